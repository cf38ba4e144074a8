//! The command line.

use clap::{Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use trainer::Error;
use trainer::data::augment::Augment;
use trainer::data::pairs::PairRules;
use trainer::data::spec::DataSpec;
use trainer::data::{DataOptions, Dataset};
use trainer::fit::{Budget, FitOptions, RunOptions, standard};
use trainer::network::StatisticsNets;
use trainer::validate::Validation;
use weights_format::Architecture;

/// Train, prune and export the DR-MIM tracker
#[derive(Debug, Parser)]
#[command(version)]
pub struct Args {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Train a network, from nothing or from a checkpoint
    Fit(Box<Fit>),
    /// Write a checkpoint's network as a weights file
    Export(Export),
    /// Write contact sheets of sampled pairs
    Show(Show),
}

/// What to train on
#[derive(Debug, clap::Args)]
pub struct Data {
    /// A source of pairs and its share of them: an annotation file (CSV, JSON) or a folder of sequences, `scenes`,
    /// `patches:PATH`, `paste:PATH`; give it several times to mix
    #[arg(long = "data", value_name = "WHAT[:SHARE]")]
    pub data: Vec<String>,
    /// Decides everything random
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// What is changed about the crops: none, light or strong
    #[arg(long, default_value = "strong")]
    pub augment: String,
    /// Share of pairs whose template is another target's
    #[arg(long, default_value_t = 0.1)]
    pub negatives: f32,
    /// Most frames between the two of a pair
    #[arg(long, default_value_t = 100)]
    pub max_gap: u32,
    /// Choose pairs as video_analyst does: every later frame, boxes of any share of the frame
    #[arg(long)]
    pub compat: bool,
    /// Memory for decoded pictures, in GiB
    #[arg(long, default_value_t = 8.0)]
    pub cache_gib: f64,
}

impl Data {
    /// Opens the sources.
    pub fn open(&self) -> Result<Dataset, Error> {
        let specs: Result<Vec<DataSpec>, _> = self.data.iter().map(|text| text.parse()).collect();
        Dataset::open(&specs?, self.options()?)
    }

    /// How pairs are made.
    pub fn options(&self) -> Result<DataOptions, Error> {
        let augment = Augment::from_name(&self.augment)
            .ok_or_else(|| wrong("--augment", "none, light or strong", &self.augment))?;
        if !(0.0..=1.0).contains(&self.negatives) {
            return Err(wrong("--negatives", "a share from 0 to 1", &self.negatives));
        }
        if !(0.0..=1024.0).contains(&self.cache_gib) {
            return Err(wrong("--cache-gib", "0 to 1024", &self.cache_gib));
        }
        Ok(DataOptions {
            seed: self.seed,
            negatives: self.negatives,
            augment,
            rules: PairRules { max_gap: self.max_gap, compat: self.compat, ..PairRules::default() },
            cache_bytes: (self.cache_gib * f64::from(1 << 30)) as usize,
            ..DataOptions::default()
        })
    }
}

#[derive(Debug, clap::Args)]
pub struct Fit {
    #[command(flatten)]
    pub data: Data,
    /// The folder for checkpoints, log, curves and weights
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Go on with the run of this checkpoint; everything but the run's behaviour comes from it
    #[arg(long, value_name = "CKPT", conflicts_with_all = ["data", "init"])]
    pub resume: Option<PathBuf>,
    /// Begin with the parameters of this checkpoint, as far as they fit
    #[arg(long, value_name = "CKPT")]
    pub init: Option<PathBuf>,

    /// Where options begin: `cpu` (AdamW, from nothing, small search crops first) or `paper` (SGD, freezing)
    #[arg(long, value_enum, default_value_t = Preset::Cpu, help_heading = "Training")]
    pub preset: Preset,
    /// Length of the run in minutes of training
    #[arg(long, conflicts_with_all = ["steps", "pairs"], help_heading = "Training")]
    pub minutes: Option<f64>,
    /// Length of the run in steps
    #[arg(long, conflicts_with = "pairs", help_heading = "Training")]
    pub steps: Option<u64>,
    /// Length of the run in pairs
    #[arg(long, help_heading = "Training")]
    pub pairs: Option<u64>,
    /// Pairs per step
    #[arg(long, help_heading = "Training")]
    pub batch: Option<usize>,
    /// Highest learning rate
    #[arg(long, help_heading = "Training")]
    pub rate: Option<f64>,
    /// Last learning rate
    #[arg(long, help_heading = "Training")]
    pub floor_rate: Option<f64>,
    /// Share of the run in which the learning rate rises
    #[arg(long, help_heading = "Training")]
    pub warmup_share: Option<f64>,
    /// Weight decay
    #[arg(long, help_heading = "Training")]
    pub decay: Option<f32>,
    /// Largest norm of the gradient, 0 for no limit
    #[arg(long, help_heading = "Training")]
    pub clip: Option<f32>,
    /// Share of the old in a running average of the weights, which then is what is deployed; 0 for none
    #[arg(long, help_heading = "Training")]
    pub average: Option<f32>,
    /// Side of the search crops in the first part of the run
    #[arg(long, help_heading = "Training")]
    pub early_size: Option<usize>,
    /// Share of the run that is its first part
    #[arg(long, help_heading = "Training")]
    pub early_share: Option<f64>,
    /// Batches from which batch statistics are estimated anew at the end, 0 to keep the running ones
    #[arg(long, help_heading = "Training")]
    pub estimation_batches: Option<usize>,

    /// Widths: share of the filters that pruning took from every layer of the full network
    #[arg(long, default_value_t = 0.5, help_heading = "Network")]
    pub ratio: f64,
    /// Side of the search crops
    #[arg(long, default_value_t = 303, help_heading = "Network")]
    pub search_size: usize,
    /// No encoders: SiamFC++ as it is
    #[arg(long, help_heading = "Network")]
    pub no_encoder: bool,
    /// No mutual-information losses
    #[arg(long, help_heading = "Network")]
    pub no_mi: bool,
    /// No identity loss
    #[arg(long, help_heading = "Network")]
    pub no_identity: bool,
    /// Networks of the mutual-information losses [default: the preset's]
    #[arg(long, value_enum, help_heading = "Network")]
    pub statistics: Option<Statistics>,

    /// Threads that compute [default: one per core]
    #[arg(long, help_heading = "Run")]
    pub threads: Option<usize>,
    /// Threads that make samples
    #[arg(long, default_value_t = 1, help_heading = "Run")]
    pub data_threads: usize,
    /// Minutes of training between checkpoints
    #[arg(long, default_value_t = 5.0, help_heading = "Run")]
    pub checkpoint_minutes: f64,
    /// A folder of sequences to validate on; may be given several times
    #[arg(long, value_name = "DIR", help_heading = "Run")]
    pub validate: Vec<PathBuf>,
    /// Rendered flights to validate on
    #[arg(long, default_value_t = 0, help_heading = "Run")]
    pub validate_flights: usize,
    /// Most frames of each to track
    #[arg(long, default_value_t = 80, help_heading = "Run")]
    pub validate_frames: usize,
    /// Minutes of training between validations
    #[arg(long, default_value_t = 30.0, help_heading = "Run")]
    pub validate_minutes: f64,
}

/// Where training options begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Preset {
    /// For hours on a few cores, from nothing
    Cpu,
    /// The reference implementation's schedule, for a pretrained backbone
    Paper,
}

