//! How a network is trained.

use crate::error::Error;
use crate::network::{Init, LossOptions, StatisticsNets};
use autodiff::Parameters;
use autodiff::optim::{AdamW, Optimizer, Sgd, WarmupCosine};
use serde::{Deserialize, Serialize};
use weights_format::{Architecture, Encoder, Widths};

/// How long training goes on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Budget {
    /// Number of steps.
    Steps(u64),
    /// Minutes of steps, without validation and saving. A resumed run has the same length but not
    /// the same bits, since speed varies.
    Minutes(f64),
}

/// Optimizer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OptimizerKind {
    /// Adam with decoupled weight decay on convolution weights.
    AdamW,
    /// SGD with momentum 0.9 and weight decay on everything.
    Sgd,
}

/// Everything that determines a training run, together with its data.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FitOptions {
    /// Widths, encoder, crop sizes.
    pub architecture: Architecture,
    /// Networks of the mutual-information loss.
    pub statistics_nets: StatisticsNets,
    /// Initialization of the parameters.
    pub init: Init,
    /// Weights of the losses.
    pub losses: LossOptions,
    /// Optimizer.
    #[serde(alias = "optimiser")]
    pub optimizer: OptimizerKind,
    /// Highest learning rate.
    pub peak_rate: f64,
    /// Last learning rate.
    pub floor_rate: f64,
    /// Share of the run in which the rate rises.
    pub warmup_share: f64,
    /// Weight decay.
    pub decay: f32,
    /// Factor on the backbone's learning rate.
    pub backbone_rate: f32,
    /// Whether backbone convolutions are frozen and thawed one by one (docs/method.md, section
    /// 3.5).
    pub freeze: bool,
    /// Largest norm of the gradient; larger ones are scaled down. 0 for no limit.
    pub clip: f32,
    /// Pairs per step, of all processes together; at least 2.
    pub batch: usize,
    /// Length of the run.
    pub budget: Budget,
    /// Side of the search crops in the first part of the run.
    pub early_size: usize,
    /// Share of the run that is its first part.
    pub early_share: f64,
    /// Decay of the running average of the weights; 0 for no average.
    pub average: f32,
    /// Batches from which batch statistics are re-estimated at the end; 0 keeps the running ones.
    pub estimation_batches: usize,
    /// Seed of the initialization.
    pub seed: u64,
}

impl FitOptions {
    /// Preset for hours on a few cores from random weights: AdamW, no freezing, small search crops
    /// first.
    pub fn cpu() -> FitOptions {
        FitOptions {
            architecture: standard(0.5),
            statistics_nets: StatisticsNets::Light,
            init: Init::Kaiming,
            losses: LossOptions::default(),
            optimizer: OptimizerKind::AdamW,
            peak_rate: 6e-4,
            floor_rate: 3e-6,
            warmup_share: 0.03,
            decay: 0.05,
            backbone_rate: 1.0,
            freeze: false,
            clip: 10.0,
            batch: 16,
            budget: Budget::Minutes(60.0),
            early_size: 239,
            early_share: 0.5,
            average: 0.0,
            estimation_batches: 25,
            seed: 0,
        }
    }

    /// The reference implementation's schedule (docs/method.md, section 3.5): for a pretrained
    /// backbone.
    pub fn paper() -> FitOptions {
        FitOptions {
            statistics_nets: StatisticsNets::Full,
            init: Init::Paper,
            losses: LossOptions {
                min_iou: f32::MIN_POSITIVE,
                max_exponent: f32::MAX,
                ..LossOptions::default()
            },
            optimizer: OptimizerKind::Sgd,
            peak_rate: 0.08,
            floor_rate: 1e-6,
            warmup_share: 0.05, // one epoch of 20
            decay: 5e-5,
            backbone_rate: 0.1,
            freeze: true,
            clip: 0.0,
            batch: 32,
            budget: Budget::Steps(20 * 12_500),
            early_share: 0.0,
            estimation_batches: 0,
            ..FitOptions::cpu()
        }
    }

