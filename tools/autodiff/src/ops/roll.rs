//! Rolling along the batch: item `b` gets item `b + shift`, counted around. Backwards the other way
//! round.

use crate::tape::Operation;
use crate::{Tape, Tensor, Var};

struct Roll {
    x: Var,
    shift: usize,
}

impl Tape<'_> {
    /// Item `b` of the result is item `(b + shift) mod batch` of `x` (`[batch, ..]`).
    pub fn roll(&mut self, x: Var, shift: usize) -> Var {
        let mut out = self.compute.tensor(self.shape(x));
        roll(self.value(x), &mut out, shift);
        self.record(out, &[x], Roll { x, shift })
    }
}

fn roll(from: &Tensor, to: &mut Tensor, shift: usize) {
    let batch = *from
        .shape()
        .first()
        .unwrap_or_else(|| panic!("roll needs [batch, ..], found a scalar"));
    let items = |n: usize| from.data().len() / batch * (n % batch);
    let (front, back) = from.data().split_at(items(shift));
    let (first, last) = to.data_mut().split_at_mut(back.len());
    first.copy_from_slice(back);
    last.copy_from_slice(front);
}

impl Operation for Roll {
    fn backward(&self, tape: &mut Tape, _: &Tensor, gradient: Tensor) {
        let batch = gradient.shape()[0];
        let mut share = tape.compute.tensor(gradient.shape());
        roll(&gradient, &mut share, batch - self.shift % batch);
        tape.add_gradient(self.x, share);
        tape.compute.recycle(gradient);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{check, noise};

    #[test]
    fn gradients_equal_finite_differences() {
        for shift in [0, 1, 2, 4] {
            check(&[noise(&[3, 2], 1)], 0.25, 1e-5, |tape, v| {
                tape.roll(v[0], shift)
            });
        }
    }

    #[test]
    fn every_item_gets_the_next_one() {
        let mut to = Tensor::zeros(&[3, 1]);
        roll(&Tensor::new(&[3, 1], vec![0.0, 1.0, 2.0]), &mut to, 1);
        assert_eq!(to.data(), [1.0, 2.0, 0.0]);
    }
}
