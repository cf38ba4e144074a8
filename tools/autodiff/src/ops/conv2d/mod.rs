//! Convolution:
//! `y[o] = b[o] + sum over ky, kx, i of w[o, ky, kx, i] * x[sy + ky - pad, sx + kx - pad, i]`, then
//! ReLU if asked for.
//!
//! Shapes: input `[batch, H, W, Cin]`, weights `[Cout, k, k, Cin]`, bias `[Cout]`, output
//! `[batch, H', W', Cout]`. Backwards, with `g` the gradient of `y` (zeroed where ReLU was):
//! - bias: the sum of `g` over batch and positions;
//! - weights: `dw[o, ky, kx, i] = sum of g[y, x, o] * x[sy + ky - pad, sx + kx - pad, i]`, see
//!   [`weight_gradient`] and, with fewer multiplications, [`winograd_gradient`];
//! - input: the convolution of `g`, zeros between its pixels if the stride is more than 1 and
//!   `k - 1 - pad` of them around it, with the weights turned by half a turn and their channel axes
//!   exchanged. So it runs on the forward's kernels, Winograd's among them.
//!
//! All three cost the forward's multiply-accumulates (docs/method.md, section 3.9), fewer with
//! Winograd's algorithm, and images of a batch run in parallel.

mod weight_gradient;
mod winograd_gradient;

use crate::ops::map::{Placement, sum_positions};
use crate::tape::{Direction, Operation};
use crate::tensor::Maps;
use crate::{Compute, Tape, Tensor, Var};
use kernels::Size;
use kernels::conv::{Algorithm, Conv, ConvShape};
use kernels::par::Threads;
use std::sync::Arc;

/// Options of a convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conv2d {
    /// Stride in both directions.
    pub stride: usize,
    /// Zero padding on all four sides, less than the kernel.
    pub pad: usize,
    /// Whether negative outputs become 0.
    pub relu: bool,
}

impl Default for Conv2d {
    fn default() -> Conv2d {
        Conv2d {
            stride: 1,
            pad: 0,
            relu: false,
        }
    }
}

struct Convolution {
    x: Var,
    weights: Var,
    bias: Option<Var>,
    shape: ConvShape,
}

impl Tape<'_> {
    /// Convolves `x` (`[batch, H, W, Cin]`) with `weights` (`[Cout, k, k, Cin]`) and adds `bias`
    /// (`[Cout]`).
    ///
    /// Panics if the shapes do not fit each other.
    pub fn conv2d(&mut self, x: Var, weights: Var, bias: Option<Var>, options: Conv2d) -> Var {
        let maps = self.value(x).maps("conv2d");
        let [out_channels, kernel, k, in_channels] = self.shape(weights)[..] else {
            panic!(
                "conv2d needs weights [Cout, k, k, Cin], found {:?}",
                self.shape(weights)
            )
        };
        assert_eq!(
            (k, in_channels),
            (kernel, maps.channels),
            "conv2d: weights for an input {maps:?}"
        );
        assert!(
            options.pad < kernel && options.stride > 0,
            "conv2d: {options:?} with a kernel of {kernel}"
        );
        if let Some(bias) = bias {
            assert_eq!(self.shape(bias), [out_channels], "conv2d: bias");
        }
        let Conv2d { stride, pad, relu } = options;
        let shape = ConvShape {
            in_channels,
            out_channels,
            kernel,
            stride,
            pad,
            relu,
        };
        let algorithm = self.compute.algorithm(&shape, maps.size);
        let conv = self.packed_once(weights, Direction::Forward, algorithm, |tape| {
            let zeros = vec![0.0; out_channels];
            let bias = bias.map_or(&zeros[..], |bias| tape.value(bias).data());
            Conv::new(
                tape.compute.isa(),
                algorithm,
                shape,
                tape.value(weights).data(),
                bias,
            )
        });
        let out = convolve(self.compute, &conv, self.value(x));
        let inputs = [x, weights, bias.unwrap_or(x)];
        self.record(
            out,
            &inputs,
            Convolution {
                x,
                weights,
                bias,
                shape,
            },
        )
    }

    /// The convolution with `weights` laid out for a direction and an algorithm, made the first
    /// time.
    fn packed_once(
        &mut self,
        weights: Var,
        direction: Direction,
        algorithm: Algorithm,
        make: impl FnOnce(&Self) -> Conv,
    ) -> Arc<Conv> {
        if let Some(conv) = self.packed.get(&(weights, direction, algorithm)) {
            return conv.clone();
        }
        let conv = Arc::new(make(self));
        self.packed
            .insert((weights, direction, algorithm), conv.clone());
        conv
    }
}

