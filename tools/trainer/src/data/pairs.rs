//! Which two frames of a track make a pair (docs/method.md, section 3.1).

use super::tracks::{Shot, running};
use crate::rng::Rng;
use serde::{Deserialize, Serialize};
use track_cpu::BBox;

/// Rules for the two frames of a pair.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PairRules {
    /// Largest gap between them in frames.
    pub max_gap: u32,
    /// Whether any later frame may be the second one, as in video_analyst.
    pub compat: bool,
    /// Greatest ratio of a box's sides.
    pub max_aspect: f32,
    /// Smallest side of a box in pixels.
    pub min_side: f32,
    /// How much more often a second frame is drawn that shows the target in another shape; 0 for
    /// all alike.
    #[serde(default)]
    pub variety: f32,
}

impl Default for PairRules {
    fn default() -> PairRules {
        PairRules {
            max_gap: 100,
            compat: false,
            max_aspect: 10.0,
            min_side: 3.0,
            variety: 0.0,
        }
    }
}

impl PairRules {
    /// Whether a box may be in a pair. (The rule on its share of the frame is [`leaves_context`].)
    pub fn accepts(&self, bbox: &BBox) -> bool {
        let (short, long) = (bbox.w.min(bbox.h), bbox.w.max(bbox.h));
        short >= self.min_side && long < self.max_aspect * short
    }

    /// Two frames of a track, the first uniform, the second within the gap; a still is paired with
    /// itself.
    ///
    /// `shots` is in the order of time and not empty.
    pub fn draw(&self, rng: &mut Rng, shots: &[Shot]) -> (Shot, Shot) {
        let first = *rng.pick(shots);
        let earliest = first.number.saturating_sub(self.max_gap);
        let latest = if self.compat {
            u32::MAX
        } else {
            first.number.saturating_add(self.max_gap)
        };
        let start = shots.partition_point(|shot| shot.number < earliest);
        let end = shots.partition_point(|shot| shot.number <= latest);
        let near = &shots[start..end];
        if self.variety > 0.0 {
            let weights = running(near.iter().map(|shot| self.weight(&first, shot)));
            return (first, near[rng.weighted(&weights)]);
        }
        (first, *rng.pick(near))
    }

    /// Relative frequency of a second frame: 1 for the first frame itself, more the more the
    /// target's aspect, its size and the time differ.
    fn weight(&self, first: &Shot, second: &Shot) -> f64 {
        let aspect = |shot: &Shot| f64::from(shot.bbox.w / shot.bbox.h).ln();
        let area = |shot: &Shot| f64::from(shot.bbox.area()).ln();
        let by_aspect = (aspect(first) - aspect(second)).abs().min(1.5);
        let by_size = (area(first) - area(second)).abs().min(2.0);
        let frames = f64::from(first.number.abs_diff(second.number));
        let by_time = (frames / f64::from(self.max_gap.max(1))).min(1.0);
        1.0 + f64::from(self.variety) * (2.0 * by_aspect + 0.25 * by_size + 0.5 * by_time)
    }
}

/// Whether a box covers less than 60 % of its whole frame, so that there is context around it.
///
/// The test in video_analyst has no effect, so `compat` leaves it out. It does not apply to crops
/// of frames.
pub fn leaves_context(bbox: &BBox, width: usize, height: usize) -> bool {
    bbox.area() < 0.6 * (width * height) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::picture::PictureId;

    fn shots(numbers: impl Iterator<Item = u32>) -> Vec<Shot> {
        let shot = |number| Shot {
            picture: PictureId(number),
            bbox: BBox::new(0.0, 0.0, 20.0, 20.0),
            number,
        };
        numbers.map(shot).collect()
    }

    #[test]
    fn gap_is_bounded_both_ways_unless_compatible() {
        let shots = shots((0..100).map(|i| i * 10));
        let mut rng = Rng::new(0, 0, 0);
        let gap = |rules: &PairRules, rng: &mut Rng| {
            let (a, b) = rules.draw(rng, &shots);
            i64::from(b.number) - i64::from(a.number)
        };
        let rules = PairRules::default();
        let gaps: Vec<_> = (0..2000).map(|_| gap(&rules, &mut rng)).collect();
        assert_eq!(
            (gaps.iter().min(), gaps.iter().max()),
            (Some(&-100), Some(&100))
        );
        let compat = PairRules {
            compat: true,
            ..rules
        };
        let gaps: Vec<_> = (0..2000).map(|_| gap(&compat, &mut rng)).collect();
        assert_eq!(gaps.iter().min(), Some(&-100));
        assert!(gaps.iter().max() > Some(&800));
    }

    #[test]
    fn variety_prefers_another_aspect_and_a_later_frame() {
        let mut shots = shots(0..40);
        for shot in &mut shots[30..] {
            shot.bbox.w *= 1.8; // the target spreads its arms
        }
        let rules = PairRules {
            variety: 3.0,
            ..PairRules::default()
        };
        let (mut spread, mut gap) = ([0.0; 2], [0.0; 2]);
        let mut rng = Rng::new(5, 0, 0);

        for _ in 0..4000 {
            for (k, rules) in [PairRules::default(), rules].iter().enumerate() {
                let (a, b) = rules.draw(&mut rng, &shots);
                spread[k] += f64::from(u8::from(a.bbox.w != b.bbox.w)) / 4000.0;
                gap[k] += f64::from(a.number.abs_diff(b.number)) / 4000.0;
            }
        }

        // A quarter of the frames is spread: 2 * 1/4 * 3/4 of uniform pairs differ.
        assert!((spread[0] - 0.375).abs() < 0.03, "{spread:?}");
        assert!(spread[1] > 0.55, "{spread:?}");
        assert!(gap[1] > 1.1 * gap[0], "{gap:?}");
    }

    #[test]
    fn odd_boxes_are_refused_and_a_still_pairs_with_itself() {
        let rules = PairRules::default();
        let one = shots(5..6);
        assert_eq!(rules.draw(&mut Rng::new(0, 0, 1), &one), (one[0], one[0]));
        assert!(!rules.accepts(&BBox::new(0.0, 0.0, 2.0, 8.0)));
        assert!(!rules.accepts(&BBox::new(0.0, 0.0, 10.0, 100.0)));
        assert!(rules.accepts(&BBox::new(0.0, 0.0, 99.0, 10.0)));
        // A target from the air is a speck of the frame.
        let (speck, most) = (
            BBox::new(0.0, 0.0, 12.0, 8.0),
            BBox::new(0.0, 0.0, 800.0, 800.0),
        );
        assert!(leaves_context(&speck, 3840, 2160));
        assert!(!leaves_context(&most, 1000, 1000));
    }
}
