//! Winograd's algorithm where `U` is kept, and read.
//!
//! A thread takes its tiles a strip at a time, and does all three steps for it in its own scratch space, a row of points at a time: its part of
//! `V` stays in the second cache while all output channels pass over it. A block's row of `M` is halfway to outputs as soon as it is
//! multiplied, and never leaves the first cache (`strips.rs`):
//!
//! ```text
//! for each strip of tiles
//!   for each row of tiles: B^T d, then V of its tiles
//!   for each row of points
//!     for each block of 1..=3 channel vectors
//!       M of the row: for each point and group of tiles, sums in registers    <- the direct path's hot loop, from `Groups`
//!       M A of the row
//!   A^T (M A), bias, floor
//! ```
//!
//! `U` lies in the order in which it is read, and the next point's is asked for while one point's is multiplied: what comes from the third cache
//! or from memory is there when it is needed.

use super::super::ConvShape;
use super::super::direct::{add_products, blocks};
use super::points::{MAX_KERNEL, kernel_matrix, output_values};
use super::strips::{Block, Layout, Plan, Strip, Walk};
use super::transforms::{AsIs, HalfOutputs};
use super::{Part, pack, step};
use crate::simd::{Kernel, Simd};
use crate::{Aligned, Isa};

/// Kernels of one layer.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    pub layout: Layout,
    short: bool,     // whether a row of points is multiplied at once
    u: Aligned<f32>, // [row of points][block][a][Cin][vectors of the block * LANES]
}

impl Weights {
    /// From `[Cout, k, k, Cin]`.
    pub(super) fn new(isa: Isa, shape: &ConvShape, points: usize, weights: &[f32]) -> Weights {
        let vectors = shape.out_channels.div_ceil(isa.lanes());
        let (_, most) = isa.long_tile();
        let short = is_short(shape) && points == SHORT_POINTS && most >= SHORT_TILES * SHORT_POINTS;
        let mut layout = Layout::new(isa, shape.in_channels, widths(short, vectors));
        if short {
            layout.group = SHORT_TILES;
        }
        let u = transform_kernels(isa, shape, points, widths(short, vectors), weights);
        Weights { layout, short, u }
    }
}

/// Input channels with which a row of points is multiplied at once: those of an image, folded by a stride of two. A constant number leaves
/// the hot loop nothing to do but products.
const SHORT_CHANNELS: usize = 12;

/// Points of such a row,
const SHORT_POINTS: usize = 10;

/// and tiles of which it is multiplied: as many as 32 registers hold.
const SHORT_TILES: usize = 2;

/// Whether a row of points is multiplied at once where there are registers enough.
pub(in crate::conv) fn is_short(shape: &ConvShape) -> bool {
    shape.in_channels == SHORT_CHANNELS
}

/// Vectors of each block of output channels.
fn widths(short: bool, vectors: usize) -> impl Iterator<Item = usize> + Clone {
    let ones = if short { vectors } else { 0 };
    std::iter::repeat_n(1, ones).chain(blocks(vectors - ones))
}

/// `U` as [`Weights`] keep it for blocks of such `widths`, of kernels `[Cout, k, k, Cin]`.
pub(super) fn transform_kernels(
    isa: Isa,
    shape: &ConvShape,
    points: usize,
    widths: impl Iterator<Item = usize> + Clone,
    weights: &[f32],
) -> Aligned<f32> {
    let vectors = shape.out_channels.div_ceil(isa.lanes());
    let taps = pack(isa, shape, widths.clone(), weights);
    let mut u = Aligned::zeros(points * points * shape.in_channels * vectors * isa.lanes());
    isa.run(TransformKernels {
        shape,
        points,
        widths,
        taps: &taps,
        out: &mut u,
    });
    u
}

/// `U = G g G^T` of all kernels.
struct TransformKernels<'a, W> {
    shape: &'a ConvShape,
    points: usize,
    widths: W,          // of the blocks
    taps: &'a [f32],    // as `pack` lays them
    out: &'a mut [f32], // as `Weights::u`
}

impl<W: Iterator<Item = usize> + Clone> Kernel for TransformKernels<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        match (self.points, self.shape.kernel) {
            (6, 3) => self.run_sized::<S, 6, 3>(simd),
            (8, 3) => self.run_sized::<S, 8, 3>(simd),
            (6, 5) => self.run_sized::<S, 6, 5>(simd),
            (8, 5) => self.run_sized::<S, 8, 5>(simd),
            (10, 5) => self.run_sized::<S, 10, 5>(simd),
            (8, 6) => self.run_sized::<S, 8, 6>(simd),
            (10, 6) => self.run_sized::<S, 10, 6>(simd),
            (points, kernel) => unreachable!("{points} points for a {kernel}x{kernel} kernel"),
        }
    }
}

