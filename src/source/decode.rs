//! Picture files to pixels; the only file that decodes with the `image` crate.
//!
//! Orientation tags (EXIF) are not applied: boxes refer to the pixels as they are stored.

use std::fs::File;
use std::io::{BufReader, Error};
use std::path::{Path, PathBuf};

use image::{ColorType, DynamicImage, ImageDecoder, ImageReader, Limits};

use super::{Image, MAX_FRAME_BYTES, SourceError};
use crate::frame::{ChannelOrder, Frame};

/// Decodes one file into `buffer`; gray pictures stay gray, all others become RGB.
pub(super) fn decode(path: PathBuf, mut buffer: Vec<u8>) -> Result<Image, SourceError> {
    let file = open(&path).map_err(|error| SourceError::Io { path: path.clone(), error })?;
    let (width, height, order) = match decode_file(file, &mut buffer) {
        Ok(size) => size,
        Err(reason) => return Err(SourceError::Decode { path, reason }),
    };
    Ok(Image { data: buffer, width, height, order, name: Some(path) })
}

/// A regular file of bounded size: a pipe or a device would never end.
fn open(path: &Path) -> Result<File, Error> {
    let found = std::fs::metadata(path)?;
    if !found.is_file() {
        return Err(Error::other("expected a picture file, found something else"));
    }
    if found.len() > MAX_FRAME_BYTES {
        return Err(Error::other(format!("{} bytes, expected at most {MAX_FRAME_BYTES}", found.len())));
    }
    File::open(path)
}

fn decode_file(file: File, out: &mut Vec<u8>) -> Result<(usize, usize, ChannelOrder), String> {
    let mut reader =
        ImageReader::new(BufReader::new(file)).with_guessed_format().map_err(|error| error.to_string())?;
    if reader.format().is_none() {
        return Err("expected a jpg, png, webp or bmp picture, found something else".into());
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
        return Err(format!("{width}x{height} pixels, expected sides from 1 to {max_side}"));
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
