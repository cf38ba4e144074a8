//! Winograd's algorithm for 3x3 kernels, whose `U` is computed in each strip and not stored.
//!
//! `U` has 4 to 7 times as many values as the kernels, and a small map uses each of them only a few
//! times: reading them from memory would take longer than multiplying with them. So only kernels
//! are read, one block of output channels at a time. They become lines (`G g`, three values per
//! kernel) for two rows of points, `q` and `-q`, which stay in the L2 cache. The lines give `U`
//! point by point, with two operations per value:
//!
//! ```text
//! for each strip of tiles
//!   V of all its tiles
//!   for each pair of rows of points, q and -q
//!     for each block of output channels
//!       lines of both rows                               `KernelLines`
//!       for each of the two rows
//!         for each point of the row                      `Row`
//!           for each group of tiles: M = V U             <- the hot loop, `Tile`
//!         M A of the row                                 `HalfOutputs`
//!   Y = A^T (M A), bias, ReLU
//! ```
//!
//! The tricks:
//!
//! - If one register tile holds all tiles of a strip, `U` stays in registers. Otherwise it goes to
//!   the L1 cache, and is read once per group.
//! - The register tile is long: one or two vectors of channels x as many tiles as there are
//!   registers, so that each value of `U` is used as often as possible.
//! - While one row is multiplied, the kernels of the next block are prefetched, a cache line per
//!   input channel.
//!
//! Shapes: those of `mod.rs`, for `k = 3`. Cost: the products, plus two operations per value of `U`
//! in each strip.
//!
//! Every thread transforms all kernels for its own rows. Sharing `V` instead, with each thread
//! reading from another's cache, was slower.

use super::super::ConvShape;
use super::points::point;
use super::transforms::{
    AsIs, HalfOutputs, InputTiles, OutputBlock, OutputTiles, Steps, Tiles, lines_len,
};
use super::{
    LINE, ThreadPart, TileTask, Winograd, from_line, pack, rows_per_tile, run_on_the_fly, step,
};
use crate::par::ThreadTiles;
use crate::simd::{Kernel, Simd};
use crate::{Aligned, Isa, Size};

/// Side of the kernels.
const KERNEL: usize = 3;

/// Taps of one kernel.
const TAPS: usize = KERNEL * KERNEL;

/// Most tiles in a strip, unless a single row of tiles has more.
const STRIP_TILES: usize = 64;

/// Kernels of one layer as they are, in the order in which they are read.
#[derive(Clone, Debug)]
pub(super) struct PackedKernels {
    lanes: usize,    // of a vector
    block: usize,    // channels of a block
    group: usize,    // most tiles of a register tile
    g: Aligned<f32>, // [block][Cin][vectors of the block][k * k][LANES]
}

impl PackedKernels {
    /// Packs `weights` (`[Cout, k, k, Cin]`).
    pub(super) fn new(isa: Isa, shape: &ConvShape, weights: &[f32]) -> PackedKernels {
        let (lanes, (vectors, group)) = (isa.lanes(), isa.long_tile());
        let block = vectors * lanes;
        let blocks = std::iter::repeat_n(vectors, shape.out_channels.div_ceil(block));
        PackedKernels {
            lanes,
            block,
            group,
            g: pack(isa, shape, blocks, weights),
        }
    }
}

/// How `V` and `M A` of a strip lie in the scratch space.
struct GroupPlan {
    group: usize,  // tiles in a group; the last one has those left over
    v_step: usize, // from one point's V, [vector of Cin][tiles of the group][LANES], to the next
    v_len: usize,  // of one group
    // From one row of points of M A, [tiles][vectors of the block][M][LANES], to the next.
    half_step: usize,
    half_len: usize, // of one block
}

impl GroupPlan {
    fn new(kernels: &PackedKernels, shape: &ConvShape, points: usize, tiles: usize) -> GroupPlan {
        // Even groups rather than full ones and a small rest.
        let group = tiles.div_ceil(tiles.div_ceil(kernels.group));
        let v_step = step(group * shape.in_channels.next_multiple_of(kernels.lanes));
        let half_step = step(tiles * rows_per_tile(shape, points) * kernels.block);
        GroupPlan {
            group,
            v_step,
            v_len: points * points * v_step,
            half_step,
            half_len: points * half_step,
        }
    }
}

