//! A forward pass, with what became of each layer on the way.

use autodiff::{Tape, Var};
use std::ops::{Deref, DerefMut};

/// A forward pass: the tape that it is written on, and which layer made which of the tape's values.
pub struct Pass<'t, 'p> {
    tape: &'t mut Tape<'p>,
    made: Vec<Made>,
}

/// What one layer made of its input in one run.
#[derive(Clone, Debug)]
pub struct Made {
    /// The layer's name; `backbone.pool1` and `backbone.pool2` are layers too.
    pub layer: String,
    /// Behind the convolution, before anything that follows it.
    pub convolved: Var,
    /// As the next layer sees it.
    pub output: Var,
}

impl<'t, 'p> Pass<'t, 'p> {
    /// A pass that begins.
    pub fn new(tape: &'t mut Tape<'p>) -> Pass<'t, 'p> {
        Pass {
            tape,
            made: Vec::new(),
        }
    }

    /// Remembers what a layer made.
    pub(super) fn remember(&mut self, layer: &str, convolved: Var, output: Var) {
        self.made.push(Made {
            layer: layer.into(),
            convolved,
            output,
        });
    }

    /// What every layer made, in the order of execution.
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
