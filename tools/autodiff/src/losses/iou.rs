//! Box regression: `-ln IoU` of boxes that are decoded from a map of offsets (docs/method.md,
//! sections 1.3, 3.4, 3.9).
//!
//! Each cell of the map has four offsets `o`, which become the distances `e` from the cell's point
//! to the left, top, right and bottom edge of a box. Both corners are inside: the box is
//! `x1 - x0 + 1` pixels wide.
//!
//! ```text
//! point of column ix, row iy:   px = first + stride ix,  py = first + stride iy
//! distances:                    e = [l, t, r, b] = stride exp(si o + bi)
//! box (x0, y0, x1, y1):         (px - l, py - t, px + r, py + b)
//! ```
//!
//! The loss is the mean over the cells whose label is 1; without any it is 0.
//!
//! Gradient, with `I` the intersection, `U` the union and `A` the area of the predicted box:
//!
//! ```text
//! d(-ln IoU)/de = -dI / I + (dA - dI) / U
//! dA/de         = the side of the box that is perpendicular to e
//! dI/de         = the intersection's perpendicular side if the predicted edge is the inner one,
//!                 else 0
//! de/do = e si      de/dsi = e o      de/dbi = e
//! ```

use crate::{Tape, Tensor, Var};

/// How a map of offsets becomes boxes, and the limits that keep the loss finite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoxDecoder {
    /// Coordinate of the first row's and column's points, in crop pixels.
    pub first: f32,
    /// Distance between neighboring points, in crop pixels.
    pub stride: f32,
    /// The limit of `si o + bi`. A larger exponent counts as this one and gets no gradient.
    pub max_exponent: f32,
    /// The lower limit of the IoU. A smaller IoU counts as this one and gives no gradient.
    pub min_iou: f32,
}

impl BoxDecoder {
    /// As in the reference implementation: stride 8, no limit of the exponent, and the smallest
    /// normal number as the limit of the IoU.
    pub fn new(first: f32) -> BoxDecoder {
        BoxDecoder {
            first,
            stride: 8.0,
            max_exponent: f32::INFINITY,
            min_iou: f32::MIN_POSITIVE,
        }
    }

    /// The distances at one point, and whether each depends on its offset.
    fn distances(&self, offsets: &[f32], si: f32, bi: f32) -> ([f64; 4], [bool; 4]) {
        let exponents = [0, 1, 2, 3].map(|i| f64::from(si) * f64::from(offsets[i]) + f64::from(bi));
        let max = f64::from(self.max_exponent);
        (
            exponents.map(|e| f64::from(self.stride) * e.min(max).exp()),
            exponents.map(|e| e <= max),
        )
    }

    /// The point of cell `i` of a map that is `width` wide.
    fn point(&self, i: usize, width: usize) -> [f64; 2] {
        [i % width, i / width].map(|n| f64::from(self.first) + f64::from(self.stride) * n as f64)
    }

    /// The boxes `(x0, y0, x1, y1)` that `offsets` (`[batch, H, W, 4]`) stand for, in the same
    /// shape.
    pub fn boxes(&self, offsets: &Tensor, si: f32, bi: f32) -> Tensor {
        let maps = offsets.maps("boxes");
        assert_eq!(maps.channels, 4, "boxes: four offsets per cell");
        let mut boxes = Vec::with_capacity(offsets.data().len());
        for (i, offsets) in offsets.data().chunks_exact(4).enumerate() {
            let [px, py] = self.point(i % maps.size.area(), maps.size.w);
            let ([l, t, r, b], _) = self.distances(offsets, si, bi);
            boxes.extend([px - l, py - t, px + r, py + b].map(|v| v as f32));
        }
        Tensor::new(offsets.shape(), boxes)
    }
}

