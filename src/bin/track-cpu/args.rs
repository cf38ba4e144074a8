//! The command line: clap structs and the parsing of their values, nothing else.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::{Parser, Subcommand, ValueEnum};
use kernels::conv::Algorithm;
use scenes::Difficulty;
use track_cpu::source::{PixelFormat, RawFormat};
use track_cpu::{BBox, Cores, Isa, Model, ModelError, Precision, SearchRegion, TrackerOptions};
use weights_format::{Architecture, Calibration, Encoder, LayerKind, Range, Weights, Widths};

/// Follows one object through video on a CPU.
#[derive(Debug, Parser)]
#[command(version, about, after_help = format!("{EXAMPLES}\n\n{}", crate::exit::help()))]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

impl Args {
    /// Reads this process's command line; ends the process with help or a message where that does not parse.
    pub fn read() -> Args {
        Args::parse()
    }
}

const EXAMPLES: &str = "\
Start here:
  track-cpu doctor                                     is everything in order on this machine?
  track-cpu demo                                       a rendered flight, tracked; writes a GIF
  track-cpu track --input clip.mp4 --init 300,120,40,24 --out boxes.txt --overlay out.gif";

/// The sub-commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Follow the object inside a box through images, a video or a stream.
    Track(TrackArgs),
    /// Run live: a camera or stream in; boxes, MAVLink and a web page out.
    #[cfg(feature = "serve")]
    Serve(Box<crate::serve::args::ServeArgs>),
    /// Do a flight that `serve --log` wrote down again and compare every box.
    #[cfg(feature = "serve")]
    Replay(crate::serve::args::ReplayArgs),
    /// Render a UAV flight, track it and show the result.
    Demo(DemoArgs),
    /// Show a model's layers, shapes, parameters and multiply-accumulates.
    Info(InfoArgs),
    /// Measure speed: frames per second, latency percentiles, time per stage.
    Bench(BenchArgs),
    /// Serve the TraX protocol: evaluation toolkits such as VOT's drive the tracker.
    Trax(TraxArgs),
    /// Check this machine: CPU features, kernels against golden numbers, speed to expect.
    Doctor(DoctorArgs),
}

/// How the network is run.
#[derive(Debug, clap::Args)]
pub struct EngineArgs {
    /// Threads that work on one frame.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = threads)]
    pub threads: usize,
    /// Processor cores to hold these threads on, in turn, as in 2,3 or 4-7 [default: where the system puts them; as many threads as cores, one on each].
    #[arg(long, value_name = "CORES", value_parser = cores)]
    pub pin: Option<Cores>,
    /// Instruction set, of those that `track-cpu doctor` lists [default: the fastest].
    #[arg(long, value_name = "NAME", value_parser = isa)]
    pub isa: Option<Isa>,
    /// Arithmetic of the network: f32, or int8, integers of 8 and 16 bits, where the model is calibrated for it [default: int8 if
    /// the model allows it and the processor multiplies integers faster].
    #[arg(long, value_name = "NAME", value_parser = precision)]
    pub precision: Option<Precision>,
    /// Share of the network's error in the first frame that is taken out of all later boxes, 0 to 1; 0 is the paper's tracker
    /// [default: the model's].
    #[arg(long, value_name = "SHARE", value_parser = share)]
    pub correction: Option<f64>,
    /// Share of the target's later looks in the template, 0 to 1; 0 is the paper's tracker [default: the model's].
    #[arg(long, value_name = "SHARE", value_parser = share)]
    pub template_update: Option<f64>,
    /// Share of a filter that is learned while tracking in the score, 0 to 1; 0 is the paper's tracker [default: the model's].
    #[arg(long, value_name = "SHARE", value_parser = share)]
    pub online_filter: Option<f64>,
    /// How much of the search region is looked at.
    #[arg(long, value_name = "HOW", value_enum, default_value_t = Search::Full)]
    pub search: Search,
}

/// How much of the search region is looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum Search {
    /// All of it, in every frame.
    #[default]
    Full,
    /// Its middle, while the target is easy to follow; not in flight mode.
    Auto,
}

impl EngineArgs {
    /// The instruction set asked for, or the fastest.
    pub fn isa(&self) -> Isa {
        self.isa.unwrap_or_else(Isa::detect)
    }

