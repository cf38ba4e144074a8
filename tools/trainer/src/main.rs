//! `train`: everything that makes weights.

#![forbid(unsafe_code)]

mod args;
mod commands;

use args::{Args, Command};
use clap::Parser;
use program::Exit;
use std::process::ExitCode;
use trainer::Error;

fn main() -> ExitCode {
    match run(Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => exit(&error).fail(error),
    }
}

/// The exit code of an error.
fn exit(error: &Error) -> Exit {
    match error {
        Error::Option { .. } => Exit::Usage,
        Error::Io { .. } | Error::Sequences(_) | Error::ReadWeights(_) => Exit::Input,
        Error::WriteWeights(_) => Exit::Output,
        _ => Exit::Model,
    }
}

fn run(args: Args) -> Result<(), Error> {
    match args.command {
        Command::Fit(args) => commands::fit(&args),
        Command::Queue(args) => commands::queue(&args),
        Command::Prune(args) => commands::prune(&args),
        Command::Sweep(args) => commands::sweep(&args),
        Command::Ablate(args) => commands::ablate(&args),
        Command::Average(args) => commands::average(&args),
        Command::Export(args) => commands::export(&args),
        Command::Quantize(args) => commands::quantize(args),
        Command::Tune(args) => commands::tune(args),
        Command::Show(args) => commands::show(&args),
    }
}
