//! The legacy stream of torch before 1.6: four pickles, a list of storage keys, then the storages.
//!
//! | part | content |
//! |---|---|
//! | pickle | the magic number |
//! | pickle | 1001, the version |
//! | pickle | a dict that says, among other things, whether the file is little-endian |
//! | pickle | the object, storages as persistent ids |
//! | pickle | the list of storage keys |
//! | per key | number of elements (i64), then the elements |
//!
//! Source: `torch.serialization._legacy_save`, docs/method.md, section 1.5.

use super::{
    Heap, Id, Storages, dict,
    pickle::{self, Value},
};
use crate::error::Refusal;
use std::{collections::BTreeMap, ops::Range};

const MAGIC: i128 = 0x1950_a86a_20f9_469c_fc6c;

/// The object's values and root, and where the storages are.
pub fn open(bytes: &[u8]) -> Result<(Heap, Id, Storages<'_>), Refusal> {
    let mut stream = Stream { bytes, at: 0 };
    for (place, number) in [("magic number", MAGIC), ("version", 1001)] {
        let (heap, root) = stream.pickle()?;
        if *heap.get(root) != Value::Int(number) {
            return Err(Refusal::new(place, number, heap.get(root).kind()));
        }
    }
    let (heap, root) = stream.pickle()?;
    let system = dict(&heap, root, "system information")?;
    match system.get("little_endian").map(|&id| heap.get(id)) {
        Some(Value::Bool(true)) => {}
        other => {
            let found = other.map_or("nothing".into(), Value::kind);
            return Err(Refusal::new(
                "system information",
                "little_endian = true",
                found,
            ));
        }
    }
    let (heap, root) = stream.pickle()?;
    let keys = stream.pickle()?;
    let ranges = stream.storages(&heap, &keys)?;
    Ok((heap, root, Storages::Ranges { bytes, ranges }))
}

struct Stream<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Stream<'_> {
    fn pickle(&mut self) -> Result<(Heap, Id), Refusal> {
        let pickle = pickle::read(&self.bytes[self.at..]).map_err(|error| Refusal {
            place: format!("from byte {}: {}", self.at, error.place),
            ..error
        })?;
        self.at += pickle.length;
        Ok((pickle.heap, pickle.root))
    }

    /// Where the storage of each key lies, up to the end of the file.
    fn storages(
        &mut self,
        heap: &Heap,
        keys: &(Heap, Id),
    ) -> Result<BTreeMap<String, Range<usize>>, Refusal> {
        let mut known = BTreeMap::new();
        for storage in heap.values() {
            let Value::Storage(storage) = storage else {
                continue;
            };
            let first = known.entry(&storage.key).or_insert(storage);
            if *first != storage {
                let place = format!("storage {:?}", storage.key);
                return Err(Refusal::new(
                    place,
                    format!("{first:?}"),
                    format!("also {storage:?}"),
                ));
            }
        }
        let (names, list) = keys;
        let Value::List(list) = names.get(*list) else {
            return Err(Refusal::new(
                "storage keys",
                "a list",
                names.get(*list).kind(),
            ));
        };
        let mut ranges = BTreeMap::new();
        for &key in list {
            let Value::Str(key) = names.get(key) else {
                return Err(Refusal::new(
                    "storage keys",
                    "strings",
                    names.get(key).kind(),
                ));
            };
            let place = || format!("storage {key:?}");
            let Some(storage) = known.get(key) else {
                return Err(Refusal::new(place(), "a tensor that uses it", "none"));
            };
            let elements =
                i64::from_le_bytes(self.take(8, place)?.try_into().expect("8 bytes were taken"));
            if usize::try_from(elements) != Ok(storage.elements) {
                return Err(Refusal::new(
                    place(),
                    format!("{} elements", storage.elements),
                    elements,
                ));
            }
            let start = self.at;
            self.take(storage.bytes().unwrap_or(usize::MAX), place)?;
            if ranges.insert(key.clone(), start..self.at).is_some() {
                return Err(super::twice(key));
            }
        }
        match self.bytes.len() - self.at {
            0 => Ok(ranges),
            more => Err(Refusal::new(
                "file",
                "its end after the last storage",
                format!("{more} more bytes"),
            )),
        }
    }

    fn take(&mut self, length: usize, place: impl Fn() -> String) -> Result<&[u8], Refusal> {
        let rest = &self.bytes[self.at..];
        if length > rest.len() {
            return Err(Refusal::new(
                place(),
                format!("{length} bytes"),
                format!("the end after {}", rest.len()),
            ));
        }
        self.at += length;
        Ok(&rest[..length])
    }
}
