//! A state dict as a file: a zip archive as torch 1.6 and later write it, or safetensors.

use super::{StateDict, Values, pickle::Pickle};
use crate::error::Error;
use safetensors::tensor::{Dtype, TensorView};
use std::{
    collections::HashMap,
    fs::{self, File},
    io::{self, Cursor, Write},
    path::Path,
};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

/// What stands before the names of an archive's entries.
const ROOT: &str = "archive";

impl Values {
    fn bytes(&self) -> Vec<u8> {
        match self {
            Values::F32(values) => values
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect(),
            Values::I64(value) => value.to_le_bytes().to_vec(),
        }
    }
}

impl StateDict {
    /// Writes a file, beside its place first, then renamed: safetensors if its name ends so,
    /// otherwise a zip archive that `torch.load` reads, also with `weights_only`.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        let safetensors = path
            .extension()
            .is_some_and(|extension| extension == "safetensors");
        let bytes = if safetensors {
            self.to_safetensors()
        } else {
            self.to_archive()
        };
        let written = bytes.and_then(|bytes| {
            let mut name = std::ffi::OsString::from(".");
            name.push(path.file_name().unwrap_or_default());
            name.push(format!(".{}.tmp", std::process::id()));
            let temporary = path.with_file_name(name);
            let written = File::create(&temporary).and_then(|mut file| {
                file.write_all(&bytes)?;
                file.sync_all()?;
                fs::rename(&temporary, path)
            });
            if written.is_err() {
                let _ = fs::remove_file(&temporary); // the first error is the one worth reporting
            }
            written
        });
        written.map_err(|error| {
            Error::Unwritable(weights_format::WriteError::Io {
                path: path.into(),
                error,
            })
        })
    }

    /// The archive: the pickle, what torch wants beside it, and a storage per tensor.
    fn to_archive(&self) -> io::Result<Vec<u8>> {
        let mut pickle = Pickle::dict();
        for (i, (name, shape, values)) in self.entries.iter().enumerate() {
            let class = match values {
                Values::F32(_) => "FloatStorage",
                Values::I64(_) => "LongStorage",
            };
            pickle.tensor(name, class, &i.to_string(), shape);
        }
        let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
        let mut add = |name: &str, bytes: &[u8]| {
            archive.start_file(format!("{ROOT}/{name}"), options)?;
            archive.write_all(bytes)
        };
        add("data.pkl", &pickle.finish())?;
        add("byteorder", b"little")?;
        for (i, (_, _, values)) in self.entries.iter().enumerate() {
            add(&format!("data/{i}"), &values.bytes())?;
        }
        add("version", b"3\n")?;
        Ok(archive.finish()?.into_inner())
    }

    fn to_safetensors(&self) -> io::Result<Vec<u8>> {
        let bytes: Vec<Vec<u8>> = self
            .entries
            .iter()
            .map(|(_, _, values)| values.bytes())
            .collect();
        let views: Result<Vec<_>, _> = self
            .entries
            .iter()
            .zip(&bytes)
            .map(|((name, shape, values), bytes)| {
                let dtype = if matches!(values, Values::F32(_)) {
                    Dtype::F32
                } else {
                    Dtype::I64
                };
                Ok((name.clone(), TensorView::new(dtype, shape.clone(), bytes)?))
            })
            .collect();
        let metadata = HashMap::from([("format".to_owned(), "pt".to_owned())]);
        views
            .and_then(|views| safetensors::serialize(views, Some(metadata)))
            .map_err(io::Error::other)
    }
}
