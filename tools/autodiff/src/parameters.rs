//! Named tensors with their gradients and training options: parameters and statistics.

use crate::{ProcessGroup, Tensor};
use std::collections::HashMap;

/// A parameter of one [`Parameters`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ParameterId(pub(crate) usize);

/// A named tensor that training changes.
#[derive(Clone, Debug)]
pub struct Parameter {
    name: String,
    trained: bool,
    /// Its value.
    pub value: Tensor,
    /// The sum of its gradients since [`Parameters::clear_gradients`]; none if no loss reached it.
    pub gradient: Option<Tensor>,
    /// Whether training leaves its value as it is: it gets no gradient and no update.
    pub frozen: bool,
    /// Factor on the learning rate.
    pub rate: f32,
    /// Weight decay.
    pub decay: f32,
}

impl Parameter {
    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether an optimizer may update it: it is neither a statistic nor frozen.
    pub fn is_trained(&self) -> bool {
        self.trained && !self.frozen
    }

    /// Whether it is a statistic, such as a running mean: kept with the parameters, but not learned
    /// by gradient.
    pub fn is_statistic(&self) -> bool {
        !self.trained
    }
}

/// Saved state that does not belong to what it is restored into.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    /// There is no such tensor.
    #[error("tensor '{0}' is unknown here")]
    Unknown(String),
    /// The tensor has another shape.
    #[error("tensor '{name}': expected shape {expected:?}, found {found:?}")]
    Shape {
        /// Its name.
        name: String,
        /// The shape that belongs here.
        expected: Vec<usize>,
        /// The shape of the saved tensor.
        found: Vec<usize>,
    },
}

/// Refuses a saved tensor of the wrong shape.
pub(crate) fn check_shape(
    name: &str,
    expected: &[usize],
    found: &[usize],
) -> Result<(), StateError> {
    if expected == found {
        return Ok(());
    }
    Err(StateError::Shape {
        name: name.into(),
        expected: expected.to_vec(),
        found: found.to_vec(),
    })
}

/// All parameters of a network, by name and by [`ParameterId`].
#[derive(Clone, Debug, Default)]
pub struct Parameters {
    list: Vec<Parameter>,
    names: HashMap<String, ParameterId>,
}

impl Parameters {
    /// A set without parameters.
    pub fn new() -> Parameters {
        Parameters::default()
    }

    /// Adds a parameter with rate 1 and no decay. Panics if the name is taken.
    pub fn add(&mut self, name: impl Into<String>, value: Tensor) -> ParameterId {
        self.push(name.into(), value, true)
    }

    /// Adds a statistic, which is saved like a parameter but never learned by gradient. Panics if
    /// the name is taken.
    pub fn add_statistic(&mut self, name: impl Into<String>, value: Tensor) -> ParameterId {
        self.push(name.into(), value, false)
    }

    fn push(&mut self, name: String, value: Tensor, trained: bool) -> ParameterId {
        let id = ParameterId(self.list.len());
        assert!(
            self.names.insert(name.clone(), id).is_none(),
            "two parameters named '{name}'"
        );
        let parameter = Parameter {
            name,
            trained,
            value,
            gradient: None,
            frozen: false,
            rate: 1.0,
            decay: 0.0,
        };
        self.list.push(parameter);
        id
    }

    /// The parameter of that name.
    pub fn find(&self, name: &str) -> Option<ParameterId> {
        self.names.get(name).copied()
    }

    /// All of them, in the order in which they were added.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Parameter> {
        self.list.iter()
    }

    /// All of them, to change: a group is whatever a filter over them selects.
    pub fn iter_mut(&mut self) -> impl ExactSizeIterator<Item = &mut Parameter> {
        self.list.iter_mut()
    }

    /// Clears all gradients, at the beginning of a step.
    pub fn clear_gradients(&mut self) {
        self.iter_mut()
            .for_each(|parameter| parameter.gradient = None);
    }

    /// Completes the gradients: adds those of the other processes.
    pub fn add_up(&mut self, processes: &dyn ProcessGroup) {
        if processes.size() == 1 {
            return;
        }
        let gradients = || self.list.iter().filter_map(|p| p.gradient.as_ref());
        let mut all = Vec::with_capacity(gradients().map(|g| g.data().len()).sum());
        gradients().for_each(|gradient| all.extend_from_slice(gradient.data()));
        processes.add_up(&mut all);
        let mut rest = &all[..];
        for gradient in self.list.iter_mut().filter_map(|p| p.gradient.as_mut()) {
            let (own, others) = rest.split_at(gradient.data().len());
            gradient.data_mut().copy_from_slice(own);
            rest = others;
        }
    }

    /// Everything to save: names and values, statistics included.
    pub fn state(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.iter()
            .map(|parameter| (parameter.name(), &parameter.value))
    }

    /// Sets one value as [`state`](Self::state) gave it.
    ///
    /// # Errors
    /// If no parameter has that name, or it has another shape.
    pub fn restore(&mut self, name: &str, value: Tensor) -> Result<(), StateError> {
        let id = self
            .find(name)
            .ok_or_else(|| StateError::Unknown(name.into()))?;
        check_shape(name, self[id].value.shape(), value.shape())?;
        self[id].value = value;
        Ok(())
    }
}

impl std::ops::Index<ParameterId> for Parameters {
    type Output = Parameter;

    fn index(&self, id: ParameterId) -> &Parameter {
        &self.list[id.0]
    }
}

impl std::ops::IndexMut<ParameterId> for Parameters {
    fn index_mut(&mut self, id: ParameterId) -> &mut Parameter {
        &mut self.list[id.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn saved_state_is_restored() {
        let mut parameters = Parameters::new();
        parameters.add("a", Tensor::new(&[2], vec![1.0, -0.0]));
        parameters.add_statistic("b", Tensor::scalar(3.0));
        let saved: Vec<_> = parameters
            .state()
            .map(|(name, t)| (name.to_owned(), t.clone()))
            .collect();
        parameters
            .iter_mut()
            .for_each(|p| p.value.data_mut().fill(9.0));
        for (name, value) in saved {
            parameters.restore(&name, value).unwrap();
        }
        let a = parameters.find("a").unwrap();
        assert_eq!(parameters[a].value.data()[1].to_bits(), (-0.0f32).to_bits());
        assert_eq!(
            parameters
                .iter()
                .map(Parameter::is_statistic)
                .collect::<Vec<_>>(),
            [false, true]
        );
    }

    #[test]
    fn unknown_state_is_refused_by_name() {
        let mut parameters = Parameters::new();
        parameters.add("a", Tensor::zeros(&[2]));
        assert_eq!(
            parameters
                .restore("c", Tensor::scalar(0.0))
                .unwrap_err()
                .to_string(),
            "tensor 'c' is unknown here"
        );
        assert_eq!(
            parameters
                .restore("a", Tensor::zeros(&[3]))
                .unwrap_err()
                .to_string(),
            "tensor 'a': expected shape [2], found [3]"
        );
    }

    #[test]
    #[should_panic(expected = "two parameters named 'a'")]
    fn second_parameter_of_a_name_panics() {
        let mut parameters = Parameters::new();
        parameters.add("a", Tensor::scalar(0.0));
        parameters.add("a", Tensor::scalar(0.0));
    }
}
