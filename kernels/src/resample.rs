//! Crop and resize: `out[j, i] = bilinear(image, x0 + step_x i, y0 + step_y j)`, rounded to the
//! nearest byte. Taps outside of the image are a constant border (`docs/method.md`, section 2.2).
//!
//! Shapes: `u8 [h, w, 1..=4]` with a stride `-> u8 [D, D, 3]`. Cost: per output row one pass that
//! blends two source rows into one, and `3 D` samples of two taps from it. A column's source
//! coordinate is the same in every row, and is computed once.

use crate::par::Threads;
use crate::simd::{Kernel, Simd};
use crate::{Isa, Size};
use wide::f32x4;

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
    /// Offsets of the three output channels within a pixel.
    pub offsets: [usize; 3],
}

/// Where the samples are taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Source column of output column 0.
    pub x0: f64,
    /// Source row of output row 0.
    pub y0: f64,
    /// Source columns from one output column to the next.
    pub step_x: f64,
    /// Source rows from one output row to the next.
    pub step_y: f64,
    /// Side of the output.
    pub side: usize,
}

/// A source coordinate: the pixel at or before it, and the weight of the next one.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tap {
    first: i32,
    share: f32,
}

impl Tap {
    fn new(x: f64) -> Tap {
        let floor = x.floor();
        Tap {
            first: floor as i32,
            share: (x - floor) as f32,
        }
    }

    /// The indices of both pixels, if they lie in `0..n`.
    fn indices(&self, n: usize) -> [Option<usize>; 2] {
        [self.first, self.first.saturating_add(1)]
            .map(|i| usize::try_from(i).ok().filter(|i| *i < n))
    }
}

/// Scratch space of [`resample`]; grows to the largest crop and frame so far.
#[derive(Clone, Debug, Default)]
pub struct Scratch {
    columns: Vec<Tap>,
    blended: Vec<f32>, // one source row and one sampled row per thread
}

/// Samples `image` on `grid` into `out` (`[side, side, 3]`).
///
/// Panics if a length is not that of its shape, or if the image's rows do not lie within its data.
pub fn resample(
    isa: Isa,
    threads: &Threads,
    image: &Pixels<'_>,
    border: [u8; 3],
    grid: &Grid,
    scratch: &mut Scratch,
    out: &mut [u8],
) {
    let Size { h, w } = image.size;
    assert_eq!(out.len(), grid.side * grid.side * 3, "output of resample");
    assert!(
        image
            .offsets
            .iter()
            .all(|o| *o < image.bytes_per_pixel.min(4)),
        "channels of a pixel"
    );
    assert!(
        h > 0 && w > 0 && image.data.len() >= (h - 1) * image.stride + w * image.bytes_per_pixel
    );
    let Scratch { columns, blended } = scratch;
    columns.clear();
    columns.extend((0..grid.side).map(|i| Tap::new(grid.x0 + grid.step_x * i as f64)));
    let row_len = w * image.bytes_per_pixel + SLACK + 4 * grid.side;
    blended.resize(blended.len().max(row_len * threads.count()), 0.0);
    let columns = &columns[..];
    let inner = inner_columns(columns, w);
    threads.split_rows_with(out, grid.side * 3, 1, blended, |first_row, out, blended| {
        isa.run(Rows {
            image,
            border,
            grid,
            columns,
            inner: inner.clone(),
            first_row,
            blended,
            out,
        });
    });
}

/// Values after a blended row: a sample reads four per pixel, even of pixels with fewer channels.
const SLACK: usize = 3;

/// Output rows between the prefetch of source rows and their use: frames come from memory.
const AHEAD: usize = 2;

/// Some rows of one crop.
struct Rows<'a> {
    image: &'a Pixels<'a>,
    border: [u8; 3],
    grid: &'a Grid,
    columns: &'a [Tap],
    inner: std::ops::Range<usize>, // columns that lie inside
    first_row: usize,              // of the output, that `out` starts at
    blended: &'a mut [f32],        // room for a source row
    out: &'a mut [u8],
}

