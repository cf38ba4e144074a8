//! Max-pool 3x3, stride 2, ceil mode (docs/method.md, section 1.1):
//! `y[oy, ox, c] = max of x[2 oy + dy, 2 ox + dx, c]`.
//!
//! Shapes: `[batch, H, W, C] -> [batch, H', W', C]`. Backwards the gradient goes to the first
//! maximum of a window in row-major order; windows overlap, so contributions add up
//! (docs/method.md, section 3.9).

use crate::tape::Operation;
use crate::tensor::Maps;
use crate::{Tape, Tensor, Var};
use kernels::Size;
use kernels::par::Threads;
use kernels::pool::{max_pool, out_size};
use kernels::simd::{Kernel, Simd};

struct MaxPool {
    x: Var,
}

impl Tape<'_> {
    /// The maxima of `x` (`[batch, H, W, C]`) over windows 3x3 at every second pixel.
    pub fn max_pool(&mut self, x: Var) -> Var {
        let maps = self.value(x).maps("max_pool");
        let out_maps = Maps {
            size: out_size(maps.size),
            ..maps
        };
        let mut out = self.compute.tensor(&out_maps.shape());
        let (one, isa, input) = (Threads::new(1), self.compute.isa(), self.value(x).data());
        self.compute
            .each(out.data_mut(), out_maps.image(), |i, out| {
                let image = &input[i * maps.image()..][..maps.image()];
                max_pool(isa, &one, image, maps.size, maps.channels, out);
            });
        self.record(out, &[x], MaxPool { x })
    }
}

impl Operation for MaxPool {
    fn backward(&self, tape: &mut Tape, output: &Tensor, mut gradient: Tensor) {
        let (x, compute) = (tape.value(self.x), tape.compute);
        let (maps, out_maps) = (x.maps("max_pool"), output.maps("max_pool"));
        let mut share = compute.tensor(&maps.shape());
        let parts = (gradient.data_mut(), out_maps.image());
        compute.each2(
            (share.data_mut(), maps.image()),
            parts,
            |i, share, gradient| {
                compute.isa().run(Unpool {
                    x: &x.data()[i * maps.image()..][..maps.image()],
                    size: maps.size,
                    y: &output.data()[i * out_maps.image()..][..out_maps.image()],
                    width: out_maps.size.w,
                    channels: maps.channels,
                    gradient,
                    share,
                });
            },
        );
        tape.add_gradient(self.x, share);
        compute.recycle(gradient);
    }
}

/// Gives one image's gradient to the first maximum of every window. Uses up `gradient`.
struct Unpool<'a> {
    x: &'a [f32], // [size.h, size.w, channels]
    size: Size,
    y: &'a [f32], // [H', width, channels]
    width: usize,
    channels: usize,
    gradient: &'a mut [f32], // [H', width, channels]
    share: &'a mut [f32],    // [size.h, size.w, channels]
}

impl Kernel for Unpool<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Unpool {
            x,
            size,
            y,
            width,
            channels,
            gradient,
            share,
        } = self;
        share.fill(0.0);
        let windows = gradient
            .chunks_exact_mut(channels)
            .zip(y.chunks_exact(channels))
            .enumerate();
        for (i, (gradient, y)) in windows {
            let (top, left) = (i / width * 2, i % width * 2);
            for iy in top..(top + 3).min(size.h) {
                for ix in left..(left + 3).min(size.w) {
                    let at = (iy * size.w + ix) * channels;
                    let share = &mut share[at..][..channels];
                    let inputs = x[at..][..channels].iter().zip(y);
                    for ((share, gradient), (x, y)) in
                        share.iter_mut().zip(gradient.iter_mut()).zip(inputs)
                    {
                        // What is given is taken away, so that a second maximum gets nothing.
                        let given = if x == y { *gradient } else { 0.0 };
                        *share += given;
                        *gradient -= given;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::check;
    use crate::{Compute, Mode, Parameters};

    /// Every value once, far enough apart for the check's step.
    fn shuffled(shape: &[usize]) -> Tensor {
        let n: usize = shape.iter().product();
        Tensor::new(shape, (0..n).map(|i| (i * 37 % n) as f32).collect())
    }

    #[test]
    fn gradients_equal_finite_differences() {
        for shape in [[2, 5, 7, 3], [1, 6, 4, 17], [1, 3, 3, 1]] {
            let x = shuffled(&shape);
            assert_ne!(x.data().len() % 37, 0);
            check(&[x], 0.25, 1e-5, |tape, v| tape.max_pool(v[0]));
        }
    }

    #[test]
    fn gradient_of_a_tie_goes_to_the_first_maximum() {
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
        // Two windows that share their middle column; both are 1 everywhere.
        let x = tape.input(Tensor::full(&[1, 3, 5, 1], 1.0));
        let y = tape.max_pool(x);
        let gradients = tape.backward_from(y, Tensor::new(&[1, 1, 2, 1], vec![2.0, 3.0]));
        let mut expected = [0.0; 15];
        (expected[0], expected[2]) = (2.0, 3.0);
        assert_eq!(gradients.get(x).unwrap().data(), expected);
    }
}
