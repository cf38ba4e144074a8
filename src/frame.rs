//! A borrowed picture: pixels, size, strides, order of samples. The tracker never copies it, and
//! converts those pixels only that it reads.

use crate::error::FrameError;
use kernels::pixels::{Pixels, PlaneShape};
use kernels::{Isa, Size};
use std::fmt;

pub use kernels::pixels::{ChannelOrder, Plane};

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
    pixels: Pixels<'a>,
}

impl<'a> Frame<'a> {
    /// Largest width and height accepted, in pixels.
    pub const MAX_SIDE: usize = 1 << 15;

    /// A frame without gaps between its rows, and between its planes if it has several.
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
            order.row_bytes(width.min(Self::MAX_SIDE + 1)),
            order,
        )
    }

    /// A frame whose rows start `stride` bytes apart; planes follow each other, and those of half
    /// the width have half of the stride, rounded up.
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
        let expected = Self::bytes(width, height, stride, order)?;
        if data.len() < expected {
            return Err(FrameError::Data {
                found: data.len(),
                expected,
            });
        }
        let shapes = || order.planes(size(width, height), stride);
        let mut planes = [Plane { data, stride }; MAX_PLANES];
        let mut rest = data;
        for (plane, shape) in planes.iter_mut().zip(shapes()) {
            *plane = Plane {
                data: rest,
                stride: shape.stride,
            };
            rest = rest.get(shape.stride * shape.rows..).unwrap_or_default();
        }
        let count = shapes().count();
        Self::from_planes(&planes[..count], width, height, order)
    }

    /// A frame of planes that lie anywhere.
    ///
    /// # Errors
    /// If a side is 0 or above [`MAX_SIDE`](Self::MAX_SIDE), there are not as many planes as the
    /// order has, a stride is shorter than a row, or a plane ends before its last sample.
    pub fn from_planes(
        planes: &[Plane<'a>],
        width: usize,
        height: usize,
        order: ChannelOrder,
    ) -> Result<Self, FrameError> {
        let size = checked(width, height)?;
        let expected = order.planes(size, 0).count();
        if planes.len() != expected {
            return Err(FrameError::Planes {
                found: planes.len(),
                expected,
            });
        }
        for (shape, Plane { data, stride }) in order.planes(size, 0).zip(planes) {
            let stride = *stride;
            if stride < shape.row {
                return Err(FrameError::Stride {
                    stride,
                    expected: shape.row,
                });
            }
            let expected = PlaneShape { stride, ..shape }.bytes();
            if data.len() < expected {
                return Err(FrameError::Data {
                    found: data.len(),
                    expected,
                });
            }
        }
        Ok(Frame {
            pixels: Pixels::new(order, size, planes),
        })
    }

    /// Bytes that [`with_stride`](Self::with_stride) needs; the last row may end after its pixels.
    ///
    /// # Errors
    /// If a side is 0 or above [`MAX_SIDE`](Self::MAX_SIDE), or the stride is shorter than a row.
    pub fn bytes(
        width: usize,
        height: usize,
        stride: usize,
        order: ChannelOrder,
    ) -> Result<usize, FrameError> {
        let size = checked(width, height)?;
        let mut before = 0usize; // bytes of the planes before
        let mut bytes = 0;
        for shape in order.planes(size, stride) {
            if shape.stride < shape.row {
                return Err(FrameError::Stride {
                    stride: shape.stride,
                    expected: shape.row,
                });
            }
            bytes = before.saturating_add(shape.bytes());
            before = before.saturating_add(shape.stride.saturating_mul(shape.rows));
        }
        Ok(bytes)
    }

    /// Width and height in pixels.
    pub fn size(&self) -> FrameSize {
        FrameSize {
            width: self.width(),
            height: self.height(),
        }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.pixels.size().w
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.pixels.size().h
    }

    /// The pixels as the kernels take them.
    pub(crate) fn pixels(&self) -> &Pixels<'a> {
        &self.pixels
    }

    /// Blue, green and red of one pixel.
    ///
    /// # Panics
    /// If it lies outside of the frame's bytes.
    #[inline]
    pub fn bgr(&self, x: usize, y: usize) -> [u8; 3] {
        self.pixels.bgr(x, y)
    }

    /// The whole frame in RGB, row after row without gaps.
    pub fn to_rgb(&self) -> Vec<u8> {
        let mut rgb = vec![0; 3 * self.pixels.size().area()];
        self.pixels.write_rgb(&mut rgb);
        rgb
    }

    /// Mean of blue, green and red over all pixels, truncated: the border color of the crops.
    ///
    /// Source: docs/method.md, section 2.2.
    pub fn mean_bgr(&self, isa: Isa) -> [u8; 3] {
        self.pixels.mean_bgr(isa)
    }
}

/// Most planes of a frame.
const MAX_PLANES: usize = 3;

fn size(width: usize, height: usize) -> Size {
    Size {
        h: height,
        w: width,
    }
}

/// The size, if a frame may have it.
fn checked(width: usize, height: usize) -> Result<Size, FrameError> {
    let max = Frame::MAX_SIDE;
    if (1..=max).contains(&width) && (1..=max).contains(&height) {
        Ok(size(width, height))
    } else {
        Err(FrameError::Size { width, height, max })
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
    fn planes_of_odd_sizes_follow_each_other() {
        let data: Vec<u8> = (0..64).collect();
        for (order, bytes, padded) in [
            (ChannelOrder::Nv12, 15 + 2 * 6, 3 * 16 + 16 + 6),
            (ChannelOrder::I420, 15 + 4 * 3, 3 * 16 + 3 * 8 + 3),
            (ChannelOrder::Yuyv, 3 * 12, 2 * 16 + 12),
        ] {
            let found = Frame::bytes(5, 3, order.row_bytes(5), order);
            assert_eq!(found, Ok(bytes), "{order:?}");
            assert!(Frame::new(&data[..bytes], 5, 3, order).is_ok());
            assert!(Frame::new(&data[..bytes - 1], 5, 3, order).is_err());
            assert_eq!(Frame::bytes(5, 3, 16, order), Ok(padded), "{order:?}");
        }
        let plane = Plane {
            data: &data,
            stride: 8,
        };
        assert!(Frame::from_planes(&[plane; 2], 5, 3, ChannelOrder::Nv12).is_ok());
        let message = |planes: &[Plane<'_>], order| {
            let error = Frame::from_planes(planes, 5, 3, order).unwrap_err();
            error.to_string()
        };
        assert!(message(&[plane], ChannelOrder::Nv12).contains("1 planes, expected 2"));
        let narrow = Plane { stride: 2, ..plane };
        assert!(
            message(&[plane, narrow, plane], ChannelOrder::I420).contains("expected at least 3")
        );
    }

    #[test]
    fn mean_of_a_frame_is_bgr_and_truncated() {
        let rgb = [10, 20, 30, 11, 21, 32, 99, 99]; // two pixels, then a gap
        let frame = Frame::with_stride(&rgb, 2, 1, 8, ChannelOrder::Rgb).unwrap();
        assert_eq!(frame.mean_bgr(Isa::detect()), [31, 20, 10]);
        let gray = Frame::new(&[1, 2, 4, 4], 2, 2, ChannelOrder::Gray).unwrap();
        assert_eq!(gray.mean_bgr(Isa::detect()), [2, 2, 2]);
    }
}
