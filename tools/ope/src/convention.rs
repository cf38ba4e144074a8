//! The rules by which toolkits count: they differ on rows where a box is missing.
//!
//! | case | got10k | pysot | OTB | drop |
//! |---|---|---|---|---|
//! | result of the first frame | the annotation | as in the file | the annotation | the annotation |
//! | annotation has a NaN | frame dropped | no overlap, error -1: a precision *hit* | as pysot | frame dropped |
//! | annotation without area | used as it is | as NaN | as NaN | frame dropped |
//! | annotation with x or y of 0 or less | used as it is | no overlap | no overlap, error -1 | used as it is |
//! | result NaN or without area | used as it is | used as it is | the previous frame's | used as it is |
//! | list of absent frames | not used | dropped, but still divided by | not used | not used |
//!
//! pysot takes the error wherever the annotation's *center* is above 0 in both coordinates, OTB only where all four
//! numbers are. Source: the got10k toolkit 0.1.3, pysot's `statistics.py`, OTB's `calcSeqErrRobust.m`.

use crate::annotations::Annotation;
use crate::bbox::BBox;
use crate::curves::Curves;
use std::borrow::Cow;

/// A rule by which frames are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Convention {
    /// The got10k toolkit: annotations with NaN do not count. Normalized precision as LaSOT: the curve's mean.
    Got10k,
    /// pysot: every frame counts. Normalized precision at 0.20.
    Pysot,
    /// The Matlab code of OTB and UAV123: every frame counts, unusable results are the previous frame's.
    Otb,
    /// As got10k, and annotations without area do not count either: the rule of some published DTB70 figures.
    Drop,
}

