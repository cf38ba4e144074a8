//! A window of a map.
//!
//! Shapes: `[batch, H, W, C] -> [batch, h, w, C]`, the same window for every item. Backwards zeros
//! around the window.

use crate::tape::Operation;
use crate::{Tape, Tensor, Var};
use kernels::Size;

struct Crop {
    x: Var,
    top: usize,
    left: usize,
}

impl Tape<'_> {
    /// The window of `x` (`[batch, H, W, C]`) of that `size` whose first pixel is in row `top`,
    /// column `left`.
    ///
    /// Panics if it sticks out of the map.
    pub fn crop(&mut self, x: Var, (top, left): (usize, usize), size: Size) -> Var {
        let maps = self.value(x).maps("crop");
        let inside = top + size.h <= maps.size.h && left + size.w <= maps.size.w && size.area() > 0;
        assert!(
            inside,
            "crop of {size:?} at ({top}, {left}) of maps {maps:?}"
        );
        let mut out = self
            .compute
            .tensor(&[maps.batch, size.h, size.w, maps.channels]);
        let row = size.w * maps.channels;
        for (i, out) in out.data_mut().chunks_exact_mut(row).enumerate() {
            let y = i / size.h * maps.size.h + top + i % size.h;
            out.copy_from_slice(
                &self.value(x).data()[(y * maps.size.w + left) * maps.channels..][..row],
            );
        }
        self.record(out, &[x], Crop { x, top, left })
    }
}

impl Operation for Crop {
    fn backward(&self, tape: &mut Tape, output: &Tensor, gradient: Tensor) {
        let (maps, window) = (tape.value(self.x).maps("crop"), output.maps("crop"));
        let mut share = tape.compute.zeros(&maps.shape());
        let row = window.size.w * window.channels;
        for (i, gradient) in gradient.data().chunks_exact(row).enumerate() {
            let y = i / window.size.h * maps.size.h + self.top + i % window.size.h;
            share.data_mut()[(y * maps.size.w + self.left) * maps.channels..][..row]
                .copy_from_slice(gradient);
        }
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
        let x = noise(&[2, 4, 5, 3], 1);
        check(std::slice::from_ref(&x), 0.25, 1e-5, |tape, v| {
            tape.crop(v[0], (1, 2), Size { h: 2, w: 3 })
        });
        check(&[x], 0.25, 1e-5, |tape, v| {
            tape.crop(v[0], (0, 0), Size { h: 4, w: 5 })
        });
    }
}
