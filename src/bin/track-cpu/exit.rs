//! How the program ends: one type of failure, and its exit code.

use std::io::ErrorKind;
use std::path::Path;
use std::process::ExitCode;

use program::{Clash, Exit};
use track_cpu::source::SourceError;
use track_cpu::{FrameError, ModelError, TrackError};

/// Why the program ends early.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// A threshold of flight mode is refused.
    #[error(transparent)]
    Threshold(#[from] track_cpu::flight::ThresholdError),
    /// An input cannot be opened.
    #[error(transparent)]
    Input(#[from] SourceError),
    /// A frame cannot be read.
    #[error("frame {frame}: {error}")]
    Frame {
        /// Its index in the input.
        frame: usize,
        /// What the source said.
        error: SourceError,
    },
    /// A model cannot be used.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A model's presence coefficients cannot be used.
    #[error(transparent)]
    Presence(#[from] track_cpu::flight::PresenceError),
    /// An output cannot be written.
    #[error("{output}: {reason}")]
    Output {
        /// File or pipe.
        output: String,
        /// What the system or encoder said.
        reason: String,
    },
    /// The tracker refuses the box.
    #[error("--init: {0}")]
    Target(#[from] TrackError),
    /// A file of boxes cannot be read.
    #[error(transparent)]
    Boxes(#[from] sequences::Error),
    /// The self-test failed.
    #[error("self-test failed: {0}")]
    SelfTest(String),
    /// Frames that could not be read were held or skipped.
    #[error("{count} frames could not be read; {consequence}")]
    BadFrames {
        /// How many.
        count: usize,
        /// What stands for them in the results.
        consequence: &'static str,
    },
    /// An output would overwrite an input.
    #[error(transparent)]
    Clash(#[from] Clash),
    /// A rendered frame is invalid.
    #[error("rendered frame: {0}")]
    Rendered(#[from] FrameError),
    /// The live program cannot start, or cannot go on.
    #[cfg(feature = "serve")]
    #[error(transparent)]
    Station(#[from] station::Error),
    /// The reader of standard output has gone: a quiet end.
    #[error("standard output was closed")]
    ClosedPipe,
}

impl Failure {
    /// Makes the failure of a frame from what its source said.
    pub fn at_frame(frame: usize) -> impl FnOnce(SourceError) -> Failure {
        move |error| Failure::Frame { frame, error }
    }

    /// A failure to write to `path`.
    pub fn output(path: &Path, reason: impl ToString) -> Failure {
        Failure::Output {
            output: path.display().to_string(),
            reason: reason.to_string(),
        }
    }

    /// A failure to write to standard output. A closed pipe is not an error.
    pub fn stdout(error: &std::io::Error) -> Failure {
        match error.kind() {
            ErrorKind::BrokenPipe => Failure::ClosedPipe,
            _ => Failure::Output {
                output: "standard output".into(),
                reason: error.to_string(),
            },
        }
    }

    /// Prints the failure on standard error and returns its exit code.
    pub fn exit(&self) -> ExitCode {
        let exit = match self {
            Failure::ClosedPipe => return ExitCode::SUCCESS,
            Failure::Clash(_) | Failure::Threshold(_) => Exit::Usage,
            #[cfg(feature = "serve")]
            Failure::Station(error) => match error {
                station::Error::ClosedPipe => return ExitCode::SUCCESS,
                station::Error::Source(_) | station::Error::File { .. } => Exit::Input,
                station::Error::Output { .. } => Exit::Output,
                station::Error::Refused(_) => Exit::Target,
            },
            Failure::Input(_) | Failure::Frame { .. } | Failure::Boxes(_) => Exit::Input,
            Failure::Model(_) | Failure::Presence(_) => Exit::Model,
            Failure::Output { .. } => Exit::Output,
            Failure::Target(_) => Exit::Target,
            Failure::SelfTest(_) | Failure::Rendered(_) => Exit::Check,
            Failure::BadFrames { .. } => Exit::Frames,
        };
        exit.fail(self)
    }
}
