//! The gradient of a convolution's weights with fewer multiplications: Winograd's algorithm run
//! backwards.
//!
//! Forwards, a tile of outputs is `y = A^T [U * V] A` with `V = B^T d B` of the inputs and
//! `U = G g G^T` of the kernel (`kernels::conv::winograd`). All of it is linear in `U`, so
//!
//! ```text
//! W  = A y' A^T                   gradient tile, per output channel      additions
//! U' = sum over tiles of V^T W    a x a matrix products           all the multiplications
//!                                 [Cin, tiles] x [tiles, Cout]
//! g' = G^T U' G                   once per batch
//! ```
//!
//! Tiles of several images fill a strip; a full strip is multiplied, point by point, in the
//! register tiles of [`weight_gradient`](super::weight_gradient).

use super::weight_gradient::{CHANNELS, PART_IMAGES, Tile};
use crate::ops::map::Placement;
use crate::{Compute, Tensor};
use kernels::Size;
use kernels::conv::ConvShape;
use kernels::conv::winograd::{
    AsIs, Lines, MAX_KERNEL, Steps, kernel_row, lines_len, pairs, share,
};
use kernels::simd::{Kernel, Simd};

/// Tiles of a strip: enough to make up for reading and writing all of `U'` once per strip.
const STRIP_TILES: usize = 128;

/// Most points along one side of a tile.
const MAX_POINTS: usize = 8;

/// Points along one side of a tile where this algorithm is expected to be faster than the direct
/// one.
pub(super) fn points(shape: &ConvShape, batch: usize, out: Size) -> Option<usize> {
    // Costs in multiply-accumulates of the register tile, as in `Algorithm::cost`: transforming one
    // value of one channel, and adding one product to `U'`.
    const TRANSFORMED_VALUE: usize = 22;
    const SUM: usize = 12;
    let points = match shape.kernel {
        3 => 6,
        5 => 8,
        _ => return None,
    };
    if shape.stride != 1 {
        return None;
    }
    let m = points + 1 - shape.kernel;
    let product = shape.in_channels * shape.out_channels;
    let images = batch.min(PART_IMAGES);
    let tiles = images * out.h.div_ceil(m) * out.w.div_ceil(m);
    let values = shape.in_channels + shape.out_channels;
    let sums = tiles.div_ceil(STRIP_TILES) * SUM * product;
    let winograd = points * points * (tiles * (product + TRANSFORMED_VALUE * values) + sums);
    let direct = images * out.area() * shape.kernel * shape.kernel * product;
    (winograd < direct).then_some(points)
}

/// The gradient of `[Cout, k, k, Cin]`, for an input `x` and the `gradient` of the output.
pub(super) fn weight_gradient(
    compute: &Compute,
    shape: &ConvShape,
    points: usize,
    x: &Tensor,
    gradient: &Tensor,
) -> Tensor {
    let (inputs, outputs) = (x.maps("conv2d"), gradient.maps("conv2d"));
    let padded = Placement::pad(inputs.size, shape.pad);
    let parts = inputs.batch.div_ceil(PART_IMAGES);
    let len = points * points * shape.in_channels * shape.out_channels;
    let mut sums = compute.zeros(&[parts, len]);
    let strip_len = Strip::len(shape, points);
    let image_len = if shape.pad == 0 {
        0
    } else {
        padded.size.area() * inputs.channels
    };
    let m = points + 1 - shape.kernel;
    let columns = (outputs.size.w.div_ceil(m) - 1) * m + points;
    let row_len = lines_len(points, columns, inputs.channels);
    compute.each(sums.data_mut(), len, |part, out| {
        compute.scratch(strip_len + row_len + image_len, |scratch| {
            let (space, scratch) = scratch.split_at_mut(strip_len);
            let (row, image_space) = scratch.split_at_mut(row_len);
            let mut strip = Strip::new(shape, points, space, out);
            for image in part * PART_IMAGES..((part + 1) * PART_IMAGES).min(inputs.batch) {
                let gradient = &gradient.data()[image * outputs.image()..][..outputs.image()];
                let mut input = &x.data()[image * inputs.image()..][..inputs.image()];
                if shape.pad > 0 {
                    padded.place_image(input, inputs.size, inputs.channels, image_space);
                    input = image_space;
                }
                let strip = &mut strip;
                let lines = Lines {
                    values: &mut *row,
                    columns,
                    channels: inputs.channels,
                };
                let (size, out_size) = (padded.size, outputs.size);
                compute.isa().run(AddImage {
                    strip,
                    lines,
                    input,
                    size,
                    gradient,
                    out_size,
                });
            }
            compute.isa().run(Multiply { strip: &mut strip });
        });
    });
    let window = shape.kernel * shape.kernel * shape.in_channels;
    let mut out = compute.tensor(&[
        shape.out_channels,
        shape.kernel,
        shape.kernel,
        shape.in_channels,
    ]);
    compute.each(out.data_mut(), CHANNELS * window, |block, out| {
        compute.isa().run(Finish {
            shape,
            points,
            sums: sums.data(),
            first: block * CHANNELS,
            out,
        });
    });
    compute.recycle(sums);
    out
}

