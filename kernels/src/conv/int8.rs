//! Direct convolution of bytes: `u8` activations with `i8` weights, summed exactly in `i32`, then
//! scaled to `f32`.
//!
//! ```text
//! y[o] = s[o] * (sum over the window of q_w * q_x  -  z * sum of q_w)  +  b[o]
//! s[o] = scale of weights[o] * scale of x,  z = zero-point of x
//! ```
//!
//! Shapes: `u8 [H, W, Cin] -> f32 or u8 [H', W', Cout]`. Cost: a quarter of `direct.rs`'s
//! instructions where the instruction set has a dot product of bytes. Source: Jacob et al.,
//! "Quantization and training of neural networks for efficient integer-arithmetic-only inference",
//! 2018.
//!
//! The walk is that of `direct.rs` with four inputs per step. The tricks:
//!
//! - One step loads four weights per lane and channel vector, and broadcasts four neighboring
//!   inputs per pixel. A row of the window (`k * Cin` bytes) is rounded up to whole steps; the
//!   weights after its end are zero.
//! - The zero-point's term depends on the weights alone, so sums start from it instead of from 0.
//!   Padding is the zero-point itself.
//! - Weights are symmetric with one scale per output channel, `q_w = round(w * 127 / max |w|)`: no
//!   second zero-point.
//! - Where the instruction set multiplies matrices (i8mm), a step has eight inputs, and pixels go
//!   in pairs.

use super::direct::blocks;
use super::{ConvShape, Output};
use crate::quant::Quantization;
use crate::simd::{Dot, DotKernel, Simd};
use crate::{Aligned, Isa, Size};

/// Bytes that must follow an input of bytes, because steps read up to eight at a time.
pub const SLACK: usize = 7;

/// Weights as bytes in the order of the walk, with what turns sums into outputs.
#[derive(Clone, Debug)]
pub(super) struct QuantizedWeights {
    // [block][kernel row][steps][vectors of the block * LANES][quads of a step]
    quads: Aligned<[i8; 4]>,
    start: Vec<i32>, // what sums start from: [Cout], zeros up to whole vectors
    scale: Vec<f32>, // of the sums: [Cout]
    pub input: Quantization,
}

impl QuantizedWeights {
    /// From `[Cout, k, k, Cin]`.
    pub(super) fn new(
        isa: Isa,
        shape: &ConvShape,
        weights: &[f32],
        input: Quantization,
    ) -> QuantizedWeights {
        let (lanes, (offset, quads_per_step)) = (isa.lanes(), isa.dot_offset_and_quads());
        let row_len = shape.kernel * shape.in_channels;
        let vectors = shape.out_channels.div_ceil(lanes);
        // Round each output channel, and fold the zero-point and the instruction's offset into the
        // start of its sums.
        let rounded: Vec<(Vec<i8>, f32)> =
            weights.chunks_exact(shape.window()).map(round).collect();
        let sum = |row: &[i8]| row.iter().map(|w| i32::from(*w)).sum::<i32>();
        let mut start: Vec<i32> = rounded
            .iter()
            .map(|(row, _)| (offset - i32::from(input.zero_point)) * sum(row))
            .collect();
        start.resize(vectors * lanes, 0);
        // Four weights of one output channel; zeros after the end of a window's row and after the
        // last channel.
        let quad = |output: usize, ky: usize, group: usize| {
            let mut quad = [0; 4];
            if let Some((window, _)) = rounded.get(output) {
                let row = &window[ky * row_len..][..row_len];
                let from = &row[row_len.min(4 * group)..row_len.min(4 * group + 4)];
                quad[..from.len()].copy_from_slice(from);
            }
            quad
        };
        let steps = steps_per_row(shape, quads_per_step);
        let mut quads = Vec::with_capacity(vectors * lanes * shape.kernel * steps * quads_per_step);
        let mut first = 0;
        for width in blocks(vectors) {
            let channels = first..first + width * lanes;
            for ky in 0..shape.kernel {
                for step in 0..steps {
                    let groups = step * quads_per_step..(step + 1) * quads_per_step;
                    let quads_of =
                        |output| groups.clone().map(move |group| quad(output, ky, group));
                    quads.extend(channels.clone().flat_map(quads_of));
                }
            }
            first = channels.end;
        }
        let scale = rounded
            .iter()
            .map(|(_, scale)| scale * input.scale)
            .collect();
        QuantizedWeights {
            quads: quads.as_slice().into(),
            start,
            scale,
            input,
        }
    }
}

