//! Reading pictures for the tracker, and encoding those of reports.

use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageResult, RgbImage};
use std::path::Path;
use track_cpu::source::{Image, Input, Source};

/// Reads one picture, or says why it cannot.
pub fn decode(path: &Path) -> Result<Image, String> {
    let mut source = Source::open(&Input::new(path)).map_err(|error| error.to_string())?;
    let image = source.next();
    let image = image.ok_or_else(|| format!("{}: no picture", path.display()))?;
    image.map_err(|error| error.to_string())
}

/// A picture in RGB; `None` if it has no pixels.
pub fn rgb(image: &Image) -> Option<RgbImage> {
    let width = u32::try_from(image.width).ok()?;
    let height = u32::try_from(image.height).ok()?;
    RgbImage::from_raw(width, height, image.frame().to_rgb())
}

/// An RGB picture of this width and height as JPEG, with a quality from 1 to 100.
pub fn jpeg(rgb: &[u8], (width, height): (u32, u32), quality: u8) -> ImageResult<Vec<u8>> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality).encode(
        rgb,
        width,
        height,
        ExtendedColorType::Rgb8,
    )?;
    Ok(bytes)
}
