//! How networks are trained, and how runs behave.

use super::wrong;
use autodiff::OneProcess;
use clap::ValueEnum;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use trainer::Error;
use trainer::fit::{Budget, FitOptions, RunOptions, standard};
use trainer::network::StatisticsNets;
use trainer::validate::{Passes, Validation};
use weights_format::Architecture;

#[derive(Debug, clap::Args)]
pub struct Training {
    /// Default options: `cpu` (AdamW, from random weights, small search crops first) or `paper`
    /// (SGD, freezing).
    #[arg(long, value_enum, default_value_t = Preset::Cpu, help_heading = "Training")]
    pub preset: Preset,
    /// Length of the run in minutes of training.
    #[arg(long, conflicts_with_all = ["steps", "pairs"], help_heading = "Training")]
    pub minutes: Option<f64>,
    /// Length of the run in steps.
    #[arg(long, conflicts_with = "pairs", help_heading = "Training")]
    pub steps: Option<u64>,
    /// Length of the run in pairs.
    #[arg(long, help_heading = "Training")]
    pub pairs: Option<u64>,
    /// Pairs per step; under mpirun, of each process.
    #[arg(long, help_heading = "Training")]
    pub batch: Option<usize>,
    /// Highest learning rate.
    #[arg(long, help_heading = "Training")]
    pub rate: Option<f64>,
    /// Last learning rate.
    #[arg(long, help_heading = "Training")]
    pub floor_rate: Option<f64>,
    /// Share of the run in which the learning rate rises.
    #[arg(long, help_heading = "Training")]
    pub warmup_share: Option<f64>,
    /// Weight decay.
    #[arg(long, help_heading = "Training")]
    pub decay: Option<f32>,
    /// Largest norm of the gradient, 0 for no limit.
    #[arg(long, help_heading = "Training")]
    pub clip: Option<f32>,
    /// Decay of a running average of the weights, which is then deployed; 0 for no average.
    #[arg(long, help_heading = "Training")]
    pub average: Option<f32>,
    /// Side of the search crops in the first part of the run.
    #[arg(long, help_heading = "Training")]
    pub early_size: Option<usize>,
    /// Share of the run that is its first part.
    #[arg(long, help_heading = "Training")]
    pub early_share: Option<f64>,
    /// Batches from which batch statistics are re-estimated at the end; 0 keeps the running ones.
    #[arg(long, help_heading = "Training")]
    pub estimation_batches: Option<usize>,

    /// Widths, as the share of filters pruned from every layer of the full network [default: 0.5].
    #[arg(long, help_heading = "Network")]
    pub ratio: Option<f64>,
    /// Side of the search crops.
    #[arg(long, default_value_t = 303, help_heading = "Network")]
    pub search_size: usize,
    /// No encoders: plain SiamFC++.
    #[arg(long, help_heading = "Network")]
    pub no_encoder: bool,
    /// No mutual-information losses.
    #[arg(long, help_heading = "Network")]
    pub no_mi: bool,
    /// No identity loss.
    #[arg(long, help_heading = "Network")]
    pub no_identity: bool,
    /// Networks of the mutual-information losses [default: the preset's].
    #[arg(long, value_enum, help_heading = "Network")]
    pub statistics: Option<Statistics>,
}

#[derive(Debug, clap::Args)]
pub struct Behavior {
    /// Threads that compute, in each process [default: one per core].
    #[arg(long, help_heading = "Run")]
    pub threads: Option<usize>,
    /// Threads that make samples.
    #[arg(long, default_value_t = 1, help_heading = "Run")]
    pub data_threads: usize,
    /// Minutes of training between checkpoints.
    #[arg(long, default_value_t = 5.0, help_heading = "Run")]
    pub checkpoint_minutes: f64,
    /// A folder of sequences to validate on; may be given several times.
    #[arg(long, value_name = "DIR", help_heading = "Run")]
    pub validate: Vec<PathBuf>,
    /// Four passes over each sequence: from its first and middle frame forwards, from its last and
    /// middle frame backwards.
    #[arg(long, help_heading = "Run")]
    pub four_starts: bool,
    /// Rendered flights to validate on.
    #[arg(long, default_value_t = 0, help_heading = "Run")]
    pub validate_flights: usize,
    /// Most frames of each to track.
    #[arg(long, default_value_t = 80, help_heading = "Run")]
    pub validate_frames: usize,
}

