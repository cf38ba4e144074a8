//! Batch normalization per channel: `y = gamma (x - mean) / sqrt(variance + 1e-5) + beta`, then
//! ReLU if asked for.
//!
//! In training `mean` and `variance` are those of the batch, over its `m` images and positions. The
//! running ones then move toward them with momentum 0.1. The batch is normalized with the biased
//! variance; the running variance follows the unbiased one, `m / (m - 1)` times as large. In
//! evaluation the running ones are used, and the backward pass takes them as constants
//! (docs/method.md, sections 1.1, 3.9). Where processes share a batch, `m` and the sums below are
//! those of all of them.
//!
//! Shapes: `x` and `y` `[.., channels]`, `gamma` and `beta` `[channels]`.
//!
//! Backwards, with `g` the gradient of `y` (0 where ReLU cut off), `n` the normalized input and
//! `a = gamma / sqrt(variance + 1e-5)`:
//!
//! ```text
//! dbeta = sum g      dgamma = sum g n
//! dx    = a (g - dbeta / m - n dgamma / m)     in training
//! dx    = a g                                  in evaluation
//! ```

mod moments;
mod passes;

use crate::tape::Operation;
use crate::{Compute, Mode, ParameterId, Tape, Tensor, Var};
use moments::Moments;
use passes::{Affine, Differentiate, Normalize, Sums};

const EPSILON: f64 = 1e-5;
const MOMENTUM: f64 = 0.1;

/// Where a normalization keeps its running statistics, both `[channels]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RunningStatistics {
    /// The mean.
    pub mean: ParameterId,
    /// The unbiased variance.
    pub variance: ParameterId,
}

struct BatchNorm {
    x: Var,
    gamma: Var,
    beta: Var,
    affine: Affine,
    deviation: Vec<f64>, // [channels], sqrt(variance + EPSILON)
    mode: Mode,
}

impl Tape<'_> {
    /// Normalizes `x` (`[.., channels]`) and applies ReLU if asked for; in training, updates the
    /// `running` statistics.
    ///
    /// Panics if the shapes do not fit each other.
    pub fn batch_norm(
        &mut self,
        x: Var,
        gamma: Var,
        beta: Var,
        running: RunningStatistics,
        relu: bool,
    ) -> Var {
        let (rows, channels) = self.value(x).rows("batch_norm");
        for shape in [self.shape(gamma), self.shape(beta)] {
            assert_eq!(shape, [channels], "batch_norm of {channels} channels");
        }
        let (mean, variance) = match self.mode {
            Mode::Training => self.batch_statistics(x, running),
            Mode::Evaluation => self.running_statistics(running),
        };
        assert!(
            rows > 0 && mean.len() == channels && variance.len() == channels,
            "statistics of batch_norm"
        );
        let deviation: Vec<f64> = variance.iter().map(|v| (v + EPSILON).sqrt()).collect();
        let gammas = self.value(gamma).data().iter().zip(&deviation);
        let affine = Affine {
            mean: mean.iter().map(|v| *v as f32).collect(),
            a: gammas
                .map(|(gamma, deviation)| (f64::from(*gamma) / deviation) as f32)
                .collect(),
            b: self.value(beta).data().to_vec(),
            relu,
        };
        let mut out = self.compute.tensor(self.shape(x));
        let part = part_len(self.value(x));
        let input = self.value(x).data();
        self.compute.each(out.data_mut(), part, |i, out| {
            let x = &input[i * part..][..out.len()];
            self.compute.isa().run(Normalize {
                affine: &affine,
                x,
                out,
            });
        });
        let operation = BatchNorm {
            x,
            gamma,
            beta,
            affine,
            deviation,
            mode: self.mode,
        };
        self.record(out, &[x, gamma, beta], operation)
    }

    /// Mean and biased variance of `x` per channel; the `running` statistics follow.
    fn batch_statistics(&mut self, x: Var, running: RunningStatistics) -> (Vec<f64>, Vec<f64>) {
        let x = self.value(x);
        let Moments {
            mean,
            squares,
            count,
        } = Moments::of(self.compute, x, part_len(x)).over(self.compute.processes());
        let unbiased = squares.iter().map(|s| s / (count - 1.0).max(1.0));
        let running_mean = &mut self.parameters[running.mean].value;
        follow(running_mean.data_mut(), mean.iter().copied());
        let running_variance = &mut self.parameters[running.variance].value;
        follow(running_variance.data_mut(), unbiased);
        let variance = squares.iter().map(|s| s / count).collect();
        (mean, variance)
    }

    /// The `running` mean and variance.
    fn running_statistics(&self, running: RunningStatistics) -> (Vec<f64>, Vec<f64>) {
        let values = |id| {
            let statistic = self.parameters[id].value.data();
            statistic.iter().map(|v| f64::from(*v)).collect()
        };
        (values(running.mean), values(running.variance))
    }
}

/// Moves running statistics a step toward the batch's.
fn follow(running: &mut [f32], batch: impl Iterator<Item = f64>) {
    for (running, batch) in running.iter_mut().zip(batch) {
        *running = ((1.0 - MOMENTUM) * f64::from(*running) + MOMENTUM * batch) as f32;
    }
}

/// Values of one image, or of one row where there are no positions: what a thread takes at a time.
fn part_len(x: &Tensor) -> usize {
    x.data().len() / x.shape()[0]
}

