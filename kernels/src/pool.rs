//! Max-pool: `y[oy, ox, c] = max of x[2 oy + dy, 2 ox + dx, c]` over a 3x3 window with stride 2,
//! without padding.
//!
//! Ceil mode: a last window that exceeds the map takes the pixels that exist (`docs/method.md`,
//! section 1.1).
//!
//! Shapes: `[H, W, C] -> [H', W', C]`. Cost: nine loads per output; bound by memory.

use crate::par::Threads;
use crate::simd::{Kernel, Simd};
use crate::{Isa, Size};

/// Size of the output for an input of `size`.
///
/// Panics if a side is below 3.
pub fn out_size(size: Size) -> Size {
    let side = |n: usize| {
        assert!(n >= 3, "input side {n} is smaller than the window 3");
        let out = (n - 3).div_ceil(2) + 1;
        if (out - 1) * 2 >= n { out - 1 } else { out }
    };
    Size {
        h: side(size.h),
        w: side(size.w),
    }
}

/// Some rows of one max-pool.
struct MaxPool<'a> {
    input: &'a [f32], // [size.h, size.w, channels]
    size: Size,
    channels: usize,
    first_row: usize,   // of the output, that `out` starts at
    out: &'a mut [f32], // [rows, W', channels]
}

/// Pools `input` (`[H, W, channels]`) into `out` (`[H', W', channels]`) and returns the output's
/// size.
///
/// Panics if a length is not that of its shape.
pub fn max_pool(
    isa: Isa,
    threads: &Threads,
    input: &[f32],
    size: Size,
    channels: usize,
    out: &mut [f32],
) -> Size {
    over_rows(threads, input, size, channels, out, |first_row, out| {
        isa.run(MaxPool {
            input,
            size,
            channels,
            first_row,
            out,
        });
    })
}

/// As [`max_pool`], on bytes. Quantization is monotonic, so pooling may follow it.
///
/// Panics if a length is not that of its shape.
pub fn max_pool_bytes(
    isa: Isa,
    threads: &Threads,
    input: &[u8],
    size: Size,
    channels: usize,
    out: &mut [u8],
) -> Size {
    over_rows(threads, input, size, channels, out, |first_row, out| {
        isa.run(MaxPoolBytes {
            input,
            size,
            channels,
            first_row,
            out,
        });
    })
}

/// Splits the output's rows over the threads; each thread calls `pool(first_row, rows)`. Returns
/// the output's size.
fn over_rows<T: Send + Sync>(
    threads: &Threads,
    input: &[T],
    size: Size,
    channels: usize,
    out: &mut [T],
    pool: impl Fn(usize, &mut [T]) + Sync,
) -> Size {
    let out_size = out_size(size);
    assert_eq!(input.len(), size.area() * channels, "input of max_pool");
    assert_eq!(out.len(), out_size.area() * channels, "output of max_pool");
    threads.split_rows(out, out_size.w * channels, pool);
    out_size
}

/// Some rows of one max-pool of bytes.
struct MaxPoolBytes<'a> {
    input: &'a [u8], // [size.h, size.w, channels]
    size: Size,
    channels: usize,
    first_row: usize,  // of the output, that `out` starts at
    out: &'a mut [u8], // [rows, W', channels]
}

impl Kernel for MaxPoolBytes<'_> {
    type Output = ();

    /// Plain loops over the channels: the compiler turns them into the instruction set's byte
    /// maxima.
    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let MaxPoolBytes {
            input,
            size,
            channels,
            first_row,
            out,
        } = self;
        for (y, row) in out
            .chunks_exact_mut(out_size(size).w * channels)
            .enumerate()
        {
            let top = 2 * (first_row + y);
            for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
                let left = 2 * x;
                pixel.fill(0);
                for iy in top..(top + 3).min(size.h) {
                    for ix in left..(left + 3).min(size.w) {
                        let from = &input[(iy * size.w + ix) * channels..][..channels];
                        for (max, value) in pixel.iter_mut().zip(from) {
                            *max = (*max).max(*value);
                        }
                    }
                }
            }
        }
    }
}

