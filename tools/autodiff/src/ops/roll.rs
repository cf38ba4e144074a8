//! Rolling along the batch: item `b` gets item `b + shift`, counted around. Backwards the other way
//! round. Where processes share a batch, the last items come from the next process.

use crate::tape::Operation;
use crate::{ProcessGroup, Tape, Tensor, Var};

struct Roll {
    x: Var,
    shift: usize,
}

impl Tape<'_> {
    /// Item `b` of the result is item `(b + shift) mod batch` of `x` (`[batch, ..]`).
    ///
    /// Panics if `shift` is larger than one process's part of a shared batch.
    pub fn roll(&mut self, x: Var, shift: usize) -> Var {
        let mut out = self.compute.tensor(self.shape(x));
        let batch = *self
            .shape(x)
            .first()
            .unwrap_or_else(|| panic!("roll needs [batch, ..], found a scalar"));
        let processes = self.compute.processes();
        let shift = shift % (batch * processes.size());
        assert!(shift <= batch, "roll by {shift} of {batch} items");
        let (from, to) = (self.value(x).data(), out.data_mut());
        let (front, back) = from.split_at(from.len() / batch * shift);
        let (first, last) = to.split_at_mut(back.len());
        first.copy_from_slice(back);
        last.copy_from_slice(&of_neighbor(processes, front, 1));
        self.record(out, &[x], Roll { x, shift })
    }
}

/// What the process `distance` places further on gives, counted around.
fn of_neighbor(processes: &dyn ProcessGroup, own: &[f32], distance: usize) -> Vec<f32> {
    let neighbor = (processes.rank() + distance) % processes.size();
    processes.all(own)[neighbor * own.len()..][..own.len()].to_vec()
}

impl Operation for Roll {
    fn backward(&self, tape: &mut Tape, _: &Tensor, gradient: Tensor) {
        let mut share = tape.compute.tensor(gradient.shape());
        let processes = tape.compute.processes();
        let rolled = gradient.data().len() / gradient.shape()[0] * self.shift;
        let (first, last) = gradient.data().split_at(gradient.data().len() - rolled);
        let (front, back) = share.data_mut().split_at_mut(rolled);
        back.copy_from_slice(first);
        front.copy_from_slice(&of_neighbor(processes, last, processes.size() - 1));
        tape.add_gradient(self.x, share);
        tape.compute.recycle(gradient);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{check, noise};
    use crate::{Compute, Mode, Parameters};

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
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
        let x = tape.constant(Tensor::new(&[3, 1], vec![0.0, 1.0, 2.0]));

        let rolled = tape.roll(x, 1);

        assert_eq!(tape.value(rolled).data(), [1.0, 2.0, 0.0]);
    }
}
