//! How the tiles of a large map are cut into strips, and the scratch space for one: for both ways in which `U` is kept.

use super::super::ConvShape;
use super::transforms::lines_len;
use super::{rows_per_tile, step};
use crate::Size;
use std::ops::Range;

/// Values of `V` and `M A` in a strip: so many, or this share of those of `U`. Smaller strips read `U` more often; of larger
/// ones less is still in the caches when it is needed again.
const STRIP_VALUES: usize = 256 << 10;
const STRIP_SHARE: usize = 8;

/// How a map is cut into tiles, and the scratch space for a strip of them.
///
/// `V` lies group by group (as many tiles as a register tile takes), in a group point by point: its transform, which
/// touches all points of a tile, stays within few pages of memory.
pub(super) struct Plan {
    pub across: usize,    // tiles in a row
    pub strip: usize,     // most tiles in a strip
    lines_len: usize,     // B^T d of a row of tiles
    pub group: usize,     // most tiles in a group
    pub v_step: usize,    // from one point's V to the next one's, within a group
    pub v_len: usize,     // from one group's V to the next one's
    m_len: usize,         // a row of M
    pub half_step: usize, // from one row of points of M A to the next
}

/// What the cut depends on besides the map.
pub(super) struct Kernels {
    pub inputs: usize,   // values of 32 bits in V, per tile and point
    pub channels: usize, // Cout, in whole vectors
    pub lanes: usize,    // of the widest block
    pub group: usize,    // most tiles that are multiplied at a time
    pub values: usize,   // of 32 bits, of U
}

impl Plan {
    pub fn new(kernels: &Kernels, shape: &ConvShape, points: usize, out: Size) -> Plan {
        let Kernels { inputs, channels, lanes, group, values } = *kernels;
        let m = rows_per_tile(shape, points);
        let (across, down) = (out.w.div_ceil(m), out.h.div_ceil(m));
        let per_tile = points * (points * inputs + m * channels); // of V and M A
        let most = STRIP_VALUES.max(values / STRIP_SHARE) / per_tile;
        let strips = (across * down).div_ceil(most.max(group));
        let strip = (across * down).div_ceil(strips);
        let strip = if strips > 1 { strip.next_multiple_of(group) } else { strip };
        let v_step = step(group * inputs);
        Plan {
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

    /// Values on the way to `V`, of `V`, of a row of `M`, and of `M A`.
    pub fn lens(&self, points: usize) -> [usize; 4] {
        let groups = self.strip.div_ceil(self.group);
        [self.lines_len, groups * self.v_len, self.m_len, points * self.half_step]
    }
}

/// Some tiles, counted along the rows from a thread's first.
pub(super) struct Strip<'a> {
    pub plan: &'a Plan,
    pub tiles: Range<usize>,
}

impl Strip<'_> {
    /// The groups as two runs of equal ones, the larger first: how many there are, and of how many tiles each.
    #[inline(always)]
    pub fn runs(&self) -> [(usize, usize); 2] {
        let groups = self.tiles.len().div_ceil(self.plan.group);
        let (tiles, larger) = (self.tiles.len() / groups, self.tiles.len() % groups);
        [(larger, tiles + 1), (groups - larger, tiles)]
    }

    /// Where each tile's V begins, of so many `inputs` per point.
    #[inline(always)]
    pub fn places(&self, inputs: usize) -> impl Iterator<Item = usize> {
        let v_len = self.plan.v_len;
        let groups = self.runs().into_iter().flat_map(|(groups, tiles)| std::iter::repeat_n(tiles, groups));
        groups
            .enumerate()
            .flat_map(move |(group, tiles)| (0..tiles).map(move |tile| group * v_len + tile * inputs))
    }
}
