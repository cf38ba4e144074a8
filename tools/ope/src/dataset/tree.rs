//! What lies below a root: folders of pictures, and texts.

use crate::annotations::{entries, file_name};
use crate::error::Error;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folders below the root that are looked into.
const MAX_DEPTH: usize = 6;

/// Endings of pictures.
const PICTURES: [&str; 5] = ["jpg", "jpeg", "png", "webp", "bmp"];

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
        tree.pictures
            .values_mut()
            .for_each(|paths| paths.sort_by_cached_key(|path| natural(&file_name(path))));
        Ok(tree)
    }

    fn walk(&mut self, folder: &Path, depth: usize) -> Result<(), Error> {
        for path in entries(folder)? {
            let ending = path
                .extension()
                .unwrap_or_default()
                .to_string_lossy()
                .to_ascii_lowercase();
            if PICTURES.contains(&&*ending) {
                self.pictures
                    .entry(folder.to_path_buf())
                    .or_default()
                    .push(path);
            } else if ending == "txt" {
                self.texts.push(path);
            } else if depth < MAX_DEPTH && path.is_dir() {
                self.walk(&path, depth + 1)?;
            }
        }
        Ok(())
    }

    /// Whether texts lie right in a folder of this name.
    pub fn has_texts_in(&self, folder: &str) -> bool {
        let is_in = |path: &PathBuf| {
            path.parent()
                .is_some_and(|p| file_name(p).eq_ignore_ascii_case(folder))
        };
        self.texts.iter().any(is_in)
    }
}

/// A key in whose order `img2` comes before `img10`.
fn natural(name: &str) -> Vec<(String, u64)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let words = rest
            .find(|c: char| c.is_ascii_digit())
            .unwrap_or(rest.len());
        let (word, numbers) = rest.split_at(words);
        let digits = numbers
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(numbers.len());
        let (number, after) = numbers.split_at(digits);
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
    fn natural_order() {
        let mut names = ["img10.jpg", "img2.jpg", "img1.jpg", "a.jpg", "img002.jpg"];
        names.sort_by_key(|name| natural(name));
        assert_eq!(
            names,
            ["a.jpg", "img1.jpg", "img002.jpg", "img2.jpg", "img10.jpg"]
        );
    }
}
