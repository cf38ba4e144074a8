//! Sum and mean of all values: `y = w sum x` with `w = 1` or `1 / n`, of shape `[]`; `dx = w g`.

use crate::tape::Operation;
use crate::{Tape, Tensor, Var};

struct WeightedSum {
    x: Var,
    weight: f32,
}

impl Tape<'_> {
    /// The sum of all values.
    pub fn sum(&mut self, x: Var) -> Var {
        self.weighted_sum(x, 1.0)
    }

    /// The mean of all values. Panics if there are none.
    pub fn mean(&mut self, x: Var) -> Var {
        let n = self.value(x).data().len();
        assert!(n > 0, "mean of nothing");
        self.weighted_sum(x, 1.0 / n as f64)
    }

    fn weighted_sum(&mut self, x: Var, weight: f64) -> Var {
        let sum: f64 = self.value(x).data().iter().map(|v| f64::from(*v)).sum();
        let operation = WeightedSum {
            x,
            weight: weight as f32,
        };
        self.record(Tensor::scalar((weight * sum) as f32), &[x], operation)
    }
}

impl Operation for WeightedSum {
    fn backward(&self, tape: &mut Tape, _: &Tensor, gradient: Tensor) {
        let mut share = tape.compute.tensor(tape.shape(self.x));
        share.data_mut().fill(self.weight * gradient.item());
        tape.add_gradient(self.x, share);
    }
}

#[cfg(test)]
mod tests {
    use crate::check::{check, noise};

    #[test]
    fn gradients_equal_finite_differences() {
        let x = noise(&[2, 3], 1);
        check(std::slice::from_ref(&x), 0.25, 1e-5, |tape, v| {
            tape.sum(v[0])
        });
        check(&[x], 0.25, 1e-5, |tape, v| tape.mean(v[0]));
    }
}
