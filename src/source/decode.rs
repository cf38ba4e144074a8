//! Picture files to pixels; the only file that decodes with the `image` crate.
//!
//! Pictures are turned as their orientation tag (EXIF) says, as viewers show them: boxes refer to
//! the turned picture. Samples of 16 bits are stretched to 8 by the rule of [`Stretch`].

use std::io::{Cursor, Error};
use std::path::{Path, PathBuf};

use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use super::header::read_pnm;
use super::{Image, MAX_FRAME_BYTES, RawFormat, SourceError, Stretch, jpeg};
use crate::frame::{ChannelOrder, Frame};
use kernels::pixels::LumaRange;

/// Decodes pictures one after the other, as one source: 16-bit pictures share one range.
#[derive(Clone, Debug, Default)]
pub struct Decoder {
    stretch: Stretch,
}

impl Decoder {
    /// Reads and decodes a picture file into `buffer`; gray pictures stay gray, others become RGB.
    ///
    /// # Errors
    /// If the file cannot be read or is not a whole still picture of bounded size.
    pub fn read(&mut self, path: PathBuf, buffer: Vec<u8>) -> Result<Image, SourceError> {
        let file = match read(&path) {
            Ok(file) => file,
            Err(error) => return Err(SourceError::Io { path, error }),
        };
        match self.decode(&file, buffer) {
            Ok(image) => Ok(Image {
                name: Some(path),
                ..image
            }),
            Err(reason) => Err(SourceError::Decode { path, reason }),
        }
    }

    /// Decodes the bytes of a picture file into `buffer`; gray pictures stay gray, others become
    /// RGB.
    ///
    /// # Errors
    /// If they are not a whole still picture of bounded size.
    pub fn decode(&mut self, file: &[u8], buffer: Vec<u8>) -> Result<Image, String> {
        let format = image::guess_format(file).ok();
        match format {
            Some(ImageFormat::Jpeg) => self.jpeg(file, buffer),
            Some(format @ (ImageFormat::Png | ImageFormat::WebP | ImageFormat::Bmp)) => {
                if is_animation(file) {
                    return Err(
                        "an animation, expected a still picture; ffmpeg makes a video \
                                of it"
                            .into(),
                    );
                }
                self.decode_whole(file, format, buffer)
            }
            _ if file.starts_with(b"P5") || file.starts_with(b"P6") => self.pnm(file, buffer),
            _ => {
                let found = if file.is_empty() {
                    "no bytes"
                } else {
                    "something else"
                };
                Err(format!(
                    "expected a jpg, png, webp or bmp picture, found {found}"
                ))
            }
        }
    }

    /// A JPEG that lacks nothing.
    fn jpeg(&mut self, file: &[u8], buffer: Vec<u8>) -> Result<Image, String> {
        let cut_short = || {
            let bytes = file.len();
            format!("the jpg lacks a part of its picture: its {bytes} bytes are cut short")
        };
        let Some(body) = jpeg::before_end(file) else {
            let [one, other] = jpeg::with_tails(file).ok_or_else(cut_short)?;
            let (image, orientation) = self.decode_stored(&one, ImageFormat::Jpeg, buffer)?;
            let (same, _) = self.decode_stored(&other, ImageFormat::Jpeg, Vec::new())?;
            return if image == same {
                Ok(turned(image, orientation))
            } else {
                Err(cut_short())
            };
        };
        jpeg::check_restarts(file)?;
        let (image, orientation) = self.decode_stored(file, ImageFormat::Jpeg, buffer)?;
        // Decoding twice is for the few pictures that may lack something. The first tail is the
        // zeros that a decoder makes up itself.
        if ends_in_a_pattern(&image)
            && let Some([_, tailed]) = jpeg::with_tails(body)
        {
            let (same, _) = self.decode_stored(&tailed, ImageFormat::Jpeg, Vec::new())?;
            if image != same {
                return Err(cut_short());
            }
        }
        Ok(turned(image, orientation))
    }

    /// The picture, turned as its orientation tag says.
    fn decode_whole(
        &mut self,
        file: &[u8],
        format: ImageFormat,
        buffer: Vec<u8>,
    ) -> Result<Image, String> {
        let (image, orientation) = self.decode_stored(file, format, buffer)?;
        Ok(turned(image, orientation))
    }

