//! The subcommands.

use crate::args;
use autodiff::{OneProcess, ProcessGroup};
use clap::Parser;
use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use trainer::Error;
use trainer::calibrate::calibrate;
use trainer::data::Dataset;
use trainer::fit::{Claim, Fit, RunOptions, agree, compute, refuse_used};
use trainer::prune::{Ranks, prune as prune_by_rank};
use trainer::queue::{self, Entry, State};
use trainer::study::{Study, ablation, markdown, sweep as sweep_of};
use trainer::tune::{SHARES, correction, leave_one_out, over_sequences};
use trainer::validate::Validation;
use weights_format::{Storage, TrackerParams, Weights};

/// `fit`, in one of the processes of a run.
pub fn fit(args: &args::Fit, processes: Arc<dyn ProcessGroup>) -> Result<(), Error> {
    let first = processes.is_first();
    if first && args.resume.is_none() && !args.overwrite {
        refuse_used(&args.out)?;
    }
    let run = RunOptions {
        processes,
        ..args
            .behavior
            .run_options(&args.out, args.validate_minutes)?
    };
    let init = args.init.as_ref().map(|path| Fit::open(path)).transpose()?;
    let mut fit = match &args.resume {
        Some(checkpoint) => Fit::resume(checkpoint)?,
        None => {
            let architecture = init.as_ref().map(|init| init.network().architecture());
            let options =
                args.training
                    .options(architecture, args.data.seed, run.processes.size())?;
            Fit::start(options, args.data.data.clone(), args.data.options()?)?
        }
    };
    if let (Some(init), Some(path)) = (&init, &args.init) {
        let fresh = fit.take_over(init);
        if first && !fresh.is_empty() {
            eprintln!(
                "initialized, since {} lacks them: {}",
                path.display(),
                fresh.join(", ")
            );
        }
    }
    let dataset = dataset_of(&fit)?;
    // All processes have read their files before the folder is cleared.
    let compute = compute(1)?.with_processes(run.processes.clone());
    agree(&fit, &dataset, &compute)?;
    let claim = first.then(|| Claim::new(&run.out)).transpose()?;
    if let Some(claim) = claim.as_ref().filter(|_| args.overwrite) {
        claim.clear()?;
    }
    fit.run(dataset, &run)?;
    if first {
        println!("{}", run.out.join("weights.safetensors").display());
    }
    Ok(())
}

/// `queue`.
pub fn queue(args: &args::Queue) -> Result<(), Error> {
    let read = || -> Result<Vec<(Entry, args::Fit)>, Error> {
        let entries = queue::read(&args.list, &args.out)?;
        let with_options = |entry: Entry| {
            let options = options_of(&entry, &args.list)?;
            Ok((entry, options))
        };
        entries.into_iter().map(with_options).collect()
    };
    let table = |runs: &[(Entry, args::Fit)]| {
        let entries: Vec<_> = runs.iter().map(|(entry, _)| entry.clone()).collect();
        queue::table(&entries)
    };
    if args.status {
        print!("{}", table(&read()?));
        return Ok(());
    }
    yield_to_others();
    let mut failed = BTreeSet::new();
    // The list is read before each run: it may have grown.
    loop {
        let runs = read()?;
        eprint!("{}", table(&runs));
        let next = runs
            .iter()
            .find(|(entry, _)| entry.state() != State::Finished && !failed.contains(&entry.name));
        let Some((entry, options)) = next else { break };
        eprintln!("{}", entry.name);
        if let Err(error) = fit(options, Arc::new(OneProcess)) {
            eprintln!("{}: error: {error}", entry.name);
            failed.insert(entry.name.clone());
        }
    }
    if failed.is_empty() {
        return Ok(());
    }
    let names: Vec<_> = failed.into_iter().collect();
    Err(Error::File {
        path: args.list.clone(),
        expected: "runs that come to their end".into(),
        found: format!("errors in {}", names.join(", ")),
    })
}

