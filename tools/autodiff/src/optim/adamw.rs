//! Adam with decoupled weight decay (Loshchilov and Hutter, "Decoupled weight decay
//! regularization", algorithm 2): `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`,
//! `p = p - rate (decay p + (m / (1 - b1^t)) / (sqrt(v / (1 - b2^t)) + epsilon))`, with `t` the
//! parameter's own steps.

use super::{Optimizer, Slots, restore};
use crate::vector::{update2, update3};
use crate::{Compute, Parameters, StateError, Tensor};

/// Adam with decoupled weight decay.
#[derive(Clone, Debug)]
pub struct AdamW {
    /// Decay rates of the running means of the gradients and of their squares.
    pub betas: [f32; 2],
    /// Added to the root of the squares' mean.
    pub epsilon: f32,
    mean: Slots,
    square: Slots,
    step: Slots,
}

impl Default for AdamW {
    /// Betas 0.9 and 0.999, epsilon 1e-8.
    fn default() -> AdamW {
        AdamW {
            betas: [0.9, 0.999],
            epsilon: 1e-8,
            mean: Slots::tensors("mean"),
            square: Slots::tensors("square"),
            step: Slots::scalars("step"),
        }
    }
}

impl Optimizer for AdamW {
    fn step(&mut self, compute: &Compute, parameters: &mut Parameters, rate: f32) {
        let ([b1, b2], epsilon) = (self.betas, self.epsilon);
        for (i, parameter) in parameters
            .iter_mut()
            .enumerate()
            .filter(|(_, p)| p.is_trained())
        {
            let rate = rate * parameter.rate;
            let Some(gradient) = &parameter.gradient else {
                continue;
            };
            let step = &mut self.step.get(i, parameter).data_mut()[0];
            *step += 1.0;
            let bias = |beta: f32| 1.0 - f64::from(beta).powf(f64::from(*step));
            let size = (f64::from(rate) / bias(b1)) as f32;
            let root = (1.0 / bias(b2).sqrt()) as f32;
            let keep = 1.0 - rate * parameter.decay;
            let mean = self.mean.get(i, parameter).data_mut();
            let square = self.square.get(i, parameter).data_mut();
            update2(compute, mean, gradient.data(), |m, g| {
                *m += (1.0 - b1) * (g - *m)
            });
            update2(compute, square, gradient.data(), |v, g| {
                *v = b2 * *v + (1.0 - b2) * g * g
            });
            update3(
                compute,
                parameter.value.data_mut(),
                mean,
                square,
                |p, m, v| {
                    *p = keep * *p - size * m / (v.sqrt() * root + epsilon);
                },
            );
        }
    }

    fn state<'a>(&'a self, parameters: &'a Parameters) -> Vec<(String, &'a Tensor)> {
        [&self.mean, &self.square, &self.step]
            .into_iter()
            .flat_map(|slots| slots.state(parameters))
            .collect()
    }

    fn restore(
        &mut self,
        parameters: &Parameters,
        name: &str,
        value: Tensor,
    ) -> Result<(), StateError> {
        restore(
            &mut [&mut self.mean, &mut self.square, &mut self.step],
            parameters,
            name,
            value,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the formula in `f64`.
    #[test]
    fn three_steps_equal_the_definition() {
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        let id = parameters.add("p", Tensor::scalar(2.0));
        (parameters[id].rate, parameters[id].decay) = (0.5, 0.1);
        let mut adamw = AdamW::default();
        let (mut p, mut m, mut v) = (2.0f64, 0.0, 0.0);
        for (t, g) in [(1, 0.5), (2, -3.0), (3, 0.01)] {
            parameters[id].gradient = Some(Tensor::scalar(g as f32));
            adamw.step(&compute, &mut parameters, 0.02);
            m = 0.9 * m + 0.1 * g;
            v = 0.999 * v + 0.001 * g * g;
            let (m_hat, v_hat) = (m / (1.0 - 0.9f64.powi(t)), v / (1.0 - 0.999f64.powi(t)));
            p -= 0.01 * (0.1 * p + m_hat / (v_hat.sqrt() + 1e-8));
            let found = f64::from(parameters[id].value.item());
            assert!((found - p).abs() < 1e-6, "step {t}: {found}, expected {p}");
        }
    }
}
