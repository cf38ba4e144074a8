//! A temporary folder.

use std::fs;
use std::path::{Path, PathBuf};
use std::process;
use std::sync::atomic::{AtomicUsize, Ordering};

/// A new empty folder that is removed with everything in it when dropped.
#[derive(Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// Creates a folder whose path contains `name`, the process id and a counter.
    ///
    /// Panics if the system refuses.
    pub fn new(name: &str) -> Folder {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let unique = format!("track-cpu-{name}-{}-{count}", process::id());
        let path = std::env::temp_dir().join(unique);
        fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    /// The folder's path.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// The path of `name` below the folder.
    pub fn join(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// The path of `name` below the folder as text, for a command line.
    pub fn at(&self, name: &str) -> String {
        self.join(name).display().to_string()
    }

    /// Writes the file `name` below the folder, with the folders above it, and returns its path.
    ///
    /// Panics if the system refuses.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, content).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // A folder that cannot be removed is left to the system.
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dropped_folder_is_removed_with_its_files() {
        let folder = Folder::new("drop");
        let file = folder.write("deep/below/file.txt", "x");
        let path = folder.path().to_path_buf();
        assert!(file.is_file());

        drop(folder);

        assert!(!path.exists());
    }

    #[test]
    fn two_folders_of_one_name_are_distinct() {
        let first = Folder::new("same");
        let second = Folder::new("same");

        assert_ne!(first.path(), second.path());
    }
}
