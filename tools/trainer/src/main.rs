//! `train`: everything that makes weights.

#![forbid(unsafe_code)]

mod args;

use args::{Args, Command};
use clap::Parser;
use std::process::ExitCode;
use trainer::Error;

fn main() -> ExitCode {
    match run(Args::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(match error {
                Error::Option { .. } => 2,
                Error::Io { .. } | Error::ReadWeights(_) => 3,
                Error::WriteWeights(_) => 5,
                _ => 4,
            })
        }
    }
}

fn run(args: Args) -> Result<(), Error> {
    match args.command {
        Command::Show(show) => {
            let dataset = show.data.open()?;
            for path in
                trainer::show::write_sheets(&dataset, show.search_size, show.first, show.sheets, &show.out)?
            {
                println!("{}", path.display());
            }
            Ok(())
        }
    }
}
