//! The Jensen-Shannon estimate of mutual information, from the scores that a statistics network
//! gives to `n` pairs that belong together (`t`) and `n'` pairs that do not (`t'`); docs/method.md,
//! sections 3.7 and 3.9.
//!
//! ```text
//! estimate = -mean softplus(-t) - mean softplus(t')
//! gradient: sigmoid(-t) / n for each t, -sigmoid(t') / n' for each t'
//! ```
//!
//! The estimate is at most 0, and `-2 ln 2` if all scores are 0. Training maximizes it.

use crate::ops::{sigmoid, softplus};
use crate::{Tape, Tensor, Var};

impl Tape<'_> {
    /// The estimate from `positive` and `negative` scores, each of any shape.
    ///
    /// Panics if either is empty.
    pub fn information(&mut self, positive: Var, negative: Var) -> Var {
        let mut estimate = 0.0;
        let mut gradients = Vec::with_capacity(2);
        for (scores, sign) in [(positive, -1.0f32), (negative, 1.0)] {
            let t = self.value(scores);
            assert!(!t.data().is_empty(), "information from no scores");
            let n = self.count_of_all(t.data().len());
            estimate -= t
                .data()
                .iter()
                .map(|t| f64::from(softplus(sign * t)))
                .sum::<f64>()
                / n;
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
    fn estimate_has_its_golden_values() {
        let estimate = |t: f32, u: f32| {
            let scores = [Tensor::full(&[2, 1], t), Tensor::full(&[3], u)];
            value_and_gradients(&scores, |tape, v| tape.information(v[0], v[1])).0
        };
        assert_near(&[estimate(0.0, 0.0)], &[-1.386294], 1e-6);
        let separated = estimate(20.0, -20.0);
        assert!(separated <= 0.0 && separated > -1e-8, "{separated}");
    }

    #[test]
    fn gradients_equal_finite_differences() {
        let scores = [noise(&[2, 3], 1), noise(&[4], 2)];
        check(&scores, 0.1, 1e-4, |tape, v| tape.information(v[0], v[1]));
    }
}
