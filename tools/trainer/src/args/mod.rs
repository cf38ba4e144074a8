//! The command line.

mod data;
mod prune;
mod study;
mod training;

pub use data::Data;
pub use prune::Prune;
pub use study::{Ablate, Sweep, comparable};
pub use training::{Behavior, Training, passes};

use clap::{Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use trainer::Error;

/// Train, prune and export the DR-MIM tracker.
#[derive(Debug, Parser)]
#[command(version, after_help = program::exit_help())]
pub struct Args {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Train a network from random weights or from a checkpoint.
    #[command(allow_negative_numbers = true)]
    Fit(Box<Fit>),
    /// Train the runs of a list one after another, and continue those that were stopped.
    Queue(Queue),
    /// Prune a network: remove filters whose feature maps have low rank.
    #[command(allow_negative_numbers = true)]
    Prune(Box<Prune>),
    /// Prune to several ratios, train each on, and compare.
    #[command(allow_negative_numbers = true)]
    Sweep(Box<Sweep>),
    /// Train without each part of DR-MIM in turn, and compare.
    #[command(allow_negative_numbers = true)]
    Ablate(Box<Ablate>),
    /// Average networks of one shape, such as the ends of successive runs.
    Average(Average),
    /// Write a checkpoint's network as a weights file.
    Export(Export),
    /// Calibrate a weights file for int8 by measuring its activations.
    #[command(allow_negative_numbers = true)]
    Quantize(Measure),
    /// Choose the tracker's constants for a weights file: correction, template update, online
    /// filter, unstretching and voting.
    #[command(allow_negative_numbers = true)]
    Tune(Tune),
    /// Write contact sheets of sampled pairs.
    #[command(allow_negative_numbers = true)]
    Show(Show),
}

#[derive(Debug, clap::Args)]
pub struct Fit {
    #[command(flatten)]
    pub data: Data,
    /// The folder for checkpoints, log, curves and weights.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Continue the run of this checkpoint, with its data and training options.
    #[arg(long, value_name = "CKPT", conflicts_with_all = ["data", "init"])]
    pub resume: Option<PathBuf>,
    /// Remove the results of an earlier run from the folder; without this option, a folder with
    /// results is refused.
    #[arg(long, conflicts_with = "resume")]
    pub overwrite: bool,
    /// Start from the parameters of this file: a checkpoint, a weights file, or a file of
    /// `convert --to trainer`. Widths and encoder are those of the file unless --ratio is given;
    /// parameters that do not fit are initialized.
    #[arg(long, value_name = "FILE")]
    pub init: Option<PathBuf>,
    #[command(flatten)]
    pub training: Training,
    #[command(flatten)]
    pub behavior: Behavior,
    /// Minutes of training between validations.
    #[arg(long, default_value_t = 30.0, help_heading = "Run")]
    pub validate_minutes: f64,
}

#[derive(Debug, clap::Args)]
pub struct Queue {
    /// The list: a line per run with its name and options of `train fit`; `#` begins a comment, and
    /// @NAME stands for the end of an earlier run. Lines that are added later are read after the
    /// present run.
    pub list: PathBuf,
    /// The folder in which each run has a folder of its name.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Only print what each run has done.
    #[arg(long)]
    pub status: bool,
}

#[derive(Debug, clap::Args)]
pub struct Average {
    /// The networks: checkpoints, weights files, or files of `convert --to trainer`.
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    pub networks: Vec<PathBuf>,
    /// The checkpoint to write; replaced if it exists.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
}

#[derive(Debug, clap::Args)]
pub struct Export {
    /// The checkpoint.
    pub checkpoint: PathBuf,
    /// The weights file to write; replaced if it exists.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Type of the weights in the file (biases are always f32).
    #[arg(long, value_enum, default_value_t = Dtype::F16)]
    pub dtype: Dtype,
    /// Name of the model.
    #[arg(long, default_value = "drmim")]
    pub name: String,
    /// Folders of sequences whose accuracy goes into the file.
    #[arg(long, value_name = "DIR")]
    pub validate: Vec<PathBuf>,
    /// Four passes over each sequence: from its first and middle frame forwards, from its last and
    /// middle frame backwards.
    #[arg(long)]
    pub four_starts: bool,
    /// Most frames of each pass to track.
    #[arg(long, default_value_t = 100_000)]
    pub validate_frames: usize,
}

/// Type of the weights in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Dtype {
    /// Half precision: half the size, a relative error of about 0.0002.
    F16,
    /// Single precision.
    F32,
}

#[derive(Debug, clap::Args)]
pub struct Measure {
    /// The weights file.
    pub weights: PathBuf,
    /// The weights file to write, with the measured values; replaced if it exists.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Pairs to measure on.
    #[arg(long, default_value_t = 200)]
    pub pairs: u64,
    /// Rendered flights unless --data is given.
    #[command(flatten)]
    pub data: Data,
}

#[derive(Debug, clap::Args)]
pub struct Tune {
    #[command(flatten)]
    pub measure: Measure,
    /// A folder of sequences on which the shares of template update and online filter are chosen;
    /// may be given several times. Without it they stay as they are. Rendered flights are
    /// unsuitable: a rendered target always looks the same.
    #[arg(long, value_name = "DIR")]
    pub validate: Vec<PathBuf>,
    /// Four passes over each sequence: from its first and middle frame forwards, from its last and
    /// middle frame backwards.
    #[arg(long)]
    pub four_starts: bool,
}

#[derive(Debug, clap::Args)]
pub struct Show {
    #[command(flatten)]
    pub data: Data,
    /// The folder to write to.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Side of the search crops.
    #[arg(long, default_value_t = 303,
        value_parser = clap::value_parser!(u16).range(64..=1024))]
    pub search_size: u16,
    /// How many sheets, of 24 pairs each.
    #[arg(long, default_value_t = 1)]
    pub sheets: usize,
    /// Number of the first sample.
    #[arg(long, default_value_t = 0)]
    pub first: u64,
}

pub fn wrong(option: &str, expected: &str, found: &dyn ToString) -> Error {
    Error::Option {
        option: option.into(),
        expected: expected.into(),
        found: found.to_string(),
    }
}
