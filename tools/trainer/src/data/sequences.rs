//! Folders of annotated sequences, however their data set lays them out.
//!
//! Understood are an annotation file beside its pictures (OTB, DTB70, GOT-10k, LaSOT: `groundtruth*.txt` with the pictures
//! in the same folder or in `img`), and annotations in a folder of their own that bear the names of the picture folders
//! (UAV123, UAV123@10fps, UAVDT, VisDrone: `anno/.../<name>.txt` or `<name>_gt.txt`). A `meta.json` beside an annotation
//! may say at what `scale` the pictures are, and whether the sequence is `in_train`.

use super::skipped::Skipped;
use crate::error::Error;
use serde::Deserialize;
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};
use track_cpu::BBox;

/// One video with its annotations.
#[derive(Clone, Debug, PartialEq)]
pub struct Sequence {
    /// The data set's and its own name: `DTB70/Gull2`.
    pub name: String,
    /// The pictures in order.
    pub frames: Vec<PathBuf>,
    /// The target's box in each of them, in pixels of the picture; `None` where it is absent.
    pub boxes: Vec<Option<BBox>>,
    /// Picture pixels per pixel of the original video.
    pub scale: f32,
    /// Whether its video is also trained on: it then says nothing about accuracy.
    pub in_train: bool,
}

/// What `meta.json` says.
#[derive(Deserialize)]
struct Meta {
    #[serde(default = "one")]
    scale: f32,
    #[serde(default)]
    in_train: bool,
}

fn one() -> f32 {
    1.0
}

/// Folders below the root that are looked into.
const MAX_DEPTH: usize = 5;

/// Largest annotation file, in bytes.
const MAX_BYTES: u64 = 64 << 20;

/// Which frames of UAV123's long videos its sequences are, at 30 and 10 frames per second; 1-based, inclusive.
const UAV123: &str = include_str!("uav123_frames.csv");

/// All sequences below a folder, by name.
///
/// # Errors
/// If the folder cannot be read.
pub fn find(root: &Path, skipped: &mut Skipped) -> Result<Vec<Sequence>, Error> {
    let mut found = Found::default();
    walk(root, 0, &mut found)?;
    let mut sequences = Vec::new();
    for annotation in &found.annotations {
        match sequence(annotation, &found, skipped) {
            Ok(sequence) => sequences.push(sequence),
            Err(reason) => skipped.add(annotation.display().to_string(), reason),
        }
    }
    sequences.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(sequences)
}

/// All pictures below a folder.
///
/// # Errors
/// If the folder cannot be read.
pub fn pictures_below(root: &Path) -> Result<Vec<PathBuf>, Error> {
    let mut found = Found::default();
    walk(root, 0, &mut found)?;
    let mut pictures: Vec<_> = found.pictures.into_values().flatten().collect();
    pictures.sort();
    Ok(pictures)
}

#[derive(Default)]
struct Found {
    annotations: Vec<PathBuf>,
    pictures: HashMap<PathBuf, Vec<PathBuf>>, // by folder
}

fn walk(folder: &Path, depth: usize, found: &mut Found) -> Result<(), Error> {
    let mut entries = Vec::new();
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        entries.push(entry.map_err(Error::io(folder))?.path());
    }
    entries.sort();
    for path in entries {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if path.is_dir() {
            let other = ["att", "attributes", "initialization"].contains(&&*name);
            if depth < MAX_DEPTH && !other {
                walk(&path, depth + 1, found)?;
            }
        } else if ["jpg", "jpeg", "png", "webp", "bmp"]
            .iter()
            .any(|e| extension == *e)
        {
            found
                .pictures
                .entry(folder.to_path_buf())
                .or_default()
                .push(path);
        } else if extension == "txt"
            && (name.starts_with("groundtruth") || !is_beside_pictures(folder))
        {
            found.annotations.push(path);
        }
    }
    Ok(())
}

/// Whether a folder holds one sequence, whose texts but for `groundtruth*` are about other things.
fn is_beside_pictures(folder: &Path) -> bool {
    folder.join("img").is_dir() || folder.join("groundtruth.txt").is_file()
}

