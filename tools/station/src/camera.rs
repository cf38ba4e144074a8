//! Cameras: how a device's buffers become pictures, and the V4L2 device itself.

use std::time::{Duration, Instant};

use crate::feed::Frames;
use crate::picture::Picture;
use crate::say::say;

/// Frames in a row that may be damaged before the camera is opened again.
const MAX_DAMAGED: u32 = 30;
/// How long one wait for a buffer of a silent device lasts.
const PATIENCE: Duration = Duration::from_millis(100);

/// How a device's buffers are laid out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// One JPEG per buffer.
    Jpeg,
    /// Luma and chroma interleaved, luma first: `YUYV`.
    Yuyv,
    /// Luma and chroma interleaved, chroma first: `UYVY`.
    Uyvy,
    /// A plane of luma, then one of interleaved chroma: `NV12`.
    Nv12,
    /// As `NV12`, with the two chroma components swapped.
    Nv21,
    /// Three bytes per pixel.
    Bgr,
    /// Three bytes per pixel.
    Rgb,
    /// One byte per pixel.
    Gray,
    /// Two bytes per pixel, the low one first, as thermal cameras deliver it.
    Gray16,
}

/// What a device delivers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    /// How its buffers are laid out.
    pub layout: Layout,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Bytes from row to row, if the device reports them.
    pub stride: Option<usize>,
}

/// A streaming camera: a real device, or one that a test simulates.
pub trait Device {
    /// What it delivers.
    fn format(&self) -> Format;

    /// Waits for a buffer for at most `patience` and calls `work` with it.
    ///
    /// Returns `false` if none came. A buffer that the driver marks as damaged is skipped.
    ///
    /// # Errors
    /// If the device fails: it was unplugged, or the driver gave up.
    fn capture(&mut self, patience: Duration, work: &mut dyn FnMut(&[u8])) -> Result<bool, String>;
}

/// Decodes a buffer into a picture, reusing the given memory. It may keep state between buffers.
pub type Decode = Box<dyn FnMut(Format, &[u8], Vec<u8>) -> Result<Picture, String> + Send>;

/// The frames of a device.
pub struct Camera<D> {
    device: D,
    decode: Decode,
    stall: Duration,
    damaged: u32,
}

impl<D: Device> Camera<D> {
    /// Frames of a device that is given up after being silent for `stall`.
    pub fn new(device: D, decode: Decode, stall: Duration) -> Camera<D> {
        Camera {
            device,
            decode,
            stall,
            damaged: 0,
        }
    }
}

impl<D: Device> Frames for Camera<D> {
    fn next(&mut self, spare: Vec<u8>) -> Result<Option<Picture>, String> {
        let format = self.device.format();
        let decode = &mut self.decode;
        let mut spare = Some(spare);
        let mut heard = Instant::now();
        loop {
            let mut decoded = None;
            let came = self.device.capture(PATIENCE, &mut |bytes| {
                let spare = spare.take().unwrap_or_default();
                decoded = Some(decode(format, bytes, spare));
            })?;
            if came {
                heard = Instant::now();
            }
            match decoded {
                Some(Ok(picture)) => {
                    self.damaged = 0;
                    return Ok(Some(picture));
                }
                Some(Err(reason)) => {
                    self.damaged += 1;
                    if self.damaged == 1 {
                        say!("source: {reason}; frame skipped");
                    }
                    if self.damaged >= MAX_DAMAGED {
                        return Err(format!("{MAX_DAMAGED} damaged frames in a row: {reason}"));
                    }
                }
                None if heard.elapsed() > self.stall => {
                    return Err(format!("no frame for {:.1} s", self.stall.as_secs_f64()));
                }
                None => {}
            }
        }
    }
}

#[cfg(target_os = "linux")]
pub use v4l2::V4l2;

#[cfg(target_os = "linux")]
mod v4l2 {
    //! A V4L2 device, through the crate `linuxvideo`.

    use std::io::Error;
    use std::path::Path;
    use std::time::{Duration, Instant};

    use linuxvideo::format::{PixFormat, PixelFormat};
    use linuxvideo::stream::ReadStream;
    use linuxvideo::{BufType, Device};

    use super::{Format, Layout};
    use crate::say::say;

    /// Formats by preference: over USB, uncompressed ones do not reach 30 frames a second at 720p.
    const FORMATS: [(PixelFormat, Layout); 13] = [
        (PixelFormat::MJPG, Layout::Jpeg),
        (PixelFormat::JPEG, Layout::Jpeg),
        (PixelFormat::YUYV, Layout::Yuyv),
        (PixelFormat::from_fourcc(*b"UYVY"), Layout::Uyvy),
        (PixelFormat::from_fourcc(*b"NV12"), Layout::Nv12),
        (PixelFormat::from_fourcc(*b"NV21"), Layout::Nv21),
        (PixelFormat::BGR3, Layout::Bgr),
        (PixelFormat::RGB3, Layout::Rgb),
        (
            PixelFormat::from_fourcc([b'G', b'R', b'E', b'Y']),
            Layout::Gray,
        ),
        (PixelFormat::from_fourcc(*b"Y16 "), Layout::Gray16),
        (PixelFormat::from_fourcc(*b"Y14 "), Layout::Gray16),
        (PixelFormat::from_fourcc(*b"Y12 "), Layout::Gray16),
        (PixelFormat::from_fourcc(*b"Y10 "), Layout::Gray16),
    ];
    /// The size asked for if the user names none.
    const SIZE: (usize, usize) = (1280, 720);
    /// How often a silent device is checked.
    const TICK: Duration = Duration::from_millis(2);

