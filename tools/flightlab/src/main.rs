//! `flightlab`: fits the presence coefficients of a model on rendered flights and measures flight mode on others.
//!
//! | file | what happens there |
//! |---|---|
//! | `flights.rs` | rendered flights, frame by frame, with their truth |
//! | `collect.rs` | evidence with the truth about it |
//! | `fit.rs` | logistic regression, calibration of the smoothed log-odds |
//! | `measure.rs`, `plots.rs` | ROC, calibration: figures and plots |
//! | `evaluate.rs` | flight mode as a whole: lost, found again, wrong target |
//! | `sequences.rs` | the same on real sequences |

#![forbid(unsafe_code)]

mod calibrate;
mod collect;
mod evaluate;
mod fit;
mod flights;
mod measure;
mod plots;
mod sequences;

use clap::{Args, Parser, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;
use track_cpu::flight::Presence;
use track_cpu::{Isa, Model, ModelError};

/// Fits and measures track-cpu's flight mode.
#[derive(Debug, Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Fit the presence coefficients of a model on rendered flights, and measure them on others.
    Calibrate(CalibrateArgs),
    /// Measure flight mode on rendered flights: presence, lost targets found again, wrong targets.
    Evaluate(EvaluateArgs),
    /// Compare the paper's mode and flight mode on folders of real sequences.
    Sequences(SequencesArgs),
}

/// Which flights.
#[derive(Clone, Debug, Args)]
pub struct FlightArgs {
    /// Flights, one seed each; two of three are hard ones.
    #[arg(long, default_value_t = 24)]
    pub flights: u64,
    /// Frames per flight, 30 a second.
    #[arg(long, default_value_t = 300)]
    pub frames: usize,
    /// Width of the view in pixels; its height is 9/16 of it.
    #[arg(long, default_value_t = 480)]
    pub width: usize,
    /// Share of the look-alikes that have the target's very body, 0 to 1; by its difficulty if absent: a quarter in a medium
    /// flight, more than half in a hard one.
    #[arg(long)]
    pub twins: Option<f32>,
    /// Threads, a flight each.
    #[arg(long, default_value_t = 1)]
    pub jobs: usize,
}

#[derive(Debug, Args)]
struct CalibrateArgs {
    #[command(flatten)]
    flights: FlightArgs,
    /// First seed of the flights that are fitted to.
    #[arg(long, default_value_t = 910_000)]
    seed: u64,
    /// First seed of as many flights that are only measured.
    #[arg(long, default_value_t = 920_000)]
    test_seed: u64,
    /// Weights file, or a built-in model: drmim-p50 (the default) or drmim-p82, a sixth of its work
    #[arg(long)]
    model: Option<PathBuf>,
    /// Weights file to carry the coefficients from now on, usually the same: it is rewritten with them as a note.
    #[arg(long)]
    into: Option<PathBuf>,
    /// File for the coefficients as text, such as src/flight/presence.txt.
    #[arg(long)]
    text: Option<PathBuf>,
    /// Fit only how looks for a lost target are weighed, and keep the model's other coefficients.
    #[arg(long)]
    again_only: bool,
}

#[derive(Debug, Args)]
struct EvaluateArgs {
    #[command(flatten)]
    flights: FlightArgs,
    /// First seed: not one that was fitted to.
    #[arg(long, default_value_t = 930_000)]
    seed: u64,
    /// Weights file, or a built-in model: drmim-p50 (the default) or drmim-p82, a sixth of its work
    #[arg(long)]
    model: Option<PathBuf>,
    /// Searches per frame while the target is lost.
    #[arg(long, default_value_t = 2)]
    searches: u32,
    /// Print a line per frame: visible share, IoU, presence, state, believed.
    #[arg(long)]
    trace: bool,
    /// Folder for plots of presence over all flights: flight-roc.svg, flight-presence.svg.
    #[arg(long)]
    plots: Option<PathBuf>,
    /// Leave out the paper's mode: half the time.
    #[arg(long)]
    flight_only: bool,
    /// Presence coefficients as text in place of the model's.
    #[arg(long)]
    text: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct SequencesArgs {
    /// Folder of sequences, each with img/ and groundtruth_rect.txt, one or two levels below.
    folder: PathBuf,
    /// Weights file, or a built-in model: drmim-p50 (the default) or drmim-p82, a sixth of its work
    #[arg(long)]
    model: Option<PathBuf>,
    /// Searches per frame while the target is lost.
    #[arg(long, default_value_t = 2)]
    searches: u32,
    /// Presence coefficients as text in place of the model's.
    #[arg(long)]
    text: Option<PathBuf>,
}

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// A model cannot be used.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A model's coefficients cannot be used.
    #[error(transparent)]
    Presence(#[from] track_cpu::flight::PresenceError),
    /// A weights file cannot be read.
    #[error(transparent)]
    Read(#[from] weights_format::ReadError),
    /// A weights file cannot be written.
    #[error(transparent)]
    Write(#[from] weights_format::WriteError),
    /// A file cannot be read or written.
    #[error("{0}: {1}")]
    File(PathBuf, String),
    /// There is nothing to work on.
    #[error("{0}")]
    Nothing(String),
    /// A frame or box is refused.
    #[error(transparent)]
    Track(#[from] track_cpu::TrackError),
}

/// The model of a file, or the built-in one.
fn load(path: Option<&PathBuf>) -> Result<Model, ModelError> {
    Model::from_weights(&Model::find(path.map(PathBuf::as_path))?, Isa::detect())
}

/// The presence coefficients of a text file, or the model's.
fn presence(text: Option<&PathBuf>, model: &Model) -> Result<Presence, Failure> {
    let Some(path) = text else {
        return Ok(Presence::of(model.header())?);
    };
    let text = std::fs::read_to_string(path)
        .map_err(|error| Failure::File(path.clone(), error.to_string()))?;
    Ok(Presence::parse(&text)?)
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Sequences(args) => sequences::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            ExitCode::FAILURE
        }
    }
}
