//! Convolution with fewer multiplications: Winograd's F(m x m, k x k), for stride 1 and whatever `fold.rs` makes of others.
//!
//! An `m x m` tile of outputs depends on an `a x a` tile of inputs, `a = m + k - 1`. Both and the kernel are polynomials
//! that are multiplied at `a` points (0, pairs such as 1 and -1, infinity), where a product costs one multiplication per point:
//!
//! ```text
//! V = B^T d B              input tile, per input channel              additions
//! M = sum over i of U V    a x a matrix products [tiles, Cin] x [Cin, Cout]   all the multiplications
//! Y = A^T M A              output tile, per output channel            additions
//! U = G g G^T              kernels
//! ```
//!
//! Multiplications per output, by side of the kernel and points:
//!
//! | `k` | direct | 6 points | 8 points | 10 points |
//! |---|---|---|---|---|
//! | 3 | 9 | 2.25 | 1.78 | |
//! | 5 | 25 | 9 | 4 | 2.78 |
//! | 6 | 36 | | 7.11 | 4 |
//!
//! More points round more (about 1e-6 of the outputs' RMS for 8, 1e-5 for 10) and waste more at the border.
//! Source: Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016; the choice of points: Barabasz et al., "Error
//! analysis and improving the accuracy of Winograd convolution for deep neural networks", 2020.
//!
//! A thread takes some rows of tiles, a strip at a time, and does all three steps for it in its own scratch space, a block of output
//! channels at a time: small enough for the cache.
//!
//! `U` is `a * a / (k * k)` times as large as the kernels. For `k = 3` that is up to 7 times, and on the small maps where such
//! kernels stand reading it from memory would take longer than multiplying with it: there `U` is made anew where it is used, a row of
//! points at a time.

mod points;

use super::direct::{Tile, blocks};
use super::{ConvShape, fold};
use crate::simd::{Kernel, Simd};
use crate::{Isa, Size};
pub use points::{MAX_KERNEL, kernel_row, pairs};
use points::{input_points, kernel_matrix, output_values};

/// Kernels of one layer.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    shape: ConvShape, // without stride
    points: usize,    // a
    lanes: usize,     // of the widest block
    group: usize,     // most tiles that are multiplied at a time
    kernels: Kernels,
}

#[derive(Clone, Debug)]
enum Kernels {
    /// `g`: `[block][Cin][vectors of the block][k * k][LANES]`.
    Taps(Vec<f32>),
    /// `U`: `[block][a * a][Cin][vectors of the block * LANES]`.
    Points(Vec<f32>),
}

/// Whether there is an algorithm of `points` for the kernel without its stride.
pub(super) fn fits(shape: &ConvShape, points: usize) -> bool {
    [(6, 3), (8, 3), (6, 5), (8, 5), (10, 5), (8, 6), (10, 6)]
        .contains(&(points, fold::unstrided(shape).kernel))
}

impl Weights {
    /// From `[Cout, k, k, Cin]`.
    pub(super) fn new(isa: Isa, shape: &ConvShape, points: usize, weights: &[f32]) -> Weights {
        let inner = fold::unstrided(shape);
        let taps = if shape.stride > 1 {
            pack(isa, &inner, &fold::weights(shape, weights))
        } else {
            pack(isa, &inner, weights)
        };
        let kernels = if inner.kernel == 3 {
            Kernels::Taps(taps)
        } else {
            let mut whole = vec![0.0; taps.len() / (inner.kernel * inner.kernel) * points * points];
            isa.run(TransformKernels { shape: &inner, points, taps: &taps, out: &mut whole });
            Kernels::Points(whole)
        };
        let widest = blocks(inner.out_channels.div_ceil(isa.lanes())).max().unwrap_or(0);
        Weights { shape: inner, points, lanes: widest * isa.lanes(), group: isa.tile_pixels(widest), kernels }
    }

    /// The convolution without its stride.
    pub(super) fn shape(&self) -> &ConvShape {
        &self.shape
    }

    pub(super) fn points(&self) -> usize {
        self.points
    }
}

