//! Annotated boxes: the truth that results are compared with.

use crate::error::Error;
use crate::folder::{entries, file_name};
use crate::notes::Notes;
use crate::rect::Rect;
use crate::text;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The boxes of one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Annotation {
    /// The sequence's name.
    pub name: String,
    /// One box per frame, as in the file.
    pub boxes: Vec<Rect>,
    /// Whether the target is present, per frame; `None` where no list says so.
    pub present: Option<Vec<bool>>,
    /// Picture pixels per pixel of the original video. Thresholds are in pixels of the video.
    pub scale: f64,
    /// Whether the model is trained on its video too, so that it says nothing about accuracy.
    pub in_train: bool,
}

impl Annotation {
    /// Boxes of full-size pictures, nothing else known.
    pub fn new(name: impl Into<String>, boxes: Vec<Rect>) -> Annotation {
        Annotation {
            name: name.into(),
            boxes,
            present: None,
            scale: 1.0,
            in_train: false,
        }
    }

    /// Reads a file of boxes and the `meta.json` beside it.
    ///
    /// # Errors
    /// If either file cannot be used, or the boxes are in shares of the picture.
    pub fn read(name: impl Into<String>, path: &Path) -> Result<Annotation, Error> {
        let boxes = text::read_boxes(path)?;
        if are_shares(&boxes) {
            let found = "shares of the picture: no number exceeds 1";
            return Err(Error::content(path, "boxes in pixels", found));
        }
        let meta = Meta::beside(path)?;
        Ok(Annotation {
            scale: meta.scale,
            in_train: meta.in_train,
            ..Annotation::new(name, boxes)
        })
    }

    /// Whether the target is in frame `i`; true where nothing is known.
    pub fn is_present(&self, i: usize) -> bool {
        match &self.present {
            Some(present) => present.get(i).copied().unwrap_or(true),
            None => true,
        }
    }

    /// Whether frame `i` shows the target in a box that can be tracked.
    pub fn is_visible(&self, i: usize) -> bool {
        self.is_present(i) && self.boxes.get(i).is_some_and(Rect::is_usable)
    }

    /// Keeps the first `count` frames.
    pub fn truncate(&mut self, count: usize) {
        self.boxes.truncate(count);
        if let Some(present) = &mut self.present {
            present.truncate(count);
        }
    }
}

/// Whether boxes are in shares of the picture: no number of a usable one exceeds 1.
pub fn are_shares(boxes: &[Rect]) -> bool {
    let mut usable = boxes.iter().filter(|rect| rect.is_usable()).peekable();
    let is_share = |rect: &Rect| rect.to_array().iter().all(|value| *value <= 1.0);
    usable.peek().is_some() && usable.all(is_share)
}

/// What a `meta.json` beside an annotation says.
#[derive(serde::Deserialize)]
struct Meta {
    #[serde(default = "full_size")]
    scale: f64,
    #[serde(default)]
    in_train: bool,
}

fn full_size() -> f64 {
    1.0
}

impl Meta {
    fn beside(annotation: &Path) -> Result<Meta, Error> {
        let path = annotation.with_file_name("meta.json");
        if !path.is_file() {
            return Ok(Meta {
                scale: full_size(),
                in_train: false,
            });
        }
        let failure =
            |found: String| Error::content(&path, "JSON with a scale above 0, or none", found);
        let text = text::read(&path)?;
        let meta: Meta = serde_json::from_str(&text).map_err(|error| failure(error.to_string()))?;
        if meta.scale > 0.0 && meta.scale.is_finite() {
            Ok(meta)
        } else {
            Err(failure(meta.scale.to_string()))
        }
    }
}

/// Reads a folder of annotations without pictures: `<sequence>.txt`, `<sequence>_gt.txt` (UAVDT) or
/// `<sequence>/groundtruth*.txt`.
///
/// A sequence with two annotations, or with one that cannot be used, is left out and noted.
///
/// # Errors
/// If the folder cannot be read, or no annotation in it can be used.
pub fn read_folder(folder: &Path, notes: &mut Notes) -> Result<Vec<Annotation>, Error> {
    let mut files: BTreeMap<String, Vec<PathBuf>> = BTreeMap::new();
    for path in entries(folder)? {
        if path.is_dir() {
            let inner = entries(&path)?
                .into_iter()
                .filter(|file| is_groundtruth(file));
            let inner: Vec<PathBuf> = inner.collect();
            if !inner.is_empty() {
                files.entry(file_name(&path)).or_default().extend(inner);
            }
        } else if let Some(name) = sequence_name(&path) {
            files.entry(name).or_default().push(path);
        }
    }
    let mut annotations = Vec::new();
    let mut left_out = Notes::default();
    for (name, paths) in files {
        let read = single(&paths)
            .and_then(|path| Annotation::read(&name, path).map_err(|error| error.to_string()));
        match read {
            Ok(annotation) => annotations.push(annotation),
            Err(reason) => left_out.add(&name, format!("left out: {reason}")),
        }
    }
    if annotations.is_empty() {
        let expected = "annotations <sequence>.txt or <sequence>/groundtruth*.txt";
        return Err(Error::content(folder, expected, none_because(&left_out)));
    }
    notes.extend(left_out);
    Ok(annotations)
}