/// Where training options begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// For hours on a few cores, from random weights.
    Cpu,
    /// The reference implementation's schedule, for a pretrained backbone.
    Paper,
}

/// Networks of the mutual-information losses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Statistics {
    /// The global one sees averages.
    Light,
    /// The global one sees whole maps.
    Full,
}

impl Training {
    /// How the network is trained that begins as `init`, if there is one, by a number of
    /// `processes`; `seed` decides first values.
    pub fn options(
        &self,
        init: Option<&Architecture>,
        seed: u64,
        processes: usize,
    ) -> Result<FitOptions, Error> {
        let mut options = match self.preset {
            Preset::Cpu => FitOptions::cpu(),
            Preset::Paper => FitOptions::paper(),
        };
        let architecture = match (self.ratio, init) {
            (None, Some(init)) => *init,
            (ratio, _) => standard(ratio_of("--ratio", ratio.unwrap_or(0.5))?),
        };
        options.architecture = Architecture {
            search_size: self.search_size,
            ..architecture
        };
        match self.statistics {
            Some(Statistics::Light) => options.statistics_nets = StatisticsNets::Light,
            Some(Statistics::Full) => options.statistics_nets = StatisticsNets::Full,
            None => {}
        }
        if self.no_encoder {
            options.architecture.encoder = None;
        }
        let encoder = options.architecture.encoder.is_some();
        if self.no_mi || !encoder {
            options.statistics_nets = StatisticsNets::None;
        }
        if self.no_identity || !encoder {
            options.losses.identity = 0.0;
        }
        fn set<T: Copy>(to: &mut T, value: Option<T>) {
            *to = value.unwrap_or(*to);
        }
        set(&mut options.batch, self.batch);
        options.batch = options.batch.saturating_mul(processes);
        set(&mut options.peak_rate, self.rate);
        set(&mut options.floor_rate, self.floor_rate);
        set(&mut options.warmup_share, self.warmup_share);
        set(&mut options.decay, self.decay);
        set(&mut options.clip, self.clip);
        set(&mut options.average, self.average);
        set(&mut options.early_size, self.early_size);
        set(&mut options.early_share, self.early_share);
        set(&mut options.estimation_batches, self.estimation_batches);
        let steps = self.steps.or(self
            .pairs
            .map(|pairs| pairs.div_ceil(options.batch.max(1) as u64)));
        set(
            &mut options.budget,
            self.minutes
                .map(Budget::Minutes)
                .or(steps.map(Budget::Steps)),
        );
        options.seed = seed;
        options.check()?;
        Ok(options)
    }
}

/// A share of filters, checked.
pub fn ratio_of(option: &str, ratio: f64) -> Result<f64, Error> {
    if (0.0..1.0).contains(&ratio) {
        Ok(ratio)
    } else {
        Err(wrong(option, "0 to below 1", &ratio))
    }
}

/// Passes over each sequence of the validation.
pub fn passes(four_starts: bool) -> Passes {
    if four_starts {
        Passes::Four
    } else {
        Passes::One
    }
}

impl Behavior {
    /// Threads that compute.
    pub fn threads(&self) -> usize {
        self.threads
            .unwrap_or_else(|| std::thread::available_parallelism().map_or(1, |n| n.get()))
    }

    /// How the run behaves.
    pub fn run_options(&self, out: &Path, validate_minutes: f64) -> Result<RunOptions, Error> {
        let minutes = |option: &str, value: f64| {
            if value >= 0.0 {
                Ok(value)
            } else {
                Err(wrong(option, "0 or more", &value))
            }
        };
        Ok(RunOptions {
            out: out.into(),
            processes: Arc::new(OneProcess),
            threads: self.threads(),
            data_threads: self.data_threads.clamp(1, 64),
            checkpoint_minutes: minutes("--checkpoint-minutes", self.checkpoint_minutes)?,
            validate_minutes: minutes("--validate-minutes", validate_minutes)?,
            validation: Validation::open(
                &self.validate,
                passes(self.four_starts),
                self.validate_flights,
                self.validate_frames,
            )?,
            stop_after: None,
        })
    }
}