    /// The picture as it is stored, and its orientation.
    fn decode_stored(
        &mut self,
        file: &[u8],
        format: ImageFormat,
        mut buffer: Vec<u8>,
    ) -> Result<(Image, Orientation), String> {
        let max_side = Frame::MAX_SIDE as u32;
        let mut limits = Limits::default();
        limits.max_image_width = Some(max_side);
        limits.max_image_height = Some(max_side);
        limits.max_alloc = Some(MAX_FRAME_BYTES);
        let mut reader = ImageReader::with_format(Cursor::new(file), format);
        reader.limits(limits);
        let mut decoder = reader.into_decoder().map_err(|error| error.to_string())?;

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

        // A damaged tag is no reason to refuse the picture.
        let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
        let color = decoder.color_type();
        let order = if color.has_color() {
            ChannelOrder::Rgb
        } else {
            ChannelOrder::Gray
        };
        if matches!(color, ColorType::L8 | ColorType::Rgb8) {
            buffer.resize(bytes as usize, 0);
            decoder
                .read_image(&mut buffer)
                .map_err(|error| error.to_string())?;
        } else {
            let picture = DynamicImage::from_decoder(decoder).map_err(|error| error.to_string())?;
            match (color, order) {
                (ColorType::L16 | ColorType::La16, _) => {
                    self.stretch
                        .to_bytes(picture.into_luma16().as_raw(), &mut buffer);
                }
                (ColorType::Rgb16 | ColorType::Rgba16, _) => {
                    self.stretch
                        .to_bytes(picture.into_rgb16().as_raw(), &mut buffer);
                }
                (_, ChannelOrder::Gray) => buffer = picture.into_luma8().into_raw(),
                _ => buffer = picture.into_rgb8().into_raw(),
            }
        }
        let image = Image {
            data: buffer,
            width: width as usize,
            height: height as usize,
            order,
            name: None,
        };
        Ok((image, orientation))
    }

    /// A PGM (`P5`) or PPM (`P6`) picture.
    fn pnm(&mut self, file: &[u8], mut buffer: Vec<u8>) -> Result<Image, String> {
        let mut samples = &file[2..];
        let [width, height, largest] = read_pnm(&mut samples)?;
        let order = if file.starts_with(b"P5") {
            ChannelOrder::Gray
        } else {
            ChannelOrder::Rgb
        };
        let sides = 1..=Frame::MAX_SIDE;
        if !sides.contains(&width) || !sides.contains(&height) || !(1..=65535).contains(&largest) {
            return Err(format!(
                "{width}x{height} pixels up to {largest}, expected sides from 1 to {} and values \
                 up to 65535",
                Frame::MAX_SIDE
            ));
        }
        let bytes_per_sample = if largest > 255 { 2 } else { 1 };
        let expected = width * height * order.bytes_per_pixel() * bytes_per_sample;
        let samples = samples
            .get(..expected)
            .ok_or_else(|| format!("ends after {} of {expected} bytes of pixels", samples.len()))?;

        if bytes_per_sample == 2 {
            let samples: Vec<u16> = samples
                .chunks_exact(2)
                .map(|pair| u16::from_be_bytes([pair[0], pair[1]]))
                .collect();
            self.stretch.to_bytes(&samples, &mut buffer);
        } else {
            let scaled = |&sample: &u8| (usize::from(sample) * 255 / largest).min(255) as u8;
            buffer.clear();
            buffer.extend(samples.iter().map(scaled));
        }
        Ok(Image {
            data: buffer,
            width,
            height,
            order,
            name: None,
        })
    }

