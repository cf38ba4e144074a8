//! Convolution with fewer multiplications: Winograd's F(m x m, k x k), for stride 1.
//!
//! An `m x m` tile of outputs depends on an `a x a` tile of inputs, `a = m + k - 1`. Both and the kernel are polynomials
//! that are multiplied at `a` points (0, 1, -1, 2, -2, 1/2, -1/2, infinity), where a product costs one multiplication per point:
//!
//! ```text
//! V = B^T d B              input tile, per input channel              additions
//! M = sum over i of U V    a x a matrix products [tiles, Cin] x [Cin, Cout]   all the multiplications
//! Y = A^T M A              output tile, per output channel            additions
//! U = G g G^T              kernels, once
//! ```
//!
//! For `k = 3`, `a = 6` needs `36 / 16` multiplications per output instead of 9: 4 times fewer; `a = 8` 5.1 times fewer, at a
//! larger rounding error and with more waste at the border. For `k = 5`, `a = 8` needs `64 / 16` instead of 25.
//! Source: Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016.
//!
//! A thread takes some rows of tiles, a strip at a time, and does all three steps for it in its own scratch space: small
//! enough for the cache, large enough that the kernels `U`, which each strip reads anew, are worth the way.

use super::ConvShape;
use super::direct::{Tile, blocks, pack};
use crate::simd::{Kernel, Simd};
use crate::{Isa, Size};

/// Kernels in the transformed domain: `[a * a][block][Cin][vectors of the block * LANES]`.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    points: usize, // a
    data: Vec<f32>,
}

/// Whether `points` fit a kernel: 6 or 8 points, a kernel of 3 or 5, stride 1.
pub(super) fn fits(shape: &ConvShape, points: usize) -> bool {
    [6, 8].contains(&points) && shape.stride == 1 && [3, 5].contains(&shape.kernel)
}

/// The finite points, in pairs of opposite sign behind 0.
pub const POINTS: [f64; 7] = [0.0, 1.0, -1.0, 2.0, -2.0, 0.5, -0.5];

/// Row `i` of `G`: the kernel's value at point `i`, scaled so that `B` has small numbers.
pub fn kernel_row(points: usize, kernel: usize, i: usize) -> [f32; 5] {
    let mut row = [0.0; 5];
    if i == points - 1 {
        row[kernel - 1] = 1.0;
        return row;
    }
    let scale = if points == 6 {
        [1.0 / 4.0, -1.0 / 6.0, -1.0 / 6.0, 1.0 / 24.0, 1.0 / 24.0, 0.0, 0.0][i]
    } else {
        [1.0, -2.0 / 9.0, -2.0 / 9.0, 1.0 / 90.0, 1.0 / 90.0, 32.0 / 45.0, 32.0 / 45.0][i]
    };
    for (j, value) in row[..kernel].iter_mut().enumerate() {
        *value = (scale * POINTS[i].powi(j as i32)) as f32;
    }
    row
}

impl Weights {
    /// From `[Cout, k, k, Cin]`.
    pub(super) fn new(isa: Isa, shape: &ConvShape, points: usize, weights: &[f32]) -> Weights {
        let mut packed = Vec::new();
        pack(isa, shape.out_channels, shape.window(), weights, &mut packed);
        let size = points * points * packed.len() / (shape.kernel * shape.kernel);
        let mut data = vec![0.0; size];
        isa.run(TransformKernels { shape, points, packed: &packed, out: &mut data });
        Weights { points, data }
    }

    pub(super) fn points(&self) -> usize {
        self.points
    }
}

/// `U = G g G^T`, vectors of output channels at a time: training does this at every step.
struct TransformKernels<'a> {
    shape: &'a ConvShape,
    points: usize,
    packed: &'a [f32],  // [block][k * k * Cin][vectors of the block * LANES]
    out: &'a mut [f32], // as in `Weights`
}

impl Kernel for TransformKernels<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        match (self.points, self.shape.kernel) {
            (6, 3) => self.run_sized::<S, 6, 3>(simd),
            (8, 3) => self.run_sized::<S, 8, 3>(simd),
            (6, 5) => self.run_sized::<S, 6, 5>(simd),
            (8, 5) => self.run_sized::<S, 8, 5>(simd),
            (points, kernel) => unreachable!("{points} points for a {kernel}x{kernel} kernel"),
        }
    }
}