    /// A streaming V4L2 device.
    pub struct V4l2 {
        stream: ReadStream,
        format: Format,
        path: String,
    }

    impl V4l2 {
        /// Opens a device and starts it, at the size closest to the one asked for.
        ///
        /// # Errors
        /// If there is no such device, or none that delivers pictures in a known format.
        pub fn open(path: &Path, size: Option<(usize, usize)>) -> Result<V4l2, String> {
            let wrong = |error: Error| format!("{}: {error}", path.display());
            let device = Device::open(path).map_err(wrong)?;
            let mut offered = Vec::new();
            for format in device.formats(BufType::VIDEO_CAPTURE) {
                offered.push(format.map_err(wrong)?.pixel_format());
            }
            let chosen = FORMATS.iter().find(|(code, _)| offered.contains(code));
            let Some(&(code, layout)) = chosen else {
                return Err(format!(
                    "{}: offers {offered:?}, expected one of {:?}",
                    path.display(),
                    FORMATS.map(|(code, _)| code)
                ));
            };
            let (width, height) = size.unwrap_or(SIZE);
            let capture = device
                .video_capture(PixFormat::new(width as u32, height as u32, code))
                .map_err(wrong)?;
            let format = Format {
                layout,
                width: capture.format().width() as usize,
                height: capture.format().height() as usize,
                // Some drivers leave it at 0, which means unknown.
                stride: Some(capture.format().bytes_per_line() as usize)
                    .filter(|stride| *stride > 0 && layout != Layout::Jpeg),
            };
            if capture.format().pixel_format() != code {
                return Err(format!(
                    "{}: switched from {code:?} to {:?}",
                    path.display(),
                    capture.format().pixel_format()
                ));
            }
            say!(
                "source: {} delivers {}x{} {code:?}",
                path.display(),
                format.width,
                format.height
            );
            Ok(V4l2 {
                stream: capture.into_stream().map_err(wrong)?,
                format,
                path: path.display().to_string(),
            })
        }
    }

    impl super::Device for V4l2 {
        fn format(&self) -> Format {
            self.format
        }

        fn capture(
            &mut self,
            patience: Duration,
            work: &mut dyn FnMut(&[u8]),
        ) -> Result<bool, String> {
            let wrong = |error: Error| format!("{}: {error}", self.path);
            // A blocked dequeue could not be given up, so it is called when it returns at once.
            let until = Instant::now() + patience;
            while self.stream.will_block().map_err(wrong)? {
                if Instant::now() >= until {
                    return Ok(false);
                }
                std::thread::sleep(TICK);
            }
            let used = self.stream.dequeue(|view| {
                if !view.is_error() {
                    work(&view);
                }
                Ok(())
            });
            used.map(|()| true).map_err(wrong)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Order;

    /// A camera that plays a script: a buffer, silence, or a failure.
    struct Fake {
        format: Format,
        script: Vec<Option<Vec<u8>>>,
    }

    impl Device for Fake {
        fn format(&self) -> Format {
            self.format
        }

        fn capture(
            &mut self,
            patience: Duration,
            work: &mut dyn FnMut(&[u8]),
        ) -> Result<bool, String> {
            if self.script.is_empty() {
                return Err("/dev/video9: No such device (os error 19)".into());
            }
            match self.script.remove(0) {
                Some(bytes) => work(&bytes),
                None => {
                    std::thread::sleep(patience);
                    return Ok(false);
                }
            }
            Ok(true)
        }
    }

    fn decode(format: Format, bytes: &[u8], _: Vec<u8>) -> Result<Picture, String> {
        let Format { width, height, .. } = format;
        let data = bytes
            .get(..width * height)
            .ok_or("a short buffer")?
            .to_vec();
        Ok(Picture {
            data,
            width,
            height,
            order: Order::Gray,
        })
    }

    fn camera(layout: Layout, script: Vec<Option<Vec<u8>>>) -> Camera<Fake> {
        let format = Format {
            layout,
            width: 2,
            height: 1,
            stride: None,
        };
        let device = Fake { format, script };
        Camera::new(device, Box::new(decode), Duration::from_millis(250))
    }

    #[test]
    fn damaged_buffer_is_skipped() {
        let script = vec![Some(vec![1, 2]), Some(vec![3]), Some(vec![4, 5])];
        let mut camera = camera(Layout::Gray, script);

        let first = camera.next(Vec::new()).unwrap().unwrap();
        let second = camera.next(Vec::new()).unwrap().unwrap();

        assert_eq!(first.data, [1, 2]);
        assert_eq!(second.data, [4, 5]);
    }

    #[test]
    fn camera_that_only_delivers_damage_fails() {
        let mut camera = camera(Layout::Gray, vec![Some(vec![1]); 40]);

        let failed = camera.next(Vec::new()).unwrap_err();

        assert!(failed.contains("30 damaged frames"), "{failed}");
    }

    #[test]
    fn unplugged_camera_fails_with_the_drivers_words() {
        let mut camera = camera(Layout::Gray, Vec::new());

        let failed = camera.next(Vec::new()).unwrap_err();

        assert!(failed.contains("No such device"), "{failed}");
    }

    #[test]
    fn silent_camera_is_given_up_after_the_stall_time_out() {
        let mut camera = camera(Layout::Gray, vec![None; 40]);

        let failed = camera.next(Vec::new()).unwrap_err();

        assert!(failed.contains("no frame for"), "{failed}");
    }

    #[test]
    fn short_silence_is_waited_out() {
        let mut camera = camera(Layout::Gray, vec![None, Some(vec![7, 8])]);

        assert_eq!(camera.next(Vec::new()).unwrap().unwrap().data, [7, 8]);
    }
}