/// Convolves every image of `x`.
fn convolve(compute: &Compute, conv: &Conv, x: &Tensor) -> Tensor {
    let maps = x.maps("conv2d");
    let out_maps = Maps {
        size: conv.shape().out_size(maps.size),
        channels: conv.shape().out_channels,
        ..maps
    };
    let mut out = compute.tensor(&out_maps.shape());
    let one = Threads::new(1);
    let scratch = conv.scratch_len(maps.size, &one);
    compute.each(out.data_mut(), out_maps.image(), |i, out| {
        let image = &x.data()[i * maps.image()..][..maps.image()];
        compute.scratch(scratch, |scratch| {
            conv.run(&one, image, maps.size, out, scratch)
        });
    });
    out
}

impl Operation for Convolution {
    fn backward(&self, tape: &mut Tape, output: &Tensor, mut gradient: Tensor) {
        let compute = tape.compute;
        if self.shape.relu {
            crate::vector::update2(compute, gradient.data_mut(), output.data(), |g, y| {
                *g = if y > 0.0 { *g } else { 0.0 }
            });
        }
        if let Some(bias) = self.bias
            && tape.needs_gradient(bias)
        {
            let share = sum_positions(compute, &gradient);
            tape.add_gradient(bias, share);
        }
        if tape.needs_gradient(self.weights) {
            let share = weight_gradient::weight_gradient(
                compute,
                &self.shape,
                tape.value(self.x),
                &gradient,
            );
            tape.add_gradient(self.weights, share);
        }
        if tape.needs_gradient(self.x) {
            let share = self.input_gradient(tape, &gradient);
            tape.add_gradient(self.x, share);
        }
        compute.recycle(gradient);
    }
}

impl Convolution {
    fn input_gradient(&self, tape: &mut Tape, gradient: &Tensor) -> Tensor {
        let ConvShape {
            in_channels,
            out_channels,
            kernel,
            stride,
            pad,
            ..
        } = self.shape;
        let back = ConvShape {
            in_channels: out_channels,
            out_channels: in_channels,
            kernel,
            stride: 1,
            pad: kernel - 1 - pad,
            relu: false,
        };
        let input = tape.value(self.x).maps("conv2d").size;
        let side = |n: usize| n + 2 * pad + 1 - kernel;
        let size = Size {
            h: side(input.h),
            w: side(input.w),
        }; // of the gradient with zeros between its pixels
        let algorithm = tape.compute.algorithm(&back, size);
        let conv = tape.packed_once(self.weights, Direction::Backward, algorithm, |tape| {
            let turned = turn(&self.shape, tape.value(self.weights).data());
            Conv::new(
                tape.compute.isa(),
                algorithm,
                back,
                &turned,
                &vec![0.0; in_channels],
            )
        });
        if stride == 1 {
            return convolve(tape.compute, &conv, gradient);
        }
        let spread = Placement {
            size,
            first: 0,
            step: stride,
        };
        let gradient = spread.place(tape.compute, gradient);
        let out = convolve(tape.compute, &conv, &gradient);
        tape.compute.recycle(gradient);
        out
    }
}