/// IoU of `truth` (x0, y0, x1, y1) and the box at the distances `e` (left, top, right, bottom) from
/// a point, and the gradient of `-ln IoU` with respect to the distances. `None` if the boxes do not
/// overlap.
fn minus_log_iou([px, py]: [f64; 2], e: [f64; 4], truth: [f64; 4]) -> Option<(f64, [f64; 4])> {
    let (w, h) = (e[0] + e[2] + 1.0, e[1] + e[3] + 1.0);
    // How far the truth reaches from the point, in the four directions.
    let reach = [px - truth[0], py - truth[1], truth[2] - px, truth[3] - py];
    let inner = [0, 1, 2, 3].map(|i| e[i].min(reach[i]));
    let (iw, ih) = (
        (inner[0] + inner[2] + 1.0).max(0.0),
        (inner[1] + inner[3] + 1.0).max(0.0),
    );
    let intersection = iw * ih;
    let union = w * h + (reach[0] + reach[2] + 1.0) * (reach[1] + reach[3] + 1.0) - intersection;
    if !(intersection > 0.0 && union.is_finite()) {
        return None;
    }
    let gradient = [0, 1, 2, 3].map(|i| {
        let (area_side, side) = if i % 2 == 0 { (h, ih) } else { (w, iw) };
        let slope = if e[i] < reach[i] { side } else { 0.0 };
        (area_side - slope) / union - slope / intersection
    });
    Some((intersection / union, gradient))
}

