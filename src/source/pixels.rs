//! Layouts of headerless frames, and YUV to RGB.
//!
//! Conversion follows BT.601 in 8.8 fixed point, chroma repeated over the pixels it covers (what
//! `ffmpeg` does by default). With limited range, for Y in 16..=235 and U, V in 16..=240:
//!
//! ```text
//! R = (298 (Y-16)               + 409 (V-128) + 128) >> 8
//! G = (298 (Y-16) - 100 (U-128) - 208 (V-128) + 128) >> 8
//! B = (298 (Y-16) + 516 (U-128)               + 128) >> 8
//! ```

use super::{MAX_FRAME_BYTES, Stretch};
use crate::frame::{ChannelOrder, Frame};

/// How the pixels of one frame follow each other; the names are ffmpeg's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PixelFormat {
    /// Three bytes a pixel: blue, green, red.
    Bgr24,
    /// Three bytes a pixel: red, green, blue.
    Rgb24,
    /// Four bytes a pixel: blue, green, red, and one that is ignored.
    Bgra,
    /// Four bytes a pixel: red, green, blue, and one that is ignored.
    Rgba,
    /// One byte a pixel.
    Gray,
    /// Two bytes a pixel, the lower one first: stretched to one by the rule of [`Stretch`].
    Gray16Le,
    /// Planes Y, U, V; chroma at half the width and half the height.
    Yuv420p,
    /// Plane Y, then U and V interleaved at half the width and half the height.
    Nv12,
    /// Plane Y, then V and U interleaved at half the width and half the height.
    Nv21,
    /// Y0 U Y1 V for every two pixels of a row.
    Yuyv422,
    /// U Y0 V Y1 for every two pixels of a row.
    Uyvy422,
    /// Planes Y, U, V; chroma at half the width.
    Yuv422p,
    /// Planes Y, U, V, all of full size.
    Yuv444p,
}

impl PixelFormat {
    /// Every format with the name that ffmpeg, and the command line, give it.
    pub const NAMES: [(&'static str, PixelFormat); 13] = [
        ("bgr24", PixelFormat::Bgr24),
        ("rgb24", PixelFormat::Rgb24),
        ("bgra", PixelFormat::Bgra),
        ("rgba", PixelFormat::Rgba),
        ("gray", PixelFormat::Gray),
        ("gray16le", PixelFormat::Gray16Le),
        ("yuv420p", PixelFormat::Yuv420p),
        ("nv12", PixelFormat::Nv12),
        ("nv21", PixelFormat::Nv21),
        ("yuyv422", PixelFormat::Yuyv422),
        ("uyvy422", PixelFormat::Uyvy422),
        ("yuv422p", PixelFormat::Yuv422p),
        ("yuv444p", PixelFormat::Yuv444p),
    ];

    /// The names that V4L2 and GStreamer give these formats, in lower case.
    const OTHER_NAMES: [(&'static str, PixelFormat); 12] = [
        ("bgr", PixelFormat::Bgr24),
        ("rgb", PixelFormat::Rgb24),
        ("bgr0", PixelFormat::Bgra),
        ("rgb0", PixelFormat::Rgba),
        ("bgrx", PixelFormat::Bgra),
        ("rgbx", PixelFormat::Rgba),
        ("gray8", PixelFormat::Gray),
        ("gray16_le", PixelFormat::Gray16Le),
        ("i420", PixelFormat::Yuv420p),
        ("yuyv", PixelFormat::Yuyv422),
        ("yuy2", PixelFormat::Yuyv422),
        ("uyvy", PixelFormat::Uyvy422),
    ];

    /// The format of this name, if there is one; V4L2's and GStreamer's names are known as well.
    pub fn from_name(name: &str) -> Option<PixelFormat> {
        let mut known = Self::NAMES.iter().chain(&Self::OTHER_NAMES);
        let found = known.find(|(known, _)| known.eq_ignore_ascii_case(name));
        found.map(|&(_, format)| format)
    }
}

/// A headerless frame: its size in pixels and their layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawFormat {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Layout of the pixels.
    pub pixels: PixelFormat,
    /// Bytes from one row of the first plane to the next; `None` for rows without gaps. Planes of
    /// half the width have half of it.
    pub stride: Option<usize>,
}

/// A plane of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Plane {
    row: usize, // bytes of pixels
    stride: usize,
    rows: usize,
}

/// Which luma values are black and white.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Range {
    /// 16 and 235, as video usually has it.
    Limited,
    /// 0 and 255.
    Full,
}