impl TransformKernels<'_> {
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // two matrices and their product
    fn run_sized<S: Simd, const A: usize, const K: usize>(self, simd: S) {
        let cin = self.shape.in_channels;
        let mut g = [[0.0; 5]; A];
        for (i, row) in g.iter_mut().enumerate() {
            *row = kernel_row(A, K, i);
        }
        let point_step = self.packed.len() / (K * K);
        let (mut from, mut first) = (self.packed, 0);
        for vectors in blocks(self.shape.out_channels.div_ceil(S::LANES)) {
            let width = vectors * S::LANES;
            let block;
            (block, from) = from.split_at(K * K * cin * width);
            for at in (0..cin * width).step_by(S::LANES) {
                let mut half = [[simd.zero(); K]; A]; // G g
                for x in 0..K {
                    for y in 0..K {
                        let tap = simd.load(&block[(y * K + x) * cin * width + at..]);
                        for i in 0..A {
                            half[i][x] = simd.mul_add(simd.splat(g[i][y]), tap, half[i][x]);
                        }
                    }
                }
                for i in 0..A {
                    for j in 0..A {
                        let mut value = simd.zero();
                        for x in 0..K {
                            value = simd.mul_add(simd.splat(g[j][x]), half[i][x], value);
                        }
                        simd.store(value, &mut self.out[(i * A + j) * point_step + first + at..]);
                    }
                }
            }
            first += cin * width;
        }
    }
}

/// Tiles that one strip takes, if a row of tiles is not longer.
const STRIP_TILES: usize = 64;

/// How a map is cut into tiles.
struct Plan {
    points: usize, // a
    across: usize, // tiles in a row
    strip: usize,  // rows of tiles in a strip
    v_step: usize, // from one point's V to the next one's
    m_step: usize, // from one point's M to the next one's
}

impl Plan {
    fn new(shape: &ConvShape, points: usize, out: Size) -> Plan {
        let m = points + 1 - shape.kernel;
        let across = out.w.div_ceil(m);
        let strip = (STRIP_TILES / across).clamp(1, out.h.div_ceil(m));
        // One cache line more than a full strip, lest the points' lines fall on each other in the cache.
        let step = |channels: usize| (strip * across * channels).next_multiple_of(16) + 16;
        Plan { points, across, strip, v_step: step(shape.in_channels), m_step: step(shape.out_channels) }
    }

    fn scratch_len(&self) -> usize {
        self.points * self.points * (self.v_step + self.m_step)
    }
}

/// Output rows of one row of tiles: threads split the map at multiples of it.
pub(super) fn rows_per_tile(shape: &ConvShape, points: usize) -> usize {
    points + 1 - shape.kernel
}

/// Scratch values per thread.
pub(super) fn scratch_len(shape: &ConvShape, points: usize, size: Size) -> usize {
    Plan::new(shape, points, shape.out_size(size)).scratch_len()
}

/// Some rows of one convolution without padding.
pub(super) struct Winograd<'a> {
    pub shape: &'a ConvShape,
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
        match (self.weights.points, self.shape.kernel) {
            (6, 3) => self.run_sized::<S, 6, 4>(simd),
            (8, 3) => self.run_sized::<S, 8, 6>(simd),
            (6, 5) => self.run_sized::<S, 6, 2>(simd),
            (8, 5) => self.run_sized::<S, 8, 4>(simd),
            (points, kernel) => unreachable!("{points} points for a {kernel}x{kernel} kernel"),
        }
    }
}

