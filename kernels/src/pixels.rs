//! Pictures as they lie in memory, and their pixels: the one place that knows layouts and turns YUV
//! into RGB.
//!
//! Conversion follows BT.601 in 8.8 fixed point, chroma repeated over the pixels it covers (what
//! `ffmpeg` does by default). With limited range, for Y in 16..=235 and U, V in 16..=240:
//!
//! ```text
//! R = (298 (Y-16)               + 409 (V-128) + 128) >> 8
//! G = (298 (Y-16) - 100 (U-128) - 208 (V-128) + 128) >> 8
//! B = (298 (Y-16) + 516 (U-128)               + 128) >> 8
//! ```
//!
//! Shapes: planes of `u8 -> [b, g, r, 0]` per pixel. Cost: six multiplications per pixel, of those
//! pixels only that are read.

use crate::simd::{Kernel, Simd};
use crate::{Isa, Size};
use std::ops::Range;

/// Order of a picture's samples in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ChannelOrder {
    /// Three bytes: red, green, blue.
    Rgb,
    /// Three bytes: blue, green, red.
    Bgr,
    /// Four bytes: red, green, blue and an ignored one.
    Rgba,
    /// Four bytes: blue, green, red and an ignored one.
    Bgra,
    /// One byte, used for all three channels.
    Gray,
    /// Plane Y, then U and V interleaved at half the width and half the height.
    Nv12,
    /// Plane Y, then V and U interleaved at half the width and half the height.
    Nv21,
    /// Planes Y, U, V; chroma at half the width and half the height.
    I420,
    /// Planes Y, U, V; chroma at half the width.
    I422,
    /// Planes Y, U, V, all of full size.
    I444,
    /// Y0 U Y1 V for every two pixels of a row.
    Yuyv,
    /// U Y0 V Y1 for every two pixels of a row.
    Uyvy,
}

/// How one plane of a picture lies in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaneShape {
    /// Bytes of samples in a row.
    pub row: usize,
    /// Bytes from one row to the next.
    pub stride: usize,
    /// Rows.
    pub rows: usize,
}

impl PlaneShape {
    /// Bytes up to the last sample; `usize::MAX` if there are more than that.
    pub fn bytes(&self) -> usize {
        self.stride
            .saturating_mul(self.rows - 1)
            .saturating_add(self.row)
    }
}

impl ChannelOrder {
    /// Every order.
    pub const ALL: [ChannelOrder; 12] = [
        ChannelOrder::Rgb,
        ChannelOrder::Bgr,
        ChannelOrder::Rgba,
        ChannelOrder::Bgra,
        ChannelOrder::Gray,
        ChannelOrder::Nv12,
        ChannelOrder::Nv21,
        ChannelOrder::I420,
        ChannelOrder::I422,
        ChannelOrder::I444,
        ChannelOrder::Yuyv,
        ChannelOrder::Uyvy,
    ];

    /// Bytes from one pixel to the next in the first plane.
    pub const fn bytes_per_pixel(self) -> usize {
        match self {
            ChannelOrder::Rgb | ChannelOrder::Bgr => 3,
            ChannelOrder::Rgba | ChannelOrder::Bgra => 4,
            ChannelOrder::Yuyv | ChannelOrder::Uyvy => 2,
            _ => 1,
        }
    }

    /// Bytes of a row of `width` pixels in the first plane.
    pub const fn row_bytes(self, width: usize) -> usize {
        let width = match self {
            ChannelOrder::Yuyv | ChannelOrder::Uyvy => width.next_multiple_of(2),
            _ => width,
        };
        width * self.bytes_per_pixel()
    }

    /// Whether a pixel is bytes of its own, rather than luma with chroma that several share.
    pub const fn is_packed(self) -> bool {
        self.offsets().is_some()
    }

