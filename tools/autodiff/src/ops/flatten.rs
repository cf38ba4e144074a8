//! Flattening of a map with channels outermost: the order in which PyTorch's linear layers expect a
//! map's values.
//!
//! Shapes: `[batch, H, W, C] -> [batch, C H W]`, with the value of `(y, x, c)` at
//! `(c H + y) W + x`. The backward pass moves each gradient back.

use crate::tape::Operation;
use crate::{Tape, Tensor, Var};

struct Flatten {
    x: Var,
}

impl Tape<'_> {
    /// `x` (`[batch, H, W, C]`) as `[batch, C H W]`.
    pub fn flatten(&mut self, x: Var) -> Var {
        let maps = self.value(x).maps("flatten");
        let mut out = self.compute.tensor(&[maps.batch, maps.image()]);
        let input = self.value(x).data();
        self.compute.each(out.data_mut(), maps.image(), |i, out| {
            transpose(
                &input[i * maps.image()..][..maps.image()],
                maps.channels,
                out,
            );
        });
        self.record(out, &[x], Flatten { x })
    }
}

/// `from` (`[.., columns]`) with rows and columns exchanged.
fn transpose(from: &[f32], columns: usize, to: &mut [f32]) {
    for (column, to) in to.chunks_exact_mut(from.len() / columns).enumerate() {
        to.iter_mut()
            .zip(from[column..].iter().step_by(columns))
            .for_each(|(to, from)| *to = *from);
    }
}

impl Operation for Flatten {
    fn backward(&self, tape: &mut Tape, _: &Tensor, gradient: Tensor) {
        let maps = tape.value(self.x).maps("flatten");
        let mut share = tape.compute.tensor(&maps.shape());
        tape.compute
            .each(share.data_mut(), maps.image(), |i, share| {
                transpose(
                    &gradient.data()[i * maps.image()..][..maps.image()],
                    maps.size.area(),
                    share,
                );
            });
        tape.add_gradient(self.x, share);
        tape.compute.recycle(gradient);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{check, noise};

    #[test]
    fn gradients_equal_finite_differences() {
        check(&[noise(&[2, 3, 4, 5], 1)], 0.25, 1e-5, |tape, v| {
            tape.flatten(v[0])
        });
    }

    #[test]
    fn channels_become_outermost() {
        let mut to = [0.0; 6];
        transpose(&[0.0, 10.0, 1.0, 11.0, 2.0, 12.0], 2, &mut to);
        assert_eq!(to, [0.0, 1.0, 2.0, 10.0, 11.0, 12.0]);
    }
}
