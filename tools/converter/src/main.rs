//! `convert`: PyTorch checkpoint -> weights file or the trainer's parameters, and back.

#![forbid(unsafe_code)]

mod args;

use args::{Args, To};
use clap::Parser;
use converter::{
    Conversion, Error, StateDict, Unfolding, convert,
    report::{Table, f16_rounding, thousands},
    unfold,
};
use program::{Exit, check_outputs, printable};
use std::{
    io::{self, Write},
    path::Path,
    process::ExitCode,
};
use weights_format::{ReadError, Storage, WriteError};

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(text) => match io::stdout().write_all(text.as_bytes()) {
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                Exit::Output.fail(format!("standard output: {error}"))
            }
            _ => ExitCode::SUCCESS,
        },
        Err(error) => exit(&error).fail(error),
    }
}

/// The exit code of an error.
fn exit(error: &Error) -> Exit {
    match error {
        Error::Usage(_) => Exit::Usage,
        Error::Unreadable { .. } => Exit::Input,
        Error::Input(ReadError::File { error, .. }) if matches!(**error, ReadError::Io(_)) => {
            Exit::Input
        }
        Error::Refused { .. }
        | Error::Input(_)
        | Error::Unwritable(WriteError::Invalid(_) | WriteError::Overflow { .. }) => Exit::Model,
        Error::Unwritable(WriteError::Io { .. }) => Exit::Output,
    }
}

/// Does what the arguments ask for and returns the text for standard output.
fn run(args: &Args) -> Result<String, Error> {
    if let Some(out) = &args.out {
        check_outputs(&[("--out", out)], &[&args.checkpoint])
            .map_err(|clash| Error::Usage(clash.to_string()))?;
    }
    match args.to {
        To::Weights => to_weights(args),
        To::Trainer => to_trainer(args),
        To::Pytorch => to_pytorch(args),
    }
}

fn to_trainer(args: &Args) -> Result<String, Error> {
    let Unfolding {
        unfolded,
        ignored,
        unknown,
    } = unfold(&args.checkpoint, &args.options())?;
    left_out(&ignored, &unknown);
    match &args.out {
        Some(out) if !args.dry_run => {
            unfolded.write(out)?;
            let parameters = thousands(unfolded.architecture.parameters() as u64);
            Ok(format!(
                "{}: {parameters} parameters, nothing folded\n",
                out.display()
            ))
        }
        _ => Ok(Table(&unfolded.architecture).to_string()),
    }
}

fn to_pytorch(args: &Args) -> Result<String, Error> {
    let known = |path: &Path| {
        path.extension()
            .is_some_and(|e| ["pth", "pt", "safetensors"].iter().any(|known| e == *known))
    };
    if let Some(out) = args.out.as_ref().filter(|out| !known(out)) {
        let expected = "expected a name that ends in .pth, .pt or .safetensors";
        return Err(Error::Usage(format!(
            "--out: {expected}, found {}",
            out.display()
        )));
    }
    let dict = StateDict::read(&args.checkpoint)?;
    if dict.folded {
        eprintln!(
            "batch normalization is folded into this file's convolutions: its layers are \
             written as ones that change nothing (weight 1, bias 0, mean 0, variance 0.99999). \
             Evaluation is the same; to continue training, convert a checkpoint of the trainer \
             instead"
        );
    }
    match &args.out {
        Some(out) if !args.dry_run => {
            dict.write(out)?;
            Ok(format!(
                "{}: {} tensors\n",
                out.display(),
                dict.entries.len()
            ))
        }
        _ => Ok(dict
            .entries
            .iter()
            .map(|(name, shape, _)| format!("{name} {shape:?}\n"))
            .collect()),
    }
}

/// Lists on standard error what is not converted.
fn left_out(ignored: &[String], unknown: &[String]) {
    for (what, names) in [
        ("ignored", ignored),
        ("warning: unknown, not converted", unknown),
    ] {
        if !names.is_empty() {
            eprintln!("{what} ({}): {}", names.len(), printable(&names.join(", ")));
        }
    }
}

fn to_weights(args: &Args) -> Result<String, Error> {
    let Conversion {
        weights,
        ignored,
        unknown,
    } = convert(&args.checkpoint, &args.options())?;
    left_out(&ignored, &unknown);
    let header = &weights.header;
    let ratio = header
        .pruning_ratio
        .map_or("none of 0.0 to 0.9".into(), |ratio| ratio.to_string());
    let mut text = String::new();
    if args.dry_run {
        // As strict as a real run: what cannot be written is refused here too.
        weights.to_bytes().map_err(Error::Unwritable)?;
        text += &format!("{}\npruning ratio {ratio}\n", Table(&header.architecture));
    } else if let Some(out) = &args.out {
        weights.write(out).map_err(Error::Unwritable)?;
        let parameters = thousands(header.architecture.parameters() as u64);
        text += &format!(
            "{}: {parameters} parameters, pruning ratio {ratio}\n",
            out.display()
        );
    }
    if header.storage == Storage::F16 {
        let (name, error) = f16_rounding(&weights);
        text += &format!("rounding to f16 changes {name} most, by {error:.1e}\n");
    }
    Ok(text)
}
