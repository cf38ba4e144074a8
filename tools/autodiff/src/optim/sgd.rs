//! Stochastic gradient descent with momentum, as PyTorch has it (dampening 0, no Nesterov):
//! `m = momentum m + (g + decay p)`, `p = p - rate m`.

use super::{Optimizer, Slots, restore};
use crate::vector::{update2, update3};
use crate::{Compute, Parameters, StateError, Tensor};

/// Stochastic gradient descent with momentum.
#[derive(Clone, Debug)]
pub struct Sgd {
    factor: f32,
    momentum: Slots,
}

impl Sgd {
    /// An optimizer with this momentum.
    pub fn new(momentum: f32) -> Sgd {
        Sgd {
            factor: momentum,
            momentum: Slots::tensors("momentum"),
        }
    }
}

impl Optimizer for Sgd {
    fn step(&mut self, compute: &Compute, parameters: &mut Parameters, rate: f32) {
        let factor = self.factor;
        for (i, parameter) in parameters
            .iter_mut()
            .enumerate()
            .filter(|(_, p)| p.is_trained())
        {
            let (decay, rate) = (parameter.decay, rate * parameter.rate);
            let Some(gradient) = &parameter.gradient else {
                continue;
            };
            let momentum = self.momentum.get(i, parameter).data_mut();
            update3(
                compute,
                momentum,
                gradient.data(),
                parameter.value.data(),
                |m, g, p| {
                    *m = factor * *m + (g + decay * p);
                },
            );
            update2(compute, parameter.value.data_mut(), momentum, |p, m| {
                *p -= rate * m
            });
        }
    }

    fn state<'a>(&'a self, parameters: &'a Parameters) -> Vec<(String, &'a Tensor)> {
        self.momentum.state(parameters).collect()
    }

    fn restore(
        &mut self,
        parameters: &Parameters,
        name: &str,
        value: Tensor,
    ) -> Result<(), StateError> {
        restore(&mut [&mut self.momentum], parameters, name, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_steps_equal_a_calculation_by_hand() {
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        let id = parameters.add("p", Tensor::scalar(2.0));
        (parameters[id].rate, parameters[id].decay) = (0.5, 0.25);
        let mut sgd = Sgd::new(0.5);
        for expected in [
            2.0 - 0.05 * 1.5,                                // m = 1 + 0.25 * 2
            1.925 - 0.05 * (0.5 * 1.5 + 1.0 + 0.25 * 1.925), // m = half the old one + 1 + decay
        ] {
            parameters[id].gradient = Some(Tensor::scalar(1.0));
            sgd.step(&compute, &mut parameters, 0.1);
            assert!((parameters[id].value.item() - expected).abs() < 1e-6);
        }
        assert_eq!(sgd.state(&parameters)[0].0, "momentum.p");
    }
}
