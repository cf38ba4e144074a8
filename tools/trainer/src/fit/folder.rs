//! The folder of a run: one run at a time, and no run over another one's results.

use crate::error::Error;
use std::fs::{self, File, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Files in which a run keeps its results.
const RESULTS: [&str; 4] = [
    "checkpoint.safetensors",
    "best.safetensors",
    "final.safetensors",
    "weights.safetensors",
];

/// Files about a run that are worth nothing without its results.
const RECORDS: [&str; 2] = ["log.jsonl", "curves.svg"];

/// A folder that belongs to one run until the value is dropped or the process ends.
#[derive(Debug)]
pub struct Claim {
    folder: PathBuf,
    _lock: Option<File>, // `None` where the file system has no locks
}

impl Claim {
    /// Claims a folder, and creates it if need be.
    ///
    /// # Errors
    /// If another run has claimed the folder, or if the folder cannot be written.
    pub fn new(folder: &Path) -> Result<Claim, Error> {
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let path = folder.join(".lock");
        let file = File::create(&path).map_err(Error::io(&path))?;
        let lock = match file.try_lock() {
            Ok(()) => Some(file),
            Err(TryLockError::WouldBlock) => {
                let found = format!("{}, in which another run is under way", folder.display());
                return Err(Error::option("--out", "a folder of its own", found));
            }
            Err(TryLockError::Error(error)) if error.kind() == ErrorKind::Unsupported => None,
            Err(TryLockError::Error(error)) => return Err(Error::io(path)(error)),
        };
        Ok(Claim {
            folder: folder.to_owned(),
            _lock: lock,
        })
    }

    /// Removes what an earlier run left in the folder.
    ///
    /// # Errors
    /// If a file cannot be removed.
    pub fn clear(&self) -> Result<(), Error> {
        for file in present(&self.folder, RESULTS.iter().chain(&RECORDS)) {
            fs::remove_file(&file).map_err(Error::io(&file))?;
        }
        Ok(())
    }
}

/// Refuses a folder that holds results of a run.
///
/// # Errors
/// Names one of the results.
pub fn refuse_used(folder: &Path) -> Result<(), Error> {
    let expected =
        "a folder without a run, or --resume CHECKPOINT to continue that run, or --overwrite";
    let results = present(folder, RESULTS.iter());
    match results.first() {
        None => Ok(()),
        Some(result) => Err(Error::option("--out", expected, result.display())),
    }
}

fn present<'a>(folder: &Path, names: impl Iterator<Item = &'a &'a str>) -> Vec<PathBuf> {
    names
        .map(|name| folder.join(name))
        .filter(|file| file.exists())
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Folder;

    #[test]
    fn used_folder_is_refused_until_it_is_cleared() {
        let folder = Folder::new("used");
        let run = folder.path().join("run");
        let unused = refuse_used(&run);
        let claim = Claim::new(&run).unwrap();
        for name in ["final.safetensors", "log.jsonl", "notes.txt"] {
            fs::write(run.join(name), name).unwrap();
        }

        let refused = refuse_used(&run).unwrap_err().to_string();
        claim.clear().unwrap();

        assert!(unused.is_ok());
        for part in ["--resume", "--overwrite", "final.safetensors"] {
            assert!(refused.contains(part), "{refused}");
        }
        assert!(refuse_used(&run).is_ok() && !run.join("log.jsonl").exists());
        assert!(run.join("notes.txt").exists(), "not a file of the trainer");
    }

    #[test]
    fn claimed_folder_is_refused_until_it_is_free() {
        let folder = Folder::new("claimed");
        let first = Claim::new(folder.path()).unwrap();

        let second = Claim::new(folder.path()).unwrap_err().to_string();
        drop(first);

        assert!(second.contains("another run"), "{second}");
        assert!(Claim::new(folder.path()).is_ok());
    }
}
