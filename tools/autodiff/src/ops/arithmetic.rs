//! Sum of two tensors of one shape, `dx = dy = g`; and a constant times a tensor, `dx = factor g`.

use crate::tape::Operation;
use crate::vector::{update2, update3};
use crate::{Tape, Tensor, Var};

struct Add {
    a: Var,
    b: Var,
}

struct Scale {
    x: Var,
    factor: f32,
}

impl Tape<'_> {
    /// `a + b`. Panics if their shapes differ.
    pub fn add(&mut self, a: Var, b: Var) -> Var {
        assert_eq!(self.shape(a), self.shape(b), "add");
        let mut out = self.compute.tensor(self.shape(a));
        let inputs = (self.value(a).data(), self.value(b).data());
        update3(
            self.compute,
            out.data_mut(),
            inputs.0,
            inputs.1,
            |y, a, b| *y = a + b,
        );
        self.record(out, &[a, b], Add { a, b })
    }

    /// `factor x`.
    pub fn scale(&mut self, x: Var, factor: f32) -> Var {
        let mut out = self.compute.tensor(self.shape(x));
        update2(
            self.compute,
            out.data_mut(),
            self.value(x).data(),
            |y, x| *y = factor * x,
        );
        self.record(out, &[x], Scale { x, factor })
    }
}

impl Operation for Add {
    fn backward(&self, tape: &mut Tape, _: &Tensor, gradient: Tensor) {
        if tape.needs_gradient(self.a) && tape.needs_gradient(self.b) {
            let mut copy = tape.compute.tensor(gradient.shape());
            copy.data_mut().copy_from_slice(gradient.data());
            tape.add_gradient(self.a, copy);
            tape.add_gradient(self.b, gradient);
        } else {
            let only = if tape.needs_gradient(self.a) {
                self.a
            } else {
                self.b
            };
            tape.add_gradient(only, gradient);
        }
    }
}

impl Operation for Scale {
    fn backward(&self, tape: &mut Tape, _: &Tensor, mut gradient: Tensor) {
        let factor = self.factor;
        crate::vector::update1(tape.compute, gradient.data_mut(), |g| *g *= factor);
        tape.add_gradient(self.x, gradient);
    }
}

#[cfg(test)]
mod tests {
    use crate::check::{check, noise};

    #[test]
    fn gradients_equal_finite_differences() {
        let inputs = [noise(&[2, 3], 1), noise(&[2, 3], 2)];
        check(&inputs, 0.25, 1e-5, |tape, v| tape.add(v[0], v[1]));
        check(&inputs[..1], 0.25, 1e-5, |tape, v| tape.add(v[0], v[0]));
        check(&inputs[..1], 0.25, 1e-5, |tape, v| tape.scale(v[0], -1.5));
    }
}
