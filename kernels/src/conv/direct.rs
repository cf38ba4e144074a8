//! Direct convolution in register tiles.
//!
//! One tile is up to 9 neighboring pixels of an output row x up to 3 vectors of output channels, held in registers
//! while the window is walked once: per step one vector load per channel vector, one broadcast per pixel, and their
//! products. Weights are packed so that the walk reads them front to back:
//!
//! ```text
//! for each block of 1..=3 channel vectors     stays in the L2 cache while all rows pass over it
//!   for each output row
//!     for each tile of pixels                 accumulators in registers
//!       for each kernel row                   k * Cin contiguous inputs per pixel
//!         for each input of that row          <- the hot loop, in `add_products`
//! ```

use super::ConvShape;
use crate::simd::{Kernel, Simd};
use crate::{Aligned, Isa, Size};

/// Weights as the tiles read them: `[block][k * k * Cin][vectors of the block * LANES]`, zeros behind the last channel.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    data: Aligned<f32>,
}

/// Channel vectors of each block: twos, and a three at the end instead of a lone one.
pub(super) fn blocks(vectors: usize) -> impl Iterator<Item = usize> + Clone {
    let threes = usize::from(vectors % 2 == 1 && vectors > 1);
    let twos = (vectors - 3 * threes) / 2;
    let ones = vectors - 3 * threes - 2 * twos;
    [(2, twos), (3, threes), (1, ones)]
        .into_iter()
        .flat_map(|(width, count)| std::iter::repeat_n(width, count))
}

impl Weights {
    /// From `[Cout, k, k, Cin]`.
    pub(super) fn new(isa: Isa, shape: &ConvShape, weights: &[f32]) -> Weights {
        let mut data = Vec::new();
        pack(isa, shape.out_channels, shape.window(), weights, &mut data);
        Weights {
            data: data.as_slice().into(),
        }
    }
}

/// Appends `weights` (`[outputs, inputs]`) to `data` as `[block][inputs][vectors of the block * LANES]`.
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
    pub weights: &'a Weights,
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
        let mut packed = &weights.data[..];
        let mut first = 0; // channel of the block
        for vectors in blocks(channels.div_ceil(S::LANES)) {
            let block;
            (block, packed) = packed.split_at(window * vectors * S::LANES);
            let used = (channels - first).min(vectors * S::LANES);
            let bias = &bias[first..first + used];
            // Equal tiles instead of full ones and a small rest.
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
                    super::for_tile!(pixels, vectors, tile.run, S, simd);
                    x += pixels;
                }
            }
            first += used;
        }
    }
}

/// One register tile: neighboring pixels x a block of channels.
pub(super) struct Tile<'a> {
    pub input: &'a [f32],   // from the first pixel's window on
    pub pixel_step: usize,  // from one pixel's window to the next one's
    pub row_step: usize,    // from one row of the window to the next
    pub row_len: usize,     // contiguous values of a window's row
    pub rows: usize,        // rows of the window
    pub weights: &'a [f32], // [rows * row_len, VECTORS * LANES]
    pub bias: &'a [f32],    // [channels of the block that exist]
    pub relu: bool,
    pub out: &'a mut [f32], // from the first pixel's first channel on
    pub out_step: usize,    // from one pixel to the next
}

impl Tile<'_> {
    /// Writes the products with bias and floor.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // constant indices keep the sums in registers
    pub(super) fn run<S: Simd, const PIXELS: usize, const VECTORS: usize>(self, simd: S) {
        let sums = self.sums::<S, PIXELS, VECTORS>(simd);
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

    #[inline(always)]
    #[allow(clippy::needless_range_loop)]
    fn sums<S: Simd, const PIXELS: usize, const VECTORS: usize>(
        &self,
        simd: S,
    ) -> [[S::F32; VECTORS]; PIXELS] {
        if PIXELS > S::TILE_PIXELS[VECTORS] {
            unreachable!("more than the registers hold");
        }
        let mut sums = [[simd.zero(); VECTORS]; PIXELS];
        for (ky, weights) in self
            .weights
            .chunks_exact(self.row_len * VECTORS * S::LANES)
            .take(self.rows)
            .enumerate()
        {
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

/// The hot loop: adds the products of `len` values of each pixel with `weights` (`[len, VECTORS * LANES]`); on the way asks, if `AHEAD`, for
/// what follows those weights.
#[inline(always)]
#[allow(clippy::needless_range_loop)] // constant indices keep the sums in registers
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
