//! Crop and resize: `out[j, i] = bilinear(image, x0 + step_x i, y0 + step_y j)`, rounded to the
//! nearest byte. Taps outside of the image are a constant border (`docs/method.md`, section 2.2).
//!
//! Shapes: a picture `-> u8 [D, D, 3]`, blue, green, red. Cost: per output row one pass that blends
//! two source rows into one, and `3 D` samples of two taps from it. A column's source coordinate is
//! the same in every row, and is computed once. Of YUV the parts of rows that are read are
//! converted first.

use crate::par::Threads;
use crate::pixels::{Pixels, RowReader};
use crate::simd::{Kernel, Simd};
use crate::{Isa, Size};
use wide::f32x4;

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
    blended: Vec<f32>, // one source row, one sampled row and the converted rows per thread
}

/// Samples `image` on `grid` into `out` (`[side, side, 3]`).
///
/// Panics if `out` does not have the length of its shape.
pub fn resample(
    isa: Isa,
    threads: &Threads,
    image: &Pixels<'_>,
    border: [u8; 3],
    grid: &Grid,
    scratch: &mut Scratch,
    out: &mut [u8],
) {
    let Size { w, .. } = image.size();
    let (bytes_per_pixel, _) = image.row_format();
    assert_eq!(out.len(), grid.side * grid.side * 3, "output of resample");
    let Scratch { columns, blended } = scratch;
    columns.clear();
    columns.extend((0..grid.side).map(|i| Tap::new(grid.x0 + grid.step_x * i as f64)));
    let row_len = w * bytes_per_pixel + SLACK + 4 * grid.side + image.row_scratch_len();
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
    blended: &'a mut [f32],        // room for a source row and what is made of it
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
        let Size { h, .. } = image.size();
        let (converted, blended) = blended.split_at_mut(image.row_scratch_len());
        let mut source = RowReader::new(image, columns_read(columns, image.size().w), converted);
        let mut prefetched = 0; // source rows
        for (j, out) in out.chunks_exact_mut(grid.side * 3).enumerate() {
            let tap = |j: usize| Tap::new(grid.y0 + grid.step_y * (first_row + j) as f64);
            // Prefetch the source rows of a later output row, each of them once.
            let [top, bottom] = tap(j + AHEAD)
                .indices(h)
                .map(|y| y.filter(|y| *y >= prefetched));
            for y in [top, bottom].into_iter().flatten() {
                for bytes in source.sources(y) {
                    for at in (0..bytes.len()).step_by(size_of::<crate::simd::Line>()) {
                        simd.prefetch(bytes, at);
                    }
                }
                prefetched = y + 1;
            }
            // Columns left of the image, inside, and right of it.
            let tap = tap(j);
            let rows = tap.indices(h);
            rows.into_iter().flatten().for_each(|y| source.load(y));
            let rows = rows.map(|y| y.map(|y| source.row(y)));
            let line = Line {
                format: image.row_format(),
                w: image.size().w,
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

/// The columns of a row of `w` that are read: those of all taps that lie inside.
fn columns_read(columns: &[Tap], w: usize) -> std::ops::Range<usize> {
    let inside = |x: i64| x.clamp(0, w as i64) as usize;
    match (columns.first(), columns.last()) {
        (Some(first), Some(last)) => inside(first.first.into())..inside(i64::from(last.first) + 2),
        _ => 0..0,
    }
}

/// One output row: two source rows, if they exist, and the weight of the lower one.
struct Line<'a> {
    format: (usize, [usize; 3]), // bytes per pixel, and offsets of the output's channels
    w: usize,
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
        let (bpp, [o0, o1, o2]) = self.format;
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
        let (w, (bpp, offsets)) = (self.w, self.format);
        for (tap, out) in columns.iter().zip(out.chunks_exact_mut(3)) {
            let [left, right] = tap.indices(w);
            for ((value, o), border) in out.iter_mut().zip(offsets).zip(self.border) {
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
    use crate::pixels::{ChannelOrder, Plane};
    use crate::reference;

    const BORDER: [u8; 3] = [3, 120, 255];

    const GRIDS: [Grid; 6] = [
        grid(2.25, 1.5, (0.31, 0.31), 17),
        grid(-7.3, -4.9, (1.9, 0.7), 23),
        grid(-100.0, 3.0, (1.0, 1.0), 9),
        grid(4.0, 500.0, (2.5, 2.5), 9),
        grid(-1.0, -1.0, (1.0, 1.0), 12),
        grid(-1e12, 1e12, (1e9, 1e9), 5),
    ];

    const fn grid(x0: f64, y0: f64, (step_x, step_y): (f64, f64), side: usize) -> Grid {
        Grid {
            x0,
            y0,
            step_x,
            step_y,
            side,
        }
    }

    /// Bytes of noise for the planes of a picture with `gap` bytes behind each row of the first.
    fn planes(order: ChannelOrder, size: Size, gap: usize) -> Vec<(Vec<u8>, usize)> {
        let stride = order.row_bytes(size.w) + gap;
        let noise = |bytes: usize| -> Vec<u8> {
            let noise = testing::noise(bytes, 11);
            noise.iter().map(|v| (v * 127.0 + 128.0) as u8).collect()
        };
        let shapes = order.planes(size, stride);
        shapes
            .map(|shape| (noise(shape.bytes()), shape.stride))
            .collect()
    }

    fn pixels(order: ChannelOrder, size: Size, planes: &[(Vec<u8>, usize)]) -> Pixels<'_> {
        let lent = planes.iter().map(|(data, stride)| Plane {
            data,
            stride: *stride,
        });
        Pixels::new(order, size, &lent.collect::<Vec<_>>())
    }

    fn crop(isa: Isa, threads: usize, image: &Pixels<'_>, grid: &Grid) -> Vec<u8> {
        let threads = Threads::new(threads);
        let mut out = vec![0; grid.side * grid.side * 3];
        let mut scratch = Scratch::default();
        threads.enter(|| resample(isa, &threads, image, BORDER, grid, &mut scratch, &mut out));
        out
    }

    fn runs() -> impl Iterator<Item = (Isa, usize)> {
        Isa::available()
            .into_iter()
            .flat_map(|isa| [(isa, 1), (isa, 3)])
    }

    #[test]
    fn crops_of_every_order_equal_those_of_the_converted_picture() {
        for order in ChannelOrder::ALL {
            for (h, w, gap) in [(40, 60, 0), (41, 63, 7), (9, 7, 3), (2, 1, 0), (1, 2, 5)] {
                let size = Size { h, w };
                let planes = planes(order, size, gap);
                let image = pixels(order, size, &planes);
                let mut rgb = vec![0; 3 * size.area()];
                image.write_rgb(&mut rgb);
                let rgb = [(rgb, 3 * w)];
                let converted = pixels(ChannelOrder::Rgb, size, &rgb);
                let more = [
                    grid(3.7, 2.2, (1.0, 1.0), 31),
                    grid(-5.5, -9.25, (2.75, 3.5), 20),
                    grid(20.1, 30.9, (0.9, 0.4), 57),
                ];
                for grid in GRIDS.iter().chain(&more) {
                    for (isa, threads) in runs() {
                        assert_eq!(
                            crop(isa, threads, &image, grid),
                            crop(isa, threads, &converted, grid),
                            "{isa} {order:?} {size:?} {grid:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn resampled_images_of_any_layout_equal_the_reference() {
        for (h, w, order, gap) in [
            (20, 30, ChannelOrder::Bgr, 0),
            (20, 31, ChannelOrder::Rgb, 5),
            (9, 7, ChannelOrder::Rgba, 0),
            (12, 5, ChannelOrder::Gray, 3),
            (20, 31, ChannelOrder::Nv12, 3),
            (1, 1, ChannelOrder::Bgr, 0),
        ] {
            let size = Size { h, w };
            let planes = planes(order, size, gap);
            let image = pixels(order, size, &planes);
            for grid in GRIDS {
                for (isa, threads) in runs() {
                    let out = crop(isa, threads, &image, &grid);
                    for (i, value) in out.iter().enumerate() {
                        let (pixel, channel) = (i / 3, i % 3);
                        let x = grid.x0 + grid.step_x * (pixel % grid.side) as f64;
                        let y = grid.y0 + grid.step_y * (pixel / grid.side) as f64;
                        let expected = reference::sample(&image, channel, x, y, BORDER[channel]);
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
