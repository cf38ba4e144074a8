//! The walk over a map by strips of tiles, where `U` is stored in `f32` or `i16`, and the scratch
//! space of a strip.
//!
//! A strip is as many tiles as fit the L2 cache together with a part of `U`. Longer strips would
//! push `V` out of the cache before all output channels have passed over it; shorter ones would
//! read `U` more often.

use super::super::ConvShape;
use super::transforms::{
    InputTiles, OutputBlock, OutputTiles, PointFormat, Steps, Tiles, lines_len,
};
use super::{LINE, Winograd, from_line, rows_per_tile, step};
use crate::par::ThreadTiles;
use crate::simd::Simd;
use crate::{Isa, Size};
use bytemuck::Pod;
use std::ops::Range;

/// Most values of `V` and `M A` in a strip, unless [`STRIP_SHARE`] allows more.
const STRIP_VALUES: usize = 256 << 10;

/// Most values of `V` and `M A` in a strip, as a fraction of those of `U`: reading `U` again must
/// be worth it.
const STRIP_SHARE: usize = 8;

/// How a map is cut into strips, and the scratch space for one.
///
/// `V` lies group by group (as many tiles as a register tile takes), and in a group point by point.
/// The input transform touches all points of a tile, and so stays within few pages of memory.
pub(super) struct StripPlan {
    pub across: usize,    // tiles in a row
    pub strip: usize,     // most tiles in a strip
    lines_len: usize,     // B^T d of a row of tiles
    pub group: usize,     // most tiles in a group
    pub v_step: usize,    // from one point's V to the next one's, within a group
    pub v_len: usize,     // from one group's V to the next one's
    m_len: usize,         // a row of M
    pub half_step: usize, // from one row of points of M A to the next
}

/// What the cut into strips has to know about the stored kernels.
#[derive(Clone, Debug)]
pub(super) struct KernelLayout {
    pub inputs: usize, // values of 32 bits in V and U, per point and tile or output channel
    pub channels: usize, // Cout, in whole vectors
    pub lanes: usize,  // of the widest block
    pub group: usize,  // most tiles that are multiplied at a time
}

impl KernelLayout {
    /// For blocks of these `widths`, in vectors, and the largest register tiles.
    pub fn new(
        isa: Isa,
        inputs: usize,
        widths: impl Iterator<Item = usize> + Clone,
    ) -> KernelLayout {
        let widest = widths.clone().max().unwrap_or(0);
        let channels = widths.sum::<usize>() * isa.lanes();
        KernelLayout {
            inputs,
            channels,
            lanes: widest * isa.lanes(),
            group: isa.tile_pixels(widest),
        }
    }

    /// Scratch values per thread.
    pub fn scratch_len(&self, shape: &ConvShape, points: usize, out: Size) -> usize {
        LINE + StripPlan::new(self, shape, points, out)
            .lens(points)
            .iter()
            .sum::<usize>()
    }
}

impl StripPlan {
    fn new(layout: &KernelLayout, shape: &ConvShape, points: usize, out: Size) -> StripPlan {
        let KernelLayout {
            inputs,
            channels,
            lanes,
            group,
        } = *layout;
        let m = rows_per_tile(shape, points);
        let (across, down) = (out.w.div_ceil(m), out.h.div_ceil(m));
        // Strips of equal length, which are whole groups of tiles.
        let per_tile = points * (points * inputs + m * channels); // of V and M A
        let most = STRIP_VALUES.max(points * points * inputs * channels / STRIP_SHARE) / per_tile;
        let strips = (across * down).div_ceil(most.max(group));
        let strip = (across * down).div_ceil(strips);
        let strip = if strips > 1 {
            strip.next_multiple_of(group)
        } else {
            strip
        };
        let v_step = step(group * inputs);
        StripPlan {
            across,
            strip,
            lines_len: lines_len(points, (across - 1) * m + points, shape.in_channels),
            group,
            v_step,
            v_len: points * points * v_step,
            m_len: points * strip * lanes,
            half_step: step(m * strip * channels),
        }
    }

    /// Values of `B^T d` of a row of tiles, of `V`, of a row of `M`, and of `M A`.
    fn lens(&self, points: usize) -> [usize; 4] {
        let groups = self.strip.div_ceil(self.group);
        [
            self.lines_len,
            groups * self.v_len,
            self.m_len,
            points * self.half_step,
        ]
    }
}

/// Consecutive tiles, counted along the rows from the first tile in a thread's first row.
pub(super) struct Strip<'a> {
    pub plan: &'a StripPlan,
    pub tiles: Range<usize>,
}