    /// The model that [`Model::find`] finds, as it is to run.
    pub fn model(&self, name: Option<&Path>) -> Result<Model, ModelError> {
        self.model_of(&Model::find(name)?)
    }

    /// Weights as they are to run.
    pub fn model_of(&self, weights: &Weights) -> Result<Model, ModelError> {
        let precision = self
            .precision
            .unwrap_or_else(|| Precision::best(weights, self.isa()));
        if (self.correction, self.template_update, self.online_filter) == (None, None, None) {
            return Model::with_precision(weights, self.isa(), precision);
        }
        let mut weights = weights.clone();
        let tracker = &mut weights.header.tracker;
        tracker.correction = self.correction.unwrap_or(tracker.correction);
        tracker.template_update = self.template_update.unwrap_or(tracker.template_update);
        tracker.online_filter = self.online_filter.unwrap_or(tracker.online_filter);
        Model::with_precision(&weights, self.isa(), precision)
    }

    /// The cores to be held on.
    pub fn cores(&self) -> Cores {
        self.pin.unwrap_or_default()
    }

    /// How a tracker of the model is to run.
    pub fn options(&self, model: &Model) -> TrackerOptions {
        let search = match self.search {
            Search::Full => SearchRegion::Full,
            Search::Auto => SearchRegion::Adaptive,
        };
        TrackerOptions {
            threads: self.threads,
            cores: self.cores(),
            search,
            ..TrackerOptions::of(model)
        }
    }

    /// Random weights as they are to run; bytes only if asked for, with ranges out of the air.
    pub fn random_model(&self, mut weights: Weights) -> Result<Model, ModelError> {
        let layers = weights.header.architecture.layers().into_iter();
        let convs = layers.filter(|layer| layer.kind == LayerKind::Conv && layer.kernel > 1);
        let inputs: BTreeMap<_, _> = convs
            .map(|layer| {
                (
                    layer.name,
                    Range {
                        low: -4.0,
                        high: 4.0,
                    },
                )
            })
            .collect();
        weights.header.calibration = Some(Calibration {
            method: "none".into(),
            inputs,
        });
        Model::with_precision(
            &weights,
            self.isa(),
            self.precision.unwrap_or(Precision::F32),
        )
    }
}

/// What follows the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Mode {
    /// The tracker alone: it always finds something. With --correction 0 --template-update 0 --online-filter 0
    /// it is the one published.
    Paper,
    /// Knows when the target is lost, coasts, and finds it again.
    Flight,
}

impl Mode {
    /// As on the command line.
    #[cfg(feature = "serve")]
    pub fn name(self) -> &'static str {
        match self {
            Mode::Paper => "paper",
            Mode::Flight => "flight",
        }
    }

    /// The mode of this name.
    #[cfg(feature = "serve")]
    pub fn from_name(name: &str) -> Option<Mode> {
        [Mode::Paper, Mode::Flight]
            .into_iter()
            .find(|mode| mode.name() == name)
    }
}

/// `track`.
#[derive(Debug, clap::Args)]
#[command(after_help = TRACK_EXAMPLES)]
pub struct TrackArgs {
    /// Folder of images, 'glob*.jpg' (quoted), image, video file, URL, or - for standard input.
    #[arg(short, long, value_name = "INPUT")]
    pub input: PathBuf,
    /// The object in the first frame: left, top, width, height in pixels, 0-based.
    #[arg(long, value_name = "X,Y,W,H", value_parser = bbox, allow_hyphen_values = true)]
    pub init: BBox,
    /// Weights file, or a built-in model: drmim-p50 (the default) or drmim-p82, a sixth of its work
    #[arg(short, long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Where the boxes go, one line x,y,w,h per frame; standard output if absent.
    #[arg(short, long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Draw the boxes into pictures: a folder for JPEGs, a .gif, or a .mp4 (through ffmpeg).
    #[arg(long, value_name = "DIR|X.gif|X.mp4", value_parser = overlay)]
    pub overlay: Option<PathBuf>,
    /// Write one JSON object per frame: frame, box, score, milliseconds.
    #[arg(long)]
    pub json: bool,
    /// What follows the target; in flight mode JSON lines also hold presence (0 to 1) and state.
    #[arg(long, value_enum, default_value_t = Mode::Paper)]
    pub mode: Mode,
    /// First frame, 0-based; --init refers to it.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub start: usize,
    /// Frame to end before.
    #[arg(long, value_name = "N")]
    pub end: Option<usize>,
    /// Size of headerless frames.
    #[arg(long, value_name = "WxH", value_parser = size, requires = "pix")]
    raw: Option<(usize, usize)>,
    /// Pixel format of headerless frames: bgr24, rgb24, gray, yuv420p, nv12, yuyv422, yuv422p or yuv444p.
    #[arg(long, value_name = "FORMAT", value_parser = pixel_format, requires = "raw")]
    pix: Option<PixelFormat>,
    /// How the network is run.
    #[command(flatten)]
    pub engine: EngineArgs,
}

