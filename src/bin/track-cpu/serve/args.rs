//! The command lines of `serve` and `replay`: clap structs and the parsing of their values.

use std::path::PathBuf;
use std::time::Duration;

use serde_json::json;
use station::commands::Place;
use station::http::HttpOptions;
use station::log::{self, LogOptions};
use station::mavlink::{MavlinkOptions, VideoStreamEncoding};
use station::{Limits, Options};
use track_cpu::source::{PixelFormat, RawFormat};
use track_cpu::{BBox, Model};

use super::engine::frame_box;
use super::video::VideoArgs;
use crate::args::input::{ReadArgs, pix_help};
use crate::args::{
    EngineArgs, Mode, ModelArg, bbox, frame_rate, pixel_format, size, targets, threshold,
};

const EXAMPLES: &str = "\
Examples:
  track-cpu serve --input /dev/video0 --http 127.0.0.1:8080
  track-cpu serve --input rtsp://192.168.1.10/main --mavlink udpout:192.168.1.2:14550 \\
      --log flight.jsonl
  track-cpu serve --input flight:seed=3,difficulty=hard,size=1280x720 --init 600,320,60,40

Inputs: a V4L2 camera (/dev/videoN); anything that `track` reads (videos and URLs through the ffmpeg
on your PATH, folders, - for standard input); H.264 in RTP on a port of this machine (rtp:5600,
rtp:5600/h265, rtp:5600/jpeg) or as X.sdp describes it; a GStreamer pipeline that ends in raw video
('gst:v4l2src ! image/jpeg ! jpegdec'), run by your gst-launch-1.0; or a rendered flight,
flight:[seed=N],[difficulty=easy|medium|hard],[size=WxH],[frames=N].

Only the newest frame is tracked; the others are counted as dropped. One JSON object per tracked
frame goes to standard output; with --targets one per target of the frame. A camera or stream that
fails, ends or falls silent is opened again. SIGTERM and SIGINT end the program in order.

Commands: {\"command\": \"start\", \"box\": [left, top, width, height]} in pixels; \"rectangle\": [left,
top, right, bottom] or \"point\": [x, y] in shares of the frame in place of \"box\", and \"frame\": N if
they were seen in that frame; {\"command\": \"stop\"}; {\"command\": \"state\"}. With --targets,
start and stop may name a \"target\"; else start takes the lowest free number and stop ends all. Each
is answered once it is carried out: {\"done\": true}, or false with an \"error\"; an \"id\" is
repeated.";

/// `serve`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct ServeArgs {
    /// Read options from this file, one a line: name = value, as in TOML; a list repeats an option.
    /// Options on the command line win.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    /// Camera, stream, file, folder, - or rendered flight.
    #[arg(short, long, value_name = "INPUT", default_value = "/dev/video0")]
    pub input: PathBuf,
    /// Size of headerless frames on standard input, or the size asked of a camera.
    #[arg(long, value_name = "WxH", value_parser = size)]
    pub raw: Option<(usize, usize)>,
    #[doc = "The pixel format."]
    #[arg(long, value_name = "FORMAT", value_parser = pixel_format, requires = "raw",
        help = pix_help())]
    pub pix: Option<PixelFormat>,
    /// More about how frames are read.
    #[command(flatten)]
    pub read: ReadArgs,
    /// Frames per second of files, folders and rendered flights, and of any input with
    /// --every-frame; other cameras and streams have their own.
    #[arg(long, value_name = "N", default_value_t = 30.0, value_parser = frame_rate)]
    pub fps: f64,
    /// Track every frame, however long that takes; for files.
    #[arg(long)]
    pub every_frame: bool,
    /// How many targets can be followed at a time, 1 to 8. They have numbers from 1 on in every
    /// output, and share the model and the time of a frame; autopilots steer by the lowest.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = targets)]
    pub targets: usize,
    /// Target in the first frame: left, top, width, height in pixels; without it a client starts.
    /// May be repeated.
    #[arg(long, value_name = "X,Y,W,H", value_parser = bbox, allow_hyphen_values = true)]
    pub init: Vec<BBox>,
    /// The model.
    #[command(flatten)]
    pub model: ModelArg,
    /// What follows the target.
    #[arg(long, value_enum, default_value_t = Mode::Flight)]
    pub mode: Mode,
    /// A threshold of flight mode: present (0.5), sure (0.8), absent (0.01), patience (0.5 s),
    /// coast (1 s) or confirm (3 looks). May be repeated.
    #[arg(long, value_name = "NAME=VALUE", value_parser = threshold)]
    pub threshold: Vec<(String, f64)>,
    /// Time for one frame; the search for a lost target uses what is left of it.
    #[arg(long, value_name = "MS", default_value = "33", value_parser = milliseconds)]
    pub deadline_ms: Duration,
    /// Age of a frame above which its result is withheld, and nothing moves by it.
    #[arg(long, value_name = "MS", default_value = "250", value_parser = milliseconds)]
    pub max_age_ms: Duration,
    /// Silence after which the source is stalled: outputs say so, and a camera or stream is
    /// reopened.
    #[arg(long, value_name = "MS", default_value = "2000", value_parser = milliseconds)]
    pub stall_ms: Duration,
    /// Send every JSON line to this address as well, one UDP datagram each.
    #[arg(long, value_name = "ADDR")]
    pub udp: Option<String>,
    /// Write no report to standard output.
    #[arg(long)]
    pub quiet: bool,
    /// Take commands as JSON lines, and answer each with one: udp:PORT of this machine, unix:PATH,
    /// or - for standard input. May be repeated.
    #[arg(long, value_name = "WHERE")]
    pub commands: Vec<Place>,
    /// How the network runs.
    #[command(flatten)]
    pub engine: EngineArgs,
    /// The flight log.
    #[command(flatten)]
    pub log: LogArgs,
    /// MAVLink camera.
    #[command(flatten)]
    pub mavlink: MavlinkArgs,
    /// Web page.
    #[command(flatten)]
    pub http: HttpArgs,
    /// Video with boxes.
    #[command(flatten)]
    pub video: VideoArgs,
}