/// Transformed tiles of inputs and gradients that are not multiplied yet.
struct Strip<'a> {
    shape: &'a ConvShape,
    points: usize,
    filled: usize,         // tiles
    inputs: &'a mut [f32], // [points^2][STRIP_TILES, Cin], every `input_step`
    // [points^2][block][STRIP_TILES, vectors of the block * LANES], every `gradient_step`
    gradients: &'a mut [f32],
    sums: &'a mut [f32], // [points^2][Cin, Cout], added to
}

/// Lanes of the widest vector. Rows of gradients are padded to at most this many.
const MAX_LANES: usize = 16;

/// Values of one cache line. Points lie a line further apart than they need to, so that they do not
/// all compete for the same sets of the cache.
const LINE: usize = 16;

impl<'a> Strip<'a> {
    /// Values from one point's inputs to the next point's.
    fn input_step(shape: &ConvShape) -> usize {
        (STRIP_TILES * shape.in_channels).next_multiple_of(LINE) + LINE
    }

    /// Values from one point's gradients to the next point's.
    fn gradient_step(shape: &ConvShape) -> usize {
        STRIP_TILES * shape.out_channels.next_multiple_of(MAX_LANES) + LINE
    }

    /// Values of the inputs and gradients together.
    fn len(shape: &ConvShape, points: usize) -> usize {
        points * points * (Strip::input_step(shape) + Strip::gradient_step(shape))
    }

    fn new(
        shape: &'a ConvShape,
        points: usize,
        space: &'a mut [f32],
        sums: &'a mut [f32],
    ) -> Strip<'a> {
        let (inputs, gradients) = space.split_at_mut(points * points * Strip::input_step(shape));
        Strip {
            shape,
            points,
            filled: 0,
            inputs,
            gradients,
            sums,
        }
    }

    /// Adds the products of all tiles to `sums` and empties the strip.
    #[inline(always)]
    fn multiply<S: Simd>(&mut self, simd: S) {
        if self.filled == 0 {
            return;
        }
        let (cin, cout) = (self.shape.in_channels, self.shape.out_channels);
        let all_vectors = cout.div_ceil(S::LANES);
        let groups = cin.div_ceil(S::TILE_PIXELS[all_vectors.min(3)]);
        for p in 0..self.points * self.points {
            let inputs = &self.inputs[p * Strip::input_step(self.shape)..];
            let gradients = &self.gradients[p * Strip::gradient_step(self.shape)..];
            let sums = &mut self.sums[p * cin * cout..][..cin * cout];
            for first_vector in (0..all_vectors).step_by(3) {
                let vectors = (all_vectors - first_vector).min(3);
                let first = first_vector * S::LANES;
                let used = (cout - first).min(vectors * S::LANES);
                let mut j = 0;
                for i in 0..groups {
                    let width = cin / groups + usize::from(i < cin % groups);
                    let tile = Tile {
                        input: &inputs[j..],
                        input_row: 0,
                        input_step: cin,
                        gradient: &gradients[STRIP_TILES * first..]
                            [..self.filled * vectors * S::LANES],
                        width: self.filled,
                        out: &mut sums[j * cout + first..],
                        out_step: cout,
                        used,
                    };
                    tile.dispatch(simd, width, vectors);
                    j += width;
                }
            }
        }
        self.filled = 0;
    }
}

/// Multiplies the tiles that are left in a strip.
struct Multiply<'a, 'b> {
    strip: &'a mut Strip<'b>,
}

impl Kernel for Multiply<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        self.strip.multiply(simd);
    }
}

/// Transforms the tiles of one image, and multiplies the strip whenever it is full.
struct AddImage<'a, 'b> {
    strip: &'a mut Strip<'b>,
    lines: Lines<'a>, // of a whole row of tiles
    input: &'a [f32], // [size.h, size.w, Cin], padding included
    size: Size,
    gradient: &'a [f32], // [H', W', Cout]
    out_size: Size,
}

