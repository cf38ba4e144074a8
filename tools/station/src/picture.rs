//! Pictures and boxes.

use image::{RgbImage, imageops};
use kernels::Size;
use kernels::pixels::{Pixels, Plane};

pub use kernels::pixels::ChannelOrder as Order;

/// One frame that owns its pixels: `height` rows of `width` pixels without gaps, of YUV plane after
/// plane.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// The pixels.
    pub data: Vec<u8>,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// How the bytes are to be read.
    pub order: Order,
}

impl Picture {
    /// A picture of one black pixel, for tests that need any picture.
    #[cfg(test)]
    pub(crate) fn dot() -> Picture {
        Picture {
            data: vec![0],
            width: 1,
            height: 1,
            order: Order::Gray,
        }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Copies the picture into an RGB image of the same size.
    pub fn to_rgb(&self) -> RgbImage {
        let (h, w) = (self.height, self.width);
        let size = Size { h, w };
        let mut planes = Vec::new();
        let mut rest = &self.data[..];
        for shape in self.order.planes(size, self.order.row_bytes(w)) {
            let (data, behind) = rest.split_at(shape.bytes());
            let stride = shape.stride;
            planes.push(Plane { data, stride });
            rest = behind;
        }
        let mut image = RgbImage::new(w as u32, h as u32);
        Pixels::new(self.order, size, &planes).write_rgb(&mut image);
        image
    }

    /// Copies the picture into an RGB image that is at most `max_width` pixels wide.
    pub fn fitted(&self, max_width: usize) -> RgbImage {
        let image = self.to_rgb();
        if self.width <= max_width {
            return image;
        }
        let height = (self.height * max_width / self.width).max(1);
        imageops::thumbnail(&image, max_width as u32, height as u32)
    }
}

/// A box in the pixels of a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameBox {
    /// Left edge.
    pub x: f32,
    /// Top edge.
    pub y: f32,
    /// Width.
    pub w: f32,
    /// Height.
    pub h: f32,
}

impl FrameBox {
    /// A box from its left edge, top edge, width and height.
    pub fn new(x: f32, y: f32, w: f32, h: f32) -> FrameBox {
        FrameBox { x, y, w, h }
    }

    /// Whether all four numbers are finite.
    pub fn is_finite(&self) -> bool {
        [self.x, self.y, self.w, self.h]
            .iter()
            .all(|number| number.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn picture_of_every_order_becomes_rgb() {
        for (order, pixel, expected) in [
            (Order::Rgb, &[1, 2, 3][..], [1, 2, 3]),
            (Order::Bgr, &[3, 2, 1], [1, 2, 3]),
            (Order::Rgba, &[1, 2, 3, 9], [1, 2, 3]),
            (Order::Bgra, &[3, 2, 1, 9], [1, 2, 3]),
            (Order::Gray, &[7], [7, 7, 7]),
            (Order::Nv12, &[126, 128, 128], [128, 128, 128]),
            (Order::Yuyv, &[81, 90, 0, 240], [255, 0, 0]),
        ] {
            let picture = Picture {
                data: pixel.to_vec(),
                width: 1,
                height: 1,
                order,
            };

            let image = picture.to_rgb();

            assert_eq!(image.get_pixel(0, 0).0, expected, "{order:?}");
        }
    }

    #[test]
    fn wide_picture_is_fitted_in_proportion() {
        let picture = Picture {
            data: vec![9; 40 * 10],
            width: 40,
            height: 10,
            order: Order::Gray,
        };

        assert_eq!(picture.fitted(20).dimensions(), (20, 5));
        assert_eq!(picture.fitted(80).dimensions(), (40, 10));
    }
}
