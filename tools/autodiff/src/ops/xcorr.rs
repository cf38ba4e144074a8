//! Depthwise cross-correlation of every item's search features with its own template features:
//! `y[i, j, c] = sum over u, v of x[i + u, j + v, c] z[u, v, c]`, valid, no bias (docs/method.md,
//! section 1.3).
//!
//! Shapes: search `[batch, H, W, C]`, template `[batch, h, w, C]` -> response
//! `[batch, H-h+1, W-w+1, C]`. Backwards (docs/method.md, section 3.9), both on the forward's
//! kernel:
//! - template: the correlation of the search features with `g`;
//! - search: the correlation of `g`, with `h - 1` and `w - 1` zeros around it, with the template
//!   turned by half a turn.

use super::map::Placement;
use crate::tape::Operation;
use crate::tensor::Maps;
use crate::{Compute, Tape, Tensor, Var};
use kernels::Size;
use kernels::par::Threads;
use kernels::xcorr::{Features, xcorr};

struct CrossCorrelation {
    search: Var,
    template: Var,
}

impl Tape<'_> {
    /// Correlates `search` (`[batch, H, W, C]`) with `template` (`[batch, h, h, C]`), item by item.
    ///
    /// Panics if batch or channels differ, or if the template is not square or the larger one.
    pub fn xcorr(&mut self, search: Var, template: Var) -> Var {
        let (x, z) = (self.value(search), self.value(template));
        let maps = z.maps("xcorr");
        assert_eq!(maps.size.h, maps.size.w, "xcorr: square template");
        let out = correlate(self.compute, x, z);
        self.record(
            out,
            &[search, template],
            CrossCorrelation { search, template },
        )
    }
}

/// Correlates every item of `x` with its own `z`.
fn correlate(compute: &Compute, x: &Tensor, z: &Tensor) -> Tensor {
    let (xs, zs) = (x.maps("xcorr"), z.maps("xcorr"));
    assert_eq!(
        (xs.batch, xs.channels),
        (zs.batch, zs.channels),
        "xcorr: batch and channels"
    );
    assert!(
        zs.size.h <= xs.size.h && zs.size.w <= xs.size.w,
        "xcorr: template {zs:?} in {xs:?}"
    );
    let size = Size {
        h: xs.size.h - zs.size.h + 1,
        w: xs.size.w - zs.size.w + 1,
    };
    let out_maps = Maps { size, ..xs };
    let mut out = compute.tensor(&out_maps.shape());
    let one = Threads::new(1);
    compute.each(out.data_mut(), out_maps.image(), |i, out| {
        let search = Features {
            values: &x.data()[i * xs.image()..][..xs.image()],
            size: xs.size,
        };
        let template = Features {
            values: &z.data()[i * zs.image()..][..zs.image()],
            size: zs.size,
        };
        xcorr(compute.isa(), &one, search, template, xs.channels, out);
    });
    out
}

impl Operation for CrossCorrelation {
    fn backward(&self, tape: &mut Tape, _: &Tensor, gradient: Tensor) {
        let compute = tape.compute;
        if tape.needs_gradient(self.template) {
            let share = correlate(compute, tape.value(self.search), &gradient);
            tape.add_gradient(self.template, share);
        }
        if tape.needs_gradient(self.search) {
            let turned = turn(compute, tape.value(self.template));
            let side = turned.maps("xcorr").size.h;
            let padded =
                Placement::pad(gradient.maps("xcorr").size, side - 1).place(compute, &gradient);
            let share = correlate(compute, &padded, &turned);
            compute.recycle(padded);
            compute.recycle(turned);
            tape.add_gradient(self.search, share);
        }
        compute.recycle(gradient);
    }
}

/// Every map turned by half a turn.
fn turn(compute: &Compute, z: &Tensor) -> Tensor {
    let maps = z.maps("xcorr");
    let mut turned = compute.tensor(z.shape());
    compute.each(turned.data_mut(), maps.image(), |i, turned| {
        let pixels = z.data()[i * maps.image()..][..maps.image()]
            .chunks_exact(maps.channels)
            .rev();
        turned
            .chunks_exact_mut(maps.channels)
            .zip(pixels)
            .for_each(|(to, from)| to.copy_from_slice(from));
    });
    turned
}

#[cfg(test)]
mod tests {
    use crate::check::{check, noise};

    #[test]
    fn gradients_equal_finite_differences() {
        for (h, w, side, channels) in [(4, 5, 2, 3), (4, 4, 4, 1), (5, 3, 1, 17)] {
            let inputs = [
                noise(&[2, h, w, channels], 1),
                noise(&[2, side, side, channels], 2),
            ];
            check(&inputs, 0.25, 1e-5, |tape, v| tape.xcorr(v[0], v[1]));
        }
    }
}
