//! Helpers of tests.

use crate::data::picture::Picture;
use std::sync::Arc;

pub use ::testing::{Folder, shared};

/// A few pictures of colored rectangles with boxes, as an annotation file.
pub fn pictures(folder: &Folder) -> String {
    let mut text = String::from("path,x,y,w,h\n");
    for i in 0..6u32 {
        let (x, y, w, h) = (40 + 7 * i, 50 + 5 * i, 30 + 3 * i, 44 - 4 * i);
        let picture = image::RgbImage::from_fn(180, 160, |px, py| {
            let inside = (x..x + w).contains(&px) && (y..y + h).contains(&py);
            let stripes = ((px + py * (i + 1)) / 6 % 2) as u8;
            if inside {
                image::Rgb([255 * stripes, 40 * i as u8, 200])
            } else {
                image::Rgb([90, 110 + 20 * stripes, 70])
            }
        });
        picture
            .save(folder.path().join(format!("{i}.png")))
            .unwrap();
        text += &format!("{i}.png,{x},{y},{w},{h}\n");
    }
    let file = folder.path().join("boxes.csv");
    std::fs::write(&file, text).unwrap();
    file.display().to_string()
}

/// A picture of one gray value.
pub fn plain(value: u8, width: usize, height: usize) -> Arc<Picture> {
    Arc::new(Picture::new(width, height, vec![value; 3 * width * height]))
}