    /// The planes of a picture whose first one has rows `stride` bytes apart, up to three.
    ///
    /// Planes of U or V at half the width have half of the stride, rounded up. Sides are above 0.
    pub fn planes(self, size: Size, stride: usize) -> impl Iterator<Item = PlaneShape> {
        let Size { h, w } = size;
        let (half_w, half_h) = (w.div_ceil(2), h.div_ceil(2));
        let plane = |row, stride, rows| PlaneShape { row, stride, rows };
        let chroma = match self {
            ChannelOrder::Nv12 | ChannelOrder::Nv21 => {
                // Rows of an odd width without gaps are longer than those of luma.
                let row = 2 * half_w;
                [Some(plane(row, stride.max(row), half_h)), None]
            }
            ChannelOrder::I420 => [Some(plane(half_w, stride.div_ceil(2), half_h)); 2],
            ChannelOrder::I422 => [Some(plane(half_w, stride.div_ceil(2), h)); 2],
            ChannelOrder::I444 => [Some(plane(w, stride, h)); 2],
            _ => [None; 2],
        };
        std::iter::once(plane(self.row_bytes(w), stride, h)).chain(chroma.into_iter().flatten())
    }

    /// Offsets of blue, green and red within a packed pixel.
    const fn offsets(self) -> Option<[usize; 3]> {
        match self {
            ChannelOrder::Rgb | ChannelOrder::Rgba => Some([2, 1, 0]),
            ChannelOrder::Bgr | ChannelOrder::Bgra => Some([0, 1, 2]),
            ChannelOrder::Gray => Some([0, 0, 0]),
            _ => None,
        }
    }
}

/// Which luma values are black and white.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LumaRange {
    /// 16 and 235, as video usually has it.
    Limited,
    /// 0 and 255.
    Full,
}

/// Some bytes of a picture with the distance of their rows.
#[derive(Clone, Copy, Debug)]
pub struct Plane<'a> {
    /// Rows of samples; the last one may end after its samples.
    pub data: &'a [u8],
    /// Bytes from one row to the next.
    pub stride: usize,
}

/// A picture as it lies in memory.
#[derive(Clone, Copy, Debug)]
pub struct Pixels<'a> {
    size: Size,
    layout: Layout<'a>,
}

#[derive(Clone, Copy, Debug)]
enum Layout<'a> {
    Packed(Packed<'a>),
    Yuv(Yuv<'a>),
}

/// Pixels of whole bytes.
#[derive(Clone, Copy, Debug)]
struct Packed<'a> {
    plane: Plane<'a>,
    bytes: usize,
    offsets: [usize; 3], // of blue, green, red
}

/// Luma and chroma apart from each other.
#[derive(Clone, Copy, Debug)]
struct Yuv<'a> {
    luma: Samples<'a>,
    u: Samples<'a>,
    v: Samples<'a>,
    across: usize, // pixels of a row that share chroma
    down: usize,   // rows that share chroma
    matrix: Matrix,
}

/// One channel of a picture.
#[derive(Clone, Copy, Debug)]
struct Samples<'a> {
    plane: Plane<'a>, // begins with the first sample
    step: usize,      // bytes from one sample to the next
}

impl<'a> Samples<'a> {
    fn new(plane: Plane<'a>, start: usize, step: usize) -> Samples<'a> {
        let data = &plane.data[start..];
        Samples {
            plane: Plane { data, ..plane },
            step,
        }
    }

    /// Row `y` from sample `x` on.
    #[inline(always)]
    fn from(&self, x: usize, y: usize) -> &'a [u8] {
        &self.plane.data[y * self.plane.stride + x * self.step..]
    }
}

