//! Corrects the network's boxes by the error it makes in the first frame.
//!
//! The first frame comes with the true box. The network's error there is mostly the target's own:
//! it takes the head for the face, or stops where the car's shadow begins. Later frames show the
//! same target, so every later box is corrected by a share of that error. This adapts the bias of
//! the network's last layer to the target, at the price of one search per target. A share of 0 is
//! the published tracker.
//!
//! Source: docs/method.md, section 5.1.

use crate::bbox::CropBox;

/// Greatest change of a side that is believed, as a natural logarithm.
const MAX_STRETCH: f64 = 0.5;
/// Greatest shift of the center that is believed, in sides of the box.
const MAX_SHIFT: f64 = 0.3;

/// Maps the network's boxes to corrected ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Correction {
    x: Axis,
    y: Axis,
}

/// The correction along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axis {
    stretch: f64, // factor of the side
    shift: f64,   // of the center, in stretched sides
}

/// A box along one axis.
struct Span {
    center: f32,
    side: f32,
}

impl Correction {
    /// Leaves boxes as they are.
    pub(crate) const NONE: Correction = Correction {
        x: Axis::NONE,
        y: Axis::NONE,
    };

    /// Goes a `share` of the way from the `found` box to the true one.
    ///
    /// [`NONE`](Self::NONE) if a number is not finite.
    pub(crate) fn between(found: &CropBox, truth: &CropBox, share: f64) -> Correction {
        let across = |bbox: &CropBox| Span {
            center: bbox.cx,
            side: bbox.w,
        };
        let down = |bbox: &CropBox| Span {
            center: bbox.cy,
            side: bbox.h,
        };
        let x = Axis::between(across(found), across(truth), share);
        let y = Axis::between(down(found), down(truth), share);
        match (x, y) {
            (Some(x), Some(y)) => Correction { x, y },
            _ => Correction::NONE,
        }
    }

    /// Corrects offsets in place: `[cells, 4]` distances from each cell's center to the left, top,
    /// right and bottom edge of its box.
    pub(crate) fn apply(&self, ltrb: &mut [f32]) {
        if *self == Correction::NONE {
            return;
        }
        for [left, top, right, bottom] in ltrb.as_chunks_mut::<4>().0 {
            self.x.apply(left, right);
            self.y.apply(top, bottom);
        }
    }
}

impl Axis {
    const NONE: Axis = Axis {
        stretch: 1.0,
        shift: 0.0,
    };

    /// Goes a `share` of the way from found to true; `None` if a number is not finite.
    fn between(found: Span, truth: Span, share: f64) -> Option<Axis> {
        let error = (f64::from(truth.side) / f64::from(found.side)).ln();
        let stretch = (share * error).clamp(-MAX_STRETCH, MAX_STRETCH).exp();
        let error = share * f64::from(truth.center - found.center) / f64::from(truth.side);
        let shift = error.clamp(-MAX_SHIFT, MAX_SHIFT);
        (stretch.is_finite() && shift.is_finite()).then_some(Axis { stretch, shift })
    }

    /// Corrects the distances from a cell's center to the two edges along this axis.
    fn apply(&self, near: &mut f32, far: &mut f32) {
        let side = (f64::from(*near) + f64::from(*far) + 1.0) * self.stretch;
        let center = (f64::from(*far) - f64::from(*near)) / 2.0 + self.shift * side;
        *near = ((side - 1.0) / 2.0 - center) as f32;
        *far = ((side - 1.0) / 2.0 + center) as f32;
    }
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
    fn whole_share_leads_to_the_truth_and_half_share_part_of_the_way() {
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
        for (found, expected) in [(w, 50.0), (h, 54.0), (cx, 1.0), (cy, -4.0)] {
            assert!((found - expected).abs() < 1e-4, "{whole:?}");
        }
        let CropBox { cx, cy, w, h } = decoded(half);
        assert!((w - (40.0f32 * 50.0).sqrt()).abs() < 1e-3, "{half:?}");
        assert!((h - (60.0f32 * 54.0).sqrt()).abs() < 1e-3, "{half:?}");
        assert!(cx > 0.0 && cx < 1.0, "{half:?}");
        assert!(cy < 0.0 && cy > -4.0, "{half:?}");
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

        assert_eq!((x.shift, y.shift), (MAX_SHIFT, -MAX_SHIFT));
        assert_eq!(x.stretch, MAX_STRETCH.exp());
        assert_eq!(y.stretch, (-MAX_STRETCH).exp());
    }

    #[test]
    fn box_that_is_not_finite_stretches_nothing() {
        for cx in [f32::NAN, f32::INFINITY] {
            let found = CropBox { cx, ..TRUTH };
            let correction = Correction::between(&found, &TRUTH, 1.0);
            assert_eq!(correction.x.stretch, 1.0, "{cx}");
        }
        let found = CropBox {
            w: f32::NAN,
            ..TRUTH
        };

        let correction = Correction::between(&found, &TRUTH, 1.0);

        assert_eq!(correction, Correction::NONE);
    }
}
