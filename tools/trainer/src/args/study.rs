//! `sweep` and `ablate`.

use super::training::ratio_of;
use super::{Behavior, Data, Training, wrong};
use std::path::PathBuf;
use trainer::Error;
use trainer::fit::{Budget, FitOptions};
use trainer::study::VARIANTS;

#[derive(Debug, clap::Args)]
pub struct Sweep {
    #[command(flatten)]
    pub data: Data,
    /// The folder for the runs, the table and the plot; started again, finished runs are skipped.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// The network to prune: a checkpoint, a weights file, or what `convert --to trainer` wrote.
    #[arg(long, value_name = "FILE")]
    pub init: PathBuf,
    /// Ratios: a list such as 0.5,0.6,0.75, or a range in steps of 0.1 such as 0.1..0.8.
    #[arg(long, default_value = "0.1..0.8")]
    pub ratios: String,
    /// Pairs of crops over which ranks are averaged.
    #[arg(long, default_value_t = 96)]
    pub rank_pairs: usize,
    #[command(flatten)]
    pub training: Training,
    #[command(flatten)]
    pub behavior: Behavior,
}

#[derive(Debug, clap::Args)]
pub struct Ablate {
    #[command(flatten)]
    pub data: Data,
    /// The folder for the runs, the table and the plot; started again, finished runs are skipped.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// A run of each variant for each of these seeds (in place of --seed).
    #[arg(long, value_delimiter = ',', default_values_t = [1, 2])]
    pub seeds: Vec<u64>,
    /// What to train: with everything, or without a part.
    #[arg(long, value_delimiter = ',', value_parser = VARIANTS, default_values = VARIANTS)]
    pub variants: Vec<String>,
    #[command(flatten)]
    pub training: Training,
    #[command(flatten)]
    pub behavior: Behavior,
}

/// Refuses a length in minutes: runs that are compared see the same number of pairs.
pub fn comparable(options: FitOptions) -> Result<FitOptions, Error> {
    match options.budget {
        Budget::Steps(_) => Ok(options),
        Budget::Minutes(_) => Err(wrong(
            "--pairs",
            "the pairs of every run",
            &"a length in minutes, or none",
        )),
    }
}

impl Sweep {
    /// The ratios.
    pub fn ratios(&self) -> Result<Vec<f64>, Error> {
        let expected = "ratios such as 0.5,0.6,0.75 or 0.1..0.8";
        let refused = || wrong("--ratios", expected, &self.ratios);
        let number = |text: &str| text.trim().parse::<f64>().map_err(|_| refused());
        let ratios = match self.ratios.split_once("..") {
            Some((first, last)) => {
                // Tenths as they are written, not as sums of 0.1.
                let tenth = |text: &str| -> Result<u32, Error> {
                    Ok((10.0 * ratio_of("--ratios", number(text)?)?).round() as u32)
                };
                (tenth(first)?..=tenth(last)?)
                    .map(|tenths| f64::from(tenths) / 10.0)
                    .collect()
            }
            None => self
                .ratios
                .split(',')
                .map(number)
                .collect::<Result<Vec<_>, _>>()?,
        };
        if ratios.is_empty() {
            return Err(refused());
        }
        ratios
            .into_iter()
            .map(|ratio| ratio_of("--ratios", ratio))
            .collect()
    }
}