impl<'a> Pixels<'a> {
    /// A picture of these planes, YUV in limited range.
    ///
    /// Panics if there are not as many planes as the order has, or if their rows do not lie within
    /// their data.
    pub fn new(order: ChannelOrder, size: Size, planes: &[Plane<'a>]) -> Pixels<'a> {
        assert!(size.h > 0 && size.w > 0, "sides of a picture");
        let shapes = order.planes(size, 0);
        assert_eq!(shapes.count(), planes.len(), "planes of a picture");
        for (shape, plane) in order.planes(size, 0).zip(planes) {
            let stride = plane.stride;
            let shape = PlaneShape { stride, ..shape };
            assert!(
                shape.row <= stride && shape.bytes() <= plane.data.len(),
                "a plane of {} bytes, expected {shape:?}",
                plane.data.len()
            );
        }
        if let Some(offsets) = order.offsets() {
            let packed = Packed {
                plane: planes[0],
                bytes: order.bytes_per_pixel(),
                offsets,
            };
            return Pixels {
                size,
                layout: Layout::Packed(packed),
            };
        }
        let samples = |plane: usize, start, step| Samples::new(planes[plane], start, step);
        let (luma, u, v) = match order {
            ChannelOrder::Yuyv => (samples(0, 0, 2), samples(0, 1, 4), samples(0, 3, 4)),
            ChannelOrder::Uyvy => (samples(0, 1, 2), samples(0, 0, 4), samples(0, 2, 4)),
            ChannelOrder::Nv12 => (samples(0, 0, 1), samples(1, 0, 2), samples(1, 1, 2)),
            ChannelOrder::Nv21 => (samples(0, 0, 1), samples(1, 1, 2), samples(1, 0, 2)),
            _ => (samples(0, 0, 1), samples(1, 0, 1), samples(2, 0, 1)),
        };
        let (across, down) = match order {
            ChannelOrder::I444 => (1, 1),
            ChannelOrder::Nv12 | ChannelOrder::Nv21 | ChannelOrder::I420 => (2, 2),
            _ => (2, 1),
        };
        Pixels {
            size,
            layout: Layout::Yuv(Yuv {
                luma,
                u,
                v,
                across,
                down,
                matrix: Matrix::bt601(LumaRange::Limited),
            }),
        }
    }

    /// The same picture with YUV in this range.
    pub fn with_range(mut self, range: LumaRange) -> Pixels<'a> {
        if let Layout::Yuv(yuv) = &mut self.layout {
            yuv.matrix = Matrix::bt601(range);
        }
        self
    }

    /// Height and width in pixels.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Blue, green and red of one pixel.
    #[inline(always)]
    pub fn bgr(&self, x: usize, y: usize) -> [u8; 3] {
        match &self.layout {
            Layout::Packed(Packed {
                plane,
                bytes,
                offsets,
            }) => {
                let pixel = &plane.data[y * plane.stride + x * bytes..][..*bytes];
                offsets.map(|offset| pixel[offset])
            }
            Layout::Yuv(yuv) => yuv.bgr(x, y),
        }
    }

    /// Writes the whole picture in RGB: `[h, w, 3]`.
    ///
    /// Panics if `out` does not have that length.
    pub fn write_rgb(&self, out: &mut [u8]) {
        let Size { h, w } = self.size;
        assert_eq!(out.len(), 3 * h * w, "output of write_rgb");
        for (y, row) in out.chunks_exact_mut(3 * w).enumerate() {
            match &self.layout {
                Layout::Packed(Packed {
                    plane,
                    bytes,
                    offsets: [b, g, r],
                }) => {
                    let pixels = plane.data[y * plane.stride..].chunks_exact(*bytes);
                    for (out, pixel) in row.as_chunks_mut::<3>().0.iter_mut().zip(pixels) {
                        *out = [pixel[*r], pixel[*g], pixel[*b]];
                    }
                }
                Layout::Yuv(yuv) => yuv.blocks(y, w, |x, block| {
                    let out = row[3 * x..].as_chunks_mut::<3>().0;
                    for (out, [b, g, r, _]) in out.iter_mut().zip(block) {
                        *out = [*r, *g, *b];
                    }
                }),
            }
        }
    }

    /// Mean of blue, green and red over all pixels, truncated.
    pub fn mean_bgr(&self, isa: Isa) -> [u8; 3] {
        let sums = isa.run(Sums { pixels: self });
        sums.map(|sum| (sum / self.size.area() as u64) as u8)
    }

    /// Bytes from one pixel to the next in the rows of [`RowReader`], and the offsets of blue,
    /// green and red in them.
    pub(crate) fn row_format(&self) -> (usize, [usize; 3]) {
        match &self.layout {
            Layout::Packed(packed) => (packed.bytes, packed.offsets),
            Layout::Yuv(_) => (CONVERTED, [0, 1, 2]),
        }
    }

    /// Values that a [`RowReader`] needs.
    pub(crate) fn row_scratch_len(&self) -> usize {
        match &self.layout {
            Layout::Packed(_) => 0,
            Layout::Yuv(_) => 2 * self.size.w,
        }
    }
}

/// Bytes of a converted pixel: blue, green, red, 0.
const CONVERTED: usize = 4;

/// Pixels that are converted at a time.
const BLOCK: usize = 64;

impl Yuv<'_> {
    #[inline(always)]
    fn bgr(&self, x: usize, y: usize) -> [u8; 3] {
        let (cx, cy) = (x / self.across, y / self.down);
        let (u, v) = (self.u.from(cx, cy)[0], self.v.from(cx, cy)[0]);
        let [b, g, r, _] = self.matrix.bgr(self.luma.from(x, y)[0], u, v);
        [b, g, r]
    }