/// Networks of the mutual-information losses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Statistics {
    /// The global one sees averages
    Light,
    /// The global one sees whole maps
    Full,
}

impl Fit {
    /// How the network is trained.
    pub fn options(&self) -> Result<FitOptions, Error> {
        let mut options = match self.preset {
            Preset::Cpu => FitOptions::cpu(),
            Preset::Paper => FitOptions::paper(),
        };
        if !(0.0..1.0).contains(&self.ratio) {
            return Err(wrong("--ratio", "0 to below 1", &self.ratio));
        }
        options.architecture = Architecture { search_size: self.search_size, ..standard(self.ratio) };
        match self.statistics {
            Some(Statistics::Light) => options.statistics_nets = StatisticsNets::Light,
            Some(Statistics::Full) => options.statistics_nets = StatisticsNets::Full,
            None => {}
        }
        if self.no_encoder {
            options.architecture.encoder = None;
        }
        if self.no_mi || self.no_encoder {
            options.statistics_nets = StatisticsNets::None;
        }
        if self.no_identity || self.no_encoder {
            options.losses.identity = 0.0;
        }
        fn set<T: Copy>(to: &mut T, value: Option<T>) {
            *to = value.unwrap_or(*to);
        }
        set(&mut options.batch, self.batch);
        set(&mut options.peak_rate, self.rate);
        set(&mut options.floor_rate, self.floor_rate);
        set(&mut options.warmup_share, self.warmup_share);
        set(&mut options.decay, self.decay);
        set(&mut options.clip, self.clip);
        set(&mut options.average, self.average);
        set(&mut options.early_size, self.early_size);
        set(&mut options.early_share, self.early_share);
        set(&mut options.estimation_batches, self.estimation_batches);
        let steps = self.steps.or(self.pairs.map(|pairs| pairs.div_ceil(options.batch.max(1) as u64)));
        set(&mut options.budget, self.minutes.map(Budget::Minutes).or(steps.map(Budget::Steps)));
        options.seed = self.data.seed;
        options.check()?;
        Ok(options)
    }

