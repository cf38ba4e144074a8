//! Picture files to pixels; the only file that decodes with the `image` crate.
//!
//! Orientation tags (EXIF) are not applied: boxes refer to the pixels as they are stored.

use std::io::{Cursor, Error};
use std::path::{Path, PathBuf};

use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::{Image, MAX_FRAME_BYTES, SourceError};
use crate::frame::{ChannelOrder, Frame};

/// Decodes one file into `buffer`; gray pictures stay gray, all others become RGB.
pub(super) fn decode(path: PathBuf, mut buffer: Vec<u8>) -> Result<Image, SourceError> {
    let file = read(&path).map_err(|error| SourceError::Io {
        path: path.clone(),
        error,
    })?;
    let (width, height, order) = match decode_file(&file, &mut buffer) {
        Ok(size) => size,
        Err(reason) => return Err(SourceError::Decode { path, reason }),
    };
    Ok(Image {
        data: buffer,
        width,
        height,
        order,
        name: Some(path),
    })
}

/// A regular file of bounded size: a pipe or a device would never end.
fn read(path: &Path) -> Result<Vec<u8>, Error> {
    let found = std::fs::metadata(path)?;
    if !found.is_file() {
        return Err(Error::other(
            "expected a picture file, found something else",
        ));
    }
    if found.len() > MAX_FRAME_BYTES {
        return Err(Error::other(format!(
            "{} bytes, expected at most {MAX_FRAME_BYTES}",
            found.len()
        )));
    }
    std::fs::read(path)
}

fn decode_file(file: &[u8], out: &mut Vec<u8>) -> Result<(usize, usize, ChannelOrder), String> {
    let mut reader = ImageReader::new(Cursor::new(file))
        .with_guessed_format()
        .map_err(|error| error.to_string())?;
    match reader.format() {
        None => {
            return Err("expected a jpg, png, webp or bmp picture, found something else".into());
        }
        Some(ImageFormat::Jpeg) if is_cut_short(file) => {
            return Err(format!(
                "the jpg has no end within its {} bytes: it is cut short",
                file.len()
            ));
        }
        Some(_) => {}
    }
    let max_side = Frame::MAX_SIDE as u32;
    let mut limits = Limits::default();
    limits.max_image_width = Some(max_side);
    limits.max_image_height = Some(max_side);
    limits.max_alloc = Some(MAX_FRAME_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|error| error.to_string())?;
    let (width, height) = decoder.dimensions();
    if !(1..=max_side).contains(&width) || !(1..=max_side).contains(&height) {
        return Err(format!(
            "{width}x{height} pixels, expected sides from 1 to {max_side}"
        ));
    }
    let bytes = decoder.total_bytes();
    if bytes > MAX_FRAME_BYTES {
        return Err(format!(
            "{width}x{height} pixels take {bytes} bytes, expected at most {MAX_FRAME_BYTES}"
        ));
    }
    let order = match decoder.color_type() {
        ColorType::L8 | ColorType::La8 | ColorType::L16 | ColorType::La16 => ChannelOrder::Gray,
        _ => ChannelOrder::Rgb,
    };
    match decoder.color_type() {
        ColorType::L8 | ColorType::Rgb8 => {
            out.resize(bytes as usize, 0);
            decoder.read_image(out).map_err(|error| error.to_string())?;
        }
        _ => {
            let image = DynamicImage::from_decoder(decoder).map_err(|error| error.to_string())?;
            *out = match order {
                ChannelOrder::Gray => image.into_luma8().into_raw(),
                _ => image.into_rgb8().into_raw(),
            };
        }
    }
    Ok((width as usize, height as usize, order))
}

/// Whether a JPEG lacks its end marker: the decoder would fill the rest of the picture with gray and say nothing.
///
/// The marker is looked for behind the headers, which may contain a whole small JPEG of their own.
fn is_cut_short(jpeg: &[u8]) -> bool {
    const START_OF_SCAN: u8 = 0xda;
    let mut rest = jpeg.get(2..).unwrap_or_default(); // behind the start-of-image marker
    while let [0xff, marker, high, low, ..] = *rest {
        let skipped = match marker {
            0xff => 1, // padding before a marker
            START_OF_SCAN => break,
            _ => 2 + usize::from(u16::from_be_bytes([high, low])),
        };
        rest = rest.get(skipped..).unwrap_or_default();
    }
    !rest.windows(2).any(|pair| pair == [0xff, 0xd9])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_the_end_of_a_jpeg() {
        let start = [0xff, 0xd8];
        let thumbnail = [0xff, 0xe1, 0, 6, 0xff, 0xd8, 0xff, 0xd9];
        let scan = [0xff, 0xda, 0, 2, 1, 2, 0xff, 0, 3];
        let end = [0xff, 0xd9];
        let cases: [(&[&[u8]], bool); 7] = [
            (&[&start, &thumbnail, &scan, &end], false),
            (&[&start, &[0xff], &scan, &end, b"appended"], false),
            (&[&start, &thumbnail, &scan], true),
            (&[&start, &thumbnail], true),
            (&[&start, &thumbnail[..5]], true),
            (&[&start], true),
            (&[], true),
        ];
        for (parts, expected) in cases {
            assert_eq!(is_cut_short(&parts.concat()), expected, "{parts:x?}");
        }
    }
}
