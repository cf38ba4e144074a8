//! What the first frame tells about the network's boxes.
//!
//! In the first frame the true box is known. A network that was asked to find it there errs in a way that is mostly the
//! target's own: it takes the head for the face, or stops where the car's shadow begins. Later frames see the same target, so
//! a share of that error is taken out of every later box. In terms of the network this adapts the bias of its last layer to the
//! target, at the price of one search when it is given. The paper's tracker is a share of 0.

use crate::bbox::CenterBox;

/// Largest change of a side that is believed, as a natural logarithm.
const MAX_STRETCH: f64 = 0.5;

/// Largest shift of the center that is believed, in sides of the box.
const MAX_SHIFT: f64 = 0.3;

/// Turns the boxes of a network into better ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Correction {
    stretch: [f64; 2], // of width and height
    shift: [f64; 2],   // of the center, in stretched widths and heights
}

impl Correction {
    /// Leaves boxes as they are.
    pub(crate) const NONE: Correction = Correction {
        stretch: [1.0; 2],
        shift: [0.0; 2],
    };

    /// What takes a `share` of the way from the box that was found to the true one; nothing if that is not finite.
    pub(crate) fn between(found: &CenterBox, truth: &CenterBox, share: f64) -> Correction {
        let stretch = |found: f32, truth: f32| {
            let error = (f64::from(truth) / f64::from(found)).ln();
            (share * error).clamp(-MAX_STRETCH, MAX_STRETCH).exp()
        };
        let shift = |found: f32, truth: f32, side: f32| {
            (share * f64::from(truth - found) / f64::from(side)).clamp(-MAX_SHIFT, MAX_SHIFT)
        };
        let correction = Correction {
            stretch: [stretch(found.w, truth.w), stretch(found.h, truth.h)],
            shift: [
                shift(found.cx, truth.cx, truth.w),
                shift(found.cy, truth.cy, truth.h),
            ],
        };
        let Correction {
            stretch: [w, h],
            shift: [x, y],
        } = correction;
        if [w, h, x, y].iter().all(|v| v.is_finite()) {
            correction
        } else {
            Correction::NONE
        }
    }

    /// Corrects offsets in place: distances from each cell's center to its box's left, top, right and bottom edge, `[cells, 4]`.
    pub(crate) fn apply(&self, ltrb: &mut [f32]) {
        if *self == Correction::NONE {
            return;
        }
        for cell in ltrb.as_chunks_mut::<4>().0 {
            for axis in 0..2 {
                let (near, far) = (f64::from(cell[axis]), f64::from(cell[axis + 2]));
                let side = (near + far + 1.0) * self.stretch[axis];
                let center = (far - near) / 2.0 + self.shift[axis] * side;
                cell[axis] = ((side - 1.0) / 2.0 - center) as f32;
                cell[axis + 2] = ((side - 1.0) / 2.0 + center) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Width, height and center relative to the cell, as `Selector::decode` has them.
    fn decoded([l, t, r, b]: [f32; 4]) -> [f32; 4] {
        [l + r + 1.0, t + b + 1.0, (r - l) / 2.0, (b - t) / 2.0]
    }

    #[test]
    fn all_of_the_error_leads_to_the_truth_and_a_share_part_of_the_way() {
        let found = CenterBox {
            cx: 150.0,
            cy: 152.0,
            w: 40.0,
            h: 60.0,
        };
        let truth = CenterBox {
            cx: 151.0,
            cy: 148.0,
            w: 50.0,
            h: 54.0,
        };
        let offsets = [19.5, 29.5, 19.5, 29.5]; // `found`, of the cell at its center
        let mut whole = offsets;
        Correction::between(&found, &truth, 1.0).apply(&mut whole);
        for (found, expected) in decoded(whole).into_iter().zip([50.0, 54.0, 1.0, -4.0]) {
            assert!((found - expected).abs() < 1e-4, "{whole:?}");
        }
        let mut half = offsets;
        Correction::between(&found, &truth, 0.5).apply(&mut half);
        let [w, h, x, y] = decoded(half);
        assert!(
            (w - (40.0f32 * 50.0).sqrt()).abs() < 1e-3
                && (h - (60.0f32 * 54.0).sqrt()).abs() < 1e-3
        );
        assert!(x > 0.0 && x < 1.0 && y < 0.0 && y > -4.0, "{half:?}");
    }

    #[test]
    fn no_share_changes_nothing_and_absurd_errors_little() {
        let truth = CenterBox {
            cx: 151.0,
            cy: 151.0,
            w: 50.0,
            h: 54.0,
        };
        let far = CenterBox {
            cx: 0.0,
            cy: 300.0,
            w: 1.0,
            h: 300.0,
        };
        assert_eq!(Correction::between(&far, &truth, 0.0), Correction::NONE);
        let wild = Correction::between(&far, &truth, 1.0);
        assert_eq!(wild.shift, [MAX_SHIFT, -MAX_SHIFT]);
        assert_eq!(wild.stretch, [MAX_STRETCH.exp(), (-MAX_STRETCH).exp()]);
        for broken in [f32::NAN, f32::INFINITY] {
            let found = CenterBox {
                cx: broken,
                ..truth
            };
            assert_eq!(
                Correction::between(&found, &truth, 1.0).stretch,
                [1.0; 2],
                "{broken}"
            );
        }
        assert_eq!(
            Correction::between(
                &CenterBox {
                    w: f32::NAN,
                    ..truth
                },
                &truth,
                1.0
            ),
            Correction::NONE
        );
    }
}
