//! The command lines of `serve` and `replay`: clap structs and the parsing of their values.

use std::path::PathBuf;
use std::time::Duration;

use track_cpu::BBox;
use track_cpu::source::{PixelFormat, RawFormat};

use crate::args::engine::model_help;
use crate::args::{EngineArgs, Mode, bbox, pixel_format, size};

const EXAMPLES: &str = "\
Examples:
  track-cpu serve --input /dev/video0 --http 127.0.0.1:8080
  track-cpu serve --input rtsp://192.168.1.10/main --mavlink udpout:192.168.1.2:14550 --log flight.jsonl
  track-cpu serve --input flight:seed=3,difficulty=hard,size=1280x720 --init 600,320,60,40

Inputs: a V4L2 camera (/dev/videoN), anything that `track` reads (videos and URLs through the ffmpeg on your PATH, folders,
- for standard input), or a rendered flight, flight:[seed=N],[difficulty=easy|medium|hard],[size=WxH],[frames=N].

Only the newest frame is tracked; the others are counted as dropped. One JSON object per tracked frame goes to standard
output. SIGTERM and SIGINT end it in order.";

/// `serve`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct ServeArgs {
    /// Camera, stream, file, folder, - or rendered flight.
    #[arg(short, long, value_name = "INPUT", default_value = "/dev/video0")]
    pub input: PathBuf,
    /// Size of headerless frames on standard input, or the size asked of a camera.
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub raw: Option<(usize, usize)>,
    /// Pixel format of headerless frames on standard input.
    #[arg(long, value_name = "FORMAT", value_parser = pixel_format, requires = "raw")]
    pub pix: Option<PixelFormat>,
    /// Frames per second of files, folders and rendered flights; cameras and streams have their own.
    #[arg(long, value_name = "N", default_value_t = 30.0, value_parser = rate)]
    pub fps: f64,
    /// Track every frame, however long that takes; for files.
    #[arg(long)]
    pub every_frame: bool,
    /// Target in the first frame: left, top, width, height in pixels; without it a client starts.
    #[arg(long, value_name = "X,Y,W,H", value_parser = bbox, allow_hyphen_values = true)]
    pub init: Option<BBox>,
    #[doc = "The model."]
    #[arg(short, long, value_name = "FILE|NAME", help = model_help())]
    pub model: Option<PathBuf>,
    /// What follows the target.
    #[arg(long, value_enum, default_value_t = Mode::Flight)]
    pub mode: Mode,
    /// Time for one frame; the search for a lost target uses what is left of it.
    #[arg(long, value_name = "MS", default_value = "33", value_parser = milliseconds)]
    pub deadline_ms: Duration,
    /// Results of frames older than this are never reported.
    #[arg(long, value_name = "MS", default_value = "250", value_parser = milliseconds)]
    pub max_age_ms: Duration,
    /// Send every JSON line to this address as well, a UDP datagram each.
    #[arg(long, value_name = "ADDR")]
    pub udp: Option<String>,
    /// No JSON lines on standard output.
    #[arg(long)]
    pub quiet: bool,
    /// Write a log that `track-cpu replay` can follow.
    #[arg(long, value_name = "FILE")]
    pub log: Option<PathBuf>,
    /// Save every tracked frame into this folder beside the log, for sources that cannot be read twice.
    #[arg(long, value_name = "DIR", requires = "log")]
    pub log_frames: Option<PathBuf>,
    /// How the network is run.
    #[command(flatten)]
    pub engine: EngineArgs,
    /// MAVLink camera.
    #[command(flatten)]
    pub mavlink: super::mavlink::MavlinkArgs,
    /// Web ground station.
    #[command(flatten)]
    pub http: super::http::HttpArgs,
}

impl ServeArgs {
    /// The headerless format, if there is one.
    pub fn raw_format(&self) -> Option<RawFormat> {
        let ((width, height), pixels) = self.raw.zip(self.pix)?;
        Some(RawFormat {
            width,
            height,
            pixels,
        })
    }
}

/// `replay`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Tracks the log's frames again, with the same commands at the same frames and as many searches, and compares every box
bit by bit. Prints one JSON object: frames, differing, first_difference. Ends with code 7 if any box differs.

Frames come from --frames (what serve --log-frames saved), else from the log's own input, if it can be read again.")]
pub struct ReplayArgs {
    /// Log that `serve --log` wrote.
    #[arg(value_name = "LOG")]
    pub log: PathBuf,
    /// Folder of saved frames.
    #[arg(long, value_name = "DIR")]
    pub frames: Option<PathBuf>,
    /// Weights file or built-in model in place of the one that the log names.
    #[arg(short, long, value_name = "FILE")]
    pub model: Option<PathBuf>,
}

fn milliseconds(text: &str) -> Result<Duration, String> {
    match text.parse::<f64>() {
        Ok(ms) if (1.0..=60_000.0).contains(&ms) => Ok(Duration::from_secs_f64(ms / 1e3)),
        _ => Err("expected milliseconds from 1 to 60000".into()),
    }
}

fn rate(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|fps| (0.1..=1000.0).contains(fps))
        .ok_or("expected a number from 0.1 to 1000".into())
}