const TRACK_EXAMPLES: &str = "\
Examples:
  track-cpu track --input seq/img --init 300,120,40,24 > boxes.txt
  track-cpu track --input 'seq/img/*.jpg' --init 300,120,40,24 --start 100 --end 200 --json
  track-cpu track --input flight.mp4 --init 300,120,40,24 --out boxes.txt --overlay flight-tracked.mp4
  track-cpu track --input rtsp://192.168.1.10/main --init 600,300,80,60 --json | your-program
  ffmpeg -i flight.mp4 -f yuv4mpegpipe - | track-cpu track --input - --init 300,120,40,24
  rpicam-vid -t 0 --codec yuv420 --width 640 --height 480 -o - |
      track-cpu track --input - --raw 640x480 --pix yuv420p --init 300,120,40,24

Inputs:
  images (jpg, png, webp, bmp) are read in natural order: img2 comes before img10;
  videos and URLs are read by the ffmpeg on your PATH;
  standard input, named pipes and .y4m files hold y4m, PPM, or headerless frames with --raw and --pix.

One line per frame goes to standard output (or --out), the first one being the box given; progress and a summary go to
standard error. Every line is written as soon as its frame is done.";

impl TrackArgs {
    /// The headerless format, if there is one.
    pub fn raw(&self) -> Option<RawFormat> {
        let ((width, height), pixels) = self.raw.zip(self.pix)?;
        Some(RawFormat {
            width,
            height,
            pixels,
        })
    }
}

/// `demo`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  track-cpu demo --seed 3 --out my-demo

The object is shown by the flight's true box in the first frame and then never again. Mean IoU and precision (share of
frames whose center is at most 20 pixels off) are over the frames after the first in which more than 30 % of the object
is visible; FPS counts tracking only, frames divided by total time.")]
pub struct DemoArgs {
    /// Folder for demo.gif and sheet.png.
    #[arg(short, long, value_name = "DIR", default_value = "track-cpu-demo")]
    pub out: PathBuf,
    /// Which flight.
    #[arg(long, value_name = "N", default_value_t = 7)]
    pub seed: u64,
    /// How hard it is to follow: medium hides the object behind things, hard also lets it leave the view.
    #[arg(long, value_enum, default_value_t = DifficultyChoice::Easy)]
    difficulty: DifficultyChoice,
    /// Its length.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = frames)]
    pub frames: usize,
    /// Weights file, or a built-in model: drmim-p50 (the default) or drmim-p82, a sixth of its work
    #[arg(short, long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// End standard output with one JSON object: mean_iou, precision_20, fps, frames.
    #[arg(long)]
    pub json: bool,
    /// How the network is run.
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// How hard a flight is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DifficultyChoice {
    /// Calm and clear.
    Easy,
    /// Shake, look-alikes, occlusions.
    Medium,
    /// More of it, and exits from the view.
    Hard,
}

impl DemoArgs {
    /// How hard the flight is to be.
    pub fn difficulty(&self) -> Difficulty {
        match self.difficulty {
            DifficultyChoice::Easy => Difficulty::Easy,
            DifficultyChoice::Medium => Difficulty::Medium,
            DifficultyChoice::Hard => Difficulty::Hard,
        }
    }
}

/// Which network, where a random one will do.
#[derive(Debug, clap::Args)]
pub struct RandomArgs {
    /// A random network: half, full, P0 to P90 (percent pruned), C1,C2,C3,C4,C5,N, or all 13 widths.
    #[arg(long, value_name = "WIDTHS", value_parser = widths)]
    widths: Option<Widths>,
    /// Identity-related encoder of a random network.
    #[arg(long, value_enum, default_value_t = EncoderChoice::None, requires = "widths", conflicts_with = "model")]
    encoder: EncoderChoice,
}

