//! Contact sheets of sampled pairs.

use crate::data::{Dataset, Sample};
use crate::error::Error;
use image::{Rgb, RgbImage};
use std::path::{Path, PathBuf};

const COLUMNS: usize = 6;
const ROWS: usize = 4;
const TEMPLATE: u32 = 127;
const GAP: u32 = 4;

/// Writes `sheets` contact sheets of 24 pairs each into `folder`, from sample number `first` on,
/// and returns their paths.
///
/// A pair is shown as its template above the template of the search picture, and the search crop
/// with the target's box: green, or red for a negative pair. The bar beside them has a color per
/// source.
///
/// # Errors
/// If a file cannot be written.
pub fn write_sheets(
    dataset: &Dataset,
    search_size: usize,
    first: u64,
    sheets: usize,
    folder: &Path,
) -> Result<Vec<PathBuf>, Error> {
    std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
    let mut paths = Vec::new();
    for sheet in 0..sheets {
        let (cell_w, cell_h) = (
            TEMPLATE + search_size as u32 + 3 * GAP,
            search_size.max(260) as u32 + GAP,
        );
        let mut image =
            RgbImage::from_pixel(cell_w * COLUMNS as u32, cell_h * ROWS as u32, Rgb([24; 3]));
        for i in 0..COLUMNS * ROWS {
            let index = first + (sheet * COLUMNS * ROWS + i) as u64;
            let at = ((i % COLUMNS) as u32 * cell_w, (i / COLUMNS) as u32 * cell_h);
            draw(&mut image, at, &dataset.sample(index, search_size));
        }
        let path = folder.join(format!("pairs-{sheet:02}.png"));
        image
            .save(&path)
            .map_err(|error| Error::file(&path, "a file to write", error))?;
        paths.push(path);
    }
    Ok(paths)
}

fn draw(image: &mut RgbImage, (x, y): (u32, u32), sample: &Sample) {
    const SOURCES: [[u8; 3]; 6] = [
        [70, 160, 255],
        [255, 190, 60],
        [170, 110, 255],
        [90, 220, 160],
        [255, 120, 160],
        [200, 200, 200],
    ];
    let side = sample.search_size as u32;
    put(image, (x, y), &sample.template, TEMPLATE);
    put(image, (x, y + TEMPLATE + GAP), &sample.again, TEMPLATE);
    let left = x + TEMPLATE + GAP;
    put(image, (left, y), &sample.search, side);
    let color = if sample.negative {
        Rgb([255, 40, 40])
    } else {
        Rgb([40, 255, 40])
    };
    let [x0, y0, x1, y1] = sample
        .corners
        .map(|v| (v.round().max(0.0) as u32).min(side - 1));
    for i in x0..=x1 {
        image.put_pixel(left + i, y + y0, color);
        image.put_pixel(left + i, y + y1, color);
    }
    for j in y0..=y1 {
        image.put_pixel(left + x0, y + j, color);
        image.put_pixel(left + x1, y + j, color);
    }
    for j in 0..side {
        image.put_pixel(
            left + side + 1,
            y + j,
            Rgb(SOURCES[sample.source % SOURCES.len()]),
        );
    }
}

fn put(image: &mut RgbImage, (x, y): (u32, u32), crop: &[u8], side: u32) {
    for (i, bgr) in crop.chunks_exact(3).enumerate() {
        let i = i as u32;
        image.put_pixel(x + i % side, y + i / side, Rgb([bgr[2], bgr[1], bgr[0]]));
    }
}
