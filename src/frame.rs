//! A borrowed picture: pixels, size, stride, channel order. The tracker never copies it.

use crate::error::FrameError;
use std::fmt;

/// Order and number of one pixel's bytes.
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
}

impl ChannelOrder {
    /// Bytes from one pixel to the next.
    pub const fn bytes_per_pixel(self) -> usize {
        match self {
            ChannelOrder::Rgb | ChannelOrder::Bgr => 3,
            ChannelOrder::Rgba | ChannelOrder::Bgra => 4,
            ChannelOrder::Gray => 1,
        }
    }

    /// Offsets of blue, green and red within a pixel; the network reads BGR.
    ///
    /// Source: docs/method.md, section 2.3.
    pub const fn bgr_offsets(self) -> [usize; 3] {
        match self {
            ChannelOrder::Rgb | ChannelOrder::Rgba => [2, 1, 0],
            ChannelOrder::Bgr | ChannelOrder::Bgra => [0, 1, 2],
            ChannelOrder::Gray => [0, 0, 0],
        }
    }
}

/// Width and height of a frame in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FrameSize {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

impl fmt::Display for FrameSize {
    /// `WIDTHxHEIGHT`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// One picture, borrowed from the caller.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    data: &'a [u8], // height rows of `stride` bytes; the last one may end after its pixels
    width: usize,
    height: usize,
    stride: usize,
    order: ChannelOrder,
}

impl<'a> Frame<'a> {
    /// Largest width and height accepted, in pixels.
    pub const MAX_SIDE: usize = 1 << 15;

    /// A frame without gaps between its rows.
    ///
    /// # Errors
    /// As [`with_stride`](Self::with_stride).
    pub fn new(
        data: &'a [u8],
        width: usize,
        height: usize,
        order: ChannelOrder,
    ) -> Result<Self, FrameError> {
        Self::with_stride(
            data,
            width,
            height,
            width.saturating_mul(order.bytes_per_pixel()),
            order,
        )
    }

    /// A frame whose rows start `stride` bytes apart.
    ///
    /// # Errors
    /// If a side is 0 or above [`MAX_SIDE`](Self::MAX_SIDE), the stride is shorter than a row, or
    /// `data` ends before the last pixel.
    pub fn with_stride(
        data: &'a [u8],
        width: usize,
        height: usize,
        stride: usize,
        order: ChannelOrder,
    ) -> Result<Self, FrameError> {
        if !(1..=Self::MAX_SIDE).contains(&width) || !(1..=Self::MAX_SIDE).contains(&height) {
            return Err(FrameError::Size {
                width,
                height,
                max: Self::MAX_SIDE,
            });
        }
        let row = width * order.bytes_per_pixel();
        if stride < row {
            return Err(FrameError::Stride {
                stride,
                expected: row,
            });
        }
        let expected = stride.saturating_mul(height - 1).saturating_add(row);
        if data.len() < expected {
            return Err(FrameError::Data {
                found: data.len(),
                expected,
            });
        }
        Ok(Frame {
            data,
            width,
            height,
            stride,
            order,
        })
    }

    /// Width and height in pixels.
    pub fn size(&self) -> FrameSize {
        FrameSize {
            width: self.width,
            height: self.height,
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Bytes from one row to the next.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Channel order.
    pub fn order(&self) -> ChannelOrder {
        self.order
    }

    /// All bytes, row after row, `stride` apart.
    pub fn data(&self) -> &'a [u8] {
        self.data
    }

    /// The pixels of row `y`, without the gap after them.
    pub fn row(&self, y: usize) -> &'a [u8] {
        &self.data[y * self.stride..][..self.width * self.order.bytes_per_pixel()]
    }

    /// Mean of blue, green and red over all pixels, truncated: the border color of the crops.
    ///
    /// Source: docs/method.md, section 2.2.
    pub fn mean_bgr(&self) -> [u8; 3] {
        let step = self.order.bytes_per_pixel();
        let offsets = self.order.bgr_offsets();
        let mut sums = [0u64; 3];
        for y in 0..self.height {
            let mut row_sums = [0u32; 3]; // holds a row of 2^15 pixels of 255
            for pixel in self.row(y).chunks_exact(step) {
                for (sum, offset) in row_sums.iter_mut().zip(offsets) {
                    *sum += u32::from(pixel[offset]);
                }
            }
            for (sum, row_sum) in sums.iter_mut().zip(row_sums) {
                *sum += u64::from(row_sum);
            }
        }
        sums.map(|sum| (sum / (self.width * self.height) as u64) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_of_wrong_size_stride_or_data_is_refused() {
        let data = [0u8; 30];
        assert!(Frame::new(&data, 5, 2, ChannelOrder::Rgb).is_ok());
        assert!(Frame::with_stride(&data, 3, 2, 20, ChannelOrder::Rgb).is_ok());
        for (error, expected) in [
            (Frame::new(&data, 0, 2, ChannelOrder::Rgb), "0x2"),
            (Frame::new(&data, 1 << 16, 1, ChannelOrder::Gray), "65536x1"),
            (Frame::new(&data, 5, 3, ChannelOrder::Rgb), "45"),
            (Frame::with_stride(&data, 5, 2, 14, ChannelOrder::Rgb), "15"),
            (
                Frame::with_stride(&data, 5, 2, usize::MAX, ChannelOrder::Rgb),
                "30",
            ),
        ] {
            let message = error.unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn mean_of_a_frame_is_bgr_and_truncated() {
        let rgb = [10, 20, 30, 11, 21, 32, 99, 99]; // two pixels, then a gap
        let frame = Frame::with_stride(&rgb, 2, 1, 8, ChannelOrder::Rgb).unwrap();
        assert_eq!(frame.mean_bgr(), [31, 20, 10]);
        let gray = Frame::new(&[1, 2, 4, 4], 2, 2, ChannelOrder::Gray).unwrap();
        assert_eq!(gray.mean_bgr(), [2, 2, 2]);
    }
}
