//! Boxes in double precision, as the toolkits count them.

/// An axis-aligned box in pixels: left, top, width, height.
///
/// Numbers may be anything that a file can hold, NaN included; what an unusable box means is the [`Convention`]'s to say.
///
/// [`Convention`]: crate::Convention
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BBox {
    /// Left edge.
    pub x: f64,
    /// Top edge.
    pub y: f64,
    /// Width.
    pub w: f64,
    /// Height.
    pub h: f64,
}

impl BBox {
    /// A box from left, top, width and height.
    pub const fn new(x: f64, y: f64, w: f64, h: f64) -> BBox {
        BBox { x, y, w, h }
    }

    /// Whether any of its numbers is NaN.
    pub fn has_nan(&self) -> bool {
        [self.x, self.y, self.w, self.h].iter().any(|v| v.is_nan())
    }

    /// Whether it is a box that can be tracked: finite numbers, width and height above 0.
    pub fn is_usable(&self) -> bool {
        [self.x, self.y, self.w, self.h]
            .iter()
            .all(|v| v.is_finite())
            && self.w > 0.0
            && self.h > 0.0
    }

    /// The center, the width counting pixels inclusively: x + (w - 1) / 2.
    pub fn center(&self) -> (f64, f64) {
        (self.x + (self.w - 1.0) / 2.0, self.y + (self.h - 1.0) / 2.0)
    }

    /// Intersection over union in `[0, 1]`, with continuous edges `x..x + w`; NaN if a number is NaN.
    ///
    /// Source: the got10k toolkit, which adds 2.2e-16 to the union so that empty boxes overlap by 0.
    pub fn iou(&self, other: &BBox) -> f64 {
        if self.has_nan() || other.has_nan() {
            return f64::NAN;
        }
        let w = (self.x + self.w).min(other.x + other.w) - self.x.max(other.x);
        let h = (self.y + self.h).min(other.y + other.h) - self.y.max(other.y);
        let intersection = w.max(0.0) * h.max(0.0);
        let union = self.w * self.h + other.w * other.h - intersection;
        (intersection / (union + f64::EPSILON)).clamp(0.0, 1.0)
    }

    /// Distance between the centers, horizontally and vertically, in pixels.
    pub fn offset(&self, other: &BBox) -> (f64, f64) {
        let (a, b) = (self.center(), other.center());
        (a.0 - b.0, a.1 - b.1)
    }
}

impl BBox {
    /// As the tracker counts them, in single precision.
    pub(crate) fn to_track_cpu(self) -> track_cpu::BBox {
        track_cpu::BBox::new(self.x as f32, self.y as f32, self.w as f32, self.h as f32)
    }
}

impl From<track_cpu::BBox> for BBox {
    fn from(b: track_cpu::BBox) -> BBox {
        BBox::new(b.x.into(), b.y.into(), b.w.into(), b.h.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlap_and_offset() {
        let a = BBox::new(0.0, 0.0, 10.0, 10.0);
        assert_eq!(a.iou(&a), 1.0);
        assert_eq!(a.iou(&BBox::new(5.0, 0.0, 10.0, 10.0)), 50.0 / 150.0);
        assert_eq!(a.iou(&BBox::new(10.0, 0.0, 10.0, 10.0)), 0.0);
        assert_eq!(BBox::default().iou(&BBox::default()), 0.0);
        assert!(a.iou(&BBox::new(f64::NAN, 0.0, 1.0, 1.0)).is_nan());
        assert_eq!(a.offset(&BBox::new(3.0, 4.0, 10.0, 12.0)), (-3.0, -5.0));
    }
}
