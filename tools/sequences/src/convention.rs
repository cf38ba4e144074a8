//! The rules by which toolkits count. They differ on frames where a box is missing.
//!
//! | case | got10k | pysot | OTB | drop |
//! |---|---|---|---|---|
//! | result of the first frame | the annotation | as in the file | the annotation | the annotation |
//! | annotation has a NaN | not counted | no overlap, error -1: a *hit* | as pysot | not counted |
//! | annotation without area | as it is | as NaN | as NaN | not counted |
//! | annotation with x or y of 0 or less | as it is | no overlap | no overlap, error -1 | as it is |
//! | result NaN or without area | as it is | as it is | the previous frame's | as it is |
//! | no result | a miss | a miss | a miss | a miss |
//! | list of absent frames | not used | no hit, but counted | not used | not used |
//!
//! pysot takes the error wherever the annotation's *center* is above 0 in both coordinates, OTB
//! only where all four numbers are. Source: the got10k toolkit 0.1.3, pysot's `statistics.py`,
//! OTB's `calcSeqErrRobust.m`. The toolkits cut annotations to the length of short results, so that
//! a tracker that crashed scores as well as a perfect one; here a frame without a result is a miss.

use crate::annotation::Annotation;
use crate::curves::{Curves, Judgment, PRECISION_BINS, QUOTED_PRECISION};
use crate::rect::Rect;
use std::borrow::Cow;

/// A rule by which frames are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Convention {
    /// The got10k toolkit: annotations with NaN do not count. Normalized precision follows LaSOT
    /// and is the curve's mean.
    Got10k,
    /// pysot: every frame counts. Normalized precision at 0.20.
    Pysot,
    /// The Matlab code of OTB and UAV123: every frame counts, and the previous frame's box replaces
    /// an unusable result.
    Otb,
    /// As got10k, and annotations without area do not count either: the rule of some published
    /// figures on DTB70.
    Drop,
}

impl Convention {
    /// All of them, the default first.
    pub const ALL: [Convention; 4] = [
        Convention::Got10k,
        Convention::Pysot,
        Convention::Otb,
        Convention::Drop,
    ];

    /// Its name in options, tables and JSON.
    pub fn name(self) -> &'static str {
        match self {
            Convention::Got10k => "got10k",
            Convention::Pysot => "pysot",
            Convention::Otb => "otb",
            Convention::Drop => "drop",
        }
    }

    /// The curves of one sequence; `None` if no frame counts.
    ///
    /// An annotated frame without a result is a miss. Results after the last annotation do not
    /// count.
    pub fn curves(self, annotation: &Annotation, result: &[Rect]) -> Option<Curves> {
        let judgments = self.judge(annotation, result);
        let counted = match self {
            Convention::Got10k | Convention::Drop => judgments.iter().flatten().count(),
            Convention::Pysot | Convention::Otb => judgments.len(),
        };
        Curves::of(judgments.into_iter().flatten(), counted)
    }

    /// The judgment of each annotated frame; `None` where the frame does not count.
    pub fn judge(self, annotation: &Annotation, result: &[Rect]) -> Vec<Option<Judgment>> {
        let result = self.repaired(annotation, result);
        let mut judgments = Vec::with_capacity(annotation.boxes.len());
        for (i, annotated) in annotation.boxes.iter().enumerate() {
            let judgment = match result.get(i) {
                Some(found) => self.judge_frame(annotated, found, annotation.scale),
                None => Judgment::MISS,
            };
            judgments.push(self.counts(annotation, i).then_some(judgment));
        }
        judgments
    }

    /// Normalized precision: the curve's mean where the toolkit follows LaSOT, otherwise its value
    /// at 0.20.
    pub fn norm_precision(self, curves: &Curves) -> f64 {
        match self {
            Convention::Got10k | Convention::Drop => {
                curves.norm_precision.iter().sum::<f64>() / PRECISION_BINS as f64
            }
            Convention::Pysot | Convention::Otb => curves.norm_precision[QUOTED_PRECISION],
        }
    }

    /// The results after this rule has replaced the boxes it does not use.
    fn repaired<'a>(self, annotation: &Annotation, result: &'a [Rect]) -> Cow<'a, [Rect]> {
        let first = match annotation.boxes.first() {
            Some(first) if self != Convention::Pysot && !result.is_empty() => *first,
            _ => return Cow::Borrowed(result),
        };
        let mut repaired = result.to_vec();
        repaired[0] = first;
        if self == Convention::Otb {
            for i in 1..repaired.len().min(annotation.boxes.len()) {
                let found = repaired[i];
                let unusable = found.has_nan() || found.w <= 0.0 || found.h <= 0.0;
                if unusable && !annotation.boxes[i].has_nan() {
                    repaired[i] = repaired[i - 1];
                }
            }
        }
        Cow::Owned(repaired)
    }

    /// Whether the judgment of frame `i` counts.
    fn counts(self, annotation: &Annotation, i: usize) -> bool {
        let annotated = &annotation.boxes[i];
        match self {
            Convention::Got10k => !annotated.has_nan(),
            Convention::Drop => !annotated.has_nan() && annotated.w > 0.0 && annotated.h > 0.0,
            Convention::Pysot => annotation.is_present(i),
            Convention::Otb => true,
        }
    }

    fn judge_frame(self, annotated: &Rect, found: &Rect, scale: f64) -> Judgment {
        let (dx, dy) = found.offset(annotated);
        let (w, h) = match self {
            Convention::Got10k | Convention::Drop => (annotated.w.max(1.0), annotated.h.max(1.0)),
            Convention::Pysot => (annotated.w + 1e-16, annotated.h + 1e-16),
            Convention::Otb => (annotated.w, annotated.h),
        };
        let all_positive =
            annotated.x > 0.0 && annotated.y > 0.0 && annotated.w > 0.0 && annotated.h > 0.0;
        let (has_overlap, has_error) = match self {
            Convention::Got10k | Convention::Drop => (true, true),
            Convention::Pysot => {
                let (cx, cy) = annotated.center();
                (all_positive, cx > 0.0 && cy > 0.0)
            }
            Convention::Otb => (all_positive, all_positive),
        };
        let or_failure = |known: bool, value: f64| if known { value } else { -1.0 };
        Judgment {
            overlap: or_failure(has_overlap, annotated.iou(found)),
            error: or_failure(has_error, dx.hypot(dy) / scale),
            norm_error: or_failure(
                self.has_norm_error(annotated, has_error),
                (dx / w).hypot(dy / h),
            ),
        }
    }

    /// Whether the normalized error is known. pysot asks this of the normalized center, whose sign
    /// changes with that of the width.
    fn has_norm_error(self, annotated: &Rect, has_error: bool) -> bool {
        if self != Convention::Pysot {
            return has_error;
        }
        let (cx, cy) = annotated.center();
        cx / (annotated.w + 1e-16) > 0.0 && cy / (annotated.h + 1e-16) > 0.0
    }
}

#[cfg(test)]
mod tests;