fn sequence(annotation: &Path, found: &Found, skipped: &mut Skipped) -> Result<Sequence, String> {
    let folder = annotation.parent().unwrap_or(Path::new(""));
    let stem = annotation
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let beside = stem.starts_with("groundtruth");
    let mut boxes = read_boxes(annotation)?;
    let (name, frames) = if beside {
        let at = [
            folder.to_path_buf(),
            folder.join("img"),
            folder.join("imgs"),
            folder.join("color"),
        ];
        let frames = at
            .iter()
            .find_map(|at| found.pictures.get(at))
            .ok_or("no pictures beside it")?;
        (last_names(folder, 2), frames.clone())
    } else {
        let ten = annotation.to_string_lossy().contains("10fps");
        let name = stem.strip_suffix("_gt").unwrap_or(&stem);
        let (video, range) = part_of_video(name, ten).unwrap_or((name.to_owned(), None));
        let matches = |at: &&PathBuf| {
            last_names(at, 1) == video || last_names(at, 2) == format!("{video}/img")
        };
        let at = found
            .pictures
            .keys()
            .filter(matches)
            .min()
            .ok_or(format!("no pictures in a folder {video:?}"))?;
        let mut frames = found.pictures[at].clone();
        if let Some((first, last)) = range {
            let last = last.min(frames.len());
            frames = frames
                .get(first - 1..last)
                .ok_or("fewer frames than the sequence has")?
                .to_vec();
        }
        (format!("{}/{name}", last_names(folder, 1)), frames)
    };
    if frames.len() != boxes.len() {
        let reason = format!(
            "{} frames and {} boxes: only as many as both have are used",
            frames.len(),
            boxes.len()
        );
        skipped.add(annotation.display().to_string(), reason);
    }
    let count = frames.len().min(boxes.len());
    boxes.truncate(count);
    let frames: Vec<_> = frames.into_iter().take(count).collect();
    if count == 0 {
        return Err("no frame with a box".into());
    }
    let meta = match fs::read(folder.join("meta.json")) {
        Ok(bytes) if beside => {
            serde_json::from_slice(&bytes).map_err(|error| format!("meta.json: {error}"))?
        }
        _ => Meta {
            scale: 1.0,
            in_train: false,
        },
    };
    if !(meta.scale > 0.0 && meta.scale.is_finite()) {
        return Err(format!(
            "meta.json: scale is {}, expected a number above 0",
            meta.scale
        ));
    }
    Ok(Sequence {
        name,
        frames,
        boxes,
        scale: meta.scale,
        in_train: meta.in_train,
    })
}

/// The last `count` parts of a path.
fn last_names(path: &Path, count: usize) -> String {
    let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
    parts[parts.len().saturating_sub(count)..].join("/")
}

/// The video that a UAV123 sequence is cut from, with its first and last frame (1-based).
fn part_of_video(name: &str, ten: bool) -> Option<(String, Option<(usize, usize)>)> {
    let line = UAV123
        .lines()
        .skip(1)
        .find(|line| line.split(',').next() == Some(name))?;
    let fields: Vec<_> = line.split(',').collect();
    let number = |i: usize| fields.get(i)?.parse::<usize>().ok().filter(|n| *n > 0);
    let at = if ten { 4 } else { 2 };
    Some((
        (*fields.get(1)?).to_owned(),
        Some((number(at)?, number(at + 1)?)),
    ))
}

