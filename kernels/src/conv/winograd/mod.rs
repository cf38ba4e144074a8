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
//! A thread takes its tiles a strip at a time, and does all three steps for it in its own scratch space, a row of points at a time: its part of
//! `V` stays in the second cache while all output channels pass over it. A block's row of `M` is halfway to outputs as soon as it is
//! multiplied, and never leaves the first cache:
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
//! `U` is `a * a / (k * k)` times as large as the kernels. For `k = 3` that is up to 7 times, and on the small maps where such
//! kernels stand reading it from memory would take longer than multiplying with it: there `U` is made anew where it is used, a row of
//! points at a time.

mod points;
mod transforms;

use super::direct::{add_products, blocks};
use super::{ConvShape, fold};
use crate::simd::{Kernel, Line, Simd};
use crate::{Isa, Size};
use points::kernel_matrix;
pub use points::{MAX_KERNEL, kernel_row, pairs};
use std::ops::Range;
use transforms::{HalfOutputs, InputTiles, KernelRow, OutputTiles};
pub use transforms::{Lines, lines_len};

/// Kernels of one layer.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    shape: ConvShape, // without stride
    points: usize,    // a
    channels: usize,  // Cout, in whole vectors
    lanes: usize,     // of the widest block
    group: usize,     // most tiles that are multiplied at a time
    kernels: Kernels,
}

/// Values from the start of a cache line on: no vector lies across two.
#[derive(Clone, Debug)]
enum Kernels {
    /// `g`: `[block][Cin][vectors of the block][k * k][LANES]`.
    Taps(Vec<Line>),
    /// `U`: `[block][a * a][Cin][vectors of the block * LANES]`.
    Points(Vec<Line>),
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
            let mut lines = vec![Line::ZERO; taps.len().div_ceil(LINE)];
            bytemuck::cast_slice_mut(&mut lines)[..taps.len()].copy_from_slice(&taps);
            Kernels::Taps(lines)
        } else {
            let len = taps.len() / (inner.kernel * inner.kernel) * points * points;
            let mut lines = vec![Line::ZERO; len.div_ceil(LINE)];
            let out = bytemuck::cast_slice_mut(&mut lines);
            isa.run(TransformKernels { shape: &inner, points, taps: &taps, out });
            Kernels::Points(lines)
        };
        let widest = blocks(inner.out_channels.div_ceil(isa.lanes())).max().unwrap_or(0);
        Weights {
            shape: inner,
            points,
            channels: inner.out_channels.next_multiple_of(isa.lanes()),
            lanes: widest * isa.lanes(),
            group: isa.tile_pixels(widest),
            kernels,
        }
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
                simd.call(KernelRow::<A, K> { g: &g, i, taps, u: row, u_step: step });
            }
        }
    }
}

/// Most tiles in a strip where `U` is made anew for every strip.
const STRIP_TILES: usize = 64;

/// Values of `V` and `M A` in a strip where `U` is read: so many, or this share of those of `U`. Smaller strips read `U` more often; of larger
/// ones less is still in the caches when it is needed again.
const STRIP_VALUES: usize = 256 << 10;
const STRIP_SHARE: usize = 4;

/// Values in a cache line.
const LINE: usize = size_of::<Line>() / size_of::<f32>();

/// From the start of one run of `values` to that of the next: one cache line more than needed, lest the runs' lines fall on each other in the
/// cache.
#[inline(always)]
fn step(values: usize) -> usize {
    values.next_multiple_of(LINE) + LINE
}

/// How a map is cut into tiles, and the scratch space for a strip of them.
///
/// `V` lies group by group (as many tiles as a register tile takes), in a group point by point: its transform, which
/// touches all points of a tile, stays within few pages of memory.
struct Plan {
    across: usize,    // tiles in a row
    strip: usize,     // most tiles in a strip
    lines_len: usize, // B^T d of a row of tiles
    group: usize,     // most tiles in a group
    v_step: usize,    // from one point's V to the next one's, within a group
    v_len: usize,     // from one group's V to the next one's
    u_step: usize,    // from one point's U to the next one's, where a row of it is made anew
    m_len: usize,     // a row of M
    half_step: usize, // from one row of points of M A to the next
}

