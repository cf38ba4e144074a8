//! `bench`: speed of the whole tracker on frames that lie ready, and the comparison of two such measurements.

mod clip;
mod compare;
mod measure;
mod plan;
mod report;

use track_cpu::Model;

use crate::args::BenchArgs;
use crate::exit::Failure;
use crate::report::{print, progress};
use clip::Clip;
use report::Report;

/// Runs the sub-command.
pub fn run(args: &BenchArgs) -> Result<(), Failure> {
    if let [before, after] = &args.compare[..] {
        return compare::run(before, after, args.json);
    }
    let model = model(args)?;
    if args.plan {
        return plan(args, &model);
    }
    let clip = Clip::render();
    let threads = if args.sweep { sweep() } else { Vec::new() };
    let bar = progress(Some(measure::steps(args, &threads)));
    let measured = measure::measure(args, &model, &clip, &threads, || bar.inc(1))?;
    bar.finish_and_clear();
    let report = Report {
        args,
        model: &model,
        measured,
    };
    match (args.json, args.markdown) {
        (true, _) => print(&report.json().to_string()),
        (_, true) => print(&report.markdown()),
        _ => print(&report.text()),
    }
}

/// Measures algorithms in place of the tracker.
fn plan(args: &BenchArgs, model: &Model) -> Result<(), Failure> {
    let bar = progress(Some(plan::steps(model)));
    let rows = plan::measure(model, || bar.inc(1));
    bar.finish_and_clear();
    match args.json {
        true => print(&plan::json(model, &rows).to_string()),
        false => print(&plan::text(model, &rows)),
    }
}

/// The model that the arguments ask for.
pub fn model(args: &BenchArgs) -> Result<Model, Failure> {
    let random = args.random.weights()?;
    let is_random = random.is_some();
    let weights = match (random, &args.model) {
        (Some(weights), _) => weights,
        (None, name) => Model::find(name.as_deref())?,
    };
    Ok(match args.algorithm {
        Some(algorithm) => Model::with_algorithm(&weights, args.engine.isa(), algorithm)?,
        None if is_random => args.engine.random_model(weights)?,
        None => args.engine.model_of(&weights)?,
    })
}

/// 1, 2, 4 ... threads, and as many as there are cores.
fn sweep() -> Vec<usize> {
    let cores = std::thread::available_parallelism()
        .map_or(1, |n| n.get())
        .min(256);
    let mut threads: Vec<usize> = std::iter::successors(Some(1), |n| Some(2 * n))
        .take_while(|n| *n < cores)
        .collect();
    threads.push(cores);
    threads
}
