//! Direct convolution in register tiles: `y = relu(b + sum of w x)` over the input in place.
//!
//! Shapes: `[H, W, Cin] -> [H', W', Cout]`. Cost: one multiply-add per product, at 90 to 100 % of
//! the processor's peak. Source: the register tiling of GotoBLAS (Goto and van de Geijn, "Anatomy
//! of high-performance matrix multiplication", 2008), without its copies: a row of the window is
//! contiguous already.
//!
//! The basic idea is simple: a register tile of outputs (up to 9 neighboring pixels x up to 3
//! vectors of channels) stays in registers while its window is walked once.
//!
//! ```text
//! for each block of 1..=3 channel vectors     stays in the L2 cache while all rows pass over it
//!   for each output row
//!     for each tile of pixels                 accumulators in registers
//!       for each kernel row                   k * Cin contiguous inputs per pixel
//!         for each input of that row          <- the hot loop, `add_products`
//! ```
//!
//! Three tricks make it fast:
//!
//! - Reuse: `V` weight vectors and `P` broadcast inputs feed `P * V` multiply-adds, so loads are
//!   not the bottleneck.
//! - Packing: weights lie in the order of the walk, so that every load is sequential.
//! - Even tiles: a row is split into tiles of nearly equal width instead of full ones and a small,
//!   slow rest.

use super::ConvShape;
use crate::simd::{Kernel, Simd};
use crate::{Aligned, Isa, Size};

/// Weights in the order of the walk: `[block][k * k * Cin][vectors of the block * LANES]`, zeros
/// after the last channel.
#[derive(Clone, Debug)]
pub(super) struct PackedWeights {
    data: Aligned<f32>,
}

/// Channel vectors of each block: twos, with a three at the end rather than a one.
pub(super) fn blocks(vectors: usize) -> impl Iterator<Item = usize> + Clone {
    let threes = usize::from(vectors % 2 == 1 && vectors > 1);
    let twos = (vectors - 3 * threes) / 2;
    let ones = vectors - 3 * threes - 2 * twos;
    [(2, twos), (3, threes), (1, ones)]
        .into_iter()
        .flat_map(|(width, count)| std::iter::repeat_n(width, count))
}

impl PackedWeights {
    /// From `[Cout, k, k, Cin]`.
    pub(super) fn new(isa: Isa, shape: &ConvShape, weights: &[f32]) -> PackedWeights {
        let mut data = Vec::new();
        pack(isa, shape.out_channels, shape.window(), weights, &mut data);
        PackedWeights {
            data: data.as_slice().into(),
        }
    }
}

/// Appends `weights` (`[outputs, inputs]`) to `data` as
/// `[block][inputs][vectors of the block * LANES]`.
pub(super) fn pack(isa: Isa, outputs: usize, inputs: usize, weights: &[f32], data: &mut Vec<f32>) {
    let lanes = isa.lanes();
    let vectors = outputs.div_ceil(lanes);
    data.reserve(vectors * lanes * inputs);
    let mut first = 0;
    for width in blocks(vectors) {
        let channels = first..first + width * lanes;
        for i in 0..inputs {
            data.extend(
                channels
                    .clone()
                    .map(|o| weights.get(o * inputs + i).copied().unwrap_or(0.0)),
            );
        }
        first = channels.end;
    }
}

/// Some rows of one convolution without padding.
pub(super) struct Direct<'a> {
    pub shape: &'a ConvShape,
    pub weights: &'a PackedWeights,
    pub bias: &'a [f32],  // [Cout]
    pub input: &'a [f32], // [size.h, size.w, Cin], padding included
    pub size: Size,
    pub first_row: usize,   // of the output, that `out` starts at
    pub out: &'a mut [f32], // [rows, W', Cout]
}

impl Kernel for Direct<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Direct {
            shape,
            weights,
            bias,
            input,
            size,
            first_row,
            out,
        } = self;
        let width = (size.w - shape.kernel) / shape.stride + 1;
        let (channels, window) = (shape.out_channels, shape.window());
        // Blocks are the outer loop: one block's weights serve all rows before the next block's are
        // read.
        let mut packed = &weights.data[..];
        let mut first = 0; // channel of the block
        for vectors in blocks(channels.div_ceil(S::LANES)) {
            let block;
            (block, packed) = packed.split_at(window * vectors * S::LANES);
            let used = (channels - first).min(vectors * S::LANES);
            let bias = &bias[first..first + used];
            // Even tiles: of 10 pixels and a tile of 9, two times 5 rather than 9 and 1.
            let tiles = width.div_ceil(S::TILE_PIXELS[vectors]);
            for (y, row) in out.chunks_exact_mut(width * channels).enumerate() {
                let top = (first_row + y) * shape.stride * size.w;
                let mut x = 0;
                for i in 0..tiles {
                    let pixels = width / tiles + usize::from(i < width % tiles);
                    let tile = Tile {
                        input: &input[(top + x * shape.stride) * shape.in_channels..],
                        pixel_step: shape.stride * shape.in_channels,
                        row_step: size.w * shape.in_channels,
                        row_len: shape.kernel * shape.in_channels,
                        rows: shape.kernel,
                        weights: block,
                        bias,
                        relu: shape.relu,
                        out: &mut row[x * channels + first..],
                        out_step: channels,
                    };
                    super::for_tile!(pixels, vectors, tile.run, S, simd, S::TILE_PIXELS);
                    x += pixels;
                }
            }
            first += used;
        }
    }
}

