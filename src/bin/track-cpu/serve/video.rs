//! The video with boxes of `serve` and `track`: its options, and what is drawn.

use std::ffi::OsStr;
use std::path::Path;

use image::RgbImage;
use station::film::{Film, FilmOptions, Output};
use station::mavlink::VideoStreamEncoding;
use station::{Followed, FrameBox, Picture, Report, State, Tracked};
use track_cpu::BBox;
use track_cpu::source::{Image, bound_command};

use super::engine::{frame, frame_box, state};
use super::feed::picture;
use crate::exit::Failure;
use crate::follow::Found;
use crate::overlay::Canvas;

/// Options of the video with boxes.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Video")]
pub struct VideoArgs {
    /// Write the video with boxes burnt in, through your ffmpeg: a file, rtp://HOST:PORT, or
    /// rtsp://, udp://, srt:// or rtmp:// of a server. Its rate is --fps. A file that is there is
    /// kept, and the new one gets a number.
    #[arg(long, value_name = "WHERE", value_parser = Output::parse)]
    video_out: Option<Output>,
    /// Options of ffmpeg for encoder and output, separated by blanks [default: H.264 by libx264
    /// without delay].
    #[arg(
        long,
        value_name = "ARGS",
        requires = "video_out",
        allow_hyphen_values = true,
        default_value = "",
        hide_default_value = true
    )]
    video_args: String,
}

impl VideoArgs {
    /// How the video is to be written; with `every` no frame may be missing.
    pub fn options(&self, rate: f64, every: bool) -> Option<FilmOptions> {
        Some(FilmOptions {
            output: self.video_out.clone()?,
            rate,
            every,
            args: self
                .video_args
                .split_whitespace()
                .map(str::to_string)
                .collect(),
            draw: burn_in,
            ffmpeg: || bound_command(OsStr::new("ffmpeg")),
        })
    }

    /// The file that is asked for; its name may get a number.
    pub fn file(&self) -> Option<&Path> {
        match self.video_out.as_ref()? {
            Output::File(path) => Some(path),
            Output::Stream { .. } => None,
        }
    }

    /// Where ground stations find it.
    pub fn announced(&self) -> Option<String> {
        self.video_out.as_ref()?.announced()
    }

    /// How the video is encoded, as far as the options tell.
    pub fn encoding(&self) -> VideoStreamEncoding {
        let args = &self.video_args;
        if args.contains("265") || args.contains("hevc") {
            VideoStreamEncoding::VIDEO_STREAM_ENCODING_H265
        } else if args.is_empty() || args.contains("264") {
            VideoStreamEncoding::VIDEO_STREAM_ENCODING_H264
        } else {
            VideoStreamEncoding::VIDEO_STREAM_ENCODING_UNKNOWN
        }
    }
}

/// The video of `track`, which holds every frame.
pub struct Video(Film);

impl Video {
    /// Starts the video, if the options ask for one.
    ///
    /// # Errors
    /// If its file cannot be created.
    pub fn start(args: &VideoArgs, rate: f64) -> Result<Option<Video>, Failure> {
        let film = args
            .options(rate, true)
            .map(|film| Film::start(film, |_| {}));
        Ok(film.transpose()?.map(Video))
    }

    /// Has a frame drawn and encoded.
    pub fn add(&mut self, index: usize, image: &Image, found: &Found) {
        let (presence, state) = match found.sureness {
            Some((presence, at)) => (Some(presence), state(at)),
            None => (None, State::Tracking),
        };
        let track = Tracked {
            presence,
            state,
            ..Tracked::certain(frame_box(&found.bbox))
        };
        let report = Report {
            frame: index as u64,
            size: (image.width, image.height),
            room: 1,
            targets: vec![Followed {
                id: 1,
                start: 1,
                track,
            }],
            ..Report::default()
        };
        let _ = self.0.add(picture(image.clone()), report); // that it has ended is told at the end
    }

    /// Completes the video.
    ///
    /// # Errors
    /// If frames are missing.
    pub fn finish(self) -> Result<(), Failure> {
        let lacking = |reason| station::Error::output("--video-out", reason).into();
        self.0.finish().map_err(lacking)
    }
}

/// Draws what is known of a frame into a copy of it.
pub fn burn_in(picture: &Picture, report: &Report) -> RgbImage {
    let Ok(frame) = frame(picture) else {
        return picture.to_rgb();
    };
    let mut canvas = Canvas::new(&frame);
    let mut caption = format!("#{}", report.frame);
    for Followed { id, track, .. } in &report.targets {
        let FrameBox { x, y, w, h } = track.bbox;
        let mut name = String::new();
        if report.tells_ids() {
            name = id.to_string();
            caption += &format!(" {id}");
        }
        canvas.target(&BBox::new(x, y, w, h), &name, track.presence);
        caption += &format!(" {}", track.state.name());
    }
    if report.targets.is_empty() {
        caption += " idle";
    }
    canvas.caption(&caption);
    canvas.picture
}
