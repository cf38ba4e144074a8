//! `bench`: speed of the whole tracker on prepared frames, of each algorithm, and comparisons of
//! these.

mod clip;
mod compare;
mod measure;
mod plan;
mod report;
mod worker;

use kernels::par::Threads;
use track_cpu::Model;

use crate::args::bench::{BenchArgs, BenchCommand, MeasureArgs, NetworkArgs, PlanArgs};
use crate::exit::Failure;
use crate::report::{print, progress};
use clip::Clip;
use report::Report;

/// Runs the sub-command.
pub fn run(args: &BenchArgs) -> Result<(), Failure> {
    match &args.command {
        None => measure(&args.measure),
        Some(BenchCommand::Plan(args)) => plan(args),
        Some(BenchCommand::Compare(args)) => compare::run(&args.before, &args.after, args.json),
        Some(BenchCommand::Worker(args)) => worker::run(args),
    }
}

/// Measures the tracker.
fn measure(args: &MeasureArgs) -> Result<(), Failure> {
    let model = match args.algorithm {
        Some(algorithm) => {
            let weights = match args.network.random.weights()? {
                Some(weights) => weights,
                None => Model::find(args.network.model.name())?,
            };
            Model::with_algorithm(&weights, args.network.engine.isa(), algorithm)?
        }
        None => model(&args.network)?,
    };
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
    print(&if args.json {
        report.json().to_string()
    } else if args.markdown {
        report.markdown()
    } else {
        report.text()
    })
}

/// Measures algorithms in place of the tracker.
fn plan(args: &PlanArgs) -> Result<(), Failure> {
    let model = model(&args.network)?;
    let bar = progress(Some(plan::steps(&model)));
    let rows = plan::measure(&model, || bar.inc(1));
    bar.finish_and_clear();
    print(&if args.json {
        plan::json(&model, &rows).to_string()
    } else {
        plan::text(&model, &rows)
    })
}

/// The model that the arguments ask for.
fn model(args: &NetworkArgs) -> Result<Model, Failure> {
    Ok(match args.random.weights()? {
        Some(weights) => args.engine.random_model(weights)?,
        None => args.engine.model(args.model.name())?,
    })
}

/// 1, 2, 4 ... threads, and as many as there are cores.
fn sweep() -> Vec<usize> {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    let cores = cores.min(Threads::MAX);
    let mut threads: Vec<usize> = std::iter::successors(Some(1), |n| Some(2 * n))
        .take_while(|n| *n < cores)
        .collect();
    threads.push(cores);
    threads
}
