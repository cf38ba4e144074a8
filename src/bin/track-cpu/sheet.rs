//! A contact sheet: frames of a film side by side, under one title.

use std::io::Cursor;
use std::path::Path;

use image::{ImageFormat, Rgb, RgbImage, imageops};
use program::NewFile;

use crate::exit::Failure;
use crate::overlay::{Canvas, WHITE, text_width};

const COLUMNS: u32 = 4;
const MARGIN: u32 = 10;
const TITLE_HEIGHT: u32 = 44;
const PAPER: Rgb<u8> = Rgb([24, 26, 30]);
const FAINT: Rgb<u8> = Rgb([150, 155, 165]);

/// A color's meaning: the words, the color, the thickness of its line.
pub type Entry<'a> = (&'a str, Rgb<u8>, i32);

/// Writes pictures of equal size as a PNG, four in a row, with a title and the colors' meaning
/// above.
pub fn write(
    path: &Path,
    title: &str,
    subtitle: &str,
    meanings: &[Entry<'_>],
    pictures: &[RgbImage],
) -> Result<(), Failure> {
    let (w, h) = pictures.first().map_or((0, 0), RgbImage::dimensions);
    let rows = (pictures.len() as u32).div_ceil(COLUMNS);
    let (width, height) = (
        COLUMNS * (w + MARGIN) + MARGIN,
        TITLE_HEIGHT + rows * (h + MARGIN) + 2 * MARGIN,
    );
    let mut sheet = Canvas::blank(width, height, PAPER);
    let left = MARGIN as i32;
    sheet.text(left, left, title, 3, WHITE);
    sheet.text(left, left + 28, subtitle, 2, FAINT);
    legend(&mut sheet, meanings, width as i32 - left);
    for (i, picture) in pictures.iter().enumerate() {
        let (column, row) = (i as u32 % COLUMNS, i as u32 / COLUMNS);
        let (x, y) = (
            MARGIN + column * (w + MARGIN),
            TITLE_HEIGHT + 2 * MARGIN + row * (h + MARGIN),
        );
        imageops::replace(&mut sheet.picture, picture, i64::from(x), i64::from(y));
    }
    let mut png = Cursor::new(Vec::new());
    sheet
        .picture
        .write_to(&mut png, ImageFormat::Png)
        .map_err(|error| Failure::output(path, error))?;
    NewFile::write(path, png.get_ref()).map_err(|error| Failure::output(path, error))
}

/// What the colors mean, right-aligned.
fn legend(sheet: &mut Canvas, meanings: &[Entry<'_>], right: i32) {
    let mut x = right;
    for &(text, color, thickness) in meanings {
        x -= text_width(text, 2);
        sheet.text(x, 14, text, 2, color);
        x -= 36;
        sheet.fill(
            [x, 21 - thickness / 2, x + 26, 21 + thickness / 2],
            color,
            1.0,
        );
        x -= 24;
    }
}