impl Winograd<'_> {
    #[inline(always)]
    fn run_sized<S: Simd, const A: usize, const M: usize>(self, simd: S) {
        let Winograd { shape, weights, bias, input, size, first_row, out, scratch } = self;
        let width = size.w + 1 - shape.kernel;
        let (cin, cout) = (shape.in_channels, shape.out_channels);
        let plan = Plan::new(shape, A, Size { h: size.h + 1 - shape.kernel, w: width });
        let (v, products) = scratch.split_at_mut(A * A * plan.v_step);
        let products = &mut products[..A * A * plan.m_step];
        let floor = if shape.relu { 0.0 } else { f32::NEG_INFINITY };
        for (i, out) in out.chunks_mut(plan.strip * M * width * cout).enumerate() {
            let top = first_row + i * plan.strip * M;
            let rows = (out.len() / (width * cout)).div_ceil(M);
            let tiles = rows * plan.across;
            for tile in 0..tiles {
                let (y, x) = (top + tile / plan.across * M, tile % plan.across * M);
                input_tile::<S, A>(simd, input, size, cin, (y, x), &mut v[tile * cin..], plan.v_step);
            }
            multiply(simd, A * A, tiles, cin, cout, v, plan.v_step, &weights.data, products, plan.m_step);
            for tile in 0..tiles {
                let (y, x) = (tile / plan.across * M, tile % plan.across * M);
                let from = &products[tile * cout..];
                output_tile::<S, A, M>(simd, from, plan.m_step, bias, floor, out, width, (y, x));
            }
        }
    }
}