    /// How the run behaves.
    pub fn run_options(&self) -> Result<RunOptions, Error> {
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        let minutes = |option: &str, value: f64| match value >= 0.0 {
            true => Ok(value),
            false => Err(wrong(option, "0 or more", &value)),
        };
        Ok(RunOptions {
            out: self.out.clone(),
            threads: self.threads.unwrap_or(cores),
            data_threads: self.data_threads.clamp(1, 64),
            checkpoint_minutes: minutes("--checkpoint-minutes", self.checkpoint_minutes)?,
            validate_minutes: minutes("--validate-minutes", self.validate_minutes)?,
            validation: Validation::open(&self.validate, self.validate_flights, self.validate_frames)?,
            stop_after: None,
        })
    }
}

#[derive(Debug, clap::Args)]
pub struct Export {
    /// The checkpoint
    pub checkpoint: PathBuf,
    /// The weights file to write; replaced if it exists
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Type of the weights in the file (biases are always f32)
    #[arg(long, value_enum, default_value_t = Dtype::F16)]
    pub dtype: Dtype,
    /// Name of the model
    #[arg(long, default_value = "drmim")]
    pub name: String,
    /// Folders of sequences whose accuracy goes into the file
    #[arg(long, value_name = "DIR")]
    pub validate: Vec<PathBuf>,
    /// Most frames of each to track
    #[arg(long, default_value_t = 100_000)]
    pub validate_frames: usize,
}

/// Type of the weights in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Dtype {
    /// Half precision: half the size, a relative error of about 0.0002
    F16,
    /// Single precision
    F32,
}

fn wrong(option: &str, expected: &str, found: &dyn ToString) -> Error {
    Error::Option { option: option.into(), expected: expected.into(), found: found.to_string() }
}

#[derive(Debug, clap::Args)]
pub struct Show {
    #[command(flatten)]
    pub data: Data,
    /// The folder to write to
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Side of the search crops
    #[arg(long, default_value_t = 303)]
    pub search_size: usize,
    /// How many sheets, of 24 pairs each
    #[arg(long, default_value_t = 1)]
    pub sheets: usize,
    /// Number of the first sample
    #[arg(long, default_value_t = 0)]
    pub first: u64,
}
