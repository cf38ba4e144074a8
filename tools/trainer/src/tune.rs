//! The tracker's constants that suit weights, by tracking itself.
//!
//! Three are measured. The share of the first frame's error that is taken out of later boxes: a tracker is given a target in one
//! frame and put near it in another one; the share with which its boxes lie best is the weights' own. The share of the
//! target's later looks in the template, and the online filter's share in the score: those with which whole sequences are tracked best.

use crate::data::Dataset;
use crate::error::Error;
use crate::rng::Rng;
use crate::validate::Validation;
use track_cpu::{Isa, Model, TrackConfig, Tracker, TrackerOptions};
use weights_format::{TrackerParams, Weights};

/// Samples for tuning are far behind all that are trained or calibrated on.
const FIRST: u64 = 1 << 46;

/// Shares that are tried.
pub const SHARES: [f64; 6] = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];

/// Times that the second frame is shown: until the size has settled.
const LOOKS: usize = 3;

/// The mean IoU for each of [`SHARES`], over `pairs` pairs of frames of the data.
///
/// # Errors
/// If the weights are not those of a network that can run, or no target of the data is seen at two moments.
pub fn correction(
    weights: &Weights,
    dataset: &Dataset,
    pairs: u64,
) -> Result<[f64; SHARES.len()], Error> {
    let model = Model::from_weights(weights, Isa::detect())?;
    let mut sums = [0.0; SHARES.len()];
    for index in FIRST..FIRST + pairs {
        let (first, second) = dataset.moments(index).ok_or_else(|| {
            Error::option(
                "--data",
                "targets that are seen at two moments",
                dataset.sources().join(", "),
            )
        })?;
        let truth = second.bbox;
        let mut rng = Rng::new(dataset.options().seed, 0x70e5, index);
        let mut near = truth.center();
        near.cx += truth.w * rng.range(-0.2, 0.2);
        near.cy += truth.h * rng.range(-0.2, 0.2);
        let stretch = rng.factor(0.1);
        (near.w, near.h) = (near.w * stretch, near.h * stretch);
        for (share, sum) in SHARES.into_iter().zip(&mut sums) {
            let config = TrackConfig {
                correction: share,
                ..model.config()
            };
            let mut tracker = Tracker::with_options(
                model.clone(),
                TrackerOptions {
                    config,
                    ..TrackerOptions::of(&model)
                },
            );
            tracker.init(&first.picture.frame(), first.bbox)?;
            tracker.place(near);
            let mut found = truth;
            for _ in 0..LOOKS {
                found = tracker.update(&second.picture.frame())?.bbox;
            }
            *sum += f64::from(found.iou(&truth));
        }
    }
    Ok(sums.map(|sum| sum / pairs as f64))
}

/// The AUC over sequences for each of [`SHARES`], as `set` puts it into the tracker's hyper-parameters.
///
/// # Errors
/// If the weights are not those of a network that can run.
pub fn over_sequences(
    weights: &Weights,
    sequences: &Validation,
    set: impl Fn(&mut TrackerParams, f64),
) -> Result<[f64; SHARES.len()], Error> {
    let mut weights = weights.clone();
    let mut quality = [0.0; SHARES.len()];
    for (share, auc) in SHARES.into_iter().zip(&mut quality) {
        set(&mut weights.header.tracker, share);
        *auc = sequences.run(&weights, 2)?.score().unwrap_or(0.0);
    }
    Ok(quality)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::DataOptions;
    use crate::fit::standard;

    #[test]
    fn boxes_of_a_network_that_errs_are_mended() {
        // A network that says the same whatever it sees: only the first frame tells that not everything has one size.
        let mut weights = Weights::random(standard(0.9), 3);
        for (name, bias) in [
            ("head.score", 3.0),
            ("head.centerness", 3.0),
            ("head.offsets", 1.5),
        ] {
            for (part, value) in [("weight", 0.0), ("bias", bias)] {
                let name = format!("{name}.{part}");
                let mut tensor = weights.tensor(&name).expect("a layer").clone();
                tensor.data.fill(value);
                weights.insert(name, tensor);
            }
        }
        let options = DataOptions {
            seed: 1,
            ..DataOptions::default()
        };
        let dataset = Dataset::open(&["scenes".parse().unwrap()], options).unwrap();
        let found = correction(&weights, &dataset, 4).unwrap();
        assert!(found[5] > found[0] + 0.05, "{found:?}");
        assert_eq!(found, correction(&weights, &dataset, 4).unwrap());
    }
}