impl RawFormat {
    /// Frames whose rows follow each other without gaps.
    pub fn new(width: usize, height: usize, pixels: PixelFormat) -> RawFormat {
        RawFormat {
            width,
            height,
            pixels,
            stride: None,
        }
    }

    /// The planes of a frame, up to three.
    fn planes(&self) -> impl Iterator<Item = Plane> {
        let (w, h) = (self.width, self.height);
        let (half_w, half_h) = (w.div_ceil(2), h.div_ceil(2));
        let none = (0, 0);
        let planes = match self.pixels {
            PixelFormat::Bgr24 | PixelFormat::Rgb24 => [(3 * w, h), none, none],
            PixelFormat::Bgra | PixelFormat::Rgba => [(4 * w, h), none, none],
            PixelFormat::Gray => [(w, h), none, none],
            PixelFormat::Gray16Le => [(2 * w, h), none, none],
            PixelFormat::Yuv420p => [(w, h), (half_w, half_h), (half_w, half_h)],
            PixelFormat::Nv12 | PixelFormat::Nv21 => [(w, h), (2 * half_w, half_h), none],
            PixelFormat::Yuyv422 | PixelFormat::Uyvy422 => [(4 * half_w, h), none, none],
            PixelFormat::Yuv422p => [(w, h), (half_w, h), (half_w, h)],
            PixelFormat::Yuv444p => [(w, h), (w, h), (w, h)],
        };
        let is_halved = matches!(self.pixels, PixelFormat::Yuv420p | PixelFormat::Yuv422p);
        let stride = self.stride;
        planes
            .into_iter()
            .enumerate()
            .filter(|(_, (row, _))| *row > 0)
            .map(move |(index, (row, rows))| Plane {
                row,
                stride: match stride {
                    None => row,
                    Some(stride) if is_halved && index > 0 => stride.div_ceil(2),
                    Some(stride) => stride,
                },
                rows,
            })
    }

    /// Whether rows are followed by bytes that are no pixels.
    fn has_gaps(&self) -> bool {
        self.planes().any(|plane| plane.stride > plane.row)
    }

    /// Copies the rows of a frame without the gaps behind them.
    fn close_gaps(&self, bytes: &[u8], out: &mut Vec<u8>) {
        out.clear();
        let mut rest = bytes;
        for plane in self.planes() {
            let (rows, behind) = rest.split_at(plane.stride * plane.rows);
            for row in rows.chunks_exact(plane.stride) {
                out.extend_from_slice(&row[..plane.row]);
            }
            rest = behind;
        }
    }

    /// Bytes of one frame, with the gaps behind its rows.
    ///
    /// # Errors
    /// If a side is 0 or above [`Frame::MAX_SIDE`], if the stride is shorter than a row, or if a
    /// frame would take more than [`MAX_FRAME_BYTES`].
    pub fn frame_bytes(&self) -> Result<usize, String> {
        let (w, h, max) = (self.width, self.height, Frame::MAX_SIDE);
        if !(1..=max).contains(&w) || !(1..=max).contains(&h) {
            return Err(format!(
                "frames of {w}x{h} pixels, expected sides from 1 to {max}"
            ));
        }
        let mut bytes = 0u64;
        for plane in self.planes() {
            if plane.stride < plane.row {
                return Err(format!(
                    "a stride of {} bytes is too short for rows of {w} pixels",
                    self.stride.unwrap_or_default()
                ));
            }
            bytes = bytes.saturating_add((plane.stride as u64).saturating_mul(plane.rows as u64));
        }
        // YUV becomes RGB, so that counts as well.
        if bytes.max(3 * w as u64 * h as u64) > MAX_FRAME_BYTES {
            return Err(format!(
                "frames of {w}x{h} pixels, expected at most {MAX_FRAME_BYTES} bytes each"
            ));
        }
        Ok(bytes as usize)
    }

    /// The order of a frame whose bytes need no conversion.
    pub(super) fn ready(&self) -> Option<ChannelOrder> {
        self.order().filter(|_| !self.has_gaps())
    }

    /// The order of pixels that need no conversion.
    fn order(&self) -> Option<ChannelOrder> {
        match self.pixels {
            PixelFormat::Bgra => Some(ChannelOrder::Bgra),
            PixelFormat::Rgba => Some(ChannelOrder::Rgba),
            PixelFormat::Bgr24 => Some(ChannelOrder::Bgr),
            PixelFormat::Rgb24 => Some(ChannelOrder::Rgb),
            PixelFormat::Gray => Some(ChannelOrder::Gray),
            _ => None,
        }
    }