/// `[Cout, k, k, Cin]` as [`Kernels::Taps`], zeros behind the last channel.
fn pack(isa: Isa, shape: &ConvShape, weights: &[f32]) -> Vec<f32> {
    let (lanes, taps, cin) = (isa.lanes(), shape.kernel * shape.kernel, shape.in_channels);
    let vectors = shape.out_channels.div_ceil(lanes);
    let mut packed = Vec::with_capacity(vectors * lanes * shape.window());
    let mut first = 0;
    for width in blocks(vectors) {
        for i in 0..cin {
            for vector in first..first + width {
                for tap in 0..taps {
                    let channels = vector * lanes..(vector + 1) * lanes;
                    let weight = |o: usize| weights.get((o * taps + tap) * cin + i).copied();
                    packed.extend(channels.map(|o| weight(o).unwrap_or(0.0)));
                }
            }
        }
        first += width;
    }
    packed
}

/// `U = G g G^T` of all kernels.
struct TransformKernels<'a> {
    shape: &'a ConvShape,
    points: usize,
    taps: &'a [f32],    // as in `Kernels::Taps`
    out: &'a mut [f32], // as in `Kernels::Points`
}

impl Kernel for TransformKernels<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        match (self.points, self.shape.kernel) {
            (6, 5) => self.run_sized::<S, 6, 5>(simd),
            (8, 5) => self.run_sized::<S, 8, 5>(simd),
            (10, 5) => self.run_sized::<S, 10, 5>(simd),
            (8, 6) => self.run_sized::<S, 8, 6>(simd),
            (10, 6) => self.run_sized::<S, 10, 6>(simd),
            (points, kernel) => unreachable!("{points} points for a {kernel}x{kernel} kernel"),
        }
    }
}

impl TransformKernels<'_> {
    #[inline(always)]
    fn run_sized<S: Simd, const A: usize, const K: usize>(self, simd: S) {
        let (mut from, mut to) = (self.taps, self.out);
        let g = kernel_matrix(K);
        for vectors in blocks(self.shape.out_channels.div_ceil(S::LANES)) {
            let step = self.shape.in_channels * vectors * S::LANES;
            let (taps, points);
            (taps, from) = from.split_at(K * K * step);
            (points, to) = to.split_at_mut(A * A * step);
            for (i, row) in points.chunks_exact_mut(A * step).enumerate() {
                row_of_kernels::<S, A, K>(simd, &g, i, taps, row, step);
            }
        }
    }
}

/// Row `i` of the points of `U` for one block: from `[Cin * vectors][k * k][LANES]` taps to `A` matrices `[Cin, vectors * LANES]`,
/// which begin `u_step` apart.
#[inline(always)]
#[allow(clippy::needless_range_loop)] // constant indices keep the taps in registers
fn row_of_kernels<S: Simd, const A: usize, const K: usize>(
    simd: S,
    g: &[[f32; MAX_KERNEL]; A],
    i: usize,
    taps: &[f32],
    u: &mut [f32],
    u_step: usize,
) {
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

/// Tiles that one strip takes, if a row of tiles is not longer: where `U` is made anew for every strip, and where it is read.
const STRIP_TILES: [usize; 2] = [64, 24];

/// How a map is cut into tiles, and the scratch space for a strip of them.
///
/// `V` and `M` lie group by group (as many tiles as a register tile takes), in a group point by point: the transforms, which
/// touch all points of a tile, stay within few pages of memory.
struct Plan {
    points: usize, // a
    across: usize, // tiles in a row
    strip: usize,  // rows of tiles in a strip
    group: usize,  // most tiles in a group
    v_step: usize, // from one point's V to the next one's, within a group
    m_step: usize, // from one point's M to the next one's, within a group
    u_step: usize, // from one point's U to the next one's, within a row
}

impl Plan {
    fn new(weights: &Weights, out: Size) -> Plan {
        let Weights { shape, points, lanes, group, kernels } = weights;
        let m = rows_per_tile(shape, *points);
        let across = out.w.div_ceil(m);
        let anew = matches!(kernels, Kernels::Taps(_));
        let strip = (STRIP_TILES[usize::from(!anew)] / across).clamp(1, out.h.div_ceil(m));
        // One cache line more than needed, lest the points' lines fall on each other in the cache.
        let step = |values: usize| values.next_multiple_of(16) + 16;
        Plan {
            points: *points,
            across,
            strip,
            group: *group,
            v_step: step(group * shape.in_channels),
            m_step: step(group * lanes),
            u_step: if anew { step(shape.in_channels * lanes) } else { 0 },
        }
    }

    /// Values of `V` and of `M` of one group.
    fn group_len(&self) -> [usize; 2] {
        [self.v_step, self.m_step].map(|step| self.points * self.points * step)
    }

    fn scratch_len(&self) -> usize {
        let groups = (self.strip * self.across).div_ceil(self.group);
        groups * self.group_len().iter().sum::<usize>() + self.points * self.u_step
    }

    /// The first tile of each group and behind the last, of `tiles` in groups of equal size: no small rest.
    fn groups(&self, tiles: usize) -> impl Iterator<Item = std::ops::Range<usize>> + use<> {
        let groups = tiles.div_ceil(self.group);
        (0..groups).map(move |i| i * tiles / groups..(i + 1) * tiles / groups)
    }
}

/// Output rows of one row of tiles: threads split the map at multiples of it.
pub(super) fn rows_per_tile(shape: &ConvShape, points: usize) -> usize {
    points + 1 - shape.kernel
}

/// Scratch values per thread.
pub(super) fn scratch_len(weights: &Weights, out: Size) -> usize {
    Plan::new(weights, out).scratch_len()
}

/// Some rows of one convolution without padding.
pub(super) struct Winograd<'a> {
    pub weights: &'a Weights,
    pub bias: &'a [f32],  // [Cout]
    pub input: &'a [f32], // [size.h, size.w, Cin], padding included
    pub size: Size,
    pub first_row: usize, // of the output, that `out` starts at: a multiple of the tile's
    pub out: &'a mut [f32], // [rows, W', Cout]
    pub scratch: &'a mut [f32], // of `scratch_len`
}

