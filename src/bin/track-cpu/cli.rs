//! The program's command line: its sub-commands, and how it is read.

use std::ffi::OsString;

#[cfg(feature = "serve")]
use clap::CommandFactory;
use clap::{Parser, Subcommand};

use crate::args::bench::BenchArgs;
use crate::args::compare::CompareArgs;
use crate::args::demo::DemoArgs;
use crate::args::doctor::DoctorArgs;
use crate::args::info::InfoArgs;
use crate::args::track::TrackArgs;
use crate::args::trax::TraxArgs;
#[cfg(feature = "serve")]
use crate::serve::args::{ReplayArgs, ServeArgs};

/// Follows one object through video on a CPU.
#[derive(Debug, Parser)]
#[command(version, about, after_help = format!("{EXAMPLES}\n\n{}", program::exit_help()))]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

const EXAMPLES: &str = "\
Start here:
  track-cpu doctor                                     is everything in order on this machine?
  track-cpu demo                                       a rendered flight, tracked; writes a GIF
  track-cpu track --input clip.mp4 --init 300,120,40,24 --out boxes.txt --overlay out.gif";

/// The sub-commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Follow the object inside a box through images, a video or a stream.
    Track(Box<TrackArgs>),
    /// Run live: a camera or stream in; boxes, MAVLink and a web page out.
    #[cfg(feature = "serve")]
    Serve(Box<ServeArgs>),
    /// Repeat a flight that `serve --log` recorded, and compare every box.
    #[cfg(feature = "serve")]
    Replay(ReplayArgs),
    /// Render a UAV flight, track it and show the result.
    Demo(DemoArgs),
    /// Draw the boxes of several trackers into one film or contact sheet.
    Compare(CompareArgs),
    /// Show a model's layers, shapes, parameters and multiply-accumulates.
    Info(InfoArgs),
    /// Measure speed: frames per second, latency percentiles, time per stage.
    Bench(Box<BenchArgs>),
    /// Serve the TraX protocol: evaluation toolkits such as VOT's drive the tracker.
    Trax(TraxArgs),
    /// Check this machine: CPU features, kernels against golden numbers, speed to expect.
    Doctor(DoctorArgs),
}

impl Args {
    /// Reads this process's command line. Ends the process with help, or with a message if the line
    /// does not parse.
    pub fn read() -> Args {
        let args = with_sub_commands(std::env::args_os().collect());
        #[cfg(feature = "serve")]
        let args = with_config(args);
        Args::parse_from(args)
    }
}

/// Adds what the file of `serve --config` holds. Ends the process if that is wrong.
#[cfg(feature = "serve")]
fn with_config(args: Vec<OsString>) -> Vec<OsString> {
    let mut command = Args::command();
    command.build();
    let Some(serve) = command.find_subcommand("serve") else {
        return args;
    };
    match crate::serve::config::expand(args, serve) {
        Ok(args) => args,
        Err(reason) => {
            let _ = program::Exit::Usage.fail(&reason);
            std::process::exit(program::Exit::Usage.code().into());
        }
    }
}

/// Turns `bench --plan` and `bench --compare` into sub-commands: their spelling up to version 0.1.
fn with_sub_commands(mut args: Vec<OsString>) -> Vec<OsString> {
    if args.get(1).is_some_and(|command| command == "bench") {
        for (option, command) in [("--plan", "plan"), ("--compare", "compare")] {
            if let Some(at) = args.iter().position(|arg| arg == option) {
                args.remove(at);
                args.insert(2, command.into());
                break;
            }
        }
    }
    args
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn command_line_is_consistent() {
        Args::command().debug_assert();
    }

    #[test]
    fn options_that_became_sub_commands_still_work() {
        for (before, after) in [
            ("x bench --json", "x bench --json"),
            ("x bench --json --plan", "x bench plan --json"),
            ("x bench --compare a b", "x bench compare a b"),
            ("x track --plan", "x track --plan"),
            ("x", "x"),
        ] {
            let args = before.split(' ').map(OsString::from).collect();

            let found = with_sub_commands(args);

            let expected: Vec<OsString> = after.split(' ').map(OsString::from).collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn model_help_is_the_same_everywhere_and_names_every_model() {
        for command in ["track", "demo", "info", "bench", "trax"] {
            let mut args = Args::command();
            let command = args.find_subcommand_mut(command).unwrap();
            let help = command.render_help().to_string();
            for name in track_cpu::Model::builtin_names() {
                assert!(help.contains(name), "{name} in the help of {command}");
            }
        }
    }
}