    /// Converts one frame into `out` and returns how its pixels are to be read.
    ///
    /// `bytes` has the length of [`frame_bytes`](Self::frame_bytes).
    pub(super) fn convert(
        &self,
        range: Range,
        bytes: &[u8],
        stretch: &mut Stretch,
        out: &mut Vec<u8>,
    ) -> ChannelOrder {
        if let Some(order) = self.order() {
            self.close_gaps(bytes, out);
            return order;
        }
        let mut without_gaps = Vec::new();
        let bytes = if self.has_gaps() {
            self.close_gaps(bytes, &mut without_gaps);
            &without_gaps
        } else {
            bytes
        };
        if self.pixels == PixelFormat::Gray16Le {
            let samples: Vec<u16> = bytes
                .chunks_exact(2)
                .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
                .collect();
            stretch.to_bytes(&samples, out);
            return ChannelOrder::Gray;
        }
        out.resize(3 * self.width * self.height, 0);
        self.yuv_to_rgb(range, bytes, out);
        ChannelOrder::Rgb
    }

    /// Converts one frame of a YUV layout; `rgb` is `[H, W, 3]`.
    fn yuv_to_rgb(&self, range: Range, bytes: &[u8], rgb: &mut [u8]) {
        let (w, h) = (self.width, self.height);
        let (half_w, half_h) = (w.div_ceil(2), h.div_ceil(2));
        let matrix = Matrix::bt601(range);
        let (luma, chroma) = bytes.split_at(w * h); // every layout has that many at least
        for (y, out) in rgb.chunks_exact_mut(3 * w).enumerate() {
            match self.pixels {
                PixelFormat::Yuyv422 | PixelFormat::Uyvy422 => {
                    let row = &bytes[y * 4 * half_w..][..4 * half_w];
                    let is_luma_first = self.pixels == PixelFormat::Yuyv422;
                    for (pixels, group) in out.chunks_mut(6).zip(row.as_chunks::<4>().0) {
                        let [y0, u, y1, v] = if is_luma_first {
                            *group
                        } else {
                            [group[1], group[0], group[3], group[2]]
                        };
                        for (pixel, luma) in pixels.chunks_exact_mut(3).zip([y0, y1]) {
                            pixel.copy_from_slice(&matrix.rgb(luma, u, v));
                        }
                    }
                }
                PixelFormat::Nv12 | PixelFormat::Nv21 => {
                    let pairs = &chroma[y / 2 * 2 * half_w..][..2 * half_w];
                    let pairs = pairs.chunks_exact(2).map(|pair| (pair[0], pair[1]));
                    let row = &luma[y * w..];
                    if self.pixels == PixelFormat::Nv12 {
                        convert_row(&matrix, out, row, pairs, 2);
                    } else {
                        convert_row(&matrix, out, row, pairs.map(|(v, u)| (u, v)), 2);
                    }
                }
                _ => {
                    let (across, chroma_w, down, chroma_h) = match self.pixels {
                        PixelFormat::Yuv420p => (2, half_w, 2, half_h),
                        PixelFormat::Yuv422p => (2, half_w, 1, h),
                        _ => (1, w, 1, h),
                    };
                    let (u, v) = chroma.split_at(chroma_w * chroma_h);
                    let start = y / down * chroma_w;
                    let (u, v) = (&u[start..][..chroma_w], &v[start..][..chroma_w]);
                    let uv = u.iter().copied().zip(v.iter().copied());
                    convert_row(&matrix, out, &luma[y * w..], uv, across);
                }
            }
        }
    }
}

/// One row: every chroma pair covers `across` pixels.
#[inline(always)]
fn convert_row(
    matrix: &Matrix,
    rgb: &mut [u8],
    luma: &[u8],
    chroma: impl Iterator<Item = (u8, u8)>,
    across: usize,
) {
    for ((pixels, luma), (u, v)) in rgb
        .chunks_mut(3 * across)
        .zip(luma.chunks(across))
        .zip(chroma)
    {
        for (pixel, &y) in pixels.chunks_exact_mut(3).zip(luma) {
            pixel.copy_from_slice(&matrix.rgb(y, u, v));
        }
    }
}

/// YUV to RGB in 8.8 fixed point.
struct Matrix {
    black: i32,
    y: i32,
    red_v: i32,
    green_u: i32,
    green_v: i32,
    blue_u: i32,
}

