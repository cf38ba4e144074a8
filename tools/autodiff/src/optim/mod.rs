//! Updates of the parameters: optimizers, gradient clipping, learning rates.
//!
//! A parameter's own [`rate`](crate::Parameter::rate), [`decay`](crate::Parameter::decay) and
//! [`frozen`](crate::Parameter::frozen) say how; groups are whatever a filter over
//! [`Parameters::iter_mut`] selects. Frozen parameters, and those that no loss reached, keep every
//! bit of their value and of the optimizer's state.

mod adamw;
mod clip;
mod schedule;
mod sgd;

pub use adamw::AdamW;
pub use clip::clip_gradients;
pub use schedule::WarmupCosine;
pub use sgd::Sgd;

use crate::parameters::check_shape;
use crate::{Compute, Parameter, Parameters, StateError, Tensor};

/// Updates parameters from their gradients.
pub trait Optimizer {
    /// One step at a learning rate, for every trained parameter that has a gradient.
    fn step(&mut self, compute: &Compute, parameters: &mut Parameters, rate: f32);

    /// Everything to save, by names such as `momentum.conv1.weight`.
    fn state<'a>(&'a self, parameters: &'a Parameters) -> Vec<(String, &'a Tensor)>;

    /// Sets one tensor as [`state`](Self::state) gave it.
    ///
    /// # Errors
    /// If no tensor of the optimizer has that name, or it has another shape.
    fn restore(
        &mut self,
        parameters: &Parameters,
        name: &str,
        value: Tensor,
    ) -> Result<(), StateError>;
}

/// One tensor per parameter that an optimizer has moved.
#[derive(Clone, Debug)]
struct Slots {
    kind: &'static str,
    scalar: bool, // one value each, instead of the parameter's shape
    tensors: Vec<Option<Tensor>>,
}

impl Slots {
    /// Tensors of the parameters' shapes.
    fn tensors(kind: &'static str) -> Slots {
        Slots {
            kind,
            scalar: false,
            tensors: vec![],
        }
    }

    /// One value per parameter.
    fn scalars(kind: &'static str) -> Slots {
        Slots {
            kind,
            scalar: true,
            tensors: vec![],
        }
    }

    fn shape<'a>(&self, parameter: &'a Parameter) -> &'a [usize] {
        if self.scalar {
            &[]
        } else {
            parameter.value.shape()
        }
    }

    /// The tensor of the `i`-th parameter; zeros if there is none yet.
    fn get(&mut self, i: usize, parameter: &Parameter) -> &mut Tensor {
        if self.tensors.len() <= i {
            self.tensors.resize(i + 1, None);
        }
        let shape = self.shape(parameter);
        self.tensors[i].get_or_insert_with(|| Tensor::zeros(shape))
    }

    fn state<'a>(
        &'a self,
        parameters: &'a Parameters,
    ) -> impl Iterator<Item = (String, &'a Tensor)> {
        let named = parameters.iter().zip(&self.tensors);
        named.filter_map(|(parameter, tensor)| {
            Some((
                format!("{}.{}", self.kind, parameter.name()),
                tensor.as_ref()?,
            ))
        })
    }
}

