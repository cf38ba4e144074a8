//! `track-cpu`: follows one object through video on a CPU. `track-cpu --help` teaches the rest.

#![forbid(unsafe_code)]

mod args;
mod bench;
mod cli;
mod compare;
mod demo;
mod doctor;
mod exit;
mod film;
mod follow;
mod font;
mod info;
mod machine;
mod overlay;
mod painter;
mod pictures;
mod report;
mod selftest;
#[cfg(feature = "serve")]
mod serve;
mod sheet;
mod statistics;
mod track;
mod trax;

use std::process::ExitCode;

use cli::{Args, Command};

fn main() -> ExitCode {
    let done = match Args::read().command {
        Command::Track(args) => track::run(&args),
        Command::Demo(args) => demo::run(&args),
        Command::Compare(args) => compare::run(&args),
        Command::Info(args) => info::run(&args),
        Command::Bench(args) => bench::run(&args),
        #[cfg(feature = "serve")]
        Command::Serve(args) => serve::run(&args),
        #[cfg(feature = "serve")]
        Command::Replay(args) => serve::replay::run(&args),
        Command::Trax(args) => trax::run(&args),
        Command::Doctor(args) => doctor::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.exit(),
    }
}