impl Kernel for Winograd<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        match (self.weights.points, self.weights.shape.kernel) {
            (6, 3) => self.run_sized::<S, 6, 3, 4>(simd),
            (8, 3) => self.run_sized::<S, 8, 3, 6>(simd),
            (6, 5) => self.run_sized::<S, 6, 5, 2>(simd),
            (8, 5) => self.run_sized::<S, 8, 5, 4>(simd),
            (10, 5) => self.run_sized::<S, 10, 5, 6>(simd),
            (8, 6) => self.run_sized::<S, 8, 6, 3>(simd),
            (10, 6) => self.run_sized::<S, 10, 6, 5>(simd),
            (points, kernel) => unreachable!("{points} points for a {kernel}x{kernel} kernel"),
        }
    }
}

impl Winograd<'_> {
    #[inline(always)]
    fn run_sized<S: Simd, const A: usize, const K: usize, const M: usize>(self, simd: S) {
        let Winograd { weights, bias, input, size, first_row, out, scratch } = self;
        let shape = &weights.shape;
        let width = size.w + 1 - K;
        let (cin, cout) = (shape.in_channels, shape.out_channels);
        let plan = Plan::new(weights, Size { h: size.h + 1 - K, w: width });
        let [v_len, m_len] = plan.group_len();
        let (u, scratch) = scratch.split_at_mut(A * plan.u_step);
        let (v, m) = scratch.split_at_mut((plan.strip * plan.across).div_ceil(plan.group) * v_len);
        let floor = if shape.relu { 0.0 } else { f32::NEG_INFINITY };
        let g = kernel_matrix(K);
        let (mut half_in, mut half_out) = ([[simd.zero(); A]; A], [[simd.zero(); M]; A]);
        for (i, out) in out.chunks_mut(plan.strip * M * width * cout).enumerate() {
            let top = first_row + i * plan.strip * M;
            let tiles = (out.len() / (width * cout)).div_ceil(M) * plan.across;
            for (group, v) in plan.groups(tiles).zip(v.chunks_exact_mut(v_len)) {
                for (tile, at) in group.zip((0..).step_by(cin)) {
                    let corner = (top + tile / plan.across * M, tile % plan.across * M);
                    input_tile::<S, A>(
                        simd,
                        input,
                        size,
                        cin,
                        corner,
                        &mut v[at..],
                        plan.v_step,
                        &mut half_in,
                    );
                }
            }
            let mut first = 0; // channel of the block
            for vectors in blocks(cout.div_ceil(S::LANES)) {
                let lanes = vectors * S::LANES;
                for i in 0..A {
                    let (row, step) = match &weights.kernels {
                        Kernels::Taps(taps) => {
                            let taps = &taps[first * K * K * cin..][..K * K * cin * lanes];
                            row_of_kernels::<S, A, K>(simd, &g, i, taps, u, plan.u_step);
                            (&*u, plan.u_step)
                        }
                        Kernels::Points(points) => {
                            (&points[(first * A * A + i * A * lanes) * cin..], cin * lanes)
                        }
                    };
                    for j in 0..A {
                        let (p, u) = (i * A + j, &row[j * step..][..cin * lanes]);
                        let groups = v.chunks_exact(v_len).zip(m.chunks_exact_mut(m_len));
                        for (group, (v, m)) in plan.groups(tiles).zip(groups) {
                            let (v, m) = (&v[p * plan.v_step..], &mut m[p * plan.m_step..]);
                            multiply(simd, group.len(), vectors, v, u, m);
                        }
                    }
                }
                let used = (cout - first).min(lanes);
                let bias = &bias[first..first + used];
                for (group, m) in plan.groups(tiles).zip(m.chunks_exact(m_len)) {
                    for (tile, at) in group.zip((0..).step_by(lanes)) {
                        let corner = (tile / plan.across * M, tile % plan.across * M);
                        let map = OutputMap { values: &mut *out, width, channels: cout, first };
                        output_tile::<S, A, M>(
                            simd,
                            &m[at..],
                            plan.m_step,
                            bias,
                            floor,
                            map,
                            corner,
                            &mut half_out,
                        );
                    }
                }
                first += used;
            }
        }
    }
}

