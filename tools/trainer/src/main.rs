//! `train`: everything that makes weights.

#![forbid(unsafe_code)]

mod args;
mod commands;

use args::{Args, Command};
use clap::Parser;
use program::{Exit, check_outputs};
use std::path::{Path, PathBuf};
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

/// Refuses a `--out` that would overwrite what is read. `quantize` and `tune` may add to their own
/// weights file, which they replace as a whole.
fn spare_inputs(command: &Command) -> Result<(), Error> {
    let (output, inputs): (PathBuf, Vec<&Path>) = match command {
        Command::Fit(args) => (in_folder(&args.out), folders(&args.data.data)),
        Command::Sweep(args) => (in_folder(&args.out), folders(&args.data.data)),
        Command::Ablate(args) => (in_folder(&args.out), folders(&args.data.data)),
        Command::Show(args) => (in_folder(&args.out), folders(&args.data.data)),
        Command::Prune(args) => (args.out.clone(), vec![&args.network]),
        Command::Export(args) => (args.out.clone(), vec![&args.checkpoint]),
        Command::Average(args) => (
            args.out.clone(),
            args.networks.iter().map(PathBuf::as_path).collect(),
        ),
        Command::Queue(_) | Command::Quantize(_) | Command::Tune(_) => return Ok(()),
    };
    check_outputs(&[("--out", &output)], &inputs).map_err(|clash| Error::Option {
        option: "--out".into(),
        expected: "a path that spares the inputs".into(),
        found: clash.to_string(),
    })
}

/// A file in a folder that a command writes to.
fn in_folder(folder: &Path) -> PathBuf {
    folder.join("weights.safetensors")
}

/// The paths that sources of data may name: `WHAT`, `KIND:WHAT`, with or without `:SHARE`.
fn folders(sources: &[String]) -> Vec<&Path> {
    let mut paths = Vec::new();
    for source in sources {
        let what = source.split_once(':').map_or("", |(_, what)| what);
        for text in [source, what] {
            paths.push(Path::new(text));
            paths.extend(text.rsplit_once(':').map(|(path, _)| Path::new(path)));
        }
    }
    paths.retain(|path| *path != Path::new(""));
    paths
}

fn run(args: Args) -> Result<(), Error> {
    spare_inputs(&args.command)?;
    match args.command {
        Command::Fit(args) => trainer::fit::join(
            |error| exit(error).code(),
            |processes| commands::fit(&args, processes),
        ),
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