    /// Converts the pixels of row `y` in `columns` to the same places of `out`, which holds a row.
    /// The pixel that shares chroma with the first one may be written as well.
    #[inline(always)]
    fn convert(&self, y: usize, columns: Range<usize>, out: &mut [[u8; CONVERTED]]) {
        // Steps that are constants make loads of whole vectors with shuffles.
        match (self.luma.step, self.u.step, self.across) {
            (1, 2, _) => self.convert_sized::<1, 2, 2>(y, columns, out),
            (2, ..) => self.convert_sized::<2, 4, 2>(y, columns, out),
            (_, _, 2) => self.convert_sized::<1, 1, 2>(y, columns, out),
            _ => self.convert_sized::<1, 1, 1>(y, columns, out),
        }
    }

    #[inline(always)]
    fn convert_sized<const LUMA: usize, const CHROMA: usize, const ACROSS: usize>(
        &self,
        y: usize,
        columns: Range<usize>,
        out: &mut [[u8; CONVERTED]],
    ) {
        let first = columns.start / ACROSS * ACROSS;
        let whole = first + (columns.end - first) / ACROSS * ACROSS;
        let cy = y / self.down;
        let luma = self.luma.from(0, y);
        let (u, v) = (self.u.from(0, cy), self.v.from(0, cy));
        // Samples of a block are laid out alike, one per pixel, which compilers vectorize. The last
        // block begins early enough to be a whole one.
        let mut x = first;
        while x < whole && whole - first >= BLOCK {
            let at = x.min(whole - BLOCK);
            let chroma = at / ACROSS * CHROMA;
            let last = (BLOCK / ACROSS - 1) * CHROMA;
            let luma = spread::<LUMA, 1>(&luma[at * LUMA..][..(BLOCK - 1) * LUMA + 1]);
            let u = spread::<CHROMA, ACROSS>(&u[chroma..][..last + 1]);
            let v = spread::<CHROMA, ACROSS>(&v[chroma..][..last + 1]);
            let out = &mut out[at..at + BLOCK];
            for (((out, y), u), v) in out.iter_mut().zip(luma).zip(u).zip(v) {
                *out = self.matrix.bgr(y, u, v);
            }
            x = at + BLOCK;
        }
        for (x, out) in out.iter_mut().enumerate().take(columns.end).skip(x) {
            let c = x / ACROSS * CHROMA;
            *out = self.matrix.bgr(luma[x * LUMA], u[c], v[c]);
        }
    }

    /// Converts row `y` of `w` pixels piece by piece; `work` gets a piece and its first column.
    #[inline(always)]
    fn blocks(&self, y: usize, w: usize, mut work: impl FnMut(usize, &[[u8; CONVERTED]])) {
        const PIECE: usize = 2 * BLOCK;
        let mut converted = [[0; CONVERTED]; PIECE];
        for x in (0..w).step_by(PIECE) {
            let piece = Yuv {
                luma: Samples::new(self.luma.plane, x * self.luma.step, self.luma.step),
                u: Samples::new(self.u.plane, x / self.across * self.u.step, self.u.step),
                v: Samples::new(self.v.plane, x / self.across * self.v.step, self.v.step),
                ..*self
            };
            let count = PIECE.min(w - x);
            piece.convert(y, 0..count, &mut converted);
            work(x, &converted[..count]);
        }
    }
}

/// Every `STEP`th sample, each for `TIMES` pixels.
#[inline(always)]
fn spread<const STEP: usize, const TIMES: usize>(samples: &[u8]) -> [u8; BLOCK] {
    let mut out = [0; BLOCK];
    for (i, out) in out.chunks_exact_mut(TIMES).enumerate() {
        out.fill(samples[i * STEP]);
    }
    out
}