/// Most rows of tiles in a strip.
fn strip_rows(across: usize) -> usize {
    (STRIP_TILES / across).max(1)
}

/// Scratch values of strips of at most `tiles` tiles: of `B^T d` of a row of tiles, `G g` of two
/// rows of points and one block, `U` of one point and block, `M` of one row and block, all of
/// `M A`, and `V`.
fn lens(
    kernels: &PackedKernels,
    shape: &ConvShape,
    points: usize,
    across: usize,
    tiles: usize,
) -> [usize; 6] {
    let &PackedKernels {
        lanes,
        block,
        group,
        ..
    } = kernels;
    let m = rows_per_tile(shape, points);
    let lines_len = lines_len(points, (across - 1) * m + points, shape.in_channels);
    let u_len = shape.in_channels * block;
    let half_len = points * step(tiles * m * block) * shape.out_channels.div_ceil(block);
    let groups = tiles.div_ceil(group);
    // An upper bound: even groups have less than one tile of padding each, and steps less than two
    // cache lines.
    let v_step = (tiles + groups) * shape.in_channels.next_multiple_of(lanes) + groups * 2 * LINE;
    [
        lines_len,
        2 * KERNEL * u_len,
        u_len,
        tiles * points * block,
        half_len,
        points * points * v_step,
    ]
}

/// Scratch values per thread.
pub(super) fn scratch_len(
    kernels: &PackedKernels,
    shape: &ConvShape,
    points: usize,
    out: Size,
) -> usize {
    let m = rows_per_tile(shape, points);
    let (across, down) = (out.w.div_ceil(m), out.h.div_ceil(m));
    let tiles = across * down.min(strip_rows(across));
    LINE + lens(kernels, shape, points, across, tiles)
        .iter()
        .sum::<usize>()
}

impl Kernel for ThreadPart<'_, PackedKernels> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let (points, kernel) = (self.conv.kernels.points, self.conv.kernels.shape.kernel);
        run_on_the_fly(points, kernel, (self, simd));
    }
}

impl<S: Simd> TileTask for (ThreadPart<'_, PackedKernels>, S) {
    #[inline(always)]
    fn run<const A: usize, const M: usize>(self) {
        let (part, simd) = self;
        let ThreadPart {
            conv,
            kernels,
            tiles,
        } = part;
        let ThreadTiles {
            first_row,
            tiles: all,
            mut map,
            scratch,
        } = tiles;
        let Winograd {
            bias, input, size, ..
        } = *conv;
        let shape = &conv.kernels.shape;
        let (width, cout) = (shape.out_size(size).w, shape.out_channels);
        let across = width.div_ceil(M);
        let most = all.len().min(across * strip_rows(across));
        let [lines_len, g_len, u_len, m_len, half_len, _] = lens(kernels, shape, A, across, most);
        let (lines, scratch) = from_line(scratch).split_at_mut(lines_len);
        let (kernel_lines, scratch) = scratch.split_at_mut(g_len);
        let (u, scratch) = scratch.split_at_mut(u_len);
        let (m, scratch) = scratch.split_at_mut(m_len);
        let (half, v) = scratch.split_at_mut(half_len);
        for first in all.clone().step_by(most) {
            let tiles = Tiles {
                across,
                range: first..all.end.min(first + most),
            };
            let plan = &GroupPlan::new(kernels, shape, A, tiles.range.len());
            // V of the strip's tiles, by groups: [group][point][vector of Cin][tile][LANES].
            simd.call(InputTiles::<_, _, A, M> {
                input,
                size,
                channels: shape.in_channels,
                first_row,
                tiles: tiles.clone(),
                lines: &mut *lines,
                v: &mut *v,
                places: (0..tiles.range.len())
                    .map(|tile| tile / plan.group * plan.v_len + tile % plan.group * S::LANES),
                steps: Steps {
                    point: plan.v_step,
                    vector: plan.group * S::LANES,
                },
                to: AsIs,
            });
            let products = Products::<A, M> {
                plan,
                tiles: tiles.range.len(),
                v: &*v,
                g: &kernels.g,
                half,
                kernel_lines,
                u,
                m,
            };
            products.run(simd);
            // Outputs, block by block.
            let lanes = const { S::LONG_TILE.0 } * S::LANES;
            for (i, (bias, half)) in bias
                .chunks(lanes)
                .zip(half.chunks_exact(plan.half_len))
                .enumerate()
            {
                let block = OutputBlock {
                    vectors: S::LONG_TILE.0,
                    half,
                    half_step: plan.half_step,
                    bias,
                    relu: shape.relu,
                    channels: cout,
                    first: i * lanes,
                };
                simd.call(OutputTiles::<A, M> {
                    tiles: tiles.clone(),
                    map: &mut map,
                    width,
                    block,
                });
            }
        }
    }
}

