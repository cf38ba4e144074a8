//! Mean ranks of feature maps over crops of the data.

use crate::data::Dataset;
use crate::error::Error;
use crate::fit::{Fit, compute, crops_of};
use autodiff::{Mode, Tape, Tensor};
use kernels::gemm::Matrix;
use std::collections::BTreeMap;
use weights_format::{Storage, Weights};

/// The mean rank of each filter's feature map, by layer.
///
/// Maps are the input of the next layer: after ReLU, and after the pool if there is one. For a
/// layer that runs on template and search crops, both count alike.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Ranks {
    /// How many pairs of crops they are the means over.
    pub pairs: usize,
    by_layer: BTreeMap<String, Vec<f64>>,
}

/// Pairs that pass through the network at once.
const BATCH: usize = 4;

/// First pair for ranks, far beyond all training pairs.
const FIRST: u64 = 1 << 44;

impl Ranks {
    /// Ranks by the names of the weights format's layers, and `dr.e1.<i>`.
    pub fn new(pairs: usize, by_layer: BTreeMap<String, Vec<f64>>) -> Ranks {
        Ranks { pairs, by_layer }
    }

    /// Measures a network on `pairs` pairs of crops of the data.
    ///
    /// # Errors
    /// If a feature map is not finite, or the threads cannot be started.
    pub fn measure(
        fit: &Fit,
        dataset: &Dataset,
        pairs: usize,
        threads: usize,
    ) -> Result<Ranks, Error> {
        let compute = compute(threads)?;
        let architecture = *fit.network().architecture();
        let mut parameters = fit.deployed();
        parameters
            .iter_mut()
            .for_each(|parameter| parameter.frozen = true);
        let mut sums: BTreeMap<String, Sum> = BTreeMap::new();
        for start in (0..pairs).step_by(BATCH) {
            let numbers = start..pairs.min(start + BATCH);
            let samples: Vec<_> = numbers
                .map(|i| dataset.sample(FIRST + i as u64, architecture.search_size))
                .collect();
            let (template, search) = crops_of(&samples, &architecture);
            let mut tape = Tape::new(&compute, &mut parameters, Mode::Evaluation);
            for made in fit.network().observe(&mut tape, template, search) {
                let maps = tape.value(made.output);
                sums.entry(made.layer).or_default().add(maps, threads);
            }
        }
        // What conv1 and conv2 made is seen behind the pool.
        for i in [1, 2] {
            if let Some(pooled) = sums.remove(&format!("backbone.pool{i}")) {
                sums.insert(format!("backbone.conv{i}"), pooled);
            }
        }
        let mut by_layer = BTreeMap::new();
        for (layer, sum) in sums {
            let ranks = sum.mean().ok_or_else(|| Error::Diverged {
                step: fit.position().step,
                what: format!("a feature map of {layer}"),
                found: f64::NAN,
            })?;
            by_layer.insert(layer, ranks);
        }
        Ok(Ranks { pairs, by_layer })
    }

    /// The mean ranks of a layer's filters.
    pub fn of(&self, layer: &str) -> Option<&[f64]> {
        self.by_layer.get(layer).map(|ranks| &ranks[..])
    }
}

/// Ranks of a layer's maps, added up by filter.
#[derive(Debug, Default)]
struct Sum {
    maps: usize,             // per filter
    ranks: Vec<Option<u64>>, // none if a map was not finite
}

impl Sum {
    /// Adds the ranks of maps `[batch, H, W, C]`.
    fn add(&mut self, maps: &Tensor, threads: usize) {
        let [batch, h, w, channels] = maps.shape()[..] else {
            return;
        };
        self.ranks.resize(channels, Some(0));
        self.maps += batch;
        let rank = |image: usize, channel: usize| {
            let pixels = &maps.data()[image * h * w * channels..][..h * w * channels];
            let map: Vec<f32> = pixels[channel..]
                .iter()
                .step_by(channels)
                .copied()
                .collect();
            Matrix::new(&map, h, w).rank()
        };
        let part = channels.div_ceil(threads.max(1)).max(1);
        std::thread::scope(|scope| {
            for (start, sums) in self.ranks.chunks_mut(part).enumerate() {
                scope.spawn(move || {
                    for (i, sum) in sums.iter_mut().enumerate() {
                        for image in 0..batch {
                            *sum = sum
                                .zip(rank(image, start * part + i))
                                .map(|(sum, rank)| sum + rank as u64);
                        }
                    }
                });
            }
        });
    }

    fn mean(&self) -> Option<Vec<f64>> {
        self.ranks
            .iter()
            .map(|sum| Some((*sum)? as f64 / self.maps.max(1) as f64))
            .collect()
    }
}

/// The L1 norm of every filter with its normalization folded in, by layer.
///
/// # Errors
/// If a weight is not finite.
pub fn norms(fit: &Fit) -> Result<BTreeMap<String, Vec<f64>>, Error> {
    let weights: Weights = fit.export(Storage::F32, "", None)?;
    let norms = weights.tensors().filter_map(|(name, tensor)| {
        let layer = name.strip_suffix(".weight")?;
        let per_filter = tensor.data.len() / tensor.shape[0].max(1);
        let norm = |filter: &[f32]| filter.iter().map(|v| f64::from(v.abs())).sum();
        Some((
            layer.to_owned(),
            tensor
                .data
                .chunks_exact(per_filter.max(1))
                .map(norm)
                .collect(),
        ))
    });
    Ok(norms.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_maps_have_their_ranks() {
        // Filter 0 is dead, filter 1 constant, filter 2 the identity matrix in the first image and
        // constant in the second.
        let value = |image: usize, y: usize, x: usize, c: usize| match (c, image) {
            (0, _) => 0.0,
            (2, 0) => f32::from(u8::from(x == y)),
            _ => 3.0,
        };
        let mut values = Vec::new();
        for (image, y) in (0..2).flat_map(|image| (0..5).map(move |y| (image, y))) {
            values.extend((0..5 * 3).map(|i| value(image, y, i / 3, i % 3)));
        }
        let maps = Tensor::new(&[2, 5, 5, 3], values);
        for threads in [1, 2, 7] {
            let mut sum = Sum::default();
            sum.add(&maps, threads);
            assert_eq!(sum.mean().unwrap(), [0.0, 1.0, 3.0]);
            sum.add(&Tensor::zeros(&[2, 4, 4, 3]), threads);
            assert_eq!(sum.mean().unwrap(), [0.0, 0.5, 1.5]);
            sum.add(&Tensor::full(&[1, 4, 4, 3], f32::NAN), threads);
            assert_eq!(sum.mean(), None);
        }
    }
}
