//! `convert`: PyTorch checkpoint -> weights file.

#![forbid(unsafe_code)]

mod args;

use args::Args;
use clap::Parser;
use converter::{
    Conversion, Error, convert,
    report::{Table, f16_rounding, thousands},
};
use std::{
    io::{self, Write},
    process::ExitCode,
};
use weights_format::{Storage, WriteError};

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(text) => match io::stdout().write_all(text.as_bytes()) {
            Err(error) if error.kind() != io::ErrorKind::BrokenPipe => {
                eprintln!("error: standard output: {error}");
                ExitCode::from(5)
            }
            _ => ExitCode::SUCCESS,
        },
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(match error {
                Error::Unreadable { .. } => 3,
                Error::Refused { .. }
                | Error::Unwritable(WriteError::Invalid(_) | WriteError::Overflow { .. }) => 4,
                Error::Unwritable(WriteError::Io { .. }) => 5,
            })
        }
    }
}

/// What there is to say on standard output.
fn run(args: &Args) -> Result<String, Error> {
    let Conversion { weights, ignored, unknown } = convert(&args.checkpoint, &args.options())?;
    for (what, names) in [("ignored", ignored), ("warning: unknown, not converted", unknown)] {
        if !names.is_empty() {
            eprintln!("{what} ({}): {}", names.len(), printable(&names.join(", ")));
        }
    }
    let header = &weights.header;
    let ratio = header.pruning_ratio.map_or("none of 0.0 to 0.9".into(), |ratio| ratio.to_string());
    let mut text = String::new();
    if args.dry_run {
        // As strict as the real thing: what cannot be written is refused here too.
        weights.to_bytes().map_err(Error::Unwritable)?;
        text += &format!("{}\npruning ratio {ratio}\n", Table(&header.architecture));
    } else if let Some(out) = &args.out {
        weights.write(out).map_err(Error::Unwritable)?;
        let parameters = thousands(header.architecture.parameters() as u64);
        text += &format!("{}: {parameters} parameters, pruning ratio {ratio}\n", out.display());
    }
    if header.storage == Storage::F16 {
        let (name, error) = f16_rounding(&weights);
        text += &format!("rounding to f16 changes {name} most, by {error:.1e}\n");
    }
    Ok(text)
}

/// A stranger's names, fit for a terminal.
fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { '\u{fffd}' } else { c }).collect()
}
