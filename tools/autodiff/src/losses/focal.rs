//! Focal loss on logits `x`, with `p = sigmoid(x)` (docs/method.md, sections 3.4 and 3.9).
//!
//! ```text
//! label  loss of a point                    its gradient
//!   1    -alpha (1 - p)^gamma ln p          alpha (1 - p)^gamma (gamma p ln p - (1 - p))
//!   0    -(1 - alpha) p^gamma ln(1 - p)     (1 - alpha) p^gamma (p - gamma (1 - p) ln(1 - p))
//!  -1    0                                  0
//! ```
//!
//! The loss of a batch is the sum over its points, divided by the number of ones (at least 1). The
//! code computes label 0 as label 1 with `p` and `1 - p` exchanged and the gradient negated.

use crate::{Tape, Tensor, Var};

/// The focal loss's two constants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Focal {
    /// Weight of the ones; the zeros' is `1 - alpha`.
    pub alpha: f32,
    /// Exponent that reduces the loss of easy points.
    pub gamma: f32,
}

impl Default for Focal {
    fn default() -> Focal {
        Focal {
            alpha: 0.25,
            gamma: 2.0,
        }
    }
}

impl Focal {
    /// Loss and gradient of one point of label 1 or 0.
    fn point(&self, x: f32, one: bool) -> (f64, f64) {
        let (alpha, gamma) = (f64::from(self.alpha), f64::from(self.gamma));
        let (sign, weight) = if one {
            (1.0, alpha)
        } else {
            (-1.0, 1.0 - alpha)
        };
        let x = sign * f64::from(x);
        let log_p = -((-x).max(0.0) + (-x.abs()).exp().ln_1p()); // of the label's probability
        let (p, rest) = (log_p.exp(), -log_p.exp_m1());
        let easy = weight * rest.powf(gamma);
        (-easy * log_p, sign * easy * (gamma * p * log_p - rest))
    }
}

impl Tape<'_> {
    /// The focal loss of `logits` against `labels` (1, 0, or -1 to ignore the point). Only the
    /// number of labels matters, not their shape.
    ///
    /// Panics if there are not as many labels as logits.
    pub fn focal_loss(&mut self, logits: Var, labels: &Tensor, focal: Focal) -> Var {
        let x = self.value(logits);
        assert_eq!(x.data().len(), labels.data().len(), "focal_loss: labels");
        let scale = self.one_over(labels.data().iter().filter(|label| **label == 1.0).count());
        let mut gradient = Tensor::zeros(x.shape());
        let mut loss = 0.0;
        let points = gradient
            .data_mut()
            .iter_mut()
            .zip(x.data())
            .zip(labels.data());
        for ((gradient, x), label) in points.filter(|(_, label)| **label != -1.0) {
            let (point, slope) = focal.point(*x, *label == 1.0);
            loss += scale * point;
            *gradient = (scale * slope) as f32;
        }
        self.record_loss(loss, vec![(logits, gradient)])
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_near, value_and_gradients};
    use super::*;
    use crate::check::{check, noise};

    #[test]
    fn loss_has_its_golden_values() {
        for (x, label, loss) in [
            (0.0, 1.0, 0.0433217),
            (0.0, 0.0, 0.1299651),
            (2.0, 1.0, 0.000450891),
            (2.0, 0.0, 1.2375586),
        ] {
            let (found, _) = value_and_gradients(&[Tensor::scalar(x)], |tape, v| {
                tape.focal_loss(v[0], &Tensor::scalar(label), Focal::default())
            });
            assert_near(&[found], &[loss], 1e-7);
        }
        for (label, slope) in [(1.0, -0.0745717), (0.0, 0.2237151)] {
            let (_, gradients) = value_and_gradients(&[Tensor::scalar(0.0)], |tape, v| {
                tape.focal_loss(v[0], &Tensor::scalar(label), Focal::default())
            });
            assert_near(&gradients[0], &[slope], 1e-7);
        }
    }

    #[test]
    fn gradients_equal_finite_differences() {
        let mut x = noise(&[2, 2, 2, 1], 1);
        x.data_mut().iter_mut().for_each(|v| *v *= 4.0);
        let labels = Tensor::new(&[8], vec![1.0, 0.0, -1.0, 1.0, 0.0, 0.0, 1.0, -1.0]);
        for gamma in [0.5, 2.0] {
            let focal = Focal { alpha: 0.3, gamma };
            check(&[x.clone()], 0.05, 1e-4, |tape, v| {
                tape.focal_loss(v[0], &labels, focal)
            });
        }
    }

    #[test]
    fn loss_without_ones_or_with_large_logits_is_finite() {
        let x = Tensor::new(&[3], vec![-300.0, 300.0, 0.0]);
        let labels = Tensor::new(&[3], vec![0.0, 0.0, -1.0]);
        let (loss, gradients) = value_and_gradients(&[x], |tape, v| {
            tape.focal_loss(v[0], &labels, Focal::default())
        });
        assert_near(&[loss], &[225.0], 1e-3);
        assert_near(&gradients[0], &[0.0, 0.75, 0.0], 1e-6);
    }
}
