//! A convolution and the max-pool after it, band by band: `y = max_pool(conv(x))`.
//!
//! Shapes: `[H, W, Cin] -> [H'', W'', Cout]`, the sizes of [`Conv`] and [`pool`] one after the
//! other. Cost: that of both, minus the traffic to memory. The map between them is by far the
//! network's largest; it is never held as a whole, and each band of it stays in the caches. Without
//! bands the first layers take 8 to 18 % longer.
//!
//! ```text
//! for each band of rows of the map
//!   convolve it into the space after the rows kept from the last band
//!   pool all windows that are complete
//!   move the rows that the next windows share to the front
//! ```
//!
//! Bands begin at rows of Winograd tiles, so that every value has the same bits as in one piece.

use super::conv::Weights;
use super::{Conv, Input, Output, SLACK, winograd};
use crate::par::Threads;
use crate::{Size, pool};
use std::ops::Range;

/// Values of one thread's part of a band: what an L2 cache of 512 KiB holds. Half of it is 2 %
/// slower.
///
/// Tests use small bands, so that small maps have several.
const BAND_VALUES: usize = if cfg!(test) { 2 << 10 } else { 128 << 10 };

/// Fewest rows of a band: those of one pooling window.
const LEAST: usize = 3;

/// Most rows that are kept for the next band: the one that two windows share, and one of an
/// incomplete window.
const KEPT: usize = 2;

impl Conv {
    /// The bands: ranges of rows of the map, for an input of `size`.
    fn bands(&self, size: Size, threads: &Threads) -> impl Iterator<Item = Range<usize>> {
        let map = self.shape.out_size(size);
        let unit = match &self.weights {
            Weights::Winograd(kernels) => {
                winograd::rows_per_tile(kernels.shape(), kernels.points())
            }
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

    /// Rows of the input that these rows of the map depend on.
    fn input_rows(&self, rows: &Range<usize>) -> Range<usize> {
        let stride = self.shape.stride;
        rows.start * stride..(rows.end - 1) * stride + self.shape.kernel
    }

    /// Scratch values for the largest band and the rows kept before it.
    fn band_len(&self, size: Size, threads: &Threads) -> usize {
        let most = self
            .bands(size, threads)
            .map(|rows| rows.len())
            .max()
            .unwrap_or(0);
        (KEPT + most) * self.shape.out_size(size).w * self.shape.out_channels
    }

    /// Scratch values that [`run_pooled`](Self::run_pooled) needs for an input of `size`.
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

    /// Convolves `input` (`[H, W, Cin]`), pools the result into `out` as [`pool::max_pool`] does,
    /// and returns the size of `out`. The bits equal those of both one after the other.
    ///
    /// Panics as [`run_between`](Self::run_between) does, if the convolution has padding, or if
    /// `scratch` is shorter than [`pooled_scratch_len`](Self::pooled_scratch_len).
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

/// Lets `convolve` write each band after the rows kept from the last one, and `pool` read both:
/// `pool(rows, count, out)`.
fn pool_bands<T: Copy>(
    bands: impl Iterator<Item = Range<usize>>,
    [row_len, pooled_len]: [usize; 2], // values of a row of the map, and of a pooled row
    band: &mut [T],
    mut out: &mut [T],
    mut convolve: impl FnMut(Range<usize>, &mut [T]),
    pool: impl Fn(&[T], usize, &mut [T]),
) {
    let mut kept = 0; // rows at the front of `band` from the last one
    let mut bands = bands.peekable();
    while let Some(rows) = bands.next() {
        let held = kept + rows.len();
        convolve(rows, &mut band[kept * row_len..held * row_len]);
        // A window needs rows 2 i to 2 i + 2; at the map's end the pool decides what an incomplete
        // one does.
        let last = bands.peek().is_none();
        let windows = if last {
            out.len() / pooled_len
        } else {
            (held - 1) / 2
        };
        let used = if last { held } else { 2 * windows + 1 };
        let (pooled, rest) = std::mem::take(&mut out).split_at_mut(windows * pooled_len);
        pool(&band[..used * row_len], used, pooled);
        out = rest;
        kept = held.saturating_sub(2 * windows);
        band.copy_within(2 * windows * row_len..(2 * windows + kept) * row_len, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Algorithm, ConvShape};
    use super::*;
    use crate::Isa;
    use crate::quant::Quantization;
    use testing::noise;

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
    fn pooled_convolution_has_the_same_bits_as_one_after_the_other() {
        for (shape, isa) in cases() {
            let weights = noise(shape.out_channels * shape.window(), 1);
            let bias = noise(shape.out_channels, 2);
            for (size, count) in sizes(&shape).flat_map(|size| [1, 3].map(|count| (size, count))) {
                let input = noise(size.area() * shape.in_channels, 3);
                let (map, threads) = (shape.out_size(size), Threads::new(count));
                let pooled = pool::out_size(map);
                // im2col's products differ with the number of rows: faer picks a kernel by size.
                for algorithm in Algorithm::ALL
                    .into_iter()
                    .filter(|a| *a != Algorithm::Im2col)
                {
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
    fn pooled_convolution_of_bytes_has_the_same_bits_as_one_after_the_other() {
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
