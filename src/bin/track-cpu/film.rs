//! Drawn frames on their way into a folder of JPEGs, a GIF or a video.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use image::codecs::gif::{GifEncoder, Repeat};
use image::codecs::jpeg::JpegEncoder;
use image::{Delay, ImageError, RgbImage};
use program::NewFile;
use track_cpu::Frame;

use crate::exit::Failure;
use crate::overlay::Canvas;

/// Frames per second of a film: sources do not tell theirs.
const RATE: u32 = 30;

/// Where drawn frames go.
pub enum Film {
    /// One JPEG per frame, named by its index.
    Folder(PathBuf),
    /// An animated GIF.
    Gif(Gif),
    /// A video, encoded by ffmpeg.
    Video(Video),
}

impl Film {
    /// The first file that a film of this path writes: itself, or a picture in a folder.
    pub fn first_file(path: &Path) -> PathBuf {
        if has_extension(path, "gif") || has_extension(path, "mp4") {
            path.to_path_buf()
        } else {
            path.join(picture_name(0))
        }
    }

    /// Opens a film: a GIF or video by its extension, a folder otherwise. A GIF or video takes its
    /// place when it is complete.
    pub fn create(path: &Path) -> Result<Film, Failure> {
        if has_extension(path, "gif") {
            return Gif::create(path).map(Film::Gif);
        }
        if has_extension(path, "mp4") {
            let file = NewFile::create(path).map_err(|error| Failure::output(path, error))?;
            return Ok(Film::Video(Video {
                path: path.into(),
                file,
                encoder: None,
                size: (0, 0),
            }));
        }
        std::fs::create_dir_all(path).map_err(|error| Failure::output(path, error))?;
        Ok(Film::Folder(path.into()))
    }

    /// Adds a frame after `draw` has drawn on its copy.
    pub fn add(
        &mut self,
        index: usize,
        frame: &Frame<'_>,
        draw: impl FnOnce(&mut Canvas),
    ) -> Result<(), Failure> {
        match self {
            Film::Folder(folder) => {
                let mut canvas = Canvas::new(frame);
                draw(&mut canvas);
                let path = folder.join(picture_name(index));
                save_jpeg(&canvas.picture, &path).map_err(|error| Failure::output(&path, error))
            }
            Film::Gif(gif) => {
                gif.add(frame, draw);
                Ok(())
            }
            Film::Video(video) => video.add(frame, draw),
        }
    }

    /// Completes the film.
    pub fn finish(self) -> Result<(), Failure> {
        match self {
            Film::Folder(_) => Ok(()),
            Film::Gif(gif) => gif.finish(),
            Film::Video(video) => video.finish(),
        }
    }
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension()
        .is_some_and(|found| found.eq_ignore_ascii_case(extension))
}

/// The file name of a frame's picture.
fn picture_name(index: usize) -> String {
    format!("{index:06}.jpg")
}

fn save_jpeg(picture: &RgbImage, path: &Path) -> Result<(), ImageError> {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, 90).encode_image(picture)?;
    Ok(NewFile::write(path, &jpeg)?)
}

/// An animated GIF that stays small however long the video is: frames are scaled down and thinned
/// out.
pub struct Gif {
    path: PathBuf,
    file: NewFile,
    size: Option<(u32, u32)>,
    pictures: Vec<RgbImage>,
    step: usize, // every step-th frame is kept
    seen: usize,
}

impl Gif {
    const MAX_WIDTH: u32 = 400;
    const MAX_PICTURES: usize = 160;
    const MAX_BYTES: usize = 6_000_000;
    /// Neighbors that differ by at most this much in every channel become equal: halves the file.
    const TOLERANCE: u8 = 7;

    fn create(path: &Path) -> Result<Gif, Failure> {
        let file = NewFile::create(path).map_err(|error| Failure::output(path, error))?;
        Ok(Gif {
            path: path.into(),
            file,
            size: None,
            pictures: Vec::new(),
            step: 1,
            seen: 0,
        })
    }

    fn add(&mut self, frame: &Frame<'_>, draw: impl FnOnce(&mut Canvas)) {
        let wanted = self.seen.is_multiple_of(self.step);
        self.seen += 1;
        if !wanted {
            return;
        }
        let (width, height) = *self.size.get_or_insert_with(|| {
            let (w, h) = (frame.width() as u32, frame.height() as u32);
            let width = w.min(Self::MAX_WIDTH);
            (width, (h * width / w).clamp(1, 2 * Self::MAX_WIDTH))
        });
        let mut canvas = Canvas::fitted(frame, width, height);
        soften(&mut canvas.picture, Self::TOLERANCE);
        draw(&mut canvas);
        self.pictures.push(canvas.picture);
        if self.pictures.len() > Self::MAX_PICTURES {
            self.thin();
        }
    }

    /// Drops every second picture.
    fn thin(&mut self) {
        let mut keep = [false, true].into_iter().cycle();
        self.pictures.retain(|_| keep.next() == Some(false));
        self.step *= 2;
    }

    fn finish(mut self) -> Result<(), Failure> {
        if self.pictures.is_empty() {
            return Ok(());
        }
        let bytes = loop {
            let bytes = self
                .encode()
                .map_err(|error| Failure::output(&self.path, error))?;
            if bytes.len() <= Self::MAX_BYTES || self.pictures.len() < 3 {
                break bytes;
            }
            self.thin();
        };
        self.file
            .write_all(&bytes)
            .and_then(|()| self.file.keep())
            .map_err(|error| Failure::output(&self.path, error))
    }

