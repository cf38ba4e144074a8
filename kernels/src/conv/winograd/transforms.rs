//! The transforms of Winograd's algorithm: input tiles to points, `V = B^T d B`, and products to
//! outputs, `Y = A^T M A`.
//!
//! Shapes: `[a, a] -> [a, a]` per tile and input channel; `[a, a] -> [m, m]` per tile and output
//! channel. Cost: about `2 a` multiply-adds per line of `a` values in each direction; see
//! `Algorithm::cost` for their share.
//!
//! Both are done one direction after the other, on a vector of channels at a time:
//!
//! - Columns first: neighboring tiles overlap in `k - 1` columns, and share `B^T d` of a whole row
//!   of tiles ([`Lines`]).
//! - `M A` follows each row of points at once ([`HalfOutputs`]), `A^T (M A)` follows when all rows
//!   are multiplied ([`OutputTiles`]), and adds bias and ReLU on the way.

use super::points::{input_points, output_values};
use super::step;
use crate::Size;
use crate::par::{OutputPart, TileRows};
use crate::simd::{Kernel, Simd};
use std::ops::Range;

/// Consecutive tiles of `m x m` outputs, counted along the rows of a map.
#[derive(Clone)]
pub(super) struct Tiles {
    pub across: usize, // in a row
    pub range: Range<usize>,
}

impl Tiles {
    /// A tile's row of tiles, and its column.
    #[inline(always)]
    fn place(&self, tile: usize) -> (usize, usize) {
        (tile / self.across, tile % self.across)
    }
}

/// `V = B^T d B` of some tiles.
pub(super) struct InputTiles<'a, P, T: PointFormat, const A: usize, const M: usize> {
    pub input: &'a [f32], // [size.h, size.w, channels]
    pub size: Size,
    pub channels: usize,
    pub first_row: usize, // of tile 0's outputs
    pub tiles: Tiles,
    pub lines: &'a mut [f32], // room for B^T d of a row of tiles
    pub v: &'a mut [T::Value],
    pub places: P, // where each tile's V begins
    pub steps: Steps,
    pub to: T,
}

impl<P: Iterator<Item = usize>, T: PointFormat, const A: usize, const M: usize> Kernel
    for InputTiles<'_, P, T, A, M>
{
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let InputTiles {
            input,
            size,
            channels,
            first_row,
            tiles,
            lines,
            v,
            mut places,
            steps,
            to,
        } = self;
        let mut first = tiles.range.start;
        while first < tiles.range.end {
            // The tiles of one row at a time: they share B^T d.
            let count = (tiles.across - first % tiles.across).min(tiles.range.end - first);
            let (band, column) = tiles.place(first);
            let mut lines = Lines {
                values: &mut *lines,
                columns: (count - 1) * M + A,
                channels,
            };
            lines.fill::<S, A>(simd, input, size, (first_row + band * M, column * M));
            for (tile, place) in (0..count).zip(&mut places) {
                lines.tile::<S, T, A>(simd, tile * M, &mut v[place..], steps, to);
            }
            first += count;
        }
    }
}

/// The format in which `V` is held.
pub trait PointFormat: Copy {
    /// One value.
    type Value;

    /// Writes a vector of point number `point`, counted row by row.
    fn store<S: Simd>(self, simd: S, point: usize, v: S::F32, out: &mut [Self::Value]);
}

/// `V` in `f32`.
#[derive(Clone, Copy, Debug)]
pub struct AsIs;

impl PointFormat for AsIs {
    type Value = f32;

    #[inline(always)]
    fn store<S: Simd>(self, simd: S, _: usize, v: S::F32, out: &mut [f32]) {
        simd.store(v, out);
    }
}

/// Distances between the values of one tile's `V`.
#[derive(Clone, Copy, Debug)]
pub struct Steps {
    /// From one point to the next.
    pub point: usize,
    /// From one vector of channels to the next.
    pub vector: usize,
}

/// `B^T d` of a row of tiles, which share the columns where they overlap.
pub struct Lines<'a> {
    /// `[A][columns, channels]`, with room for one vector after each of the `A` lines:
    /// [`lines_len`] values.
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
    /// Transforms the columns of `input` (`[size.h, size.w, channels]`) from `(y, x)` on; values
    /// outside the map are 0.
    #[inline(always)]
    pub fn fill<S: Simd, const A: usize>(
        &mut self,
        simd: S,
        input: &[f32],
        size: Size,
        (y, x): (usize, usize),
    ) {
        let Lines {
            columns, channels, ..
        } = *self;
        let (rows, len) = (A.min(size.h - y), columns.min(size.w - x) * channels);
        let (from_step, to_step) = (size.w * channels, step(columns * channels));
        let input = &input[y * from_step + x * channels..];
        // Columns and channels are one run of values here: whole vectors, whatever the number of
        // channels.
        for at in starts(len, S::LANES) {
            let mut d = [simd.zero(); A];
            for i in 0..rows {
                let from = &input[i * from_step + at..];
                d[i] = if len >= S::LANES {
                    simd.load(from)
                } else {
                    simd.load_partial(&from[..len])
                };
            }
            for (i, value) in input_points::<S, A>(simd, &d).into_iter().enumerate() {
                simd.store(value, &mut self.values[i * to_step + at..]);
            }
        }
        for line in self.values.chunks_exact_mut(to_step).take(A) {
            line[len..columns * channels].fill(0.0);
        }
    }

    /// `V = B^T d B` of the tile that begins in `column`; `v` begins with its first channel at
    /// point 0.
    ///
    /// Writes whole vectors. What they hold after the last channel is meaningless: the next tile
    /// overwrites it, and after the last tile there must be room for it.
    #[inline(always)]
    pub fn tile<S: Simd, T: PointFormat, const A: usize>(
        &self,
        simd: S,
        column: usize,
        v: &mut [T::Value],
        steps: Steps,
        to: T,
    ) {
        let Lines {
            columns, channels, ..
        } = *self;
        let from_step = step(columns * channels);
        for vector in 0..channels.div_ceil(S::LANES) {
            for i in 0..A {
                let line = &self.values[i * from_step + column * channels + vector * S::LANES..];
                let mut d = [simd.zero(); A];
                for j in 0..A {
                    d[j] = simd.load(&line[j * channels..]);
                }
                for (j, value) in input_points::<S, A>(simd, &d).into_iter().enumerate() {
                    let point = i * A + j;
                    to.store(
                        simd,
                        point,
                        value,
                        &mut v[point * steps.point + vector * steps.vector..],
                    );
                }
            }
        }
    }
}

