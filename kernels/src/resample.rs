//! Crop-and-resize: `out[j, i] = bilinear(image, x0 + step i, y0 + step j)`, each tap that lies outside the image replaced by
//! a constant border; rounded to the nearest byte (spec section 2.2).
//!
//! Shapes: `u8 [h, w, 1..=4]` with a stride -> `u8 [D, D, 3]`. Cost: `3 D^2` samples of four taps, bound by the gather.
//! The source coordinate of a column does not depend on the row, so it is computed once per column.

use crate::Size;
use crate::par::Threads;

/// An image as it lies in memory.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    /// Rows of `stride` bytes.
    pub data: &'a [u8],
    /// Height and width in pixels.
    pub size: Size,
    /// Bytes from one row to the next.
    pub stride: usize,
    /// Bytes from one pixel to the next.
    pub bytes_per_pixel: usize,
    /// Where the three channels wanted lie within a pixel.
    pub offsets: [usize; 3],
}

/// Where the samples are taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Source column of output column 0.
    pub x0: f64,
    /// Source row of output row 0.
    pub y0: f64,
    /// Source pixels from one output pixel to the next.
    pub step: f64,
    /// Side of the output.
    pub side: usize,
}

/// A source coordinate: the pixel at or before it, and the share of the next one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tap {
    first: i32,
    share: f32,
}

impl Tap {
    fn new(x: f64) -> Tap {
        let floor = x.floor();
        Tap { first: floor as i32, share: (x - floor) as f32 }
    }

    /// The two pixels' indices, where they lie within `0..n`.
    fn indices(&self, n: usize) -> [Option<usize>; 2] {
        [self.first, self.first.saturating_add(1)].map(|i| usize::try_from(i).ok().filter(|i| *i < n))
    }
}

/// Samples `image` on `grid` into `out` (`[side, side, 3]`); `columns` is scratch space of `side` taps.
///
/// Panics if a length is not that of its shape, or if the image's rows do not lie within its data.
pub fn resample(
    threads: &Threads,
    image: &Pixels<'_>,
    border: [u8; 3],
    grid: &Grid,
    columns: &mut [Tap],
    out: &mut [u8],
) {
    let Size { h, w } = image.size;
    assert_eq!((columns.len(), out.len()), (grid.side, grid.side * grid.side * 3), "output of resample");
    assert!(image.offsets.iter().all(|o| *o < image.bytes_per_pixel), "channels of a pixel");
    assert!(h > 0 && w > 0 && image.data.len() >= (h - 1) * image.stride + w * image.bytes_per_pixel);
    for (i, tap) in columns.iter_mut().enumerate() {
        *tap = Tap::new(grid.x0 + grid.step * i as f64);
    }
    let inner = inner_columns(columns, w);
    threads.split_rows(out, grid.side * 3, |first_row, out| {
        for (j, out) in out.chunks_exact_mut(grid.side * 3).enumerate() {
            let tap = Tap::new(grid.y0 + grid.step * (first_row + j) as f64);
            let row = |y: usize| &image.data[y * image.stride..][..w * image.bytes_per_pixel];
            let rows = tap.indices(h).map(|y| y.map(row));
            let mut line = Line { image, border, rows, share: tap.share };
            let (left, rest) = out.split_at_mut(inner.start * 3);
            let (middle, right) = rest.split_at_mut(inner.len() * 3);
            line.border(&columns[..inner.start], left);
            match rows {
                [Some(top), Some(bottom)] => line.inner(&columns[inner.clone()], top, bottom, middle),
                _ => line.border(&columns[inner.clone()], middle),
            }
            line.border(&columns[inner.end..], right);
        }
    });
}

/// The columns whose two pixels both lie within a row of `w`.
fn inner_columns(columns: &[Tap], w: usize) -> std::ops::Range<usize> {
    let start = columns.partition_point(|tap| tap.first < 0);
    let end = columns.partition_point(|tap| i64::from(tap.first) + 1 < w as i64);
    start.min(end)..end
}

/// One output row: two source rows, if they exist, and the share of the lower one.
struct Line<'a> {
    image: &'a Pixels<'a>,
    border: [u8; 3],
    rows: [Option<&'a [u8]>; 2],
    share: f32,
}