/// Rows of a picture, packed: lent where they lie so, else converted. Of each row only some columns
/// are there. Two neighboring rows are held at a time.
pub(crate) struct RowReader<'a, 'b> {
    pixels: &'b Pixels<'a>,
    columns: Range<usize>,
    rows: [&'b mut [[u8; CONVERTED]]; 2], // row y is in `rows[y % 2]`
    held: [Option<usize>; 2],
}

impl<'a, 'b> RowReader<'a, 'b> {
    /// Reads `columns`; `scratch` has [`Pixels::row_scratch_len`] values.
    #[inline(always)]
    pub(crate) fn new(
        pixels: &'b Pixels<'a>,
        columns: Range<usize>,
        scratch: &'b mut [f32],
    ) -> RowReader<'a, 'b> {
        let scratch = bytemuck::cast_slice_mut(scratch);
        let (even, odd) = scratch.split_at_mut(scratch.len() / 2);
        RowReader {
            pixels,
            columns,
            rows: [even, odd],
            held: [None; 2],
        }
    }

    /// Makes a row ready for [`row`](Self::row).
    #[inline(always)]
    pub(crate) fn load(&mut self, y: usize) {
        if let Layout::Yuv(yuv) = &self.pixels.layout
            && self.held[y % 2] != Some(y)
            && !self.columns.is_empty()
        {
            yuv.convert(y, self.columns.clone(), self.rows[y % 2]);
            self.held[y % 2] = Some(y);
        }
    }

    /// A loaded row.
    #[inline(always)]
    pub(crate) fn row(&self, y: usize) -> &[u8] {
        match &self.pixels.layout {
            Layout::Packed(Packed { plane, bytes, .. }) => {
                &plane.data[y * plane.stride..][..self.pixels.size.w * bytes]
            }
            Layout::Yuv(_) => self.rows[y % 2].as_flattened(),
        }
    }

    /// The bytes from which a row is made, up to three pieces.
    #[inline(always)]
    pub(crate) fn sources(&self, y: usize) -> [&'a [u8]; 3] {
        let Range { start, end } = self.columns.clone();
        if start >= end {
            return [&[]; 3];
        }
        match &self.pixels.layout {
            Layout::Packed(Packed { plane, bytes, .. }) => {
                let row = &plane.data[y * plane.stride..];
                [&row[start * bytes..end * bytes], &[], &[]]
            }
            Layout::Yuv(yuv) => {
                let cy = y / yuv.down;
                let count = (end - start).div_ceil(yuv.across);
                let piece = |samples: &Samples<'a>, x, y, count: usize| {
                    let row = samples.from(x, y);
                    &row[..row.len().min(count * samples.step)]
                };
                let luma = piece(&yuv.luma, start, y, end - start);
                let u = piece(&yuv.u, start / yuv.across, cy, count);
                let v = piece(&yuv.v, start / yuv.across, cy, count);
                match yuv.u.step {
                    1 => [luma, u, v],
                    2 => [luma, u, &[]], // V lies between
                    _ => [luma, &[], &[]],
                }
            }
        }
    }
}

/// Sums of blue, green and red over a picture.
struct Sums<'a> {
    pixels: &'a Pixels<'a>,
}

impl Kernel for Sums<'_> {
    type Output = [u64; 3];

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> [u64; 3] {
        let Size { h, w } = self.pixels.size;
        let (bytes, offsets) = self.pixels.row_format();
        let mut sums = [0u64; LANES];
        for y in 0..h {
            // Holds a row of 2^15 pixels of 255.
            let mut row_sums = [0u32; LANES];
            match &self.pixels.layout {
                Layout::Packed(Packed { plane, .. }) => {
                    add_bytes(&plane.data[y * plane.stride..][..w * bytes], &mut row_sums);
                }
                Layout::Yuv(yuv) => {
                    yuv.blocks(y, w, |_, block| {
                        add_bytes(block.as_flattened(), &mut row_sums);
                    });
                }
            }
            for (sum, row_sum) in sums.iter_mut().zip(row_sums) {
                *sum += u64::from(row_sum);
            }
        }
        offsets.map(|offset| sums.iter().skip(offset).step_by(bytes).sum())
    }
}

