//! The transforms of input tiles, and of products to outputs.

use super::points::{input_points, output_values};
use super::step;
use crate::Size;
use crate::par::{MapPart, TileRows};
use crate::simd::{Kernel, Simd};
use std::ops::Range;

/// Some tiles of `m x m` outputs, counted along the rows of a map.
#[derive(Clone)]
pub(super) struct Tiles {
    pub across: usize, // in a row
    pub range: Range<usize>,
}

impl Tiles {
    /// Which row of tiles one is in, and which column.
    #[inline(always)]
    fn place(&self, tile: usize) -> (usize, usize) {
        (tile / self.across, tile % self.across)
    }
}

/// `V = B^T d B` of some tiles.
pub(super) struct InputTiles<'a, P, T: Stored, const A: usize, const M: usize> {
    pub input: &'a [f32], // [size.h, size.w, channels]
    pub size: Size,
    pub channels: usize,
    pub first_row: usize, // of the outputs that tile 0 has
    pub tiles: Tiles,
    pub lines: &'a mut [f32], // room for B^T d of a row of tiles
    pub v: &'a mut [T::Value],
    pub places: P, // of each tile in V
    pub steps: Steps,
    pub to: T,
}

impl<P: Iterator<Item = usize>, T: Stored, const A: usize, const M: usize> Kernel
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
            let count = (tiles.across - first % tiles.across).min(tiles.range.end - first); // in this row
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

/// What `V` is held in.
pub trait Stored: Copy {
    /// One value of it.
    type Value;

    /// Writes a vector of a point, which are counted row by row.
    fn store<S: Simd>(self, simd: S, point: usize, v: S::F32, out: &mut [Self::Value]);
}

/// `V` in `f32`, as it is.
#[derive(Clone, Copy, Debug)]
pub struct AsIs;

impl Stored for AsIs {
    type Value = f32;

    #[inline(always)]
    fn store<S: Simd>(self, simd: S, _: usize, v: S::F32, out: &mut [f32]) {
        simd.store(v, out);
    }
}

/// How far apart the values of one tile's `V` are.
#[derive(Clone, Copy, Debug)]
pub struct Steps {
    /// From one point to the next.
    pub point: usize,
    /// From one vector of channels to the next.
    pub vector: usize,
}

/// `B^T d` of a row of tiles, which share the columns in which they overlap.
pub struct Lines<'a> {
    /// `[A][columns, channels]` and a vector's room behind each of the `A` lines: [`lines_len`] values.
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
    /// Takes the columns from `(y, x)` on out of `input` (`[size.h, size.w, channels]`); beyond the map everything counts as 0.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // constant indices keep the line in registers
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

    /// `V = B^T d B` of the tile that begins in `column`, its first channel at point 0 to the start of `v`.
    ///
    /// Whole vectors are written: what they reach beyond the last channel means nothing, the next tile overwrites it, and behind the last
    /// tile there must be room for it.
    #[inline(always)]
    #[allow(clippy::needless_range_loop)] // as above
    pub fn tile<S: Simd, T: Stored, const A: usize>(
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

/// Where the vectors begin that cover `len` values: the last one reaches back where it would reach beyond.
#[inline(always)]
fn starts(len: usize, lanes: usize) -> impl Iterator<Item = usize> {
    let last = len.saturating_sub(lanes);
    (0..len).step_by(lanes).map(move |at| at.min(last))
}

/// Row `i` of `M A`, of some tiles: half of the output's transform, as soon as a row of points is multiplied.
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

/// `Y = A^T M A`, bias and floor, of some tiles and one block: the outputs as far as they lie within the map.
pub(super) struct OutputTiles<'a, 'b, const A: usize, const M: usize> {
    pub tiles: Tiles,
    pub map: &'a mut MapPart<'b>, // [rows, width, channels]
    pub width: usize,
    pub block: OutputBlock<'a>,
}

/// The channels of a block, on their way from `M A` to outputs.
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
            // The same three times, so that the usual one has a single slice to write to, and a constant number of rows.
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
    /// Hands what is there of a tile's `rows` and `columns` to `write`: a row, where in it, and a vector.
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
