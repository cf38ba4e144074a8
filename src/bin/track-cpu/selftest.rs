//! The network's outputs on one pair of crops against golden numbers, on every instruction set.

use track_cpu::net::{Network, Outputs};
use track_cpu::{Isa, Model, Precision};

/// Outputs of the built-in model on [`crops`]: index of a cell, its score, its four offsets, per
/// line.
const GOLDEN: &str = include_str!("golden.txt");

/// Largest deviation of a score accepted.
const SCORE_TOLERANCE: f32 = 2e-3;
/// Largest deviation of an offset accepted, as a share of it.
const OFFSET_TOLERANCE: f32 = 5e-3;
/// Every how many cells one is kept in the golden file.
const STEP: usize = 12;

/// How far one instruction set is from the golden numbers.
pub struct Outcome {
    /// Which one.
    pub isa: Isa,
    /// Largest deviation of a score.
    pub score: f32,
    /// Largest deviation of an offset, as a share of it.
    pub offset: f32,
}

impl Outcome {
    /// Whether that is close enough; a NaN never is.
    pub fn passed(&self) -> bool {
        self.score <= SCORE_TOLERANCE && self.offset <= OFFSET_TOLERANCE
    }
}

/// Runs the built-in model on every instruction set of this machine.
pub fn run() -> Vec<Outcome> {
    Isa::available()
        .into_iter()
        .map(|isa| compare(isa, &outputs(isa), GOLDEN))
        .collect()
}

/// The golden file as this machine's portable kernels would write it.
pub fn golden() -> String {
    let outputs = outputs(Isa::available()[0]);
    let mut text = String::new();
    for cell in (0..outputs.score.len()).step_by(STEP) {
        let ltrb = outputs.ltrb[4 * cell..][..4]
            .iter()
            .map(|v| format!(" {v:.5}"))
            .collect::<String>();
        text += &format!("{cell} {:.7}{ltrb}\n", outputs.score[cell]);
    }
    text
}

fn outputs(isa: Isa) -> Outputs {
    let (template, search) = crops();
    let model = Model::with_precision(&Model::builtin_weights(), isa, Precision::F32);
    let mut network = Network::new(
        model.expect("the built-in weights fit their architecture"),
        1,
    );
    network.set_template(&template);
    network.search(&search).clone()
}

fn compare(isa: Isa, outputs: &Outputs, golden: &str) -> Outcome {
    let mut outcome = Outcome {
        isa,
        score: 0.0,
        offset: 0.0,
    };
    if golden.lines().count() != outputs.score.len().div_ceil(STEP) {
        outcome.score = f32::NAN; // golden numbers of another network
    }
    for line in golden.lines() {
        let numbers: Vec<f32> = line
            .split(' ')
            .filter_map(|number| number.parse().ok())
            .collect();
        let cell = numbers.first().map_or(usize::MAX, |&cell| cell as usize);
        let found = (
            outputs.score.get(cell),
            outputs.ltrb.chunks_exact(4).nth(cell),
        );
        let (&[_, score, l, t, r, b], (Some(found_score), Some(found_ltrb))) =
            (numbers.as_slice(), found)
        else {
            outcome.score = f32::NAN;
            continue;
        };
        outcome.score = worse(outcome.score, (found_score - score).abs());
        for (found, expected) in found_ltrb.iter().zip([l, t, r, b]) {
            outcome.offset = worse(
                outcome.offset,
                (found - expected).abs() / expected.abs().max(1.0),
            );
        }
    }
    outcome
}

/// The larger one; unlike `f32::max` a NaN stays.
fn worse(a: f32, b: f32) -> f32 {
    if a >= b || a.is_nan() { a } else { b }
}

/// A template and a search crop, BGR: a car-like block on textured ground, made of integers only so
/// that it is the same on every machine.
fn crops() -> (Vec<u8>, Vec<u8>) {
    (crop(127, 63, 63), crop(303, 175, 135))
}

fn crop(side: i32, cx: i32, cy: i32) -> Vec<u8> {
    let mut bgr = Vec::with_capacity((3 * side * side) as usize);
    for y in 0..side {
        for x in 0..side {
            let (u, v) = (x - cx, y - cy);
            let noise = (x * 7919 + y * 104_729 + x * y * 31) % 23;
            bgr.extend(match (u.abs(), v.abs()) {
                (0..=20, 0..=11) if (4..=10).contains(&u) => {
                    [90, 70, 60].map(|c| (c + noise / 4) as u8)
                }
                (0..=20, 0..=11) => [50, 60, 205].map(|c| (c + noise) as u8),
                (0..=24, 0..=15) => [40, 52, 48].map(|c| (c + noise / 2) as u8),
                _ => {
                    let furrow = if (u + 2 * v).rem_euclid(24) < 12 {
                        0
                    } else {
                        14
                    };
                    [70, 118, 96].map(|c| (c + furrow + noise) as u8)
                }
            });
        }
    }
    bgr
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_instruction_set_agrees() {
        for outcome in run() {
            let (isa, score, offset) = (outcome.isa.name(), outcome.score, outcome.offset);
            assert!(outcome.passed(), "{isa}: score {score}, offset {offset}");
        }
    }

    #[test]
    fn notices_a_difference() {
        let isa = Isa::detect();
        let good = outputs(isa);
        let check = |change: &dyn Fn(&mut Outputs)| {
            let mut changed = good.clone();
            change(&mut changed);
            compare(isa, &changed, GOLDEN).passed()
        };
        assert!(check(&|_| {}));
        assert!(!check(&|o| o.score[STEP] += 0.01));
        assert!(!check(&|o| o.ltrb[4 * STEP + 2] *= 1.02));
        assert!(!check(&|o| o.ltrb[4 * STEP + 2] = f32::NAN));
        assert!(!check(&|o| o.score[STEP] = f32::NAN));
        assert!(!check(&|o| o.score.truncate(100)));
        assert!(!compare(isa, &good, "").passed());
    }
}