/// Sets a tensor of whichever of `all` it belongs to by its name.
fn restore(
    all: &mut [&mut Slots],
    parameters: &Parameters,
    name: &str,
    value: Tensor,
) -> Result<(), StateError> {
    for slots in all {
        let parameter = name
            .strip_prefix(slots.kind)
            .and_then(|rest| rest.strip_prefix('.'));
        if let Some(id) = parameter.and_then(|parameter| parameters.find(parameter)) {
            let parameter = &parameters[id];
            check_shape(name, slots.shape(parameter), value.shape())?;
            *slots.get(id.0, parameter) = value;
            return Ok(());
        }
    }
    Err(StateError::Unknown(name.into()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn network() -> Parameters {
        let mut parameters = Parameters::new();
        for (name, values) in [("a", [1.0, -2.0]), ("b", [0.5, 3.0]), ("c", [4.0, 4.0])] {
            parameters.add(name, Tensor::new(&[2], values.to_vec()));
        }
        parameters.add_statistic("s", Tensor::scalar(1.0));
        parameters.iter_mut().for_each(|p| p.decay = 0.1);
        parameters
    }

    /// Gradients that change from step to step; the statistic has none, as on a tape.
    fn set_gradients(parameters: &mut Parameters, step: usize) {
        for p in parameters.iter_mut().filter(|p| !p.is_statistic()) {
            p.gradient = Some(Tensor::new(&[2], vec![0.3 * step as f32, -1.0]));
        }
    }

    fn optimizers() -> [Box<dyn Fn() -> Box<dyn Optimizer>>; 2] {
        [
            Box::new(|| Box::new(Sgd::new(0.9))),
            Box::new(|| Box::new(AdamW::default())),
        ]
    }

    #[test]
    fn frozen_parameter_keeps_every_bit() {
        let compute = Compute::new(1).unwrap();
        for optimizer in optimizers() {
            let (mut parameters, mut optimizer) = (network(), optimizer());
            let b = parameters.find("b").unwrap();
            set_gradients(&mut parameters, 0);
            optimizer.step(&compute, &mut parameters, 0.1);
            parameters[b].frozen = true;
            let saved = |optimizer: &dyn Optimizer, parameters: &Parameters| -> Vec<Tensor> {
                let state = optimizer.state(parameters).into_iter();
                let of_b = state
                    .filter(|(name, _)| name.ends_with(".b"))
                    .map(|(_, tensor)| tensor.clone());
                of_b.chain([parameters[b].value.clone()]).collect()
            };
            let before = saved(&*optimizer, &parameters);
            assert!(before.len() > 1);
            set_gradients(&mut parameters, 1);
            let a = parameters[parameters.find("a").unwrap()].value.clone();
            optimizer.step(&compute, &mut parameters, 0.1);
            assert_eq!(saved(&*optimizer, &parameters), before);
            assert_ne!(parameters[parameters.find("a").unwrap()].value, a);
            assert_eq!(parameters[parameters.find("s").unwrap()].value.item(), 1.0);
        }
    }

    #[test]
    fn restored_optimizer_continues_with_the_same_bits() {
        let compute = Compute::new(1).unwrap();
        for make in optimizers() {
            let (mut parameters, mut optimizer) = (network(), make());
            let c = parameters.find("c").unwrap();
            parameters[c].frozen = true; // has no state yet when the others are saved
            let run = |parameters: &mut Parameters, optimizer: &mut dyn Optimizer, steps| {
                for step in steps {
                    set_gradients(parameters, step);
                    optimizer.step(&compute, parameters, 0.1);
                }
            };
            run(&mut parameters, &mut *optimizer, 0..3);
            let (mut resumed, mut fresh) = (network(), make());
            for (name, value) in parameters.state() {
                resumed.restore(name, value.clone()).unwrap();
            }
            for (name, value) in optimizer.state(&parameters) {
                fresh.restore(&resumed, &name, value.clone()).unwrap();
            }
            run(&mut parameters, &mut *optimizer, 3..6);
            resumed[c].frozen = true;
            run(&mut resumed, &mut *fresh, 3..6);
            assert!(parameters.state().eq(resumed.state()));
        }
    }

    #[test]
    fn unknown_optimizer_state_is_refused() {
        let parameters = network();
        for make in optimizers() {
            let mut optimizer = make();
            let unknown = optimizer.restore(&parameters, "momentum.z", Tensor::zeros(&[2]));
            assert_eq!(unknown, Err(StateError::Unknown("momentum.z".into())));
        }
        let shape = Sgd::new(0.9).restore(&parameters, "momentum.a", Tensor::zeros(&[3]));
        assert!(matches!(shape, Err(StateError::Shape { .. })), "{shape:?}");
    }
}