/// One register tile: neighboring pixels of an output row x a block of channels.
struct Tile<'a> {
    input: &'a [f32],   // from the first pixel's window on
    pixel_step: usize,  // from one pixel's window to the next one's
    row_step: usize,    // from one row of the window to the next
    row_len: usize,     // contiguous values of a window's row
    rows: usize,        // rows of the window
    weights: &'a [f32], // [rows * row_len, VECTORS * LANES]
    bias: &'a [f32],    // [channels of the block that exist]
    relu: bool,
    out: &'a mut [f32], // from the first pixel's first channel on
    out_step: usize,    // from one pixel to the next
}

impl Tile<'_> {
    /// Computes the tile's sums, adds the bias, applies ReLU, and writes them: the map is touched
    /// once.
    #[inline(always)]
    #[expect(
        clippy::needless_range_loop,
        reason = "constant indices keep the sums in registers"
    )]
    fn run<S: Simd, const PIXELS: usize, const VECTORS: usize>(self, simd: S) {
        let sums = self.sums::<S, PIXELS, VECTORS>(simd);
        // ReLU is a maximum with 0, no ReLU one with -infinity: no branch per value.
        let floor = simd.splat(if self.relu { 0.0 } else { f32::NEG_INFINITY });
        for i in 0..PIXELS {
            let out = &mut self.out[i * self.out_step..][..self.bias.len()];
            for v in 0..VECTORS {
                let (first, whole) = (v * S::LANES, (v + 1) * S::LANES <= out.len());
                if whole {
                    let sum = simd.add(sums[i][v], simd.load(&self.bias[first..]));
                    simd.store(simd.max(sum, floor), &mut out[first..]);
                } else if first < out.len() {
                    let sum = simd.add(sums[i][v], simd.load_partial(&self.bias[first..]));
                    simd.store_partial(simd.max(sum, floor), &mut out[first..]);
                }
            }
        }
    }

    /// The tile's sums over the whole window, one row of the window after the other.
    #[inline(always)]
    fn sums<S: Simd, const PIXELS: usize, const VECTORS: usize>(
        &self,
        simd: S,
    ) -> [[S::F32; VECTORS]; PIXELS] {
        let mut sums = [[simd.zero(); VECTORS]; PIXELS];
        for (ky, weights) in self
            .weights
            .chunks_exact(self.row_len * VECTORS * S::LANES)
            .take(self.rows)
            .enumerate()
        {
            // Slices of a known length per pixel: the hot loop's bounds checks vanish.
            let mut windows = [&self.input[..0]; PIXELS];
            for (i, window) in windows.iter_mut().enumerate() {
                *window = &self.input[ky * self.row_step + i * self.pixel_step..][..self.row_len];
            }
            add_products::<S, PIXELS, VECTORS, false>(
                simd,
                windows,
                self.row_len,
                weights,
                &mut sums,
            );
        }
        sums
    }
}

/// The hot loop: adds the products of `len` values of each pixel with `weights`
/// (`[len, VECTORS * LANES]`). Winograd's stored kernels use it for their point products.
///
/// ```text
/// for j in 0..len
///   w[v] = load of weights[j][v]           VECTORS loads
///   x    = broadcast of pixels[i][j]       PIXELS broadcasts, part of AVX-512's multiply-add
///   sums[i][v] += x * w[v]                 PIXELS * VECTORS multiply-adds
/// ```
///
/// If `AHEAD`, prefetches the weights that follow these, which the next call reads.
#[inline(always)]
pub(super) fn add_products<
    S: Simd,
    const PIXELS: usize,
    const VECTORS: usize,
    const AHEAD: bool,
>(
    simd: S,
    pixels: [&[f32]; PIXELS],
    len: usize,
    weights: &[f32],
    sums: &mut [[S::F32; VECTORS]; PIXELS],
) {
    for (j, weights) in (0..len).zip(weights.chunks_exact(VECTORS * S::LANES)) {
        let mut w = [simd.zero(); VECTORS];
        for v in 0..VECTORS {
            w[v] = simd.load(&weights[v * S::LANES..]);
            if AHEAD {
                simd.prefetch(&weights[v * S::LANES..], len * VECTORS * S::LANES);
            }
        }
        for i in 0..PIXELS {
            let x = simd.splat(pixels[i][j]);
            for v in 0..VECTORS {
                sums[i][v] = simd.mul_add(x, w[v], sums[i][v]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn blocks_cover_every_vector_without_a_lone_one() {
        for vectors in 1..40 {
            let widths: Vec<_> = super::blocks(vectors).collect();
            assert_eq!(widths.iter().sum::<usize>(), vectors);
            assert!(
                vectors == 1 || !widths.contains(&1),
                "{vectors}: {widths:?}"
            );
        }
    }
}
