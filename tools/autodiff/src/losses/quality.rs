//! Quality loss (docs/method.md, section 3.4): binary cross-entropy of logits `x` against targets
//! `t` in `[0, 1]`, minus the targets' own entropy, so that a perfect fit costs 0.
//!
//! ```text
//! loss of a point = softplus(x) - x t - entropy(t)
//! its gradient    = sigmoid(x) - t
//! ```
//!
//! Points whose target is 0 do not count. The loss of a batch is the mean over the others, or 0 if
//! there are none.

use crate::ops::{sigmoid, softplus};
use crate::{Tape, Tensor, Var};

/// `-t ln t - (1 - t) ln(1 - t)`.
fn entropy(t: f64) -> f64 {
    let term = |t: f64| if t > 0.0 { -t * t.ln() } else { 0.0 };
    term(t) + term(1.0 - t)
}

impl Tape<'_> {
    /// The quality loss of `logits` against `targets`. Only the number of targets matters, not
    /// their shape.
    ///
    /// Panics if there are not as many targets as logits.
    pub fn quality_loss(&mut self, logits: Var, targets: &Tensor) -> Var {
        let x = self.value(logits);
        assert_eq!(
            x.data().len(),
            targets.data().len(),
            "quality_loss: targets"
        );
        let scale = self.one_over(
            targets
                .data()
                .iter()
                .filter(|target| **target != 0.0)
                .count(),
        );
        let mut gradient = Tensor::zeros(x.shape());
        let mut loss = 0.0;
        let points = gradient
            .data_mut()
            .iter_mut()
            .zip(x.data())
            .zip(targets.data());
        for ((gradient, x), target) in points.filter(|(_, target)| **target != 0.0) {
            let (x, t) = (f64::from(*x), f64::from(*target));
            loss += scale * (f64::from(softplus(x as f32)) - x * t - entropy(t));
            *gradient = (scale * (f64::from(sigmoid(x as f32)) - t)) as f32;
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
        for (x, target, loss) in [
            (0.0, 0.7, 0.0822829),
            (0.5, 0.7, 0.0132127),
            (0.0, 0.5, 0.0),
        ] {
            let (found, _) = value_and_gradients(&[Tensor::scalar(x)], |tape, v| {
                tape.quality_loss(v[0], &Tensor::scalar(target))
            });
            assert_near(&[found], &[loss], 1e-7);
        }
    }

    #[test]
    fn gradients_equal_finite_differences() {
        let targets = Tensor::new(&[6], vec![0.5, 0.0, 1.0, 0.01, 0.99, 0.0]);
        check(&[noise(&[6], 1)], 0.1, 1e-4, |tape, v| {
            tape.quality_loss(v[0], &targets)
        });
        let (loss, gradients) = value_and_gradients(&[noise(&[2], 1)], |tape, v| {
            tape.quality_loss(v[0], &Tensor::zeros(&[2]))
        });
        assert_eq!((loss, &gradients[0][..]), (0.0, &[0.0, 0.0][..]));
    }
}