/// Bytes that are summed apart from each other: a multiple of 1, 3 and 4 bytes per pixel.
const LANES: usize = 48;

/// Adds the bytes of whole pixels to the sums of their places in a chunk.
#[inline(always)]
fn add_bytes(bytes: &[u8], sums: &mut [u32; LANES]) {
    let (chunks, rest) = bytes.as_chunks::<LANES>();
    for chunk in chunks {
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum += u32::from(chunk[i]);
        }
    }
    for (sum, byte) in sums.iter_mut().zip(rest) {
        *sum += u32::from(*byte);
    }
}

/// YUV to RGB in 8.8 fixed point.
#[derive(Clone, Copy, Debug)]
struct Matrix {
    black: i32,
    y: i32,
    red_v: i32,
    green_u: i32,
    green_v: i32,
    blue_u: i32,
}

impl Matrix {
    fn bt601(range: LumaRange) -> Matrix {
        match range {
            LumaRange::Limited => Matrix {
                black: 16,
                y: 298,
                red_v: 409,
                green_u: -100,
                green_v: -208,
                blue_u: 516,
            },
            LumaRange::Full => Matrix {
                black: 0,
                y: 256,
                red_v: 359,
                green_u: -88,
                green_v: -183,
                blue_u: 454,
            },
        }
    }

    /// Blue, green, red, 0.
    #[inline(always)]
    fn bgr(&self, y: u8, u: u8, v: u8) -> [u8; CONVERTED] {
        let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
        let y = self.y * (i32::from(y) - self.black) + 128;
        let byte = |sum: i32| (sum >> 8).clamp(0, 255) as u32;
        let blue = byte(y + self.blue_u * u);
        let green = byte(y + self.green_u * u + self.green_v * v);
        let red = byte(y + self.red_v * v);
        (blue | green << 8 | red << 16).to_le_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: Size = Size { h: 3, w: 5 };
    const LUMA: [u8; 15] = [
        40, 49, 58, 67, 76, 85, 94, 103, 112, 121, 130, 139, 148, 157, 166,
    ];
    /// Chroma, constant over blocks of 2 x 2 pixels.
    const U: [u8; 6] = [100, 140, 90, 120, 150, 80];
    const V: [u8; 6] = [90, 150, 120, 200, 60, 110];

    /// The same picture in an order, its planes one behind the other.
    fn picture(order: ChannelOrder) -> Vec<u8> {
        let (Size { h, w }, at) = (SIZE, |x: usize, y: usize| y / 2 * 3 + x / 2);
        let chroma = |plane: &[u8; 6], step: usize| -> Vec<u8> {
            let row = |y| (0..w).step_by(step).map(move |x| (x, y));
            (0..h).flat_map(row).map(|(x, y)| plane[at(x, y)]).collect()
        };
        let luma = |x: usize, y: usize| if x < w { LUMA[y * w + x] } else { 0 };
        let pairs = (0..h).flat_map(|y| (0..w).step_by(2).map(move |x| (x, y)));
        let (u, v) = (|x, y| U[at(x, y)], |x, y| V[at(x, y)]);
        match order {
            ChannelOrder::I420 => [&LUMA[..], &U, &V].concat(),
            ChannelOrder::I422 => [&LUMA[..], &chroma(&U, 2), &chroma(&V, 2)].concat(),
            ChannelOrder::I444 => [&LUMA[..], &chroma(&U, 1), &chroma(&V, 1)].concat(),
            ChannelOrder::Nv12 => {
                let both = U.iter().zip(V).flat_map(|(u, v)| [*u, v]);
                LUMA.into_iter().chain(both).collect()
            }
            ChannelOrder::Nv21 => {
                let both = U.iter().zip(V).flat_map(|(u, v)| [v, *u]);
                LUMA.into_iter().chain(both).collect()
            }
            ChannelOrder::Yuyv => pairs
                .flat_map(|(x, y)| [luma(x, y), u(x, y), luma(x + 1, y), v(x, y)])
                .collect(),
            ChannelOrder::Uyvy => pairs
                .flat_map(|(x, y)| [u(x, y), luma(x, y), v(x, y), luma(x + 1, y)])
                .collect(),
            _ => panic!("{order:?} has no chroma"),
        }
    }

    fn pixels(order: ChannelOrder, size: Size, bytes: &[u8]) -> Pixels<'_> {
        let mut rest = bytes;
        let mut planes = Vec::new();
        for PlaneShape { stride, rows, .. } in order.planes(size, order.row_bytes(size.w)) {
            let (data, behind) = rest.split_at(stride * rows);
            planes.push(Plane { data, stride });
            rest = behind;
        }
        assert!(rest.is_empty(), "{order:?}");
        Pixels::new(order, size, &planes)
    }