impl Kernel for Rows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Rows {
            image,
            border,
            grid,
            columns,
            inner,
            first_row,
            blended,
            out,
        } = self;
        let Size { h, w } = image.size;
        let row = |y: usize| &image.data[y * image.stride..][..w * image.bytes_per_pixel];
        let read = match &columns[inner.clone()] {
            [first, .., last] => first.first as usize..last.first as usize + 2,
            _ => 0..0,
        };
        let read = read.start * image.bytes_per_pixel..read.end * image.bytes_per_pixel;
        let mut prefetched = 0; // source rows
        for (j, out) in out.chunks_exact_mut(grid.side * 3).enumerate() {
            let tap = |j: usize| Tap::new(grid.y0 + grid.step_y * (first_row + j) as f64);
            // Prefetch the source rows of a later output row, each of them once.
            let [top, bottom] = tap(j + AHEAD)
                .indices(h)
                .map(|y| y.filter(|y| *y >= prefetched));
            for y in [top, bottom].into_iter().flatten() {
                let bytes = &row(y)[read.clone()];
                for at in (0..bytes.len()).step_by(size_of::<crate::simd::Line>()) {
                    simd.prefetch(bytes, at);
                }
                prefetched = y + 1;
            }
            // Columns left of the image, inside, and right of it.
            let tap = tap(j);
            let rows = tap.indices(h).map(|y| y.map(row));
            let line = Line {
                image,
                border,
                rows,
                share: tap.share,
            };
            let (left, rest) = out.split_at_mut(inner.start * 3);
            let (middle, right) = rest.split_at_mut(inner.len() * 3);
            line.border(&columns[..inner.start], left);
            match rows {
                [Some(top), Some(bottom)] => {
                    line.inner(&columns[inner.clone()], top, bottom, blended, middle)
                }
                _ => line.border(&columns[inner.clone()], middle),
            }
            line.border(&columns[inner.end..], right);
        }
    }
}

/// The columns whose two pixels both lie in a row of `w`.
fn inner_columns(columns: &[Tap], w: usize) -> std::ops::Range<usize> {
    let start = columns.partition_point(|tap| tap.first < 0);
    let end = columns.partition_point(|tap| i64::from(tap.first) + 1 < w as i64);
    start.min(end)..end
}

/// One output row: two source rows, if they exist, and the weight of the lower one.
struct Line<'a> {
    image: &'a Pixels<'a>,
    border: [u8; 3],
    rows: [Option<&'a [u8]>; 2],
    share: f32,
}

impl Line<'_> {
    /// Columns inside the image: blends `top` and `bottom` into one row, then samples that.
    #[inline(always)]
    fn inner(
        &self,
        columns: &[Tap],
        top: &[u8],
        bottom: &[u8],
        blended: &mut [f32],
        out: &mut [u8],
    ) {
        let (bpp, [o0, o1, o2]) = (self.image.bytes_per_pixel, self.image.offsets);
        let ([first, ..], [.., last]) = (columns, columns) else {
            return;
        };
        let origin = first.first as usize;
        let span = origin * bpp..(last.first as usize + 2) * bpp;
        let (sampled, blended) = blended.split_at_mut(4 * columns.len());
        let blended = &mut blended[..span.len() + SLACK];
        for ((value, top), bottom) in blended
            .iter_mut()
            .zip(&top[span.clone()])
            .zip(&bottom[span])
        {
            *value = blend(f32::from(*top), f32::from(*bottom), self.share);
        }
        for (tap, sampled) in columns.iter().zip(sampled.as_chunks_mut::<4>().0) {
            let pixels = &blended[(tap.first as usize - origin) * bpp..][..bpp + 4];
            let left = f32x4::new([pixels[0], pixels[1], pixels[2], pixels[3]]);
            let right = f32x4::new([
                pixels[bpp],
                pixels[bpp + 1],
                pixels[bpp + 2],
                pixels[bpp + 3],
            ]);
            *sampled = (left + (right - left) * tap.share + ROUND).to_array();
        }
        // Adding 2^23 has left the rounded value in the lowest byte of each float.
        let rounded = bytemuck::cast_slice::<f32, u8>(sampled).as_chunks::<16>().0;
        for (bytes, out) in rounded.iter().zip(out.as_chunks_mut::<3>().0) {
            *out = [bytes[low(o0)], bytes[low(o1)], bytes[low(o2)]];
        }
    }

    /// Columns that may lie outside: every tap is checked.
    fn border(&self, columns: &[Tap], out: &mut [u8]) {
        let (bpp, w) = (self.image.bytes_per_pixel, self.image.size.w);
        for (tap, out) in columns.iter().zip(out.chunks_exact_mut(3)) {
            let [left, right] = tap.indices(w);
            for ((value, o), border) in out.iter_mut().zip(self.image.offsets).zip(self.border) {
                let read = |row: Option<&[u8]>, x: Option<usize>| match (row, x) {
                    (Some(row), Some(x)) => row[x * bpp + o],
                    _ => border,
                };
                let [top, bottom] = self.rows;
                let column = |x| {
                    blend(
                        f32::from(read(top, x)),
                        f32::from(read(bottom, x)),
                        self.share,
                    )
                };
                *value = round(blend(column(left), column(right), tap.share));
            }
        }
    }
}

