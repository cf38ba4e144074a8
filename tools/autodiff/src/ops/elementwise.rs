//! Functions of single values, any shape: ReLU, exponential, sigmoid, softplus. `dx = g f'(x)`, and
//! every `f'(x)` here is a function of `y = f(x)` alone.

use crate::tape::Operation;
use crate::vector::update2;
use crate::{Tape, Tensor, Var};

/// A function and its derivative in terms of its value.
#[derive(Clone, Copy)]
enum Function {
    /// `max(x, 0)`, derivative 1 where positive.
    Relu,
    /// `e^x`, its own derivative.
    Exp,
    /// `s = 1 / (1 + e^-x)`, derivative `s (1 - s)`.
    Sigmoid,
    /// `p = ln(1 + e^x)`, derivative `sigmoid(x) = 1 - e^-p`.
    Softplus,
}

struct Elementwise {
    x: Var,
    function: Function,
}

impl Tape<'_> {
    /// `max(x, 0)`.
    pub fn relu(&mut self, x: Var) -> Var {
        self.elementwise(x, Function::Relu)
    }

    /// `e^x`.
    pub fn exp(&mut self, x: Var) -> Var {
        self.elementwise(x, Function::Exp)
    }

    /// `1 / (1 + e^-x)`.
    pub fn sigmoid(&mut self, x: Var) -> Var {
        self.elementwise(x, Function::Sigmoid)
    }

    /// `ln(1 + e^x)`.
    pub fn softplus(&mut self, x: Var) -> Var {
        self.elementwise(x, Function::Softplus)
    }

    fn elementwise(&mut self, x: Var, function: Function) -> Var {
        let mut out = self.compute.tensor(self.shape(x));
        let (compute, y, input) = (self.compute, out.data_mut(), self.value(x).data());
        match function {
            Function::Relu => update2(compute, y, input, |y, x| *y = x.max(0.0)),
            Function::Exp => update2(compute, y, input, |y, x| *y = x.exp()),
            Function::Sigmoid => update2(compute, y, input, |y, x| *y = sigmoid(x)),
            Function::Softplus => update2(compute, y, input, |y, x| *y = softplus(x)),
        }
        self.record(out, &[x], Elementwise { x, function })
    }
}

impl Operation for Elementwise {
    fn backward(&self, tape: &mut Tape, output: &Tensor, mut gradient: Tensor) {
        let (compute, g, y) = (tape.compute, gradient.data_mut(), output.data());
        match self.function {
            Function::Relu => update2(compute, g, y, |g, y| *g = if y > 0.0 { *g } else { 0.0 }),
            Function::Exp => update2(compute, g, y, |g, y| *g *= y),
            Function::Sigmoid => update2(compute, g, y, |g, y| *g *= y * (1.0 - y)),
            Function::Softplus => update2(compute, g, y, |g, y| *g *= -(-y).exp_m1()),
        }
        tape.add_gradient(self.x, gradient);
    }
}

/// `1 / (1 + e^-x)`.
pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// `ln(1 + e^x)`, for any size of `x`.
pub(crate) fn softplus(x: f32) -> f32 {
    x.max(0.0) + (-x.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{check, noise};
    use crate::{Compute, Mode, Parameters};

    #[test]
    fn gradients_equal_finite_differences() {
        let mut x = noise(&[3, 5], 1);
        x.data_mut().iter_mut().for_each(|v| *v *= 3.0);
        check(&[x.clone()], 0.05, 1e-4, |tape, v| tape.exp(v[0]));
        check(&[x.clone()], 0.05, 1e-4, |tape, v| tape.sigmoid(v[0]));
        check(&[x], 0.05, 1e-4, |tape, v| tape.softplus(v[0]));
        let away_from_0 = Tensor::new(&[4], vec![-2.0, -0.5, 0.5, 3.0]);
        check(&[away_from_0], 0.05, 1e-5, |tape, v| tape.relu(v[0]));
    }

    #[test]
    fn softplus_and_sigmoid_are_exact_far_from_zero() {
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
        let x = tape.input(Tensor::new(&[3], vec![-200.0, 0.0, 200.0]));
        let y = tape.softplus(x);
        assert_eq!(tape.value(y).data(), [0.0, 2.0f32.ln(), 200.0]);
        let gradients = tape.backward_from(y, Tensor::full(&[3], 1.0));
        assert_eq!(gradients.get(x).unwrap().data(), [0.0, 0.5, 1.0]);
        assert_eq!([sigmoid(-200.0), sigmoid(200.0)], [0.0, 1.0]);
    }
}
