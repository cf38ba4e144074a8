//! `flightlab`: fits the presence coefficients of a model, and measures flight mode on other clips.
//!
//! | file | contents |
//! |---|---|
//! | `clips.rs` | rendered flights and real footage, frame by frame, with their truth |
//! | `panning.rs` | a virtual camera over real footage: absences with exact truth |
//! | `collect.rs` | evidence with the truth about it |
//! | `calibrate.rs`, `fit.rs` | `calibrate`: logistic regression, smoothing, cross-validation |
//! | `evaluate.rs` | `evaluate`: losses, returns, wrong targets |
//! | `compare.rs`, `losses.rs` | `sequences`: plain and flight mode on real footage; a page of losses |
//! | `measure.rs`, `plots.rs` | ROC and reliability: figures and plots |
//! | `chance.rs` | random numbers |

#![forbid(unsafe_code)]

mod calibrate;
mod chance;
mod clips;
mod collect;
mod compare;
mod evaluate;
mod fit;
mod losses;
mod measure;
mod panning;
mod plots;

use clap::{Args, Parser, Subcommand};
use program::{Exit, NewFile, check_outputs};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use track_cpu::flight::Presence;
use track_cpu::{Isa, Model, ModelError};

/// Fits and measures track-cpu's flight mode.
#[derive(Debug, Parser)]
#[command(version, about, after_help = program::exit_help())]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Fit the presence coefficients of a model on clips; measured by cross-validation.
    Calibrate(CalibrateArgs),
    /// Measure flight mode on clips with absences: presence, returns, wrong targets.
    Evaluate(EvaluateArgs),
    /// Compare plain and flight mode on real sequences, frame by frame.
    Sequences(SequencesArgs),
}

/// Which rendered flights.
#[derive(Clone, Debug, Args)]
pub struct FlightArgs {
    /// Rendered flights, one seed each; two of three are hard ones. 0 for none.
    #[arg(long, default_value_t = 24)]
    pub flights: u64,
    /// Frames per flight, 30 a second.
    #[arg(long, default_value_t = 300)]
    pub frames: usize,
    /// Width of the view in pixels; its height is 9/16 of it.
    #[arg(long, default_value_t = 480)]
    pub width: usize,
    /// Share of the look-alikes that have the target's very body, 0 to 1 [default: by difficulty, a
    /// quarter in a medium flight, more than half in a hard one].
    #[arg(long)]
    pub twins: Option<f32>,
}

/// Which real footage.
#[derive(Clone, Debug, Args)]
pub struct FootageArgs {
    /// Folder of real sequences, each with its pictures and groundtruth*.txt, at any depth.
    #[arg(long)]
    pub sequences: Option<PathBuf>,
    /// Only the sequences of these names.
    #[arg(long, num_args = 1.., requires = "sequences")]
    pub only: Vec<String>,
    /// Passes of a virtual camera over each sequence, in which the target leaves the view and is
    /// occluded; a seed each.
    #[arg(
        long = "virtual",
        default_value_t = 0,
        requires = "sequences",
        value_name = "SEEDS"
    )]
    pub panning: u64,
    /// First seed of the virtual camera.
    #[arg(long, default_value_t = 1, value_name = "SEED")]
    pub virtual_from: u64,
    /// With --virtual: the sequences as they are, too.
    #[arg(long)]
    pub plain_too: bool,
    /// With --virtual: folder of pictures, parts of which occlude the target.
    #[arg(long)]
    pub stills: Option<PathBuf>,
    /// Four passes over each sequence as it is: from both ends, and from the middle both ways.
    #[arg(long)]
    pub four_starts: bool,
}

#[derive(Debug, Args)]
struct CalibrateArgs {
    #[command(flatten)]
    flights: FlightArgs,
    #[command(flatten)]
    footage: FootageArgs,
    /// First seed of the flights that are fitted to.
    #[arg(long, default_value_t = 910_000)]
    seed: u64,
    /// Weights file, or the name of a built-in model.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Weights file to carry the coefficients from now on, usually the same: it is rewritten with
    /// them as a note.
    #[arg(long)]
    into: Option<PathBuf>,
    /// File for the coefficients as text, such as src/flight/presence.txt.
    #[arg(long)]
    text: Option<PathBuf>,
    /// Fit only how looks for a lost target are weighed, and keep the model's other coefficients.
    #[arg(long)]
    again_only: bool,
    /// File for all looks as a table: clip, kind, truth, evidence.
    #[arg(long)]
    dump: Option<PathBuf>,
    /// Threads, a clip each.
    #[arg(long, default_value_t = 1)]
    jobs: usize,
}