    /// Checks the options.
    ///
    /// # Errors
    /// Names the first option that is out of range.
    pub fn check(&self) -> Result<(), Error> {
        let within = |option: &str, value: f64, low: f64, high: f64| {
            if (low..=high).contains(&value) {
                return Ok(());
            }
            Err(Error::option(option, format!("{low} to {high}"), value))
        };
        for (option, size) in [
            ("--search-size", self.architecture.search_size),
            ("--early-size", self.early_size),
        ] {
            let architecture = Architecture {
                search_size: size,
                ..self.architecture
            };
            architecture
                .check()
                .map_err(|error| match error.field.as_str() {
                    "search_size" => Error::option(option, error.expected, error.found),
                    _ => error.into(),
                })?;
        }
        within("--batch", self.batch as f64, 2.0, 1024.0)?;
        within("--rate", self.peak_rate, 0.0, 10.0)?;
        within("--floor-rate", self.floor_rate, 0.0, 10.0)?;
        within("--warmup-share", self.warmup_share, 0.0, 1.0)?;
        within("--decay", f64::from(self.decay), 0.0, 1.0)?;
        within("--clip", f64::from(self.clip), 0.0, f64::from(f32::MAX))?;
        within("--early-share", self.early_share, 0.0, 1.0)?;
        within("--average", f64::from(self.average), 0.0, 0.999_999)?;
        within(
            "--estimation-batches",
            self.estimation_batches as f64,
            0.0,
            1e5,
        )?;
        match self.budget {
            Budget::Steps(steps) => within("--steps", steps as f64, 1.0, 1e12),
            Budget::Minutes(minutes) => within("--minutes", minutes, 1e-3, 1e6),
        }
    }

    /// Learning rate at a progress from 0 to 1.
    pub fn rate(&self, progress: f64) -> f32 {
        const FINE: f64 = 1e9; // the schedule counts whole steps; these are fine enough for any run
        let fine = |share: f64| (share.clamp(0.0, 1.0) * FINE) as usize;
        let start = if self.warmup_share > 0.0 {
            self.floor_rate.min(self.peak_rate)
        } else {
            self.peak_rate
        };
        let schedule = WarmupCosine {
            start,
            peak: self.peak_rate,
            floor: self.floor_rate,
            warmup: fine(self.warmup_share),
            total: fine(1.0),
        };
        schedule.rate(fine(progress))
    }

    /// Side of the search crops at a progress from 0 to 1.
    pub fn search_size(&self, progress: f64) -> usize {
        if progress < self.early_share {
            self.early_size
        } else {
            self.architecture.search_size
        }
    }

    /// A fresh optimizer.
    pub fn optimizer(&self) -> Box<dyn Optimizer> {
        match self.optimizer {
            OptimizerKind::AdamW => Box::new(AdamW::default()),
            OptimizerKind::Sgd => Box::new(Sgd::new(0.9)),
        }
    }

    /// Sets rate, decay and freezing of every parameter at a progress from 0 to 1.
    pub fn group(&self, parameters: &mut Parameters, progress: f64) {
        let epoch = (progress * 20.0) as usize;
        for parameter in parameters.iter_mut() {
            let name = parameter.name();
            let backbone = name.starts_with("backbone.");
            let convolution = !name.contains(".bn.");
            let weights = name.ends_with(".weight") && !name.starts_with("mi.");
            let thaws = |layer: &str| match layer {
                "conv5" => 5,
                "conv4" => 10,
                "conv3" => 15,
                _ => usize::MAX,
            };
            let layer = name.split('.').nth(1).unwrap_or_default();
            let frozen = self.freeze && backbone && convolution && epoch < thaws(layer);
            let decays = self.optimizer == OptimizerKind::Sgd || weights;
            parameter.rate = if backbone { self.backbone_rate } else { 1.0 };
            parameter.decay = if decays { self.decay } else { 0.0 };
            parameter.frozen = frozen;
        }
    }
}

