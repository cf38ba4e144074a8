//! A PyTorch checkpoint as what we want of it: named tensors, read when asked for.

mod legacy;
mod pickle;
mod torch;
mod zip;

use crate::error::Refusal;
use pickle::{Heap, Id, Value};
use std::{collections::BTreeMap, ops::Range};
use torch::{StorageRef, TensorRef};

/// Longest checkpoint accepted, and most bytes that its storages may have when decompressed.
pub const MAX_BYTES: u64 = 1 << 30;

/// A state dict whose tensors are read when asked for.
#[derive(Debug)]
pub struct Checkpoint<'a> {
    tensors: BTreeMap<String, TensorRef>,
    others: Vec<String>,
    storages: Storages<'a>,
}

impl<'a> Checkpoint<'a> {
    /// Reads the structure of a checkpoint: a zip archive or a legacy stream, its state dict under
    /// `model_state_dict`, under `state_dict` or bare, its names with or without `module.`.
    ///
    /// # Errors
    /// Says which part of the file, which byte of the pickle or which key is not acceptable.
    pub fn from_bytes(bytes: &'a [u8]) -> Result<Checkpoint<'a>, Refusal> {
        let (heap, root, storages) = match bytes {
            [b'P', b'K', 3, 4, ..] => zip::open(bytes)?,
            [0x80, ..] => legacy::open(bytes)?,
            _ => {
                let first = &bytes[..bytes.len().min(4)];
                let expected = "a PyTorch checkpoint (zip archive or legacy stream)";
                return Err(Refusal::new(
                    "file",
                    expected,
                    format!("first bytes {first:02x?}"),
                ));
            }
        };
        let mut others = Vec::new();
        let mut entries = dict(&heap, root, "checkpoint")?;
        let wrapped = ["model_state_dict", "state_dict"]
            .into_iter()
            .find(|&key| entries.contains_key(key));
        if let Some(key) = wrapped {
            let inner = dict(&heap, entries[key], key)?;
            others.extend(entries.into_keys().filter(|name| name != key));
            entries = inner;
        }
        let mut tensors = BTreeMap::new();
        for (name, id) in entries {
            let name = name.strip_prefix("module.").unwrap_or(&name);
            match heap.get(id) {
                Value::Tensor(tensor) => {
                    if tensors
                        .insert(name.to_owned(), (**tensor).clone())
                        .is_some()
                    {
                        return Err(twice(name));
                    }
                }
                _ => others.push(name.to_owned()),
            }
        }
        Ok(Checkpoint {
            tensors,
            others,
            storages,
        })
    }

    /// Names of the tensors, without `module.`.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// Keys of whatever else lies beside the tensors and beside the state dict.
    pub fn others(&self) -> &[String] {
        &self.others
    }

    /// Shape of a tensor, if there is one of that name.
    pub fn shape(&self, name: &str) -> Option<&[usize]> {
        self.tensors.get(name).map(|tensor| &tensor.shape[..])
    }

    /// Values of a tensor, row-major.
    ///
    /// # Errors
    /// If there is no such tensor, it has another shape or an integer type, its storage is not as long as the pickle
    /// says, or a value is not finite.
    pub fn load(&mut self, name: &str, shape: &[usize]) -> Result<Vec<f64>, Refusal> {
        let place = || format!("tensor {name:?}");
        let Some(tensor) = self.tensors.get(name) else {
            return Err(Refusal::new(
                place(),
                format!("shape {shape:?}"),
                "no such tensor",
            ));
        };
        if tensor.shape != shape {
            return Err(Refusal::new(
                place(),
                format!("shape {shape:?}"),
                format!("shape {:?}", tensor.shape),
            ));
        }
        let bytes = self.storages.get(&tensor.storage)?;
        let Some(values) = tensor.elements(bytes) else {
            return Err(Refusal::new(
                place(),
                "a floating-point type",
                format!("{:?}", tensor.storage.dtype),
            ));
        };
        match values
            .iter()
            .enumerate()
            .find(|(_, value)| !value.is_finite())
        {
            Some((i, value)) => Err(Refusal::new(
                place(),
                "finite values",
                format!("{value} at element {i}"),
            )),
            None => Ok(values),
        }
    }
}

/// The entries of a dict whose keys are strings, none of them twice.
fn dict(heap: &Heap, id: Id, place: &str) -> Result<BTreeMap<String, Id>, Refusal> {
    let Value::Dict(items) = heap.get(id) else {
        return Err(Refusal::new(place, "a dict", heap.get(id).kind()));
    };
    let mut entries = BTreeMap::new();
    for &(key, value) in items {
        let Value::Str(key) = heap.get(key) else {
            return Err(Refusal::new(place, "strings as keys", heap.get(key).kind()));
        };
        if entries.insert(key.clone(), value).is_some() {
            return Err(twice(key));
        }
    }
    Ok(entries)
}

fn twice(key: &str) -> Refusal {
    Refusal::new(format!("key {key:?}"), "one entry", "two")
}

/// Where the bytes of a checkpoint's storages are.
#[derive(Debug)]
enum Storages<'a> {
    Zip(zip::Entries<'a>),
    Legacy {
        bytes: &'a [u8],
        ranges: BTreeMap<String, Range<usize>>,
    },
}

impl Storages<'_> {
    /// The bytes of a storage, exactly as many as its elements need.
    fn get(&mut self, storage: &StorageRef) -> Result<&[u8], Refusal> {
        let place = || format!("storage {:?}", storage.key);
        let expected = storage.bytes().unwrap_or(usize::MAX);
        let bytes = match self {
            Storages::Zip(entries) => entries.get(&storage.key, expected)?,
            Storages::Legacy { bytes, ranges } => match ranges.get(&storage.key) {
                Some(range) => &bytes[range.clone()],
                None => return Err(Refusal::new(place(), "its data", "none")),
            },
        };
        if bytes.len() != expected {
            return Err(Refusal::new(
                place(),
                format!("{expected} bytes"),
                bytes.len(),
            ));
        }
        Ok(bytes)
    }
}
