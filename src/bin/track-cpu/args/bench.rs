//! The command line of `bench` and its sub-commands.

use std::path::PathBuf;

use clap::Subcommand;
use kernels::conv::Algorithm;

use super::random::RandomArgs;
use super::values::{algorithm, frames, minutes};
use super::{EngineArgs, ModelArg};

/// `bench`.
#[derive(Debug, clap::Args)]
#[command(
    args_conflicts_with_subcommands = true,
    after_help = "\
Examples:
  track-cpu bench
  track-cpu bench --threads 2 --json
  track-cpu bench --widths full --encoder 3x3 --isa avx2
  track-cpu bench --decode --sweep --minutes 5 --markdown
  track-cpu bench plan
  track-cpu bench --json > before.json; ...; track-cpu bench --json > after.json
  track-cpu bench compare before.json after.json

Frames of a rendered 1280x720 flight are prepared in memory and played back and forth; only --decode
measures decoding. FPS is frames divided by total time. The mean of the frames' own rates, which the
got10k toolkit quotes, stands beside it and is never lower. GFLOP/s counts two operations per
multiply-accumulate of the plain convolutions, over the time of the network's stages."
)]
pub struct BenchArgs {
    /// What to do in place of the measurement.
    #[command(subcommand)]
    pub command: Option<BenchCommand>,
    /// The measurement.
    #[command(flatten)]
    pub measure: MeasureArgs,
}

/// The sub-commands of `bench`.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Time every algorithm for every convolution on one thread, beside the one that is planned.
    Plan(PlanArgs),
    /// Say whether two files that `bench --json` wrote differ by more than noise.
    Compare(CompareArgs),
    /// Time the network alone: for each line N on standard input run N passes, print N times in ms.
    #[command(hide = true)]
    Worker(NetworkArgs),
}

/// The network that is timed.
#[derive(Debug, clap::Args)]
pub struct NetworkArgs {
    /// Which model.
    #[command(flatten)]
    pub model: ModelArg,
    /// A network without a file.
    #[command(flatten)]
    pub random: RandomArgs,
    /// How the network runs.
    #[command(flatten)]
    pub engine: EngineArgs,
}

/// A measurement of the whole tracker.
#[derive(Debug, clap::Args)]
pub struct MeasureArgs {
    /// The network.
    #[command(flatten)]
    pub network: NetworkArgs,
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
    /// Go on for M minutes and report how the speed changes: heat, other programs.
    #[arg(long, value_name = "M", value_parser = minutes)]
    pub minutes: Option<f64>,
    /// Algorithm of every convolution that it can compute, in f32: direct, im2col, winograd6,
    /// winograd8 or winograd10 [default: the best for each].
    #[arg(long, value_name = "NAME", value_parser = algorithm)]
    pub algorithm: Option<Algorithm>,
}

/// `bench plan`.
#[derive(Debug, clap::Args)]
pub struct PlanArgs {
    /// The network.
    #[command(flatten)]
    pub network: NetworkArgs,
    /// Print one JSON object in place of the table.
    #[arg(long)]
    pub json: bool,
}

/// `bench compare`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Each run's frames form ten blocks. The medians of these blocks are compared: the runs differ if the
change is above two standard deviations of the block medians, and above 1 %.")]
pub struct CompareArgs {
    /// The first measurement.
    #[arg(value_name = "BEFORE")]
    pub before: PathBuf,
    /// The second measurement.
    #[arg(value_name = "AFTER")]
    pub after: PathBuf,
    /// Print one JSON object in place of the table.
    #[arg(long)]
    pub json: bool,
}
