//! Weights as files: bounded reading, atomic writing.

use crate::{
    container::MAX_FILE_BYTES,
    error::{ReadError, WriteError},
    weights::Weights,
};
use std::{
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
    process,
    sync::atomic::{AtomicU32, Ordering},
};

impl Weights {
    /// Reads a weights file and checks all of it.
    ///
    /// # Errors
    /// Those of [`from_bytes`](Self::from_bytes), with the file's name.
    pub fn read(path: &Path) -> Result<Weights, ReadError> {
        let name = |error| ReadError::File {
            path: path.into(),
            error: Box::new(error),
        };
        let bytes = read_bounded(path, MAX_FILE_BYTES).map_err(name)?;
        Weights::from_bytes(&bytes).map_err(name)
    }

    /// Writes a weights file atomically, so that no reader ever sees half of it.
    ///
    /// # Errors
    /// Those of [`to_bytes`](Self::to_bytes) and those of the file system.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        let bytes = self.to_bytes()?;
        write_atomically(path, &bytes).map_err(|error| WriteError::Io {
            path: path.into(),
            error,
        })
    }
}

/// Reads a file of at most `most` bytes.
///
/// Reads at most one byte more, even if the file's metadata claim another length.
pub(crate) fn read_bounded(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    let too_long = |length| ReadError::container("file", format!("at most {most} bytes"), length);
    if length > most {
        return Err(too_long(format!("{length}")));
    }
    let mut bytes = Vec::with_capacity(length as usize);
    file.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        return Err(too_long("more".into()));
    }
    Ok(bytes)
}

/// Writes a temporary file in the same directory, then renames it to `path`.
pub(crate) fn write_atomically(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let temporary = beside(path)?;
    let written = File::create_new(&temporary).and_then(|mut file| {
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&temporary, path)
    });
    if written.is_err() {
        // The first error matters to the caller, and there may be nothing to remove.
        let _ = fs::remove_file(&temporary);
    }
    written
}

/// A path in the same directory that no other writer uses.
fn beside(path: &Path) -> io::Result<PathBuf> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let Some(name) = path.file_name() else {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "not the name of a file",
        ));
    };
    let mut temporary = std::ffi::OsString::from(".");
    temporary.push(name);
    temporary.push(format!(
        ".{}.{}.tmp",
        process::id(),
        COUNT.fetch_add(1, Ordering::Relaxed)
    ));
    Ok(path.with_file_name(temporary))
}
