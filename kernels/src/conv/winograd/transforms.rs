//! The transforms: of a strip's input tiles, of the kernels, and of the products to outputs.

use super::points::{MAX_KERNEL, input_points, output_values};
use super::{Plan, Strip, step};
use crate::Size;
use crate::simd::{Kernel, Simd};

/// `V = B^T d B` of a strip's tiles.
pub(super) struct InputTiles<'a, const A: usize, const M: usize> {
    pub input: &'a [f32], // [size.h, size.w, channels]
    pub size: Size,
    pub channels: usize,
    pub first_row: usize, // of the outputs that tile 0 has
    pub strip: &'a Strip<'a>,
    pub lines: &'a mut [f32], // room for B^T d of a row of tiles
    pub v: &'a mut [f32],     // of the strip
}

impl<const A: usize, const M: usize> Kernel for InputTiles<'_, A, M> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let InputTiles { input, size, channels, first_row, strip, lines, v } = self;
        let Plan { across, v_step, v_len, .. } = *strip.plan;
        let mut places = strip.groups().enumerate().flat_map(|(group, tiles)| {
            (0..tiles).map(move |tile| group * v_len + tile * channels) // of the tile in V
        });
        let mut first = strip.tiles.start;
        while first < strip.tiles.end {
            let tiles = (across - first % across).min(strip.tiles.end - first); // in this row
            let (y, x) = strip.plan.corner(first, M);
            let mut lines = Lines { values: &mut *lines, columns: (tiles - 1) * M + A, channels };
            lines.fill::<S, A>(simd, input, size, (first_row + y, x));
            for (tile, place) in (0..tiles).zip(&mut places) {
                lines.tile::<S, A>(simd, tile * M, &mut v[place..], v_step);
            }
            first += tiles;
        }
    }
}

/// `B^T d` of a row of tiles, which share the columns in which they overlap.
pub struct Lines<'a> {
    /// `[A][columns, channels]` and a vector's room behind each of the `A` lines: [`lines_len`] values.
    pub values: &'a mut [f32],
    /// Columns of all tiles together.
    pub columns: usize,
    /// Channels of the input.
    pub channels: usize,
}

/// Values that [`Lines`] needs for `points` points.
pub fn lines_len(points: usize, columns: usize, channels: usize) -> usize {
    points * step(columns * channels)
}

impl Lines<'_> {
    /// Takes the columns from `(y, x)` on out of `input` (`[size.h, size.w, channels]`); beyond the map everything counts as 0.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // constant indices keep the line in registers
    pub fn fill<S: Simd, const A: usize>(
        &mut self,
        simd: S,
        input: &[f32],
        size: Size,
        (y, x): (usize, usize),
    ) {
        let Lines { columns, channels, .. } = *self;
        let (rows, len) = (A.min(size.h - y), columns.min(size.w - x) * channels);
        let (from_step, to_step) = (size.w * channels, step(columns * channels));
        let input = &input[y * from_step + x * channels..];
        for at in starts(len, S::LANES) {
            let mut d = [simd.zero(); A];
            for i in 0..rows {
                let from = &input[i * from_step + at..];
                d[i] = if len >= S::LANES { simd.load(from) } else { simd.load_partial(&from[..len]) };
            }
            for (i, value) in input_points::<S, A>(simd, &d).into_iter().enumerate() {
                simd.store(value, &mut self.values[i * to_step + at..]);
            }
        }
        for line in self.values.chunks_exact_mut(to_step).take(A) {
            line[len..columns * channels].fill(0.0);
        }
    }

    /// `V = B^T d B` of the tile that begins in `column`.
    ///
    /// `v` starts with the tile's channels of point 0; the next point's are `v_step` further on. Of fewer channels than a vector has
    /// lanes a whole vector is written: what it reaches beyond them, the next tile overwrites, and behind the last tile there
    /// must be room for it.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // as above
    pub fn tile<S: Simd, const A: usize>(&self, simd: S, column: usize, v: &mut [f32], v_step: usize) {
        let Lines { columns, channels, .. } = *self;
        let from_step = step(columns * channels);
        for c in starts(channels, S::LANES) {
            for i in 0..A {
                let line = &self.values[i * from_step + column * channels + c..];
                let mut d = [simd.zero(); A];
                for j in 0..A {
                    d[j] = simd.load(&line[j * channels..]);
                }
                for (j, value) in input_points::<S, A>(simd, &d).into_iter().enumerate() {
                    simd.store(value, &mut v[(i * A + j) * v_step + c..]);
                }
            }
        }
    }
}

/// Where the vectors begin that cover `len` values: the last one reaches back where it would reach beyond.
#[inline(always)]
fn starts(len: usize, lanes: usize) -> impl Iterator<Item = usize> {
    let last = len.saturating_sub(lanes);
    (0..len).step_by(lanes).map(move |at| at.min(last))
}

