//! Which input is read how: cameras, streams, files, pipes, rendered flights.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer};
use station::camera::{Camera, Format, Layout};
use station::{Feed, Frames, Order, Picture, Stopper};
use track_cpu::source::{Decoder, Image, Input, LIVE_SCHEMES, PixelFormat, RawFormat, Source};

use super::args::ServeArgs;

/// Frames of a rendered flight without a length of its own: ten minutes.
const FRAMES: usize = 18_000;

/// What an input is, by the look of it.
#[derive(Debug)]
enum Kind {
    /// A V4L2 device.
    Camera(PathBuf),
    /// A stream at its own pace, opened again when it ends.
    Stream(Input),
    /// A file or folder, at a pace that is given.
    File(Input),
    /// A pipe at its own pace, which cannot be opened again.
    Pipe(Input),
    /// A rendered flight.
    Rendered(FlightConfig),
}

/// How the input is read, and whether it can be read again from its beginning.
///
/// # Errors
/// If it is a rendered flight that is described wrongly.
pub fn open(args: &ServeArgs) -> Result<(Feed, bool), String> {
    let read = Input {
        raw: args.raw_format(),
        ffmpeg_args: args.read.ffmpeg(),
        ..Input::new(&args.input)
    };
    let kind = kind(read)?;
    let repeats = matches!(kind, Kind::Rendered(_) | Kind::File(_));
    let period = Duration::from_secs_f64(1.0 / args.fps);
    let size = args.raw;
    let stall = args.stall_ms;
    let feed = match kind {
        Kind::Camera(path) => Feed {
            open: Box::new(move || open_camera(&path, size, stall)),
            reopens: true,
            period: None,
        },
        Kind::Stream(input) => Feed {
            open: Box::new(move || open_source(&input)),
            reopens: true,
            period: None,
        },
        Kind::File(input) => Feed {
            open: Box::new(move || open_source(&input)),
            reopens: false,
            period: Some(period),
        },
        Kind::Pipe(input) => Feed {
            open: Box::new(move || open_source(&input)),
            reopens: false,
            period: None,
        },
        Kind::Rendered(config) => Feed {
            open: Box::new(move || Ok(Box::new(Rendered::new(config.clone())))),
            reopens: false,
            period: Some(period),
        },
    };
    Ok((feed, repeats))
}

fn kind(input: Input) -> Result<Kind, String> {
    let location = input.location.clone();
    let text = location.to_string_lossy();
    if let Some(flight) = text.strip_prefix("flight:") {
        return Ok(Kind::Rendered(parse_flight(flight)?));
    }
    if text.starts_with("/dev/video") {
        return Ok(Kind::Camera(input.location));
    }
    let is_stream = LIVE_SCHEMES
        .iter()
        .chain(&["http://", "https://", "rtp:", "gst:"])
        .any(|start| text.starts_with(start));
    if is_stream || text.ends_with(".sdp") {
        return Ok(Kind::Stream(Input {
            is_live: true,
            ..input
        }));
    }
    let is_special =
        std::fs::metadata(&location).is_ok_and(|found| !found.is_file() && !found.is_dir());
    if text == "-" || is_special {
        Ok(Kind::Pipe(input))
    } else {
        Ok(Kind::File(input))
    }
}

fn open_source(input: &Input) -> Result<Box<dyn Frames>, String> {
    let source = Source::open(input).map_err(|error| error.to_string())?;
    if let Some(note) = source.note() {
        let _ = writeln!(std::io::stderr(), "note: {note}");
    }
    Ok(Box::new(SourceFrames { source }))
}

/// The frames of a file, folder, pipe or stream.
struct SourceFrames {
    source: Source,
}