/// Rounds one output channel's weights to bytes; returns them with their scale.
fn round(weights: &[f32]) -> (Vec<i8>, f32) {
    let largest = weights.iter().fold(0.0f32, |all, w| all.max(w.abs()));
    let scale = (largest / 127.0).max(f32::MIN_POSITIVE);
    (
        weights
            .iter()
            .map(|w| (w / scale).round_ties_even() as i8)
            .collect(),
        scale,
    )
}

/// Steps along one row of the window.
fn steps_per_row(shape: &ConvShape, quads_per_step: usize) -> usize {
    (shape.kernel * shape.in_channels).div_ceil(4 * quads_per_step)
}

/// Some rows of one convolution without padding.
pub(super) struct Int8<'a> {
    pub shape: &'a ConvShape,
    pub weights: &'a QuantizedWeights,
    pub bias: &'a [f32], // [Cout]
    pub input: &'a [u8], // [size.h, size.w, Cin], padding included, then `SLACK` bytes
    pub size: Size,
    pub first_row: usize, // of the output, that `out` starts at
    pub out: Output<'a>,  // [rows, W', Cout]
}

impl Output<'_> {
    /// Writes a vector of outputs, or its first `len` values, at place `at`.
    #[inline(always)]
    fn write<S: Simd>(&mut self, simd: S, y: S::F32, at: usize, len: usize) {
        match self {
            Output::Floats(out) => simd.write(y, &mut out[at..][..len.min(S::LANES)]),
            Output::Bytes(out, q) => q.store(simd, y, &mut out[at..][..len.min(S::LANES)]),
        }
    }
}

impl DotKernel for Int8<'_> {
    type Output = ();

    #[inline(always)]
    fn run<D: Dot>(self, dot: D) {
        let Int8 {
            shape,
            weights,
            bias,
            input,
            size,
            first_row,
            mut out,
        } = self;
        let (channels, lanes) = (shape.out_channels, D::Float::LANES);
        let width = (size.w - shape.kernel) / shape.stride + 1;
        let steps = steps_per_row(shape, D::QUADS);
        // The same loops as in `direct.rs`: blocks of channels, rows, even tiles of pixels.
        let mut rest = &weights.quads[..];
        let mut first = 0;
        for vectors in blocks(channels.div_ceil(lanes)) {
            let (block, later) = rest.split_at(shape.kernel * steps * vectors * lanes * D::QUADS);
            rest = later;
            let used = (vectors * lanes).min(channels - first);
            let tiles = width.div_ceil(D::TILE_GROUPS[vectors] * D::PIXELS);
            for y in 0..out.len() / (width * channels) {
                let top = (first_row + y) * shape.stride * size.w;
                let mut x = 0;
                for i in 0..tiles {
                    let pixels = width / tiles + usize::from(i < width % tiles);
                    let tile = Tile {
                        input: &input[(top + x * shape.stride) * shape.in_channels..],
                        pixel_step: shape.stride * shape.in_channels,
                        row_step: size.w * shape.in_channels,
                        pixels,
                        steps,
                        rows: shape.kernel,
                        weights: block,
                        start: &weights.start[first..],
                        scale: &weights.scale[first..][..used],
                        bias: &bias[first..][..used],
                        relu: shape.relu,
                        out: &mut out,
                        at: (y * width + x) * channels + first,
                        out_step: channels,
                    };
                    let groups = pixels.div_ceil(D::PIXELS);
                    super::for_tile!(groups, vectors, tile.run, D, dot, D::TILE_GROUPS);
                    x += pixels;
                }
            }
            first += used;
        }
    }
}

/// One register tile: neighboring pixels x a block of channels.
struct Tile<'a, 'b> {
    input: &'a [u8],        // from the first pixel's window on
    pixel_step: usize,      // from one pixel's window to the next one's
    row_step: usize,        // from one row of the window to the next
    pixels: usize,          // of the tile; of a pair the second may be missing
    steps: usize,           // along a window's row
    rows: usize,            // rows of the window
    weights: &'a [[i8; 4]], // [rows * steps, VECTORS * LANES * QUADS]
    start: &'a [i32],       // [VECTORS * LANES]
    scale: &'a [f32],       // [channels of the block that exist]
    bias: &'a [f32],        // [channels of the block that exist]
    relu: bool,
    out: &'a mut Output<'b>,
    at: usize,       // of the first pixel's first channel in `out`
    out_step: usize, // from one pixel to the next
}