/// The only file of a sequence, or the reason why there is not one.
pub(crate) fn single(paths: &[PathBuf]) -> Result<&PathBuf, String> {
    match paths {
        [path] => Ok(path),
        _ => {
            let names: Vec<String> = paths.iter().map(|path| file_name(path)).collect();
            Err(format!(
                "{} annotations: {}",
                paths.len(),
                names.join(" and ")
            ))
        }
    }
}

/// "none", with the reasons that notes give.
pub(crate) fn none_because(notes: &Notes) -> String {
    if notes.count() == 0 {
        "none".to_owned()
    } else {
        format!("none ({})", notes.summary(3))
    }
}

/// Whether a file is an annotation that lies beside its pictures: `groundtruth*.txt` in any case.
pub fn is_groundtruth(path: &Path) -> bool {
    let name = file_name(path).to_ascii_lowercase();
    name.starts_with("groundtruth") && name.ends_with(".txt")
}

/// The sequence that a file of boxes is named after; `None` if its name says that it is another
/// file.
pub fn sequence_name(path: &Path) -> Option<String> {
    const OTHERS: [&str; 4] = ["_time", "_att", "_attr", "_absent"];
    let name = file_name(path);
    let stem = name
        .strip_suffix(".txt")
        .or_else(|| name.strip_suffix(".TXT"))?;
    // GOT-10k, the VOT toolkit and `ope render` name a folder's sequences in `list.txt`.
    let is_other = stem == "list" || OTHERS.iter().any(|suffix| stem.ends_with(suffix));
    if is_other || stem.starts_with('.') || stem.is_empty() {
        return None;
    }
    Some(stem.strip_suffix("_gt").unwrap_or(stem).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Folder;

    fn read(folder: &Folder) -> Result<(Vec<Annotation>, String), String> {
        let mut notes = Notes::default();
        let annotations = read_folder(folder.path(), &mut notes).map_err(|e| e.to_string())?;
        Ok((annotations, notes.to_string()))
    }

    #[test]
    fn annotations_of_every_layout_are_found() {
        let folder = Folder::new("annotations");
        folder.write("bike1.txt", "1,2,3,4\n");
        folder.write("S0101_gt.txt", "1,2,3,4\n5,6,7,8\n");
        folder.write("Gull2/GroundTruth_rect.txt", "1\t2\t3\t4\n");
        folder.write("Gull2/meta.json", r#"{"scale": 0.75, "in_train": true}"#);
        folder.write("Gull2/._groundtruth_rect.txt", "\0\x05\x16\x07");
        folder.write("._bike1.txt", "\0\x05\x16\x07");
        folder.write("__MACOSX/groundtruth.txt", "\0\x05\x16\x07");
        folder.write("att/bike1.txt", "0,1\n");
        folder.write("S0101_att.txt", "0,1\n");
        folder.write("list.csv", "bike1\n");

        let (found, notes) = read(&folder).unwrap();

        let names: Vec<_> = found.iter().map(|a| (&a.name[..], a.boxes.len())).collect();
        assert_eq!(names, [("Gull2", 1), ("S0101", 2), ("bike1", 1)]);
        assert_eq!((found[0].scale, found[1].scale), (0.75, 1.0));
        assert_eq!((found[0].in_train, found[1].in_train), (true, false));
        assert_eq!(notes, "");
    }

    #[test]
    fn sequence_that_cannot_be_used_is_left_out_with_a_note() {
        let cases = [
            ("a_gt.txt", "1,2,3,4\n", "2 annotations: a.txt and a_gt.txt"),
            ("a/groundtruth.txt", "1,2,3,4\n", "2 annotations"),
            ("a.txt", "1,2,3,4\nend of file\n", "line 2"),
            ("a.txt", "", "an empty file"),
        ];
        for (file, text, reason) in cases {
            let folder = Folder::new("annotations");
            folder.write("a.txt", "1,2,3,4\n");
            folder.write("b.txt", "1,2,3,4\n");
            folder.write(file, text);

            let (found, notes) = read(&folder).unwrap();

            assert_eq!(found.len(), 1, "{file}");
            assert!(
                notes.contains("a: left out: ") && notes.contains(reason),
                "{notes}"
            );
        }
    }

    #[test]
    fn folder_without_a_usable_annotation_is_refused_with_the_reason() {
        let folder = Folder::new("annotations");
        let empty = read(&folder).unwrap_err();
        assert!(empty.ends_with("found none"), "{empty}");

        folder.write("a/groundtruth.txt", "1,2,3,4\n");
        folder.write("a/meta.json", r#"{"scale": 0}"#);
        let scale = read(&folder).unwrap_err();
        assert!(
            scale.contains("a: left out: ") && scale.contains("a scale above 0"),
            "{scale}"
        );

        assert!(read_folder(&folder.join("none"), &mut Notes::default()).is_err());
    }
}