    /// One headerless frame, as cameras deliver them, in `buffer`. YUV, of limited range, stays
    /// YUV.
    ///
    /// # Errors
    /// If the format's sizes are out of bounds or `bytes` ends before the frame does.
    pub fn raw(
        &mut self,
        raw: RawFormat,
        bytes: &[u8],
        mut buffer: Vec<u8>,
    ) -> Result<Image, String> {
        let expected = raw.frame_bytes()?;
        let bytes = bytes
            .get(..expected)
            .ok_or_else(|| format!("a frame of {} bytes, expected {expected}", bytes.len()))?;
        let order = raw.convert(LumaRange::Limited, bytes, &mut self.stretch, &mut buffer);
        Ok(Image {
            data: buffer,
            width: raw.width,
            height: raw.height,
            order,
            name: None,
        })
    }
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

/// Whether a PNG or WebP file holds more than one picture.
fn is_animation(file: &[u8]) -> bool {
    if file.starts_with(b"RIFF") {
        const ANIMATION: u8 = 2; // a flag of the extended header
        return file.get(12..16) == Some(b"VP8X")
            && file.get(20).is_some_and(|flags| flags & ANIMATION != 0);
    }
    // An animated PNG says so in a chunk before its first data: length, name, body, checksum.
    let mut rest = file.strip_prefix(b"\x89PNG\r\n\x1a\n").unwrap_or_default();
    while let [a, b, c, d, name @ ..] = rest {
        if name.starts_with(b"acTL") {
            return true;
        }
        if name.starts_with(b"IDAT") {
            return false;
        }
        let length = u32::from_be_bytes([*a, *b, *c, *d]) as usize;
        rest = rest.get(length.saturating_add(12)..).unwrap_or_default();
    }
    false
}

/// Whether the last rows end in a pattern that repeats from block to block, or in one color.
///
/// A decoder that runs out of data reads zeros on, so all the blocks behind look alike. Blocks are
/// 8 or 16 pixels wide.
fn ends_in_a_pattern(image: &Image) -> bool {
    let pixel = image.order.bytes_per_pixel();
    let row = image.width * pixel;
    let period = 16 * pixel;
    if row < 2 * period {
        return true; // too small to tell, and quick to decode
    }
    let alike = |row: &[u8]| {
        let (before, last) = row[row.len() - 2 * period..].split_at(period);
        before == last
    };
    image.data.chunks_exact(row).rev().take(8).all(alike)
}

/// The picture as its orientation tag wants it seen.
fn turned(image: Image, orientation: Orientation) -> Image {
    // Where a pixel of the turned picture comes from: mirrored in x, in y, then with x and y
    // swapped.
    let (mirror_x, mirror_y, swap) = match orientation {
        Orientation::NoTransforms => return image,
        Orientation::FlipHorizontal => (true, false, false),
        Orientation::Rotate180 => (true, true, false),
        Orientation::FlipVertical => (false, true, false),
        Orientation::Rotate90FlipH => (false, false, true),
        Orientation::Rotate90 => (false, true, true),
        Orientation::Rotate270FlipH => (true, true, true),
        Orientation::Rotate270 => (true, false, true),
    };
    let (width, height) = if swap {
        (image.height, image.width)
    } else {
        (image.width, image.height)
    };
    let bytes = image.order.bytes_per_pixel();
    let mut data = Vec::with_capacity(image.data.len());
    for y in 0..height {
        for x in 0..width {
            let (mut from_x, mut from_y) = if swap { (y, x) } else { (x, y) };
            if mirror_x {
                from_x = image.width - 1 - from_x;
            }
            if mirror_y {
                from_y = image.height - 1 - from_y;
            }
            let from = bytes * (from_y * image.width + from_x);
            data.extend_from_slice(&image.data[from..from + bytes]);
        }
    }
    Image {
        data,
        width,
        height,
        ..image
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::jpeg::JpegEncoder;

    /// A JPEG of colored noise.
    fn noisy_jpeg() -> Vec<u8> {
        let pixels: Vec<u8> = (0u32..3 * 72 * 56)
            .map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8)
            .collect();
        let mut jpeg = Vec::new();
        JpegEncoder::new_with_quality(&mut jpeg, 80)
            .encode(&pixels, 72, 56, image::ExtendedColorType::Rgb8)
            .unwrap();
        jpeg
    }

    #[test]
    fn jpeg_without_end_marker_is_read_where_every_block_is_there() {
        let jpeg = noisy_jpeg();
        let whole = Decoder::default().decode(&jpeg, Vec::new()).unwrap();

        for missing in [1, 2] {
            let cut = &jpeg[..jpeg.len() - missing];
            assert_eq!(Decoder::default().decode(cut, vec![9]).as_ref(), Ok(&whole));
        }
        for missing in (4..jpeg.len()).step_by(29) {
            let cut = &jpeg[..jpeg.len() - missing];
            assert!(
                Decoder::default().decode(cut, Vec::new()).is_err(),
                "{missing} bytes are missing"
            );
        }
    }

    #[test]
    fn jpeg_cut_short_is_refused_with_an_end_marker_as_well() {
        let jpeg = noisy_jpeg();
        for share in [0.5, 0.7, 0.9] {
            let length = (jpeg.len() as f64 * share) as usize;
            let cut = [&jpeg[..length], &[0xff, 0xd9]].concat();

            let found = Decoder::default().decode(&cut, Vec::new());

            let message = found.map(|image| image.width).unwrap_err();
            assert!(message.contains("cut short"), "{share}: {message}");
        }
        assert!(Decoder::default().decode(&jpeg, Vec::new()).is_ok());
    }

    #[test]
    fn picture_with_orientation_is_turned_as_the_image_crate_turns_it() {
        let pixels: Vec<u8> = (0..3 * 4 * 3).collect();
        let reference = image::RgbImage::from_raw(4, 3, pixels.clone()).unwrap();
        for tag in 1..=8 {
            let orientation = Orientation::from_exif(tag).unwrap();
            let image = Image {
                data: pixels.clone(),
                width: 4,
                height: 3,
                order: ChannelOrder::Rgb,
                name: None,
            };
            let mut expected = DynamicImage::from(reference.clone());
            expected.apply_orientation(orientation);

            let found = turned(image, orientation);

            let size = (expected.width() as usize, expected.height() as usize);
            assert_eq!((found.width, found.height), size, "{tag}");
            assert_eq!(found.data, expected.into_bytes(), "{tag}");
        }
    }

    #[test]
    fn pgm_and_ppm_of_every_depth_are_read() {
        let sixteen = [b"P5 2 1 4095\n".as_slice(), &[0x0b, 0x90, 0x0b, 0xca]].concat();
        let cases: [(&[u8], &[u8], usize); 5] = [
            (b"P5 2 1 255\nab", b"ab", 1),
            (b"P5\n# words\n2 1\n255\nab and more", b"ab", 1),
            (b"P6 1 1 255\nabc", b"abc", 3),
            (b"P5 2 1 15\n\x00\x0f", &[0, 255], 1),
            (&sixteen, &[26, 229], 1),
        ];
        for (file, expected, bytes_per_pixel) in cases {
            let image = Decoder::default().decode(file, Vec::new()).unwrap();

            let label = String::from_utf8_lossy(file);
            let is_near = |(a, b): (&u8, &u8)| a.abs_diff(*b) <= 1;
            assert!(image.data.iter().zip(expected).all(is_near), "{label}");
            assert_eq!(image.data.len(), expected.len(), "{label}");
            assert_eq!(image.order.bytes_per_pixel(), bytes_per_pixel, "{label}");
        }
    }

    #[test]
    fn pgm_that_lies_about_its_size_is_refused() {
        for (file, part) in [
            (&b"P5 2 2 255\nabc"[..], "3 of 4 bytes"),
            (b"P5 0 2 255\nabc", "0x2"),
            (b"P5 99999 99999 255\nabc", "99999x99999"),
            (b"P5 2 2 0\nabcd", "up to 0"),
            (b"P5 2 2 70000\nabcd", "up to 70000"),
            (b"P5", "cut short"),
        ] {
            let message = Decoder::default().decode(file, Vec::new()).unwrap_err();
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn animations_are_told_from_pictures() {
        let chunk = |name: &[u8]| [&[0, 0, 0, 2], name, &[1, 2], &[0; 4]].concat();
        let png = |chunks: &[&[u8]]| {
            let chunks: Vec<u8> = chunks.iter().flat_map(|name| chunk(name)).collect();
            [b"\x89PNG\r\n\x1a\n".to_vec(), chunks].concat()
        };
        let webp = |flags| [b"RIFF----WEBPVP8X----".to_vec(), vec![flags]].concat();
        for (file, expected) in [
            (png(&[b"IHDR", b"IDAT"]), false),
            (png(&[b"IHDR", b"acTL", b"IDAT"]), true),
            (png(&[b"IHDR", b"IDAT", b"acTL"]), false),
            (png(&[]), false),
            (webp(0), false),
            (webp(2), true),
            (b"RIFF".to_vec(), false),
            (Vec::new(), false),
        ] {
            assert_eq!(is_animation(&file), expected, "{file:?}");
        }
    }
}