    fn encode(&self) -> Result<Vec<u8>, ImageError> {
        let mut bytes = Vec::new();
        let mut encoder = GifEncoder::new_with_speed(&mut bytes, 10);
        encoder.set_repeat(Repeat::Infinite)?;
        let delay = Delay::from_numer_denom_ms(1000 * self.step as u32, RATE);
        for picture in &self.pictures {
            let frame = image::DynamicImage::from(picture.clone()).into_rgba8();
            encoder.encode_frame(image::Frame::from_parts(frame, 0, 0, delay))?;
        }
        drop(encoder);
        Ok(bytes)
    }
}

/// Lets each row's pixels repeat the one before where they are close to it, which GIF's compression
/// rewards.
fn soften(picture: &mut RgbImage, tolerance: u8) {
    let row_bytes = 3 * picture.width() as usize;
    for row in picture.chunks_exact_mut(row_bytes) {
        let mut last = [row[0], row[1], row[2]];
        for pixel in row.chunks_exact_mut(3) {
            let is_close = |(&a, b): (&u8, u8)| a.abs_diff(b) <= tolerance;
            if pixel.iter().zip(last).all(is_close) {
                pixel.copy_from_slice(&last);
            } else {
                last.copy_from_slice(pixel);
            }
        }
    }
}

/// A video that ffmpeg encodes; it starts with the first frame, whose size all others get.
pub struct Video {
    path: PathBuf,
    file: NewFile,
    encoder: Option<Child>,
    size: (u32, u32),
}

impl Video {
    fn add(&mut self, frame: &Frame<'_>, draw: impl FnOnce(&mut Canvas)) -> Result<(), Failure> {
        if self.encoder.is_none() {
            self.size = (frame.width() as u32, frame.height() as u32);
            self.encoder = Some(self.spawn()?);
        }
        let mut canvas = Canvas::fitted(frame, self.size.0, self.size.1);
        draw(&mut canvas);
        let pipe = self
            .encoder
            .as_mut()
            .and_then(|encoder| encoder.stdin.as_mut());
        match pipe.map(|pipe| pipe.write_all(canvas.picture.as_raw())) {
            Some(Ok(())) => Ok(()),
            _ => Err(self.failure()),
        }
    }

    fn spawn(&self) -> Result<Child, Failure> {
        let size = format!("{}x{}", self.size.0, self.size.1);
        let mut command = Command::new("ffmpeg");
        command.args([
            "-y",
            "-hide_banner",
            "-loglevel",
            "error",
            "-f",
            "rawvideo",
            "-pix_fmt",
            "rgb24",
        ]);
        command.args(["-s", &size, "-r", &RATE.to_string(), "-i", "pipe:0"]);
        // Most encoders want even sides.
        command.args([
            "-vf",
            "pad=ceil(iw/2)*2:ceil(ih/2)*2",
            "-pix_fmt",
            "yuv420p",
            "-movflags",
            "+faststart",
        ]);
        let mut url = std::ffi::OsString::from("file:");
        url.push(self.file.path());
        command.arg(url).stdin(Stdio::piped()).stdout(Stdio::null());
        command.spawn().map_err(|error| match error.kind() {
            std::io::ErrorKind::NotFound => Failure::output(
                &self.path,
                "ffmpeg is needed to write video, but was not found: install it, or write a \
                 folder or GIF",
            ),
            _ => Failure::output(&self.path, format!("ffmpeg could not be started: {error}")),
        })
    }

    /// Why ffmpeg stopped reading; its own words are on standard error.
    fn failure(&mut self) -> Failure {
        let status = self.encoder.take().and_then(|mut encoder| {
            drop(encoder.stdin.take());
            encoder.wait().ok()
        });
        let status = status.map_or("lost".into(), |status| status.to_string());
        Failure::output(
            &self.path,
            format!("ffmpeg failed to write the video ({status})"),
        )
    }

    fn finish(mut self) -> Result<(), Failure> {
        let Some(encoder) = &mut self.encoder else {
            return Ok(());
        };
        drop(encoder.stdin.take());
        match encoder.wait() {
            Ok(status) if status.success() => {
                let kept = self.file.keep();
                kept.map_err(|error| Failure::output(&self.path, error))
            }
            _ => Err(self.failure()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn softened_picture_stays_within_the_tolerance() {
        let mut picture = RgbImage::from_fn(64, 3, |x, y| Rgb([(x * 5) as u8, (x * y) as u8, 9]));
        let before = picture.clone();
        soften(&mut picture, 7);
        assert!(
            before
                .iter()
                .zip(picture.iter())
                .all(|(a, b)| a.abs_diff(*b) <= 7)
        );
        let different = |p: &RgbImage| {
            p.rows()
                .flat_map(|row| row.map(|p| p.0))
                .collect::<std::collections::HashSet<_>>()
                .len()
        };
        assert!(different(&picture) < different(&before));
    }

    #[test]
    fn long_gif_is_thinned_evenly() {
        let path = std::env::temp_dir().join(format!("track-cpu-thin-{}.gif", std::process::id()));
        let mut gif = Gif::create(&path).unwrap();
        let pixels: Vec<u8> = vec![0; 4];
        for i in 0..1000u32 {
            let frame = Frame::new(&pixels, 2, 2, track_cpu::ChannelOrder::Gray).unwrap();
            gif.add(&frame, |canvas| {
                *canvas.picture.get_pixel_mut(0, 0) = Rgb([(i / 8) as u8, 0, 0])
            });
        }
        assert_eq!((gif.step, gif.pictures.len()), (8, 125));
        assert!(
            gif.pictures
                .iter()
                .enumerate()
                .all(|(i, p)| p.get_pixel(0, 0).0[0] == i as u8)
        );
        gif.finish().unwrap();
        assert!(std::fs::metadata(&path).unwrap().len() > 1000);
        std::fs::remove_file(&path).unwrap();
    }
}