impl<'a> Tile<'a, '_> {
    /// One row of a pixel's window, as `steps` steps.
    #[inline(always)]
    fn window<D: Dot>(&self, pixel: usize, row: usize, steps: usize) -> &'a [D::Step] {
        let rest = &self.input[row * self.row_step + pixel * self.pixel_step..];
        let whole = rest.len() / size_of::<D::Step>() * size_of::<D::Step>();
        &bytemuck::cast_slice(&rest[..whole])[..steps]
    }

    /// Sums the tile's window, then scales, adds the bias, applies ReLU, and writes.
    #[inline(always)]
    fn run<D: Dot, const GROUPS: usize, const VECTORS: usize>(self, dot: D) {
        let (simd, lanes) = (dot.float(), D::Float::LANES);
        let mut start = [dot.sums(self.start); VECTORS];
        for (v, start) in start.iter_mut().enumerate() {
            *start = dot.sums(&self.start[v * lanes..]);
        }
        let sums = self.add(dot, [start; GROUPS]);
        // The epilogue, once per output: it may branch, the hot loop may not.
        let floor = simd.splat(if self.relu { 0.0 } else { f32::NEG_INFINITY });
        for (i, sums) in sums.iter().enumerate() {
            for p in 0..D::PIXELS {
                let pixel = i * D::PIXELS + p;
                if p > 0 && pixel >= self.pixels {
                    continue;
                }
                let at = self.at + pixel * self.out_step;
                for (v, sums) in sums.iter().enumerate() {
                    let first = v * lanes;
                    if first >= self.bias.len() {
                        continue;
                    }
                    let (scale, bias) = (&self.scale[first..], &self.bias[first..]);
                    let sum = dot.to_f32(dot.of_pixel(*sums, p));
                    let y = if bias.len() >= lanes {
                        simd.mul_add(sum, simd.load(scale), simd.load(bias))
                    } else {
                        simd.mul_add(sum, simd.load_partial(scale), simd.load_partial(bias))
                    };
                    let y = simd.max(y, floor);
                    self.out.write(simd, y, at + first, bias.len());
                }
            }
        }
    }

    /// The hot loop: adds the products of the whole window to `sums`.
    ///
    /// ```text
    /// for each row of the window
    ///   for each step of 4 or 8 bytes
    ///     w[v] = load of the step's weights, vector v      VECTORS loads
    ///     x    = broadcast of group i's step               GROUPS broadcasts
    ///     sums[i][v] = dot(x, w[v], sums[i][v])            GROUPS * VECTORS dot products
    /// ```
    ///
    /// Where a dot product takes a part of a register, a load brings four steps of a pixel
    /// ([`add_runs`]): a quarter of the broadcasts.
    ///
    /// `sums` goes by value: the epilogue indexes it by variables, so a reference would keep it in
    /// memory here as well, and NEON would store it in every step.
    #[inline(always)]
    fn add<D: Dot, const GROUPS: usize, const VECTORS: usize>(
        &self,
        dot: D,
        mut sums: [[D::Sums; VECTORS]; GROUPS],
    ) -> [[D::Sums; VECTORS]; GROUPS] {
        let (steps, vector) = (self.steps, D::Float::LANES * D::QUADS);
        for (ky, weights) in self
            .weights
            .chunks_exact(steps * VECTORS * vector)
            .take(self.rows)
            .enumerate()
        {
            let (mut first, mut second) = ([&[][..]; GROUPS], [&[][..]; GROUPS]);
            for i in 0..GROUPS {
                first[i] = self.window::<D>(i * D::PIXELS, ky, steps);
                // Of an odd count the last pair repeats its first pixel; the epilogue drops the
                // copy.
                let next = (i * D::PIXELS + 1).min(self.pixels - 1);
                second[i] = if D::PIXELS == 1 {
                    first[i]
                } else {
                    self.window::<D>(next, ky, steps)
                };
            }
            let mut done = 0;
            if const { D::RUN > 1 } {
                sums = add_runs::<D, GROUPS, VECTORS>(dot, first, steps, weights, sums);
                done = steps / D::RUN * D::RUN;
            }
            let rest = weights[done * VECTORS * vector..].chunks_exact(VECTORS * vector);
            for (j, weights) in (done..steps).zip(rest) {
                let mut w = [dot.load(weights); VECTORS];
                for v in 1..VECTORS {
                    w[v] = dot.load(&weights[v * vector..]);
                }
                for i in 0..GROUPS {
                    let x = dot.activations([first[i][j], second[i][j]]);
                    for v in 0..VECTORS {
                        sums[i][v] = dot.dot(x, w[v], sums[i][v]);
                    }
                }
            }
        }
        sums
    }
}

