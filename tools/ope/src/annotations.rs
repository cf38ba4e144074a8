//! Annotated boxes: the truth that results are held against.

use crate::bbox::BBox;
use crate::error::Error;
use crate::text;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// The boxes of one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Annotation {
    /// The sequence's name.
    pub name: String,
    /// One box per frame, as in the file.
    pub boxes: Vec<BBox>,
    /// Whether the target is there, per frame, where a list of that exists.
    pub present: Option<Vec<bool>>,
    /// Picture pixels per pixel of the original video: thresholds are in those of the video.
    pub scale: f64,
}

impl Annotation {
    /// Whether the target is in frame `i`; true where nothing is known.
    pub fn is_present(&self, i: usize) -> bool {
        self.present
            .as_ref()
            .is_none_or(|present| present.get(i).copied().unwrap_or(true))
    }
}

/// Reads a folder of annotations: `<sequence>.txt`, `<sequence>_gt.txt` (UAVDT) or `<sequence>/groundtruth*.txt`.
///
/// # Errors
/// If the folder or a file cannot be read, a file holds no boxes, there is none, or two are of one sequence.
pub fn read_folder(folder: &Path) -> Result<Vec<Annotation>, Error> {
    let mut files = BTreeMap::new();
    for path in entries(folder)? {
        let (name, path) = if path.is_dir() {
            let Some(file) = annotation_in(&path)? else {
                continue;
            };
            (file_name(&path), file)
        } else if let Some(name) = sequence_name(&path) {
            (name, path)
        } else {
            continue;
        };
        if let Some(other) = files.insert(name.clone(), path) {
            let expected = format!("one annotation of {name}");
            return Err(Error::content(
                folder,
                expected,
                format!("two, one of them {}", other.display()),
            ));
        }
    }
    if files.is_empty() {
        return Err(Error::content(folder, "annotations <sequence>.txt", "none"));
    }
    let read = |(name, path): (String, PathBuf)| {
        let (boxes, scale) = (text::read_boxes(&path)?, scale_beside(&path)?);
        Ok(Annotation {
            name,
            boxes,
            present: None,
            scale,
        })
    };
    files.into_iter().map(read).collect()
}

/// The `scale` that a `meta.json` beside an annotation states; 1 where there is none.
///
/// # Errors
/// If the file cannot be used, or the scale is not above 0.
pub fn scale_beside(annotation: &Path) -> Result<f64, Error> {
    let path = annotation.with_file_name("meta.json");
    if !path.is_file() {
        return Ok(1.0);
    }
    let failure =
        |found: String| Error::content(&path, "JSON with a scale above 0, or none", found);
    let meta: Meta =
        serde_json::from_str(&text::read(&path)?).map_err(|error| failure(error.to_string()))?;
    let usable = meta.scale > 0.0 && meta.scale.is_finite();
    if usable {
        Ok(meta.scale)
    } else {
        Err(failure(meta.scale.to_string()))
    }
}

#[derive(serde::Deserialize)]
struct Meta {
    #[serde(default = "one")]
    scale: f64,
}

fn one() -> f64 {
    1.0
}

/// The sequence that a file of boxes is named after; `None` if it is none.
pub fn sequence_name(path: &Path) -> Option<String> {
    let stem = file_name(path).strip_suffix(".txt")?.to_owned();
    let other = ["_time", "_att", "_attr", "_absent"]
        .iter()
        .any(|suffix| stem.ends_with(suffix));
    if other || stem.starts_with('.') || stem.is_empty() {
        return None;
    }
    Some(stem.strip_suffix("_gt").unwrap_or(&stem).to_owned())
}

/// The annotation in a sequence's own folder.
fn annotation_in(folder: &Path) -> Result<Option<PathBuf>, Error> {
    let is_annotation = |path: &PathBuf| {
        let name = file_name(path);
        name.starts_with("groundtruth") && name.ends_with(".txt")
    };
    Ok(entries(folder)?.into_iter().find(is_annotation))
}

/// What is in a folder, sorted.
pub fn entries(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let read = fs::read_dir(folder).map_err(Error::unreadable(folder))?;
    let paths: std::io::Result<Vec<PathBuf>> = read.map(|entry| Ok(entry?.path())).collect();
    let mut paths = paths.map_err(Error::unreadable(folder))?;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Folder;

    #[test]
    fn every_layout_of_annotations() {
        let folder = Folder::new("annotations");
        folder.write("bike1.txt", "1,2,3,4\n");
        folder.write("S0101_gt.txt", "1,2,3,4\n5,6,7,8\n");
        folder.write("Gull2/groundtruth_rect.txt", "1\t2\t3\t4\n");
        folder.write("Gull2/meta.json", r#"{"scale": 0.75, "more": []}"#);
        folder.write("att/bike1.txt", "0,1\n");
        folder.write("S0101_att.txt", "0,1\n");
        folder.write("list.csv", "bike1\n");
        let read = read_folder(folder.path()).unwrap();
        let names: Vec<_> = read.iter().map(|a| (&a.name[..], a.boxes.len())).collect();
        assert_eq!(names, [("Gull2", 1), ("S0101", 2), ("bike1", 1)]);
        assert_eq!((read[0].scale, read[1].scale), (0.75, 1.0));
        folder.write("Gull2/meta.json", r#"{"scale": 0}"#);
        assert!(
            read_folder(folder.path())
                .unwrap_err()
                .to_string()
                .contains("a scale above 0")
        );
        folder.write("Gull2/meta.json", "{}");
        folder.write("bike1_gt.txt", "1,2,3,4\n");
        assert!(
            read_folder(folder.path())
                .unwrap_err()
                .to_string()
                .contains("one annotation of bike1")
        );
    }

    #[test]
    fn no_annotation() {
        let folder = Folder::new("annotations");
        let error = read_folder(folder.path()).unwrap_err().to_string();
        assert!(
            error.ends_with("expected annotations <sequence>.txt, found none"),
            "{error}"
        );
        assert!(read_folder(&folder.path().join("none")).is_err());
    }
}
