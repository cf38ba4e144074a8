//! A smaller search region while the target is easy to follow.
//!
//! While the target is surely found near the middle of the region, frame after frame, the border of the region is
//! not looked at; once it is not, the same frame is searched again in full.

use crate::select::Choice;
use weights_format::Architecture;

/// Frames in a row that must be calm before the region shrinks.
const PATIENCE: u32 = 3;
/// Least score of a calm frame,
const SCORE: f64 = 0.4;
/// least penalty (how little size and aspect changed),
const PENALTY: f64 = 0.95;
/// and greatest shift from the middle, in cells.
const SHIFT: f64 = 2.0;

/// Decides how much of the region is searched.
#[derive(Clone, Debug, Default)]
pub(crate) struct Adaptive {
    calm: u32, // frames in a row
}

impl Adaptive {
    /// Whether the smaller region will do for the next frame.
    pub(crate) fn is_calm(&self) -> bool {
        self.calm >= PATIENCE
    }

    /// Takes note of what a search chose in a crop with this middle; whether that may stand, if it was the smaller crop.
    pub(crate) fn note(&mut self, choice: Option<&Choice>, middle: f64) -> bool {
        let near =
            |at: f32| (f64::from(at) - middle).abs() <= SHIFT * Architecture::TOTAL_STRIDE as f64;
        let calm = choice.is_some_and(|c| {
            c.score >= SCORE && c.penalty >= PENALTY && near(c.bbox.cx) && near(c.bbox.cy)
        });
        self.calm = if calm { self.calm + 1 } else { 0 };
        calm
    }

    /// Forgets what was seen.
    pub(crate) fn reset(&mut self) {
        self.calm = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bbox::CenterBox;

    fn choice(cx: f32, score: f64) -> Choice {
        let bbox = CenterBox {
            cx,
            cy: 151.0,
            w: 60.0,
            h: 60.0,
        };
        Choice {
            index: 0,
            bbox,
            score,
            response: 0.0,
            penalty: 1.0,
            penalized_score: score,
        }
    }

    #[test]
    fn calm_comes_slowly_and_goes_at_once() {
        let mut adaptive = Adaptive::default();
        for (cx, score) in [(151.0, 0.9), (160.0, 0.5), (140.0, 0.6)] {
            assert!(!adaptive.is_calm());
            assert!(adaptive.note(Some(&choice(cx, score)), 151.0));
        }
        assert!(adaptive.is_calm());
        for restless in [Some(choice(170.0, 0.9)), Some(choice(151.0, 0.3)), None] {
            (0..4).for_each(|_| assert!(adaptive.note(Some(&choice(151.0, 0.9)), 151.0)));
            assert!(adaptive.is_calm());
            assert!(!adaptive.note(restless.as_ref(), 151.0));
            assert!(!adaptive.is_calm());
        }
    }
}