/// The hot loop by runs: adds the products of all whole runs of a window's row.
///
/// ```text
/// for each run of 4 steps
///   x[i] = load of pixel i's run                              GROUPS loads
///   for each step of the run
///     w[v] = load of the step's weights, vector v             VECTORS loads
///     sums[i][v] = dot(x[i]'s step, w[v], sums[i][v])         GROUPS * VECTORS dot products
/// ```
///
/// All pixels take one step before any takes the next: dot products in a row are independent.
#[inline(always)]
fn add_runs<D: Dot, const GROUPS: usize, const VECTORS: usize>(
    dot: D,
    windows: [&[D::Step]; GROUPS],
    steps: usize,
    weights: &[[i8; 4]],
    mut sums: [[D::Sums; VECTORS]; GROUPS],
) -> [[D::Sums; VECTORS]; GROUPS] {
    let step = VECTORS * D::Float::LANES * D::QUADS;
    let runs = weights.chunks_exact(D::RUN * step);
    for (j, weights) in (0..steps / D::RUN).zip(runs) {
        let mut x = [dot.load_run(&windows[0][j * D::RUN..]); GROUPS];
        for i in 1..GROUPS {
            x[i] = dot.load_run(&windows[i][j * D::RUN..]);
        }
        sums = add_step::<D, 0, GROUPS, VECTORS>(dot, x, weights, sums);
        sums = add_step::<D, 1, GROUPS, VECTORS>(dot, x, weights, sums);
        sums = add_step::<D, 2, GROUPS, VECTORS>(dot, x, weights, sums);
        sums = add_step::<D, 3, GROUPS, VECTORS>(dot, x, weights, sums);
    }
    sums
}

