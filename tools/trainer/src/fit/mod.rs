//! The training run: read [`Fit::run`] first.

mod batch;
mod checkpoint;
mod curves;
mod export;
mod folder;
mod open;
mod options;
mod processes;
mod report;
mod statistics;
#[cfg(test)]
mod tests;

pub use batch::crops_of;
pub use checkpoint::{Position, State, write_atomically};
pub use folder::{Claim, refuse_used};
pub use options::{Budget, FitOptions, OptimizerKind, standard};
pub use processes::{agree, join};

use crate::data::feed::{Feed, Part};
use crate::data::{DataOptions, Dataset};
use crate::error::Error;
use crate::network::{LossValues, Network};
use crate::validate::{Report, Validation};
use autodiff::optim::{Optimizer, clip_gradients};
use autodiff::{Compute, Mode, Parameters, ProcessGroup, Tape, Tensor};
use report::{Reporter, Standing};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use weights_format::Storage;

/// Options of a run that do not change its result.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// Folder of checkpoints, log and curves.
    pub out: PathBuf,
    /// The processes that share each batch; the first one alone writes.
    pub processes: Arc<dyn ProcessGroup>,
    /// Threads that compute, in each process.
    pub threads: usize,
    /// Threads that make samples.
    pub data_threads: usize,
    /// Minutes of training between checkpoints.
    pub checkpoint_minutes: f64,
    /// Minutes of training between validations.
    pub validate_minutes: f64,
    /// Clips on which the weights are judged.
    pub validation: Validation,
    /// Number of further steps after which the run stops as if interrupted.
    pub stop_after: Option<u64>,
}

impl RunOptions {
    /// Whether this process validates.
    fn validates(&self) -> bool {
        self.processes.is_first() && !self.validation.is_empty()
    }
}

/// A network in training.
pub struct Fit {
    position: Position,
    network: Network,
    parameters: Parameters,
    optimizer: Box<dyn Optimizer>,
    averages: Vec<Tensor>, // of all parameters in their order; empty if the run keeps none
    folded: bool,          // whether normalizations are folded away, as in a weights file
}

/// Batches made ahead of the one in use.
const AHEAD: usize = 6;

/// Steps between two entries of the log.
const LOG_STEPS: u64 = 25;

/// First batch for the estimation of statistics, far beyond all training batches.
const ESTIMATION: u64 = 1 << 40;

/// Batches from which the statistics of folded normalizations are estimated.
const UNFOLDING_BATCHES: usize = 8;

impl Fit {
    /// A run that begins with fresh parameters.
    ///
    /// # Errors
    /// If an option is out of range.
    pub fn start(
        options: FitOptions,
        data: Vec<String>,
        data_options: DataOptions,
    ) -> Result<Fit, Error> {
        options.check()?;
        let mut fit = Fit::empty(Position::start(options, data, data_options))?;
        let FitOptions { init, seed, .. } = fit.position.options;
        fit.network.initialize(&mut fit.parameters, init, seed);
        fit.begin_averages();
        Ok(fit)
    }

    /// Starts the running averages at the present values, if the run keeps any.
    fn begin_averages(&mut self) {
        self.averages = if self.position.options.average > 0.0 {
            self.parameters.iter().map(|p| p.value.clone()).collect()
        } else {
            Vec::new()
        };
    }

    fn empty(position: Position) -> Result<Fit, Error> {
        let FitOptions {
            architecture,
            statistics_nets,
            ..
        } = position.options;
        let mut parameters = Parameters::new();
        let network = Network::new(&mut parameters, architecture, statistics_nets)?;
        let optimizer = position.options.optimizer();
        Ok(Fit {
            position,
            network,
            parameters,
            optimizer,
            averages: Vec::new(),
            folded: false,
        })
    }

