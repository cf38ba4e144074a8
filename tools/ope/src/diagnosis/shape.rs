//! Whether boxes follow the target's shape.
//!
//! With the box `w x h` in a frame and `w0 x h0` in the pass's first frame, which is the truth's,
//! the change of aspect is `ln(w / h) - ln(w0 / h0)` and the change of size
//! `ln(sqrt(w h)) - ln(sqrt(w0 h0))`. [`Fit`] compares the box's changes with the truth's.

use crate::score::Evaluated;
use sequences::curves::mean;
use serde::Serialize;

/// Lower ends of the bins of change of aspect: 10 %, 28 % and 65 %.
const BINS: [f64; 4] = [0.0, 0.1, 0.25, 0.5];

/// One frame in which a box is on the target.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    /// Changes of aspect since the first frame: of the truth, of the box.
    aspect: [f64; 2],
    /// Changes of size since the first frame: of the truth, of the box.
    size: [f64; 2],
    /// Distance of the centers in sides of the truth (the root of its area).
    center_error: f64,
    iou: f64,
}

/// How boxes follow a target's changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Fit {
    /// Slope of the line through the origin of the box's changes over the truth's: 1 follows, 0
    /// keeps the first frame's; 0 if the truth never changes.
    pub slope: f64,
    /// Root mean square of the difference between the two.
    pub rmse: f64,
}

/// Boxes of one change of aspect.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Bin {
    /// Least change of aspect, as an absolute logarithm.
    pub from: f64,
    /// Frames.
    pub frames: usize,
    /// Their mean IoU; 0 without frames.
    pub mean_iou: f64,
}

/// How boxes follow the target's shape.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Shape {
    /// Fit of the change of aspect.
    pub aspect: Fit,
    /// Fit of the change of size.
    pub size: Fit,
    /// Mean distance of the centers in sides of the truth.
    pub center_error: f64,
    /// Mean IoU.
    pub mean_iou: f64,
    /// Mean IoU by change of aspect.
    pub by_aspect: Vec<Bin>,
}

/// The given frames of a pass, measured.
pub fn frames(pass: &Evaluated, frames: &[usize]) -> Vec<Frame> {
    let annotation = &pass.annotation;
    let Some(first) = annotation.boxes.first().filter(|first| first.is_usable()) else {
        return Vec::new();
    };
    let mut measured = Vec::with_capacity(frames.len());
    for &i in frames {
        let truth = annotation.boxes[i];
        let found = pass.boxes[i];
        let aspect = |rect: &sequences::Rect| (rect.w / rect.h).ln() - (first.w / first.h).ln();
        let size = |rect: &sequences::Rect| (rect.side() / first.side()).ln();
        let (dx, dy) = found.offset(&truth);
        measured.push(Frame {
            aspect: [aspect(&truth), aspect(&found)],
            size: [size(&truth), size(&found)],
            center_error: dx.hypot(dy) / truth.side(),
            iou: truth.iou(&found),
        });
    }
    measured
}

impl Fit {
    /// Fits pairs of changes: the truth's, then the box's.
    fn of(changes: impl Iterator<Item = [f64; 2]>) -> Fit {
        let mut products = 0.0;
        let mut squares = 0.0;
        let mut errors = 0.0;
        let mut count = 0;
        for [truth, found] in changes {
            products += truth * found;
            squares += truth * truth;
            errors += (found - truth).powi(2);
            count += 1;
        }
        Fit {
            slope: if squares > 0.0 {
                products / squares
            } else {
                0.0
            },
            rmse: (errors / f64::from(count.max(1))).sqrt(),
        }
    }
}

impl Shape {
    /// The figures as the cells of a table: slopes and deviations of aspect and size, the error of
    /// the center, the mean IoU, and the mean IoU of each bin, empty without frames.
    pub fn cells(&self) -> Vec<String> {
        let fits = [
            self.aspect.slope,
            self.aspect.rmse,
            self.size.slope,
            self.size.rmse,
        ];
        let means = [self.center_error, self.mean_iou];
        let mut cells: Vec<String> = fits.map(|value| format!("{value:.2}")).into();
        cells.extend(means.map(|value| format!("{value:.3}")));
        for bin in &self.by_aspect {
            cells.push(if bin.frames == 0 {
                String::new()
            } else {
                format!("{:.3}", bin.mean_iou)
            });
        }
        cells
    }

    /// The figures over all frames; zeros without frames.
    pub fn of(frames: impl IntoIterator<Item = Frame>) -> Shape {
        let frames: Vec<Frame> = frames.into_iter().collect();
        let mean_over = |of: fn(&Frame) -> f64| mean(frames.iter().map(of));
        let mut by_aspect = Vec::with_capacity(BINS.len());
        for (i, from) in BINS.into_iter().enumerate() {
            let to = BINS.get(i + 1).copied().unwrap_or(f64::INFINITY);
            let is_in = |frame: &&Frame| (from..to).contains(&frame.aspect[0].abs());
            let ious = frames.iter().filter(is_in).map(|frame| frame.iou);
            by_aspect.push(Bin {
                from,
                frames: ious.clone().count(),
                mean_iou: mean(ious),
            });
        }
        Shape {
            aspect: Fit::of(frames.iter().map(|frame| frame.aspect)),
            size: Fit::of(frames.iter().map(|frame| frame.size)),
            center_error: mean_over(|frame| frame.center_error),
            mean_iou: mean_over(|frame| frame.iou),
            by_aspect,
        }
    }
}