/// Weights for the backward pass: `[Cout, k, k, Cin]` turned by half a turn, with channel axes
/// exchanged.
fn turn(shape: &ConvShape, weights: &[f32]) -> Vec<f32> {
    let (cin, area) = (shape.in_channels, shape.kernel * shape.kernel);
    let mut turned = Vec::with_capacity(weights.len());
    for i in 0..cin {
        for k in (0..area).rev() {
            turned.extend(weights[k * cin + i..].iter().step_by(area * cin));
        }
    }
    turned
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{check, noise};
    use crate::{Mode, Parameters};

    fn check_shape(
        batch: usize,
        size: Size,
        cin: usize,
        cout: usize,
        kernel: usize,
        options: Conv2d,
    ) {
        let x = noise(&[batch, size.h, size.w, cin], 1);
        let weights = noise(&[cout, kernel, kernel, cin], 2);
        let bias = noise(&[cout], 3);
        check(&[x, weights, bias], 0.25, 1e-5, |tape, v| {
            tape.conv2d(v[0], v[1], Some(v[2]), options)
        });
    }

    #[test]
    fn gradients_equal_finite_differences() {
        for (kernel, stride, pad) in [
            (1, 1, 0),
            (3, 1, 0),
            (3, 1, 1),
            (2, 1, 1),
            (5, 2, 0),
            (3, 2, 1),
            (4, 3, 2),
        ] {
            let options = Conv2d {
                stride,
                pad,
                relu: false,
            };
            check_shape(2, Size { h: 6, w: 7 }, 3, 5, kernel, options);
        }
    }

    #[test]
    fn gradients_of_many_channels_equal_finite_differences() {
        check_shape(
            1,
            Size { h: 3, w: 4 },
            17,
            19,
            3,
            Conv2d {
                pad: 1,
                ..Conv2d::default()
            },
        );
        check_shape(5, Size { h: 2, w: 2 }, 2, 40, 1, Conv2d::default());
    }

    #[test]
    fn winograd_stays_near_the_direct_convolution() {
        for (side, cin, cout, kernel, stride, pad) in [
            (13, 64, 64, 3, 1, 1),
            (40, 8, 16, 5, 1, 0),
            (24, 16, 24, 3, 1, 0),
            (17, 16, 16, 3, 1, 1),
            (131, 3, 8, 11, 2, 0),
            (70, 48, 40, 5, 1, 0),
        ] {
            let inputs = [
                noise(&[2, side + 1, side, cin], 6),
                noise(&[cout, kernel, kernel, cin], 7),
                noise(&[cout], 8),
            ];
            let run = |compute: Compute| {
                let mut parameters = Parameters::new();
                let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
                let vars = inputs.clone().map(|input| tape.input(input));
                let options = Conv2d {
                    stride,
                    pad,
                    relu: false,
                };
                let y = tape.conv2d(vars[0], vars[1], Some(vars[2]), options);
                let direct = tape
                    .packed
                    .keys()
                    .all(|(.., algorithm)| *algorithm == Algorithm::Direct);
                let (out, factors) = (tape.value(y).clone(), noise(tape.shape(y), 9));
                let gradients = tape.backward_from(y, factors);
                (
                    direct,
                    [out]
                        .into_iter()
                        .chain(vars.map(|var| gradients.get(var).unwrap().clone())),
                )
            };
            let (direct, expected) = run(Compute::new(1).unwrap());
            let (planned_direct, found) = run(Compute::new(2).unwrap().with_winograd());
            assert!(direct && !planned_direct);
            for (what, (found, expected)) in
                ["y", "dx", "dw", "db"].into_iter().zip(found.zip(expected))
            {
                let squares: f32 = expected.data().iter().map(|v| v * v).sum();
                let rms = (squares / expected.data().len() as f32).sqrt();
                let pairs = found.data().iter().zip(expected.data());
                let error = pairs
                    .map(|(found, expected)| (found - expected).abs())
                    .fold(0.0, f32::max)
                    / rms;
                let allowed = if kernel == 3 { 1e-4 } else { 1e-3 }; // up to 10 points
                assert!(
                    error < allowed,
                    "{side}, {cin} to {cout}, {kernel}x{kernel}: {what} off by {error:.1e} RMS"
                );
            }
        }
    }

    #[test]
    fn relu_gradients_equal_finite_differences() {
        // Outputs are whole and half numbers away from 0, far more than the check's step moves
        // them.
        let x = Tensor::new(&[1, 2, 2, 1], vec![1.0, -2.0, 3.0, -4.0]);
        let weights = Tensor::new(&[2, 1, 1, 1], vec![1.0, -1.0]);
        let bias = Tensor::new(&[2], vec![0.5, -0.5]);
        let options = Conv2d {
            relu: true,
            ..Conv2d::default()
        };
        check(&[x, weights, bias], 0.01, 1e-4, |tape, v| {
            tape.conv2d(v[0], v[1], Some(v[2]), options)
        });
    }

    #[test]
    fn gradients_without_a_bias_equal_finite_differences() {
        let (x, weights) = (noise(&[1, 3, 3, 2], 4), noise(&[2, 2, 2, 2], 5));
        check(&[x, weights], 0.25, 1e-5, |tape, v| {
            tape.conv2d(v[0], v[1], None, Conv2d::default())
        });
    }
}