impl Tape<'_> {
    /// The loss of `offsets` (`[batch, H, W, 4]`), decoded with scale `si` and shift `bi` (one
    /// value each), against the true `boxes` (x0, y0, x1, y1; `[batch, H, W, 4]`). Only cells whose
    /// label (`[batch, H, W, 1]`) is 1 count.
    ///
    /// Panics if the shapes do not fit each other.
    pub fn iou_loss(
        &mut self,
        offsets: Var,
        si: Var,
        bi: Var,
        labels: &Tensor,
        boxes: &Tensor,
        decoder: BoxDecoder,
    ) -> Var {
        let maps = self.value(offsets).maps("iou_loss");
        assert_eq!(maps.channels, 4, "iou_loss: four offsets per cell");
        assert_eq!(
            boxes.data().len(),
            maps.batch * maps.image(),
            "iou_loss: boxes"
        );
        assert_eq!(
            4 * labels.data().len(),
            boxes.data().len(),
            "iou_loss: labels"
        );
        let (scale_var, shift_var) = (si, bi);
        let (si, bi) = (self.value(si).item(), self.value(bi).item());
        let share = self.one_over(labels.data().iter().filter(|label| **label == 1.0).count());
        let o = self.value(offsets);
        let mut to_offsets = Tensor::zeros(o.shape());
        let (mut loss, mut to_si, mut to_bi) = (0.0, 0.0, 0.0);
        for (i, _) in labels
            .data()
            .iter()
            .enumerate()
            .filter(|(_, label)| **label == 1.0)
        {
            let o = &o.data()[4 * i..][..4];
            let truth = [0, 1, 2, 3].map(|n| f64::from(boxes.data()[4 * i + n]));
            let (distances, free) = decoder.distances(o, si, bi);
            let point = decoder.point(i % maps.size.area(), maps.size.w);
            let min = f64::from(decoder.min_iou);
            match minus_log_iou(point, distances, truth) {
                Some((iou, gradient)) if iou >= min => {
                    loss -= share * iou.ln();
                    for n in (0..4).filter(|n| free[*n]) {
                        let slope = share * gradient[n] * distances[n];
                        to_offsets.data_mut()[4 * i + n] = (slope * f64::from(si)) as f32;
                        to_si += slope * f64::from(o[n]);
                        to_bi += slope;
                    }
                }
                _ => loss -= share * min.ln(),
            }
        }
        let like = |var, value: f64| Tensor::full(self.shape(var), value as f32);
        let (to_si, to_bi) = (like(scale_var, to_si), like(shift_var, to_bi));
        self.record_loss(
            loss,
            vec![
                (offsets, to_offsets),
                (scale_var, to_si),
                (shift_var, to_bi),
            ],
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_near, value_and_gradients};
    use super::*;
    use crate::check::{check, noise};

    #[test]
    fn loss_has_its_golden_values() {
        // The point (31, 30), as row 0, column 0 of a map whose first point is at 31; the truth
        // moved along in y.
        let decoder = BoxDecoder::new(31.0);
        let inputs = [
            Tensor::new(&[1, 1, 1, 4], vec![0.8, 0.4, 0.9, 0.7]),
            Tensor::scalar(1.1),
            Tensor::scalar(0.05),
        ];
        let truth = Tensor::new(&[4], vec![10.0, 21.0, 50.0, 61.0]);
        let (loss, gradients) = value_and_gradients(&inputs, |tape, v| {
            tape.iou_loss(v[0], v[1], v[2], &Tensor::scalar(1.0), &truth, decoder)
        });
        assert_near(&[loss], &[0.4920510], 1e-6);
        assert_near(
            &gradients[0],
            &[-0.5182641, 0.3282912, 0.4175604, -0.6473157],
            1e-6,
        );
        assert_near(
            &[gradients[1][0], gradients[2][0]],
            &[-0.3278286, -0.3815711],
            1e-6,
        );
    }

    #[test]
    fn half_overlap_costs_ln_2() {
        let (iou, _) =
            minus_log_iou([5.0, 5.0], [5.0, 5.0, 4.0, 4.0], [0.0, 0.0, 9.0, 4.0]).unwrap();
        assert!((iou - 0.5).abs() < 1e-12);
    }

    #[test]
    fn gradients_equal_finite_differences() {
        let mut inputs = vec![
            noise(&[2, 2, 3, 4], 1),
            Tensor::scalar(1.1),
            Tensor::scalar(0.05),
        ];
        inputs[0].data_mut().iter_mut().for_each(|v| *v *= 0.8);
        let labels = Tensor::new(&[12], [1.0, 0.0, 1.0, -1.0, 1.0, 1.0].repeat(2));
        let boxes = Tensor::new(&[12, 4], [3.0, 2.5, 28.0, 21.0].repeat(12));
        let decoder = BoxDecoder::new(8.0);
        check(&inputs, 0.004, 2e-3, |tape, v| {
            tape.iou_loss(v[0], v[1], v[2], &labels, &boxes, decoder)
        });
    }

    #[test]
    fn limits_bound_the_loss_and_its_gradient() {
        let offsets = Tensor::new(
            &[1, 1, 4, 4],
            [[200.0; 4], [0.0; 4], [f32::NAN; 4], [7.0; 4]].concat(),
        );
        let inputs = [offsets, Tensor::scalar(1.0), Tensor::scalar(0.0)];
        let far = [1000.0, 1000.0, 1010.0, 1010.0];
        let boxes = Tensor::new(
            &[4, 4],
            [[0.0, 0.0, 9.0, 9.0], far, far, [0.0, 0.0, 20.0, 20.0]].concat(),
        );
        let labels = Tensor::full(&[4], 1.0);
        let run = |decoder| {
            value_and_gradients(&inputs, |tape, v| {
                tape.iou_loss(v[0], v[1], v[2], &labels, &boxes, decoder)
            })
        };
        let (loss, gradients) = run(BoxDecoder {
            min_iou: 1e-6,
            ..BoxDecoder::new(5.0)
        });
        assert!(loss.is_finite() && loss <= -(1e-6f32.ln()));
        assert!(gradients.iter().flatten().all(|g| g.is_finite()));
        assert_eq!(gradients[0][..12], [0.0; 12]);
        assert!(gradients[0][12] > 0.0);
        let (_, limited) = run(BoxDecoder {
            max_exponent: 6.0,
            ..BoxDecoder::new(5.0)
        });
        assert_eq!(limited[0], [0.0; 16]);
    }
}