impl Plan {
    fn new(weights: &Weights, out: Size) -> Plan {
        let Weights { shape, points, channels, lanes, group, kernels } = weights;
        let m = rows_per_tile(shape, *points);
        let (across, down) = (out.w.div_ceil(m), out.h.div_ceil(m));
        let anew = matches!(kernels, Kernels::Taps(_));
        let values = points * (points * shape.in_channels + m * channels); // of V and M A, per tile
        let u_values = points * points * shape.in_channels * channels;
        let most = if anew { STRIP_TILES } else { STRIP_VALUES.max(u_values / STRIP_SHARE) / values };
        let strips = (across * down).div_ceil(most.max(*group));
        let strip = (across * down).div_ceil(strips);
        let strip = if strips > 1 { strip.next_multiple_of(*group) } else { strip };
        let v_step = step(group * shape.in_channels);
        Plan {
            across,
            strip,
            lines_len: lines_len(*points, (across - 1) * m + points, shape.in_channels),
            group: *group,
            v_step,
            v_len: points * points * v_step,
            u_step: if anew { step(shape.in_channels * lanes) } else { 0 },
            m_len: points * strip * lanes,
            half_step: step(m * strip * channels),
        }
    }

    /// Values on the way to `V`, of `V`, of a row of `U` that is made anew, of a row of `M`, and of `M A`.
    fn lens(&self, points: usize) -> [usize; 5] {
        [
            self.lines_len,
            self.strip.div_ceil(self.group) * self.v_len,
            points * self.u_step,
            self.m_len,
            points * self.half_step,
        ]
    }

    /// The corner of a tile of `m x m` outputs.
    #[inline(always)]
    fn corner(&self, tile: usize, m: usize) -> (usize, usize) {
        (tile / self.across * m, tile % self.across * m)
    }
}

/// Some tiles, counted along the rows from a thread's first.
struct Strip<'a> {
    plan: &'a Plan,
    tiles: Range<usize>,
}

impl Strip<'_> {
    /// The groups as two runs of equal ones, the larger first: how many there are, and of how many tiles each.
    #[inline(always)]
    fn runs(&self) -> [(usize, usize); 2] {
        let groups = self.tiles.len().div_ceil(self.plan.group);
        let (tiles, larger) = (self.tiles.len() / groups, self.tiles.len() % groups);
        [(larger, tiles + 1), (groups - larger, tiles)]
    }

    /// How many tiles each group has.
    #[inline(always)]
    fn groups(&self) -> impl Iterator<Item = usize> {
        self.runs().into_iter().flat_map(|(groups, tiles)| std::iter::repeat_n(tiles, groups))
    }
}

/// Output rows of one row of tiles: threads split the map at multiples of it.
pub(super) fn rows_per_tile(shape: &ConvShape, points: usize) -> usize {
    points + 1 - shape.kernel
}