/// Lines of four numbers, separated by commas, tabs or spaces; not a number, or an empty box, says "absent".
fn read_boxes(path: &Path) -> Result<Vec<Option<BBox>>, String> {
    let size = fs::metadata(path).map_err(|error| error.to_string())?.len();
    if size > MAX_BYTES {
        return Err(format!("{size} bytes, expected at most {MAX_BYTES}"));
    }
    let text = fs::read_to_string(path).map_err(|error| error.to_string())?;
    let mut boxes = Vec::new();
    for (i, line) in text.lines().map(str::trim).enumerate() {
        if line.is_empty() {
            continue;
        }
        let fields: Vec<_> = line
            .split(|c: char| c == ',' || c.is_whitespace())
            .filter(|f| !f.is_empty())
            .collect();
        let numbers: Result<Vec<f32>, _> = fields.iter().map(|field| field.parse()).collect();
        match numbers.as_deref() {
            Ok([x, y, w, h, ..]) => {
                let bbox = BBox::new(*x, *y, *w, *h);
                boxes.push(Some(bbox).filter(|bbox| bbox.is_finite() && bbox.area() > 0.0));
            }
            _ => {
                return Err(format!(
                    "line {}: expected x,y,w,h, found {:?}",
                    i + 1,
                    crate::error::brief(line)
                ));
            }
        }
    }
    Ok(boxes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Folder;

    fn pictures(folder: &Path, count: usize) {
        fs::create_dir_all(folder).unwrap();
        (1..=count).for_each(|i| fs::write(folder.join(format!("{i:06}.jpg")), "").unwrap());
    }

    fn annotate(file: &Path, count: usize) {
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        let line = |i: usize| {
            if i == 1 {
                "NaN,NaN,NaN,NaN\n".into()
            } else {
                format!("{i},2\t30 4.5\n")
            }
        };
        fs::write(file, (0..count).map(line).collect::<String>()).unwrap();
    }

    #[test]
    fn finds_every_layout() {
        let folder = Folder::new("sequences");
        let at = |path: &str| folder.path().join(path);
        pictures(&at("DTB70/Gull2/img"), 5);
        annotate(&at("DTB70/Gull2/groundtruth_rect.txt"), 5);
        fs::write(
            at("DTB70/Gull2/meta.json"),
            r#"{"scale": 0.5, "in_train": true, "other": 1}"#,
        )
        .unwrap();
        fs::write(at("DTB70/Gull2/result.txt"), "1,2,3,4\n").unwrap();
        pictures(&at("got/GOT-10k_Train_000001"), 3);
        annotate(&at("got/GOT-10k_Train_000001/groundtruth.txt"), 3);
        fs::write(at("got/GOT-10k_Train_000001/absence.label"), "0\n0\n0\n").unwrap();
        pictures(&at("UAV123_10fps/data_seq/UAV123_10fps/bird1"), 820);
        annotate(&at("UAV123_10fps/anno/UAV123_10fps/bird1_2.txt"), 235);
        annotate(&at("UAV123_10fps/anno/UAV123_10fps/att/bird1_2.txt"), 1);
        pictures(&at("UAVDT/sequences/S0101"), 4);
        annotate(&at("UAVDT/anno/S0101_gt.txt"), 6);
        pictures(&at("VisDrone/sequences/uav0_s"), 2);
        annotate(&at("VisDrone/annotations/uav0_s.txt"), 2);
        annotate(&at("VisDrone/annotations/uav1_s.txt"), 2);
        let mut skipped = Skipped::default();
        let found = find(folder.path(), &mut skipped).unwrap();
        let summary: Vec<_> = found
            .iter()
            .map(|s| (&s.name[..], s.frames.len()))
            .collect();
        let expected = [
            ("DTB70/Gull2", 5),
            ("UAV123_10fps/bird1_2", 235),
            ("anno/S0101", 4),
            ("annotations/uav0_s", 2),
            ("got/GOT-10k_Train_000001", 3),
        ];
        assert_eq!(summary, expected);
        assert!(found[1].frames[0].ends_with("bird1/000259.jpg"));
        assert_eq!((found[0].scale, found[0].in_train), (0.5, true));
        assert_eq!(
            found[0].boxes[..2],
            [Some(BBox::new(0.0, 2.0, 30.0, 4.5)), None]
        );
        let text = skipped.to_string();
        assert!(
            text.contains("4 frames and 6 boxes")
                && text.contains("no pictures in a folder \"uav1_s\""),
            "{text}"
        );
        assert_eq!(skipped.count(), 2);
        assert_eq!(
            pictures_below(folder.path()).unwrap().len(),
            5 + 3 + 820 + 4 + 2
        );
    }

    #[test]
    fn the_development_sequences() {
        let Some(root) = crate::testing::shared("data/dev_seqs") else {
            return;
        };
        let mut skipped = Skipped::default();
        let found = find(&root, &mut skipped).unwrap();
        assert_eq!(
            (found.len(), found.iter().filter(|s| s.in_train).count()),
            (20, 5)
        );
        assert_eq!(skipped.count(), 0, "{skipped}");
    }
}
