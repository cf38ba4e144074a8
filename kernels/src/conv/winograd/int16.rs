//! Winograd's algorithm on 16-bit integers, for maps whose value range is known.
//!
//! A dot product of `i16` pairs takes half the time of two `f32` products where the instruction set
//! has one, and its factors half the memory. `V` and `U` are rounded, not inputs and weights, so
//! each point has its own scale, and `U` has one per output channel as well:
//!
//! ```text
//! V' = round(V * 16383 / bound)    bound: the largest |V| that inputs in the range can give
//! U' = round(U / s)                s: the smallest scale that lets no sum of V' U' overflow
//! M  = (sum over i of U' V') * s * bound / 16383
//! ```
//!
//! Shapes and walk are those of `stored.rs` (`strips.rs`), with two input channels per step and at
//! half the cost. Error, for normally distributed weights and rectified inputs of 128 channels:
//! 0.3 % of the outputs' RMS with 6 points, 0.6 % with 8 (tests hold it below 0.4 and 1 %). Bytes
//! err by 1.4 to 1.8 %; 10 points would err by 4 %.

use super::super::ConvShape;
use super::super::direct::blocks;
use super::points::input_matrix;
use super::stored::transform_kernels;
use super::strips::{Block, KernelLayout, Strip, StripPlan, StripWalk};
use super::transforms::{HalfOutputs, PointFormat};
use super::{ThreadPart, TileTask, run_int16};
use crate::quant::Quantization;
use crate::simd::{Dot, DotKernel, MOST_INT16, Simd};
use crate::{Aligned, Isa};

/// Two input channels of one lane.
type Pair = [i16; 2];

/// `U'` of one layer.
#[derive(Clone, Debug)]
pub(super) struct Int16Kernels {
    pub layout: KernelLayout,
    u: Aligned<Pair>, // [row of points][block][a][pairs of Cin][vectors of the block * LANES]
    scale: Aligned<f32>, // of M: [row of points][block][a][vectors of the block * LANES]
    factors: Vec<f32>, // of V: [a][a]
}

impl Int16Kernels {
    /// Transforms and rounds `weights` (`[Cout, k, k, Cin]`) for inputs in the range of `input`.
    pub(super) fn new(
        isa: Isa,
        shape: &ConvShape,
        points: usize,
        weights: &[f32],
        input: Quantization,
    ) -> Int16Kernels {
        let vectors = shape.out_channels.div_ceil(isa.lanes());
        let layout = KernelLayout::new(isa, pairs(shape), blocks(vectors));
        let bounds = bounds(points, [input.value(0), input.value(u8::MAX)]);
        let factors: Vec<f32> = bounds
            .iter()
            .map(|bound| f32::from(MOST_INT16) / bound)
            .collect();
        let all = transform_kernels(isa, shape, points, blocks(vectors), weights);
        // Round point by point and block by block, in the order in which the kernels lie.
        let mut u = Aligned::zeros(points * points * layout.inputs * layout.channels);
        let mut scale = Aligned::zeros(points * points * layout.channels);
        let (mut all, mut rest, mut scales) = (&all[..], &mut u[..], &mut scale[..]);
        for factors in factors.chunks(points) {
            for lanes in blocks(vectors).map(|vectors| vectors * isa.lanes()) {
                for factor in factors {
                    let (values, integers, scale);
                    (values, all) = all.split_at(shape.in_channels * lanes);
                    (integers, rest) = rest.split_at_mut(layout.inputs * lanes);
                    (scale, scales) = scales.split_at_mut(lanes);
                    round(values, lanes, integers, scale);
                    scale.iter_mut().for_each(|scale| *scale /= factor);
                }
            }
        }
        Int16Kernels {
            layout,
            u,
            scale,
            factors,
        }
    }
}

/// Pairs of input channels.
fn pairs(shape: &ConvShape) -> usize {
    shape.in_channels.div_ceil(2)
}