/// `V = B^T d B` of the input tile whose corner is `(y, x)`; inputs beyond the map count as 0.
///
/// `v` starts with this tile's channels of point 0; the next point's are `v_step` further on.
#[inline(always)]
pub fn input_tile<S: Simd, const A: usize>(
    simd: S,
    input: &[f32],
    size: Size,
    channels: usize,
    (y, x): (usize, usize),
    v: &mut [f32], // this tile's channels of point 0
    v_step: usize,
) {
    let (rows, columns) = (A.min(size.h - y), A.min(size.w - x));
    for c in (0..channels).step_by(S::LANES) {
        let n = S::LANES.min(channels - c);
        let mut half = [[simd.zero(); A]; A]; // B^T d, transposed: [column][row]
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

/// `B^T d` for one line of inputs.
#[inline(always)]
fn input_points<S: Simd, const A: usize>(simd: S, d: &[S::F32; A]) -> [S::F32; A] {
    let (add, sub) = (|a, b| simd.add(a, b), |a, b| simd.sub(a, b));
    let scale_add = |k: f32, a, b| simd.mul_add(simd.splat(k), a, b); // k a + b
    let mut t = [simd.zero(); A];
    if A == 6 {
        t[0] = scale_add(4.0, d[0], scale_add(-5.0, d[2], d[4]));
        let (even, odd) = (scale_add(-4.0, d[2], d[4]), scale_add(-4.0, d[1], d[3]));
        (t[1], t[2]) = (add(even, odd), sub(even, odd));
        let (even, odd) = (sub(d[4], d[2]), sub(d[3], d[1]));
        (t[3], t[4]) = (scale_add(2.0, odd, even), scale_add(-2.0, odd, even));
        t[5] = scale_add(4.0, d[1], scale_add(-5.0, d[3], d[5]));
    } else {
        t[0] = scale_add(5.25, sub(d[4], d[2]), sub(d[0], d[6]));
        let even = scale_add(-4.25, d[4], add(d[2], d[6]));
        let odd = scale_add(-4.25, d[3], add(d[1], d[5]));
        (t[1], t[2]) = (add(even, odd), sub(even, odd));
        let even = scale_add(0.25, d[2], scale_add(-1.25, d[4], d[6]));
        let odd = scale_add(0.5, d[1], scale_add(-2.5, d[3], add(d[5], d[5])));
        (t[3], t[4]) = (add(even, odd), sub(even, odd));
        let even = scale_add(4.0, d[2], scale_add(-5.0, d[4], d[6]));
        let odd = scale_add(2.0, d[1], scale_add(-2.5, d[3], scale_add(0.5, d[5], simd.zero())));
        (t[5], t[6]) = (add(even, odd), sub(even, odd));
        t[7] = scale_add(5.25, sub(d[3], d[5]), sub(d[7], d[1]));
    }
    t
}

/// `M[p] = V[p] U[p]` for every point `p`: `[tiles, Cin] x [Cin, Cout]`, in the direct path's register tiles.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // three strided matrices
fn multiply<S: Simd>(
    simd: S,
    points: usize,
    tiles: usize,
    cin: usize,
    cout: usize,
    v: &[f32],
    v_step: usize,
    u: &[f32],
    products: &mut [f32],
    m_step: usize,
) {
    let vectors = cout.div_ceil(S::LANES);
    let u_step = vectors * S::LANES * cin;
    for p in 0..points {
        let (v, products) = (&v[p * v_step..], &mut products[p * m_step..][..tiles * cout]);
        let mut packed = &u[p * u_step..][..u_step];
        let mut first = 0;
        for vectors in blocks(vectors) {
            let block;
            (block, packed) = packed.split_at(cin * vectors * S::LANES);
            let used = (cout - first).min(vectors * S::LANES);
            let groups = tiles.div_ceil(S::TILE_PIXELS[vectors]);
            let mut tile = 0;
            for i in 0..groups {
                let pixels = tiles / groups + usize::from(i < tiles % groups);
                let args = Tile {
                    input: &v[tile * cin..],
                    pixel_step: cin,
                    row_step: 0,
                    row_len: cin,
                    rows: 1,
                    weights: block,
                    bias: &ZEROS[..used],
                    relu: false,
                    out: &mut products[tile * cout + first..],
                    out_step: cout,
                };
                super::for_tile!(pixels, vectors, args.run, S, simd);
                tile += pixels;
            }
            first += used;
        }
    }
}

/// A bias of nothing, for as many channels as a block can have.
static ZEROS: [f32; 48] = [0.0; 48];

/// `Y = A^T M A`, bias and floor: the outputs of one tile, as far as they lie within `out`.
#[inline(always)]
#[allow(clippy::too_many_arguments)] // two strided maps
fn output_tile<S: Simd, const A: usize, const M: usize>(
    simd: S,
    products: &[f32], // this tile's channels of point 0
    m_step: usize,
    bias: &[f32],
    floor: f32,
    out: &mut [f32],
    width: usize,
    (y, x): (usize, usize),
) {
    let channels = bias.len();
    let height = out.len() / (width * channels);
    let (rows, columns) = (M.min(height - y), M.min(width - x));
    for c in (0..channels).step_by(S::LANES) {
        let n = S::LANES.min(channels - c);
        let load = |from: &[f32]| if n == S::LANES { simd.load(from) } else { simd.load_partial(&from[..n]) };
        let mut half = [[simd.zero(); M]; A]; // A^T M, transposed: [column][row]
        for j in 0..A {
            let mut m = [simd.zero(); A];
            for i in 0..A {
                m[i] = load(&products[(i * A + j) * m_step + c..]);
            }
            half[j] = output_values::<S, A, M>(simd, &m);
        }
        let (bias, floor) = (load(&bias[c..]), simd.splat(floor));
        for i in 0..rows {
            let mut m = [simd.zero(); A];
            for j in 0..A {
                m[j] = half[j][i];
            }
            let line = output_values::<S, A, M>(simd, &m);
            for j in 0..columns {
                let value = simd.max(simd.add(line[j], bias), floor);
                let to = &mut out[((y + i) * width + x + j) * channels + c..][..n];
                if n == S::LANES { simd.store(value, to) } else { simd.store_partial(value, to) }
            }
        }
    }
}

/// `A^T m` for one line of products: `y[j] = sum over points of point^j m`.
#[inline(always)]
fn output_values<S: Simd, const A: usize, const M: usize>(simd: S, m: &[S::F32; A]) -> [S::F32; M] {
    let mut y = [simd.zero(); M];
    let mut even = [simd.zero(); 3];
    let mut odd = [simd.zero(); 3];
    for p in 0..(A - 2) / 2 {
        even[p] = simd.add(m[1 + 2 * p], m[2 + 2 * p]);
        odd[p] = simd.sub(m[1 + 2 * p], m[2 + 2 * p]);
    }
    for (j, y) in y.iter_mut().enumerate() {
        let pairs = if j % 2 == 0 { even } else { odd };
        let mut value = if j == 0 { m[0] } else { simd.zero() };
        if j == M - 1 {
            value = simd.add(value, m[A - 1]);
        }
        for p in 0..(A - 2) / 2 {
            let power = [1.0f32, 2.0, 0.5][p].powi(j as i32);
            value = simd.mul_add(simd.splat(power), pairs[p], value);
        }
        *y = value;
    }
    y
}