impl<W: Iterator<Item = usize> + Clone> TransformKernels<'_, W> {
    #[inline(always)]
    fn run_sized<S: Simd, const A: usize, const K: usize>(self, simd: S) {
        let g = &kernel_matrix(K);
        let cin = self.shape.in_channels;
        let vectors = self.shape.out_channels.div_ceil(S::LANES);
        for (i, row) in self
            .out
            .chunks_exact_mut(A * cin * vectors * S::LANES)
            .take(A)
            .enumerate()
        {
            let (mut from, mut to) = (self.taps, row);
            for vectors in self.widths.clone() {
                let step = cin * vectors * S::LANES;
                let (taps, u);
                (taps, from) = from.split_at(K * K * step);
                (u, to) = to.split_at_mut(A * step);
                simd.call(KernelRow::<A, K> { g, i, taps, u });
            }
        }
    }
}

/// Row `i` of the points of `U = G g G^T` for one block.
struct KernelRow<'a, const A: usize, const K: usize> {
    g: &'a [[f32; MAX_KERNEL]; A],
    i: usize,
    taps: &'a [f32],  // [Cin * vectors][k * k][LANES]
    u: &'a mut [f32], // A matrices [Cin, vectors * LANES]
}

impl<const A: usize, const K: usize> Kernel for KernelRow<'_, A, K> {
    type Output = ();

    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // constant indices keep the taps in registers
    fn run<S: Simd>(self, simd: S) {
        let KernelRow { g, i, taps, u } = self;
        let (row, u_step) = (&g[i], u.len() / A);
        for (n, taps) in taps.chunks_exact(K * K * S::LANES).enumerate() {
            let mut line = [simd.zero(); K]; // of G g
            for x in 0..K {
                for y in 0..K {
                    let tap = simd.load(&taps[(y * K + x) * S::LANES..]);
                    line[x] = simd.mul_add(simd.splat(row[y]), tap, line[x]);
                }
            }
            let mut points = [simd.zero(); A];
            points[0] = line[0];
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

impl Kernel for Part<'_, Weights> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        match (self.conv.weights.points, self.conv.weights.shape.kernel) {
            (6, 5) => self.run_sized::<S, 6, 2>(simd),
            (8, 5) => self.run_sized::<S, 8, 4>(simd),
            (10, 5) => self.run_sized::<S, 10, 6>(simd),
            (8, 6) => self.run_sized::<S, 8, 3>(simd),
            (10, 6) => self.run_sized::<S, 10, 5>(simd),
            (points, kernel) => unreachable!("{points} points for a {kernel}x{kernel} kernel"),
        }
    }
}

impl Part<'_, Weights> {
    #[inline(always)]
    fn run_sized<S: Simd, const A: usize, const M: usize>(self, simd: S) {
        let Part {
            conv,
            weights,
            share,
        } = self;
        let shape = &conv.weights.shape;
        let walk = Walk {
            conv,
            share,
            layout: &weights.layout,
            widths: widths(weights.short, shape.out_channels.div_ceil(S::LANES)),
            to: AsIs,
        };
        walk.run::<S, A, M>(
            simd,
            |Block {
                 strip,
                 row,
                 first,
                 vectors,
                 v,
                 m,
                 half,
             }| {
                let Layout {
                    inputs, channels, ..
                } = weights.layout;
                let u = &weights.u[(row * channels + first) * A * inputs..]
                    [..A * inputs * vectors * S::LANES];
                if weights.short {
                    simd.call(ShortProducts::<A, M> { strip, v, u, half });
                } else {
                    simd.call(Products::<A> {
                        strip,
                        vectors,
                        v,
                        u,
                        m: &mut *m,
                    });
                    simd.call(HalfOutputs::<A, M> { m, half });
                }
            },
        );
    }
}

/// `M = V U` of one row of points, one block and the tiles of a strip: for each point `[tiles, Cin] x [Cin, lanes]`.
struct Products<'a, const A: usize> {
    strip: &'a Strip<'a>,
    vectors: usize,   // of the block
    v: &'a [f32],     // of the row's first point and the first group
    u: &'a [f32],     // A times [Cin, vectors * LANES]
    m: &'a mut [f32], // [tiles * vectors][A][LANES]
}