/// `a` and `b`, blended with weight `share` of `b`.
#[inline(always)]
fn blend(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

/// The nearest byte, ties to even, of a value in 0..=255.
#[inline(always)]
fn round(value: f32) -> u8 {
    (value + ROUND).to_bits() as u8
}

/// Index of the lowest byte of value `i`.
#[inline(always)]
fn low(i: usize) -> usize {
    4 * i + if cfg!(target_endian = "big") { 3 } else { 0 }
}

/// 2^23: adding it leaves the rounded value in the low bits of the float.
const ROUND: f32 = 8_388_608.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference;

    fn image(size: Size, bytes_per_pixel: usize, gap: usize) -> (Vec<u8>, usize) {
        let stride = size.w * bytes_per_pixel + gap;
        let data = testing::noise(stride * size.h, 11);
        (
            data.iter().map(|v| (v * 127.0 + 128.0) as u8).collect(),
            stride,
        )
    }

    #[test]
    fn resampled_images_of_any_layout_equal_the_reference() {
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
            let image = Pixels {
                data: &data,
                size,
                stride,
                bytes_per_pixel,
                offsets,
            };
            for grid in [
                Grid {
                    x0: 2.25,
                    y0: 1.5,
                    step_x: 0.31,
                    step_y: 0.31,
                    side: 17,
                },
                Grid {
                    x0: -7.3,
                    y0: -4.9,
                    step_x: 1.9,
                    step_y: 0.7,
                    side: 23,
                },
                Grid {
                    x0: -100.0,
                    y0: 3.0,
                    step_x: 1.0,
                    step_y: 1.0,
                    side: 9,
                },
                Grid {
                    x0: 4.0,
                    y0: 500.0,
                    step_x: 2.5,
                    step_y: 2.5,
                    side: 9,
                },
                Grid {
                    x0: -1.0,
                    y0: -1.0,
                    step_x: 1.0,
                    step_y: 1.0,
                    side: 12,
                },
                Grid {
                    x0: -1e12,
                    y0: 1e12,
                    step_x: 1e9,
                    step_y: 1e9,
                    side: 5,
                },
            ] {
                for (isa, count) in Isa::available()
                    .into_iter()
                    .flat_map(|isa| [(isa, 1), (isa, 3)])
                {
                    let threads = Threads::new(count);
                    let mut out = vec![0; grid.side * grid.side * 3];
                    let mut scratch = Scratch::default();
                    threads.enter(|| {
                        resample(isa, &threads, &image, border, &grid, &mut scratch, &mut out)
                    });
                    for (i, value) in out.iter().enumerate() {
                        let (pixel, channel) = (i / 3, i % 3);
                        let x = grid.x0 + grid.step_x * (pixel % grid.side) as f64;
                        let y = grid.y0 + grid.step_y * (pixel / grid.side) as f64;
                        let expected =
                            reference::sample(&image, offsets[channel], x, y, border[channel]);
                        let error = (f64::from(*value) - expected).abs();
                        assert!(
                            error < 0.501,
                            "{isa} {size:?} {grid:?} at {x},{y}: {value}, expected {expected}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn blended_constants_stay_and_ties_round_to_even() {
        assert_eq!(
            [0.5, 1.5, 2.5, 254.5, 255.0].map(round),
            [0, 2, 2, 254, 255]
        );
        for v in [0.0, 1.0, 127.0, 254.0, 255.0] {
            assert_eq!(blend(v, v, 0.3), v);
        }
    }
}
