//! The command line: clap structs, nothing else.

use clap::{Parser, Subcommand, ValueEnum};
use ope::run::Program;
use scenes::Difficulty;
use sequences::Dataset;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;
use track_cpu::source::OnBadFrame;

/// One-pass evaluation of trackers: run, score, compare.
#[derive(Debug, Parser)]
#[command(version, about, after_help = format!("{EXAMPLES}\n\n{}", program::exit_help()))]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

impl Args {
    /// Reads this process's command line. If it asks for help or does not parse, prints the help or
    /// a message and ends the process.
    pub fn read() -> Args {
        Args::parse()
    }
}

const EXAMPLES: &str = "\
Examples:
  ope run --dataset dtb70 --root DTB70 --out results
  ope run --dataset uavdt --root UAVDT --out results --tracker 'python3 kcf.py {frames} {init}'
  ope run --dataset uav123 --root UAV123 --out results --tracker 'trax:python3 nano.py'
  ope step --dataset folder --root my_videos
  ope score --dataset dtb70 --root DTB70 --results results/DTB70/track-cpu
  ope score --annotations DTB70/anno --results results/DTB70/mine --convention otb --json
  ope compare --dataset dtb70 --root DTB70 --out plots results/DTB70/track-cpu results/DTB70/kcf
  ope diagnose --dataset dtb70 --root DTB70 --out sheets results/DTB70/track-cpu results/DTB70/kcf
  ope report --dataset dtb70 --root DTB70 --out page.html results/DTB70/track-cpu results/DTB70/kcf
  ope render --out flights --count 3 && ope run --dataset folder --root flights --out results
  ope export --to pysot --dataset dtb70 --results results/DTB70/track-cpu --out exported";

/// The sub-commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run a tracker over a benchmark: this repository's, or another program. Continues an
    /// interrupted run.
    Run(RunArgs),
    /// Put this repository's tracker near the target in every frame, and count how often it finds
    /// it.
    Step(StepArgs),
    /// Merge the results of several shards into one folder.
    Merge(MergeArgs),
    /// Score a folder of results against annotations.
    Score(ScoreArgs),
    /// Compare several trackers: tables, plots as SVG.
    Compare(CompareArgs),
    /// Diagnose boxes: whether they follow the target's shape, and why a target was lost.
    Diagnose(DiagnoseArgs),
    /// Write a comparison as one HTML page with plots, sortable tables and frames of the worst
    /// failures.
    Report(ReportArgs),
    /// Write results in another toolkit's layout.
    Export(ExportArgs),
    /// Write rendered flights as a benchmark on disk: --dataset folder reads it, and so does the
    /// VOT toolkit.
    Render(RenderArgs),
}

/// `run`.
#[derive(Debug, clap::Args)]
#[command(after_help = RUN_HELP)]
pub struct RunArgs {
    /// The benchmark: uav123, uav123@10fps, uav20l, dtb70, uavdt, visdrone, otb100, got10k, lasot,
    /// or folder for any folder of sequences.
    #[arg(short, long, value_name = "NAME", value_parser = Dataset::from_str)]
    pub dataset: Dataset,
    /// The folder it lies in.
    #[arg(long, value_name = "DIR")]
    pub root: PathBuf,
    /// Four passes over each sequence: from its first and middle frame forwards, from its last and
    /// middle frame backwards.
    #[arg(long)]
    pub four_starts: bool,
    /// Where results go: <DIR>/<benchmark>/<name>/<sequence>.txt, times/<sequence>_time.txt beside
    /// them.
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    /// Another tracker, by its command line or through the TraX protocol; this repository's tracker
    /// if absent.
    #[arg(short, long, value_name = "COMMAND|trax:COMMAND", value_parser = Program::parse)]
    pub tracker: Option<Program>,
    /// How long another tracker may take for a frame; by command line, for each of a sequence's
    /// frames [default: 60].
    #[arg(long, value_name = "SECONDS", value_parser = seconds, requires = "tracker")]
    pub timeout: Option<Duration>,
    /// Weights file, or a built-in model: drmim-p50 (default), or drmim-p75, which computes less
    /// than a third as much.
    #[arg(short, long, value_name = "FILE", conflicts_with = "tracker")]
    pub model: Option<PathBuf>,
    /// The tracker's name [default: track-cpu, or the program's name].
    #[arg(short, long)]
    pub name: Option<String>,
    /// Sequences that run at a time [default: one per core]. Times are worth quoting with 1 only.
    #[arg(short, long, value_name = "N")]
    pub jobs: Option<std::num::NonZeroUsize>,
    /// Run every n-th sequence from the i-th on, for a job array. Shards may share the folder, and
    /// run at the same time; `ope merge` makes one of separate folders.
    #[arg(long, value_name = "i/n", default_value = "1/1")]
    pub shard: ope::run::Shard,
    /// At a picture that this tracker cannot read: hold the last box, or stop and leave the
    /// sequence out. Held frames are named and counted, and the exit code is 8.
    #[arg(long, value_name = "HOW", default_value = "hold", value_parser = on_bad_frame)]
    pub on_bad_frame: OnBadFrame,
}

