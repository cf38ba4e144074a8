//! A forward pass that keeps the output of each layer.

use autodiff::{Tape, Var};
use std::ops::{Deref, DerefMut};

/// A forward pass: its tape, and the values on it that each layer computed.
pub struct Pass<'t, 'p> {
    tape: &'t mut Tape<'p>,
    made: Vec<Made>,
}

/// The outputs of one layer in one run.
#[derive(Clone, Debug)]
pub struct Made {
    /// The layer's name; `backbone.pool1` and `backbone.pool2` are layers too.
    pub layer: String,
    /// Output of the convolution alone.
    pub convolved: Var,
    /// Output of the whole layer, the input of the next one.
    pub output: Var,
}

impl<'t, 'p> Pass<'t, 'p> {
    /// A pass without layers.
    pub fn new(tape: &'t mut Tape<'p>) -> Pass<'t, 'p> {
        Pass {
            tape,
            made: Vec::new(),
        }
    }

    /// Records the outputs of a layer.
    pub(super) fn remember(&mut self, layer: &str, convolved: Var, output: Var) {
        self.made.push(Made {
            layer: layer.into(),
            convolved,
            output,
        });
    }

    /// The outputs of all layers in the order of execution.
    pub fn into_made(self) -> Vec<Made> {
        self.made
    }
}

impl<'p> Deref for Pass<'_, 'p> {
    type Target = Tape<'p>;

    fn deref(&self) -> &Tape<'p> {
        self.tape
    }
}

impl<'p> DerefMut for Pass<'_, 'p> {
    fn deref_mut(&mut self) -> &mut Tape<'p> {
        self.tape
    }
}
