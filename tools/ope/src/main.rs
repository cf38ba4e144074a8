//! `ope`: one-pass evaluation of trackers. `ope --help` teaches the rest.

#![forbid(unsafe_code)]

mod args;
mod commands;

use args::{Args, Command};
use std::process::ExitCode;

fn main() -> ExitCode {
    let done = match Args::read().command {
        Command::Run(args) => commands::run::run(&args),
        Command::Step(args) => commands::step::run(&args),
        Command::Merge(args) => commands::run::merge(&args),
        Command::Score(args) => commands::score::run(&args),
        Command::Compare(args) => commands::compare::compare(&args),
        Command::Diagnose(args) => commands::diagnose::run(&args),
        Command::Report(args) => commands::compare::report(&args),
        Command::Export(args) => commands::export::run(&args),
        Command::Render(args) => commands::render::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => commands::exit(&error),
    }
}