/// The largest magnitude of `V` at each point, for inputs in `[low, high]`.
fn bounds(points: usize, [low, high]: [f32; 2]) -> Vec<f32> {
    // V = B^T d B: each coefficient is a product of two entries of B^T, positive if their signs
    // agree.
    let matrix = input_matrix(points);
    let sums = |row: &[f32]| {
        let sum = |sign: f32| row.iter().map(|b| (sign * b).max(0.0)).sum::<f32>();
        (sum(1.0), sum(-1.0))
    };
    let rows: Vec<(f32, f32)> = matrix.iter().map(|row| sums(row)).collect();
    let bound = |(up, down): (f32, f32), (right, left): (f32, f32)| {
        let (plus, minus) = (up * right + down * left, up * left + down * right);
        (plus * high - minus * low)
            .max(minus * high - plus * low)
            .max(f32::MIN_POSITIVE)
    };
    rows.iter()
        .flat_map(|y| rows.iter().map(move |x| bound(*y, *x)))
        .collect()
}

/// Rounds `values` (`[Cin, lanes]`) to `pairs` (`[pairs of Cin, lanes]`), and sets each lane's
/// `scale`.
fn round(values: &[f32], lanes: usize, pairs: &mut [Pair], scale: &mut [f32]) {
    let channels = values.len() / lanes;
    let (mut sums, mut most) = (vec![0.0f32; lanes], vec![0.0f32; lanes]);
    for values in values.chunks_exact(lanes) {
        for (lane, value) in values.iter().enumerate() {
            sums[lane] += value.abs();
            most[lane] = most[lane].max(value.abs());
        }
    }
    // The largest sum of |U'| that cannot overflow; rounding adds at most 1/2 per channel.
    let sum = (i32::MAX / i32::from(MOST_INT16)) as f32 - channels as f32;
    for (lane, scale) in scale.iter_mut().enumerate() {
        *scale = (sums[lane] / sum)
            .max(most[lane] / f32::from(i16::MAX))
            .max(f32::MIN_POSITIVE);
    }
    for (i, values) in values.chunks_exact(lanes).enumerate() {
        let pairs = &mut pairs[i / 2 * lanes..][..lanes];
        for ((pair, value), scale) in pairs.iter_mut().zip(values).zip(&*scale) {
            pair[i % 2] = (value / scale).round_ties_even() as i16;
        }
    }
}

/// `V'`: `V` scaled point by point and rounded.
#[derive(Clone, Copy)]
struct Rounded<'a> {
    factors: &'a [f32],
}

impl PointFormat for Rounded<'_> {
    type Value = i16;

    #[inline(always)]
    fn store<S: Simd>(self, simd: S, point: usize, v: S::F32, out: &mut [i16]) {
        simd.store_int16(
            simd.mul_add(v, simd.splat(self.factors[point]), simd.zero()),
            out,
        );
    }
}

impl DotKernel for ThreadPart<'_, Int16Kernels> {
    type Output = ();

    #[inline(always)]
    fn run<D: Dot>(self, dot: D) {
        let (points, kernel) = (self.conv.kernels.points, self.conv.kernels.shape.kernel);
        run_int16(points, kernel, (self, dot));
    }
}

impl<D: Dot> TileTask for (ThreadPart<'_, Int16Kernels>, D) {
    #[inline(always)]
    fn run<const A: usize, const M: usize>(self) {
        let (part, dot) = self;
        let ThreadPart {
            conv,
            kernels,
            tiles,
        } = part;
        let simd = dot.float();
        let walk = StripWalk {
            conv,
            tiles,
            layout: &kernels.layout,
            widths: blocks(conv.kernels.shape.out_channels.div_ceil(D::Float::LANES)),
            to: Rounded {
                factors: &kernels.factors,
            },
        };
        walk.run::<D::Float, A, M>(
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
                let (from, lanes) = ((row * channels + first) * A, vectors * D::Float::LANES);
                let u = &kernels.u[from * inputs..][..A * inputs * lanes];
                let (v, scale) = (bytemuck::cast_slice(v), &kernels.scale[from..][..A * lanes]);
                dot.call(Products::<A> {
                    strip,
                    vectors,
                    v,
                    u,
                    scale,
                    m: &mut *m,
                });
                simd.call(HalfOutputs::<A, M> { m, half });
            },
        );
    }
}