impl<const A: usize> Kernel for Products<'_, A> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Products {
            strip,
            vectors,
            v,
            u,
            m,
        } = self;
        let Plan { v_step, v_len, .. } = *strip.plan;
        for (j, u) in u.chunks_exact(u.len() / A).enumerate() {
            let (v, m) = (&v[j * v_step..], &mut m[j * S::LANES..]);
            let (mut groups, mut vs) = (0, 0); // done so far, and vectors of M
            for (count, tiles) in strip.runs() {
                if count > 0 {
                    let m = &mut m[vs * A * S::LANES..];
                    let some = Groups::<A> {
                        count,
                        v: &v[groups * v_len..],
                        v_len,
                        u,
                        first: groups == 0,
                        m,
                    };
                    super::super::for_tile!(tiles, vectors, some.run, S, simd);
                    (groups, vs) = (groups + count, vs + count * tiles * vectors);
                }
            }
        }
    }
}

/// The same for groups of the same size.
struct Groups<'a, const A: usize> {
    count: usize,
    v: &'a [f32],
    v_len: usize,
    u: &'a [f32],
    first: bool, // whether the next point's U is still to be asked for
    m: &'a mut [f32],
}

impl<const A: usize> Groups<'_, A> {
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // constant indices keep the sums in registers
    fn run<S: Simd, const TILES: usize, const VECTORS: usize>(self, simd: S) {
        if TILES > S::TILE_PIXELS[VECTORS] {
            unreachable!("more than the registers hold");
        }
        let cin = self.u.len() / (VECTORS * S::LANES);
        let step = A * S::LANES; // between the vectors of M
        for group in 0..self.count {
            let v = &self.v[group * self.v_len..][..TILES * cin];
            let m = &mut self.m[group * TILES * VECTORS * step..]
                [..(TILES * VECTORS - 1) * step + S::LANES];
            let mut tiles = [&v[..0]; TILES];
            for i in 0..TILES {
                tiles[i] = &v[i * cin..][..cin];
            }
            let mut sums = [[simd.zero(); VECTORS]; TILES];
            if group == 0 && self.first {
                add_products::<S, TILES, VECTORS, true>(simd, tiles, cin, self.u, &mut sums);
            } else {
                add_products::<S, TILES, VECTORS, false>(simd, tiles, cin, self.u, &mut sums);
            }
            for i in 0..TILES {
                for k in 0..VECTORS {
                    simd.store(sums[i][k], &mut m[(i * VECTORS + k) * step..]);
                }
            }
        }
    }
}

/// `M A` of one row of points, one vector of output channels and the tiles of a strip, where there are few input channels: all points are
/// multiplied at once, and what is written is half an output already, not `M`.
struct ShortProducts<'a, const A: usize, const M: usize> {
    strip: &'a Strip<'a>,
    v: &'a [f32],        // of the row's first point and the first group
    u: &'a [f32],        // [A][Cin][LANES]
    half: &'a mut [f32], // [tiles][M][LANES]
}

impl<const A: usize, const M: usize> Kernel for ShortProducts<'_, A, M> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let ShortProducts { strip, v, u, half } = self;
        let (mut groups, mut half) = (v.chunks(strip.plan.v_len), half);
        for (count, tiles) in strip.runs() {
            for v in groups.by_ref().take(count) {
                let some;
                (some, half) = std::mem::take(&mut half).split_at_mut(tiles * M * S::LANES);
                let group = ShortGroup::<A, M> { v, u, half: some };
                match tiles {
                    1 => group.run::<S, 1>(simd),
                    _ => group.run::<S, SHORT_TILES>(simd),
                }
            }
        }
    }
}

/// The same for one group.
struct ShortGroup<'a, const A: usize, const M: usize> {
    v: &'a [f32],
    u: &'a [f32],
    half: &'a mut [f32],
}

impl<const A: usize, const M: usize> ShortGroup<'_, A, M> {
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // constant indices keep the sums in registers
    fn run<S: Simd, const TILES: usize>(self, simd: S) {
        if SHORT_TILES * A > S::LONG_TILE.1 {
            unreachable!("more than the registers hold");
        }
        let v_step = step(SHORT_TILES * SHORT_CHANNELS);
        let v = &self.v[..(A - 1) * v_step + TILES * SHORT_CHANNELS];
        let u = &self.u[..A * SHORT_CHANNELS * S::LANES];
        let mut sums = [[simd.zero(); A]; TILES];
        for c in 0..SHORT_CHANNELS {
            for j in 0..A {
                let u = simd.load(&u[(j * SHORT_CHANNELS + c) * S::LANES..]);
                for i in 0..TILES {
                    let x = simd.splat(v[j * v_step + i * SHORT_CHANNELS + c]);
                    sums[i][j] = simd.mul_add(x, u, sums[i][j]);
                }
            }
        }
        let half = &mut self.half[..TILES * M * S::LANES];
        for i in 0..TILES {
            let line = output_values::<S, A, M>(simd, &sums[i]);
            for j in 0..M {
                simd.store(line[j], &mut half[(i * M + j) * S::LANES..]);
            }
        }
    }
}
