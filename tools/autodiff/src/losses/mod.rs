//! Losses with gradients in closed form (docs/method.md, sections 3.4, 3.7, 3.9), one per file.
//! Each computes its gradients along with its value and keeps them for the backward pass.

mod focal;
mod information;
mod iou;
mod mean_square;
mod quality;

pub use focal::Focal;
pub use iou::BoxDecoder;

use crate::tape::Operation;
use crate::vector::update1;
use crate::{Tape, Tensor, Var};

/// The operation of a loss: its gradients are already computed, for a loss gradient of 1.
struct Known {
    gradients: Vec<(Var, Tensor)>,
}

impl Tape<'_> {
    /// Records a scalar loss of this `value`, with its gradients by input.
    fn record_loss(&mut self, value: f64, gradients: Vec<(Var, Tensor)>) -> Var {
        let inputs: Vec<Var> = gradients.iter().map(|(var, _)| *var).collect();
        self.record(Tensor::scalar(value as f32), &inputs, Known { gradients })
    }

    /// The count of the whole batch, from that of this process's part.
    fn count_of_all(&self, count: usize) -> f64 {
        self.compute.processes().sums(&[count as f64])[0]
    }

    /// `1 / max(count, 1)` with the count of the whole batch.
    fn one_over(&self, count: usize) -> f64 {
        1.0 / self.count_of_all(count).max(1.0)
    }
}

impl Operation for Known {
    fn backward(&self, tape: &mut Tape, _: &Tensor, gradient: Tensor) {
        let factor = gradient.item();
        for (var, known) in &self.gradients {
            if tape.needs_gradient(*var) {
                let mut share = tape.compute.tensor(known.shape());
                share.data_mut().copy_from_slice(known.data());
                update1(tape.compute, share.data_mut(), |g| *g *= factor);
                tape.add_gradient(*var, share);
            }
        }
    }
}

#[cfg(test)]
mod testing {
    use crate::{Compute, Mode, Parameters, Tape, Tensor, Var};

    /// A loss of `inputs`, and its gradients with respect to them.
    pub fn value_and_gradients(
        inputs: &[Tensor],
        loss: impl Fn(&mut Tape, &[Var]) -> Var,
    ) -> (f32, Vec<Vec<f32>>) {
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
        let vars: Vec<Var> = inputs
            .iter()
            .map(|input| tape.input(input.clone()))
            .collect();
        let loss = loss(&mut tape, &vars);
        let value = tape.value(loss).item();
        let gradients = tape.backward(loss);
        (
            value,
            vars.iter()
                .map(|var| gradients.get(*var).unwrap().data().to_vec())
                .collect(),
        )
    }

    /// Asserts that all values are within `tolerance` of the expected ones.
    pub fn assert_near(found: &[f32], expected: &[f64], tolerance: f64) {
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (f64::from(*found) - expected).abs() <= tolerance,
                "found {found}, expected {expected}"
            );
        }
    }
}
