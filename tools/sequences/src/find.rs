//! Sequences below a folder of any mixture of layouts, without the name of a benchmark.

use crate::annotation::{Annotation, is_groundtruth, sequence_name, single};
use crate::dataset::tree::Tree;
use crate::dataset::{Dataset, Sequence, matched, name_beside, pictures, ranges};
use crate::error::Error;
use crate::folder::{file_name, last_names};
use crate::notes::Notes;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// All sequences below a folder, by name: `<data set>/<sequence>`.
///
/// An annotation lies beside its pictures (`groundtruth*.txt`), or in a folder of annotations and
/// bears the name of the pictures' folder. A sequence that cannot be used is left out and noted.
///
/// # Errors
/// If the folder cannot be read.
pub fn find(root: &Path, notes: &mut Notes) -> Result<Vec<Sequence>, Error> {
    let tree = Tree::read(root)?;
    let mut annotations: BTreeMap<(PathBuf, String), Vec<PathBuf>> = BTreeMap::new();
    for path in &tree.texts {
        let folder = path.parent().unwrap_or(root);
        let name = if is_groundtruth(path) {
            name_beside(path)
        } else if holds_other_texts(folder, &tree) {
            None
        } else {
            sequence_name(path)
        };
        if let Some(name) = name {
            let key = (folder.to_path_buf(), name);
            annotations.entry(key).or_default().push(path.clone());
        }
    }
    let mut sequences = Vec::new();
    // Folders whose pictures are used, or whose sequence is noted as left out.
    let mut known: BTreeSet<PathBuf> = BTreeSet::new();
    for ((folder, name), paths) in annotations {
        if paths.iter().any(|path| is_groundtruth(path)) {
            known.insert(folder.clone());
        }
        match sequence(&name, &paths, &tree, notes) {
            Ok((annotation, frames)) => {
                known.extend(
                    frames
                        .iter()
                        .filter_map(|f| f.parent())
                        .map(Path::to_path_buf),
                );
                sequences.extend(matched(annotation, frames, notes));
            }
            Err(reason) => notes.add(folder.join(&name).display(), reason),
        }
    }
    for pictures in tree.pictures.keys() {
        if !pictures.ancestors().any(|folder| known.contains(folder)) {
            notes.add(pictures.display(), "pictures without an annotation");
        }
    }
    sequences.sort_by(|a, b| a.annotation.name.cmp(&b.annotation.name));
    Ok(sequences)
}

/// All pictures below a folder, by path.
///
/// # Errors
/// If the folder cannot be read.
pub fn pictures_below(root: &Path) -> Result<Vec<PathBuf>, Error> {
    let tree = Tree::read(root)?;
    let mut pictures: Vec<PathBuf> = tree.pictures.into_values().flatten().collect();
    pictures.sort();
    Ok(pictures)
}

/// Whether the texts in a folder, except `groundtruth*`, hold something other than boxes: flags,
/// first boxes only, or notes beside a sequence's pictures.
fn holds_other_texts(folder: &Path, tree: &Tree) -> bool {
    let name = file_name(folder);
    ["att", "attributes", "initialization"].contains(&&*name)
        || tree.pictures.contains_key(&folder.join("img"))
        || tree
            .texts
            .iter()
            .any(|path| path.parent() == Some(folder) && is_groundtruth(path))
}

/// A sequence's annotation and pictures, or the reason why it cannot be used.
fn sequence(
    name: &str,
    paths: &[PathBuf],
    tree: &Tree,
    notes: &mut Notes,
) -> Result<(Annotation, Vec<PathBuf>), String> {
    let path = single(paths)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let is_beside = is_groundtruth(path);
    let dataset = if is_beside {
        Dataset::Folder
    } else {
        benchmark(name, path)
    };
    let set = if is_beside {
        folder.parent().unwrap_or(Path::new(""))
    } else {
        folder
    };
    let full_name = format!("{}/{name}", last_names(set, 1));
    let annotation = Annotation::read(full_name, path).map_err(|error| error.to_string())?;
    let frames = pictures::of(dataset, name, path, annotation.boxes.len(), tree, notes)?;
    Ok((annotation, frames))
}

/// The benchmark whose table cuts a sequence from its video, recognized by the annotation's path
/// and the sequence's name.
fn benchmark(name: &str, annotation: &Path) -> Dataset {
    let path = annotation.to_string_lossy();
    let dataset = if path.contains("UAV20L") {
        Dataset::Uav20l
    } else if path.contains("10fps") {
        Dataset::Uav123At10Fps
    } else {
        Dataset::Uav123
    };
    match ranges::part(dataset, name) {
        Some(_) => dataset,
        None => Dataset::Uavdt,
    }
}

#[cfg(test)]
mod tests;
