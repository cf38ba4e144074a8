//! A V4L2 camera, through the crate `linuxvideo`.

use std::path::Path;

use linuxvideo::format::{PixFormat, PixelFormat as FourCc};
use linuxvideo::{BufType, Device};
use track_cpu::source::{Image, PixelFormat, RawFormat};
use track_cpu::{ChannelOrder, Frame};

use super::sources::Filler;

/// Uncompressed formats by preference, with what they are called elsewhere.
const PLAIN: [(FourCc, PixelFormat); 5] = [
    (FourCc::YUYV, PixelFormat::Yuyv422),
    (FourCc::from_fourcc(*b"NV12"), PixelFormat::Nv12),
    (FourCc::BGR3, PixelFormat::Bgr24),
    (FourCc::RGB3, PixelFormat::Rgb24),
    (FourCc::from_fourcc(*b"GRAY"), PixelFormat::Gray),
];

/// Delivers frames until the camera fails (an error) or nobody wants them.
pub fn run(
    path: &Path,
    size: Option<(usize, usize)>,
    filler: &mut Filler<'_>,
) -> Result<(), String> {
    let wrong = |error: std::io::Error| format!("{}: {error}", path.display());
    let device = Device::open(path).map_err(wrong)?;
    let mut offered = Vec::new();
    for format in device.formats(BufType::VIDEO_CAPTURE) {
        offered.push(format.map_err(wrong)?.pixel_format());
    }
    // JPEG first: over USB the plain formats do not reach 30 frames a second at 720p.
    let plain = PLAIN
        .iter()
        .find(|(code, _)| offered.contains(code))
        .copied();
    let jpeg = [FourCc::MJPG, FourCc::JPEG]
        .into_iter()
        .find(|code| offered.contains(code));
    let code = jpeg.or(plain.map(|(code, _)| code));
    let code = code.ok_or_else(|| {
        format!(
            "{}: offers {offered:?}, expected JPEG or YUYV",
            path.display()
        )
    })?;
    let (width, height) = size.unwrap_or((1280, 720));
    let capture = device
        .video_capture(PixFormat::new(width as u32, height as u32, code))
        .map_err(wrong)?;
    let format = PixFormat::new(
        capture.format().width(),
        capture.format().height(),
        capture.format().pixel_format(),
    );
    let mut stream = capture.into_stream().map_err(wrong)?;
    eprintln!(
        "source: {} delivers {}x{} {code:?}",
        path.display(),
        format.width(),
        format.height()
    );
    loop {
        let spare = filler.spare();
        let image = stream.dequeue(|view| {
            Ok(if view.is_error() {
                None
            } else {
                Some(decode(&view, &format, spare))
            })
        });
        let image = match image.map_err(wrong)? {
            Some(Ok(image)) => image,
            Some(Err(reason)) => {
                eprintln!("source: {}: {reason}; frame passed over", path.display());
                continue;
            }
            None => continue,
        };
        if !filler.put(image) {
            return Ok(());
        }
    }
}

fn decode(bytes: &[u8], format: &PixFormat, buffer: Vec<u8>) -> Result<Image, String> {
    let (width, height) = (format.width() as usize, format.height() as usize);
    if let Some((_, pixels)) = PLAIN
        .iter()
        .find(|(code, _)| *code == format.pixel_format())
    {
        return Image::from_raw(
            RawFormat {
                width,
                height,
                pixels: *pixels,
            },
            bytes,
            buffer,
        );
    }
    let mut reader =
        image::ImageReader::with_format(std::io::Cursor::new(bytes), image::ImageFormat::Jpeg);
    let mut limits = image::Limits::default();
    limits.max_image_width = Some(Frame::MAX_SIDE as u32);
    limits.max_image_height = Some(Frame::MAX_SIDE as u32);
    reader.limits(limits);
    let picture = reader
        .decode()
        .map_err(|error| error.to_string())?
        .into_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Ok(Image {
        data: picture.into_raw(),
        width,
        height,
        order: ChannelOrder::Rgb,
        name: None,
    })
}
