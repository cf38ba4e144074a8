//! Why a station does not start, or ends early.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Largest key or token file in bytes.
const MAX_SECRET: u64 = 4096;

/// Why a station does not start, or ends early.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The source cannot be opened, or has failed for good.
    #[error("{0}")]
    Source(String),
    /// A key, a token or a log cannot be read.
    #[error("{file}: {reason}")]
    File {
        /// The file, and where in it.
        file: String,
        /// What was expected and found.
        reason: String,
    },
    /// An output cannot be set up.
    #[error("{output}: {reason}")]
    Output {
        /// The option, file or stream.
        output: String,
        /// What was expected, or the system's reason.
        reason: String,
    },
    /// The first target is refused, and no client can name another one.
    #[error("--init: {0}")]
    Refused(String),
    /// The reader of standard output has gone, and there is no other output.
    #[error("standard output was closed")]
    ClosedPipe,
}

impl Error {
    /// A failure to read `path`.
    pub fn file(path: &Path, reason: impl ToString) -> Error {
        Error::File {
            file: path.display().to_string(),
            reason: reason.to_string(),
        }
    }

    /// A failure to set up an output.
    pub fn output(output: impl ToString, reason: impl ToString) -> Error {
        Error::Output {
            output: output.to_string(),
            reason: reason.to_string(),
        }
    }
}

/// Reads the file of a key or a token, which is small.
///
/// # Errors
/// If it cannot be read, or is larger than any such file: a device would never end.
pub(crate) fn read_secret(path: &Path) -> Result<Vec<u8>, Error> {
    let wrong = |error: std::io::Error| Error::file(path, error);
    let file = File::open(path).map_err(wrong)?;
    let mut bytes = Vec::new();
    file.take(MAX_SECRET + 1)
        .read_to_end(&mut bytes)
        .map_err(wrong)?;
    if bytes.len() as u64 > MAX_SECRET {
        let reason = format!("holds more than {MAX_SECRET} bytes, expected a key or token");
        return Err(Error::file(path, reason));
    }
    Ok(bytes)
}
