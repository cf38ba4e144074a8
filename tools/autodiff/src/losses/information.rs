//! The Jensen-Shannon estimate of mutual information from a statistics network's scores
//! (docs/method.md, section 3.7): `-mean softplus(-t) - mean softplus(t')`, with `t` scores of
//! pairs that belong together and `t'` of pairs that do not. It is at most 0; scores of 0 give
//! `-2 ln 2`. Training maximizes it.
//!
//! Gradient (docs/method.md, section 3.9): `sigmoid(-t) / n` and `-sigmoid(t') / n'`.

use crate::ops::{sigmoid, softplus};
use crate::{Tape, Tensor, Var};

impl Tape<'_> {
    /// The estimate from `positive` and `negative` scores, each of any shape but empty.
    pub fn information(&mut self, positive: Var, negative: Var) -> Var {
        let mut estimate = 0.0;
        let mut gradients = Vec::with_capacity(2);
        for (scores, sign) in [(positive, -1.0f32), (negative, 1.0)] {
            let t = self.value(scores);
            let n = t.data().len();
            assert!(n > 0, "information from no scores");
            estimate -= t
                .data()
                .iter()
                .map(|t| f64::from(softplus(sign * t)))
                .sum::<f64>()
                / n as f64;
            let slopes = t
                .data()
                .iter()
                .map(|t| -sign * sigmoid(sign * t) / n as f32);
            gradients.push((scores, Tensor::new(t.shape(), slopes.collect())));
        }
        self.record_loss(estimate, gradients)
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{assert_near, value_and_gradients};
    use super::*;
    use crate::check::{check, noise};

    #[test]
    fn loss_has_its_golden_values() {
        let estimate = |t: f32, u: f32| {
            let scores = [Tensor::full(&[2, 1], t), Tensor::full(&[3], u)];
            value_and_gradients(&scores, |tape, v| tape.information(v[0], v[1])).0
        };
        assert_near(&[estimate(0.0, 0.0)], &[-1.386294], 1e-6);
        let separated = estimate(20.0, -20.0);
        assert!(separated <= 0.0 && separated > -1e-8, "{separated}");
    }

    #[test]
    fn gradients() {
        let scores = [noise(&[2, 3], 1), noise(&[4], 2)];
        check(&scores, 0.1, 1e-4, |tape, v| tape.information(v[0], v[1]));
    }
}
