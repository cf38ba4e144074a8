//! Corrects the network's boxes by the error it makes in the first frame.
//!
//! The first frame comes with the true box. The network's error in size and aspect there is mostly
//! the target's own: it takes the head for the face, or stops where the car's shadow begins. Later
//! frames show the same target, so every later box is corrected by a share of that error. This
//! adapts the bias of the network's last layer to the target, at the price of one search per
//! target. A share of 0 is the published tracker. The error in position says nothing about later
//! frames and is left alone.
//!
//! Source: docs/method.md, section 5.1.

use crate::bbox::CropBox;

/// Greatest change of a side that is believed, as a natural logarithm.
const MAX_STRETCH: f64 = 0.5;

/// Maps the network's boxes to corrected ones: factors of width and height.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Correction {
    x: f64,
    y: f64,
}

impl Correction {
    /// Leaves boxes as they are.
    pub(crate) const NONE: Correction = Correction { x: 1.0, y: 1.0 };

    /// Goes a `share` of the way from the sides of the `found` box to those of the true one.
    ///
    /// [`NONE`](Self::NONE) if a side is not finite.
    pub(crate) fn between(found: &CropBox, truth: &CropBox, share: f64) -> Correction {
        let stretch = |found: f32, truth: f32| {
            let error = (f64::from(truth) / f64::from(found)).ln();
            (share * error).clamp(-MAX_STRETCH, MAX_STRETCH).exp()
        };
        let x = stretch(found.w, truth.w);
        let y = stretch(found.h, truth.h);
        if x.is_finite() && y.is_finite() {
            Correction { x, y }
        } else {
            Correction::NONE
        }
    }

    /// Corrects offsets in place: `[cells, 4]` distances from each cell's center to the left, top,
    /// right and bottom edge of its box.
    pub(crate) fn apply(&self, ltrb: &mut [f32]) {
        if *self == Correction::NONE {
            return;
        }
        for [left, top, right, bottom] in ltrb.as_chunks_mut::<4>().0 {
            stretch(left, right, self.x);
            stretch(top, bottom, self.y);
        }
    }

    /// The corrected box, around the same center.
    pub(crate) fn of(&self, bbox: &CropBox) -> CropBox {
        CropBox {
            w: (f64::from(bbox.w) * self.x) as f32,
            h: (f64::from(bbox.h) * self.y) as f32,
            ..*bbox
        }
    }
}

/// Multiplies the side between two edges around its center; `near` and `far` are their distances
/// from the cell's center.
fn stretch(near: &mut f32, far: &mut f32, factor: f64) {
    let side = (f64::from(*near) + f64::from(*far) + 1.0) * factor;
    let center = (f64::from(*far) - f64::from(*near)) / 2.0;
    *near = ((side - 1.0) / 2.0 - center) as f32;
    *far = ((side - 1.0) / 2.0 + center) as f32;
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: CropBox = CropBox {
        cx: 151.0,
        cy: 148.0,
        w: 50.0,
        h: 54.0,
    };

    /// The box of a cell at the origin, as `Selector::decode` has it.
    fn decoded([l, t, r, b]: [f32; 4]) -> CropBox {
        CropBox {
            cx: (r - l) / 2.0,
            cy: (b - t) / 2.0,
            w: l + r + 1.0,
            h: t + b + 1.0,
        }
    }

    #[test]
    fn whole_share_leads_to_the_true_size_and_half_share_part_of_the_way() {
        let found = CropBox {
            cx: 150.0,
            cy: 152.0,
            w: 40.0,
            h: 60.0,
        };
        let offsets = [19.5, 29.5, 19.5, 29.5]; // `found`, of the cell at its center
        let mut whole = offsets;
        let mut half = offsets;

        Correction::between(&found, &TRUTH, 1.0).apply(&mut whole);
        Correction::between(&found, &TRUTH, 0.5).apply(&mut half);

        let CropBox { cx, cy, w, h } = decoded(whole);
        for (found, expected) in [(w, 50.0), (h, 54.0), (cx, 0.0), (cy, 0.0)] {
            assert!((found - expected).abs() < 1e-4, "{whole:?}");
        }
        let CropBox { w, h, .. } = decoded(half);
        assert_eq!(Correction::between(&found, &TRUTH, 1.0).of(&found).w, 50.0);
        assert!((w - (40.0f32 * 50.0).sqrt()).abs() < 1e-3, "{half:?}");
        assert!((h - (60.0f32 * 54.0).sqrt()).abs() < 1e-3, "{half:?}");
    }

    #[test]
    fn share_of_zero_corrects_nothing() {
        let found = CropBox { w: 40.0, ..TRUTH };

        let correction = Correction::between(&found, &TRUTH, 0.0);

        assert_eq!(correction, Correction::NONE);
    }

    #[test]
    fn absurd_error_corrects_no_more_than_the_bounds() {
        let far = CropBox {
            cx: 0.0,
            cy: 300.0,
            w: 1.0,
            h: 300.0,
        };

        let Correction { x, y } = Correction::between(&far, &TRUTH, 1.0);

        assert_eq!(x, MAX_STRETCH.exp());
        assert_eq!(y, (-MAX_STRETCH).exp());
    }

    #[test]
    fn side_that_is_not_a_number_corrects_nothing() {
        let found = CropBox {
            w: f32::NAN,
            ..TRUTH
        };

        let correction = Correction::between(&found, &TRUTH, 1.0);

        assert_eq!(correction, Correction::NONE);
    }
}
