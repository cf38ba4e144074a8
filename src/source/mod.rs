//! Frames from image folders, glob patterns, video files, streams and pipes.
//!
//! | input | how it is read | file |
//! |---|---|---|
//! | folder, glob pattern, one image | jpg, jpeg, png, webp, bmp, pgm, ppm in natural order | `files.rs`, `decode.rs`, `jpeg.rs` |
//! | `-`, a named pipe, a `.y4m` or `.ppm` file | y4m, PPM, or headerless frames in a [`RawFormat`] | `stream.rs`, `header.rs`, `pixels.rs` |
//! | any other file, any URL, `rtp:PORT`, `X.sdp` | the user's own `ffmpeg`, spawned | `ffmpeg.rs`, `program.rs` |
//! | `gst:PIPELINE` | the user's own `gst-launch-1.0`, spawned | `gstreamer.rs`, `program.rs` |
//! | samples of 16 bits | stretched to 8 bits | `stretch.rs` |
//! | frames that cannot be read | held, skipped or fatal: [`OnBadFrame`] | `bad_frames.rs` |
//!
//! [`Source`] is an iterator; [`Prefetch`] runs one on its own thread. Buffers given back with
//! `recycle` are used again, so that a long video is read without an allocation per frame.
//!
//! ```no_run
//! use track_cpu::source::{Input, Source};
//!
//! let mut source = Source::open(&Input::new("flight/img"))?;
//! while let Some(image) = source.next() {
//!     let image = image?;
//!     println!("{}x{}", image.frame().width(), image.frame().height());
//!     source.recycle(image);
//! }
//! # Ok::<(), track_cpu::source::SourceError>(())
//! ```

mod bad_frames;
mod child;
mod decode;
mod ffmpeg;
mod files;
mod gstreamer;
mod header;
mod jpeg;
mod pixels;
mod prefetch;
mod program;
mod stream;
mod stretch;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

pub use crate::error::SourceError;
use crate::frame::{ChannelOrder, Frame};
pub use bad_frames::{BadFrame, BadFrames, OnBadFrame};
pub use child::bound_command;
pub use decode::Decoder;
pub use files::is_passed_over;
pub use pixels::{PixelFormat, RawFormat};
pub use prefetch::Prefetch;
pub use program::Stopper;
use stream::Stream;
pub use stretch::Stretch;

/// Beginnings of the addresses of streams that do not wait for their reader; other addresses may be
/// films, of which every frame counts.
pub const LIVE_SCHEMES: [&str; 7] = [
    "rtsp://", "rtsps://", "rtmp://", "rtp://", "udp://", "tcp://", "srt://",
];

/// Most bytes of one decoded picture: a bound on the memory that an untrusted file can claim.
pub const MAX_FRAME_BYTES: u64 = 512 << 20;

/// Most buffers kept for reuse.
const MAX_SPARE: usize = 4;

/// Where frames come from, and which of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Input {
    /// A folder, a glob pattern, an image, a video file, a URL, `rtp:PORT`, `gst:PIPELINE`, or `-`
    /// for standard input.
    pub location: PathBuf,
    /// How headerless frames are laid out; `None` where the input describes itself.
    pub raw: Option<RawFormat>,
    /// First frame wanted, 0-based.
    pub start: usize,
    /// End of the frames wanted, exclusive; `None` for all.
    pub end: Option<usize>,
    /// Further options of ffmpeg for this input.
    pub ffmpeg_args: Vec<String>,
    /// Whether a URL is known to be a live stream, which is decoded without delay.
    pub is_live: bool,
}

impl Input {
    /// All frames of `location`, which describes itself.
    pub fn new(location: impl Into<PathBuf>) -> Input {
        Input {
            location: location.into(),
            raw: None,
            start: 0,
            end: None,
            ffmpeg_args: Vec::new(),
            is_live: false,
        }
    }
}

/// One picture that owns its pixels: `height` rows of `width` pixels without gaps, of YUV plane
/// after plane.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// The pixels.
    pub data: Vec<u8>,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// How the bytes are to be read; [`frame`](Self::frame) does so.
    pub order: ChannelOrder,
    /// The file it came from; `None` for a frame of a stream.
    pub name: Option<PathBuf>,
}