/// `M A` of a strip's tiles, for all points and output channels.
struct Products<'a, const A: usize, const M: usize> {
    plan: &'a GroupPlan,
    tiles: usize,
    v: &'a [f32],
    g: &'a [f32],
    half: &'a mut [f32],
    kernel_lines: &'a mut [f32], // room for two rows of G g of one block
    u: &'a mut [f32],            // room for U of one point and block
    m: &'a mut [f32],            // room for a row of M of one block
}

impl<const A: usize, const M: usize> Products<'_, A, M> {
    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Products {
            plan,
            tiles,
            v,
            g,
            half,
            kernel_lines,
            u,
            m,
        } = self;
        let (plus, minus) = kernel_lines.split_at_mut(kernel_lines.len() / 2);
        let m = &mut m[..tiles * A * const { S::LONG_TILE.0 } * S::LANES];
        for pair in 0..A / 2 {
            // The rows of points at 0 and infinity, then those at q and -q.
            let rows = if pair == 0 {
                [0, A - 1]
            } else {
                [2 * pair - 1, 2 * pair]
            };
            let blocks = g.chunks_exact(TAPS * u.len());
            let next = blocks.clone().cycle().skip(1); // to prefetch
            for ((g, next), half) in blocks.zip(next).zip(half.chunks_exact_mut(plan.half_len)) {
                let point = (pair > 0).then(|| point(A, rows[0]));
                simd.call(KernelLines {
                    point,
                    g,
                    plus: &mut *plus,
                    minus: &mut *minus,
                });
                // Each of the two rows prefetches half of the next block's kernels.
                let next = next.split_at(next.len() / LINE / 2 * LINE);
                for ((i, lines), next) in rows
                    .into_iter()
                    .zip([&*plus, &*minus])
                    .zip([next.0, next.1])
                {
                    let v = &v[i * A * plan.v_step..];
                    simd.call(Row::<A> {
                        plan,
                        tiles,
                        v,
                        lines,
                        next,
                        u: &mut *u,
                        m: &mut *m,
                    });
                    simd.call(HalfOutputs::<A, M> {
                        m: &*m,
                        half: &mut half[i * plan.half_step..],
                    });
                }
            }
        }
    }
}

/// Two rows of `G g` for one block: at a point and at its negative, or at 0 and at infinity.
struct KernelLines<'a> {
    point: Option<f32>,   // `None` for 0 and infinity
    g: &'a [f32],         // [Cin * vectors][k][k][LANES]
    plus: &'a mut [f32],  // [Cin * vectors][k][LANES]
    minus: &'a mut [f32], // [Cin * vectors][k][LANES]
}

