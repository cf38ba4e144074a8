//! The tape records a computation while it runs, and computes its gradients in reverse order.
//!
//! Every value on the tape is a node; an operation appends one node and remembers the nodes it
//! read. [`Tape::backward`] pops nodes off the end. When a node is popped, every user of it has
//! added its share to the node's gradient, so that gradient is complete. The node's operation turns
//! it into shares for the nodes it read, and the node's value is freed.

use crate::{Compute, ParameterId, Parameters, Tensor};
use kernels::conv::{Algorithm, Conv};
use std::collections::HashMap;
use std::sync::Arc;

/// A value on one [`Tape`]. It means nothing on another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Var(usize);

/// Whether batch normalization uses the batch's statistics, or the running ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// The batch's own; the running ones are updated.
    Training,
    /// The running ones, which stay as they are.
    Evaluation,
}

/// The backward pass of an operation.
pub(crate) trait Operation {
    /// Adds to the gradients of the operation's inputs, given its `output` and the `gradient` of
    /// the loss with respect to it.
    fn backward(&self, tape: &mut Tape, output: &Tensor, gradient: Tensor);
}

/// A computation, recorded as it runs.
pub struct Tape<'a> {
    pub(crate) compute: &'a Compute,
    pub(crate) parameters: &'a mut Parameters,
    pub(crate) mode: Mode,
    nodes: Vec<Node>,
    leaves: HashMap<ParameterId, Var>,
    gradients: Vec<Option<Tensor>>, // of the nodes, while going backwards
    /// Convolutions whose weights are laid out already, by weight, direction and algorithm.
    pub(crate) packed: HashMap<(Var, Direction, Algorithm), Arc<Conv>>,
}

/// Which way a convolution's weights are laid out for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Direction {
    Forward,
    Backward,
}

struct Node {
    value: Value,
    operation: Option<Box<dyn Operation>>, // none for leaves and for what needs no gradient
    needs_gradient: bool,
}

enum Value {
    Own(Tensor),
    Parameter(ParameterId),
}

/// Gradients of a tape's inputs.
#[derive(Debug, Default)]
pub struct Gradients(HashMap<Var, Tensor>);

impl Gradients {
    /// The gradient of an [`input`](Tape::input); none if the loss does not depend on it.
    pub fn get(&self, input: Var) -> Option<&Tensor> {
        self.0.get(&input)
    }
}

impl<'a> Tape<'a> {
    /// An empty tape over `parameters`.
    pub fn new(compute: &'a Compute, parameters: &'a mut Parameters, mode: Mode) -> Tape<'a> {
        Tape {
            compute,
            parameters,
            mode,
            nodes: vec![],
            leaves: HashMap::new(),
            gradients: vec![],
            packed: HashMap::new(),
        }
    }

    /// A value without a gradient, such as a batch of images.
    pub fn constant(&mut self, value: Tensor) -> Var {
        self.append(Value::Own(value), None, false)
    }

    /// A value whose gradient [`backward`](Self::backward) returns.
    pub fn input(&mut self, value: Tensor) -> Var {
        self.append(Value::Own(value), None, true)
    }

    /// A parameter. Asked for twice, it is the same variable.
    pub fn parameter(&mut self, id: ParameterId) -> Var {
        if let Some(var) = self.leaves.get(&id) {
            return *var;
        }
        let needs_gradient = self.parameters[id].is_trained();
        let var = self.append(Value::Parameter(id), None, needs_gradient);
        self.leaves.insert(id, var);
        var
    }

    /// The value of a variable.
    pub fn value(&self, var: Var) -> &Tensor {
        match &self.nodes[var.0].value {
            Value::Own(value) => value,
            Value::Parameter(id) => &self.parameters[*id].value,
        }
    }

    /// A variable's extents.
    pub fn shape(&self, var: Var) -> &[usize] {
        self.value(var).shape()
    }

    /// Adds the gradients of the scalar `loss` to those of the parameters, and returns those of the
    /// inputs.
    ///
    /// Panics if `loss` is not one value.
    pub fn backward(self, loss: Var) -> Gradients {
        let shape = self.shape(loss).to_vec();
        assert_eq!(
            shape.iter().product::<usize>(),
            1,
            "a loss is one value, found {shape:?}"
        );
        self.backward_from(loss, Tensor::full(&shape, 1.0))
    }

    /// As [`backward`](Self::backward) for a loss that depends on `output` with that `gradient`, of
    /// the same shape.
    pub fn backward_from(mut self, output: Var, gradient: Tensor) -> Gradients {
        assert_eq!(
            self.shape(output),
            gradient.shape(),
            "gradient of an output"
        );
        self.gradients.resize_with(self.nodes.len(), || None);
        self.add_gradient(output, gradient);
        let mut inputs = HashMap::new();
        while let Some(node) = self.nodes.pop() {
            let gradient = self.gradients.pop().flatten();
            match (node.value, gradient) {
                (Value::Own(value), gradient) => {
                    match (node.operation, gradient) {
                        (Some(operation), Some(gradient)) => {
                            operation.backward(&mut self, &value, gradient)
                        }
                        (None, Some(gradient)) => {
                            _ = inputs.insert(Var(self.nodes.len()), gradient)
                        }
                        (_, None) => {}
                    }
                    self.compute.recycle(value);
                }
                (Value::Parameter(id), Some(gradient)) => {
                    add(self.compute, &mut self.parameters[id].gradient, gradient);
                }
                (Value::Parameter(_), None) => {}
            }
        }
        self.compute.end_step();
        Gradients(inputs)
    }

    /// Records an operation that read `inputs` and gave `value`.
    pub(crate) fn record(
        &mut self,
        value: Tensor,
        inputs: &[Var],
        operation: impl Operation + 'static,
    ) -> Var {
        let needs_gradient = inputs.iter().any(|input| self.needs_gradient(*input));
        let operation: Option<Box<dyn Operation>> = if needs_gradient {
            Some(Box::new(operation))
        } else {
            None
        };
        self.append(Value::Own(value), operation, needs_gradient)
    }

    fn append(
        &mut self,
        value: Value,
        operation: Option<Box<dyn Operation>>,
        needs_gradient: bool,
    ) -> Var {
        self.nodes.push(Node {
            value,
            operation,
            needs_gradient,
        });
        Var(self.nodes.len() - 1)
    }

    /// Whether a variable's gradient is needed.
    pub(crate) fn needs_gradient(&self, var: Var) -> bool {
        self.nodes[var.0].needs_gradient
    }

    /// Adds a share to a variable's gradient if that is needed.
    pub(crate) fn add_gradient(&mut self, var: Var, share: Tensor) {
        debug_assert_eq!(self.shape(var), share.shape(), "gradient of a variable");
        if self.needs_gradient(var) {
            add(self.compute, &mut self.gradients[var.0], share);
        } else {
            self.compute.recycle(share);
        }
    }
}