impl Image {
    /// One headerless frame by itself, in `buffer`. YUV, of limited range, stays YUV.
    ///
    /// Frames of one camera go through one [`Decoder`], so that 16-bit ones share a range.
    ///
    /// # Errors
    /// If the format's sizes are out of bounds or `bytes` ends before the frame does.
    pub fn from_raw(raw: RawFormat, bytes: &[u8], buffer: Vec<u8>) -> Result<Image, String> {
        Decoder::default().raw(raw, bytes, buffer)
    }

    /// The picture as the tracker takes it.
    ///
    /// # Panics
    /// If the fields were changed so that they no longer describe a picture. What a [`Source`]
    /// yields always does.
    pub fn frame(&self) -> Frame<'_> {
        Frame::new(&self.data, self.width, self.height, self.order)
            .expect("an image has the bytes of its size")
    }
}

/// An open input: an iterator over its pictures.
///
/// A file of a folder that cannot be decoded is an error in its place, and the next file follows. A
/// stream ends at its first error.
pub struct Source {
    kind: Kind,
    decoder: Decoder,
    label: String, // the input as given, for messages
    note: Option<String>,
    places: Vec<PathBuf>,
    next: usize, // index of the frame that follows
    start: usize,
    end: Option<usize>,
    spare: Vec<Vec<u8>>,
}

enum Kind {
    Files(std::vec::IntoIter<PathBuf>),
    Stream(Box<Stream>),
    Ended,
}

impl Source {
    /// Opens an input. Nothing of a folder is decoded yet; the header of a pipe is read.
    ///
    /// # Errors
    /// If the input does not exist, holds no frame, describes none, or needs an `ffmpeg` that is
    /// not installed.
    pub fn open(input: &Input) -> Result<Source, SourceError> {
        let label = input.location.display().to_string();
        if let Some(end) = input.end.filter(|&end| end <= input.start) {
            let start = input.start;
            let reason = format!(
                "frames {start}..{end} are an empty range, expected an end behind the start"
            );
            return Err(SourceError::Format {
                input: label,
                reason,
            });
        }
        let (kind, note) = open_kind(input, &label)?;
        let mut source = Source {
            places: places(&input.location, &kind),
            kind,
            decoder: Decoder::default(),
            label,
            note,
            next: 0,
            start: input.start,
            end: input.end,
            spare: Vec::new(),
        };
        source.select_files()?;
        Ok(source)
    }

    /// What a user should know about the choice of frames, if anything.
    pub fn note(&self) -> Option<&str> {
        self.note.as_deref()
    }

    /// The files and folders that frames are read from, which no output may touch; `-` for standard
    /// input.
    pub fn places(&self) -> &[PathBuf] {
        &self.places
    }

    /// How many frames are left, where that is known without reading them: in folders.
    pub fn frames_left(&self) -> Option<usize> {
        match &self.kind {
            Kind::Files(files) => Some(files.len()),
            Kind::Stream(_) => None,
            Kind::Ended => Some(0),
        }
    }

    /// Gives a picture's buffer back for one of the next pictures.
    pub fn recycle(&mut self, image: Image) {
        if self.spare.len() < MAX_SPARE {
            self.spare.push(image.data);
        }
    }

    /// A handle that ends a blocked read from another thread; inputs read by ffmpeg have one.
    pub fn stopper(&self) -> Option<Stopper> {
        match &self.kind {
            Kind::Stream(stream) => stream.stopper(),
            _ => None,
        }
    }

    /// Cuts a folder to the frames wanted without opening a file.
    fn select_files(&mut self) -> Result<(), SourceError> {
        let Kind::Files(files) = &mut self.kind else {
            return Ok(());
        };
        let count = files.len();
        if self.start >= count {
            return Err(self.too_short(count));
        }
        let end = self.end.unwrap_or(count).min(count);
        let wanted = files.as_slice()[self.start..end].to_vec();
        self.kind = Kind::Files(wanted.into_iter());
        self.next = self.start;
        Ok(())
    }

