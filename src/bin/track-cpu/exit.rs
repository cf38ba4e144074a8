//! How the program ends: one table of exit codes, one type of failure.

use std::io::ErrorKind;
use std::path::Path;
use std::process::ExitCode;

use track_cpu::source::SourceError;
use track_cpu::{FrameError, ModelError, TrackError};

/// Every exit code with its meaning; `--help` prints this table.
const CODES: [(u8, &str); 7] = [
    (0, "done, or the reader of standard output has gone"),
    (2, "a command-line argument is wrong"),
    (INPUT, "an input cannot be read"),
    (MODEL, "a model file cannot be used"),
    (OUTPUT, "an output cannot be written"),
    (TARGET, "the tracker refuses the box"),
    (SELF_TEST, "the self-test of `doctor` failed"),
];
const INPUT: u8 = 3;
const MODEL: u8 = 4;
const OUTPUT: u8 = 5;
const TARGET: u8 = 6;
const SELF_TEST: u8 = 7;

/// The table for `--help`.
pub fn help() -> String {
    let lines: Vec<String> = CODES
        .iter()
        .map(|(code, meaning)| format!("  {code}  {meaning}"))
        .collect();
    format!("Exit codes:\n{}", lines.join("\n"))
}

/// Why the program ends early.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
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
    /// The self-test failed.
    #[error("self-test failed: {0}")]
    SelfTest(String),
    /// A rendered frame is none.
    #[error("rendered frame: {0}")]
    Rendered(#[from] FrameError),
    /// A flight log cannot be used.
    #[error("{log}: {reason}")]
    Log {
        /// Which one, and where in it.
        log: String,
        /// What was expected and found.
        reason: String,
    },
    /// Whoever read our output has gone: a quiet end.
    #[error("standard output was closed")]
    ClosedPipe,
}

impl Failure {
    /// A failure to write to `path`.
    pub fn output(path: &Path, reason: impl ToString) -> Failure {
        Failure::Output {
            output: path.display().to_string(),
            reason: reason.to_string(),
        }
    }

    /// A failure to write to standard output; that its reader has gone is none to speak of.
    pub fn stdout(error: &std::io::Error) -> Failure {
        match error.kind() {
            ErrorKind::BrokenPipe => Failure::ClosedPipe,
            _ => Failure::Output {
                output: "standard output".into(),
                reason: error.to_string(),
            },
        }
    }

    /// Says on standard error what happened and picks the exit code.
    pub fn exit(&self) -> ExitCode {
        let code = match self {
            Failure::ClosedPipe => return ExitCode::SUCCESS,
            Failure::Input(_) | Failure::Frame { .. } | Failure::Log { .. } => INPUT,
            Failure::Model(_) | Failure::Presence(_) => MODEL,
            Failure::Output { .. } => OUTPUT,
            Failure::Target(_) => TARGET,
            Failure::SelfTest(_) | Failure::Rendered(_) => SELF_TEST,
        };
        eprintln!("error: {self}");
        ExitCode::from(code)
    }
}
