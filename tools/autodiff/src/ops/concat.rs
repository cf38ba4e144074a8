//! Concatenation along the innermost extent, the channels.
//!
//! Shapes: `[.., a], [.., b], .. -> [.., a + b + ..]`. Backwards every input gets its part.

use crate::tape::Operation;
use crate::{Tape, Tensor, Var};

struct Concat {
    inputs: Vec<(Var, usize)>, // and their first channels
}

impl Tape<'_> {
    /// The channels of all `inputs`, one input after the other. Panics if there are none, or if
    /// they differ in another extent.
    pub fn concat(&mut self, inputs: &[Var]) -> Var {
        let outer = |tape: &Self, var: Var| {
            tape.shape(var)
                .split_last()
                .map(|(_, outer)| outer.to_vec())
        };
        let Some(mut shape) = inputs.first().and_then(|first| outer(self, *first)) else {
            panic!("concat of nothing")
        };
        let mut channels = 0;
        let mut parts = Vec::with_capacity(inputs.len());
        for input in inputs {
            assert_eq!(
                outer(self, *input).as_ref(),
                Some(&shape),
                "concat: extents but the last"
            );
            parts.push((*input, channels));
            channels += self.value(*input).rows("concat").1;
        }
        shape.push(channels);
        let mut out = self.compute.tensor(&shape);
        for (input, first) in &parts {
            let x = self.value(*input);
            let (_, width) = x.rows("concat");
            for (out, x) in out
                .data_mut()
                .chunks_exact_mut(channels)
                .zip(x.data().chunks_exact(width))
            {
                out[*first..][..width].copy_from_slice(x);
            }
        }
        self.record(out, inputs, Concat { inputs: parts })
    }
}

impl Operation for Concat {
    fn backward(&self, tape: &mut Tape, output: &Tensor, gradient: Tensor) {
        let (_, channels) = output.rows("concat");
        for (input, first) in &self.inputs {
            let mut share = tape.compute.tensor(tape.shape(*input));
            let (_, width) = share.rows("concat");
            let rows = share
                .data_mut()
                .chunks_exact_mut(width)
                .zip(gradient.data().chunks_exact(channels));
            rows.for_each(|(share, gradient)| share.copy_from_slice(&gradient[*first..][..width]));
            tape.add_gradient(*input, share);
        }
        tape.compute.recycle(gradient);
    }
}

#[cfg(test)]
mod tests {
    use crate::check::{check, noise};

    #[test]
    fn gradients_equal_finite_differences() {
        let inputs = [
            noise(&[2, 3, 2], 1),
            noise(&[2, 3, 1], 2),
            noise(&[2, 3, 4], 3),
        ];
        check(&inputs, 0.25, 1e-5, |tape, v| tape.concat(v));
    }

    #[test]
    fn an_input_given_twice_gets_both_gradients() {
        check(&[noise(&[2, 3], 1)], 0.25, 1e-5, |tape, v| {
            tape.concat(&[v[0], v[0]])
        });
    }
}