    /// Writes a checkpoint.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<(), Error> {
        let own = |(name, tensor): (&str, &Tensor)| (name.to_owned(), tensor.clone());
        let named = self.parameters.iter().map(|p| p.name()).zip(&self.averages);
        let optimizer = self.optimizer.state(&self.parameters);
        let state = State {
            parameters: self.parameters.state().map(own).collect(),
            optimizer: optimizer
                .into_iter()
                .map(|(name, tensor)| (name, tensor.clone()))
                .collect(),
            averages: named.map(own).collect(),
        };
        checkpoint::save(path, &self.position, &state)
    }

    /// Progress of the run.
    pub fn position(&self) -> &Position {
        &self.position
    }

    /// The parameters.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The network.
    pub fn network(&self) -> &Network {
        &self.network
    }

    /// Share of the run that is done, from 0 to 1.
    pub fn progress(&self) -> f64 {
        let done = match self.position.options.budget {
            Budget::Steps(steps) => self.position.step as f64 / steps as f64,
            Budget::Minutes(minutes) => self.position.seconds / (60.0 * minutes),
        };
        if self.position.finished {
            1.0
        } else {
            done.min(1.0)
        }
    }

    /// Trains to the end of the budget. Writes the log, validates and saves checkpoints on the way.
    ///
    /// Returns the final accuracy, if the run reaches its end and validates, in the first process.
    ///
    /// # Errors
    /// If the data cannot be opened, a file cannot be written, or a loss is not finite.
    pub fn run(
        &mut self,
        dataset: Arc<Dataset>,
        run: &RunOptions,
    ) -> Result<Option<Report>, Error> {
        let compute = compute(run.threads)?.with_processes(run.processes.clone());
        let part = Part::of(self.position.options.batch, &*run.processes)?;
        self.unfold(&compute, &dataset, run.data_threads)?;
        let mut reporter = self.reporter(run)?;
        let mut watch = Watch::new(self.position.seconds);
        let first = self.position.step;
        let mut feed = Feed::new(dataset.clone(), part, first, run.data_threads, AHEAD);
        let mut smooth = Smooth::default();
        while self.progress() < 1.0 {
            if run
                .stop_after
                .is_some_and(|steps| self.position.step >= first + steps)
            {
                return Ok(None);
            }
            let start = Instant::now();
            let samples = feed.next(|number| self.size_of(number));
            let waited = start.elapsed().as_secs_f64();
            let size = samples.first().map_or(0, |sample| sample.search_size);
            let batch = batch::batch(&samples, self.network.architecture());
            let (losses, norm, rate) = self.step(&compute, batch)?;
            // The first process's clock is everyone's: all are equally far.
            let seconds = run.processes.all(&[start.elapsed().as_secs_f64()])[0];
            self.position.seconds += seconds;
            smooth.add(&losses, seconds, waited);

            let standing = self.standing(&smooth, size);
            reporter.show(&standing);
            if self.position.step.is_multiple_of(LOG_STEPS) {
                reporter.log(entry(&standing, rate, norm, smooth.waited))?;
            }
            if watch
                .validate
                .due(self.position.seconds, run.validate_minutes)
                && run.validates()
            {
                self.validate(run, &mut reporter)?;
            }
            if watch
                .checkpoint
                .due(self.position.seconds, run.checkpoint_minutes)
            {
                self.keep(run, "checkpoint.safetensors")?;
                reporter.draw()?;
            }
        }
        drop(feed);
        if dataset.unreadable() > 0 {
            reporter.say(&format!(
                "{} pictures could not be read and were left out",
                dataset.unreadable()
            ));
        }
        self.keep(run, "checkpoint.safetensors")?;
        self.finish(&compute, dataset, run, &mut reporter)
    }

    /// The reporter of this process: silent in all but the first one.
    fn reporter(&self, run: &RunOptions) -> Result<Reporter, Error> {
        if run.processes.is_first() {
            std::fs::create_dir_all(&run.out).map_err(Error::io(&run.out))?;
            Reporter::open(&run.out, self.position.step)
        } else {
            Ok(Reporter::silent())
        }
    }

    /// Writes a checkpoint into the run's folder, in the first process.
    fn keep(&self, run: &RunOptions, name: &str) -> Result<(), Error> {
        if run.processes.is_first() {
            self.save(&run.out.join(name))
        } else {
            Ok(())
        }
    }

    /// Restores batch normalizations that were folded into weights, with the statistics of the
    /// data, so that the network can be trained. Outputs change by rounding only. A no-op for other
    /// networks.
    ///
    /// # Errors
    /// If the batch cannot be divided among the processes.
    pub fn unfold(
        &mut self,
        compute: &Compute,
        dataset: &Arc<Dataset>,
        data_threads: usize,
    ) -> Result<(), Error> {
        if !self.folded {
            return Ok(());
        }
        let part = Part::of(self.position.options.batch, compute.processes())?;
        let mut feed = Feed::new(dataset.clone(), part, ESTIMATION, data_threads, AHEAD);
        statistics::unfold(
            compute,
            &self.network,
            &mut self.parameters,
            &mut feed,
            UNFOLDING_BATCHES,
        );
        self.folded = false;
        self.begin_averages();
        Ok(())
    }

    /// Side of the search crops of a batch.
    fn size_of(&self, number: u64) -> usize {
        let progress = match self.position.options.budget {
            Budget::Steps(steps) => number as f64 / steps as f64,
            Budget::Minutes(_) => self.progress(),
        };
        self.position.options.search_size(progress)
    }

    /// Runs one step: forward, backward, clip, update. Returns the losses, the norm of the gradient
    /// and the learning rate.
    fn step(
        &mut self,
        compute: &Compute,
        batch: crate::network::Batch,
    ) -> Result<(LossValues, f32, f32), Error> {
        let progress = self.progress();
        let options = &self.position.options;
        let parameters = &mut self.parameters;
        options.group(parameters, progress);
        parameters.clear_gradients();
        let mut tape = Tape::new(compute, parameters, Mode::Training);
        let (_, losses) = self.network.losses(&mut tape, batch, &options.losses);
        let values = losses.values(&tape).over(compute.processes());
        let diverged = |what: &str, found: f64| Error::Diverged {
            step: self.position.step,
            what: what.into(),
            found,
        };
        if let Some((name, value)) = values
            .named()
            .into_iter()
            .find(|(_, value)| !value.is_finite())
        {
            return Err(diverged(&format!("the loss {name}"), value));
        }
        tape.backward(losses.total);
        parameters.add_up(compute.processes());
        let limit = if options.clip > 0.0 {
            options.clip
        } else {
            f32::INFINITY
        };
        let norm = clip_gradients(compute, parameters, limit, |_| true);
        if !norm.is_finite() {
            return Err(diverged("the gradient's norm", f64::from(norm)));
        }
        let rate = options.rate(progress);
        self.optimizer.step(compute, parameters, rate);
        let keep = options.average;
        for (average, parameter) in self.averages.iter_mut().zip(parameters.iter()) {
            for (average, value) in average.data_mut().iter_mut().zip(parameter.value.data()) {
                *average = value + (*average - value) * keep;
            }
        }
        self.position.step += 1;
        Ok((values, norm, rate))
    }

    fn standing(&self, smooth: &Smooth, size: usize) -> Standing {
        let batch = self.position.options.batch as u64;
        Standing {
            step: self.position.step,
            pairs: self.position.step * batch,
            progress: self.progress(),
            seconds: self.position.seconds,
            speed: batch as f64 / smooth.seconds,
            losses: smooth.losses,
            size,
        }
    }

    /// Validates the present weights, and saves them if they are the best so far.
    fn validate(&mut self, run: &RunOptions, reporter: &mut Reporter) -> Result<Report, Error> {
        let report = run
            .validation
            .run(&self.export(Storage::F32, "validation", None)?, run.threads)?;
        reporter.say(&format!("step {}: {report}", self.position.step));
        reporter.log(json!({ "step": self.position.step, "validation": report }))?;
        reporter.draw()?;
        if let Some(score) = report
            .score()
            .filter(|score| self.position.best.is_none_or(|(best, _)| *score > best))
        {
            self.position.best = Some((score, self.position.step));
            let state = State {
                optimizer: Vec::new(),
                averages: Vec::new(),
                ..self.deployed_state()
            };
            let mut position = self.position.clone();
            position.options.average = 0.0;
            checkpoint::save(&run.out.join("best.safetensors"), &position, &state)?;
        }
        Ok(report)
    }

    /// Ends the run: deploys the averages if there are any, re-estimates batch statistics, keeps
    /// those if they are no worse, and writes `final.safetensors` (a checkpoint) and
    /// `weights.safetensors`.
    fn finish(
        &mut self,
        compute: &Compute,
        dataset: Arc<Dataset>,
        run: &RunOptions,
        reporter: &mut Reporter,
    ) -> Result<Option<Report>, Error> {
        for (parameter, average) in self
            .parameters
            .iter_mut()
            .zip(std::mem::take(&mut self.averages))
        {
            parameter.value = average;
        }
        self.position.options.average = 0.0;
        let checks = run.validates();
        let running = if checks {
            Some(self.validate(run, reporter)?)
        } else {
            None
        };
        let mut figures = running.clone();
        let count = self.position.options.estimation_batches;
        if count > 0 {
            let kept = self.parameters.clone();
            let part = Part::of(self.position.options.batch, compute.processes())?;
            let mut feed = Feed::new(dataset, part, ESTIMATION, run.data_threads, AHEAD);
            statistics::estimate(
                compute,
                &self.network,
                &mut self.parameters,
                &mut feed,
                count,
            );
            if let Some(running) = running {
                let estimated = self.validate(run, reporter)?;
                let better = estimated.score() >= running.score();
                let verdict = if better {
                    "kept"
                } else {
                    "worse than the running ones, not kept"
                };
                reporter.say(&format!("batch statistics from {count} batches: {verdict}"));
                if better {
                    figures = Some(estimated);
                } else {
                    self.parameters = kept;
                }
            }
        }
        self.position.finished = true;
        self.keep(run, "final.safetensors")?;
        if run.processes.is_first() {
            let weights = self.export(Storage::F32, "drmim", figures.as_ref())?;
            weights.write(&run.out.join("weights.safetensors"))?;
        }
        reporter.draw()?;
        Ok(figures)
    }

    fn deployed_state(&self) -> State {
        let deployed = self.deployed();
        let parameters = deployed
            .state()
            .map(|(name, tensor)| (name.to_owned(), tensor.clone()))
            .collect();
        State {
            parameters,
            ..State::default()
        }
    }

    /// The deployed parameters: the averages if the run keeps any.
    pub fn deployed(&self) -> Parameters {
        let mut parameters = self.parameters.clone();
        for (parameter, average) in parameters.iter_mut().zip(&self.averages) {
            parameter.value = average.clone();
        }
        parameters
    }
}