/// How one frame was hit. Under some rules -1 stands for "not comparable": no overlap, and any error threshold holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judgment {
    /// Intersection over union.
    pub overlap: f64,
    /// Distance of the centers in pixels of the original video.
    pub error: f64,
    /// The same with each component divided by the annotated width or height.
    pub norm_error: f64,
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

    /// The curves of one sequence, `None` if no frame counts; frames that only one of the two has do not.
    pub fn curves(self, annotation: &Annotation, result: &[BBox]) -> Option<Curves> {
        let frames = annotation.boxes.len().min(result.len());
        let judgments = self.judge(annotation, result);
        let counted = match self {
            Convention::Got10k | Convention::Drop => judgments.iter().flatten().count(),
            Convention::Pysot | Convention::Otb => frames,
        };
        Curves::of(judgments.into_iter().flatten(), counted)
    }

    /// How each frame was hit, `None` where it does not count: as many as both have.
    pub fn judge(self, annotation: &Annotation, result: &[BBox]) -> Vec<Option<Judgment>> {
        let result = self.repaired(annotation, result);
        let pairs = annotation.boxes.iter().zip(result.iter());
        let judge = |(i, (annotated, found)): (usize, (&BBox, &BBox))| {
            self.counts(annotation, i)
                .then(|| self.judge_frame(annotated, found, annotation.scale))
        };
        pairs.enumerate().map(judge).collect()
    }

    /// The results as this rule reads them.
    fn repaired<'a>(self, annotation: &Annotation, result: &'a [BBox]) -> Cow<'a, [BBox]> {
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

    /// Whether frame `i` is looked at.
    fn counts(self, annotation: &Annotation, i: usize) -> bool {
        let annotated = &annotation.boxes[i];
        match self {
            Convention::Got10k => !annotated.has_nan(),
            Convention::Drop => !annotated.has_nan() && annotated.w > 0.0 && annotated.h > 0.0,
            Convention::Pysot => annotation.is_present(i),
            Convention::Otb => true,
        }
    }

    fn judge_frame(self, annotated: &BBox, found: &BBox, scale: f64) -> Judgment {
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

    /// Whether the normalized error is known: pysot asks it of the normalized center, which has the other sign if the
    /// width is below 0.
    fn has_norm_error(self, annotated: &BBox, has_error: bool) -> bool {
        if self != Convention::Pysot {
            return has_error;
        }
        let (cx, cy) = annotated.center();
        cx / (annotated.w + 1e-16) > 0.0 && cy / (annotated.h + 1e-16) > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAN: BBox = BBox::new(f64::NAN, f64::NAN, f64::NAN, f64::NAN);
    const GOOD: BBox = BBox::new(10.0, 10.0, 20.0, 20.0);
    const FAR: BBox = BBox::new(200.0, 10.0, 20.0, 20.0);

    fn annotation(boxes: &[BBox]) -> Annotation {
        Annotation {
            name: "a".into(),
            boxes: boxes.to_vec(),
            present: None,
            scale: 1.0,
        }
    }

    /// Precision, and success at overlap above 0, under each rule in the order of `ALL`.
    fn rates(annotated: &[BBox], found: &[BBox]) -> [Option<(f64, f64)>; 4] {
        let annotation = annotation(annotated);
        Convention::ALL.map(|rule| {
            rule.curves(&annotation, found)
                .map(|c| (c.precision(), c.success[0]))
        })
    }

    #[test]
    fn perfect() {
        let boxes = [GOOD, FAR, BBox::new(50.5, 60.25, 30.0, 7.0)];
        for rule in Convention::ALL {
            let curves = rule.curves(&annotation(&boxes), &boxes).unwrap();
            assert!((curves.auc() - 20.0 / 21.0).abs() < 1e-12, "{rule:?}");
            assert_eq!(curves.precision[0], 1.0);
            assert_eq!(curves.norm_precision(rule), 1.0);
        }
    }

    #[test]
    fn first_row_is_given_except_in_pysot() {
        let all = rates(&[GOOD, GOOD], &[FAR, GOOD]);
        assert_eq!(
            all,
            [
                Some((1.0, 1.0)),
                Some((0.5, 0.5)),
                Some((1.0, 1.0)),
                Some((1.0, 1.0))
            ]
        );
    }

    #[test]
    fn annotations_that_are_nan() {
        let all = rates(&[GOOD, NAN, GOOD, GOOD], &[GOOD, GOOD, FAR, GOOD]);
        let third = 2.0 / 3.0;
        let expected = [(third, third), (0.75, 0.5), (0.75, 0.5), (third, third)].map(Some);
        let close = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0).abs() + (a.1 - b.1).abs() < 1e-12;
        assert!(
            all.iter()
                .zip(expected)
                .all(|(a, b)| close(a.unwrap(), b.unwrap())),
            "{all:?}"
        );
        let all = rates(&[NAN, NAN], &[GOOD, GOOD]);
        assert_eq!(all, [None, Some((1.0, 0.0)), Some((1.0, 0.0)), None]);
    }

    #[test]
    fn annotations_without_area() {
        let all = rates(
            &[GOOD, BBox::default(), GOOD, GOOD],
            &[GOOD, FAR, GOOD, GOOD],
        );
        assert_eq!(
            all,
            [
                Some((0.75, 0.75)),
                Some((1.0, 0.75)),
                Some((1.0, 0.75)),
                Some((1.0, 1.0))
            ]
        );
    }

    #[test]
    fn annotations_at_the_edge() {
        // The center is above 0, x is not: pysot measures the error, OTB does not; neither counts an overlap.
        let edge = BBox::new(0.0, 10.0, 20.0, 20.0);
        let all = rates(&[GOOD, edge], &[GOOD, edge]);
        assert_eq!(
            all,
            [
                Some((1.0, 1.0)),
                Some((1.0, 0.5)),
                Some((1.0, 0.5)),
                Some((1.0, 1.0))
            ]
        );
        let all = rates(&[GOOD, edge], &[GOOD, FAR]);
        assert_eq!(
            all,
            [
                Some((0.5, 0.5)),
                Some((0.5, 0.5)),
                Some((1.0, 0.5)),
                Some((0.5, 0.5))
            ]
        );
    }

    #[test]
    fn results_that_are_no_box() {
        for unusable in [
            NAN,
            BBox::new(0.0, 0.0, 0.0, 0.0),
            BBox::new(10.0, 10.0, -20.0, 20.0),
        ] {
            let all = rates(&[GOOD, GOOD, GOOD], &[GOOD, GOOD, unusable]);
            // Only OTB repeats the frame before.
            assert_eq!(all[2], Some((1.0, 1.0)));
            for i in [0, 1, 3] {
                assert!(
                    (all[i].unwrap().1 - 2.0 / 3.0).abs() < 1e-12,
                    "{i} {unusable:?}"
                );
            }
        }
        // Where the annotation is NaN too, OTB leaves the result, and the next one repeats that.
        let judged = Convention::Otb.judge(&annotation(&[GOOD, NAN, GOOD]), &[GOOD, NAN, NAN]);
        assert!(judged[2].unwrap().error.is_nan());
    }

    #[test]
    fn absent_frames_are_pysots_alone() {
        let mut annotated = annotation(&[GOOD, GOOD, GOOD, GOOD]);
        annotated.present = Some(vec![true, true, false, true]);
        let rate = |rule: Convention| rule.curves(&annotated, &[GOOD; 4]).unwrap().precision();
        assert_eq!(Convention::ALL.map(rate), [1.0, 0.75, 1.0, 1.0]);
    }

    #[test]
    fn the_shorter_one_counts() {
        assert_eq!(
            rates(&[GOOD, GOOD], &[GOOD, GOOD, FAR, FAR]),
            [Some((1.0, 1.0)); 4]
        );
        assert_eq!(rates(&[GOOD, GOOD], &[GOOD]), [Some((1.0, 1.0)); 4]);
        assert_eq!(rates(&[], &[GOOD]), [None; 4]);
        assert_eq!(rates(&[GOOD], &[]), [None; 4]);
    }

    #[test]
    fn errors_are_in_pixels_of_the_video() {
        let mut annotated = annotation(&[GOOD, GOOD]);
        annotated.scale = 0.5;
        let judged =
            Convention::Got10k.judge(&annotated, &[GOOD, BBox::new(16.0, 18.0, 20.0, 20.0)]);
        assert_eq!(judged[1].unwrap().error, 20.0);
    }

    #[test]
    fn normalized_error() {
        let found = BBox::new(16.0, 18.0, 20.0, 20.0);
        let wide = BBox::new(10.0, 10.0, 20.0, 40.0);
        for rule in Convention::ALL {
            let judged = rule.judge(&annotation(&[wide, wide]), &[wide, found]);
            // Centers are 6 and 8 - 10 pixels apart.
            let expected = (6.0f64 / 20.0).hypot(2.0 / 40.0);
            assert!((judged[1].unwrap().norm_error - expected).abs() < 1e-12);
        }
    }
}
