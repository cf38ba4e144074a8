//! Why a tracker scores as it does: whether its boxes follow the target's shape, and how it loses
//! the target.
//!
//! AUC adds up two kinds of error. A box may be on the target and not follow its shape ([`shape`]),
//! or it may end on something else ([`losses`]). Shape is measured on the frames in which every
//! tracker of the comparison is on the target, so that a tracker gains nothing by losing the hard
//! ones.
//!
//! A tracker is *on* the target where the boxes overlap by at least [`ON`], and *off* it below
//! [`OFF`]. The first frame of a pass is given and does not count.

pub mod losses;
pub mod shape;
pub mod sheet;

pub use losses::{Cause, Loss};
pub use shape::{Fit, Shape};

use crate::compare::Comparison;
use crate::score::Evaluated;
use sequences::Rect;
use serde::Serialize;

/// Least overlap of a box that is on the target.
pub const ON: f64 = 0.2;
/// Overlap below which a box is off the target.
pub const OFF: f64 = 0.1;

/// The diagnoses of several trackers on one benchmark.
#[derive(Clone, Debug, Serialize)]
pub struct Diagnosis {
    /// The rule of precision and AUC.
    pub rule: &'static str,
    /// Frames in which every tracker is on the target.
    pub common_frames: usize,
    /// Visible frames, the first of each pass excluded.
    pub visible_frames: usize,
    /// One per tracker.
    pub trackers: Vec<Diagnosed>,
}

/// The shape of one tracker's boxes, and its losses.
#[derive(Clone, Debug, Serialize)]
pub struct Diagnosed {
    /// The tracker's name.
    pub tracker: String,
    /// Precision at 20 pixels in percent.
    pub precision: f64,
    /// Area under the success curve in percent.
    pub auc: f64,
    /// Share of the visible frames in which it is on the target, in percent.
    pub on_target: f64,
    /// How its boxes follow the target's shape in the common frames.
    pub shape: Shape,
    /// Its losses of the target.
    pub losses: Vec<Loss>,
}

/// Diagnoses all trackers of a comparison.
pub fn diagnose(comparison: &Comparison) -> Diagnosis {
    let common = common_frames(comparison);
    let mut trackers = Vec::new();
    for (evaluation, score) in comparison.trackers.iter().zip(&comparison.scores) {
        let passes = evaluation.sequences.iter().zip(&common);
        let shape = Shape::of(passes.flat_map(|(pass, frames)| shape::frames(pass, frames)));
        let losses: Vec<Loss> = evaluation.sequences.iter().flat_map(losses::of).collect();
        let overlaps: Vec<f64> = evaluation.sequences.iter().flat_map(overlaps).collect();
        let on = overlaps.iter().filter(|overlap| **overlap >= ON).count();
        trackers.push(Diagnosed {
            tracker: evaluation.tracker.clone(),
            precision: score.precision,
            auc: score.auc,
            on_target: 100.0 * on as f64 / overlaps.len().max(1) as f64,
            shape,
            losses,
        });
    }
    let first = comparison.trackers.first();
    let visible = first.map_or(0, |e| e.sequences.iter().flat_map(overlaps).count());
    Diagnosis {
        rule: comparison.convention.name(),
        common_frames: common.iter().map(Vec::len).sum(),
        visible_frames: visible,
        trackers,
    }
}

/// The overlap in every visible frame after the first; 0 where the tracker has no box.
fn overlaps(pass: &Evaluated) -> impl Iterator<Item = f64> + '_ {
    visible_frames(pass).map(|i| overlap(pass, i))
}

/// The frames after the first that show the target.
fn visible_frames(pass: &Evaluated) -> impl Iterator<Item = usize> + '_ {
    (1..pass.annotation.boxes.len()).filter(|i| pass.annotation.is_visible(*i))
}

/// The overlap in frame `i`; 0 where the tracker has no usable box.
fn overlap(pass: &Evaluated, i: usize) -> f64 {
    let found = pass.boxes.get(i).copied().unwrap_or(Rect::NONE);
    if found.is_usable() {
        pass.annotation.boxes[i].iou(&found)
    } else {
        0.0
    }
}

/// For every pass, the frames in which all trackers are on the target.
fn common_frames(comparison: &Comparison) -> Vec<Vec<usize>> {
    let Some(first) = comparison.trackers.first() else {
        return Vec::new();
    };
    let is_on = |pass: usize, i: usize| {
        let of = |evaluation: &crate::Evaluation| overlap(&evaluation.sequences[pass], i) >= ON;
        comparison.trackers.iter().all(of)
    };
    let mut common = Vec::with_capacity(first.sequences.len());
    for (pass, evaluated) in first.sequences.iter().enumerate() {
        common.push(
            visible_frames(evaluated)
                .filter(|i| is_on(pass, *i))
                .collect(),
        );
    }
    common
}

#[cfg(test)]
mod tests;