/// Options of a run of a list; those of a run that has begun continue it.
fn options_of(entry: &Entry, list: &Path) -> Result<args::Fit, Error> {
    let begin = ["train", "fit", "--out"].map(OsString::from);
    let words = begin
        .into_iter()
        .chain([entry.folder.clone().into_os_string()])
        .chain(entry.options.iter().map(OsString::from));
    let wrong = |found: String| Error::File {
        path: list.into(),
        expected: format!("options of `train fit` behind {}", entry.name),
        found,
    };
    let mut options = match args::Args::try_parse_from(words).map(|args| args.command) {
        Ok(args::Command::Fit(options)) => *options,
        Ok(_) => return Err(wrong("another command".into())),
        Err(error) => {
            let text = error.to_string();
            let first = text.lines().next().unwrap_or_default();
            return Err(wrong(first.trim_start_matches("error: ").into()));
        }
    };
    if options.resume.is_some() || options.overwrite {
        return Err(wrong("--resume or --overwrite".into()));
    }
    if entry.state() == State::Begun {
        options.resume = Some(entry.checkpoint());
        options.init = None;
    }
    Ok(options)
}

/// Gives this process the lowest priority, where the system has `renice`.
fn yield_to_others() {
    let process = std::process::id().to_string();
    let renice = Command::new("renice")
        .args(["-n", "19", "-p", &process])
        .output();
    if !renice.is_ok_and(|output| output.status.success()) {
        eprintln!("the priority stays as it is: renice failed");
    }
}

/// `prune`.
pub fn prune(args: &args::Prune) -> Result<(), Error> {
    let targets = args.targets()?;
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let threads = args.threads.unwrap_or(cores);
    let mut source = Fit::open(&args.network)?;
    let dataset = if args.data.data.is_empty() {
        dataset_of(&source)?
    } else {
        Arc::new(args.data.open()?)
    };
    source.unfold(&compute(threads)?, &dataset, 1)?;
    let ranks = Ranks::measure(&source, &dataset, args.pairs, threads)?;
    let mut pruned = prune_by_rank(&source, &ranks, &targets)?;
    if !args.data.data.is_empty() {
        pruned
            .fit
            .train_on(args.data.data.clone(), args.data.options()?);
    }
    pruned.fit.save(&args.out)?;
    println!("{pruned}{}", args.out.display());
    Ok(())
}

/// `sweep`.
pub fn sweep(args: &args::Sweep) -> Result<(), Error> {
    let ratios = args.ratios()?;
    let run = args.behavior.run_options(&args.out, f64::MAX)?;
    let mut source = Fit::open(&args.init)?;
    let options =
        args.training
            .options(Some(source.network().architecture()), args.data.seed, 1)?;
    let options = args::comparable(options)?;
    let data = (&args.data.data[..], &args.data.options()?);
    let study = sweep_of(
        &mut source,
        &ratios,
        &options,
        data,
        args.rank_pairs,
        (&run.out, run.threads),
    )?;
    finish(&study, &run)
}

/// `ablate`.
pub fn ablate(args: &args::Ablate) -> Result<(), Error> {
    let run = args.behavior.run_options(&args.out, f64::MAX)?;
    let options = args::comparable(args.training.options(None, args.data.seed, 1)?)?;
    let study = ablation(
        &options,
        &args.data.data,
        &args.data.options()?,
        &args.seeds,
        &args.variants,
    );
    finish(&study, &run)
}

/// Runs a study and prints its table.
fn finish(study: &Study, run: &RunOptions) -> Result<(), Error> {
    let outcomes = study.run(run)?;
    print!("{}", markdown(&study.title, &outcomes));
    Ok(())
}

/// The data of a run.
fn dataset_of(fit: &Fit) -> Result<Arc<Dataset>, Error> {
    let position = fit.position();
    let specs: Result<Vec<_>, _> = position.data.iter().map(|text| text.parse()).collect();
    Ok(Arc::new(Dataset::open(
        &specs?,
        position.data_options.clone(),
    )?))
}

/// `average`.
pub fn average(args: &args::Average) -> Result<(), Error> {
    let (first, others) = args.networks.split_first().expect("clap asks for two");
    Fit::mean(first, others)?.save(&args.out)?;
    println!("{}", args.out.display());
    Ok(())
}