impl Frames for SourceFrames {
    fn next(&mut self, spare: Vec<u8>) -> Result<Option<Picture>, String> {
        self.source.recycle(Image {
            data: spare,
            width: 0,
            height: 0,
            order: Order::Gray,
            name: None,
        });
        // After a bad file of a folder the next one follows; after a bad frame of a stream none.
        let is_folder = self.source.frames_left().is_some();
        loop {
            match self.source.next() {
                None => return Ok(None),
                Some(Ok(image)) => return Ok(Some(picture(image))),
                Some(Err(error)) if is_folder => {
                    let _ = writeln!(std::io::stderr(), "source: {error}; frame skipped");
                }
                Some(Err(error)) => return Err(error.to_string()),
            }
        }
    }

    fn stopper(&self) -> Option<Stopper> {
        let stopper = self.source.stopper()?;
        Some(Box::new(move || stopper.stop()))
    }
}

/// The picture of an image.
pub fn picture(image: Image) -> Picture {
    Picture {
        data: image.data,
        width: image.width,
        height: image.height,
        order: image.order,
    }
}

#[cfg(target_os = "linux")]
fn open_camera(
    path: &Path,
    size: Option<(usize, usize)>,
    stall: Duration,
) -> Result<Box<dyn Frames>, String> {
    let device = station::camera::V4l2::open(path, size)?;
    let mut decoder = Decoder::default();
    let decode =
        move |format: Format, bytes: &[u8], buffer| decode(&mut decoder, format, bytes, buffer);
    Ok(Box::new(Camera::new(device, Box::new(decode), stall)))
}

#[cfg(not(target_os = "linux"))]
fn open_camera(
    path: &Path,
    _: Option<(usize, usize)>,
    _: Duration,
) -> Result<Box<dyn Frames>, String> {
    Err(format!(
        "{}: cameras are read on Linux only; pipe the frames in (--input -)",
        path.display()
    ))
}

/// Turns a camera's buffer into a picture; the range of 16-bit frames is the decoder's.
#[cfg_attr(not(target_os = "linux"), expect(dead_code))]
fn decode(
    decoder: &mut Decoder,
    format: Format,
    bytes: &[u8],
    buffer: Vec<u8>,
) -> Result<Picture, String> {
    let pixels = match format.layout {
        Layout::Jpeg => return decoder.decode(bytes, buffer).map(picture),
        Layout::Yuyv => PixelFormat::Yuyv422,
        Layout::Uyvy => PixelFormat::Uyvy422,
        Layout::Nv12 => PixelFormat::Nv12,
        Layout::Nv21 => PixelFormat::Nv21,
        Layout::Bgr => PixelFormat::Bgr24,
        Layout::Rgb => PixelFormat::Rgb24,
        Layout::Gray => PixelFormat::Gray,
        Layout::Gray16 => PixelFormat::Gray16Le,
    };
    let tight = RawFormat::new(format.width, format.height, pixels);
    let padded = RawFormat {
        stride: format.stride,
        ..tight
    };
    // A driver may tell a stride that its buffers do not have.
    let is_padded = padded
        .frame_bytes()
        .is_ok_and(|length| length <= bytes.len());
    let raw = if is_padded { padded } else { tight };
    decoder.raw(raw, bytes, buffer).map(picture)
}

/// The frames of a rendered flight.
pub struct Rendered {
    flight: Flight,
    next: usize,
}

impl Rendered {
    /// A flight from its first frame on.
    pub fn new(config: FlightConfig) -> Rendered {
        Rendered {
            flight: Flight::new(config),
            next: 0,
        }
    }

    /// Renders a frame; `None` past the end.
    pub fn render(&self, index: usize, buffer: Vec<u8>) -> Option<Picture> {
        if index >= self.flight.len() {
            return None;
        }
        let mut rendered = FrameBuffer {
            data: buffer,
            ..FrameBuffer::default()
        };
        self.flight.render(index, &mut rendered);
        Some(Picture {
            data: rendered.data,
            width: rendered.width,
            height: rendered.height,
            order: Order::Rgb,
        })
    }
}

impl Frames for Rendered {
    fn next(&mut self, spare: Vec<u8>) -> Result<Option<Picture>, String> {
        let picture = self.render(self.next, spare);
        self.next += 1;
        Ok(picture)
    }
}