    fn rgb(image: &Pixels<'_>) -> Vec<u8> {
        let mut out = vec![0; 3 * image.size().area()];
        image.write_rgb(&mut out);
        out
    }

    #[test]
    fn primaries_and_grays_convert_as_bt601_says() {
        // Against the formula in floating point: full-scale primaries of BT.601 and grays.
        for ([y, u, v], rgb) in [
            ([16, 128, 128], [0, 0, 0]),
            ([235, 128, 128], [255, 255, 255]),
            ([126, 128, 128], [128, 128, 128]),
            ([81, 90, 240], [255, 0, 0]),
            ([145, 54, 34], [0, 255, 0]),
            ([41, 240, 110], [0, 0, 255]),
            ([0, 128, 128], [0, 0, 0]),
            ([255, 128, 128], [255, 255, 255]),
        ] {
            let [b, g, r, _] = Matrix::bt601(LumaRange::Limited).bgr(y, u, v);
            for (found, expected) in [r, g, b].into_iter().zip(rgb) {
                assert!(
                    i32::from(found).abs_diff(expected) <= 2,
                    "{y} {u} {v}: {found} for {expected}"
                );
            }
        }
        assert_eq!(
            Matrix::bt601(LumaRange::Full).bgr(77, 128, 128),
            [77, 77, 77, 0]
        );
    }

    #[test]
    fn same_picture_in_every_yuv_order_gives_the_same_rgb() {
        let i420 = picture(ChannelOrder::I420);
        let expected = rgb(&pixels(ChannelOrder::I420, SIZE, &i420));
        let [b, g, r, _] = Matrix::bt601(LumaRange::Limited).bgr(40, 100, 90);
        assert_eq!(expected[..3], [r, g, b]);

        for order in ChannelOrder::ALL {
            if order.is_packed() {
                continue;
            }
            let bytes = picture(order);
            let image = pixels(order, SIZE, &bytes);

            assert_eq!(rgb(&image), expected, "{order:?}");
            for (i, rgb) in expected.chunks(3).enumerate() {
                let [b, g, r] = image.bgr(i % SIZE.w, i / SIZE.w);
                assert_eq!([r, g, b], rgb, "{order:?}");
            }
        }
    }

    #[test]
    fn mean_of_every_order_is_that_of_its_pixels() {
        for order in ChannelOrder::ALL {
            for size in [
                Size { h: 1, w: 1 },
                Size { h: 3, w: 5 },
                Size { h: 7, w: 301 },
            ] {
                let shapes = order.planes(size, order.row_bytes(size.w));
                let bytes: usize = shapes.map(|shape| shape.stride * shape.rows).sum();
                let bytes: Vec<u8> = (0..bytes).map(|i| (i * i % 251) as u8).collect();
                let image = pixels(order, size, &bytes);
                let mut sums = [0u64; 3];
                for i in 0..size.area() {
                    let pixel = image.bgr(i % size.w, i / size.w);
                    for (sum, value) in sums.iter_mut().zip(pixel) {
                        *sum += u64::from(value);
                    }
                }
                let expected = sums.map(|sum| (sum / size.area() as u64) as u8);

                for isa in Isa::available() {
                    assert_eq!(image.mean_bgr(isa), expected, "{isa} {order:?} {size:?}");
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "a plane of 14 bytes")]
    fn plane_that_ends_early_panics() {
        let planes = [Plane {
            data: &LUMA[..14],
            stride: 5,
        }];
        Pixels::new(ChannelOrder::Gray, SIZE, &planes);
    }
}
