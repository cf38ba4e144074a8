//! Winograd's algorithm with a stored `U`: 5x5 kernels, and the first layer's 6x6.
//!
//! A thread takes its tiles one strip at a time, and does all steps of a strip in its own scratch
//! space. Its part of `V` stays in the L2 cache while all output channels pass over it
//! (`strips.rs`):
//!
//! ```text
//! for each strip of tiles
//!   V of all its tiles
//!   for each row of points
//!     for each block of 1..=3 channel vectors
//!       for each point of the row              `Products`
//!         for each group of tiles: M = V U     <- the hot loop, `add_products` of the direct path
//!       M A of the row                         `HalfOutputs`
//!   Y = A^T (M A), bias, ReLU
//! ```
//!
//! Shapes: those of `mod.rs`, for `k = 5` and `k = 6`. Cost: the products, plus one read of `U` per
//! strip.
//!
//! The tricks:
//!
//! - Half of the output transform follows each row of points at once: a block's row of `M` never
//!   leaves the L1 cache.
//! - `U` lies in the order in which it is read. While one point's `U` is multiplied, the next
//!   point's is prefetched, so that memory is never waited for.
//! - With few input channels all points of a row are multiplied in registers, and `M` is not
//!   written at all (`ShortProducts`).

use super::super::ConvShape;
use super::super::direct::{add_products, blocks};
use super::points::{MAX_KERNEL, kernel_row, output_values};
use super::strips::{Block, KernelLayout, Strip, StripPlan, StripWalk};
use super::transforms::{AsIs, HalfOutputs};
use super::{ThreadPart, TileTask, pack, run_stored, step};
use crate::simd::{Kernel, Simd};
use crate::{Aligned, Isa};

/// `U` of one layer.
#[derive(Clone, Debug)]
pub(super) struct StoredKernels {
    pub layout: KernelLayout,
    short: bool,     // whether a row of points is multiplied in registers
    u: Aligned<f32>, // [row of points][block][a][Cin][vectors of the block * LANES]
}

impl StoredKernels {
    /// Transforms `weights` (`[Cout, k, k, Cin]`).
    pub(super) fn new(
        isa: Isa,
        shape: &ConvShape,
        points: usize,
        weights: &[f32],
    ) -> StoredKernels {
        let vectors = shape.out_channels.div_ceil(isa.lanes());
        let (_, most) = isa.long_tile();
        let short = is_short(shape) && points == SHORT_POINTS && most >= SHORT_TILES * SHORT_POINTS;
        let mut layout = KernelLayout::new(isa, shape.in_channels, widths(short, vectors));
        if short {
            layout.group = SHORT_TILES;
        }
        let u = transform_kernels(isa, shape, points, widths(short, vectors), weights);
        StoredKernels { layout, short, u }
    }
}

/// Input channels of a short product: an image's three, folded by a stride of two. As a constant it
/// leaves the hot loop nothing but products.
const SHORT_CHANNELS: usize = 12;

/// Points of a row of a short product.
const SHORT_POINTS: usize = 10;

/// Tiles of a short product: their sums just fit 32 registers.
const SHORT_TILES: usize = 2;

/// Whether a layer's products are short, where there are registers enough.
pub(in crate::conv) fn is_short(shape: &ConvShape) -> bool {
    shape.in_channels == SHORT_CHANNELS
}

/// Vectors of each block of output channels.
fn widths(short: bool, vectors: usize) -> impl Iterator<Item = usize> + Clone {
    let ones = if short { vectors } else { 0 };
    std::iter::repeat_n(1, ones).chain(blocks(vectors - ones))
}

/// `U = G g G^T` of kernels `[Cout, k, k, Cin]`, laid out as [`StoredKernels`] with blocks of these
/// `widths`.
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
    taps: &'a [f32],    // as `pack` lays them out
    out: &'a mut [f32], // as `StoredKernels::u`
}

impl<W: Iterator<Item = usize> + Clone> Kernel for TransformKernels<'_, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let (a, k, cin) = (self.points, self.shape.kernel, self.shape.in_channels);
        let g: Vec<[f32; MAX_KERNEL]> = (0..a).map(|i| kernel_row(a, k, i)).collect();
        let vectors = self.shape.out_channels.div_ceil(S::LANES);
        for (i, row) in self
            .out
            .chunks_exact_mut(a * cin * vectors * S::LANES)
            .enumerate()
        {
            let (mut from, mut to) = (self.taps, row);
            for vectors in self.widths.clone() {
                let step = cin * vectors * S::LANES;
                let (taps, u);
                (taps, from) = from.split_at(k * k * step);
                (u, to) = to.split_at_mut(a * step);
                let kernels = taps.chunks_exact(k * k * S::LANES);
                for (n, taps) in kernels.enumerate() {
                    kernel_points(simd, &g, i, k, taps, &mut u[n * S::LANES..], step);
                }
            }
        }
    }
}