impl Strip<'_> {
    /// The groups as two runs, the larger groups first: how many groups, and of how many tiles
    /// each.
    #[inline(always)]
    pub fn runs(&self) -> [(usize, usize); 2] {
        let groups = self.tiles.len().div_ceil(self.plan.group);
        let (tiles, larger) = (self.tiles.len() / groups, self.tiles.len() % groups);
        [(larger, tiles + 1), (groups - larger, tiles)]
    }

    /// Where each tile's V begins, with `inputs` values per point.
    #[inline(always)]
    fn places(&self, inputs: usize) -> impl Iterator<Item = usize> {
        let v_len = self.plan.v_len;
        let groups = self
            .runs()
            .into_iter()
            .flat_map(|(groups, tiles)| std::iter::repeat_n(tiles, groups));
        groups.enumerate().flat_map(move |(group, tiles)| {
            (0..tiles).map(move |tile| group * v_len + tile * inputs)
        })
    }
}

/// The walk over a thread's tiles.
pub(super) struct StripWalk<'a, W, T> {
    pub conv: &'a Winograd<'a>,
    pub tiles: ThreadTiles<'a>,
    pub layout: &'a KernelLayout,
    pub widths: W, // of the blocks, in vectors
    pub to: T,     // the format of V
}

/// What is multiplied in one step: a row of points, a block of output channels, and the tiles of a
/// strip.
pub(super) struct Block<'a> {
    pub strip: &'a Strip<'a>,
    pub row: usize,
    pub first: usize, // channel of the block
    pub vectors: usize,
    pub v: &'a [f32],        // of the row's first point and the first group
    pub m: &'a mut [f32],    // room for [tiles * vectors][A][LANES]: the row of M
    pub half: &'a mut [f32], // [tiles * vectors][M][LANES]: the row of M A, to be written
}

impl<W: Iterator<Item = usize> + Clone, T: PointFormat<Value: Pod>> StripWalk<'_, W, T> {
    /// Computes all strips; `multiply` turns `V` into `M A`, block by block.
    #[inline(always)]
    pub fn run<S: Simd, const A: usize, const M: usize>(
        self,
        simd: S,
        mut multiply: impl FnMut(Block<'_>),
    ) {
        let StripWalk {
            conv,
            tiles,
            layout,
            widths,
            to,
        } = self;
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
        let ConvShape {
            in_channels: channels,
            relu,
            ..
        } = *shape;
        let out = shape.out_size(size);
        let plan = &StripPlan::new(layout, shape, A, out);
        let [lines_len, v_len, m_len, _] = plan.lens(A);
        let (lines, scratch) = from_line(scratch).split_at_mut(lines_len);
        let (v, scratch) = scratch.split_at_mut(v_len);
        let (m, half) = scratch.split_at_mut(m_len);
        let per_float = size_of::<f32>() / size_of::<T::Value>();
        for first_tile in all.clone().step_by(plan.strip) {
            let strip = &Strip {
                plan,
                tiles: first_tile..all.end.min(first_tile + plan.strip),
            };
            let count = strip.tiles.len();
            let tiles = Tiles {
                across: plan.across,
                range: strip.tiles.clone(),
            };
            // V of the strip's tiles.
            simd.call(InputTiles::<_, _, A, M> {
                input,
                size,
                channels,
                first_row,
                tiles: tiles.clone(),
                lines: &mut *lines,
                v: bytemuck::cast_slice_mut(v),
                places: strip.places(layout.inputs).map(|place| place * per_float),
                steps: Steps {
                    point: plan.v_step * per_float,
                    vector: S::LANES,
                },
                to,
            });
            // M A, a row of points at a time. Blocks are the inner loop: the row's V stays in the
            // cache.
            for (row, half) in half.chunks_exact_mut(plan.half_step).take(A).enumerate() {
                let mut first = 0;
                for vectors in widths.clone() {
                    multiply(Block {
                        strip,
                        row,
                        first,
                        vectors,
                        v: &v[row * A * plan.v_step..],
                        m: &mut m[..A * count * vectors * S::LANES],
                        half: &mut half[M * count * first..],
                    });
                    first += vectors * S::LANES;
                }
            }
            // Outputs, block by block.
            let mut first = 0;
            for vectors in widths.clone() {
                let last = bias.len().min(first + vectors * S::LANES);
                let block = OutputBlock {
                    vectors,
                    half: &half[M * count * first..],
                    half_step: plan.half_step,
                    bias: &bias[first..last],
                    relu,
                    channels: bias.len(),
                    first,
                };
                simd.call(OutputTiles::<A, M> {
                    tiles: tiles.clone(),
                    map: &mut map,
                    width: out.w,
                    block,
                });
                first += vectors * S::LANES;
            }
        }
    }
}