/// `M = V U` for one row of points, one block, and the tiles of a strip: per point
/// `[tiles, Cin] x [Cin, lanes]`.
struct Products<'a, const A: usize> {
    strip: &'a Strip<'a>,
    vectors: usize,   // of the block
    v: &'a [Pair],    // of the row's first point and the first group
    u: &'a [Pair],    // A times [pairs of Cin, vectors * LANES]
    scale: &'a [f32], // A times [vectors * LANES]
    m: &'a mut [f32], // [tiles * vectors][A][LANES]
}

impl<const A: usize> DotKernel for Products<'_, A> {
    type Output = ();

    #[inline(always)]
    fn run<D: Dot>(self, dot: D) {
        let Products {
            strip,
            vectors,
            v,
            u,
            scale,
            m,
        } = self;
        let StripPlan { v_step, v_len, .. } = *strip.plan;
        let vector = D::Float::LANES;
        let scales = scale.chunks_exact(scale.len() / A);
        for ((j, u), scale) in u.chunks_exact(u.len() / A).enumerate().zip(scales) {
            let (v, m) = (&v[j * v_step..], &mut m[j * vector..]);
            let (mut groups, mut vs) = (0, 0); // done so far, and vectors of M
            for (count, tiles) in strip.runs() {
                if count > 0 {
                    let m = &mut m[vs * A * vector..];
                    let some = Groups::<A> {
                        count,
                        v: &v[groups * v_len..],
                        v_len,
                        u,
                        scale,
                        first: groups == 0,
                        m,
                    };
                    super::super::for_tile!(
                        tiles,
                        vectors,
                        some.run,
                        D,
                        dot,
                        D::Float::TILE_PIXELS
                    );
                    (groups, vs) = (groups + count, vs + count * tiles * vectors);
                }
            }
        }
    }
}

/// `M = V U` for one point and some groups of equal size.
struct Groups<'a, const A: usize> {
    count: usize,
    v: &'a [Pair],
    v_len: usize,
    u: &'a [Pair],
    scale: &'a [f32],
    first: bool, // whether these are the first groups, which prefetch the next point's U
    m: &'a mut [f32],
}

impl<const A: usize> Groups<'_, A> {
    /// The hot loop, `products`, once per group; then sums become `f32`.
    #[inline(always)]
    fn run<D: Dot, const TILES: usize, const VECTORS: usize>(self, dot: D) {
        let (simd, vector) = (dot.float(), D::Float::LANES);
        let pairs = self.u.len() / (VECTORS * vector);
        // A constant: stores at variable places would keep the sums in memory, in the hot loop too.
        let step = const { A * D::Float::LANES };
        for group in 0..self.count {
            let v = &self.v[group * self.v_len..][..TILES * pairs];
            let m = &mut self.m[group * TILES * VECTORS * step..]
                [..(TILES * VECTORS - 1) * step + vector];
            let sums = if group == 0 && self.first {
                products::<D, TILES, VECTORS, true>(dot, v, self.u)
            } else {
                products::<D, TILES, VECTORS, false>(dot, v, self.u)
            };
            for (i, sums) in sums.iter().enumerate() {
                for (k, sum) in sums.iter().enumerate() {
                    let scale = simd.load(&self.scale[k * vector..]);
                    let value = simd.mul_add(dot.to_f32(*sum), scale, simd.zero());
                    simd.store(value, &mut m[(i * VECTORS + k) * step..]);
                }
            }
        }
    }
}

