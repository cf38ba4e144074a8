//! A convolution and the max-pool behind it, some rows at a time: the map between them, by far the network's largest, is never
//! there as a whole, and what there is of it stays in the caches.
//!
//! ```text
//! for each band of rows of the map:  convolve it, behind the rows kept from the last one  ->  pool all whole windows
//! ```
//!
//! Bands begin where Winograd's tiles do: every value is the same bits as in one piece.

use super::{Conv, Input, Output, Packed, SLACK, winograd};
use crate::par::Threads;
use crate::{Size, pool};
use std::ops::Range;

/// Values of one thread's part of a band: as many as a second cache holds. Half of that is 2 % slower, no bands 8 to 18 %.
const BAND_VALUES: usize = if cfg!(test) { 2 << 10 } else { 128 << 10 }; // in tests small maps have several, too

/// Least rows of a band: those of a window.
const LEAST: usize = 3;

/// Most rows that are kept for the next band: those that two windows share, and one that none was whole with.
const KEPT: usize = 2;

impl Conv {
    /// The rows of the map, `size` of the input, that are there at a time.
    fn bands(&self, size: Size, threads: &Threads) -> impl Iterator<Item = Range<usize>> {
        let map = self.shape.out_size(size);
        let unit = match &self.weights {
            Packed::Winograd(weights) => winograd::rows_per_tile(weights.shape(), weights.points()),
            _ => 1,
        };
        let rows = (BAND_VALUES / (map.w * self.shape.out_channels)).max(LEAST);
        let rows = rows.next_multiple_of(unit) * threads.count();
        let band = move |first: usize| {
            first..if map.h - first < rows + LEAST {
                map.h
            } else {
                first + rows
            }
        };
        std::iter::successors(Some(band(0)), move |last| {
            (last.end < map.h).then(|| band(last.end))
        })
    }

    /// Rows of the input that some rows of the map depend on.
    fn input_rows(&self, rows: &Range<usize>) -> Range<usize> {
        let stride = self.shape.stride;
        rows.start * stride..(rows.end - 1) * stride + self.shape.kernel
    }

    /// Values of scratch space that hold a band with the rows kept before it.
    fn band_len(&self, size: Size, threads: &Threads) -> usize {
        let most = self
            .bands(size, threads)
            .map(|rows| rows.len())
            .max()
            .unwrap_or(0);
        (KEPT + most) * self.shape.out_size(size).w * self.shape.out_channels
    }

    /// How many values of scratch space [`run_pooled`](Self::run_pooled) needs.
    pub fn pooled_scratch_len(&self, size: Size, threads: &Threads) -> usize {
        let convolved = self.bands(size, threads).map(|rows| {
            self.scratch_len(
                Size {
                    h: self.input_rows(&rows).len(),
                    w: size.w,
                },
                threads,
            )
        });
        self.band_len(size, threads) + convolved.max().unwrap_or(0)
    }

    /// Convolves `input` (`[H, W, Cin]`), pools the outcome into `out` as [`pool::max_pool`] does, and returns the size of that: the same
    /// bits as one after the other.
    ///
    /// Panics as [`run_between`](Self::run_between) does, if the convolution has padding, or if `scratch` is shorter than
    /// [`pooled_scratch_len`](Self::pooled_scratch_len).
    pub fn run_pooled(
        &self,
        threads: &Threads,
        input: Input<'_>,
        size: Size,
        out: Output<'_>,
        scratch: &mut [f32],
    ) -> Size {
        let shape = &self.shape;
        assert_eq!(shape.pad, 0, "{shape:?} before a pool");
        assert_eq!(
            input.len(),
            size.area() * shape.in_channels,
            "input of {shape:?}"
        );
        let (isa, channels, map) = (self.isa, shape.out_channels, shape.out_size(size));
        let pooled = pool::out_size(map);
        assert_eq!(
            out.len(),
            pooled.area() * channels,
            "pooled output of {shape:?}"
        );
        let (band, scratch) = scratch.split_at_mut(self.band_len(size, threads));
        let row_len = size.w * shape.in_channels;
        let mut convolve = |rows: Range<usize>, out: Output<'_>| {
            let rows = self.input_rows(&rows);
            let size = Size {
                h: rows.len(),
                w: size.w,
            };
            let (start, end) = (rows.start * row_len, rows.end * row_len);
            let input = match input {
                Input::Floats(values) => Input::Floats(&values[start..end]),
                Input::Bytes(bytes) => Input::Bytes(&bytes[start..end + SLACK]),
            };
            self.run_between(threads, input, size, out, scratch);
        };
        let bands = self.bands(size, threads);
        let rows = [map.w * channels, pooled.w * channels];
        match out {
            Output::Floats(out) => pool_bands(
                bands,
                rows,
                band,
                out,
                |rows, out| convolve(rows, Output::Floats(out)),
                |band, h, out| {
                    _ = pool::max_pool(isa, threads, band, Size { h, ..map }, channels, out)
                },
            ),
            Output::Bytes(out, quantization) => pool_bands(
                bands,
                rows,
                bytemuck::cast_slice_mut(band),
                out,
                |rows, out| convolve(rows, Output::Bytes(out, quantization)),
                |band, h, out| {
                    _ = pool::max_pool_bytes(isa, threads, band, Size { h, ..map }, channels, out)
                },
            ),
        }
        pooled
    }
}

