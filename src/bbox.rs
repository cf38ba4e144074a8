//! Boxes: pure geometry. Each type says which pixels it is in.
//!
//! | type | form | pixels |
//! |---|---|---|
//! | [`BBox`] | left, top, width, height | frame; the type of the API |
//! | [`FrameBox`] | center, width, height | frame |
//! | `CropBox` | center, width, height | crop |
//!
//! `tracker::crop::Placement` converts between frame and crop pixels, and nothing else does.

/// An axis-aligned box in frame pixels: left, top, width, height.
///
/// Coordinates are 0-based and the width counts pixels inclusively: a box of one pixel at (3, 4) is
/// `BBox::new(3.0, 4.0, 1.0, 1.0)`, and its center is (3, 4).
/// Source: docs/method.md, section 2.1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BBox {
    /// Left edge.
    pub x: f32,
    /// Top edge.
    pub y: f32,
    /// Width.
    pub w: f32,
    /// Height.
    pub h: f32,
}

/// A box in frame pixels by its center.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameBox {
    /// Center, horizontally.
    pub cx: f32,
    /// Center, vertically.
    pub cy: f32,
    /// Width.
    pub w: f32,
    /// Height.
    pub h: f32,
}

/// A box in crop pixels by its center.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CropBox {
    pub cx: f32,
    pub cy: f32,
    pub w: f32,
    pub h: f32,
}

impl BBox {
    /// A box from left, top, width and height.
    pub const fn new(x: f32, y: f32, w: f32, h: f32) -> BBox {
        BBox { x, y, w, h }
    }

    /// The same box by its center.
    pub fn center(&self) -> FrameBox {
        FrameBox {
            cx: self.x + (self.w - 1.0) / 2.0,
            cy: self.y + (self.h - 1.0) / 2.0,
            w: self.w,
            h: self.h,
        }
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        [self.x, self.y, self.w, self.h]
            .iter()
            .all(|v| v.is_finite())
    }

    /// Whether this looks like a box in shares of the frame, as YOLO writes it: no number is above
    /// 1.
    pub fn is_in_shares(&self) -> bool {
        let numbers = [self.x, self.y, self.w, self.h];
        self.w > 0.0 && self.h > 0.0 && numbers.iter().all(|number| *number <= 1.0)
    }

    /// Area in square pixels; 0 for an empty or inverted box.
    pub fn area(&self) -> f32 {
        self.w.max(0.0) * self.h.max(0.0)
    }

    /// Intersection over union in `[0, 1]`, with continuous edges `x..x + w`.
    ///
    /// Source: docs/method.md, section 4.2.
    pub fn iou(&self, other: &BBox) -> f32 {
        let w = (self.x + self.w).min(other.x + other.w) - self.x.max(other.x);
        let h = (self.y + self.h).min(other.y + other.h) - self.y.max(other.y);
        let intersection = w.max(0.0) * h.max(0.0);
        let union = self.area() + other.area() - intersection;
        if union > 0.0 {
            intersection / union
        } else {
            0.0
        }
    }

    /// Distance between the centers in pixels.
    pub fn center_distance(&self, other: &BBox) -> f32 {
        let a = self.center();
        let b = other.center();
        (a.cx - b.cx).hypot(a.cy - b.cy)
    }
}

impl FrameBox {
    /// The same box by its corner.
    pub fn corner(&self) -> BBox {
        BBox::new(
            self.cx - (self.w - 1.0) / 2.0,
            self.cy - (self.h - 1.0) / 2.0,
            self.w,
            self.h,
        )
    }

    /// Keeps the center inside a `width` x `height` frame and each side between `min_size` and the
    /// frame's. The frame's side wins where it is below `min_size`.
    ///
    /// Source: docs/method.md, section 2.6.
    pub fn clamped(&self, width: usize, height: usize, min_size: f32) -> FrameBox {
        let width = width as f32;
        let height = height as f32;
        FrameBox {
            cx: self.cx.clamp(0.0, width),
            cy: self.cy.clamp(0.0, height),
            w: self.w.max(min_size).min(width),
            h: self.h.max(min_size).min(height),
        }
    }
}

impl CropBox {
    /// Whether every number is finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.corner().is_finite()
    }

    /// Intersection over union in `[0, 1]`, as of [`BBox::iou`].
    pub(crate) fn iou(&self, other: &CropBox) -> f32 {
        self.corner().iou(&other.corner())
    }

    /// The same box by its corner, still in crop pixels.
    fn corner(&self) -> BBox {
        let CropBox { cx, cy, w, h } = *self;
        FrameBox { cx, cy, w, h }.corner()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn center_of_a_box_counts_pixels_inclusively() {
        let bbox = BBox::new(100.0, 50.0, 40.0, 80.0);

        let center = bbox.center();

        assert_eq!((center.cx, center.cy), (119.5, 89.5)); // docs/method.md, section 2.2
        assert_eq!(center.corner(), bbox);
    }

    #[test]
    fn iou_of_boxes_that_overlap_touch_or_are_inverted() {
        let a = BBox::new(0.0, 0.0, 10.0, 10.0);
        for (b, expected) in [
            (a, 1.0),
            (BBox::new(5.0, 0.0, 10.0, 10.0), 50.0 / 150.0),
            (BBox::new(10.0, 0.0, 10.0, 10.0), 0.0),
            (BBox::new(0.0, 0.0, -3.0, 5.0), 0.0),
        ] {
            assert_eq!(a.iou(&b), expected, "{b:?}");
        }
    }

    #[test]
    fn center_distance_of_shifted_boxes_is_the_shift() {
        let a = BBox::new(0.0, 0.0, 10.0, 10.0);
        let b = BBox::new(3.0, 4.0, 10.0, 10.0);

        assert_eq!(a.center_distance(&b), 5.0);
    }

    #[test]
    fn clamped_box_stays_within_the_frame_and_the_bounds() {
        let far = FrameBox {
            cx: -5.0,
            cy: 700.0,
            w: 3.0,
            h: 900.0,
        };

        let clamped = far.clamped(640, 360, 10.0);
        let in_tiny_frame = far.clamped(4, 300, 10.0);

        let expected = FrameBox {
            cx: 0.0,
            cy: 360.0,
            w: 10.0,
            h: 360.0,
        };
        assert_eq!(clamped, expected);
        assert_eq!((in_tiny_frame.w, in_tiny_frame.h), (4.0, 300.0));
    }
}