impl Kernel for KernelLines<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let KernelLines {
            point,
            g,
            plus,
            minus,
        } = self;
        let step = const { KERNEL * S::LANES };
        let kernels = g.chunks_exact(TAPS * S::LANES);
        let kernels = kernels.zip(
            plus.chunks_exact_mut(step)
                .zip(minus.chunks_exact_mut(step)),
        );
        let Some(point) = point else {
            for (g, (plus, minus)) in kernels {
                plus.copy_from_slice(&g[..step]);
                minus.copy_from_slice(&g[(KERNEL - 1) * step..]);
            }
            return;
        };
        let [positive, negative, square] = [point, -point, point * point].map(|x| simd.splat(x));
        for (g, (plus, minus)) in kernels {
            for x in 0..KERNEL {
                let tap = |y: usize| simd.load(&g[(y * KERNEL + x) * S::LANES..]);
                let (even, odd) = (simd.mul_add(square, tap(2), tap(0)), tap(1));
                simd.store(simd.mul_add(positive, odd, even), &mut plus[x * S::LANES..]);
                simd.store(
                    simd.mul_add(negative, odd, even),
                    &mut minus[x * S::LANES..],
                );
            }
        }
    }
}

/// Where the hot loop takes its values of `U` from.
trait Source: Copy {
    /// Vectors of the source per vector of `U`.
    const VECTORS: usize;

    /// A vector of `U`.
    fn value<S: Simd>(self, simd: S, from: &[f32]) -> S::F32;
}

/// From `U` itself, computed before.
#[derive(Clone, Copy)]
struct FromU;

impl Source for FromU {
    const VECTORS: usize = 1;

    #[inline(always)]
    fn value<S: Simd>(self, simd: S, from: &[f32]) -> S::F32 {
        simd.load(from)
    }
}

/// From lines of `G g`, at a finite point other than 0.
#[derive(Clone, Copy)]
struct FromLines {
    powers: [f32; KERNEL - 1], // of the point: first and second
}

impl Source for FromLines {
    const VECTORS: usize = KERNEL;

    #[inline(always)]
    fn value<S: Simd>(self, simd: S, line: &[f32]) -> S::F32 {
        let powers = self.powers.map(|power| simd.splat(power));
        let sum = simd.mul_add(powers[0], simd.load(&line[S::LANES..]), simd.load(line));
        simd.mul_add(powers[1], simd.load(&line[2 * S::LANES..]), sum)
    }
}

/// From lines of `G g`, at 0 or infinity: one of their three values.
#[derive(Clone, Copy)]
struct FromTaps {
    tap: usize,
}

impl Source for FromTaps {
    const VECTORS: usize = KERNEL;

    #[inline(always)]
    fn value<S: Simd>(self, simd: S, line: &[f32]) -> S::F32 {
        simd.load(&line[self.tap * S::LANES..])
    }
}

/// A row of `M` for one block: per point and group of tiles
/// `[tiles, Cin] x [Cin, vectors * LANES]`.
struct Row<'a, const A: usize> {
    plan: &'a GroupPlan,
    tiles: usize,     // of the strip
    v: &'a [f32],     // of the row's first point and the first group
    lines: &'a [f32], // the row's G g, [Cin * vectors][k][LANES]
    next: &'a [f32],  // to prefetch
    u: &'a mut [f32], // room for [Cin * vectors][LANES]
    m: &'a mut [f32], // [tiles * vectors][A][LANES]
}

impl<const A: usize> Kernel for Row<'_, A> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Row {
            plan,
            tiles,
            v,
            lines,
            next,
            u,
            m,
        } = self;
        let (vectors, step) = const { (S::LONG_TILE.0, KERNEL * S::LANES) };
        let channels = lines.len() / (vectors * step);
        for j in 0..A {
            let from_lines = FromLines {
                powers: [point(A, j), point(A, j) * point(A, j)],
            };
            let end = match j {
                0 => Some(0),
                _ if j == A - 1 => Some(KERNEL - 1),
                _ => None,
            };
            let at_once = tiles <= plan.group;
            // Several groups share this point's U: compute it once.
            if end.is_none() && !at_once {
                let values = lines.chunks_exact(step).zip(u.chunks_exact_mut(S::LANES));
                values.for_each(|(line, u)| simd.store(from_lines.value(simd, line), u));
            }
            for first in (0..tiles).step_by(plan.group) {
                let group = Group {
                    channels,
                    tiles: plan.group.min(tiles - first),
                    v: &v[first / plan.group * plan.v_len + j * plan.v_step..][..plan.v_step],
                    v_step: plan.group * S::LANES,
                    ahead: if first == 0 {
                        next.get(j * channels * LINE..)
                    } else {
                        None
                    },
                    m: &mut m[(first * vectors * A + j) * S::LANES..],
                    m_step: A * S::LANES,
                };
                match end {
                    Some(tap) => simd.call(Tile {
                        group,
                        weights: lines,
                        source: FromTaps { tap },
                    }),
                    None if at_once => simd.call(Tile {
                        group,
                        weights: lines,
                        source: from_lines,
                    }),
                    None => simd.call(Tile {
                        group,
                        weights: u,
                        source: FromU,
                    }),
                }
            }
        }
    }
}

