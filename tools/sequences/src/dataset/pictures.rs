//! The pictures of a sequence.

use super::Dataset;
use super::ranges::{self, Part};
use super::tree::{Tree, extension};
use crate::folder::file_name;
use crate::notes::Notes;
use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

/// Folders that may hold the pictures within a sequence's own.
const INNER: [&str; 3] = ["img", "imgs", "color"];

/// Extensions from the likeliest frames to the likeliest masks.
const FRAMES_FIRST: [&str; 6] = ["jpg", "webp", "bmp", "ppm", "pgm", "png"];

/// The pictures of a sequence with `boxes` annotated frames, or the reason why there are none.
pub fn of(
    dataset: Dataset,
    name: &str,
    annotation: &Path,
    boxes: usize,
    tree: &Tree,
    notes: &mut Notes,
) -> Result<Vec<PathBuf>, String> {
    if dataset.is_beside() {
        let folder = annotation.parent().unwrap_or(Path::new(""));
        let all = beside(folder, tree)?;
        let part = ranges::part(dataset, name).filter(|_| all.len() > boxes);
        return of_one_kind(name, cut(all, part), boxes, notes);
    }
    if let Some(all) = named(dataset, name, tree) {
        // A folder of the sequence's own name holds the whole video only where the table says so.
        let part = ranges::part(dataset, name).filter(|part| part.video == name);
        return of_one_kind(name, cut(all, part), boxes, notes);
    }
    let part = ranges::part(dataset, name);
    let video = part.map_or(name, |part| part.video);
    match named(dataset, video, tree) {
        Some(all) => of_one_kind(name, cut(all, part), boxes, notes),
        None => Err(format!(
            "no pictures in a folder {video}, {}",
            INNER.map(|inner| format!("{video}/{inner}")).join(" or ")
        )),
    }
}

/// The pictures in a folder of this name or in its inner folder; the benchmark's own folder is
/// preferred.
fn named<'a>(dataset: Dataset, name: &str, tree: &'a Tree) -> Option<&'a [PathBuf]> {
    let set = match dataset {
        Dataset::Uav20l => Dataset::Uav123.name(),
        other => other.name(),
    };
    let mut found: Option<(bool, &[PathBuf])> = None;
    for (folder, pictures) in &tree.pictures {
        let own = match folder.parent() {
            Some(parent) if INNER.contains(&&*file_name(folder)) => parent,
            _ => folder,
        };
        if file_name(own) != name {
            continue;
        }
        let is_in_set = own.parent().is_some_and(|parent| file_name(parent) == set);
        if found.is_none_or(|(best, _)| is_in_set && !best) {
            found = Some((is_in_set, pictures));
        }
    }
    found.map(|(_, pictures)| pictures)
}

/// The pictures beside an annotation. If there are none, the error names the folders that were
/// searched and those below that hold pictures.
fn beside<'a>(folder: &Path, tree: &'a Tree) -> Result<&'a [PathBuf], String> {
    for inner in INNER {
        if let Some(pictures) = tree.pictures.get(&folder.join(inner)) {
            return Ok(pictures);
        }
    }
    if let Some(pictures) = tree.pictures.get(folder) {
        return Ok(pictures);
    }
    let own = file_name(folder);
    let searched = INNER.map(|inner| format!("{own}/{inner}")).join(", ");
    let mut reason = format!("no pictures in {searched} or {own}");
    let others: Vec<String> = tree
        .pictures
        .keys()
        .filter_map(|at| at.strip_prefix(folder).ok())
        .map(|below| format!("{own}/{}", below.display()))
        .collect();
    if !others.is_empty() {
        reason += &format!("; there are some in {}", others.join(", "));
    }
    Err(reason)
}

/// The frames among `all` pictures, which may include masks or depth maps.
///
/// A kind of pictures shares an extension, and has `mask` in all names or in none. The frames are
/// the kind with as many pictures as there are boxes; if several kinds have, a note names the
/// chosen one.
fn of_one_kind(
    name: &str,
    all: Vec<PathBuf>,
    boxes: usize,
    notes: &mut Notes,
) -> Result<Vec<PathBuf>, String> {
    if all.len() == boxes {
        return Ok(all);
    }
    let mut kinds: BTreeMap<Kind, Vec<PathBuf>> = BTreeMap::new();
    for path in all {
        kinds.entry(Kind::of(&path)).or_default().push(path);
    }
    if kinds.len() <= 1 {
        return Ok(kinds.into_values().next().unwrap_or_default());
    }
    let counts: Vec<String> = kinds
        .iter()
        .map(|(kind, paths)| format!("{} {kind}", paths.len()))
        .collect();
    let counts = counts.join(", ");
    kinds.retain(|kind, paths| !kind.is_mask && paths.len() == boxes);
    let several = kinds.len() > 1;
    // The map's order puts the likeliest frames first.
    let Some((kind, paths)) = kinds.into_iter().next() else {
        return Err(format!(
            "pictures of several kinds for {boxes} boxes: {counts}"
        ));
    };
    if several {
        notes.add(name, format!("used only the {kind} of {counts}"));
    }
    Ok(paths)
}

/// A kind of pictures; kinds sort from the likeliest frames to the likeliest masks.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Kind {
    is_mask: bool,
    /// Place of the extension among [`FRAMES_FIRST`].
    rank: usize,
    extension: String,
}

impl Kind {
    fn of(path: &Path) -> Kind {
        let extension = match &*extension(path) {
            "jpeg" => "jpg".to_owned(),
            other => other.to_owned(),
        };
        let rank = FRAMES_FIRST.iter().position(|known| *known == extension);
        Kind {
            is_mask: file_name(path).to_ascii_lowercase().contains("mask"),
            rank: rank.unwrap_or(FRAMES_FIRST.len()),
            extension,
        }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mask = if self.is_mask { "mask " } else { "" };
        write!(f, "{mask}.{}", self.extension)
    }
}

/// The pictures of a part, chosen by the numbers in their names, or by their place if a name has
/// none.
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

/// The number in a picture's name: 12 of `000012.jpg` and of `img000012.jpg`.
fn number(path: &Path) -> Option<usize> {
    let stem = path.file_stem()?.to_string_lossy();
    let digits = stem.trim_start_matches(|c: char| !c.is_ascii_digit());
    digits.parse().ok()
}
