//! Choice of the tracker's constants for given weights, by tracking.
//!
//! Five constants are chosen. The correction, the share of the first frame's error in size that is
//! taken out of later boxes, is the one with the highest IoU when a tracker that was initialized in
//! one frame is placed near the target in another one. The shares of the template update, of the
//! online filter in the score, of the change of aspect that the search region takes back, and of
//! the cells' vote are those with the highest AUC on whole sequences.

use crate::data::Dataset;
use crate::error::Error;
use crate::rng::Rng;
use crate::validate::{Report, Validation, sequence_of};
use std::collections::BTreeMap;
use track_cpu::{Isa, Model, TrackConfig, Tracker, TrackerOptions};
use weights_format::{TrackerParams, Weights};

/// First sample for tuning, far beyond all samples of training and calibration.
const FIRST: u64 = 1 << 46;

/// Shares that are tried.
pub const SHARES: [f64; 6] = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];

/// Updates on the second frame, after which the size has settled.
const LOOKS: usize = 3;

/// The mean IoU for each of [`SHARES`], over `pairs` pairs of frames of the data.
///
/// # Errors
/// If the weights are not those of a network that can run, or no target of the data is seen at two
/// moments.
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

/// Accuracy over sequences for each of [`SHARES`], as `set` puts it into the tracker's
/// hyper-parameters; `begins` hears of each share before its run.
///
/// # Errors
/// If the weights are not those of a network that can run.
pub fn over_sequences(
    weights: &Weights,
    sequences: &Validation,
    set: impl Fn(&mut TrackerParams, f64),
    begins: impl Fn(f64),
) -> Result<[Report; SHARES.len()], Error> {
    let mut weights = weights.clone();
    let mut reports = SHARES.map(|_| Report::default());
    for (share, report) in SHARES.into_iter().zip(&mut reports) {
        begins(share);
        set(&mut weights.header.tracker, share);
        *report = sequences.run(&weights, 2)?;
    }
    Ok(reports)
}

/// Mean AUC over sequences, each with the share that is best on all others; `None` for fewer than
/// two sequences.
///
/// Unlike the AUC of the best share, this figure is not chosen on the sequences on which it is
/// measured.
pub fn leave_one_out(reports: &[Report; SHARES.len()]) -> Option<f64> {
    // AUC of each sequence with each share.
    let mut table: BTreeMap<&str, [f64; SHARES.len()]> = BTreeMap::new();
    let mut passes: BTreeMap<&str, f64> = BTreeMap::new();
    for (k, report) in reports.iter().enumerate() {
        for (name, _, accuracy) in &report.clips {
            table.entry(sequence_of(name)).or_default()[k] += accuracy.auc;
            if k == 0 {
                *passes.entry(sequence_of(name)).or_default() += 1.0;
            }
        }
    }
    if table.len() < 2 {
        return None;
    }
    let mean = |name: &str, k: usize| table[name][k] / passes.get(name).copied().unwrap_or(1.0);
    let mut sum = 0.0;
    for name in table.keys() {
        let others = |k: usize| -> f64 {
            let others = table.keys().filter(|other| *other != name);
            others.map(|other| mean(other, k)).sum()
        };
        let best = (0..SHARES.len()).max_by(|a, b| others(*a).total_cmp(&others(*b)));
        sum += mean(name, best.unwrap_or(0));
    }
    Some(sum / table.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::DataOptions;
    use crate::fit::standard;
    use crate::validate::Accuracy;

    #[test]
    fn left_out_sequence_does_not_choose_its_own_share() {
        // Share number 1 is best for a alone, number 2 for both others.
        let auc = [
            ("a", [10.0, 90.0, 20.0]),
            ("b", [10.0, 20.0, 60.0]),
            ("c", [10.0, 20.0, 50.0]),
        ];
        let mut reports = SHARES.map(|_| Report::default());
        for (k, report) in reports.iter_mut().enumerate().take(3) {
            for (name, auc) in auc {
                for suffix in ["", ".middle"] {
                    let accuracy = Accuracy {
                        precision: 0.0,
                        auc: auc[k],
                    };
                    report
                        .clips
                        .push((format!("{name}{suffix}"), false, accuracy));
                }
            }
        }

        let found = leave_one_out(&reports).unwrap();

        // b and c are chosen for by a and one other: 90 + 20 against 20 + 50 or 60.
        assert!((found - (20.0 + 20.0 + 20.0) / 3.0).abs() < 1e-9, "{found}");
        assert_eq!(leave_one_out(&SHARES.map(|_| Report::default())), None);
    }

    #[test]
    fn correction_improves_boxes_of_a_biased_network() {
        // A network that says the same whatever it sees: only the first frame tells that not
        // everything has one size.
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