/// `export`.
pub fn export(args: &args::Export) -> Result<(), Error> {
    let fit = Fit::resume(&args.checkpoint)?;
    let storage = match args.dtype {
        args::Dtype::F16 => Storage::F16,
        args::Dtype::F32 => Storage::F32,
    };
    let validation = Validation::open(
        &args.validate,
        args::passes(args.four_starts),
        0,
        args.validate_frames,
    )?;
    let mut report = None;
    if !validation.is_empty() {
        let found = validation.run(&fit.export(Storage::F32, &args.name, None)?, 2)?;
        for (name, in_train, accuracy) in &found.clips {
            let mark = if *in_train { "*" } else { "" };
            println!(
                "{:32} {:6.1} {:6.1} {mark}",
                name, accuracy.precision, accuracy.auc
            );
        }
        println!("{found}");
        report = Some(found);
    }
    fit.export(storage, &args.name, report.as_ref())?
        .write(&args.out)?;
    println!("{}", args.out.display());
    Ok(())
}

/// `quantize`.
pub fn quantize(args: args::Measure) -> Result<(), Error> {
    measure(args, |weights, dataset, pairs| {
        let calibration = calibrate(weights, dataset, pairs)?;
        for (name, range) in &calibration.inputs {
            println!("{name:20} {:10.4} .. {:9.4}", range.low, range.high);
        }
        weights.header.calibration = Some(calibration);
        Ok(())
    })
}

/// Constants that are tuned on sequences, in this order: name and setter.
type Share = (&'static str, fn(&mut TrackerParams, f64));
const WHILE_TRACKING: [Share; 4] = [
    ("template update", |tracker, share| {
        tracker.template_update = share
    }),
    ("online filter", |tracker, share| {
        tracker.online_filter = share
    }),
    ("unstretch", |tracker, share| tracker.unstretch = share),
    ("voting", |tracker, share| tracker.voting = share),
];

/// `tune`.
pub fn tune(args: args::Tune) -> Result<(), Error> {
    let validation = Validation::open(
        &args.validate,
        args::passes(args.four_starts),
        0,
        usize::MAX,
    )?;
    measure(args.measure, |weights, dataset, pairs| {
        let quality = correction(weights, dataset, pairs)?;
        for (share, iou) in SHARES.into_iter().zip(quality) {
            println!("correction {share:.1}: mean IoU {iou:.4}");
        }
        weights.header.tracker.correction = best_share(&quality);
        if !validation.is_empty() {
            for (number, (name, set)) in (1..).zip(WHILE_TRACKING) {
                let of = WHILE_TRACKING.len();
                let reports = over_sequences(weights, &validation, set, |share| {
                    eprintln!("{number} of {of}: {name} {share:.1}");
                })?;
                let quality = reports
                    .each_ref()
                    .map(|report| report.score().unwrap_or(0.0));
                for (share, auc) in SHARES.into_iter().zip(quality) {
                    println!("{name} {share:.1}: AUC {auc:.2}");
                }
                if let Some(auc) = leave_one_out(&reports) {
                    // Each sequence with the share that is best on all others.
                    println!("{name}, leave-one-out over sequences: AUC {auc:.2}");
                }
                let best = best_share(&quality);
                println!("{name}: {best:.1} is chosen");
                set(&mut weights.header.tracker, best);
            }
        }
        Ok(())
    })
}

/// The share of the highest quality, and the least of those that are equal.
fn best_share(quality: &[f64; SHARES.len()]) -> f64 {
    let shares = (0..SHARES.len()).rev();
    let best = shares.max_by(|a, b| quality[*a].total_cmp(&quality[*b]));
    best.map_or(0.0, |best| SHARES[best])
}

/// Writes a copy of a weights file to which `find` adds what it measures on data.
fn measure(
    mut args: args::Measure,
    find: impl FnOnce(&mut Weights, &Dataset, u64) -> Result<(), Error>,
) -> Result<(), Error> {
    if !(1..=100_000).contains(&args.pairs) {
        return Err(args::wrong("--pairs", "1 to 100000", &args.pairs));
    }
    if args.data.data.is_empty() {
        args.data.data.push("scenes".into());
    }
    let mut weights = Weights::read(&args.weights)?;
    find(&mut weights, &args.data.open()?, args.pairs)?;
    weights.write(&args.out)?;
    println!("{}", args.out.display());
    Ok(())
}

/// `show`.
pub fn show(args: &args::Show) -> Result<(), Error> {
    let dataset = args.data.open()?;
    let args::Show {
        search_size,
        first,
        sheets,
        out,
        ..
    } = args;
    for path in trainer::show::write_sheets(&dataset, (*search_size).into(), *first, *sheets, out)?
    {
        println!("{}", path.display());
    }
    Ok(())
}
