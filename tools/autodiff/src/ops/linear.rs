//! A fully connected layer: `y = x w^T + b`.
//!
//! Shapes: `x` `[.., inputs]`, weights `[outputs, inputs]`, bias `[outputs]`, `y` `[.., outputs]`.
//! Backwards: `dx = g w`, `dw = g^T x`, `db` the sum of `g`. There are few rows and many weights,
//! so each product is split along the weights, and every weight is read once.

use super::map::sum_positions;
use crate::tape::Operation;
use crate::{Compute, Tape, Tensor, Var};
use kernels::gemm::{Matrix, product};

struct Linear {
    x: Var,
    weights: Var,
    bias: Var,
}

/// Outputs, or inputs, that one thread takes at a time.
const PART: usize = 64;

impl Tape<'_> {
    /// `x` (`[.., inputs]`) times `weights` (`[outputs, inputs]`) transposed, plus `bias`
    /// (`[outputs]`).
    ///
    /// Panics if the shapes do not fit each other.
    pub fn linear(&mut self, x: Var, weights: Var, bias: Var) -> Var {
        let (rows, inputs) = self.value(x).rows("linear");
        let [outputs, width] = self.shape(weights)[..] else {
            panic!(
                "linear needs weights [outputs, inputs], found {:?}",
                self.shape(weights)
            )
        };
        assert_eq!(width, inputs, "linear: inputs");
        assert_eq!(self.shape(bias), [outputs], "linear: bias");
        let (input, weight) = (self.value(x).data(), self.value(weights).data());
        let mut shape = self.shape(x).to_vec();
        shape[self.shape(x).len() - 1] = outputs;
        let mut out = transposed_product(self.compute, &shape, |first, len| {
            let weight = Matrix::new(&weight[first * inputs..][..len * inputs], len, inputs);
            (weight, Matrix::new(input, rows, inputs).transposed())
        });
        for row in out.data_mut().chunks_exact_mut(outputs) {
            row.iter_mut()
                .zip(self.value(bias).data())
                .for_each(|(y, b)| *y += b);
        }
        self.record(out, &[x, weights, bias], Linear { x, weights, bias })
    }
}

/// A tensor of that shape, `[.., columns]`, whose transpose is a product: `factors(first, len)` are
/// those of `len` of its rows from `first` on.
fn transposed_product<'a>(
    compute: &Compute,
    shape: &[usize],
    factors: impl Fn(usize, usize) -> (Matrix<'a>, Matrix<'a>) + Sync,
) -> Tensor {
    let mut out = compute.tensor(shape);
    let (rows, columns) = out.rows("linear");
    let mut transposed = compute.tensor(&[columns, rows]);
    compute.each(transposed.data_mut(), PART * rows, |i, part| {
        let (a, b) = factors(i * PART, part.len() / rows);
        product(a, b, part);
    });
    for (c, column) in transposed.data().chunks_exact(rows).enumerate() {
        let cells = out.data_mut()[c..].iter_mut().step_by(columns);
        cells.zip(column).for_each(|(to, from)| *to = *from);
    }
    compute.recycle(transposed);
    out
}

impl Operation for Linear {
    fn backward(&self, tape: &mut Tape, _: &Tensor, gradient: Tensor) {
        let compute = tape.compute;
        let (rows, outputs) = gradient.rows("linear");
        let (_, inputs) = tape.value(self.x).rows("linear");
        if tape.needs_gradient(self.bias) {
            let share = sum_positions(compute, &gradient);
            tape.add_gradient(self.bias, share);
        }
        if tape.needs_gradient(self.weights) {
            let mut share = compute.tensor(&[outputs, inputs]);
            let x = tape.value(self.x).data();
            compute.each(share.data_mut(), PART * inputs, |i, part| {
                let columns = i * PART..i * PART + part.len() / inputs;
                let gradient = Matrix::new(gradient.data(), rows, outputs).columns(columns);
                product(gradient.transposed(), Matrix::new(x, rows, inputs), part);
            });
            tape.add_gradient(self.weights, share);
        }
        if tape.needs_gradient(self.x) {
            let weights = tape.value(self.weights).data();
            let share = transposed_product(compute, tape.shape(self.x), |first, len| {
                let weights = Matrix::new(weights, outputs, inputs).columns(first..first + len);
                (
                    weights.transposed(),
                    Matrix::new(gradient.data(), rows, outputs).transposed(),
                )
            });
            tape.add_gradient(self.x, share);
        }
        compute.recycle(gradient);
    }
}

#[cfg(test)]
mod tests {
    use crate::check::{check, noise};

    #[test]
    fn gradients_equal_finite_differences() {
        for (rows, inputs, outputs) in [
            (&[3][..], 5, 4),
            (&[2, 2], 3, 1),
            (&[1], 67, 2),
            (&[2], 2, 66),
        ] {
            let x = noise(&[rows, &[inputs]].concat(), 1);
            let parameters = [noise(&[outputs, inputs], 2), noise(&[outputs], 3)];
            let [weights, bias] = parameters;
            check(&[x, weights, bias], 0.25, 1e-5, |tape, v| {
                tape.linear(v[0], v[1], v[2])
            });
        }
    }
}
