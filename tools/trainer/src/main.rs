//! `train`: everything that makes weights.

#![forbid(unsafe_code)]

mod args;

use args::{Args, Command, Show};
use clap::Parser;
use std::process::ExitCode;
use std::sync::Arc;
use trainer::Error;
use trainer::data::Dataset;
use trainer::fit::Fit;
use trainer::validate::Validation;
use weights_format::Storage;

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
        Command::Fit(args) => fit(&args),
        Command::Export(args) => export(&args),
        Command::Show(show) => {
            let dataset = show.data.open()?;
            let Show { search_size, first, sheets, out, .. } = &show;
            for path in trainer::show::write_sheets(&dataset, *search_size, *first, *sheets, out)? {
                println!("{}", path.display());
            }
            Ok(())
        }
    }
}

fn fit(args: &args::Fit) -> Result<(), Error> {
    let run = args.run_options()?;
    let mut fit = match &args.resume {
        Some(checkpoint) => Fit::resume(checkpoint)?,
        None => Fit::start(args.options()?, args.data.data.clone(), args.data.options()?)?,
    };
    if let Some(checkpoint) = &args.init {
        let fresh = fit.take_over(checkpoint)?;
        if !fresh.is_empty() {
            eprintln!("not in {}, so begun anew: {}", checkpoint.display(), fresh.join(", "));
        }
    }
    let position = fit.position();
    let specs: Result<Vec<_>, _> = position.data.iter().map(|text| text.parse()).collect();
    let dataset = Dataset::open(&specs?, position.data_options.clone())?;
    fit.run(Arc::new(dataset), &run)?;
    println!("{}", run.out.join("weights.safetensors").display());
    Ok(())
}

fn export(args: &args::Export) -> Result<(), Error> {
    let fit = Fit::resume(&args.checkpoint)?;
    let storage = match args.dtype {
        args::Dtype::F16 => Storage::F16,
        args::Dtype::F32 => Storage::F32,
    };
    let validation = Validation::open(&args.validate, 0, args.validate_frames)?;
    let mut report = None;
    if !validation.is_empty() {
        let found = validation.run(&fit.export(Storage::F32, &args.name, None)?, 2)?;
        for (name, in_train, accuracy) in &found.clips {
            let mark = if *in_train { "*" } else { "" };
            println!("{:32} {:6.1} {:6.1} {mark}", name, accuracy.precision, accuracy.auc);
        }
        println!("{found}");
        report = Some(found);
    }
    fit.export(storage, &args.name, report.as_ref())?.write(&args.out)?;
    println!("{}", args.out.display());
    Ok(())
}