/// The encoder of a random network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EncoderChoice {
    /// Without: the P-SiamFC++ family.
    None,
    /// One 3x3 convolution, the standard.
    #[value(name = "3x3")]
    Three,
    /// One 1x1 convolution.
    #[value(name = "1x1")]
    One,
}

impl RandomArgs {
    /// The random network asked for, if one was.
    pub fn architecture(&self) -> Result<Option<Architecture>, ModelError> {
        let Some(widths) = self.widths else {
            return Ok(None);
        };
        let standard = Encoder::standard(widths.backbone[4]);
        let encoder = match self.encoder {
            EncoderChoice::None => None,
            EncoderChoice::Three => Some(standard),
            EncoderChoice::One => Some(Encoder {
                kernel: 1,
                ..standard
            }),
        };
        let architecture = Architecture::new(widths, encoder);
        architecture.check()?;
        Ok(Some(architecture))
    }

    /// Random weights, if they were asked for.
    pub fn weights(&self) -> Result<Option<Weights>, ModelError> {
        Ok(self
            .architecture()?
            .map(|architecture| Weights::random(architecture, 1)))
    }
}

/// `info`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  track-cpu info drmim-p50
  track-cpu info weights.safetensors --json
  track-cpu info --widths P50 --encoder 3x3
  track-cpu info --widths 76,224,337,334,256,256,256,230,138,224,227,145,224     P-SiamFC++: 7,489,986 parameters

All 13 widths are conv1 to conv5, the necks (cls, reg), and the towers cls1 to cls3 and reg1 to reg3.")]
pub struct InfoArgs {
    /// Weights file, or a built-in model: drmim-p50 (the default) or drmim-p82, a sixth of its work
    #[arg(value_name = "MODEL", conflicts_with = "widths")]
    pub model: Option<PathBuf>,
    /// A network without a file.
    #[command(flatten)]
    pub random: RandomArgs,
    /// Print one JSON object in place of the tables.
    #[arg(long)]
    pub json: bool,
}

/// `bench`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  track-cpu bench
  track-cpu bench --threads 2 --json
  track-cpu bench --widths full --encoder 3x3 --isa avx2
  track-cpu bench --decode --sweep --minutes 5 --markdown
  track-cpu bench --json > before.json; ...; track-cpu bench --json > after.json
  track-cpu bench --compare before.json after.json