impl Line<'_> {
    /// Columns that lie inside `top` and `bottom`.
    fn inner(&self, columns: &[Tap], top: &[u8], bottom: &[u8], out: &mut [u8]) {
        let (bpp, [o0, o1, o2]) = (self.image.bytes_per_pixel, self.image.offsets);
        for (tap, out) in columns.iter().zip(out.chunks_exact_mut(3)) {
            let at = tap.first as usize * bpp;
            let (top, bottom) = (&top[at..][..2 * bpp], &bottom[at..][..2 * bpp]);
            for (value, o) in out.iter_mut().zip([o0, o1, o2]) {
                let taps = [top[o], top[o + bpp], bottom[o], bottom[o + bpp]];
                *value = blend(taps, tap.share, self.share);
            }
        }
    }

    /// Columns that may lie outside.
    fn border(&mut self, columns: &[Tap], out: &mut [u8]) {
        let (bpp, w) = (self.image.bytes_per_pixel, self.image.size.w);
        for (tap, out) in columns.iter().zip(out.chunks_exact_mut(3)) {
            let [left, right] = tap.indices(w);
            for ((value, o), border) in out.iter_mut().zip(self.image.offsets).zip(self.border) {
                let read = |row: Option<&[u8]>, x: Option<usize>| match (row, x) {
                    (Some(row), Some(x)) => row[x * bpp + o],
                    _ => border,
                };
                let [top, bottom] = self.rows;
                let taps = [read(top, left), read(top, right), read(bottom, left), read(bottom, right)];
                *value = blend(taps, tap.share, self.share);
            }
        }
    }
}

/// Bilinear blend of `[top left, top right, bottom left, bottom right]`, rounded to the nearest byte, ties to even.
#[inline(always)]
fn blend(taps: [u8; 4], x: f32, y: f32) -> u8 {
    let [a, b, c, d] = taps.map(f32::from);
    let (top, bottom) = (a + (b - a) * x, c + (d - c) * x);
    let value = top + (bottom - top) * y;
    // Adding 2^23 leaves the rounded value in the low bits of the float.
    (value + 8_388_608.0).to_bits() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference;

    fn image(size: Size, bytes_per_pixel: usize, gap: usize) -> (Vec<u8>, usize) {
        let stride = size.w * bytes_per_pixel + gap;
        let data = crate::testing::noise(stride * size.h, 11);
        (data.iter().map(|v| (v * 127.0 + 128.0) as u8).collect(), stride)
    }

    #[test]
    fn equals_the_reference() {
        let border = [3, 120, 255];
        for (h, w, bytes_per_pixel, gap, offsets) in [
            (20, 30, 3, 0, [0, 1, 2]),
            (20, 31, 3, 5, [2, 1, 0]),
            (9, 7, 4, 0, [2, 1, 0]),
            (12, 5, 1, 3, [0, 0, 0]),
            (1, 1, 3, 0, [0, 1, 2]),
        ] {
            let size = Size { h, w };
            let (data, stride) = image(size, bytes_per_pixel, gap);
            let image = Pixels { data: &data, size, stride, bytes_per_pixel, offsets };
            for grid in [
                Grid { x0: 2.25, y0: 1.5, step: 0.31, side: 17 },
                Grid { x0: -7.3, y0: -4.9, step: 1.9, side: 23 },
                Grid { x0: -100.0, y0: 3.0, step: 1.0, side: 9 },
                Grid { x0: 4.0, y0: 500.0, step: 2.5, side: 9 },
                Grid { x0: -1.0, y0: -1.0, step: 1.0, side: 12 },
                Grid { x0: -1e12, y0: 1e12, step: 1e9, side: 5 },
            ] {
                for count in [1, 3] {
                    let threads = Threads::new(count);
                    let mut out = vec![0; grid.side * grid.side * 3];
                    let mut columns = vec![Tap::default(); grid.side];
                    threads.enter(|| resample(&threads, &image, border, &grid, &mut columns, &mut out));
                    for (i, value) in out.iter().enumerate() {
                        let (pixel, channel) = (i / 3, i % 3);
                        let x = grid.x0 + grid.step * (pixel % grid.side) as f64;
                        let y = grid.y0 + grid.step * (pixel / grid.side) as f64;
                        let expected = reference::sample(&image, offsets[channel], x, y, border[channel]);
                        let error = (f64::from(*value) - expected).abs();
                        assert!(error < 0.501, "{size:?} {grid:?} at {x},{y}: {value}, expected {expected}");
                    }
                }
            }
        }
    }

    #[test]
    fn rounds_to_even_and_keeps_constants() {
        assert_eq!(blend([0, 1, 0, 1], 0.5, 0.0), 0);
        assert_eq!(blend([1, 2, 1, 2], 0.5, 0.0), 2);
        for v in [0, 1, 127, 254, 255] {
            assert_eq!(blend([v; 4], 0.3, 0.7), v);
        }
    }
}
