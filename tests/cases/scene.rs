//! The scene of every case: a red pattern of 24x18 pixels that moves over gray tiles, 4 pixels
//! right and 1 down in each frame.

use std::path::Path;
use std::process::{Command, Stdio};

use image::codecs::jpeg::JpegEncoder;
use image::{Luma, RgbImage, imageops};

pub const SIZE: (u32, u32) = (160, 120);
/// Frames of a case's sequence.
pub const FRAMES: usize = 8;
/// The target's box in the first frame, as `--init` takes it.
pub const INIT: &str = "20,40,24,18";
/// The target's box in the last frame.
pub const LAST: [f64; 4] = [48.0, 47.0, 24.0, 18.0];

/// One frame.
pub fn frame(index: usize) -> RgbImage {
    let (left, top) = (20 + 4 * index as u32, 40 + index as u32);
    RgbImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let is_inside = (left..left + 24).contains(&x) && (top..top + 18).contains(&y);
        if is_inside && (x - left + y - top) % 9 < 6 {
            return image::Rgb([240, 30, 30]);
        }
        let tile = (x / 10).wrapping_mul(2_654_435_761) ^ (y / 10).wrapping_mul(2_246_822_519);
        image::Rgb([90 + (tile.wrapping_mul(3_266_489_917) >> 26) as u8; 3])
    })
}

/// A frame as JPEG.
pub fn jpeg(index: usize) -> Vec<u8> {
    jpeg_of(&frame(index))
}

/// A picture as JPEG.
pub fn jpeg_of(picture: &RgbImage) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, 92)
        .encode_image(picture)
        .unwrap();
    bytes
}

/// Frames in 16 bits as a thermal camera gives them: 58 levels above 2960, the target the warmest.
pub fn thermal(index: usize) -> Vec<u16> {
    frame(index)
        .pixels()
        .map(|pixel| 2960 + u16::from(pixel.0[0]) * 58 / 255)
        .collect()
}

/// Writes the frames as `seq/1.jpg` to `seq/8.jpg`.
pub fn sequence(folder: &Path) {
    std::fs::create_dir_all(folder.join("seq")).unwrap();
    for i in 0..FRAMES {
        std::fs::write(folder.join(format!("seq/{}.jpg", i + 1)), jpeg(i)).unwrap();
    }
}

/// Writes the frames as 16-bit PNGs.
pub fn thermal_pngs(folder: &Path) {
    std::fs::create_dir_all(folder.join("seq")).unwrap();
    for i in 0..FRAMES {
        let path = folder.join(format!("seq/{}.png", i + 1));
        let picture = image::ImageBuffer::<Luma<u16>, _>::from_raw(SIZE.0, SIZE.1, thermal(i));
        picture.unwrap().save(path).unwrap();
    }
}

/// Writes a mask of each frame as PNG, white on black.
pub fn masks(folder: &Path) {
    for i in 0..FRAMES {
        let mask = image::GrayImage::from_pixel(SIZE.0, SIZE.1, Luma([0]));
        mask.save(folder.join(format!("{}.png", i + 1))).unwrap();
    }
}

/// The frames as a stream of PPMs.
pub fn ppms() -> Vec<u8> {
    let mut bytes = Vec::new();
    for i in 0..FRAMES {
        bytes.extend(format!("P6 {} {} 255\n", SIZE.0, SIZE.1).into_bytes());
        bytes.extend(frame(i).into_raw());
    }
    bytes
}

/// A JPEG with an orientation tag, whose turned picture is the frame.
pub fn tagged_jpeg(index: usize, orientation: u8) -> Vec<u8> {
    let upright = frame(index);
    let stored = match orientation {
        3 => imageops::rotate180(&upright),
        6 => imageops::rotate270(&upright),
        8 => imageops::rotate90(&upright),
        _ => upright,
    };
    let mut exif = vec![0xff, 0xe1, 0, 34];
    exif.extend(b"Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0");
    exif.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    let jpeg = jpeg_of(&stored);
    [&jpeg[..2], &exif, &jpeg[2..]].concat()
}

/// The numbers of a line of boxes.
pub fn numbers(line: &str) -> Vec<f64> {
    line.split(',').filter_map(|n| n.parse().ok()).collect()
}

/// Whether ffmpeg is installed.
pub fn has_ffmpeg() -> bool {
    let mut command = Command::new("ffmpeg");
    command
        .arg("-version")
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command.status().is_ok_and(|status| status.success())
}

/// Has ffmpeg encode the frames, 32 of them, into a file of the folder.
pub fn video(folder: &Path, name: &str, options: &[&str]) {
    let frames = folder.join("video-frames");
    std::fs::create_dir_all(&frames).unwrap();
    for i in 0..32 {
        // There and back, so that the target stays in the picture.
        let index = if i < 16 { i } else { 31 - i };
        std::fs::write(frames.join(format!("{i:02}.jpg")), jpeg(index)).unwrap();
    }
    let status = Command::new("ffmpeg")
        .args(["-y", "-v", "error", "-nostdin", "-i"])
        .arg(frames.join("%02d.jpg"))
        .args(options)
        .arg(folder.join(name))
        .status()
        .unwrap();
    assert!(status.success(), "ffmpeg makes {name}");
    std::fs::remove_dir_all(frames).unwrap();
}

/// Cuts a file to a share of its length.
pub fn cut(path: &Path, share: f64) {
    let bytes = std::fs::read(path).unwrap();
    let length = (bytes.len() as f64 * share) as usize;
    std::fs::write(path, &bytes[..length]).unwrap();
}