/// `V = B^T d B` of the input tile whose corner is `(y, x)`; inputs beyond the map count as 0.
///
/// `v` starts with this tile's channels of point 0; the next point's are `v_step` further on. `half` is space for `B^T d`, transposed
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
                let to = &mut v[(i * A + j) * v_step + c..][..n];
                if n == S::LANES { simd.store(row[j], to) } else { simd.store_partial(row[j], to) }
            }
        }
    }
}

/// `M = V U` of one point, one block and one group: `[tiles, Cin] x [Cin, lanes]`, in one of the direct path's register tiles.
#[inline(always)]
fn multiply<S: Simd>(simd: S, tiles: usize, vectors: usize, v: &[f32], u: &[f32], m: &mut [f32]) {
    let lanes = vectors * S::LANES;
    let cin = u.len() / lanes;
    let args = Tile {
        input: v,
        pixel_step: cin,
        row_step: 0,
        row_len: cin,
        rows: 1,
        weights: u,
        bias: &[],
        relu: false,
        out: m,
        out_step: lanes,
    };
    super::for_tile!(tiles, vectors, args.products, S, simd);
}

/// Where the outputs of a block go.
struct OutputMap<'a> {
    values: &'a mut [f32], // [rows, width, channels]
    width: usize,
    channels: usize,
    first: usize, // channel of the block
}

/// `Y = A^T M A`, bias and floor: the outputs of one tile and one block, as far as they lie within `out`.
#[inline(always)]
#[allow(clippy::too_many_arguments, clippy::needless_range_loop)] // two strided maps; constant indices
fn output_tile<S: Simd, const A: usize, const M: usize>(
    simd: S,
    products: &[f32], // this tile's channels of point 0
    m_step: usize,
    bias: &[f32], // of the block's channels
    floor: f32,
    out: OutputMap<'_>,
    (y, x): (usize, usize),
    half: &mut [[S::F32; M]; A], // A^T M, transposed: [column][row]
) {
    let height = out.values.len() / (out.width * out.channels);
    let (rows, columns) = (M.min(height - y), M.min(out.width - x));
    for c in (0..bias.len()).step_by(S::LANES) {
        let n = S::LANES.min(bias.len() - c);
        for j in 0..A {
            let mut m = [simd.zero(); A];
            for i in 0..A {
                m[i] = simd.load(&products[(i * A + j) * m_step + c..]);
            }
            half[j] = output_values::<S, A, M>(simd, &m);
        }
        let (bias, floor) = (simd.load_partial(&bias[c..]), simd.splat(floor));
        for i in 0..rows {
            let mut m = [simd.zero(); A];
            for j in 0..A {
                m[j] = half[j][i];
            }
            let line = output_values::<S, A, M>(simd, &m);
            for j in 0..columns {
                let value = simd.max(simd.add(line[j], bias), floor);
                let at = ((y + i) * out.width + x + j) * out.channels + out.first + c;
                let to = &mut out.values[at..at + n];
                if n == S::LANES { simd.store(value, to) } else { simd.store_partial(value, to) }
            }
        }
    }
}
