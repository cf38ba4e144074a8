//! Batch statistics from many batches: a plain mean in place of the running one, or statistics for
//! folded normalizations.

use super::batch::batch;
use crate::data::feed::Feed;
use crate::network::Network;
use autodiff::{Compute, Mode, Parameters, Tape};
use std::collections::BTreeMap;

/// Share of the batch in running statistics (docs/method.md, section 1.1).
const MOMENTUM: f32 = 0.1;

/// Replaces the running statistics by their means over `count` batches of the feed. No parameter
/// changes.
///
/// Where template and search branch share a normalization, both count alike, as they do in
/// training.
pub fn estimate(
    compute: &Compute,
    network: &Network,
    parameters: &mut Parameters,
    feed: &mut Feed,
    count: usize,
) {
    if count == 0 {
        return;
    }
    let frozen: Vec<bool> = parameters.iter().map(|p| p.frozen).collect();
    // Without gradients the tape records nothing for them.
    parameters.iter_mut().for_each(|p| p.frozen = true);
    let kept: Vec<_> = parameters
        .iter()
        .map(|p| p.is_statistic().then(|| p.value.clone()))
        .collect();
    let mut sums: Vec<Vec<f64>> = parameters
        .iter()
        .map(|p| {
            if p.is_statistic() {
                vec![0.0; p.value.data().len()]
            } else {
                vec![]
            }
        })
        .collect();
    let size = network.architecture().search_size;
    for _ in 0..count {
        for parameter in parameters.iter_mut().filter(|p| p.is_statistic()) {
            parameter.value.data_mut().fill(0.0);
        }
        let batch = batch(&feed.next(|_| size), network.architecture());
        let mut tape = Tape::new(compute, parameters, Mode::Training);
        network.predict(&mut tape, batch.template, batch.search);
        drop(tape);
        for (parameter, sum) in parameters
            .iter()
            .zip(&mut sums)
            .filter(|(p, _)| p.is_statistic())
        {
            for (sum, value) in sum.iter_mut().zip(parameter.value.data()) {
                *sum += f64::from(*value);
            }
        }
    }
    // An update from 0 leaves the momentum's share of the batch's value; a second one adds its own
    // to 0.9 of that.
    let layers = network.architecture().layers();
    for ((parameter, sum), kept) in parameters.iter_mut().zip(&sums).zip(kept) {
        let Some(kept) = kept else { continue };
        let both = layers.iter().any(|l| {
            l.branch == weights_format::Branch::Both
                && parameter.name().starts_with(&format!("{}.", l.name))
        });
        let deployed = layers
            .iter()
            .any(|l| parameter.name().starts_with(&format!("{}.", l.name)));
        if !deployed {
            parameter.value = kept;
            continue;
        }
        let updates = if both { 2 } else { 1 };
        let weight = 1.0 - (1.0 - f64::from(MOMENTUM)).powi(updates);
        for (value, sum) in parameter.value.data_mut().iter_mut().zip(sum) {
            *value = (sum / (weight * count as f64)) as f32;
        }
    }
    parameters
        .iter_mut()
        .zip(frozen)
        .for_each(|(p, frozen)| p.frozen = frozen);
}

/// Added to the variance (docs/method.md, section 1.1).
const EPSILON: f64 = 1e-5;

/// Sets every normalization to the mean and variance of `count` batches of the feed, and its scale
/// and shift such that its output stays the same. Expects normalizations that are the identity.
pub fn unfold(
    compute: &Compute,
    network: &Network,
    parameters: &mut Parameters,
    feed: &mut Feed,
    count: usize,
) {
    let frozen: Vec<bool> = parameters.iter().map(|p| p.frozen).collect();
    parameters.iter_mut().for_each(|p| p.frozen = true);
    // Count, sum and sum of squares per channel.
    let mut moments: BTreeMap<String, Vec<[f64; 3]>> = BTreeMap::new();
    for _ in 0..count {
        let batch = batch(
            &feed.next(|_| network.architecture().search_size),
            network.architecture(),
        );
        let mut tape = Tape::new(compute, parameters, Mode::Evaluation);
        for made in network.observe(&mut tape, batch.template, batch.search) {
            let maps = tape.value(made.convolved);
            let channels = maps.shape().last().copied().unwrap_or(1);
            let of_layer = moments
                .entry(made.layer)
                .or_insert_with(|| vec![[0.0; 3]; channels]);
            for pixel in maps.data().chunks_exact(channels) {
                for (moments, value) in of_layer.iter_mut().zip(pixel) {
                    let value = f64::from(*value);
                    *moments = [
                        moments[0] + 1.0,
                        moments[1] + value,
                        moments[2] + value * value,
                    ];
                }
            }
        }
    }
    for of_layer in moments.values_mut() {
        let own: Vec<f64> = of_layer.iter().flatten().copied().collect();
        let all = compute.processes().sums(&own);
        for (moments, all) in of_layer.iter_mut().zip(all.chunks_exact(3)) {
            moments.copy_from_slice(all);
        }
    }
    for (layer, moments) in moments
        .iter()
        .filter(|(layer, _)| !layer.starts_with("dr.e1."))
    {
        let mean: Vec<f64> = moments.iter().map(|m| m[1] / m[0]).collect();
        let variance: Vec<f64> = moments
            .iter()
            .zip(&mean)
            .map(|(m, mean)| (m[2] / m[0] - mean * mean).max(0.0))
            .collect();
        let deviation: Vec<f64> = variance
            .iter()
            .map(|variance| (variance + EPSILON).sqrt())
            .collect();
        for (part, found) in [
            ("mean", &mean),
            ("variance", &variance),
            ("scale", &deviation),
            ("shift", &mean),
        ] {
            if let Some(id) = parameters.find(&format!("{layer}.bn.{part}")) {
                let values = parameters[id].value.data_mut();
                values
                    .iter_mut()
                    .zip(found)
                    .for_each(|(value, found)| *value = *found as f32);
            }
        }
    }
    parameters
        .iter_mut()
        .zip(frozen)
        .for_each(|(p, frozen)| p.frozen = frozen);
}
