//! `ope run` and `ope merge`.

use crate::args::{MergeArgs, RunArgs};
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
    let (runner, name) = match (&args.tracker, &args.model) {
        (Some(program), _) => {
            let timeout = args.timeout.unwrap_or(program.timeout);
            (
                Runner::Program(Program {
                    timeout,
                    ..program.clone()
                }),
                program.line.name(),
            )
        }
        (None, name) => {
            let model = Model::from_weights(&Model::find(name.as_deref())?, Isa::detect())?;
            (
                Runner::Builtin(model, args.on_bad_frame),
                "track-cpu".to_owned(),
            )
        }
    };
    let name = super::folder_name(args.name.as_ref().unwrap_or(&name))?;
    let folder = args.out.join(dataset.name()).join(name);
    let cores = || thread::available_parallelism().unwrap_or(NonZeroUsize::MIN);
    let jobs = args.jobs.unwrap_or_else(cores);
    let ran = ope::run::run(&sequences, args.shard, &runner, &folder, jobs, &|line| {
        eprintln!("{line}")
    })?;
    eprintln!("{ran} sequences run, results in {}", folder.display());
    if ran > 0 && jobs.get() > 1 {
        eprintln!(
            "note: {jobs} sequences ran at a time, which slows each: times to quote need --jobs 1"
        );
    }
    Ok(())
}

/// Makes one folder of several.
pub fn merge(args: &MergeArgs) -> Result<(), Error> {
    let parts: Vec<&Path> = args.parts.iter().map(PathBuf::as_path).collect();
    super::spare(&args.out.join("times"), &parts)?;
    let sequences = ope::run::merge(&args.parts, &args.out)?;
    eprintln!("{sequences} sequences in {}", args.out.display());
    Ok(())
}
