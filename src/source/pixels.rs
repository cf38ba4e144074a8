//! Layouts of headerless frames. Most stay as they are: a [`Frame`] reads them in place.

use super::{MAX_FRAME_BYTES, Stretch};
use crate::frame::{ChannelOrder, Frame};
use kernels::Size;
use kernels::pixels::{LumaRange, Pixels, Plane, PlaneShape};

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
    fn planes(&self) -> impl Iterator<Item = PlaneShape> {
        // Samples of 16 bits lie as those of one byte in a frame twice as wide.
        let (order, w) = match self.order() {
            Some(order) => (order, self.width),
            None => (ChannelOrder::Gray, 2 * self.width),
        };
        let stride = self.stride.unwrap_or(order.row_bytes(w));
        order.planes(Size { h: self.height, w }, stride)
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
        // YUV becomes RGB where it is shown, so that counts as well.
        if bytes.max(3 * w as u64 * h as u64) > MAX_FRAME_BYTES {
            return Err(format!(
                "frames of {w}x{h} pixels, expected at most {MAX_FRAME_BYTES} bytes each"
            ));
        }
        Ok(bytes as usize)
    }

    /// The order of a frame whose bytes need no conversion.
    pub(super) fn ready(&self, range: LumaRange) -> Option<ChannelOrder> {
        self.lent(range).filter(|_| !self.has_gaps())
    }

    /// The order of samples that a frame can read in place: not those of 16 bits, nor YUV of full
    /// range, which is rare.
    fn lent(&self, range: LumaRange) -> Option<ChannelOrder> {
        self.order()
            .filter(|order| order.is_packed() || range == LumaRange::Limited)
    }

    /// The order of samples of 8 bits.
    fn order(&self) -> Option<ChannelOrder> {
        Some(match self.pixels {
            PixelFormat::Bgr24 => ChannelOrder::Bgr,
            PixelFormat::Rgb24 => ChannelOrder::Rgb,
            PixelFormat::Bgra => ChannelOrder::Bgra,
            PixelFormat::Rgba => ChannelOrder::Rgba,
            PixelFormat::Gray => ChannelOrder::Gray,
            PixelFormat::Gray16Le => return None,
            PixelFormat::Yuv420p => ChannelOrder::I420,
            PixelFormat::Nv12 => ChannelOrder::Nv12,
            PixelFormat::Nv21 => ChannelOrder::Nv21,
            PixelFormat::Yuyv422 => ChannelOrder::Yuyv,
            PixelFormat::Uyvy422 => ChannelOrder::Uyvy,
            PixelFormat::Yuv422p => ChannelOrder::I422,
            PixelFormat::Yuv444p => ChannelOrder::I444,
        })
    }

    /// Brings one frame into a form that a [`Frame`] reads, in `out`, and returns its order.
    ///
    /// `bytes` has the length of [`frame_bytes`](Self::frame_bytes).
    pub(super) fn convert(
        &self,
        range: LumaRange,
        bytes: &[u8],
        stretch: &mut Stretch,
        out: &mut Vec<u8>,
    ) -> ChannelOrder {
        if let Some(order) = self.lent(range) {
            self.close_gaps(bytes, out);
            return order;
        }
        let Some(order) = self.order() else {
            let mut without_gaps = Vec::new();
            self.close_gaps(bytes, &mut without_gaps);
            let samples: Vec<u16> = without_gaps
                .as_chunks::<2>()
                .0
                .iter()
                .map(|pair| u16::from_le_bytes(*pair))
                .collect();
            stretch.to_bytes(&samples, out);
            return ChannelOrder::Gray;
        };
        let mut rest = bytes;
        let mut planes = Vec::new();
        for PlaneShape { stride, rows, .. } in self.planes() {
            let (data, behind) = rest.split_at(stride * rows);
            planes.push(Plane { data, stride });
            rest = behind;
        }
        let (h, w) = (self.height, self.width);
        out.resize(3 * w * h, 0);
        let pixels = Pixels::new(order, Size { h, w }, &planes).with_range(range);
        pixels.write_rgb(out);
        ChannelOrder::Rgb
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_pixel_in_every_layout_is_gray() {
        for (name, pixels) in PixelFormat::NAMES {
            let raw = RawFormat::new(1, 1, pixels);
            let bytes = vec![128; raw.frame_bytes().unwrap()];
            let mut out = Vec::new();

            let order = raw.convert(
                LumaRange::Limited,
                &bytes,
                &mut Stretch::default(),
                &mut out,
            );

            let found = Frame::new(&out, 1, 1, order).unwrap().bgr(0, 0);
            let expected = if order.is_packed() { 128 } else { 130 }; // limited range
            assert_eq!(found, [expected; 3], "{name}");
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
            let convert = |raw: &RawFormat, range, bytes: &[u8]| {
                let mut out = Vec::new();
                raw.convert(range, bytes, &mut Stretch::default(), &mut out);
                out
            };

            assert_eq!(loose.frame_bytes(), Ok(padded.len()), "{name}");
            assert_eq!(loose.ready(LumaRange::Limited), None, "{name}");
            for range in [LumaRange::Limited, LumaRange::Full] {
                assert_eq!(
                    convert(&loose, range, &padded),
                    convert(&tight, range, &whole),
                    "{name}"
                );
            }
        }
    }

    #[test]
    fn stride_shorter_than_a_row_is_refused() {
        for (pixels, stride) in [
            (PixelFormat::Bgra, 19),
            (PixelFormat::Nv12, 4),
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

        let order = raw.convert(LumaRange::Full, &bytes, &mut Stretch::default(), &mut out);

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
