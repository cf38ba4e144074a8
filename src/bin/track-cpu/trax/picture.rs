//! Pictures of messages to frames.

use std::fs::File;
use std::io::{Cursor, Read};
use std::path::Path;

use image::{DynamicImage, ImageReader, Limits};
use track_cpu::source::{Image, MAX_FRAME_BYTES};
use track_cpu::{ChannelOrder, Frame};
use trax::{Picture, Pixels};

/// Decodes the picture that a message names, or says why it cannot be.
pub fn decode(text: &str) -> Result<Image, String> {
    match Picture::parse(text).map_err(|error| error.to_string())? {
        Picture::Path(path) => {
            let failure = |reason: String| format!("{}: {reason}", path.display());
            read(&path)
                .and_then(|bytes| decode_file(&bytes))
                .map_err(failure)
        }
        Picture::Encoded(bytes) => decode_file(&bytes).map_err(|reason| format!("image: {reason}")),
        Picture::Memory {
            width,
            height,
            pixels,
            mut data,
        } => {
            let order = match pixels {
                Pixels::Rgb => ChannelOrder::Rgb,
                Pixels::Gray8 => ChannelOrder::Gray,
                Pixels::Gray16 => {
                    data = data.chunks_exact(2).map(|pixel| pixel[1]).collect();
                    ChannelOrder::Gray
                }
            };
            Ok(Image {
                data,
                width,
                height,
                order,
                name: None,
            })
        }
    }
}

/// A regular file of bounded size: a pipe or a device would never end.
fn read(path: &Path) -> Result<Vec<u8>, String> {
    let found = std::fs::metadata(path).map_err(|error| error.to_string())?;
    if !found.is_file() {
        return Err("expected a picture file, found something else".into());
    }
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|error| error.to_string())?;
    file.take(MAX_FRAME_BYTES + 1)
        .read_to_end(&mut bytes)
        .map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_FRAME_BYTES {
        return Err(format!(
            "expected at most {MAX_FRAME_BYTES} bytes, found more"
        ));
    }
    Ok(bytes)
}

fn decode_file(bytes: &[u8]) -> Result<Image, String> {
    let mut reader = ImageReader::new(Cursor::new(bytes))
        .with_guessed_format()
        .map_err(|error| error.to_string())?;
    if reader.format().is_none() {
        return Err("expected a jpg, png, webp or bmp picture, found something else".into());
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(Frame::MAX_SIDE as u32);
    limits.max_image_height = Some(Frame::MAX_SIDE as u32);
    limits.max_alloc = Some(MAX_FRAME_BYTES);
    reader.limits(limits);
    let picture = reader.decode().map_err(|error| error.to_string())?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let (data, order) = match picture {
        DynamicImage::ImageLuma8(_)
        | DynamicImage::ImageLumaA8(_)
        | DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_) => (picture.into_luma8().into_raw(), ChannelOrder::Gray),
        _ => (picture.into_rgb8().into_raw(), ChannelOrder::Rgb),
    };
    Ok(Image {
        data,
        width,
        height,
        order,
        name: None,
    })
}
