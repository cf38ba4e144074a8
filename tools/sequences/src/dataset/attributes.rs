//! Attributes of sequences (what makes each of them hard), from the flags that benchmarks publish.

use super::tree::Tree;
use super::{Attributes, Dataset};
use crate::error::Error;
use crate::folder::file_name;
use crate::text;
use std::path::Path;

/// UAV123's order of flags. Source: its evaluation code.
const UAV123: [&str; 12] = [
    "scale variation",
    "aspect ratio change",
    "low resolution",
    "fast motion",
    "full occlusion",
    "partial occlusion",
    "out of view",
    "background clutter",
    "illumination variation",
    "viewpoint change",
    "camera motion",
    "similar object",
];

/// UAVDT's order of flags.
const UAVDT: [&str; 9] = [
    "background clutter",
    "camera motion",
    "object motion",
    "small object",
    "illumination variation",
    "object blur",
    "scale variation",
    "long-term tracking",
    "large occlusion",
];

/// VisDrone's order of flags.
const VISDRONE: [&str; 12] = [
    "aspect ratio change",
    "background clutter",
    "camera motion",
    "fast motion",
    "full occlusion",
    "illumination variation",
    "low resolution",
    "out of view",
    "partial occlusion",
    "similar object",
    "scale variation",
    "viewpoint change",
];

/// Reads the flags `att/<sequence>.txt`, `<sequence>_att.txt` or `<sequence>_attr.txt` below a
/// root.
pub fn read(dataset: Dataset, tree: &Tree) -> Result<Attributes, Error> {
    let names: &[&str] = match dataset {
        Dataset::Uav123 | Dataset::Uav123At10Fps | Dataset::Uav20l => &UAV123,
        Dataset::Uavdt => &UAVDT,
        Dataset::Visdrone => &VISDRONE,
        _ => return Ok(Attributes::new()),
    };
    let mut attributes = Attributes::new();
    for path in &tree.texts {
        let Some(sequence) = flagged(path) else {
            continue;
        };
        let flags = text::read_all_numbers(path)?;
        if flags.len() != names.len() {
            let found = format!("{} flags", flags.len());
            return Err(Error::content(
                path,
                format!("{} flags of {}", names.len(), dataset.name()),
                found,
            ));
        }
        for (name, _) in names.iter().zip(flags).filter(|(_, flag)| *flag > 0.0) {
            let sequences = attributes.entry((*name).to_owned()).or_default();
            if !sequences.contains(&sequence) {
                sequences.push(sequence.clone());
            }
        }
    }
    Ok(attributes)
}

/// The sequence whose flags a file holds.
fn flagged(path: &Path) -> Option<String> {
    let file = file_name(path);
    let stem = file.strip_suffix(".txt")?;
    let marked = stem
        .strip_suffix("_att")
        .or_else(|| stem.strip_suffix("_attr"));
    let in_folder = path
        .parent()
        .is_some_and(|p| ["att", "attributes"].contains(&&*file_name(p)));
    marked.or(in_folder.then_some(stem)).map(str::to_owned)
}