impl Matrix {
    fn bt601(range: Range) -> Matrix {
        match range {
            Range::Limited => Matrix {
                black: 16,
                y: 298,
                red_v: 409,
                green_u: -100,
                green_v: -208,
                blue_u: 516,
            },
            Range::Full => Matrix {
                black: 0,
                y: 256,
                red_v: 359,
                green_u: -88,
                green_v: -183,
                blue_u: 454,
            },
        }
    }

    #[inline(always)]
    fn rgb(&self, y: u8, u: u8, v: u8) -> [u8; 3] {
        let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
        let y = self.y * (i32::from(y) - self.black) + 128;
        [
            y + self.red_v * v,
            y + self.green_u * u + self.green_v * v,
            y + self.blue_u * u,
        ]
        .map(|sum| (sum >> 8).clamp(0, 255) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn convert(width: usize, height: usize, pixels: PixelFormat, bytes: &[u8]) -> Vec<u8> {
        let raw = RawFormat::new(width, height, pixels);
        assert_eq!(raw.frame_bytes().unwrap(), bytes.len());
        let mut rgb = vec![0; 3 * width * height];
        raw.yuv_to_rgb(Range::Limited, bytes, &mut rgb);
        rgb
    }

    #[test]
    fn primaries_and_grays_convert_as_bt601_says() {
        // Against the formula in floating point: full-scale primaries of BT.601 and grays.
        for (yuv, rgb) in [
            ([16, 128, 128], [0, 0, 0]),
            ([235, 128, 128], [255, 255, 255]),
            ([126, 128, 128], [128, 128, 128]),
            ([81, 90, 240], [255, 0, 0]),
            ([145, 54, 34], [0, 255, 0]),
            ([41, 240, 110], [0, 0, 255]),
            ([0, 128, 128], [0, 0, 0]),
            ([255, 128, 128], [255, 255, 255]),
        ] {
            let found = Matrix::bt601(Range::Limited).rgb(yuv[0], yuv[1], yuv[2]);
            for (found, expected) in found.into_iter().zip(rgb) {
                assert!(
                    i32::from(found).abs_diff(expected) <= 2,
                    "{yuv:?}: {found} for {expected}"
                );
            }
        }
        assert_eq!(Matrix::bt601(Range::Full).rgb(77, 128, 128), [77; 3]);
    }

    #[test]
    fn same_picture_in_every_layout_gives_the_same_rgb() {
        // The same picture in every layout: chroma constant over 2x2 blocks, odd width and height.
        let (w, h) = (5, 3);
        let luma: Vec<u8> = (0..w * h).map(|i| 40 + 9 * i as u8).collect();
        let (u, v) = ([100, 140, 90, 120, 150, 80], [90, 150, 120, 200, 60, 110]); // 3x2
        let at = |plane: &[u8; 6], x: usize, y: usize| plane[y / 2 * 3 + x / 2];
        let plane = |p: &[u8; 6], step: usize| -> Vec<u8> {
            (0..h)
                .flat_map(|y| (0..w).step_by(step).map(move |x| (x, y)))
                .map(|(x, y)| at(p, x, y))
                .collect()
        };
        let yuv420: Vec<u8> = luma.iter().chain(&u).chain(&v).copied().collect();
        let expected = convert(w, h, PixelFormat::Yuv420p, &yuv420);
        let nv12: Vec<u8> = luma
            .iter()
            .copied()
            .chain(u.iter().zip(&v).flat_map(|(&u, &v)| [u, v]))
            .collect();
        assert_eq!(convert(w, h, PixelFormat::Nv12, &nv12), expected);
        let mut nv21 = nv12.clone();
        for pair in nv21[w * h..].chunks_exact_mut(2) {
            pair.swap(0, 1);
        }
        assert_eq!(convert(w, h, PixelFormat::Nv21, &nv21), expected);
        for (format, step) in [(PixelFormat::Yuv422p, 2), (PixelFormat::Yuv444p, 1)] {
            let bytes = [luma.clone(), plane(&u, step), plane(&v, step)].concat();
            assert_eq!(convert(w, h, format, &bytes), expected, "{format:?}");
        }
        let mut yuyv = Vec::new();
        for y in 0..h {
            for x in (0..w).step_by(2) {
                let second = if x + 1 < w { luma[y * w + x + 1] } else { 0 };
                yuyv.extend([luma[y * w + x], at(&u, x, y), second, at(&v, x, y)]);
            }
        }
        assert_eq!(convert(w, h, PixelFormat::Yuyv422, &yuyv), expected);
        let uyvy: Vec<u8> = yuyv
            .chunks_exact(2)
            .flat_map(|pair| [pair[1], pair[0]])
            .collect();
        assert_eq!(convert(w, h, PixelFormat::Uyvy422, &uyvy), expected);
        assert_eq!(
            &expected[..3],
            &Matrix::bt601(Range::Limited).rgb(40, 100, 90)
        );
    }

    #[test]
    fn one_pixel_in_every_layout_is_gray() {
        for (name, pixels) in PixelFormat::NAMES {
            let raw = RawFormat::new(1, 1, pixels);
            let bytes = vec![128; raw.frame_bytes().unwrap()];
            let mut out = Vec::new();

            let order = raw.convert(Range::Limited, &bytes, &mut Stretch::default(), &mut out);

            let expected = if raw.ready().is_some() || order == ChannelOrder::Gray {
                128
            } else {
                130 // limited range
            };
            assert_eq!(out, vec![expected; order.bytes_per_pixel()], "{name}");
        }
    }

    #[test]
    fn gaps_behind_rows_are_no_pixels() {
        for (name, pixels) in PixelFormat::NAMES {
            let tight = RawFormat::new(5, 3, pixels);
            let widest = tight.planes().map(|plane| plane.row).max().unwrap();
            let loose = RawFormat {
                stride: Some(widest + 6),
                ..tight
            };
            let whole: Vec<u8> = (0..tight.frame_bytes().unwrap())
                .map(|i| 20 + i as u8)
                .collect();
            let mut rest = &whole[..];
            let mut padded = Vec::new();
            for plane in loose.planes() {
                for _ in 0..plane.rows {
                    let (row, behind) = rest.split_at(plane.row);
                    padded.extend_from_slice(row);
                    padded.resize(padded.len() + plane.stride - plane.row, 255);
                    rest = behind;
                }
            }
            let convert = |raw: &RawFormat, bytes: &[u8]| {
                let mut out = Vec::new();
                raw.convert(Range::Full, bytes, &mut Stretch::default(), &mut out);
                out
            };

            assert_eq!(loose.frame_bytes(), Ok(padded.len()), "{name}");
            assert_eq!(loose.ready(), None, "{name}");
            assert_eq!(convert(&loose, &padded), convert(&tight, &whole), "{name}");
        }
    }

    #[test]
    fn stride_shorter_than_a_row_is_refused() {
        for (pixels, stride) in [
            (PixelFormat::Bgra, 19),
            (PixelFormat::Nv12, 5),
            (PixelFormat::Yuv420p, 4),
            (PixelFormat::Gray, 0),
        ] {
            let raw = RawFormat {
                stride: Some(stride),
                ..RawFormat::new(5, 3, pixels)
            };

            let message = raw.frame_bytes().unwrap_err();

            assert!(
                message.contains(&format!("stride of {stride}")),
                "{message}"
            );
        }
    }

    #[test]
    fn format_is_known_by_every_name() {
        for (name, pixels) in [
            ("uyvy422", PixelFormat::Uyvy422),
            ("UYVY", PixelFormat::Uyvy422),
            ("I420", PixelFormat::Yuv420p),
            ("BGRx", PixelFormat::Bgra),
        ] {
            assert_eq!(PixelFormat::from_name(name), Some(pixels), "{name}");
        }
        assert_eq!(PixelFormat::from_name("p010"), None);
    }

    #[test]
    fn sixteen_bits_are_read_with_the_lower_byte_first() {
        let raw = RawFormat::new(3, 1, PixelFormat::Gray16Le);
        let bytes = [0x00, 0x10, 0x80, 0x10, 0x00, 0x11];
        let mut out = Vec::new();

        let order = raw.convert(Range::Full, &bytes, &mut Stretch::default(), &mut out);

        assert_eq!(order, ChannelOrder::Gray);
        assert!(
            out[0] < 30 && out[1].abs_diff(128) < 2 && out[2] > 225,
            "{out:?}"
        );
    }

    #[test]
    fn sizes_out_of_bounds_are_refused() {
        for (width, height, part) in [
            (0, 5, "0x5"),
            (5, 1 << 16, "5x65536"),
            (1 << 15, 1 << 15, "at most"),
        ] {
            let raw = RawFormat::new(width, height, PixelFormat::Yuv420p);
            let message = raw.frame_bytes().unwrap_err();
            assert!(message.contains(part), "{message}");
        }
    }
}