Frames of a rendered 1280x720 flight are prepared in memory and played back and forth; decoding is measured with --decode
only. FPS is frames divided by total time; the mean of the frames' own rates, which the got10k toolkit quotes, stands
beside it and is never lower. A comparison takes the medians of ten blocks of each run and calls a difference one if it
is above two standard deviations of these, and above 1 %. GFLOP/s counts two operations per multiply-accumulate of the plain convolutions, over the
time of the network's stages.")]
pub struct BenchArgs {
    /// Weights file, or a built-in model: drmim-p50 (the default) or drmim-p82, a sixth of its work
    #[arg(short, long, value_name = "FILE", conflicts_with = "widths")]
    pub model: Option<PathBuf>,
    /// A network without a file.
    #[command(flatten)]
    pub random: RandomArgs,
    /// Frames to measure, after a warm-up of a tenth as many.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = frames)]
    pub frames: usize,
    /// Print one JSON object in place of the tables.
    #[arg(long)]
    pub json: bool,
    /// Print Markdown in place of the tables.
    #[arg(long, conflicts_with = "json")]
    pub markdown: bool,
    /// Measure with reading and decoding of JPEG files as well.
    #[arg(long)]
    pub decode: bool,
    /// Measure with 1, 2, 4 ... threads up to the number of cores as well.
    #[arg(long)]
    pub sweep: bool,
    /// Then go on for that long and say what becomes of the speed: heat, other programs.
    #[arg(long, value_name = "M", value_parser = minutes)]
    pub minutes: Option<f64>,
    /// Measure nothing: say whether two files that --json wrote differ by more than noise.
    #[arg(long, value_names = ["BEFORE", "AFTER"], num_args = 2, conflicts_with_all = ["markdown", "worker"])]
    pub compare: Vec<PathBuf>,
    /// Algorithm of every convolution that it can compute, in f32: direct, im2col, winograd6, winograd8 or winograd10 [default: the best
    /// for each].
    #[arg(long, value_name = "NAME", value_parser = algorithm)]
    pub algorithm: Option<Algorithm>,
    /// Measure every algorithm for every convolution, on one thread, and print it beside what was planned.
    #[arg(long, conflicts_with_all = ["markdown", "decode", "sweep", "minutes", "worker", "algorithm"])]
    pub plan: bool,
    /// Time the network alone: for each line N on standard input run N passes, print N times in ms.
    #[arg(long, conflicts_with_all = ["json", "markdown", "decode", "sweep", "minutes"])]
    pub worker: bool,
    /// How the network is run.
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `trax`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example, in the trackers.ini of vot-toolkit:
  [track-cpu]
  label = track-cpu
  protocol = trax
  command = /path/to/track-cpu trax

Messages go over standard input and output, or over the local port that the environment variable TRAX_SOCKET names.
Takes rectangles, polygons and masks, and pictures as paths, in memory and encoded; answers with rectangles and the
score as `confidence`. With protocol version 4 several objects may be followed at a time.")]
pub struct TraxArgs {
    /// Weights file, or a built-in model: drmim-p50 (the default) or drmim-p82, a sixth of its work
    #[arg(short, long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Version of the protocol: 1, 3 or 4.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = trax_version)]
    pub protocol: u32,
    /// How the network is run.
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// `doctor`.
#[derive(Debug, clap::Args)]
pub struct DoctorArgs {
    /// Print one JSON object in place of text.
    #[arg(long)]
    pub json: bool,
    /// Print what the golden file of the self-test should hold for the present built-in model.
    #[arg(long, hide = true)]
    pub print_golden: bool,
}

fn trax_version(text: &str) -> Result<u32, String> {
    text.parse()
        .ok()
        .filter(|version| [1, 3, 4].contains(version))
        .ok_or_else(|| "expected 1, 3 or 4".into())
}

fn threads(text: &str) -> Result<usize, String> {
    number_in(text, 1, 256)
}

fn cores(text: &str) -> Result<Cores, String> {
    let (cores, available): (Cores, _) = (text.parse()?, Cores::available());
    let is_there = available == Cores::ANY || cores.within(available); // where the system does not tell, it decides later
    if is_there {
        Ok(cores)
    } else {
        Err(format!(
            "expected some of the cores {available}, found {cores}"
        ))
    }
}

fn share(text: &str) -> Result<f64, String> {
    let number = text
        .parse::<f64>()
        .ok()
        .filter(|share| (0.0..=1.0).contains(share));
    number.ok_or_else(|| "expected a number from 0 to 1".into())
}

fn minutes(text: &str) -> Result<f64, String> {
    let minutes = text
        .parse()
        .ok()
        .filter(|minutes| *minutes > 0.0 && *minutes <= 1440.0);
    minutes.ok_or_else(|| "expected minutes above 0, at most 1440".into())
}

fn frames(text: &str) -> Result<usize, String> {
    number_in(text, 2, 100_000)
}

fn number_in(text: &str, least: usize, most: usize) -> Result<usize, String> {
    match text.parse() {
        Ok(number) if (least..=most).contains(&number) => Ok(number),
        _ => Err(format!("expected a whole number from {least} to {most}")),
    }
}

fn precision(text: &str) -> Result<Precision, String> {
    Precision::from_name(text).ok_or_else(|| format!("expected f32 or int8, found '{text}'"))
}

fn algorithm(text: &str) -> Result<Algorithm, String> {
    let names = Algorithm::ALL.map(Algorithm::name).join(", ");
    Algorithm::from_name(text).ok_or_else(|| format!("expected one of: {names}"))
}

fn isa(text: &str) -> Result<Isa, String> {
    Isa::from_name(text).map_err(|error| error.to_string())
}

pub(crate) fn bbox(text: &str) -> Result<BBox, String> {
    let numbers: Option<Vec<f32>> = text
        .split(',')
        .map(|number| number.trim().parse().ok())
        .collect();
    match numbers.as_deref() {
        Some(&[x, y, w, h]) if BBox::new(x, y, w, h).is_finite() => Ok(BBox::new(x, y, w, h)),
        _ => Err("expected four finite numbers: left,top,width,height".into()),
    }
}

fn overlay(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let extension = path.extension().map(|e| e.to_ascii_lowercase());
    match extension.as_ref().and_then(|e| e.to_str()) {
        Some("avi" | "mov" | "mkv" | "webm" | "jpg" | "jpeg" | "png" | "webp" | "bmp")
            if !path.is_dir() =>
        {
            Err("expected a folder, a .gif or a .mp4".into())
        }
        _ => Ok(path),
    }
}

pub(crate) fn size(text: &str) -> Result<(usize, usize), String> {
    let sides = text
        .split_once(['x', 'X'])
        .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    sides.ok_or_else(|| "expected WIDTHxHEIGHT in pixels, such as 640x480".into())
}

pub(crate) fn pixel_format(text: &str) -> Result<PixelFormat, String> {
    let names = || PixelFormat::NAMES.map(|(name, _)| name).join(", ");
    PixelFormat::from_name(text).ok_or_else(|| format!("expected one of: {}", names()))
}

fn widths(text: &str) -> Result<Widths, String> {
    let pruned = text
        .strip_prefix('P')
        .and_then(|percent| percent.parse::<u8>().ok());
    let list: Option<Vec<usize>> = text.split(',').map(|number| number.parse().ok()).collect();
    let widths = match (text, pruned, list.as_deref()) {
        ("half", ..) => Widths::pruned(0.5),
        ("full", ..) => Widths::FULL,
        (_, Some(percent @ 0..=90), _) => Widths::pruned(f64::from(percent) / 100.0),
        (.., Some(&[c1, c2, c3, c4, c5, n])) => Widths::uniform([c1, c2, c3, c4, c5], n),
        (.., Some(&[c1, c2, c3, c4, c5, neck_cls, neck_reg, a, b, c, d, e, f])) => Widths {
            backbone: [c1, c2, c3, c4, c5],
            neck_cls,
            neck_reg,
            head_cls: [a, b, c],
            head_reg: [d, e, f],
        },
        _ => return Err("expected half, full, P0 to P90, 6 numbers or 13 numbers".into()),
    };
    Architecture::new(widths, None)
        .check()
        .map_err(|error| error.to_string())?;
    Ok(widths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Args::command().debug_assert();
    }

    #[test]
    fn widths_in_every_form() {
        assert_eq!(widths("half"), Ok(Widths::pruned(0.5)));
        assert_eq!(widths("P50"), Ok(Widths::pruned(0.5)));
        assert_eq!(widths("P0"), Ok(Widths::FULL));
        assert_eq!(widths("full"), Ok(Widths::FULL));
        assert_eq!(widths("48,128,192,192,128,128"), Ok(Widths::pruned(0.5)));
        let paper = widths("76,224,337,334,256,256,256,230,138,224,227,145,224").unwrap();
        assert_eq!(Architecture::new(paper, None).parameters(), 7_489_986);
        for (text, part) in [
            ("P100", "P90"),
            ("P-1", "P90"),
            ("quarter", "half"),
            ("", "half"),
            ("1,2,3", "13 numbers"),
            ("0,1,1,1,1,1", "widths[0] is 0"),
            ("1,1,1,1,1,999999", "999999"),
        ] {
            let message = widths(text).unwrap_err();
            assert!(message.contains(part), "{text}: {message}");
        }
    }

    #[test]
    fn boxes() {
        assert_eq!(bbox("1, 2.5,-3,4e1"), Ok(BBox::new(1.0, 2.5, -3.0, 40.0)));
        for text in [
            "",
            "1,2,3",
            "1,2,3,4,5",
            "1,2,3,nan",
            "1,2,inf,4",
            "a,b,c,d",
            "1;2;3;4",
        ] {
            assert!(bbox(text).is_err(), "{text}");
        }
    }

    #[test]
    fn sizes() {
        assert_eq!(size("640x360"), Ok((640, 360)));
        for text in ["640", "640x", "x360", "-1x5", "640x360x3", "axb"] {
            assert!(size(text).is_err(), "{text}");
        }
    }
}