/// Row `i` of the points of `U = G g G^T` for one block.
pub(super) struct KernelRow<'a, const A: usize, const K: usize> {
    pub g: &'a [[f32; MAX_KERNEL]; A],
    pub i: usize,
    pub taps: &'a [f32],  // [Cin * vectors][k * k][LANES]
    pub u: &'a mut [f32], // A matrices [Cin, vectors * LANES]
    pub u_step: usize,    // from one of them to the next
}

impl<const A: usize, const K: usize> Kernel for KernelRow<'_, A, K> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // constant indices keep the taps in registers
    fn run<S: Simd>(self, simd: S) {
        let KernelRow { g, i, taps, u, u_step } = self;
        let row = &g[i];
        for (n, taps) in taps.chunks_exact(K * K * S::LANES).enumerate() {
            let mut line = [simd.zero(); K]; // of G g
            for x in 0..K {
                for y in 0..K {
                    let tap = simd.load(&taps[(y * K + x) * S::LANES..]);
                    line[x] = simd.mul_add(simd.splat(row[y]), tap, line[x]);
                }
            }
            let mut points = [simd.zero(); A];
            points[0] = simd.mul_add(simd.splat(g[0][0]), line[0], simd.zero());
            for j in (1..A - 1).step_by(2) {
                let (mut even, mut odd) = (simd.zero(), simd.zero()); // powers of the point, which comes with both signs
                for x in 0..K {
                    let sum = if x % 2 == 0 { &mut even } else { &mut odd };
                    *sum = simd.mul_add(simd.splat(g[j][x]), line[x], *sum);
                }
                (points[j], points[j + 1]) = (simd.add(even, odd), simd.sub(even, odd));
            }
            points[A - 1] = line[K - 1];
            for j in 0..A {
                simd.store(points[j], &mut u[j * u_step + n * S::LANES..]);
            }
        }
    }
}

/// Row `i` of `M A`, of all tiles of a strip: half of the output's transform, as soon as a row of points is multiplied.
pub(super) struct HalfOutputs<'a, const A: usize, const M: usize> {
    pub m: &'a [f32],        // [tiles * vectors][A][LANES]: a row of M
    pub half: &'a mut [f32], // [tiles * vectors][M][LANES]: the same row of M A
}

impl<const A: usize, const M: usize> Kernel for HalfOutputs<'_, A, M> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let (rows, halves) = (self.m.chunks_exact(A * S::LANES), self.half.chunks_exact_mut(M * S::LANES));
        for (row, half) in rows.zip(halves) {
            let m: [S::F32; A] = std::array::from_fn(|j| simd.load(&row[j * S::LANES..]));
            let line = output_values::<S, A, M>(simd, &m);
            for (value, half) in line.into_iter().zip(half.chunks_exact_mut(S::LANES)) {
                simd.store(value, half);
            }
        }
    }
}

/// `Y = A^T M A`, bias and floor, of a strip's tiles and one block: the outputs as far as they lie within `out`.
pub(super) struct OutputTiles<'a, const A: usize, const M: usize> {
    pub strip: &'a Strip<'a>,
    pub half: &'a [f32],  // A times [tiles][vectors][M][LANES]: M A
    pub half_step: usize, // from one of them to the next
    pub bias: &'a [f32],  // of the block's channels
    pub relu: bool,
    pub out: &'a mut [f32], // [rows, width, channels]
    pub width: usize,
    pub channels: usize,
    pub first: usize, // channel of the block
}

impl<const A: usize, const M: usize> Kernel for OutputTiles<'_, A, M> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let OutputTiles { strip, half, half_step, bias, relu, out, width, channels, first } = self;
        let height = out.len() / (width * channels);
        let floor = simd.splat(if relu { 0.0 } else { f32::NEG_INFINITY });
        let mut at = 0; // of M A
        for tile in strip.tiles.clone() {
            let (y, x) = strip.plan.corner(tile, M);
            let (rows, columns) = (M.min(height - y), M.min(width - x));
            for (bias, c) in bias.chunks(S::LANES).zip((first..).step_by(S::LANES)) {
                let (n, bias) = (bias.len(), simd.load_partial(bias));
                for j in 0..columns {
                    let m: [S::F32; A] =
                        std::array::from_fn(|i| simd.load(&half[i * half_step + at + j * S::LANES..]));
                    let line = output_values::<S, A, M>(simd, &m);
                    for (i, value) in line.into_iter().take(rows).enumerate() {
                        let value = simd.max(simd.add(value, bias), floor);
                        let to = &mut out[((y + i) * width + x + j) * channels + c..][..n];
                        if n == S::LANES { simd.store(value, to) } else { simd.store_partial(value, to) }
                    }
                }
                at += M * S::LANES;
            }
        }
    }
}