/// Options of the flight log.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Flight log")]
pub struct LogArgs {
    /// Write a log that `track-cpu replay` can follow; an earlier flight's log is kept, and the new
    /// one gets a number.
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Save every tracked frame into this folder, for sources that cannot be read twice; an earlier
    /// flight's folder is kept, and the new one gets a number.
    #[arg(long, value_name = "DIR", requires = "log")]
    log_frames: Option<PathBuf>,
    /// Size at which the log continues in a new file.
    #[arg(long, value_name = "MB", default_value_t = 64, requires = "log",
        value_parser = clap::value_parser!(u64).range(1..=100_000))]
    log_size: u64,
    /// Size of all logs of this name, above which the oldest ones are removed.
    #[arg(long, value_name = "MB", default_value_t = 1024, requires = "log",
        value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    log_total: u64,
}

/// Options of the MAVLink camera.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "MAVLink")]
pub struct MavlinkArgs {
    /// Be a MAVLink camera on this link: udpout:HOST:PORT, udpin:HOST:PORT, tcpout:HOST:PORT,
    /// tcpin:HOST:PORT or serial:/dev/ttyX:BAUD. May be repeated; the first link leads to the
    /// vehicle, and gets gimbal rates and landing targets.
    #[arg(long, value_name = "ADDR")]
    mavlink: Vec<String>,
    /// System id, which is the vehicle's.
    #[arg(long, value_name = "N", default_value_t = 1,
        value_parser = clap::value_parser!(u8).range(1..))]
    mav_system: u8,
    /// Component id; cameras have 100 to 105.
    #[arg(long, value_name = "N", default_value_t = 100,
        value_parser = clap::value_parser!(u8).range(7..))]
    mav_component: u8,
    /// System ids that may start, stop and set intervals, besides our own; all others may only ask.
    #[arg(long, value_name = "N,N", value_delimiter = ',', default_value = "255")]
    mav_allow: Vec<u8>,
    /// File with the signing key, 32 bytes or 64 hexadecimal digits; unsigned messages are then
    /// refused.
    #[arg(long, value_name = "FILE", requires = "mavlink")]
    mav_key: Option<PathBuf>,
    /// Where ground stations get the video, told to them as it is (rtsp://...).
    #[arg(long, value_name = "URI", value_parser = uri)]
    video_uri: Option<String>,
    /// Keep the target in the middle with gimbal rates.
    #[arg(long, requires_all = ["mavlink", "hfov"])]
    gimbal: bool,
    /// Send LANDING_TARGET with the angles to the target.
    #[arg(long, requires_all = ["mavlink", "hfov"])]
    landing_target: bool,
    /// Horizontal field of view of the camera in degrees.
    #[arg(long, value_name = "DEG", value_parser = field_of_view)]
    hfov: Option<f64>,
}