/// Threads to compute on.
///
/// # Errors
/// If they cannot be started.
pub fn compute(threads: usize) -> Result<Compute, Error> {
    Compute::new(threads)
        .map(Compute::with_winograd)
        .map_err(|error| Error::option("--threads", "threads that can be started", error))
}

fn entry(standing: &Standing, rate: f32, norm: f32, waited: f64) -> serde_json::Value {
    let losses: serde_json::Map<_, _> = standing
        .losses
        .named()
        .into_iter()
        .map(|(name, value)| (name.to_owned(), json!(value)))
        .collect();
    json!({
        "step": standing.step,
        "pairs": standing.pairs,
        "seconds": standing.seconds,
        "pairs_per_s": standing.speed,
        "size": standing.size,
        "rate": rate,
        "norm": norm,
        "waited": waited,
        "losses": losses,
    })
}

/// Smoothed losses and times.
#[derive(Default)]
struct Smooth {
    count: u64,
    losses: LossValues,
    seconds: f64, // per step
    waited: f64,  // seconds for data, in all
}

impl Smooth {
    fn add(&mut self, losses: &LossValues, seconds: f64, waited: f64) {
        self.count += 1;
        let share = (1.0 / self.count as f64).max(0.02);
        self.losses = self.losses.mixed(losses, share);
        self.seconds += (seconds - self.seconds) * share;
        self.waited += waited;
    }
}

/// Timers of checkpoint and validation.
struct Watch {
    checkpoint: Timer,
    validate: Timer,
}

struct Timer(f64);

impl Watch {
    fn new(seconds: f64) -> Watch {
        Watch {
            checkpoint: Timer(seconds),
            validate: Timer(seconds),
        }
    }
}

impl Timer {
    /// Whether `minutes` have passed since it was last due.
    fn due(&mut self, seconds: f64, minutes: f64) -> bool {
        let due = seconds - self.0 >= 60.0 * minutes;
        if due {
            self.0 = seconds;
        }
        due
    }
}