impl Kernel for AddImage<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        match (self.strip.points, self.strip.shape.kernel) {
            (6, 3) => self.run_sized::<S, 6, 4>(simd),
            (8, 5) => self.run_sized::<S, 8, 4>(simd),
            (points, kernel) => unreachable!("{points} points for a {kernel}x{kernel} kernel"),
        }
    }
}

impl AddImage<'_, '_> {
    #[inline(always)]
    fn run_sized<S: Simd, const A: usize, const M: usize>(self, simd: S) {
        let AddImage {
            strip,
            mut lines,
            input,
            size,
            gradient,
            out_size,
        } = self;
        let cin = strip.shape.in_channels;
        for y in (0..out_size.h).step_by(M) {
            lines.fill::<S, A>(simd, input, size, (y, 0));
            for x in (0..out_size.w).step_by(M) {
                if strip.filled == STRIP_TILES {
                    strip.multiply(simd);
                }
                let v = &mut strip.inputs[strip.filled * cin..];
                let steps = Steps {
                    point: Strip::input_step(strip.shape),
                    vector: S::LANES,
                };
                lines.tile::<S, _, A>(simd, x, v, steps, AsIs);
                gradient_tile::<S, A, M>(simd, gradient, out_size, (y, x), strip);
                strip.filled += 1;
            }
        }
    }
}

/// `W = A y' A^T` of the gradient tile whose corner is `(y, x)`, to the strip's next tile;
/// gradients beyond the map count as 0.
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "a matrix, and its transpose")]
fn gradient_tile<S: Simd, const A: usize, const M: usize>(
    simd: S,
    gradient: &[f32],
    size: Size,
    (y, x): (usize, usize),
    strip: &mut Strip<'_>,
) {
    let channels = strip.shape.out_channels;
    let step = Strip::gradient_step(strip.shape);
    let (rows, columns) = (M.min(size.h - y), M.min(size.w - x));
    let all_vectors = channels.div_ceil(S::LANES);
    for vector in 0..all_vectors {
        let c = vector * S::LANES;
        let n = S::LANES.min(channels - c);
        let mut half = [[simd.zero(); A]; M]; // A y', transposed: [column][point]
        for j in 0..columns {
            let mut line = [simd.zero(); M];
            for i in 0..rows {
                let from = &gradient[((y + i) * size.w + x + j) * channels + c..][..n];
                line[i] = if n == S::LANES {
                    simd.load(from)
                } else {
                    simd.load_partial(from)
                };
            }
            half[j] = gradient_points::<S, A, M>(simd, &line);
        }
        let block = vector / 3 * 3; // the block's first vector
        let block_width = (all_vectors - block).min(3) * S::LANES;
        let at = STRIP_TILES * block * S::LANES
            + strip.filled * block_width
            + (vector - block) * S::LANES;
        for i in 0..A {
            let mut line = [simd.zero(); M];
            for j in 0..M {
                line[j] = half[j][i];
            }
            let row = gradient_points::<S, A, M>(simd, &line);
            for j in 0..A {
                simd.store(row[j], &mut strip.gradients[(i * A + j) * step + at..]);
            }
        }
    }
}

/// `A y` for one line of gradients: at every point the polynomial whose coefficients they are, at
/// infinity the last one.
#[inline(always)]
fn gradient_points<S: Simd, const A: usize, const M: usize>(
    simd: S,
    y: &[S::F32; M],
) -> [S::F32; A] {
    let mut w = [simd.zero(); A];
    w[0] = y[0];
    for pair in 0..(A - 2) / 2 {
        let point = const { pairs(A) }[pair];
        let (mut even, mut odd) = (simd.zero(), simd.zero());
        for (j, y) in y.iter().enumerate() {
            let power = simd.splat(point.powi(j as i32));
            let sum = if j % 2 == 0 { &mut even } else { &mut odd };
            *sum = simd.mul_add(power, *y, *sum);
        }
        w[1 + 2 * pair] = simd.add(even, odd);
        w[2 + 2 * pair] = simd.sub(even, odd);
    }
    w[A - 1] = y[M - 1];
    w
}

/// `g' = G^T U' G` of some output channels, `U'` summed over the parts in their order.
struct Finish<'a> {
    shape: &'a ConvShape,
    points: usize,
    sums: &'a [f32],    // [parts, points^2, Cin, Cout]
    first: usize,       // output channel
    out: &'a mut [f32], // [channels, k, k, Cin]
}

