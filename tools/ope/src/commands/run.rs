//! `ope run` and `ope merge`.

use crate::args::{MergeArgs, RunArgs};
use ope::results::{Origin, Results};
use ope::run::{Program, Runner};
use ope::{Error, starts};
use sequences::Notes;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::thread;
use track_cpu::{Isa, Model};

/// Runs a tracker over a benchmark.
pub fn run(args: &RunArgs) -> Result<(), Error> {
    let dataset = args.dataset;
    let mut notes = Notes::default();
    let mut sequences = dataset.load(&args.root, &mut notes)?;
    if args.four_starts {
        sequences = starts::sequences(sequences);
    }
    eprint!("{notes}");
    let (runner, origin, name) = match &args.tracker {
        Some(program) => program_runner(args, program),
        None => {
            let (runner, origin) = model_runner(args)?;
            (runner, origin, "track-cpu".to_owned())
        }
    };
    let name = super::folder_name(args.name.as_ref().unwrap_or(&name))?;
    let folder = args.out.join(dataset.name()).join(name);
    Results::create(&folder)?.reserve(&origin)?;

    let cores = || thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    let jobs = args.jobs.unwrap_or_else(cores);
    let ran = ope::run::run(&sequences, args.shard, &runner, &folder, jobs, &|line| {
        eprintln!("{line}")
    })?;
    let kept = args.shard.len(sequences.len()) - ran;
    eprintln!("{ran} sequences run, results in {}", folder.display());
    if kept > 0 {
        eprintln!("note: {kept} sequences had results already; delete those to repeat them");
    }
    if ran > 0 && jobs.get() > 1 {
        eprintln!(
            "note: {jobs} sequences ran at a time, which slows each: times to quote need --jobs 1"
        );
    }
    Ok(())
}

/// Another program, what it is known by, and the name of its results.
fn program_runner(args: &RunArgs, program: &Program) -> (Runner, Origin, String) {
    let timeout = args.timeout.unwrap_or(program.timeout);
    let runner = Runner::Program(Program {
        timeout,
        ..program.clone()
    });
    let origin = Origin::Program {
        command: program.line.to_string(),
    };
    (runner, origin, program.line.name())
}

/// This repository's tracker, and what it is known by.
fn model_runner(args: &RunArgs) -> Result<(Runner, Origin), Error> {
    let weights = Model::find(args.model.as_deref())?;
    let bytes = weights
        .to_bytes()
        .map_err(|error| Error::content(Path::new("the model"), "weights", error))?;
    let model = Model::from_weights(&weights, Isa::detect())?;
    let standard = Model::builtin_names().next().map(PathBuf::from);
    let asked = args.model.clone().or(standard).unwrap_or_default();
    let file = Model::successor(&asked).map_or(asked, PathBuf::from);
    let origin = Origin::Model {
        model: file.display().to_string(),
        crc32: format!("{:08x}", crc32fast::hash(&bytes)),
        precision: model.precision().name().to_owned(),
        isa: model.isa().name().to_owned(),
    };
    Ok((Runner::Builtin(model, args.on_bad_frame), origin))
}

/// Makes one folder of several.
pub fn merge(args: &MergeArgs) -> Result<(), Error> {
    let parts: Vec<&Path> = args.parts.iter().map(PathBuf::as_path).collect();
    super::check_output(&args.out.join("times"), &parts)?;
    let sequences = ope::run::merge(&args.parts, &args.out)?;
    eprintln!("{sequences} sequences in {}", args.out.display());
    Ok(())
}