/// `sum += share`.
fn add(compute: &Compute, sum: &mut Option<Tensor>, share: Tensor) {
    match sum {
        None => *sum = Some(share),
        Some(sum) => {
            crate::vector::update2(compute, sum.data_mut(), share.data(), |s, x| *s += x);
            compute.recycle(share);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `w x` and its gradients, with `w` frozen or not.
    fn step(parameters: &mut Parameters, w: ParameterId) -> Gradients {
        let compute = Compute::new(1).unwrap();
        let mut tape = Tape::new(&compute, parameters, Mode::Training);
        let x = tape.input(Tensor::new(&[1, 2], vec![3.0, 5.0]));
        let unused = tape.input(Tensor::scalar(1.0));
        let (w, bias) = (tape.parameter(w), tape.constant(Tensor::zeros(&[1])));
        let y = tape.linear(x, w, bias);
        let loss = tape.sum(y);
        let gradients = tape.backward(loss);
        assert!(gradients.get(unused).is_none());
        assert_eq!(gradients.get(x).unwrap().data(), [2.0, 7.0]);
        gradients
    }

    #[test]
    fn gradients_accumulate_until_cleared() {
        let mut parameters = Parameters::new();
        let w = parameters.add("w", Tensor::new(&[1, 2], vec![2.0, 7.0]));
        for times in [1.0, 2.0] {
            step(&mut parameters, w);
            assert_eq!(
                parameters[w].gradient.as_ref().unwrap().data(),
                [3.0 * times, 5.0 * times]
            );
        }
        parameters.clear_gradients();
        assert!(parameters[w].gradient.is_none());
    }

    #[test]
    fn frozen_parameters_get_no_gradient() {
        let mut parameters = Parameters::new();
        let w = parameters.add("w", Tensor::new(&[1, 2], vec![2.0, 7.0]));
        parameters[w].frozen = true;
        step(&mut parameters, w);
        assert!(parameters[w].gradient.is_none());
    }

    #[test]
    fn value_without_gradient_records_no_operation() {
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        let w = parameters.add("w", Tensor::scalar(2.0));
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
        let x = tape.constant(Tensor::scalar(1.0));
        let y = tape.exp(x);
        let w_var = tape.parameter(w);
        assert_eq!(w_var, tape.parameter(w), "one variable per parameter");
        let z = tape.add(y, w_var);
        assert!(!tape.needs_gradient(y) && tape.needs_gradient(z));
        assert!(tape.nodes[y.0].operation.is_none());
        tape.backward(z);
        assert_eq!(parameters[w].gradient.as_ref().unwrap().item(), 1.0);
    }

    #[test]
    #[should_panic(expected = "a loss is one value, found [2]")]
    fn loss_of_many_values_panics() {
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
        let x = tape.input(Tensor::zeros(&[2]));
        tape.backward(x);
    }
}