/// Row `i` of the points of `U = G g G^T` for one vector of kernels (`taps`: `[k * k][LANES]`), to
/// every `u_step`-th value of `u`.
///
/// This runs once per layer, when a model is loaded: sizes are variables here, and code is small.
#[inline(always)]
fn kernel_points<S: Simd>(
    simd: S,
    g: &[[f32; MAX_KERNEL]],
    i: usize,
    k: usize,
    taps: &[f32],
    u: &mut [f32],
    u_step: usize,
) {
    let mut line = [simd.zero(); MAX_KERNEL]; // row i of G g
    for (x, sum) in line[..k].iter_mut().enumerate() {
        for (y, value) in g[i][..k].iter().enumerate() {
            let tap = simd.load(&taps[(y * k + x) * S::LANES..]);
            *sum = simd.mul_add(simd.splat(*value), tap, *sum);
        }
    }
    // (G g) G^T: at 0 the first value, at infinity the last one, and between them each point with
    // both signs.
    let last = g.len() - 1;
    simd.store(line[0], u);
    for j in (1..last).step_by(2) {
        let (mut even, mut odd) = (simd.zero(), simd.zero()); // powers of the point
        for (x, value) in line[..k].iter().enumerate() {
            let sum = if x % 2 == 0 { &mut even } else { &mut odd };
            *sum = simd.mul_add(simd.splat(g[j][x]), *value, *sum);
        }
        simd.store(simd.add(even, odd), &mut u[j * u_step..]);
        simd.store(simd.sub(even, odd), &mut u[(j + 1) * u_step..]);
    }
    simd.store(line[k - 1], &mut u[last * u_step..]);
}

impl Kernel for ThreadPart<'_, StoredKernels> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let (points, kernel) = (self.conv.kernels.points, self.conv.kernels.shape.kernel);
        run_stored(points, kernel, (self, simd));
    }
}

impl<S: Simd> TileTask for (ThreadPart<'_, StoredKernels>, S) {
    #[inline(always)]
    fn run<const A: usize, const M: usize>(self) {
        let (part, simd) = self;
        let ThreadPart {
            conv,
            kernels,
            tiles,
        } = part;
        let shape = &conv.kernels.shape;
        let walk = StripWalk {
            conv,
            tiles,
            layout: &kernels.layout,
            widths: widths(kernels.short, shape.out_channels.div_ceil(S::LANES)),
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
                let KernelLayout {
                    inputs, channels, ..
                } = kernels.layout;
                let u = &kernels.u[(row * channels + first) * A * inputs..]
                    [..A * inputs * vectors * S::LANES];
                // The constant condition leaves short products uncompiled where registers are too
                // few.
                if const { SHORT_TILES * A <= S::LONG_TILE.1 } && kernels.short {
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

/// `M = V U` for one row of points, one block, and the tiles of a strip: per point
/// `[tiles, Cin] x [Cin, lanes]`.
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
        let StripPlan { v_step, v_len, .. } = *strip.plan;
        for (j, u) in u.chunks_exact(u.len() / A).enumerate() {
            let (v, m) = (&v[j * v_step..], &mut m[j * S::LANES..]);
            // A point's U stays in the L1 cache while all groups of tiles pass over it.
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
                    super::super::for_tile!(tiles, vectors, some.run, S, simd, S::TILE_PIXELS);
                    (groups, vs) = (groups + count, vs + count * tiles * vectors);
                }
            }
        }
    }
}

/// `M = V U` for one point and some groups of equal size.
struct Groups<'a, const A: usize> {
    count: usize,
    v: &'a [f32],
    v_len: usize,
    u: &'a [f32],
    first: bool, // whether these are the first groups, which prefetch the next point's U
    m: &'a mut [f32],
}

impl<const A: usize> Groups<'_, A> {
    /// The hot loop, `add_products`, once per group: a register tile of `TILES` tiles x `VECTORS`
    /// channel vectors.
    #[inline(always)]
    fn run<S: Simd, const TILES: usize, const VECTORS: usize>(self, simd: S) {
        let cin = self.u.len() / (VECTORS * S::LANES);
        // A constant: stores at variable places would keep the sums in memory, in the hot loop too.
        let step = const { A * S::LANES };
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

/// `M A` for one row of points, one vector of output channels, and the tiles of a strip, with few
/// input channels.
///
/// All points of the row are multiplied at once, so that half of the output transform happens in
/// registers.
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

/// One group of tiles of [`ShortProducts`].
struct ShortGroup<'a, const A: usize, const M: usize> {
    v: &'a [f32],
    u: &'a [f32],
    half: &'a mut [f32],
}

impl<const A: usize, const M: usize> ShortGroup<'_, A, M> {
    /// The hot loop.
    ///
    /// ```text
    /// for each of the 12 input channels
    ///   for each of the A points
    ///     u = load of the channel's and point's U
    ///     sums[tile][point] += V[tile][point][channel] * u      for both tiles
    /// half = sums A
    /// ```
    #[inline(always)]
    fn run<S: Simd, const TILES: usize>(self, simd: S) {
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
