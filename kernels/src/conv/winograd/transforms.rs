//! The transforms: of a strip's input tiles, of the kernels, and of the products to outputs.

use super::Strip;
use super::points::{MAX_KERNEL, input_points, output_values};
use crate::Size;
use crate::simd::{Kernel, Simd};

/// `V = B^T d B` of a strip's tiles.
pub(super) struct InputTiles<'a, const A: usize, const M: usize> {
    pub input: &'a [f32], // [size.h, size.w, channels]
    pub size: Size,
    pub channels: usize,
    pub first_row: usize, // of the outputs that tile 0 has
    pub strip: &'a Strip<'a>,
    pub v: &'a mut [f32], // of the strip
}

impl<const A: usize, const M: usize> Kernel for InputTiles<'_, A, M> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let InputTiles { input, size, channels, first_row, strip, v } = self;
        let mut half = [[simd.zero(); A]; A];
        for (group, v) in strip.groups().zip(v.chunks_exact_mut(strip.plan.v_len)) {
            for (tile, at) in group.zip((0..).step_by(channels)) {
                let (y, x) = strip.plan.corner(tile, M);
                let corner = (first_row + y, x);
                input_tile::<S, A>(
                    simd,
                    input,
                    size,
                    channels,
                    corner,
                    &mut v[at..],
                    strip.plan.v_step,
                    &mut half,
                );
            }
        }
    }
}

/// `V = B^T d B` of the input tile whose corner is `(y, x)`; inputs beyond the map count as 0.
///
/// `v` starts with this tile's channels of point 0; the next point's are `v_step` further on. Whole vectors are written: what they
/// reach beyond the last channel, the next tile overwrites, and behind the last tile there must be room for it. `half` is space for `B^T d`, transposed
/// (`[column][row]`): as large as the registers together, it would cost as much to clear for each tile as to fill.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // two strided maps
pub fn input_tile<S: Simd, const A: usize>(
    simd: S,
    input: &[f32],
    size: Size,
    channels: usize,
    (y, x): (usize, usize),
    v: &mut [f32], // this tile's channels of point 0
    v_step: usize,
    half: &mut [[S::F32; A]; A],
) {
    let (rows, columns) = (A.min(size.h - y), A.min(size.w - x));
    for c in (0..channels).step_by(S::LANES) {
        let n = S::LANES.min(channels - c);
        half[columns..].fill([simd.zero(); A]);
        for j in 0..columns {
            let mut d = [simd.zero(); A];
            for i in 0..rows {
                let from = &input[((y + i) * size.w + x + j) * channels + c..][..n];
                d[i] = if n == S::LANES { simd.load(from) } else { simd.load_partial(from) };
            }
            half[j] = input_points::<S, A>(simd, &d);
        }
        for i in 0..A {
            let mut d = [simd.zero(); A];
            for j in 0..A {
                d[j] = half[j][i];
            }
            let row = input_points::<S, A>(simd, &d);
            for j in 0..A {
                simd.store(row[j], &mut v[(i * A + j) * v_step + c..]);
            }
        }
    }
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
    pub i: usize,
    pub m: &'a [f32],        // [tiles * vectors][A][LANES]: row i of M
    pub half: &'a mut [f32], // [tiles * vectors][M][A][LANES]: M A, transposed
}

impl<const A: usize, const M: usize> Kernel for HalfOutputs<'_, A, M> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let (rows, halves) =
            (self.m.chunks_exact(A * S::LANES), self.half.chunks_exact_mut(A * M * S::LANES));
        for (row, half) in rows.zip(halves) {
            let m: [S::F32; A] = std::array::from_fn(|j| simd.load(&row[j * S::LANES..]));
            let line = output_values::<S, A, M>(simd, &m);
            for (value, column) in line.into_iter().zip(half.chunks_exact_mut(A * S::LANES)) {
                simd.store(value, &mut column[self.i * S::LANES..]);
            }
        }
    }
}

/// `Y = A^T M A`, bias and floor, of a strip's tiles and one block: the outputs as far as they lie within `out`.
pub(super) struct OutputTiles<'a, const A: usize, const M: usize> {
    pub strip: &'a Strip<'a>,
    pub half: &'a [f32], // [tiles][vectors][M][A][LANES]: M A, transposed
    pub bias: &'a [f32], // of the block's channels
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
        let OutputTiles { strip, half, bias, relu, out, width, channels, first } = self;
        let height = out.len() / (width * channels);
        let floor = simd.splat(if relu { 0.0 } else { f32::NEG_INFINITY });
        let mut halves = half.chunks_exact(A * M * S::LANES);
        for tile in strip.tiles.clone() {
            let (y, x) = strip.plan.corner(tile, M);
            let (rows, columns) = (M.min(height - y), M.min(width - x));
            let vectors = bias.chunks(S::LANES).zip((first..).step_by(S::LANES));
            for ((bias, c), half) in vectors.zip(&mut halves) {
                let (n, bias) = (bias.len(), simd.load_partial(bias));
                for (j, column) in half.chunks_exact(A * S::LANES).take(columns).enumerate() {
                    let m: [S::F32; A] = std::array::from_fn(|i| simd.load(&column[i * S::LANES..]));
                    let line = output_values::<S, A, M>(simd, &m);
                    for (i, value) in line.into_iter().take(rows).enumerate() {
                        let value = simd.max(simd.add(value, bias), floor);
                        let at = ((y + i) * width + x + j) * channels + c;
                        let to = &mut out[at..at + n];
                        if n == S::LANES { simd.store(value, to) } else { simd.store_partial(value, to) }
                    }
                }
            }
        }
    }
}