impl Kernel for MaxPool<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let MaxPool {
            input,
            size,
            channels,
            first_row,
            out,
        } = self;
        for (y, row) in out
            .chunks_exact_mut(out_size(size).w * channels)
            .enumerate()
        {
            let top = 2 * (first_row + y);
            let bottom = (top + 3).min(size.h);
            for (x, pixel) in row.chunks_exact_mut(channels).enumerate() {
                let left = 2 * x;
                let right = (left + 3).min(size.w);
                // At the right and bottom edge a window may lack one column or row.
                let window = &input[(top * size.w + left) * channels..];
                match (bottom - top, right - left) {
                    (3, 3) => largest::<S, 3, 3>(simd, window, size.w * channels, channels, pixel),
                    (3, _) => largest::<S, 3, 2>(simd, window, size.w * channels, channels, pixel),
                    (_, 3) => largest::<S, 2, 3>(simd, window, size.w * channels, channels, pixel),
                    _ => largest::<S, 2, 2>(simd, window, size.w * channels, channels, pixel),
                }
            }
        }
    }
}

/// The maximum over a window of `ROWS x COLUMNS` pixels, whose rows are `row_step` values apart.
#[inline(always)]
fn largest<S: Simd, const ROWS: usize, const COLUMNS: usize>(
    simd: S,
    window: &[f32],
    row_step: usize,
    channels: usize,
    pixel: &mut [f32], // [channels]
) {
    let rows: [&[f32]; ROWS] =
        std::array::from_fn(|i| &window[i * row_step..][..COLUMNS * channels]);
    for (out, c) in pixel.chunks_mut(S::LANES).zip((0..).step_by(S::LANES)) {
        let whole = out.len() == S::LANES;
        let mut max = simd.splat(f32::NEG_INFINITY);
        for row in rows {
            for j in 0..COLUMNS {
                let from = &row[j * channels + c..];
                max = simd.max(
                    if whole {
                        simd.load(from)
                    } else {
                        simd.load_partial(from)
                    },
                    max,
                );
            }
        }
        if whole {
            simd.store(max, out)
        } else {
            simd.store_partial(max, out)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::{assert_close, noise};

    #[test]
    fn max_pool_of_any_channels_and_sides_equals_the_reference() {
        for channels in [1, 3, 4, 5, 7, 8, 9, 15, 16, 17, 47, 48] {
            for (h, w) in [(3, 3), (4, 3), (5, 6), (7, 12), (9, 10)] {
                let size = Size { h, w };
                let input = noise(size.area() * channels, 7);
                let expected = crate::reference::max_pool(size, channels, &input);
                for isa in Isa::available() {
                    for count in [1, 3] {
                        let threads = Threads::new(count);
                        let mut out = vec![f32::NAN; expected.len()];
                        threads.enter(|| max_pool(isa, &threads, &input, size, channels, &mut out));
                        assert_close(
                            &out,
                            &expected,
                            0.0,
                            &format!("{channels} channels, {size:?}, {isa}"),
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn max_pool_of_bytes_equals_that_of_floats() {
        for (channels, h, w) in [(1, 3, 3), (5, 4, 6), (48, 9, 10), (130, 5, 7)] {
            let size = Size { h, w };
            let bytes: Vec<u8> = noise(size.area() * channels, 5)
                .iter()
                .map(|v| (v * 127.0 + 128.0) as u8)
                .collect();
            let floats: Vec<f32> = bytes.iter().map(|b| f32::from(*b)).collect();
            let expected = crate::reference::max_pool(size, channels, &floats);
            for isa in Isa::available() {
                let mut out = vec![9; expected.len()];
                max_pool_bytes(isa, &Threads::new(1), &bytes, size, channels, &mut out);
                assert!(
                    out.iter().zip(&expected).all(|(o, e)| f64::from(*o) == *e),
                    "{isa}"
                );
            }
        }
    }

    #[test]
    fn out_size_follows_ceil_mode() {
        for (n, out) in [(147, 73), (69, 34), (59, 29), (25, 12), (4, 2), (6, 3)] {
            assert_eq!(out_size(Size::square(n)), Size::square(out));
        }
    }
}
