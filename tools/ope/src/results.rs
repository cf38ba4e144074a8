//! Folders of results: the boxes and times that a tracker wrote.

use crate::annotations::{entries, file_name, sequence_name};
use crate::bbox::BBox;
use crate::error::Error;
use crate::text;
use std::path::{Path, PathBuf};

/// A folder with the results of one tracker on one benchmark.
///
/// | what | where it is looked for |
/// |---|---|
/// | boxes | `<sequence>.txt`, `<sequence>/<sequence>_001.txt` (GOT-10k), `<sequence>/<sequence>.txt` |
/// | seconds per frame | `times/<sequence>_time.txt`, `<sequence>_time.txt`, `<sequence>/<sequence>_time.txt` |
#[derive(Clone, Debug)]
pub struct Results {
    folder: PathBuf,
}

impl Results {
    /// The results in `folder`.
    ///
    /// # Errors
    /// If it is no folder that can be read.
    pub fn open(folder: &Path) -> Result<Results, Error> {
        std::fs::read_dir(folder).map_err(Error::unreadable(folder))?;
        Ok(Results { folder: folder.to_path_buf() })
    }

    /// Where it lies.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The boxes of a sequence, one per frame; `None` if there is no file of it.
    ///
    /// # Errors
    /// If the file cannot be read, or a line is not a box.
    pub fn boxes(&self, sequence: &str) -> Result<Option<Vec<BBox>>, Error> {
        let names = [
            format!("{sequence}.txt"),
            format!("{sequence}/{sequence}_001.txt"),
            format!("{sequence}/{sequence}.txt"),
        ];
        self.first(&names).map(|path| text::read_boxes(&path)).transpose()
    }

    /// The seconds of each frame of a sequence; `None` if there is no file of it.
    ///
    /// # Errors
    /// If the file cannot be read, or a line is not a number.
    pub fn times(&self, sequence: &str) -> Result<Option<Vec<f64>>, Error> {
        let names = [
            format!("times/{sequence}_time.txt"),
            format!("{sequence}_time.txt"),
            format!("{sequence}/{sequence}_time.txt"),
        ];
        self.first(&names).map(|path| text::read_numbers(&path)).transpose()
    }

    /// The sequences that there are files `<sequence>.txt` of.
    ///
    /// # Errors
    /// If the folder cannot be read.
    pub fn names(&self) -> Result<Vec<String>, Error> {
        Ok(entries(&self.folder)?
            .iter()
            .filter(|path| path.is_file())
            .filter_map(|p| sequence_name(p))
            .collect())
    }

    /// The folder's own name: what a tracker is called unless told otherwise.
    pub fn name(&self) -> String {
        let resolved = self.folder.canonicalize().unwrap_or_else(|_| self.folder.clone());
        file_name(&resolved)
    }

    fn first(&self, names: &[String]) -> Option<PathBuf> {
        names.iter().map(|name| self.folder.join(name)).find(|path| path.is_file())
    }
}
