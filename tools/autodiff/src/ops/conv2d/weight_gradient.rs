//! The gradient of a convolution's weights, in register tiles.
//!
//! ```text
//! dw[ky, j, o] = sum over images and output positions of g[y, x, o] * x_row[y s + ky][x s Cin + j]
//! ```
//!
//! Here `j = kx Cin + i` runs over the `k Cin` contiguous inputs of one row of the window: as in
//! the forward kernel, no patch has to be gathered. One tile is up to 9 inputs `j` x up to 3
//! vectors of output channels, summed in registers over a strip of output positions:
//!
//! ```text
//! for each image of the part
//!   for each strip of output rows            its inputs and gradients stay in the L2 cache
//!     for each block of channel vectors      its gradients stay in the L1 cache
//!       for each kernel row, each tile of inputs
//!         for each position of the strip     the hot loop, in `Tile::run`
//! ```

use super::winograd_gradient;
use crate::ops::map::Placement;
use crate::{Compute, Tensor};
use kernels::Size;
use kernels::conv::ConvShape;
use kernels::simd::{Kernel, Simd};

/// Images of one part: few enough to keep all threads busy, enough to make the sum over the parts
/// cheap.
pub(super) const PART_IMAGES: usize = 4;

/// Output channels that are summed together at the end: a cache line of them.
pub(super) const CHANNELS: usize = 16;

/// Output positions of one strip, if a row is not longer.
const STRIP: usize = 128;

/// The gradient of `[Cout, k, k, Cin]`, for an input `x` and the `gradient` of the output; by
/// Winograd's algorithm where that is allowed and expected to be faster.
pub(super) fn weight_gradient(
    compute: &Compute,
    shape: &ConvShape,
    x: &Tensor,
    gradient: &Tensor,
) -> Tensor {
    let outputs = gradient.maps("conv2d");
    match winograd_gradient::points(shape, outputs.batch, outputs.size)
        .filter(|_| compute.winograd())
    {
        Some(points) => winograd_gradient::weight_gradient(compute, shape, points, x, gradient),
        None => direct(compute, shape, x, gradient),
    }
}

/// The gradient of `[Cout, k, k, Cin]` by the sum of products, without Winograd's algorithm.
pub(super) fn direct(
    compute: &Compute,
    shape: &ConvShape,
    x: &Tensor,
    gradient: &Tensor,
) -> Tensor {
    let (inputs, outputs) = (x.maps("conv2d"), gradient.maps("conv2d"));
    let (window, channels) = (
        shape.kernel * shape.kernel * shape.in_channels,
        shape.out_channels,
    );
    let padded = Placement::pad(inputs.size, shape.pad);
    let parts = inputs.batch.div_ceil(PART_IMAGES);
    let mut sums = compute.zeros(&[parts, window * channels]);
    compute.each(sums.data_mut(), window * channels, |part, out| {
        for image in part * PART_IMAGES..((part + 1) * PART_IMAGES).min(inputs.batch) {
            let x = &x.data()[image * inputs.image()..][..inputs.image()];
            let gradient = &gradient.data()[image * outputs.image()..][..outputs.image()];
            let mut run = |input: &[f32]| {
                let (size, width) = (padded.size, outputs.size.w);
                compute.isa().run(WeightGradient {
                    shape,
                    input,
                    size,
                    gradient,
                    width,
                    out,
                });
            };
            if shape.pad == 0 {
                run(x);
            } else {
                compute.scratch(padded.size.area() * inputs.channels, |scratch| {
                    padded.place_image(x, inputs.size, inputs.channels, scratch);
                    run(scratch);
                });
            }
        }
    });
    let mut out = compute.tensor(&[channels, shape.kernel, shape.kernel, shape.in_channels]);
    compute.each(out.data_mut(), CHANNELS * window, |block, out| {
        for j in 0..window {
            let first = j * channels + block * CHANNELS;
            for (o, out) in out[j..].iter_mut().step_by(window).enumerate() {
                *out = sums.data()[first + o..]
                    .iter()
                    .step_by(window * channels)
                    .sum();
            }
        }
    });
    compute.recycle(sums);
    out
}

/// Adds one image's share of the gradient to `out`.
struct WeightGradient<'a> {
    shape: &'a ConvShape,
    input: &'a [f32], // [size.h, size.w, Cin], padding included
    size: Size,
    gradient: &'a [f32], // [H', width, Cout]
    width: usize,
    out: &'a mut [f32], // [k, k * Cin, Cout], added to
}