/// Scratch values per thread.
pub(super) fn scratch_len(weights: &Weights, out: Size) -> usize {
    LINE + Plan::new(weights, out).lens(weights.points).iter().sum::<usize>()
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
        let ConvShape { in_channels: cin, out_channels: cout, relu, .. } = weights.shape;
        let width = size.w + 1 - K;
        let plan = &Plan::new(weights, Size { h: size.h + 1 - K, w: width });
        let [lines_len, v_len, u_len, m_len, _] = plan.lens(A);
        // From the start of a cache line on, so that no vector of U, M or M A lies across two.
        let start = scratch.as_ptr().align_offset(align_of::<Line>()).min(LINE);
        let (lines, scratch) = scratch[start..].split_at_mut(lines_len);
        let (v, scratch) = scratch.split_at_mut(v_len);
        let (u, scratch) = scratch.split_at_mut(u_len);
        let (m, half) = scratch.split_at_mut(m_len);
        let g = &kernel_matrix(K);
        let all = (out.len() / (width * cout)).div_ceil(M) * plan.across;
        for first_tile in (0..all).step_by(plan.strip) {
            let strip = &Strip { plan, tiles: first_tile..all.min(first_tile + plan.strip) };
            simd.call(InputTiles::<A, M> {
                input,
                size,
                channels: cin,
                first_row,
                strip,
                lines: &mut *lines,
                v: &mut *v,
            });
            for (i, half) in half.chunks_exact_mut(plan.half_step).take(A).enumerate() {
                let mut first = 0; // channel of the block
                for vectors in blocks(cout.div_ceil(S::LANES)) {
                    let lanes = vectors * S::LANES;
                    let (row, step) = match &weights.kernels {
                        Kernels::Taps(taps) => {
                            let taps: &[f32] = bytemuck::cast_slice(taps);
                            let taps = &taps[first * K * K * cin..][..K * K * cin * lanes];
                            simd.call(KernelRow::<A, K> { g, i, taps, u: &mut *u, u_step: plan.u_step });
                            (&*u, plan.u_step)
                        }
                        Kernels::Points(points) => {
                            let points: &[f32] = bytemuck::cast_slice(points);
                            (&points[(first * A * A + i * A * lanes) * cin..], cin * lanes)
                        }
                    };
                    let m = &mut m[..A * strip.tiles.len() * lanes];
                    let v = &v[i * A * plan.v_step..];
                    simd.call(Products::<A> {
                        strip,
                        vectors,
                        v,
                        u: row,
                        u_step: step,
                        u_len: cin * lanes,
                        m: &mut *m,
                    });
                    let half = &mut half[M * strip.tiles.len() * first..];
                    simd.call(HalfOutputs::<A, M> { m, half });
                    first += lanes;
                }
            }
            let mut first = 0;
            for vectors in blocks(cout.div_ceil(S::LANES)) {
                let lanes = vectors * S::LANES;
                simd.call(OutputTiles::<A, M> {
                    strip,
                    half: &half[M * strip.tiles.len() * first..],
                    half_step: plan.half_step,
                    bias: &bias[first..][..lanes.min(cout - first)],
                    relu,
                    out: &mut *out,
                    width,
                    channels: cout,
                    first,
                });
                first += lanes;
            }
        }
    }
}

/// `M = V U` of one row of points, one block and the tiles of a strip: for each point `[tiles, Cin] x [Cin, lanes]`.
struct Products<'a, const A: usize> {
    strip: &'a Strip<'a>,
    vectors: usize,   // of the block
    v: &'a [f32],     // of the row's first point and the first group
    u: &'a [f32],     // A times [Cin, vectors * LANES]
    u_step: usize,    // from one of them to the next
    u_len: usize,     // of each
    m: &'a mut [f32], // [tiles * vectors][A][LANES]
}

impl<const A: usize> Kernel for Products<'_, A> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Products { strip, vectors, v, u, u_step, u_len, m } = self;
        let Plan { v_step, v_len, .. } = *strip.plan;
        for j in 0..A {
            let (v, u, m) = (&v[j * v_step..], &u[j * u_step..][..u_len], &mut m[j * S::LANES..]);
            let (mut groups, mut vs) = (0, 0); // done so far, and vectors of M
            for (count, tiles) in strip.runs() {
                if count > 0 {
                    let m = &mut m[vs * A * S::LANES..];
                    let some = Groups::<A> { count, v: &v[groups * v_len..], v_len, u, m };
                    super::for_tile!(tiles, vectors, some.run, S, simd);
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
            let m = &mut self.m[group * TILES * VECTORS * step..][..(TILES * VECTORS - 1) * step + S::LANES];
            let mut tiles = [&v[..0]; TILES];
            for i in 0..TILES {
                tiles[i] = &v[i * cin..][..cin];
            }
            let mut sums = [[simd.zero(); VECTORS]; TILES];
            add_products(simd, tiles, cin, self.u, &mut sums);
            for i in 0..TILES {
                for k in 0..VECTORS {
                    simd.store(sums[i][k], &mut m[(i * VECTORS + k) * step..]);
                }
            }
        }
    }
}