    fn too_short(&self, count: usize) -> SourceError {
        let reason = match count {
            0 => "no frame in it".into(),
            _ => format!(
                "{count} frames in it, expected more than {} for the start asked for",
                self.start
            ),
        };
        SourceError::Empty {
            input: self.label.clone(),
            reason,
        }
    }

    /// The stream's next wanted frame; its end if there is none.
    fn next_of_stream(&mut self) -> Result<Option<Image>, SourceError> {
        let Kind::Stream(stream) = &mut self.kind else {
            return Ok(None);
        };
        while self.next < self.start {
            if !stream.skip()? {
                return Err(self.too_short(self.next));
            }
            self.next += 1;
        }
        if self.end.is_some_and(|end| self.next >= end) {
            return Ok(None);
        }
        let image = stream.next(self.spare.pop().unwrap_or_default())?;
        match image {
            None if self.next == self.start => Err(self.too_short(self.next)),
            None => Ok(None),
            Some(image) => {
                self.next += 1;
                Ok(Some(image))
            }
        }
    }
}

impl Iterator for Source {
    type Item = Result<Image, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Kind::Files(files) = &mut self.kind {
            let path = files.next()?;
            let buffer = self.spare.pop().unwrap_or_default();
            return Some(self.decoder.read(path, buffer));
        }
        let image = self.next_of_stream().transpose();
        if !matches!(image, Some(Ok(_))) {
            self.kind = Kind::Ended;
        }
        image
    }
}

/// The files and folders behind an input.
fn places(location: &Path, kind: &Kind) -> Vec<PathBuf> {
    match kind {
        // A pattern does not exist as a path: its files are in these folders.
        Kind::Files(files) if !location.exists() => {
            let folders: BTreeSet<PathBuf> = files
                .as_slice()
                .iter()
                .filter_map(|file| file.parent())
                .map(|folder| {
                    if folder == Path::new("") {
                        PathBuf::from(".")
                    } else {
                        folder.to_path_buf()
                    }
                })
                .collect();
            folders.into_iter().collect()
        }
        _ => {
            let url = location.to_str().unwrap_or_default();
            let local = url.strip_prefix("file://").map(PathBuf::from);
            vec![local.unwrap_or_else(|| location.to_path_buf())]
        }
    }
}

/// Decides how a location is read; returns a note on it as well.
fn open_kind(input: &Input, label: &str) -> Result<(Kind, Option<String>), SourceError> {
    let location = input.location.as_path();
    let raw = input.raw;
    let frames = |found: files::Found| (Kind::Files(found.files.into_iter()), found.note);
    let stream = |stream: Stream| (Kind::Stream(Box::new(stream)), None);

    if location.as_os_str() == "-" {
        return Stream::from_reader(Box::new(std::io::stdin()), label, raw).map(stream);
    }
    let text = location.to_str().unwrap_or_default();
    if let Some(pipeline) = text.strip_prefix("gst:") {
        return Stream::from_gstreamer(pipeline, label).map(stream);
    }
    if text.contains("://") || text.starts_with("rtp:") {
        return Stream::from_ffmpeg(location.as_os_str(), label, input).map(stream);
    }
    let io = |error| SourceError::Io {
        path: location.into(),
        error,
    };
    let found = match std::fs::metadata(location) {
        Ok(found) => found,
        Err(error) => {
            return match location.to_str().filter(|text| files::is_pattern(text)) {
                Some(pattern) => files::matching(pattern).map(frames),
                None => Err(io(error)),
            };
        }
    };
    if found.is_dir() {
        return files::in_folder(location).map(frames);
    }
    if found.is_file() && raw.is_none() && !files::has_extension(location, &["y4m", "ppm"]) {
        if files::is_image(location) {
            let file = vec![location.to_path_buf()];
            return Ok((Kind::Files(file.into_iter()), None));
        }
        return Stream::from_ffmpeg(&files::file_url(location), label, input).map(stream);
    }
    let file = std::fs::File::open(location).map_err(io)?;
    Stream::from_reader(Box::new(file), label, raw).map(stream)
}