/// Reads `seed=3,difficulty=hard,size=640x360,frames=300`, each part optional.
pub fn parse_flight(text: &str) -> Result<FlightConfig, String> {
    let mut config = FlightConfig {
        frames: FRAMES,
        ..FlightConfig::default()
    };
    for part in text.split(',').filter(|part| !part.is_empty()) {
        let (key, value) = part.split_once('=').unwrap_or((part, ""));
        let wrong = |expected: &str| format!("flight: {key} is {value:?}, expected {expected}");
        match key {
            "seed" => config.seed = value.parse().map_err(|_| wrong("a whole number"))?,
            "frames" => {
                config.frames = value
                    .parse()
                    .ok()
                    .filter(|frames| (1..=10_000_000).contains(frames))
                    .ok_or_else(|| wrong("a whole number from 1 to 10000000"))?;
            }
            "difficulty" => {
                config.difficulty = match value {
                    "easy" => Difficulty::Easy,
                    "medium" => Difficulty::Medium,
                    "hard" => Difficulty::Hard,
                    _ => return Err(wrong("easy, medium or hard")),
                };
            }
            "size" => {
                let size = crate::args::size(value).ok();
                let sides = 64..=8192;
                (config.width, config.height) = size
                    .filter(|(w, h)| sides.contains(w) && sides.contains(h))
                    .ok_or_else(|| wrong("WIDTHxHEIGHT, sides from 64 to 8192"))?;
            }
            _ => {
                return Err(format!(
                    "flight: {key:?}, expected seed, difficulty, size or frames"
                ));
            }
        }
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flight_in_words_is_parsed() {
        let config = parse_flight("seed=3,difficulty=hard,size=320x180,frames=40").unwrap();

        assert_eq!(config.seed, 3);
        assert_eq!((config.width, config.height), (320, 180));
        assert_eq!(config.frames, 40);
        assert_eq!(config.difficulty, Difficulty::Hard);
        assert!(parse_flight("").is_ok());
        for bad in [
            "seed=x",
            "size=1x1",
            "size=9",
            "frames=0",
            "color=red",
            "difficulty=mad",
        ] {
            assert!(parse_flight(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn frames_of_a_thermal_camera_share_one_range() {
        let format = Format {
            layout: Layout::Gray16,
            width: 100,
            height: 1,
            stride: None,
        };
        // Counts from 2960 on, as an uncooled sensor has them; then a hot object fills the view.
        let ramp = |shift: u16| -> Vec<u8> {
            (0..100)
                .flat_map(|i| (2960 + i + shift).to_le_bytes())
                .collect()
        };
        let mut decoder = Decoder::default();

        let first = decode(&mut decoder, format, &ramp(0), Vec::new()).unwrap();
        let second = decode(&mut decoder, format, &ramp(20), Vec::new()).unwrap();
        let short = decode(&mut decoder, format, &[0; 30], Vec::new());

        assert_eq!((first.width, first.order), (100, Order::Gray));
        assert!(first.data[90] > first.data[10] + 100, "{:?}", first.data);
        // The same count keeps nearly its brightness.
        assert!(second.data[50].abs_diff(first.data[70]) < 8);
        assert!(short.is_err());
    }

    #[test]
    fn input_is_told_apart_by_its_look() {
        let kind = |text: &str| kind(Input::new(text)).unwrap();

        assert!(matches!(kind("/dev/video2"), Kind::Camera(_)));
        assert!(matches!(kind("rtsp://a/b"), Kind::Stream(_)));
        assert!(matches!(kind("http://a/b"), Kind::Stream(_)));
        assert!(matches!(kind("rtp:5600"), Kind::Stream(_)));
        assert!(matches!(kind("gst:videotestsrc"), Kind::Stream(_)));
        assert!(matches!(kind("camera.sdp"), Kind::Stream(_)));
        assert!(matches!(kind("-"), Kind::Pipe(_)));
        assert!(matches!(kind("clip.mp4"), Kind::File(_)));
        assert!(matches!(kind("flight:seed=1"), Kind::Rendered(_)));
    }
}
