//! A PyTorch checkpoint as what we want of it: named tensors, read when asked for.

mod legacy;
mod pickle;
mod tensors;
mod torch;
mod zip;

use crate::error::Refusal;
use crate::names::{self, Role};
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
    /// Reads the structure of a checkpoint: a zip archive, a legacy stream or a safetensors file.
    ///
    /// The state dict is the whole file, or it lies under one of [`names::STATE_DICT_KEYS`] or
    /// another key, up to [`MAX_DEPTH`] dicts deep. Names lose what wrappers put before them
    /// ([`names::bare`]).
    ///
    /// # Errors
    /// Says which part of the file, which byte of the pickle or which key is not acceptable.
    pub fn from_bytes(bytes: &'a [u8]) -> Result<Checkpoint<'a>, Refusal> {
        let (heap, root, storages) = match bytes {
            [b'P', b'K', 3, 4, ..] => zip::open(bytes)?,
            [0x80, ..] => legacy::open(bytes)?,
            [_, _, _, _, _, _, _, _, b'{', ..] => return tensors::open(bytes),
            _ => {
                let first = &bytes[..bytes.len().min(4)];
                let expected = "a PyTorch checkpoint (zip archive, legacy stream or safetensors)";
                let found = format!("first bytes {first:02x?}");
                return Err(Refusal::new("file", expected, found));
            }
        };
        let found = StateDict::find(&heap, root)?;
        let mut tensors = BTreeMap::new();
        let mut others = found.others;
        for (name, id) in found.entries {
            match heap.get(id) {
                Value::Tensor(tensor) => insert(&mut tensors, &name, (**tensor).clone())?,
                _ => others.push(name),
            }
        }
        Ok(Checkpoint {
            tensors,
            others,
            storages,
        })
    }

    /// Names of the tensors, without those of wrappers.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// Keys of everything else, beside the tensors and beside the state dict.
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
    /// If there is no such tensor, it has another shape or an integer type, its storage is not as
    /// long as the pickle says, or a value is not finite.
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

/// Adds a tensor under its bare name.
fn insert(
    tensors: &mut BTreeMap<String, TensorRef>,
    name: &str,
    tensor: TensorRef,
) -> Result<(), Refusal> {
    let name = names::bare(name);
    match tensors.insert(name.to_owned(), tensor) {
        Some(_) => Err(twice(name)),
        None => Ok(()),
    }
}

/// Most dicts within each other that a state dict is looked for in.
const MAX_DEPTH: usize = 4;
/// Most dicts that are searched, since one may contain itself.
const MAX_DICTS: usize = 256;

/// Where a checkpoint keeps its tensors.
struct StateDict {
    entries: BTreeMap<String, Id>,
    /// Keys that were ignored on the way.
    others: Vec<String>,
}

impl StateDict {
    /// The first dict that has a tensor of the network; without one, the dict under the first known
    /// key, or the root.
    fn find(heap: &Heap, root: Id) -> Result<StateDict, Refusal> {
        let entries = match heap.get(root) {
            Value::Opaque(name) => {
                let expected = "a state dict: torch.save(model.state_dict(), ...) writes one";
                let found = format!("a whole object of `{name}`");
                return Err(Refusal::new("checkpoint", expected, found));
            }
            _ => dict(heap, root, "checkpoint")?,
        };
        let mut dicts = MAX_DICTS;
        if let Some(found) = Self::below(heap, &entries, MAX_DEPTH, &mut dicts) {
            return Ok(found);
        }
        let known = names::STATE_DICT_KEYS
            .iter()
            .find(|key| entries.contains_key(**key));
        let Some(&key) = known else {
            return Ok(StateDict {
                entries,
                others: Vec::new(),
            });
        };
        let inner = dict(heap, entries[key], key)?;
        Ok(StateDict {
            entries: inner,
            others: entries.into_keys().filter(|other| other != key).collect(),
        })
    }

    /// Looks through a dict and the dicts within it, known keys first.
    fn below(
        heap: &Heap,
        entries: &BTreeMap<String, Id>,
        depth: usize,
        dicts: &mut usize,
    ) -> Option<StateDict> {
        let of_network = |(name, id): (&String, &Id)| {
            matches!(heap.get(*id), Value::Tensor(_))
                && names::role(names::bare(name)) == Role::Deployed
        };
        if entries.iter().any(of_network) {
            return Some(StateDict {
                entries: entries.clone(),
                others: Vec::new(),
            });
        }
        if depth <= 1 {
            return None;
        }
        let known = names::STATE_DICT_KEYS.iter().map(|key| key.to_string());
        for key in known.chain(entries.keys().cloned()) {
            let Some(&id) = entries.get(&key) else {
                continue;
            };
            if *dicts == 0 || !matches!(heap.get(id), Value::Dict(_)) {
                continue;
            }
            *dicts -= 1;
            let Ok(inner) = dict(heap, id, &key) else {
                continue;
            };
            if let Some(mut found) = Self::below(heap, &inner, depth - 1, dicts) {
                found
                    .others
                    .extend(entries.keys().filter(|other| **other != key).cloned());
                return Some(found);
            }
        }
        None
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
    /// One run of bytes that holds them all: a legacy stream or a safetensors file.
    Ranges {
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
            Storages::Ranges { bytes, ranges } => match ranges.get(&storage.key) {
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
