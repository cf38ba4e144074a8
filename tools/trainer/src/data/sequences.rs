//! Annotated videos as training and validation use them.
//!
//! The `sequences` crate finds and reads them. Frames without a usable box become `None` here, and
//! so do frames whose box lies outside the picture.

use super::skipped::Skipped;
use crate::error::Error;
use ::sequences::{Notes, Rect};
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

/// All sequences below a folder, by name.
///
/// # Errors
/// If the folder cannot be read.
pub fn find(root: &Path, skipped: &mut Skipped) -> Result<Vec<Sequence>, Error> {
    let mut notes = Notes::default();
    let found = ::sequences::find(root, &mut notes)?;
    for note in notes.iter() {
        skipped.add(note.about.clone(), note.text.clone());
    }
    let mut sequences = Vec::with_capacity(found.len());
    for sequence in found {
        sequences.push(convert(sequence, skipped));
    }
    Ok(sequences)
}

/// All pictures below a folder.
///
/// # Errors
/// If the folder cannot be read.
pub fn pictures_below(root: &Path) -> Result<Vec<PathBuf>, Error> {
    Ok(::sequences::pictures_below(root)?)
}

fn convert(mut found: ::sequences::Sequence, skipped: &mut Skipped) -> Sequence {
    // A video whose other boxes are not public is a single frame here.
    found.frames.truncate(found.annotation.boxes.len());
    let size = image::image_dimensions(&found.frames[0]).ok();
    let mut outside = 0;
    let mut boxes = Vec::with_capacity(found.frames.len());
    for rect in found.annotation.boxes.into_iter() {
        let bbox = Some(rect).filter(Rect::is_usable).map(|rect| {
            let [x, y, w, h] = rect.to_f32();
            BBox::new(x, y, w, h)
        });
        // Pictures that cannot be read are reported where they are used.
        let is_outside = bbox.is_some()
            && size.is_some_and(|(w, h)| !rect.is_in_picture(f64::from(w), f64::from(h)));
        outside += usize::from(is_outside);
        boxes.push(bbox.filter(|_| !is_outside));
    }
    if let (Some((width, height)), true) = (size, outside > 0) {
        let of = boxes.len();
        let reason = format!("{outside} of {of} boxes lie outside the {width} x {height} picture");
        skipped.add(found.annotation.name.clone(), reason);
    }
    Sequence {
        name: found.annotation.name,
        frames: found.frames,
        boxes,
        scale: found.annotation.scale as f32,
        in_train: found.annotation.in_train,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::{Folder, MovingSquare};

    /// Eight frames of a moving square with this annotation.
    fn folder(annotation: &str) -> Folder {
        let folder = Folder::new("sequences");
        let video = MovingSquare::default();
        let at = folder.join("data/a/img");
        std::fs::create_dir_all(&at).unwrap();
        for i in 0..8 {
            let (width, height) = (video.width as u32, video.height as u32);
            let picture = image::RgbImage::from_raw(width, height, video.frame(i)).unwrap();
            picture.save(at.join(format!("{:04}.png", i + 1))).unwrap();
        }
        folder.write("data/a/groundtruth.txt", annotation);
        folder
    }

    #[test]
    fn annotations_in_every_spelling_are_read_or_skipped_by_name() {
        let good = MovingSquare::default().annotation(8);
        let cases = [
            ("as written", good.clone(), 8, ""),
            ("byte order mark", format!("\u{feff}{good}"), 8, ""),
            ("CR line ends", good.replace('\n', "\r"), 8, ""),
            ("semicolons", good.replace(',', ";"), 8, ""),
            ("decimal commas", "20,5;40,5;24,5;18,5\n".repeat(8), 8, ""),
            ("polygons", "20,40,44,40,44,58,20,58\n".repeat(8), 8, ""),
            (
                "absent in half",
                "20,40,24,18\nNaN,NaN,NaN,NaN\n".repeat(4),
                4,
                "",
            ),
            ("no area", "20,40,0,18\n".repeat(8), 0, ""),
            (
                "outside the picture",
                "900,900,24,18\n".repeat(8),
                0,
                "8 of 8 boxes lie outside the 160 x 120 picture",
            ),
            (
                "partly outside",
                "150,110,24,18\n-24,40,24,18\n".repeat(4),
                4,
                "4 of 8 boxes lie outside",
            ),
        ];
        for (what, annotation, usable, words) in cases {
            let folder = folder(&annotation);
            let mut skipped = Skipped::default();

            let found = find(folder.path(), &mut skipped).unwrap();

            let said = skipped.to_string();
            assert_eq!(found.len(), 1, "{what}: {said}");
            assert_eq!(found[0].name, "data/a");
            assert_eq!(found[0].boxes.iter().flatten().count(), usable, "{what}");
            assert!(said.contains(words), "{what}: {said}");
            assert_eq!(said.is_empty(), words.is_empty(), "{what}: {said}");
        }
    }

    #[test]
    fn sequence_with_a_stray_line_is_skipped_by_name() {
        let folder = folder("20,40,24,18\nend\n");
        let mut skipped = Skipped::default();

        let found = find(folder.path(), &mut skipped).unwrap();

        assert_eq!(found, []);
        let said = skipped.to_string();
        assert!(said.contains("data/a") && said.contains("line 2"), "{said}");
    }
}
