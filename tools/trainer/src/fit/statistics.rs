//! Batch statistics estimated anew, as a plain mean over batches in place of a running one.

use super::batch::batch;
use crate::data::feed::Feed;
use crate::network::Network;
use autodiff::{Compute, Mode, Parameters, Tape};

/// Share of the batch in running statistics (spec section 1.1).
const MOMENTUM: f32 = 0.1;

/// Replaces the running statistics by their means over `count` batches of the feed. No parameter changes.
///
/// Where template and search branch share a normalisation, both count alike, as they do in training.
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
    parameters.iter_mut().for_each(|p| p.frozen = true); // no gradients, so nothing is recorded for them
    let kept: Vec<_> = parameters.iter().map(|p| p.is_statistic().then(|| p.value.clone())).collect();
    let mut sums: Vec<Vec<f64>> = parameters
        .iter()
        .map(|p| if p.is_statistic() { vec![0.0; p.value.data().len()] } else { vec![] })
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
        for (parameter, sum) in parameters.iter().zip(&mut sums).filter(|(p, _)| p.is_statistic()) {
            for (sum, value) in sum.iter_mut().zip(parameter.value.data()) {
                *sum += f64::from(*value);
            }
        }
    }
    // An update from 0 leaves the momentum's share of the batch's value; a second one adds its own to 0.9 of that.
    let layers = network.architecture().layers();
    for ((parameter, sum), kept) in parameters.iter_mut().zip(&sums).zip(kept) {
        let Some(kept) = kept else { continue };
        let both = layers.iter().any(|l| {
            l.branch == weights_format::Branch::Both && parameter.name().starts_with(&format!("{}.", l.name))
        });
        let runs = layers
            .iter()
            .find(|l| parameter.name().starts_with(&format!("{}.", l.name)))
            .map_or(0, |l| l.runs);
        let updates = runs * if both { 2 } else { 1 };
        if updates == 0 {
            parameter.value = kept; // of a network that is not deployed
            continue;
        }
        let weight = 1.0 - (1.0 - f64::from(MOMENTUM)).powi(updates as i32);
        for (value, sum) in parameter.value.data_mut().iter_mut().zip(sum) {
            *value = (sum / (weight * count as f64)) as f32;
        }
    }
    parameters.iter_mut().zip(frozen).for_each(|(p, frozen)| p.frozen = frozen);
}