/// Adds the products of one step of a run.
#[inline(always)]
fn add_step<D: Dot, const STEP: usize, const GROUPS: usize, const VECTORS: usize>(
    dot: D,
    x: [D::Bytes; GROUPS],
    weights: &[[i8; 4]],
    mut sums: [[D::Sums; VECTORS]; GROUPS],
) -> [[D::Sums; VECTORS]; GROUPS] {
    let vector = D::Float::LANES * D::QUADS;
    let weights = &weights[STEP * VECTORS * vector..];
    for v in 0..VECTORS {
        let w = dot.load(&weights[v * vector..]);
        for i in 0..GROUPS {
            sums[i][v] = dot.dot_in_run::<STEP>(x[i], w, sums[i][v]);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::super::{Algorithm, Conv, Input};
    use super::*;
    use crate::par::Threads;
    use testing::{assert_close, noise};

    /// The convolution in `f64` on the values that the bytes stand for.
    fn expected(
        shape: &ConvShape,
        size: Size,
        input: &[f32],
        weights: &[f32],
        q: Quantization,
    ) -> Vec<f64> {
        let bytes = crate::reference::quantize(q, input);
        let input: Vec<f32> = bytes
            .iter()
            .map(|b| q.value(b.round_ties_even() as u8))
            .collect();
        let whole = |window: &[f32]| {
            let (rounded, scale) = round(window);
            rounded
                .iter()
                .map(|w| f32::from(*w) * scale)
                .collect::<Vec<_>>()
        };
        let weights: Vec<f32> = weights.chunks(shape.window()).flat_map(whole).collect();
        crate::reference::conv(shape, size, &input, &weights, &noise(shape.out_channels, 2))
    }

    fn check(shape: ConvShape, size: Size) {
        let weights = noise(shape.out_channels * shape.window(), 1);
        // Multiples of the scale: no value lies between two bytes.
        let input: Vec<f32> = noise(size.area() * shape.in_channels, 3)
            .iter()
            .map(|v| (v * 16.0).round() / 16.0)
            .collect();
        let q = Quantization {
            scale: 1.0 / 16.0,
            zero_point: 21,
        };
        let expected = expected(&shape, size, &input, &weights, q);
        for isa in Isa::available() {
            let conv = Conv::new(
                isa,
                Algorithm::Int8(q),
                shape,
                &weights,
                &noise(shape.out_channels, 2),
            );
            assert_eq!(conv.algorithm(), Algorithm::Int8(q));
            for count in [1, 2] {
                let threads = Threads::new(count);
                let mut out = vec![f32::NAN; expected.len()];
                let mut scratch = vec![f32::NAN; conv.scratch_len(size, &threads)];
                threads.enter(|| conv.run(&threads, &input, size, &mut out, &mut scratch));
                assert_close(
                    &out,
                    &expected,
                    1e-6,
                    &format!("{shape:?} on {size:?}, {isa}, {count} threads"),
                );
            }
        }
    }

    #[test]
    fn int8_at_awkward_widths_equals_the_reference() {
        for (i, n) in [1, 4, 5, 8, 9, 16, 17, 33, 47, 48, 80]
            .into_iter()
            .enumerate()
        {
            for in_channels in [1, 3, 5, 16] {
                let shape = ConvShape {
                    in_channels,
                    out_channels: n,
                    kernel: 3,
                    stride: 1,
                    pad: 0,
                    relu: i % 2 == 0,
                };
                check(shape, Size { h: 4, w: 3 + 2 * i });
            }
        }
    }

    #[test]
    fn int8_with_any_kernel_stride_and_pad_equals_the_reference() {
        for (kernel, stride, pad) in [(1, 1, 0), (3, 1, 1), (3, 2, 1), (5, 1, 2), (11, 2, 0)] {
            let shape = ConvShape {
                in_channels: 3,
                out_channels: 21,
                kernel,
                stride,
                pad,
                relu: true,
            };
            for side in [11, 12, 23] {
                check(
                    shape,
                    Size {
                        h: side,
                        w: side + 5,
                    },
                );
            }
        }
    }

    #[test]
    fn bytes_between_layers_give_the_same_bits_as_floats() {
        let shape = ConvShape {
            in_channels: 5,
            out_channels: 37,
            kernel: 3,
            stride: 1,
            pad: 0,
            relu: true,
        };
        let size = Size { h: 6, w: 11 };
        let (weights, bias) = (noise(37 * shape.window(), 1), noise(37, 2));
        let values: Vec<f32> = noise(size.area() * 5, 3);
        let (q, next) = (
            Quantization::of_range(-1.0, 1.0),
            Quantization::of_range(0.0, 2.5),
        );
        let threads = Threads::new(2);
        for isa in Isa::available() {
            let conv = Conv::new(isa, Algorithm::Int8(q), shape, &weights, &bias);
            let mut scratch = vec![0.0; conv.scratch_len(size, &threads)];
            let out_size = shape.out_size(size);
            let mut floats = vec![0.0; out_size.area() * 37];
            threads.enter(|| conv.run(&threads, &values, size, &mut floats, &mut scratch));
            let rows = |row_len| crate::quant::Rows {
                row_len,
                out_row_len: row_len,
                offset: 0,
            };
            let quantize = |values: &[f32], q, row_len, out: &mut [u8]| {
                crate::quant::quantize(isa, &Threads::new(1), values, q, rows(row_len), out);
            };
            let mut expected = vec![0; floats.len()];
            quantize(&floats, next, out_size.w * 37, &mut expected);
            let mut bytes = vec![0; values.len() + SLACK];
            quantize(&values, q, size.w * 5, &mut bytes);
            let mut out = vec![0; floats.len()];
            threads.enter(|| {
                let (input, output) = (Input::Bytes(&bytes), Output::Bytes(&mut out, next));
                conv.run_between(&threads, input, size, output, &mut scratch)
            });
            assert_eq!(out, expected, "{isa}");
            let mut again = vec![0.0; floats.len()];
            threads.enter(|| {
                let (input, output) = (Input::Bytes(&bytes), Output::Floats(&mut again));
                conv.run_between(&threads, input, size, output, &mut scratch)
            });
            assert_eq!(again, floats, "{isa}");
        }
    }

    #[test]
    fn extreme_bytes_and_weights_do_not_saturate() {
        // All bytes 255, all weights 127 and -127: sums of a few million.
        let shape = ConvShape {
            in_channels: 64,
            out_channels: 18,
            kernel: 5,
            stride: 1,
            pad: 0,
            relu: false,
        };
        let weights: Vec<f32> = (0..18 * shape.window())
            .map(|i| {
                if (i / shape.window()).is_multiple_of(2) {
                    1.0
                } else {
                    -1.0
                }
            })
            .collect();
        let size = Size::square(6);
        let input = vec![255.0; size.area() * 64];
        for isa in Isa::available() {
            let conv = Conv::new(
                isa,
                Algorithm::Int8(Quantization::PIXELS),
                shape,
                &weights,
                &[0.0; 18],
            );
            let threads = Threads::new(1);
            let mut out = vec![0.0; 4 * 18];
            let mut scratch = vec![0.0; conv.scratch_len(size, &threads)];
            conv.run(&threads, &input, size, &mut out, &mut scratch);
            for (i, y) in out.iter().enumerate() {
                let expected = 255.0 * 1600.0 * if i % 2 == 0 { 1.0 } else { -1.0 };
                assert!(
                    (y / expected - 1.0).abs() < 1e-6,
                    "{isa}: {y}, expected {expected}"
                );
            }
        }
    }
}
