//! Pictures of messages to frames.

use track_cpu::ChannelOrder;
use track_cpu::source::{Decoder, Image, PixelFormat, RawFormat};
use trax::{Picture, Pixels};

/// Decodes the picture that a message names, or says why it cannot be.
pub fn decode(decoder: &mut Decoder, text: &str) -> Result<Image, String> {
    match Picture::parse(text).map_err(|error| error.to_string())? {
        Picture::Path(path) => decoder
            .read(path, Vec::new())
            .map_err(|error| error.to_string()),
        Picture::Encoded(bytes) => decoder
            .decode(&bytes, Vec::new())
            .map_err(|reason| format!("image: {reason}")),
        Picture::Memory {
            width,
            height,
            pixels: Pixels::Gray16,
            data,
        } => {
            let raw = RawFormat::new(width, height, PixelFormat::Gray16Le);
            decoder.raw(raw, &data, Vec::new())
        }
        Picture::Memory {
            width,
            height,
            pixels,
            data,
        } => {
            let order = match pixels {
                Pixels::Rgb => ChannelOrder::Rgb,
                Pixels::Gray8 | Pixels::Gray16 => ChannelOrder::Gray,
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