impl BatchNorm {
    /// This process's `dbeta` and `dgamma`. Where ReLU cut off, zeroes `gradient` in place.
    fn parameter_gradients(
        &self,
        compute: &Compute,
        x: &Tensor,
        gradient: &mut Tensor,
    ) -> (Vec<f64>, Vec<f64>) {
        let channels = self.deviation.len();
        let part = part_len(x);
        let mut sums = vec![0.0f64; 2 * channels * x.shape()[0]];
        compute.each2(
            (gradient.data_mut(), part),
            (&mut sums, 2 * channels),
            |i, gradient, sums| {
                let x = &x.data()[i * part..][..part];
                compute.isa().run(Sums {
                    affine: &self.affine,
                    x,
                    gradient,
                    sums,
                });
            },
        );
        let total = |i: usize| sums[i..].iter().step_by(2 * channels).sum::<f64>();
        let beta = (0..channels).map(total).collect();
        let gamma = self
            .deviation
            .iter()
            .enumerate()
            .map(|(c, deviation)| total(channels + c) / deviation);
        (beta, gamma.collect())
    }
}

impl Operation for BatchNorm {
    fn backward(&self, tape: &mut Tape, _: &Tensor, mut gradient: Tensor) {
        let compute = tape.compute;
        let x = tape.value(self.x);
        let (rows, channels) = x.rows("batch_norm");
        let (beta, gamma) = self.parameter_gradients(compute, x, &mut gradient);

        if tape.needs_gradient(self.x) {
            let (shift, slope) = match self.mode {
                Mode::Training => {
                    let processes = compute.processes();
                    let sums = processes.sums(&[&beta[..], &gamma].concat());
                    let (beta, gamma) = sums.split_at(channels);
                    let m = (rows * processes.size()) as f64;
                    let slope = gamma
                        .iter()
                        .zip(&self.deviation)
                        .map(|(gamma, deviation)| gamma / deviation / m);
                    (
                        beta.iter().map(|beta| (beta / m) as f32).collect(),
                        slope.map(|v| v as f32).collect(),
                    )
                }
                Mode::Evaluation => (vec![0.0; channels], vec![0.0; channels]),
            };
            let part = part_len(x);
            compute.each(gradient.data_mut(), part, |i, gradient| {
                let x = &x.data()[i * part..][..part];
                compute.isa().run(Differentiate {
                    affine: &self.affine,
                    shift: &shift,
                    slope: &slope,
                    x,
                    gradient,
                });
            });
        }
        tape.add_gradient(self.x, gradient);
        let vector =
            |values: &[f64]| Tensor::new(&[channels], values.iter().map(|v| *v as f32).collect());
        tape.add_gradient(self.gamma, vector(&gamma));
        tape.add_gradient(self.beta, vector(&beta));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Parameters;
    use crate::check::{check_with, noise};

    fn parameters(channels: usize) -> (Parameters, RunningStatistics) {
        let mut parameters = Parameters::new();
        let mean = parameters.add_statistic("mean", noise(&[channels], 8));
        let variance = parameters.add_statistic("variance", Tensor::full(&[channels], 0.5));
        (parameters, RunningStatistics { mean, variance })
    }

    #[test]
    fn training_gradients_equal_finite_differences() {
        for shape in [&[2, 3, 3, 4][..], &[5, 2], &[1, 9, 8, 1]] {
            let channels = *shape.last().unwrap();
            let (mut parameters, running) = parameters(channels);
            let inputs = [
                noise(shape, 1),
                noise(&[channels], 2),
                noise(&[channels], 3),
            ];
            check_with(&mut parameters, &inputs, 0.02, 2e-4, |tape, v| {
                tape.batch_norm(v[0], v[1], v[2], running, false)
            });
        }
    }

    #[test]
    fn evaluation_gradients_equal_finite_differences() {
        let (mut parameters, running) = parameters(3);
        let inputs = [noise(&[2, 2, 2, 3], 1), noise(&[3], 2), noise(&[3], 3)];
        check_with(&mut parameters, &inputs, 0.1, 1e-5, |tape, v| {
            tape.mode = Mode::Evaluation;
            tape.batch_norm(v[0], v[1], v[2], running, false)
        });
    }

    #[test]
    fn relu_gradients_equal_finite_differences() {
        // Normalized to about +-1.2 and +-0.4 with beta 0.1: the check's step carries none of them
        // across 0.
        let x = Tensor::new(&[4, 1], vec![3.0, 4.0, 5.0, 6.0]);
        let (mut parameters, running) = parameters(1);
        let inputs = [x, Tensor::full(&[1], 0.9), Tensor::full(&[1], 0.1)];
        check_with(&mut parameters, &inputs, 0.02, 2e-4, |tape, v| {
            tape.batch_norm(v[0], v[1], v[2], running, true)
        });
    }

    #[test]
    fn training_normalizes_and_updates_statistics() {
        let compute = Compute::new(1).unwrap();
        let (mut parameters, running) = parameters(1);
        parameters[running.mean].value.data_mut()[0] = 2.0;
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
        let x = tape.constant(Tensor::new(&[4, 1], vec![1.0, 2.0, 3.0, 6.0]));
        let (gamma, beta) = (
            tape.constant(Tensor::full(&[1], 2.0)),
            tape.constant(Tensor::full(&[1], 1.0)),
        );
        let y = tape.batch_norm(x, gamma, beta, running, false);
        // Mean 3, biased variance 14 / 4, unbiased 14 / 3.
        let expected =
            [1.0f64, 2.0, 3.0, 6.0].map(|x| 2.0 * (x - 3.0) / (3.5f64 + 1e-5).sqrt() + 1.0);
        for (y, expected) in tape.value(y).data().iter().zip(expected) {
            assert!((f64::from(*y) - expected).abs() < 1e-6);
        }
        assert!((parameters[running.mean].value.item() - 2.1).abs() < 1e-6);
        assert!(
            (parameters[running.variance].value.item() - (0.45 + 0.1 * 14.0 / 3.0)).abs() < 1e-6
        );
    }
}