/// Lets `convolve` write each band behind the rows kept from the one before, and `pool` read it with how many rows it has.
fn pool_bands<T: Copy>(
    bands: impl Iterator<Item = Range<usize>>,
    [row_len, pooled_len]: [usize; 2], // of a row of the map, and of one that is pooled
    band: &mut [T],
    mut out: &mut [T],
    mut convolve: impl FnMut(Range<usize>, &mut [T]),
    pool: impl Fn(&[T], usize, &mut [T]),
) {
    let mut kept = 0; // rows
    let mut bands = bands.peekable();
    while let Some(rows) = bands.next() {
        let there = kept + rows.len();
        convolve(rows, &mut band[kept * row_len..there * row_len]);
        let last = bands.peek().is_none();
        let windows = if last {
            out.len() / pooled_len
        } else {
            (there - 1) / 2
        };
        let used = if last { there } else { 2 * windows + 1 };
        let (pooled, rest) = std::mem::take(&mut out).split_at_mut(windows * pooled_len);
        pool(&band[..used * row_len], used, pooled);
        out = rest;
        kept = there.saturating_sub(2 * windows);
        band.copy_within(2 * windows * row_len..(2 * windows + kept) * row_len, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Algorithm, ConvShape};
    use super::*;
    use crate::Isa;
    use crate::quant::Quantization;
    use crate::testing::noise;

    const SHAPES: [(usize, usize, usize, usize); 4] = // kernel, stride, Cin, Cout
        [(11, 2, 3, 48), (5, 1, 6, 130), (3, 1, 4, 21), (4, 3, 2, 7)];

    fn shape(
        (kernel, stride, in_channels, out_channels): (usize, usize, usize, usize),
    ) -> ConvShape {
        ConvShape {
            in_channels,
            out_channels,
            kernel,
            stride,
            pad: 0,
            relu: true,
        }
    }

    fn cases() -> impl Iterator<Item = (ConvShape, Isa)> {
        SHAPES
            .into_iter()
            .flat_map(|s| Isa::available().into_iter().map(move |isa| (shape(s), isa)))
    }

    /// Heights of the map from one window to some bands.
    fn sizes(shape: &ConvShape) -> impl Iterator<Item = Size> {
        let side = |out: usize| (out - 1) * shape.stride + shape.kernel;
        [(3, 9), (4, 4), (5, 21), (23, 21), (31, 20), (32, 9)]
            .into_iter()
            .map(move |(h, w)| Size {
                h: side(h),
                w: side(w),
            })
    }

    #[test]
    fn the_same_bits_as_one_after_the_other() {
        for (shape, isa) in cases() {
            let weights = noise(shape.out_channels * shape.window(), 1);
            let bias = noise(shape.out_channels, 2);
            for (size, count) in sizes(&shape).flat_map(|size| [1, 3].map(|count| (size, count))) {
                let input = noise(size.area() * shape.in_channels, 3);
                let (map, threads) = (shape.out_size(size), Threads::new(count));
                let pooled = pool::out_size(map);
                for algorithm in [
                    Algorithm::Direct,
                    Algorithm::Winograd6,
                    Algorithm::Winograd8,
                    Algorithm::Winograd10,
                ] {
                    let conv = Conv::new(isa, algorithm, shape, &weights, &bias);
                    let mut between = vec![f32::NAN; map.area() * shape.out_channels];
                    let mut scratch = vec![f32::NAN; conv.scratch_len(size, &threads)];
                    let mut expected = vec![f32::NAN; pooled.area() * shape.out_channels];
                    let mut out = expected.clone();
                    threads.enter(|| {
                        conv.run(&threads, &input, size, &mut between, &mut scratch);
                        pool::max_pool(
                            isa,
                            &threads,
                            &between,
                            map,
                            shape.out_channels,
                            &mut expected,
                        );
                        scratch = vec![f32::NAN; conv.pooled_scratch_len(size, &threads)];
                        let out = Output::Floats(&mut out);
                        conv.run_pooled(&threads, Input::Floats(&input), size, out, &mut scratch)
                    });
                    assert!(
                        out == expected,
                        "{shape:?} on {size:?}, {isa}, {}, {count} threads",
                        algorithm.name()
                    );
                }
            }
        }
    }

    #[test]
    fn bytes_too() {
        let [q, next] = [
            Quantization {
                scale: 0.01,
                zero_point: 90,
            },
            Quantization {
                scale: 0.05,
                zero_point: 3,
            },
        ];
        for (shape, isa) in cases() {
            let weights = noise(shape.out_channels * shape.window(), 1);
            let bias = noise(shape.out_channels, 2);
            let conv = Conv::new(isa, Algorithm::Int8(q), shape, &weights, &bias);
            for size in sizes(&shape) {
                let len = size.area() * shape.in_channels;
                let bytes: Vec<u8> = (0..len + SLACK).map(|i| (i * i / 7 % 256) as u8).collect();
                let (map, threads) = (shape.out_size(size), Threads::new(2));
                let pooled = pool::out_size(map);
                let mut between = vec![7; map.area() * shape.out_channels];
                let mut scratch = vec![f32::NAN; conv.pooled_scratch_len(size, &threads)];
                let mut expected = vec![7; pooled.area() * shape.out_channels];
                let mut out = vec![8; expected.len()];
                let input = Input::Bytes(&bytes);
                threads.enter(|| {
                    conv.run_between(
                        &threads,
                        input,
                        size,
                        Output::Bytes(&mut between, next),
                        &mut scratch,
                    );
                    pool::max_pool_bytes(
                        isa,
                        &threads,
                        &between,
                        map,
                        shape.out_channels,
                        &mut expected,
                    );
                    conv.run_pooled(
                        &threads,
                        input,
                        size,
                        Output::Bytes(&mut out, next),
                        &mut scratch,
                    );
                });
                assert!(out == expected, "{shape:?} on {size:?}, {isa}");
            }
        }
    }
}
