//! The command line of `track`.

use std::io::IsTerminal;
use std::path::PathBuf;

use track_cpu::BBox;

use super::input::{BadFrameArg, RawArgs};
use super::values::{bbox, frame_rate, overlay, threshold};
use super::{EngineArgs, Mode, ModelArg};
#[cfg(feature = "serve")]
use crate::serve::video::VideoArgs;

/// `track`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct TrackArgs {
    /// Folder of images, 'glob*.jpg' (quoted), image, video file, URL, or - for standard input.
    #[arg(short, long, value_name = "INPUT")]
    pub input: PathBuf,
    /// The object in the first frame: left, top, width, height in pixels, 0-based. Without it, a
    /// terminal names a web page of this machine to draw it on.
    #[arg(long, value_name = "X,Y,W,H", value_parser = bbox, allow_hyphen_values = true,
        required = !can_ask(), required_if_eq("json", "true"))]
    pub init: Option<BBox>,
    /// Which model.
    #[command(flatten)]
    pub model: ModelArg,
    /// File for the boxes, one line x,y,w,h per frame [default: standard output]. A file of that
    /// name is replaced when the first box is known.
    #[arg(short, long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Draw the boxes into pictures: a folder for JPEGs, a .gif, or a .mp4 (through ffmpeg).
    #[arg(long, value_name = "DIR|X.gif|X.mp4", value_parser = overlay)]
    pub overlay: Option<PathBuf>,
    /// Write one JSON object per frame: frame, box, score, milliseconds; held where a box is held.
    #[arg(long)]
    pub json: bool,
    /// What follows the target; in flight mode JSON lines hold presence (0 to 1) and state as well.
    #[arg(long, value_enum, default_value_t = Mode::Plain)]
    pub mode: Mode,
    /// Frames per second, by which flight mode knows how much time goes by; also those of
    /// --video-out.
    #[arg(long, value_name = "N", default_value_t = 30.0, value_parser = frame_rate)]
    pub fps: f64,
    /// A threshold of flight mode: present (0.5), sure (0.8), absent (0.01), patience (0.5 s),
    /// coast (1 s) or confirm (3 looks). May be repeated.
    #[arg(long, value_name = "NAME=VALUE", value_parser = threshold)]
    pub threshold: Vec<(String, f64)>,
    /// First frame, 0-based; --init refers to it.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub start: usize,
    /// Frame to end before.
    #[arg(long, value_name = "N")]
    pub end: Option<usize>,
    /// Headerless frames.
    #[command(flatten)]
    pub raw: RawArgs,
    /// Frames that cannot be read.
    #[command(flatten)]
    pub bad_frames: BadFrameArg,
    /// How the network runs.
    #[command(flatten)]
    pub engine: EngineArgs,
    /// Video with boxes.
    #[cfg(feature = "serve")]
    #[command(flatten)]
    pub video: VideoArgs,
}

/// Whether somebody at a terminal may be asked for the object.
fn can_ask() -> bool {
    let are_terminals = std::io::stdin().is_terminal() && std::io::stderr().is_terminal();
    are_terminals && cfg!(feature = "serve")
}

const EXAMPLES: &str = "\
Examples:
  track-cpu track --input flight.mp4 --out boxes.txt --overlay tracked.mp4
  track-cpu track --input seq/img --init 300,120,40,24 > boxes.txt
  track-cpu track --input 'seq/img/*.jpg' --init 300,120,40,24 --start 100 --end 200 --json
  track-cpu track --input flight.mp4 --init 300,120,40,24 --out boxes.txt --overlay tracked.mp4
  track-cpu track --input rtsp://192.168.1.10/main --init 600,300,80,60 --json | your-program
  ffmpeg -i flight.mp4 -f yuv4mpegpipe - | track-cpu track --input - --init 300,120,40,24
  rpicam-vid -t 0 --codec yuv420 --width 640 --height 480 -o - |
      track-cpu track --input - --raw 640x480 --pix yuv420p --init 300,120,40,24

Inputs:
  images (jpg, png, webp, bmp, pgm, ppm) are read in natural order: img2 comes before img10;
    they are turned as their orientation tag says, and 16-bit samples are stretched to 8 bits;
    names that begin with a dot are passed over; of pictures and masks that share names, one kind
    is read;
  videos and URLs are read by the ffmpeg on your PATH;
  standard input, named pipes and .y4m files hold y4m, PPM, or headerless frames with --raw and
    --pix.

One line per frame goes to standard output (or --out), the first one being the box given; progress
and a summary go to standard error. Every line is written as soon as its frame is done. No output
may be an input or lie in an input folder.";
