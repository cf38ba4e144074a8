//! The zip archive of torch 1.6 and later: `<name>/data.pkl`, `<name>/data/<key>`, and perhaps
//! `<name>/byteorder`.

use super::{Heap, Id, MAX_BYTES, Storages, pickle};
use crate::error::Refusal;
use std::{
    collections::HashMap,
    io::{Cursor, Read},
};
use zip::{CompressionMethod, ZipArchive};

/// The object's values and root, and where the storages are.
pub fn open(bytes: &[u8]) -> Result<(Heap, Id, Storages<'_>), Refusal> {
    let archive = ZipArchive::new(Cursor::new(bytes))
        .map_err(|error| Refusal::new("file", "a zip archive", error))?;
    if archive.has_duplicate_names() {
        return Err(Refusal::new("zip archive", "every name once", "one twice"));
    }
    let pickles: Vec<String> = archive
        .file_names()
        .filter_map(|name| Some(name.ok()?.into_owned()))
        .filter(|name| name == "data.pkl" || name.ends_with("/data.pkl"))
        .collect();
    let [name] = &pickles[..] else {
        return Err(Refusal::new(
            "zip archive",
            "one entry `data.pkl`",
            pickles.len(),
        ));
    };
    let root = name.strip_suffix("data.pkl").unwrap_or_default().to_owned();
    let mut entries = Entries {
        archive,
        root,
        read: HashMap::new(),
        left: MAX_BYTES,
    };
    if let Some(order) = entries.optional("byteorder", 16)?
        && order != b"little"
    {
        return Err(Refusal::new(
            "byteorder",
            "little",
            String::from_utf8_lossy(&order),
        ));
    }
    let bytes = entries.required("data.pkl", pickle::MAX_BYTES)?;
    let pickle = pickle::read(&bytes)?;
    if pickle.length != bytes.len() {
        let expected = format!("{} bytes, the end of its pickle", pickle.length);
        return Err(Refusal::new("data.pkl", expected, bytes.len()));
    }
    Ok((pickle.heap, pickle.root, Storages::Zip(entries)))
}

/// The archive's entries, each decompressed at most once, all of them within one bound.
#[derive(Debug)]
pub struct Entries<'a> {
    archive: ZipArchive<Cursor<&'a [u8]>>,
    /// What stands before `data.pkl`.
    root: String,
    read: HashMap<String, Vec<u8>>,
    left: u64,
}

impl Entries<'_> {
    /// The bytes of a storage that should have `expected` of them.
    pub fn get(&mut self, key: &str, expected: usize) -> Result<&[u8], Refusal> {
        if !self.read.contains_key(key) {
            let bytes = self.required(&format!("data/{key}"), expected)?;
            self.read.insert(key.to_owned(), bytes);
        }
        Ok(&self.read[key])
    }

    fn required(&mut self, name: &str, most: usize) -> Result<Vec<u8>, Refusal> {
        match self.optional(name, most)? {
            Some(bytes) => Ok(bytes),
            None => Err(Refusal::new(
                "zip archive",
                format!("an entry {name:?}"),
                "none",
            )),
        }
    }

    /// An entry of at most `most` bytes; neither what the archive says about its size nor what the
    /// compressed bytes make of it is believed beyond that.
    fn optional(&mut self, name: &str, most: usize) -> Result<Option<Vec<u8>>, Refusal> {
        let full = format!("{}{name}", self.root);
        let place = || format!("zip entry {full:?}");
        let Some(index) = self.archive.index_for_name(&full) else {
            return Ok(None);
        };
        let unreadable =
            |error: &dyn ToString| Refusal::new(place(), "readable data", error.to_string());
        let entry = self
            .archive
            .by_index(index)
            .map_err(|error| unreadable(&error))?;
        if !matches!(
            entry.compression(),
            CompressionMethod::Stored | CompressionMethod::Deflated
        ) {
            return Err(Refusal::new(
                place(),
                "no compression or deflate",
                entry.compression(),
            ));
        }
        let most = self.left.min(most as u64);
        if entry.size() > most {
            return Err(Refusal::new(
                place(),
                format!("at most {most} bytes"),
                entry.size(),
            ));
        }
        let mut bytes = Vec::new();
        entry
            .take(most + 1)
            .read_to_end(&mut bytes)
            .map_err(|error| unreadable(&error))?;
        if bytes.len() as u64 > most {
            return Err(Refusal::new(
                place(),
                format!("at most {most} bytes"),
                "more",
            ));
        }
        self.left -= bytes.len() as u64;
        Ok(Some(bytes))
    }
}
