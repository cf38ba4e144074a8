//! Boxes: pure geometry, in pixels.

/// An axis-aligned box: left, top, width, height in pixels.
///
/// Coordinates are 0-based and the width counts pixels inclusively: a box of one pixel at (3, 4) is
/// `BBox::new(3.0, 4.0, 1.0, 1.0)`, its center is (3, 4) (spec section 2.1).
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

/// The same box by its center.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CenterBox {
    /// Center, horizontally.
    pub cx: f32,
    /// Center, vertically.
    pub cy: f32,
    /// Width.
    pub w: f32,
    /// Height.
    pub h: f32,
}

impl BBox {
    /// A box from left, top, width and height.
    pub const fn new(x: f32, y: f32, w: f32, h: f32) -> BBox {
        BBox { x, y, w, h }
    }

    /// The same box by its center.
    pub fn center(&self) -> CenterBox {
        let (cx, cy) = (self.x + (self.w - 1.0) / 2.0, self.y + (self.h - 1.0) / 2.0);
        CenterBox {
            cx,
            cy,
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

    /// Area in square pixels; 0 for an empty or inverted box.
    pub fn area(&self) -> f32 {
        self.w.max(0.0) * self.h.max(0.0)
    }

    /// Intersection over union in `[0, 1]`, with continuous edges `x..x + w` (spec section 4.2).
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
        let (a, b) = (self.center(), other.center());
        (a.cx - b.cx).hypot(a.cy - b.cy)
    }
}

impl CenterBox {
    /// The same box by its corner.
    pub fn corner(&self) -> BBox {
        BBox::new(
            self.cx - (self.w - 1.0) / 2.0,
            self.cy - (self.h - 1.0) / 2.0,
            self.w,
            self.h,
        )
    }

    /// Keeps the center inside a `width` x `height` frame and the size between `min_size` and the frame's.
    ///
    /// Source: spec section 2.6. A frame smaller than `min_size` wins over it.
    pub fn clamped(&self, width: usize, height: usize, min_size: f32) -> CenterBox {
        let (width, height) = (width as f32, height as f32);
        CenterBox {
            cx: self.cx.clamp(0.0, width),
            cy: self.cy.clamp(0.0, height),
            w: self.w.max(min_size).min(width),
            h: self.h.max(min_size).min(height),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn center_of_the_spec() {
        let b = BBox::new(100.0, 50.0, 40.0, 80.0);
        let c = b.center();
        assert_eq!((c.cx, c.cy), (119.5, 89.5)); // spec section 2.2
        assert_eq!(c.corner(), b);
    }

    #[test]
    fn overlap() {
        let a = BBox::new(0.0, 0.0, 10.0, 10.0);
        assert_eq!(a.iou(&a), 1.0);
        assert_eq!(a.iou(&BBox::new(5.0, 0.0, 10.0, 10.0)), 50.0 / 150.0);
        assert_eq!(a.iou(&BBox::new(10.0, 0.0, 10.0, 10.0)), 0.0);
        assert_eq!(a.iou(&BBox::new(0.0, 0.0, -3.0, 5.0)), 0.0);
        assert_eq!(a.center_distance(&BBox::new(3.0, 4.0, 10.0, 10.0)), 5.0);
    }

    #[test]
    fn clamps_to_the_frame() {
        let c = CenterBox {
            cx: -5.0,
            cy: 700.0,
            w: 3.0,
            h: 900.0,
        }
        .clamped(640, 360, 10.0);
        assert_eq!(
            c,
            CenterBox {
                cx: 0.0,
                cy: 360.0,
                w: 10.0,
                h: 360.0
            }
        );
        let tiny = CenterBox {
            cx: 1.0,
            cy: 1.0,
            w: 5.0,
            h: 5.0,
        }
        .clamped(4, 300, 10.0);
        assert_eq!((tiny.w, tiny.h), (4.0, 10.0));
    }
}