/// Options of the web page.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Web page")]
pub struct HttpArgs {
    /// Serve the web page here, such as 127.0.0.1:8080; other addresses than this machine's own
    /// need a token.
    #[arg(long, value_name = "ADDR")]
    http: Option<String>,
    /// File that holds what starts and stops need; made up and shown if absent.
    #[arg(long, value_name = "FILE", requires = "http", conflicts_with = "token")]
    token_file: Option<PathBuf>,
    /// The token itself; other users of this machine can see it.
    #[arg(long, value_name = "TEXT", requires = "http", value_parser = token)]
    token: Option<String>,
    /// Watching needs the token as well.
    #[arg(long, requires = "http")]
    private: bool,
    /// A host name under which the page may be opened; addresses, localhost and this machine's own
    /// name are known. May be repeated.
    #[arg(long, value_name = "HOST", requires = "http")]
    http_name: Vec<String>,
}

impl ServeArgs {
    /// The headerless format, if there is one.
    pub fn raw_format(&self) -> Option<RawFormat> {
        self.read.raw(self.raw, self.pix)
    }

    /// How the station is to run; `repeats` if the input can be read again from its beginning.
    pub fn options(&self, model: &Model, repeats: bool) -> Options {
        let head = json!({
            "log": "track-cpu",
            "version": log::version(self.targets),
            "targets": self.targets,
            "input": self.input.display().to_string(),
            "repeats": repeats,
            "model": self.model.name().map(|path| path.display().to_string()),
            "weights": model.header().provenance.name,
            "isa": self.engine.isa().name(),
            "precision": model.precision().name(),
            "correction": model.config().correction,
            "template_update": model.config().template_update,
            "online_filter": model.config().online_filter,
            "unstretch": model.config().unstretch,
            "voting": model.config().voting,
            "mode": self.mode.name(),
            "thresholds": self.threshold,
        });
        Options {
            every_frame: self.every_frame,
            deadline: self.deadline_ms,
            period: Duration::from_secs_f64(1.0 / self.fps),
            limits: Limits {
                max_age: self.max_age_ms,
                stall: self.stall_ms,
            },
            init: self.init.iter().map(frame_box).collect(),
            print: !self.quiet,
            udp: self.udp.clone(),
            log: self.log.options(),
            head,
            mavlink: self.mavlink.options(&self.video, self.fps),
            http: self.http.options(),
            commands: self.commands.clone(),
            film: self.video.options(self.fps, false),
        }
    }
}

impl LogArgs {
    fn options(&self) -> Option<LogOptions> {
        Some(LogOptions {
            path: self.log.clone()?,
            frames: self.log_frames.clone(),
            max_file: self.log_size << 20,
            max_total: self.log_total << 20,
        })
    }
}

impl MavlinkArgs {
    fn options(&self, video: &VideoArgs, rate: f64) -> MavlinkOptions {
        let announced = video.announced();
        let is_ours = self.video_uri.is_none() && announced.is_some();
        MavlinkOptions {
            links: self.mavlink.clone(),
            system: self.mav_system,
            component: self.mav_component,
            allow: self.mav_allow.clone(),
            key: self.mav_key.clone(),
            video_uri: self.video_uri.clone().or(announced),
            video_rate: is_ours.then_some(rate as f32),
            video_encoding: if is_ours {
                video.encoding()
            } else {
                VideoStreamEncoding::VIDEO_STREAM_ENCODING_UNKNOWN
            },
            gimbal: self.gimbal,
            landing_target: self.landing_target,
            hfov: self.hfov,
        }
    }
}

impl HttpArgs {
    fn options(&self) -> HttpOptions {
        HttpOptions {
            address: self.http.clone(),
            token: self.token.clone(),
            token_file: self.token_file.clone(),
            private: self.private,
            names: self.http_name.clone(),
        }
    }
}

/// `replay`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Tracks the log's frames again, with the same commands at the same frames and as many searches, and
compares every box bit by bit. Prints one JSON object: frames, skipped, differing, first_difference.
Ends with code 7 if any box differs.

Frames come from --frames (what serve --log-frames saved), else from the log's own input, else from
the folder that the log names. A log that goes on in further files is followed through them. A log
whose earlier files are gone is compared from its first start on; the frames before are skipped.")]
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

fn token(text: &str) -> Result<String, String> {
    station::http::check_token(text)?;
    Ok(text.into())
}

/// A URI that fits into VIDEO_STREAM_INFORMATION.
fn uri(text: &str) -> Result<String, String> {
    if text.len() <= 159 {
        Ok(text.into())
    } else {
        Err("expected at most 159 bytes".into())
    }
}

fn field_of_view(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|degrees| (1.0..=170.0).contains(degrees))
        .ok_or("expected degrees from 1 to 170".into())
}