impl Kernel for Finish<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        match (self.points, self.shape.kernel) {
            (6, 3) => self.run_sized::<S, 6, 3>(simd),
            (8, 5) => self.run_sized::<S, 8, 5>(simd),
            (points, kernel) => unreachable!("{points} points for a {kernel}x{kernel} kernel"),
        }
    }
}

impl Finish<'_> {
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "two matrices and their product")]
    fn run_sized<S: Simd, const A: usize, const K: usize>(self, simd: S) {
        let (cin, cout) = (self.shape.in_channels, self.shape.out_channels);
        let mut g = [[0.0; MAX_KERNEL]; MAX_POINTS];
        for (i, row) in g.iter_mut().enumerate().take(A) {
            *row = kernel_row(A, K, i).map(|value| value * share(A, i));
        }
        let point_step = cin * cout;
        let window = K * K * cin;
        let channels = self.out.len() / window;
        let mut lanes = [0.0; MAX_LANES];
        for c in (0..channels).step_by(S::LANES) {
            let n = S::LANES.min(channels - c);
            for i in 0..cin {
                let mut half = [[simd.zero(); K]; A]; // U' G: [point][kx]
                for p in 0..A {
                    for q in 0..A {
                        let at = (p * A + q) * point_step + i * cout + self.first + c;
                        let mut u = simd.zero();
                        for part in self.sums.chunks_exact(A * A * point_step) {
                            let from = &part[at..][..n];
                            let share = if n == S::LANES {
                                simd.load(from)
                            } else {
                                simd.load_partial(from)
                            };
                            u = simd.add(u, share);
                        }
                        for x in 0..K {
                            half[p][x] = simd.mul_add(simd.splat(g[q][x]), u, half[p][x]);
                        }
                    }
                }
                for y in 0..K {
                    for x in 0..K {
                        let mut value = simd.zero();
                        for p in 0..A {
                            value = simd.mul_add(simd.splat(g[p][y]), half[p][x], value);
                        }
                        simd.store_partial(value, &mut lanes[..n]);
                        let at = c * window + (y * K + x) * cin + i;
                        for (o, value) in lanes[..n].iter().enumerate() {
                            self.out[at + o * window] = *value;
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::noise;
    use crate::ops::conv2d::weight_gradient;

    /// The shapes cover tiles that end at the map's edge or reach past it, several strips, channels
    /// that do not fill a vector, and padding.
    #[test]
    fn winograd_gradient_equals_the_direct_one() {
        for (batch, side, cin, cout, kernel, pad) in [
            (1, 6, 3, 5, 3, 0),
            (5, 9, 17, 35, 3, 1),
            (6, 30, 4, 50, 3, 0),
            (2, 11, 9, 20, 5, 0),
            (1, 7, 2, 3, 5, 2),
        ] {
            let shape = ConvShape {
                in_channels: cin,
                out_channels: cout,
                kernel,
                stride: 1,
                pad,
                relu: false,
            };
            let out = shape.out_size(Size {
                h: side,
                w: side + 1,
            });
            let x = noise(&[batch, side, side + 1, cin], 1);
            let gradient = noise(&[batch, out.h, out.w, cout], 2);
            let points = if kernel == 3 { 6 } else { 8 };
            for isa in kernels::Isa::available() {
                let compute = Compute::with_isa(2, isa).unwrap();
                let expected = weight_gradient::direct(&compute, &shape, &x, &gradient);
                let found = super::weight_gradient(&compute, &shape, points, &x, &gradient);
                assert_eq!(found.shape(), expected.shape());
                let squares: f32 = expected.data().iter().map(|v| v * v).sum();
                let allowed = 3e-5 * (squares / expected.data().len() as f32).sqrt();
                for (found, expected) in found.data().iter().zip(expected.data()) {
                    assert!(
                        (found - expected).abs() <= allowed,
                        "{isa} {shape:?}: {found} {expected}"
                    );
                }
            }
        }
    }

    #[test]
    fn gradient_has_the_same_bits_on_any_number_of_threads() {
        let shape = ConvShape {
            in_channels: 8,
            out_channels: 24,
            kernel: 3,
            stride: 1,
            pad: 1,
            relu: false,
        };
        let (x, gradient) = (noise(&[9, 10, 10, 8], 3), noise(&[9, 10, 10, 24], 4));
        let run = |threads| {
            super::weight_gradient(&Compute::new(threads).unwrap(), &shape, 6, &x, &gradient)
                .into_data()
        };
        assert_eq!(run(1), run(3));
    }
}