/// The products of one point, one block, and the tiles of one group.
struct Group<'a> {
    channels: usize, // Cin
    tiles: usize,
    v: &'a [f32],             // [vector of Cin][tiles][LANES]
    v_step: usize,            // from one vector of Cin to the next
    ahead: Option<&'a [f32]>, // to prefetch, a cache line per channel
    m: &'a mut [f32],
    m_step: usize, // from one vector of products to the next
}

/// One register tile: the tiles of a group x a block of channels.
struct Tile<'a, U> {
    group: Group<'a>,
    weights: &'a [f32], // [Cin * vectors][U::VECTORS][LANES]
    source: U,
}

impl<U: Source> Kernel for Tile<'_, U> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        // Only the instruction set's own tiles are compiled.
        macro_rules! run {
            ($($n:literal)*) => {
                match self.group.tiles {
                    $($n if const { S::LONG_TILE.0 == 1 && $n <= S::LONG_TILE.1 } => {
                        self.run_sized::<S, 1, $n>(simd)
                    }
                    $n if const { S::LONG_TILE.0 == 2 && $n <= S::LONG_TILE.1 } => {
                        self.run_sized::<S, 2, $n>(simd)
                    })*
                    tiles => unreachable!("{tiles} tiles"),
                }
            };
        }
        run!(1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26)
    }
}

impl<U: Source> Tile<'_, U> {
    /// The hot loop, in which 3x3 layers spend most of their time.
    ///
    /// ```text
    /// for each input channel c
    ///   u[k] = load of U, or two multiply-adds from its line     VECTORS times
    ///   x    = broadcast of V[tile][c]                           TILES broadcasts
    ///   sums[tile][k] += x * u[k]                                TILES * VECTORS multiply-adds
    /// ```
    #[inline(always)]
    fn run_sized<S: Simd, const VECTORS: usize, const TILES: usize>(self, simd: S) {
        let Tile {
            group,
            weights,
            source,
        } = self;
        let Group {
            channels,
            v,
            v_step,
            ahead,
            m,
            m_step,
            ..
        } = group;
        let (ahead, ahead_step) = ahead.map_or((v, 0), |next| (next, LINE));
        let step = const { U::VECTORS * S::LANES };
        let mut weights = weights.chunks_exact(VECTORS * step);
        let mut sums = [[simd.zero(); VECTORS]; TILES];
        for (c, v) in (0..channels).step_by(S::LANES).zip(v.chunks(v_step)) {
            let v = &v[..TILES * S::LANES];
            for (lane, weights) in (0..S::LANES.min(channels - c)).zip(&mut weights) {
                simd.prefetch(ahead, (c + lane) * ahead_step);
                let mut u = [simd.zero(); VECTORS];
                for k in 0..VECTORS {
                    u[k] = source.value(simd, &weights[k * step..][..step]);
                }
                for i in 0..TILES {
                    let x = simd.splat(v[i * S::LANES + lane]);
                    for k in 0..VECTORS {
                        sums[i][k] = simd.mul_add(x, u[k], sums[i][k]);
                    }
                }
            }
        }
        for i in 0..TILES {
            for k in 0..VECTORS {
                simd.store(sums[i][k], &mut m[(i * VECTORS + k) * m_step..]);
            }
        }
    }
}