#[derive(Debug, Args)]
struct EvaluateArgs {
    #[command(flatten)]
    flights: FlightArgs,
    #[command(flatten)]
    footage: FootageArgs,
    /// First seed of the flights: not one that was fitted to.
    #[arg(long, default_value_t = 930_000)]
    seed: u64,
    /// Weights file, or the name of a built-in model.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Searches per frame while the target is lost.
    #[arg(long, default_value_t = 2)]
    searches: u32,
    /// Print a line per frame: visible share, IoU, presence, state; where a visible target is
    /// missed, also how far away it is, and what a look at its true place shows: IoU and log-odds.
    #[arg(long)]
    trace: bool,
    /// Folder for plots of presence over all clips: flight-roc.svg, flight-presence.svg.
    #[arg(long)]
    plots: Option<PathBuf>,
    /// Leave out the plain mode: half the time.
    #[arg(long)]
    flight_only: bool,
    /// Presence coefficients as text in place of the model's.
    #[arg(long)]
    text: Option<PathBuf>,
    /// Threads, a clip each.
    #[arg(long, default_value_t = 1)]
    jobs: usize,
}

#[derive(Debug, Args)]
struct SequencesArgs {
    /// Folder of sequences, each with its pictures and groundtruth*.txt, at any depth.
    folder: PathBuf,
    /// Weights file, or the name of a built-in model.
    #[arg(long)]
    model: Option<PathBuf>,
    /// Searches per frame while the target is lost.
    #[arg(long, default_value_t = 2)]
    searches: u32,
    /// Presence coefficients as text in place of the model's.
    #[arg(long)]
    text: Option<PathBuf>,
    /// Only these sequences.
    #[arg(long, num_args = 1..)]
    only: Vec<String>,
    /// Four passes over each sequence: from both ends, and from the middle both ways.
    #[arg(long)]
    four_starts: bool,
    /// Threads, a pass each.
    #[arg(long, default_value_t = 1)]
    jobs: usize,
    /// Folder for a text per pass with a line per frame.
    #[arg(long)]
    traces: Option<PathBuf>,
    /// Folder for a page of flight mode's losses, index.html, with a contact sheet each.
    #[arg(long)]
    losses: Option<PathBuf>,
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
    /// A file of coefficients cannot be used.
    #[error("{0}: {1}")]
    Coefficients(PathBuf, track_cpu::flight::PresenceError),
    /// A weights file cannot be read.
    #[error(transparent)]
    Read(#[from] weights_format::ReadError),
    /// A weights file cannot be written.
    #[error(transparent)]
    Write(#[from] weights_format::WriteError),
    /// A file cannot be read or written.
    #[error("{0}: {1}")]
    File(PathBuf, String),
    /// An output cannot be written.
    #[error("{0}: {1}")]
    Unwritable(PathBuf, String),
    /// An output would overwrite an input.
    #[error(transparent)]
    Clash(#[from] program::Clash),
    /// A contact sheet cannot be made.
    #[error(transparent)]
    Sheet(#[from] ope::Error),
    /// There is nothing to work on.
    #[error("{0}")]
    Nothing(String),
    /// A benchmark cannot be read.
    #[error(transparent)]
    Sequences(#[from] sequences::Error),
    /// A frame or box is refused.
    #[error(transparent)]
    Track(#[from] track_cpu::TrackError),
}

impl Failure {
    /// The exit code of the failure.
    fn exit(&self) -> Exit {
        match self {
            Failure::Model(_)
            | Failure::Presence(_)
            | Failure::Coefficients(..)
            | Failure::Read(_) => Exit::Model,
            Failure::Write(_) | Failure::Unwritable(..) => Exit::Output,
            Failure::Clash(_) => Exit::Usage,
            Failure::Sheet(_) | Failure::Sequences(_) | Failure::File(..) | Failure::Nothing(_) => {
                Exit::Input
            }
            Failure::Track(_) => Exit::Target,
        }
    }
}

/// The model of a file, or the built-in one.
fn load(path: Option<&PathBuf>) -> Result<Model, ModelError> {
    Model::from_weights(&Model::find(path.map(PathBuf::as_path))?, Isa::detect())
}

/// Refuses outputs that would overwrite an input.
fn spare(
    outputs: &[(&'static str, Option<&PathBuf>)],
    inputs: &[Option<&PathBuf>],
) -> Result<(), Failure> {
    let outputs: Vec<(&str, &Path)> = outputs
        .iter()
        .filter_map(|(option, path)| Some((*option, path.as_ref()?.as_path())))
        .collect();
    let inputs: Vec<&Path> = inputs
        .iter()
        .filter_map(|path| Some(path.as_ref()?.as_path()))
        .collect();
    Ok(check_outputs(&outputs, &inputs)?)
}

/// Writes a text, whole or not at all.
fn write_text(path: &Path, text: &str) -> Result<(), Failure> {
    NewFile::write(path, text.as_bytes())
        .map_err(|error| Failure::Unwritable(path.into(), error.to_string()))
}

/// The presence coefficients of a text file, or the model's.
fn presence(text: Option<&PathBuf>, model: &Model) -> Result<Presence, Failure> {
    let Some(path) = text else {
        return Ok(Presence::of(model.header())?);
    };
    let text = std::fs::read_to_string(path)
        .map_err(|error| Failure::File(path.clone(), error.to_string()))?;
    Presence::parse(&text).map_err(|error| Failure::Coefficients(path.clone(), error))
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Calibrate(args) => calibrate::run(&args),
        Command::Evaluate(args) => evaluate::run(&args),
        Command::Sequences(args) => compare::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.exit().fail(failure),
    }
}