/// The policies that keep a box per frame.
fn on_bad_frame(text: &str) -> Result<OnBadFrame, String> {
    OnBadFrame::from_name(text)
        .filter(|policy| *policy != OnBadFrame::Skip)
        .ok_or_else(|| "expected hold or stop".into())
}

const RUN_HELP: &str = "\
A tracker's command line may name
  {frames}  a text file with the path of each frame, a line each
  {folder}  the folder of the first frame
  {init}    the first frame's box: x,y,w,h
  {out}     the file to write the boxes to, x,y,w,h a line; standard output is read without it
  {times}   the file to write the seconds of each frame to, if it can
and runs once per sequence, without a shell. After `trax:` it is a program that speaks the TraX
protocol, version 1 to 4, and takes pictures by path. It is started once per sequence, and its times
include its reading of the pictures.";

/// `step`.
#[derive(Debug, clap::Args)]
pub struct StepArgs {
    /// The benchmark, as in `ope run`.
    #[arg(short, long, value_name = "NAME", value_parser = Dataset::from_str)]
    pub dataset: Dataset,
    /// The folder it lies in.
    #[arg(long, value_name = "DIR")]
    pub root: PathBuf,
    /// Weights file, or a built-in model: drmim-p50 (default), or drmim-p75, which computes less
    /// than a third as much.
    #[arg(short, long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

/// `merge`.
#[derive(Debug, clap::Args)]
pub struct MergeArgs {
    /// Folders of results of one tracker on one benchmark.
    #[arg(required = true, value_name = "DIR")]
    pub parts: Vec<PathBuf>,
    /// The folder to make of them.
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
}

/// Where the annotations are.
#[derive(Debug, clap::Args)]
#[group(required = true, multiple = true)]
pub struct TruthArgs {
    /// Folder of annotations: <sequence>.txt, <sequence>_gt.txt or <sequence>/groundtruth*.txt.
    #[arg(short, long, value_name = "DIR", conflicts_with_all = ["dataset", "root"])]
    pub annotations: Option<PathBuf>,
    /// The benchmark, in place of --annotations.
    #[arg(short, long, value_name = "NAME", value_parser = Dataset::from_str, requires = "root")]
    pub dataset: Option<Dataset>,
    /// The folder that the benchmark lies in.
    #[arg(long, value_name = "DIR", requires = "dataset")]
    pub root: Option<PathBuf>,
    /// The four passes of `ope run --four-starts` over each sequence.
    #[arg(long)]
    pub four_starts: bool,
}

/// `score`.
#[derive(Debug, clap::Args)]
pub struct ScoreArgs {
    /// Where the annotations are.
    #[command(flatten)]
    pub truth: TruthArgs,
    /// Folder of results: <sequence>.txt or <sequence>/<sequence>_001.txt, times in
    /// times/<sequence>_time.txt.
    #[arg(short, long, value_name = "DIR")]
    pub results: PathBuf,
    /// The rule by which frames are counted.
    #[arg(short, long, value_enum, default_value_t = Rule::All)]
    pub convention: Rule,
    /// Write JSON: percent, under --convention all an object per rule.
    #[arg(long)]
    pub json: bool,
    /// Leave out sequences that have no results, instead of refusing.
    #[arg(long)]
    pub partial: bool,
    /// Show every sequence.
    #[arg(long)]
    pub per_sequence: bool,
}

/// The trackers to compare, and the annotations to compare them on.
#[derive(Debug, clap::Args)]
pub struct TrackersArgs {
    /// Where the annotations are.
    #[command(flatten)]
    pub truth: TruthArgs,
    /// A folder of results per tracker; the others are compared with the first.
    #[arg(required = true, value_name = "DIR")]
    pub results: Vec<PathBuf>,
    /// The trackers' names, in their order [default: the folders' names].
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    pub names: Vec<String>,
    /// The rule by which frames are counted.
    #[arg(short, long, value_enum, default_value_t = OneRule::Got10k)]
    pub convention: OneRule,
    /// Leave out sequences that some tracker has no results of, instead of refusing.
    #[arg(long)]
    pub partial: bool,
}

/// `compare`.
#[derive(Debug, clap::Args)]
pub struct CompareArgs {
    /// The trackers to compare.
    #[command(flatten)]
    pub trackers: TrackersArgs,
    /// Folder for the plots: precision.svg, success.svg, speed.svg and attributes.svg where there
    /// are such data.
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

/// `diagnose`.
#[derive(Debug, clap::Args)]
#[command(after_help = DIAGNOSE_HELP)]
pub struct DiagnoseArgs {
    /// The trackers to diagnose.
    #[command(flatten)]
    pub trackers: TrackersArgs,
    /// Folder for a contact sheet per loss, <tracker>/<pass>-<frame>.png; needs --dataset and
    /// --root.
    #[arg(short, long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

const DIAGNOSE_HELP: &str = "\
Shape is measured in the visible frames in which every tracker overlaps the target by at least 0.2,
the first of each pass excluded. With a box of w x h and the first frame's w0 x h0,
  aspect  ln(w / h) - ln(w0 / h0)
  size    ln(sqrt(w h)) - ln(sqrt(w0 h0))
  slope   of the box's changes over the target's, through the origin: 1 follows, 0 stays as it was
  RMSE    of the difference between the two
A loss is five visible frames in a row with an overlap below 0.1; it ends at an overlap of 0.2.";

/// `report`.
#[derive(Debug, clap::Args)]
pub struct ReportArgs {
    /// The trackers to compare.
    #[command(flatten)]
    pub trackers: TrackersArgs,
    /// The page; its name ends in .html.
    #[arg(short, long, value_name = "FILE", default_value = "report.html", value_parser = page)]
    pub out: PathBuf,
    /// Its heading.
    #[arg(long, default_value = "Tracking, one pass")]
    pub title: String,
    /// Failures to show frames of, which needs --dataset and --root.
    #[arg(long, value_name = "N", default_value_t = 6)]
    pub failures: usize,
}

/// `export`.
#[derive(Debug, clap::Args)]
pub struct ExportArgs {
    /// Folder of results.
    #[arg(short, long, value_name = "DIR")]
    pub results: PathBuf,
    /// The layout.
    #[arg(long, value_enum)]
    pub to: Toolkit,
    /// The benchmark that the results are of.
    #[arg(short, long, value_name = "NAME", value_parser = Dataset::from_str)]
    pub dataset: Dataset,
    /// The tracker's name [default: the folder's name].
    #[arg(short, long)]
    pub name: Option<String>,
    /// Where to write.
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
}

/// A toolkit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Toolkit {
    /// results/<benchmark>/<tracker>/<sequence>.txt with times.
    Got10k,
    /// <tracker>/<sequence>.txt.
    Pysot,
    /// tracking_results/<tracker>/default_000/<sequence>.txt, tabs, with times.
    Pytracking,
    /// <sequence>.txt.
    Visdrone,
}

impl Toolkit {
    /// The layout that the option stands for.
    pub fn layout(self) -> ope::export::Layout {
        match self {
            Toolkit::Got10k => ope::export::Layout::Got10k,
            Toolkit::Pysot => ope::export::Layout::Pysot,
            Toolkit::Pytracking => ope::export::Layout::Pytracking,
            Toolkit::Visdrone => ope::export::Layout::Visdrone,
        }
    }
}

/// One rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OneRule {
    /// got10k toolkit.
    Got10k,
    /// pysot.
    Pysot,
    /// Matlab code of OTB and UAV123.
    Otb,
    /// As got10k, and annotations without area do not count either.
    Drop,
}

impl OneRule {
    /// The rule that the option stands for.
    pub fn convention(self) -> sequences::Convention {
        match self {
            OneRule::Got10k => sequences::Convention::Got10k,
            OneRule::Pysot => sequences::Convention::Pysot,
            OneRule::Otb => sequences::Convention::Otb,
            OneRule::Drop => sequences::Convention::Drop,
        }
    }
}

/// A rule, or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Rule {
    /// got10k toolkit: annotations with NaN do not count.
    Got10k,
    /// pysot: every frame counts.
    Pysot,
    /// Matlab code of OTB and UAV123: every frame counts, unusable results are the previous
    /// frame's.
    Otb,
    /// As got10k, and annotations without area do not count either.
    Drop,
    /// All of them, side by side.
    All,
}

