//! The pictures of a sequence.

use super::Dataset;
use super::ranges::{self, Part};
use super::tree::Tree;
use crate::annotations::{Annotation, file_name};
use std::path::{Path, PathBuf};

/// Folders that pictures may be in within a sequence's own.
const INNER: [&str; 3] = ["img", "imgs", "color"];

/// The pictures of a sequence, or why there are none.
pub fn of(
    dataset: Dataset,
    annotation: &Annotation,
    file: &Path,
    tree: &Tree,
) -> Result<Vec<PathBuf>, String> {
    let name = annotation.name.as_str();
    if dataset.is_beside() {
        let folder = file.parent().unwrap_or(Path::new(""));
        let all = in_folder(folder, tree).ok_or("no pictures beside its annotation")?;
        let part = ranges::part(dataset, name).filter(|_| all.len() > annotation.boxes.len());
        return Ok(cut(all, part));
    }
    if let Some(all) = named(dataset, name, tree) {
        // A folder of the sequence's own name holds the whole video only where the table says so.
        let part = ranges::part(dataset, name).filter(|part| part.video == name);
        return Ok(cut(all, part));
    }
    let part = ranges::part(dataset, name).ok_or(format!("no folder {name} of pictures"))?;
    let all =
        named(dataset, part.video, tree).ok_or(format!("no folder {} of pictures", part.video))?;
    Ok(cut(all, Some(part)))
}

/// The pictures in a folder of this name, or of its inner folder; the benchmark's own folder is preferred.
fn named<'a>(dataset: Dataset, name: &str, tree: &'a Tree) -> Option<&'a [PathBuf]> {
    let set = if dataset == Dataset::Uav20l {
        Dataset::Uav123.name()
    } else {
        dataset.name()
    };
    let mut found: Option<(bool, &[PathBuf])> = None;
    for (folder, pictures) in &tree.pictures {
        let own = if INNER.contains(&&*file_name(folder)) {
            folder.parent()
        } else {
            Some(folder.as_path())
        };
        let Some(own) = own.filter(|own| file_name(own) == name) else {
            continue;
        };
        let in_set = own.parent().is_some_and(|parent| file_name(parent) == set);
        if found.is_none_or(|(best, _)| in_set && !best) {
            found = Some((in_set, pictures));
        }
    }
    found.map(|(_, pictures)| pictures)
}

fn in_folder<'a>(folder: &Path, tree: &'a Tree) -> Option<&'a [PathBuf]> {
    let at = INNER
        .iter()
        .map(|inner| folder.join(inner))
        .chain([folder.to_path_buf()]);
    at.filter_map(|at| tree.pictures.get(&at))
        .next()
        .map(Vec::as_slice)
}

/// The pictures of a part: by the numbers they are named with, or else by their place.
fn cut(all: &[PathBuf], part: Option<Part>) -> Vec<PathBuf> {
    let Some(Part { first, last, .. }) = part else {
        return all.to_vec();
    };
    let numbers: Option<Vec<usize>> = all.iter().map(|path| number(path)).collect();
    let numbers = numbers.unwrap_or_else(|| (1..=all.len()).collect());
    let within = all
        .iter()
        .zip(numbers)
        .filter(|(_, number)| (first..=last).contains(number));
    within.map(|(path, _)| path.clone()).collect()
}

/// The number that a picture is named with: 12 of `000012.jpg` and `img000012.jpg`.
fn number(path: &Path) -> Option<usize> {
    let stem = path.file_stem()?.to_string_lossy();
    stem.trim_start_matches(|c: char| !c.is_ascii_digit())
        .parse()
        .ok()
}
