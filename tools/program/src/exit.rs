//! The one table of exit codes.

use std::fmt::Display;
use std::process::ExitCode;

/// Why a program ends with a code other than 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exit {
    /// A command-line argument is wrong, or an output would destroy an input.
    Usage,
    /// An input cannot be read, or ends too early.
    Input,
    /// A model, a checkpoint or training data cannot be used.
    Model,
    /// An output cannot be written.
    Output,
    /// The tracker refuses the box.
    Target,
    /// A check failed.
    Check,
    /// The run is complete, but some frames could not be read.
    Frames,
}

impl Exit {
    const ALL: [Exit; 7] = [
        Exit::Usage,
        Exit::Input,
        Exit::Model,
        Exit::Output,
        Exit::Target,
        Exit::Check,
        Exit::Frames,
    ];

    /// The code that the process ends with.
    pub const fn code(self) -> u8 {
        match self {
            Exit::Usage => 2, // what clap uses as well
            Exit::Input => 3,
            Exit::Model => 4,
            Exit::Output => 5,
            Exit::Target => 6,
            Exit::Check => 7,
            Exit::Frames => 8,
        }
    }

    /// What the code means, for `--help`.
    pub const fn meaning(self) -> &'static str {
        match self {
            Exit::Usage => "an argument is wrong, or an output would overwrite an input",
            Exit::Input => "an input cannot be read, or ends early",
            Exit::Model => "a model, a checkpoint or training data cannot be used",
            Exit::Output => "an output cannot be written",
            Exit::Target => "the tracker refuses the box",
            Exit::Check => "a check failed: the self-test of `doctor`, or a replay that differs",
            Exit::Frames => "done, but frames that cannot be read were held or skipped",
        }
    }

    /// Prints `error: ...` on standard error and returns the code.
    pub fn fail(self, error: impl Display) -> ExitCode {
        eprintln!("error: {error}");
        self.into()
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> ExitCode {
        ExitCode::from(exit.code())
    }
}

/// The table of exit codes for `--help`.
pub fn exit_help() -> String {
    let mut text = "Exit codes:\n  0  done, or the reader of standard output has gone".to_string();
    for exit in Exit::ALL {
        text += &format!("\n  {}  {}", exit.code(), exit.meaning());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exit_codes_are_consecutive_from_two() {
        let codes: Vec<u8> = Exit::ALL.map(Exit::code).to_vec();

        assert_eq!(codes, (2..=8).collect::<Vec<_>>());
    }
}
