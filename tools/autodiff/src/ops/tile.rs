//! Tiling: one vector per item, repeated at every position of a map.
//!
//! Shapes: `[batch, C] -> [batch, H, W, C]`. Backwards the sum over positions.

use super::map::SumRows;
use crate::tape::Operation;
use crate::{Compute, Tape, Tensor, Var};
use kernels::Size;

struct Tile {
    x: Var,
}

impl Tape<'_> {
    /// `x` (`[batch, C]`) at every position of a map of `size`: `[batch, H, W, C]`.
    pub fn tile(&mut self, x: Var, size: Size) -> Var {
        let out = repeat(self.compute, self.value(x), size);
        self.record(out, &[x], Tile { x })
    }
}

/// The rows of `x` (`[batch, C]`) at every position of maps of `size`.
pub(super) fn repeat(compute: &Compute, x: &Tensor, size: Size) -> Tensor {
    let [batch, channels] = x.shape()[..] else {
        panic!("tile needs [batch, C], found {:?}", x.shape())
    };
    let mut out = compute.tensor(&[batch, size.h, size.w, channels]);
    compute.each(out.data_mut(), size.area() * channels, |i, out| {
        let row = &x.data()[i * channels..][..channels];
        out.chunks_exact_mut(channels)
            .for_each(|out| out.copy_from_slice(row));
    });
    out
}

impl Operation for Tile {
    fn backward(&self, tape: &mut Tape, output: &Tensor, gradient: Tensor) {
        let maps = output.maps("tile");
        let compute = tape.compute;
        let mut share = compute.tensor(&[maps.batch, maps.channels]);
        compute.each(share.data_mut(), maps.channels, |i, share| {
            let mut sums = vec![0.0; maps.channels];
            let x = &gradient.data()[i * maps.image()..][..maps.image()];
            compute.isa().run(SumRows { x, sums: &mut sums });
            share
                .iter_mut()
                .zip(sums)
                .for_each(|(share, sum)| *share = sum as f32);
        });
        tape.add_gradient(self.x, share);
        compute.recycle(gradient);
    }
}

#[cfg(test)]
mod tests {
    use crate::check::{check, noise};
    use kernels::Size;

    #[test]
    fn gradients_equal_finite_differences() {
        let size = Size { h: 2, w: 3 };
        check(&[noise(&[3, 5], 1)], 0.25, 1e-5, |tape, v| {
            tape.tile(v[0], size)
        });
    }
}
