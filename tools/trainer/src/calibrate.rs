//! Calibration for int8: ranges of the convolutions' inputs, measured on crops.
//!
//! The range of a layer's input minimizes the mean squared error. It is the sum of rounding,
//! `step^2 / 12` for each value inside, and of clipping outside. A few outliers would make 256
//! steps coarse, so both ends are drawn in as long as the error falls.

use crate::data::Dataset;
use crate::error::Error;
use std::collections::BTreeMap;
use track_cpu::net::Network;
use track_cpu::{Isa, Model, Precision};
use weights_format::{Calibration, Range, Weights};

/// First sample for calibration, far beyond all training samples.
const FIRST: u64 = 1 << 45;

/// Bins of a histogram.
const BINS: usize = 2048;

/// Measures the input of every convolution on `pairs` pairs of crops of the data.
///
/// # Errors
/// If the weights are not those of a network that can run, or a value is not finite.
pub fn calibrate(weights: &Weights, dataset: &Dataset, pairs: u64) -> Result<Calibration, Error> {
    let model = Model::with_precision(weights, Isa::detect(), Precision::F32)?;
    let mut network = Network::new(model, 1);
    let mut ends: BTreeMap<String, (f32, f32)> = BTreeMap::new();
    each_input(&mut network, dataset, pairs, &mut |name, values| {
        let (low, high) = ends.entry(name.into()).or_default();
        for value in values {
            (*low, *high) = (low.min(*value), high.max(*value));
        }
    });
    let mut histograms: BTreeMap<String, Histogram> = BTreeMap::new();
    for (name, (low, high)) in ends {
        if !(low.is_finite() && high.is_finite()) {
            let what = format!("an input of {name}");
            return Err(Error::Diverged {
                step: 0,
                what,
                found: f64::from(low),
            });
        }
        histograms.insert(name, Histogram::new(low, high));
    }
    each_input(&mut network, dataset, pairs, &mut |name, values| {
        if let Some(histogram) = histograms.get_mut(name) {
            values.iter().for_each(|value| histogram.add(*value));
        }
    });
    let sources = dataset.sources().join(", ");
    Ok(Calibration {
        method: format!("least mean squared error over {pairs} pairs of crops of {sources}"),
        inputs: histograms
            .into_iter()
            .map(|(name, histogram)| (name, histogram.best()))
            .collect(),
    })
}

/// Runs crops through the network and passes the input of every convolution in both branches to a
/// visitor.
fn each_input(
    network: &mut Network,
    dataset: &Dataset,
    pairs: u64,
    see: &mut dyn FnMut(&str, &[f32]),
) {
    let search_size = network.model().architecture().search_size;
    for i in 0..pairs {
        let sample = dataset.sample(FIRST + i, search_size);
        let template_only = |name: &str| name.contains("template");
        let search_only = |name: &str| name.contains("search") || name.starts_with("head.");
        network.set_template(&sample.template);
        for (name, map) in network
            .inputs()
            .into_iter()
            .filter(|(name, _)| !search_only(name))
        {
            see(&name, map.values());
        }
        network.search(&sample.search);
        for (name, map) in network
            .inputs()
            .into_iter()
            .filter(|(name, _)| !template_only(name))
        {
            see(&name, map.values());
        }
    }
}

/// A histogram of values from `low` to `high`.
struct Histogram {
    low: f32,
    high: f32,
    counts: Vec<u64>,
}

impl Histogram {
    fn new(low: f32, high: f32) -> Histogram {
        Histogram {
            low,
            high: high.max(low + 1e-6),
            counts: vec![0; BINS],
        }
    }

    fn width(&self) -> f64 {
        f64::from(self.high - self.low) / BINS as f64
    }

    fn add(&mut self, value: f32) {
        let bin = (f64::from(value - self.low) / self.width()) as usize;
        self.counts[bin.min(BINS - 1)] += 1;
    }

    /// The range with the least error.
    fn best(&self) -> Range {
        let shares = || (5..=20).map(|share| share as f32 / 20.0);
        let lows = if self.low < 0.0 {
            shares().collect()
        } else {
            vec![1.0]
        };
        let ranges = lows.iter().flat_map(|low| {
            shares().map(move |high| Range {
                low: low * self.low,
                high: (high * self.high).max(1e-6),
            })
        });
        let best = ranges.min_by(|a, b| self.error(a).total_cmp(&self.error(b)));
        best.expect("there are shares to choose from")
    }

    /// Sum of the squared errors of all values.
    fn error(&self, range: &Range) -> f64 {
        let step = f64::from(range.high - range.low) / 255.0;
        let cost = |bin: usize| {
            let value = f64::from(self.low) + (bin as f64 + 0.5) * self.width();
            let outside = (value - f64::from(range.high))
                .max(f64::from(range.low) - value)
                .max(0.0);
            outside * outside
                + if outside > 0.0 {
                    0.0
                } else {
                    step * step / 12.0
                }
        };
        self.counts
            .iter()
            .enumerate()
            .map(|(bin, count)| *count as f64 * cost(bin))
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::DataOptions;
    use crate::fit::standard;

    #[test]
    fn range_is_clipped_only_if_the_error_falls() {
        let mut even = Histogram::new(-1.0, 1.0);
        (0..10_000).for_each(|i| even.add(i as f32 / 5000.0 - 1.0));
        assert_eq!(
            even.best(),
            Range {
                low: -1.0,
                high: 1.0
            }
        );
        let mut outlier = Histogram::new(0.0, 100.0);
        (0..1_000_000).for_each(|i| outlier.add((i % 100) as f32 / 100.0));
        outlier.add(100.0);
        let Range { low, high } = outlier.best();
        assert!(low == 0.0 && high < 100.0, "{low} {high}");
    }

    #[test]
    fn calibration_covers_all_but_first_and_last_convolutions() {
        let weights = Weights::random(standard(0.9), 3);
        let options = DataOptions {
            seed: 1,
            ..DataOptions::default()
        };
        let dataset = Dataset::open(&["scenes".parse().unwrap()], options).unwrap();
        let calibration = calibrate(&weights, &dataset, 2).unwrap();
        let names: Vec<_> = calibration.inputs.keys().map(String::as_str).collect();
        assert_eq!(names.len(), 4 + 1 + 4 + 6, "{names:?}");
        assert!(calibration.inputs["head.cls2"].low == 0.0, "behind a ReLU");
        assert!(calibration.inputs["dr.e2.0"].low < 0.0, "conv5 has none");
        let mut weights = weights;
        weights.header.calibration = Some(calibration);
        Model::with_precision(&weights, Isa::detect(), Precision::Int8).unwrap();
    }
}
