//! Listing of folders without the files that operating systems and archives add.

use crate::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

/// Whether a file or folder of this name belongs to the system and never to a data set.
///
/// Those are names that begin with a dot (`._0001.jpg` from macOS, `.ipynb_checkpoints`) and the
/// folders that archives, network storage and drives add.
pub fn is_passed_over(name: &str) -> bool {
    const SYSTEM: [&str; 5] = [
        "__MACOSX",
        "@eaDir",
        "$RECYCLE.BIN",
        "System Volume Information",
        "lost+found",
    ];
    name.starts_with('.') || SYSTEM.contains(&name)
}

/// The paths in a folder, sorted, without those that [`is_passed_over`] names.
///
/// # Errors
/// If the folder cannot be read.
pub fn entries(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).map_err(Error::unreadable(folder))? {
        let path = entry.map_err(Error::unreadable(folder))?.path();
        if !is_passed_over(&file_name(&path)) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}

/// The last part of a path as text.
pub fn file_name(path: &Path) -> String {
    path.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// The last `count` parts of a path, joined by slashes.
pub fn last_names(path: &Path, count: usize) -> String {
    let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
    parts[parts.len().saturating_sub(count)..].join("/")
}