/// DR-MIM pruned by one ratio, with the standard encoder.
pub fn standard(ratio: f64) -> Architecture {
    let widths = Widths::pruned(ratio);
    Architecture::new(widths, Some(Encoder::standard(widths.backbone[4])))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::Network;

    #[test]
    fn schedules_have_the_rates_of_the_method() {
        let paper = FitOptions::paper();
        // Steps 6250, 12500, 62500 + 12500 .. of 250000 (docs/method.md, section 3.5).
        for (step, rate) in [
            (6250, 0.0400005),
            (12_500, 0.08),
            (62_500, 0.0715657),
            (131_250, 0.0400005),
        ] {
            let found = f64::from(paper.rate(f64::from(step) / 250_000.0));
            assert!(
                (found / rate - 1.0).abs() < 1e-4,
                "step {step}: {found}, expected {rate}"
            );
        }
        let cpu = FitOptions::cpu();
        assert!((cpu.rate(0.03) - 6e-4).abs() < 1e-8 && (cpu.rate(1.0) - 3e-6).abs() < 1e-9);
        assert!((cpu.rate(0.015) - 3e-4).abs() < 3e-6);
    }

    #[test]
    fn early_share_of_the_run_has_small_search_crops() {
        let cpu = FitOptions::cpu();
        assert_eq!(
            [0.0, 0.49, 0.5, 1.0].map(|p| cpu.search_size(p)),
            [239, 239, 303, 303]
        );
        assert_eq!(FitOptions::paper().search_size(0.0), 303);
    }

    #[test]
    fn parameter_groups_have_their_rates_and_decays() {
        let names =
            |options: &FitOptions, progress: f64, select: &dyn Fn(&autodiff::Parameter) -> bool| {
                let mut parameters = Parameters::new();
                Network::new(
                    &mut parameters,
                    options.architecture,
                    options.statistics_nets,
                )
                .unwrap();
                options.group(&mut parameters, progress);
                let chosen = parameters.iter().filter(|p| !p.is_statistic() && select(p));
                chosen.map(|p| p.name().to_owned()).collect::<Vec<_>>()
            };
        let (cpu, paper) = (FitOptions::cpu(), FitOptions::paper());
        let decayed = names(&cpu, 0.0, &|p| p.decay > 0.0);
        assert!(
            decayed.contains(&"backbone.conv1.weight".into())
                && decayed.contains(&"dr.e1.0.weight".into())
        );
        assert!(
            decayed
                .iter()
                .all(|n| n.ends_with(".weight") && !n.starts_with("mi.") && !n.contains("bn"))
        );
        assert!(names(&cpu, 0.0, &|p| p.frozen || p.rate != 1.0).is_empty());
        assert!(names(&paper, 0.0, &|p| p.decay == 0.0).is_empty());
        for (epoch, frozen) in [
            (0.0, 10),
            (4.9, 10),
            (5.0, 8),
            (10.0, 6),
            (15.0, 4),
            (20.0, 4),
        ] {
            assert_eq!(
                names(&paper, epoch / 20.0, &|p| p.frozen).len(),
                frozen,
                "epoch {epoch}"
            );
        }
        let slow = names(&paper, 0.0, &|p| p.rate != 1.0);
        assert!(
            slow.len() == 20 && slow.iter().all(|n| n.starts_with("backbone.")),
            "{slow:?}"
        );
    }

    #[test]
    fn options_out_of_range_are_refused() {
        FitOptions::cpu().check().unwrap();
        FitOptions::paper().check().unwrap();
        let with = |change: &dyn Fn(&mut FitOptions)| {
            let mut options = FitOptions::cpu();
            change(&mut options);
            options.check().unwrap_err().to_string()
        };
        assert!(with(&|o| o.batch = 1).contains("--batch"));
        assert!(with(&|o| o.peak_rate = f64::NAN).contains("--rate"));
        assert!(with(&|o| o.early_size = 100).contains("--early-size"));
        assert!(with(&|o| o.architecture.search_size = 1025).contains("--search-size"));
        assert!(with(&|o| o.warmup_share = -0.1).contains("--warmup-share"));
        assert!(with(&|o| o.budget = Budget::Steps(0)).contains("--steps"));
    }
}