impl Rule {
    /// The rules that the option stands for.
    pub fn conventions(self) -> &'static [sequences::Convention] {
        match self {
            Rule::Got10k => &[sequences::Convention::Got10k],
            Rule::Pysot => &[sequences::Convention::Pysot],
            Rule::Otb => &[sequences::Convention::Otb],
            Rule::Drop => &[sequences::Convention::Drop],
            Rule::All => &sequences::Convention::ALL,
        }
    }
}

/// `render`.
#[derive(Debug, clap::Args)]
pub struct RenderArgs {
    /// Where to write: a folder per flight with color/, groundtruth.txt and the files that the VOT
    /// toolkit needs.
    #[arg(short, long, value_name = "DIR")]
    pub out: PathBuf,
    /// Seed of the first flight; the others have the next ones.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// How many flights.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = up_to::<10_000>)]
    pub count: usize,
    /// Frames in each.
    #[arg(long, value_name = "N", default_value_t = 150, value_parser = up_to::<100_000>)]
    pub frames: usize,
    /// Width and height in pixels, at most 4096.
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = size)]
    pub size: (usize, usize),
    /// How hard they are to follow: easy, medium or hard.
    #[arg(long, value_name = "LEVEL", default_value_t = Difficulty::Easy)]
    pub difficulty: Difficulty,
}

/// The page's path. The required ending keeps it from replacing an annotation or a picture.
fn page(text: &str) -> Result<PathBuf, String> {
    if text.ends_with(".html") {
        Ok(text.into())
    } else {
        Err("expected a file name that ends in .html".into())
    }
}

fn up_to<const MOST: usize>(text: &str) -> Result<usize, String> {
    let number = text.parse().ok().filter(|n| (1..=MOST).contains(n));
    number.ok_or_else(|| format!("expected a whole number from 1 to {MOST}"))
}

fn size(text: &str) -> Result<(usize, usize), String> {
    let side = |text: &str| text.parse().ok().filter(|side| (32..=4096).contains(side));
    let sides = text
        .split_once('x')
        .and_then(|(w, h)| Some((side(w)?, side(h)?)));
    sides.ok_or_else(|| "expected WIDTHxHEIGHT, each from 32 to 4096 pixels".into())
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text
        .parse()
        .ok()
        .filter(|seconds| *seconds > 0.0 && *seconds <= 1e6);
    seconds
        .map(Duration::from_secs_f64)
        .ok_or_else(|| "expected seconds above 0".into())
}
