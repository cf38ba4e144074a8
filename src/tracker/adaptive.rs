//! A smaller search region while the target is easy to follow.
//!
//! After a few calm frames in a row only the inner part of the search region is searched. A frame
//! that turns out not to be calm is searched again in full.
//!
//! Source: docs/method.md, section 5.6.

use super::select::Choice;
use weights_format::Architecture;

/// Calm frames in a row before the region shrinks.
const PATIENCE: u32 = 3;
/// Least score of a calm frame.
const SCORE: f64 = 0.4;
/// Least penalty factor of a calm frame: size and aspect hardly changed.
const PENALTY: f64 = 0.95;
/// Greatest shift from the region's middle in a calm frame, in cells.
const SHIFT: f64 = 2.0;

/// Decides how much of the region is searched.
#[derive(Clone, Debug, Default)]
pub(crate) struct Adaptive {
    calm: u32, // frames in a row
}

impl Adaptive {
    /// Whether the smaller region is enough for the next frame.
    pub(crate) fn is_calm(&self) -> bool {
        self.calm >= PATIENCE
    }

    /// Notes a search's choice and returns whether the frame was calm.
    ///
    /// `middle` is the crop pixel of the crop's middle. The choice in a smaller region stands only
    /// if the frame was calm.
    pub(crate) fn note(&mut self, choice: Option<&Choice>, middle: f64) -> bool {
        let near =
            |at: f32| (f64::from(at) - middle).abs() <= SHIFT * Architecture::TOTAL_STRIDE as f64;
        let calm = choice.is_some_and(|c| {
            c.score >= SCORE && c.penalty >= PENALTY && near(c.bbox.cx) && near(c.bbox.cy)
        });
        self.calm = if calm { self.calm + 1 } else { 0 };
        calm
    }

    /// Starts over for a new target.
    pub(crate) fn reset(&mut self) {
        self.calm = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bbox::CropBox;

    fn choice(cx: f32, score: f64) -> Choice {
        let bbox = CropBox {
            cx,
            cy: 151.0,
            w: 60.0,
            h: 60.0,
        };
        Choice {
            index: 0,
            bbox,
            vote: bbox,
            score,
            response: 0.0,
            penalty: 1.0,
            penalized_score: score,
        }
    }

    #[test]
    fn region_after_three_calm_frames_is_calm() {
        let mut adaptive = Adaptive::default();
        for (cx, score) in [(151.0, 0.9), (160.0, 0.5), (140.0, 0.6)] {
            assert!(!adaptive.is_calm());
            assert!(adaptive.note(Some(&choice(cx, score)), 151.0));
        }
        assert!(adaptive.is_calm());
    }

    #[test]
    fn region_after_one_restless_frame_is_not_calm() {
        for restless in [Some(choice(170.0, 0.9)), Some(choice(151.0, 0.3)), None] {
            let mut adaptive = Adaptive::default();
            for _ in 0..4 {
                adaptive.note(Some(&choice(151.0, 0.9)), 151.0);
            }
            assert!(adaptive.is_calm());

            let calm = adaptive.note(restless.as_ref(), 151.0);

            assert!(!calm && !adaptive.is_calm());
        }
    }
}