/// The hot loop: the products of `v` (`[TILES, pairs]`) with `u` (`[pairs, VECTORS * LANES]`).
///
/// ```text
/// for each pair j of input channels
///   w[k] = load of u[j][k]                           VECTORS loads
///   x    = broadcast of v[i][j]                      TILES broadcasts
///   sums[i][k] = dot_pairs(x, w[k], sums[i][k])      TILES * VECTORS dot products
/// ```
///
/// If `AHEAD`, prefetches what follows `u`: the next point's.
#[inline(always)]
fn products<D: Dot, const TILES: usize, const VECTORS: usize, const AHEAD: bool>(
    dot: D,
    v: &[Pair],
    u: &[Pair],
) -> [[D::I32; VECTORS]; TILES] {
    let lanes = VECTORS * D::Float::LANES;
    let pairs = v.len() / TILES;
    let mut tiles = [&v[..0]; TILES];
    for i in 0..TILES {
        tiles[i] = &v[i * pairs..][..pairs];
    }
    let mut sums = [[dot.zero(); VECTORS]; TILES];
    for (j, weights) in (0..pairs).zip(u.chunks_exact(lanes)) {
        let mut w = [dot.load_pairs(weights); VECTORS];
        for k in 0..VECTORS {
            w[k] = dot.load_pairs(&weights[k * D::Float::LANES..]);
            if AHEAD {
                let lines: &[f32] = bytemuck::cast_slice(&weights[k * D::Float::LANES..]);
                dot.float().prefetch(lines, u.len());
            }
        }
        for i in 0..TILES {
            let x = dot.splat_pair(tiles[i][j]);
            for k in 0..VECTORS {
                sums[i][k] = dot.dot_pairs(x, w[k], sums[i][k]);
            }
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::noise;

    #[test]
    fn rounded_kernels_of_any_size_cannot_overflow_and_keep_their_values() {
        let lanes = 8;
        for channels in [1, 2, 3, 48, 513, 4000] {
            let mut all = noise(channels * lanes, 1);
            for values in all.chunks_exact_mut(lanes) {
                (values[0], values[1], values[2]) = (1.0, -1e-20, 0.0);
            }
            all[3] = 1e6; // the lane's other values round to 0
            let mut rounded = vec![[0; 2]; channels.div_ceil(2) * lanes];
            let mut scale = vec![0.0; lanes];
            round(&all, lanes, &mut rounded, &mut scale);
            for (lane, scale) in scale.iter().enumerate() {
                let value = |i: usize| i64::from(rounded[i / 2 * lanes + lane][i % 2]);
                let sum: i64 = (0..channels).map(|i| value(i).abs()).sum();
                assert!(
                    sum * i64::from(MOST_INT16) <= i64::from(i32::MAX),
                    "{channels} channels: {sum}"
                );
                for i in 0..channels {
                    let error = (value(i) as f32 * scale - all[i * lanes + lane]).abs();
                    assert!(
                        error <= 0.501 * scale,
                        "{channels} channels, lane {lane}: {error} of {scale}"
                    );
                }
            }
        }
    }

    #[test]
    fn bound_of_each_point_is_the_extreme_over_inputs_at_the_ends_of_the_range() {
        for (low, high) in [(0.0, 2.0), (-1.0, 3.0)] {
            let (bounds, matrix) = (bounds(6, [low, high]), input_matrix(6));
            for (point, bound) in bounds.iter().enumerate() {
                let (row, column) = (&matrix[point / 6], &matrix[point % 6]);
                let coefficients = row.iter().flat_map(|y| column.iter().map(move |x| y * x));
                let ends = |c: f32| [low * c, high * c];
                let (mut least, mut most) = (0.0, 0.0);
                for [a, b] in coefficients.map(ends) {
                    (least, most) = (least + a.min(b), most + a.max(b));
                }
                assert!(
                    (most.max(-least) - bound).abs() <= 1e-5 * bound,
                    "{least} to {most}: {bound}"
                );
            }
        }
    }
}