impl Kernel for WeightGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let WeightGradient {
            shape,
            input,
            size,
            gradient,
            width,
            out,
        } = self;
        let (channels, row_len) = (shape.out_channels, shape.kernel * shape.in_channels);
        let input_row = size.w * shape.in_channels;
        let all_vectors = channels.div_ceil(S::LANES);
        let tiles = row_len.div_ceil(S::TILE_PIXELS[all_vectors.min(3)]);
        let strip_rows = (STRIP / width).max(1);
        let mut packed = vec![0.0; strip_rows * width * 3 * S::LANES];
        for (strip, gradient) in gradient.chunks(strip_rows * width * channels).enumerate() {
            for first_vector in (0..all_vectors).step_by(3) {
                let vectors = (all_vectors - first_vector).min(3);
                let first = first_vector * S::LANES;
                let used = (channels - first).min(vectors * S::LANES);
                let packed = &mut packed[..gradient.len() / channels * vectors * S::LANES];
                for (to, from) in packed
                    .chunks_exact_mut(vectors * S::LANES)
                    .zip(gradient.chunks_exact(channels))
                {
                    to[..used].copy_from_slice(&from[first..][..used]);
                }
                for (ky, out) in out.chunks_exact_mut(row_len * channels).enumerate() {
                    let mut j = 0;
                    for i in 0..tiles {
                        let inputs = row_len / tiles + usize::from(i < row_len % tiles);
                        let args = Tile {
                            input: &input
                                [(strip * strip_rows * shape.stride + ky) * input_row + j..],
                            input_row: shape.stride * input_row,
                            input_step: shape.stride * shape.in_channels,
                            gradient: packed,
                            width,
                            out: &mut out[j * channels + first..],
                            out_step: channels,
                            used,
                        };
                        args.dispatch(simd, inputs, vectors);
                        j += inputs;
                    }
                }
            }
        }
    }
}

/// One register tile: neighboring inputs of a window's row x a block of output channels.
pub(super) struct Tile<'a> {
    pub input: &'a [f32],    // starts at the first position's first input
    pub input_row: usize,    // step from one output row to the next
    pub input_step: usize,   // step from one position to the next
    pub gradient: &'a [f32], // [rows, width, VECTORS * LANES]
    pub width: usize,
    pub out: &'a mut [f32], // starts at the first input's first channel; added to
    pub out_step: usize,    // step from one input to the next
    pub used: usize,        // channels of the block that exist
}

impl Tile<'_> {
    /// Calls [`run`](Self::run) with the tile's sizes as constants.
    #[inline(always)]
    pub(super) fn dispatch<S: Simd>(self, simd: S, inputs: usize, vectors: usize) {
        macro_rules! table {
            ($($vectors:literal: $($inputs:literal)*;)*) => {
                match (vectors, inputs) {
                    $($(($vectors, $inputs) => self.run::<S, $inputs, $vectors>(simd),)*)*
                    _ => unreachable!("tile of {inputs} inputs x {vectors} vectors"),
                }
            };
        }
        table! {
            1: 1 2 3 4 5 6 7 8 9;
            2: 1 2 3 4 5 6 7 8 9;
            3: 1 2 3 4 5 6 7 8 9;
        }
    }

    /// The hot loop: all sums of the tile stay in registers.
    ///
    /// ```text
    /// for each position of the strip
    ///   load the gradients of its VECTORS vectors of output channels
    ///   for each of the INPUTS inputs
    ///     sums[input] += input * gradients
    /// add the sums to `out`
    /// ```
    #[inline(always)]
    fn run<S: Simd, const INPUTS: usize, const VECTORS: usize>(self, simd: S) {
        if INPUTS > S::TILE_PIXELS[VECTORS] {
            unreachable!("more than the registers hold");
        }
        let mut sums = [[simd.zero(); VECTORS]; INPUTS];
        for (y, gradient) in self
            .gradient
            .chunks_exact(self.width * VECTORS * S::LANES)
            .enumerate()
        {
            let input = &self.input[y * self.input_row..];
            for (x, gradient) in gradient.chunks_exact(VECTORS * S::LANES).enumerate() {
                let input = &input[x * self.input_step..][..INPUTS];
                let mut g = [simd.zero(); VECTORS];
                for v in 0..VECTORS {
                    g[v] = simd.load(&gradient[v * S::LANES..]);
                }
                for i in 0..INPUTS {
                    let x = simd.splat(input[i]);
                    for v in 0..VECTORS {
                        sums[i][v] = simd.mul_add(x, g[v], sums[i][v]);
                    }
                }
            }
        }
        for (sums, out) in sums.iter().zip(self.out.chunks_mut(self.out_step)) {
            let out = &mut out[..self.used];
            for (sum, out) in sums.iter().zip(out.chunks_mut(S::LANES)) {
                if out.len() == S::LANES {
                    simd.store(simd.add(*sum, simd.load(out)), out);
                } else {
                    simd.store_partial(simd.add(*sum, simd.load_partial(out)), out);
                }
            }
        }
    }
}
