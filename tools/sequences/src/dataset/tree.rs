//! What lies below a root: folders of pictures, and texts.

use crate::error::Error;
use crate::folder::{entries, file_name};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Depth of folders below the root that are searched.
const MAX_DEPTH: usize = 6;

/// Extensions of pictures.
const PICTURES: [&str; 7] = ["jpg", "jpeg", "png", "webp", "bmp", "pgm", "ppm"];

/// Pictures by folder in natural order, and texts in order.
#[derive(Debug, Default)]
pub struct Tree {
    pub pictures: BTreeMap<PathBuf, Vec<PathBuf>>,
    pub texts: Vec<PathBuf>,
}

impl Tree {
    pub fn read(root: &Path) -> Result<Tree, Error> {
        let mut tree = Tree::default();
        tree.walk(root, 0)?;
        for paths in tree.pictures.values_mut() {
            paths.sort_by_cached_key(|path| natural(&file_name(path)));
        }
        Ok(tree)
    }

    fn walk(&mut self, folder: &Path, depth: usize) -> Result<(), Error> {
        for path in entries(folder)? {
            let extension = extension(&path);
            if path.is_dir() {
                if depth < MAX_DEPTH {
                    self.walk(&path, depth + 1)?;
                }
            } else if PICTURES.contains(&&*extension) {
                let pictures = self.pictures.entry(folder.to_path_buf());
                pictures.or_default().push(path);
            } else if extension == "txt" {
                self.texts.push(path);
            }
        }
        Ok(())
    }

    /// Whether texts lie right in a folder of this name.
    pub fn has_texts_in(&self, folder: &str) -> bool {
        let is_in = |path: &PathBuf| {
            let parent = path.parent().map(file_name);
            parent.is_some_and(|name| name.eq_ignore_ascii_case(folder))
        };
        self.texts.iter().any(is_in)
    }
}

/// The extension of a path in lower case; empty without one.
pub fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_ascii_lowercase()
}

/// A key in whose order `img2` comes before `img10`.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let digit = |c: char| c.is_ascii_digit();
        let (word, numbers) = rest.split_at(rest.find(digit).unwrap_or(rest.len()));
        let end = numbers.find(|c| !digit(c)).unwrap_or(numbers.len());
        let (number, after) = numbers.split_at(end);
        parts.push((word.to_owned(), number.parse().unwrap_or(u64::MAX)));
        rest = after;
    }
    parts.push((name.to_owned(), 0));
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_sort_by_their_numbers() {
        let mut names = ["img10.jpg", "img2.jpg", "img1.jpg", "a.jpg", "img002.jpg"];

        names.sort_by_key(|name| natural(name));

        let expected = ["a.jpg", "img1.jpg", "img002.jpg", "img2.jpg", "img10.jpg"];
        assert_eq!(names, expected);
    }
}
