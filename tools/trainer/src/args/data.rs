//! Data to train on.

use super::wrong;
use trainer::Error;
use trainer::data::augment::Augment;
use trainer::data::pairs::PairRules;
use trainer::data::spec::DataSpec;
use trainer::data::{DataOptions, Dataset};

/// Data to train on.
#[derive(Debug, clap::Args)]
pub struct Data {
    /// A source of pairs and its share of them: an annotation file (CSV, JSON) or a folder of
    /// sequences, `scenes`, `patches:PATH`, `paste:PATH`. Several sources are mixed.
    #[arg(long = "data", value_name = "WHAT[:SHARE]")]
    pub data: Vec<String>,
    /// Decides everything random.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Changes between the crops of a pair: none, light, strong, or shape (stretch, bent targets,
    /// touching neighbors).
    #[arg(long, default_value = "strong")]
    pub augment: String,
    /// How much more often a second frame is drawn that shows the target in another aspect or size,
    /// or much later [default: 3 with --augment shape, else 0: all frames alike].
    #[arg(long)]
    pub variety: Option<f32>,
    /// Share of pairs whose template is another target's.
    #[arg(long, default_value_t = 0.1)]
    pub negatives: f32,
    /// Largest gap between the two frames of a pair.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub max_gap: u32,
    /// Choose pairs as video_analyst does: any later frame, boxes of any size.
    #[arg(long)]
    pub compat: bool,
    /// Memory for decoded pictures, in GiB.
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
            .ok_or_else(|| wrong("--augment", "none, light, strong or shape", &self.augment))?;
        let variety = self
            .variety
            .unwrap_or(if self.augment == "shape" { 3.0 } else { 0.0 });
        if !(0.0..=100.0).contains(&variety) {
            return Err(wrong("--variety", "0 to 100", &variety));
        }
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
            rules: PairRules {
                max_gap: self.max_gap,
                compat: self.compat,
                variety,
                ..PairRules::default()
            },
            cache_bytes: (self.cache_gib * f64::from(1 << 30)) as usize,
            ..DataOptions::default()
        })
    }
}