/// Starts of the vectors that cover `len` values; the last one overlaps its neighbor rather than
/// exceed `len`.
#[inline(always)]
fn starts(len: usize, lanes: usize) -> impl Iterator<Item = usize> {
    let last = len.saturating_sub(lanes);
    (0..len).step_by(lanes).map(move |at| at.min(last))
}

/// One row of `M A` of some tiles: half of the output transform, as soon as a row of points is
/// multiplied.
pub(super) struct HalfOutputs<'a, const A: usize, const M: usize> {
    pub m: &'a [f32],        // [tiles * vectors][A][LANES]: a row of M
    pub half: &'a mut [f32], // [tiles * vectors][M][LANES]: the same row of M A
}

impl<const A: usize, const M: usize> Kernel for HalfOutputs<'_, A, M> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let (rows, halves) = (
            self.m.chunks_exact(A * S::LANES),
            self.half.chunks_exact_mut(M * S::LANES),
        );
        for (row, half) in rows.zip(halves) {
            let m: [S::F32; A] = std::array::from_fn(|j| simd.load(&row[j * S::LANES..]));
            let line = output_values::<S, A, M>(simd, &m);
            for (value, half) in line.into_iter().zip(half.chunks_exact_mut(S::LANES)) {
                simd.store(value, half);
            }
        }
    }
}

/// `Y = A^T (M A)`, bias and ReLU, of some tiles and one block: the outputs that lie within the
/// map.
pub(super) struct OutputTiles<'a, 'b, const A: usize, const M: usize> {
    pub tiles: Tiles,
    pub map: &'a mut OutputPart<'b>, // [rows, width, channels]
    pub width: usize,
    pub block: OutputBlock<'a>,
}

/// `M A` of one block of output channels, and what turns it into outputs.
pub(super) struct OutputBlock<'a> {
    pub vectors: usize,
    pub half: &'a [f32],  // A times [tiles][vectors][M][LANES]: M A
    pub half_step: usize, // from one of them to the next
    pub bias: &'a [f32],  // of the channels
    pub relu: bool,
    pub channels: usize, // of the map
    pub first: usize,    // of the block
}

impl<const A: usize, const M: usize> Kernel for OutputTiles<'_, '_, A, M> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let OutputTiles {
            tiles,
            map,
            width,
            block,
        } = self;
        let height = map.height();
        for (i, tile) in tiles.range.clone().enumerate() {
            let (band, column) = tiles.place(tile);
            let (rows, columns) = (M.min(height - band * M), M.min(width - column * M));
            // Three calls, so that the usual case is compiled for one slice and a constant number
            // of rows.
            match map.tile(band, column) {
                TileRows::Whole(values, row_len) if rows == M => {
                    block.tile::<S, A, M>(simd, i, (M, columns), |y, at, value| {
                        simd.write(value, &mut values[y * row_len + at.start..][..at.len()]);
                    });
                }
                TileRows::Whole(values, row_len) => {
                    block.tile::<S, A, M>(simd, i, (rows, columns), |y, at, value| {
                        simd.write(value, &mut values[y * row_len + at.start..][..at.len()]);
                    });
                }
                TileRows::Cut(mut cut) => {
                    block.tile::<S, A, M>(simd, i, (rows, columns), |y, at, value| {
                        simd.write(value, &mut cut[y][at]);
                    });
                }
            }
        }
    }
}

impl OutputBlock<'_> {
    /// Computes a tile's outputs and hands those in `rows` and `columns` to `write`: the row, the
    /// place in it, a vector.
    #[inline(always)]
    fn tile<S: Simd, const A: usize, const M: usize>(
        &self,
        simd: S,
        tile: usize,
        (rows, columns): (usize, usize),
        mut write: impl FnMut(usize, Range<usize>, S::F32),
    ) {
        let OutputBlock {
            vectors,
            half,
            half_step,
            bias,
            relu,
            channels,
            first,
        } = *self;
        let floor = simd.splat(if relu { 0.0 } else { f32::NEG_INFINITY });
        for (vector, bias) in bias.chunks(S::LANES).enumerate() {
            let half = &half[(tile * vectors + vector) * M * S::LANES..];
            let (n, bias) = (bias.len(), simd.load_partial(bias));
            for j in 0..columns {
                let m: [S::F32; A] =
                    std::array::from_fn(|i| simd.load(&half[i * half_step + j * S::LANES..]));
                let at = j * channels + first + vector * S::LANES;
                let line = output_values::<S, A, M>(simd, &m);
                for (i, value) in line.into_iter().take(rows).enumerate() {
                    write(i, at..at + n, simd.max(simd.add(value, bias), floor));
                }
            }
        }
    }
}
