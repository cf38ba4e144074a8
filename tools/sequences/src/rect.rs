//! Boxes in double precision, as benchmark files hold them and toolkits compare them.

use std::array;

/// An axis-aligned box in pixels: left, top, width, height.
///
/// Its numbers may be anything that a file can hold, NaN included. A [`Convention`] decides what an
/// unusable box means.
///
/// [`Convention`]: crate::Convention
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rect {
    /// Left edge.
    pub x: f64,
    /// Top edge.
    pub y: f64,
    /// Width.
    pub w: f64,
    /// Height.
    pub h: f64,
}

impl Rect {
    /// The box of a frame without a target: four NaN.
    pub const NONE: Rect = Rect::new(f64::NAN, f64::NAN, f64::NAN, f64::NAN);

    /// A box from left, top, width and height.
    pub const fn new(x: f64, y: f64, w: f64, h: f64) -> Rect {
        Rect { x, y, w, h }
    }

    /// The smallest box around a polygon's corners; [`Rect::NONE`] if a number is NaN.
    pub fn around(corners: &[(f64, f64)]) -> Rect {
        if corners.iter().any(|(x, y)| x.is_nan() || y.is_nan()) {
            return Rect::NONE;
        }
        let fold = |of: fn(&(f64, f64)) -> f64, pick: fn(f64, f64) -> f64, start: f64| {
            corners.iter().map(of).fold(start, pick)
        };
        let left = fold(|c| c.0, f64::min, f64::INFINITY);
        let right = fold(|c| c.0, f64::max, f64::NEG_INFINITY);
        let top = fold(|c| c.1, f64::min, f64::INFINITY);
        let bottom = fold(|c| c.1, f64::max, f64::NEG_INFINITY);
        Rect::new(left, top, right - left, bottom - top)
    }

    /// Left, top, width and height.
    pub fn to_array(self) -> [f64; 4] {
        [self.x, self.y, self.w, self.h]
    }

    /// Left, top, width and height in single precision, as the tracker takes them.
    pub fn to_f32(self) -> [f32; 4] {
        self.to_array().map(|value| value as f32)
    }

    /// Whether any of its numbers is NaN.
    pub fn has_nan(&self) -> bool {
        self.to_array().iter().any(|value| value.is_nan())
    }

    /// Whether it can be tracked: finite numbers, width and height above 0.
    pub fn is_usable(&self) -> bool {
        self.to_array().iter().all(|value| value.is_finite()) && self.w > 0.0 && self.h > 0.0
    }

    /// Whether it shares an area with a picture of this size.
    pub fn is_in_picture(&self, width: f64, height: f64) -> bool {
        self.x < width && self.y < height && self.x + self.w > 0.0 && self.y + self.h > 0.0
    }

    /// The center with the width counted in inclusive pixels: x + (w - 1) / 2.
    pub fn center(&self) -> (f64, f64) {
        let cx = self.x + (self.w - 1.0) / 2.0;
        let cy = self.y + (self.h - 1.0) / 2.0;
        (cx, cy)
    }

    /// The side of the square of the same area.
    pub fn side(&self) -> f64 {
        (self.w * self.h).sqrt()
    }

    /// Intersection over union in `[0, 1]`, with continuous edges `x..x + w`; NaN if a number is
    /// NaN.
    ///
    /// Source: the got10k toolkit, which adds 2.2e-16 to the union so that empty boxes overlap by
    /// 0.
    pub fn iou(&self, other: &Rect) -> f64 {
        if self.has_nan() || other.has_nan() {
            return f64::NAN;
        }
        let w = (self.x + self.w).min(other.x + other.w) - self.x.max(other.x);
        let h = (self.y + self.h).min(other.y + other.h) - self.y.max(other.y);
        let intersection = w.max(0.0) * h.max(0.0);
        let union = self.w * self.h + other.w * other.h - intersection;
        (intersection / (union + f64::EPSILON)).clamp(0.0, 1.0)
    }

    /// This box's center minus the other's, horizontally and vertically, in pixels.
    pub fn offset(&self, other: &Rect) -> (f64, f64) {
        let own = self.center();
        let other = other.center();
        (own.0 - other.0, own.1 - other.1)
    }
}

impl<T: Into<f64>> From<[T; 4]> for Rect {
    /// From left, top, width and height.
    fn from(numbers: [T; 4]) -> Rect {
        let mut numbers = numbers.into_iter().map(Into::into);
        let [x, y, w, h] = array::from_fn(|_| numbers.next().unwrap_or(f64::NAN));
        Rect { x, y, w, h }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iou_equals_hand_computed_values() {
        let a = Rect::new(0.0, 0.0, 10.0, 10.0);

        assert_eq!(a.iou(&a), 1.0);
        assert_eq!(a.iou(&Rect::new(5.0, 0.0, 10.0, 10.0)), 50.0 / 150.0);
        assert_eq!(a.iou(&Rect::new(10.0, 0.0, 10.0, 10.0)), 0.0);
        assert_eq!(Rect::default().iou(&Rect::default()), 0.0);
        assert!(a.iou(&Rect::NONE).is_nan());
    }

    #[test]
    fn offset_counts_inclusive_pixels() {
        let a = Rect::new(0.0, 0.0, 10.0, 10.0);

        assert_eq!(a.offset(&Rect::new(3.0, 4.0, 10.0, 12.0)), (-3.0, -5.0));
    }

    #[test]
    fn box_around_a_polygon_touches_its_corners() {
        let corners = [(5.0, 1.0), (9.0, 4.0), (6.0, 8.0), (2.0, 5.0)];

        assert_eq!(Rect::around(&corners), Rect::new(2.0, 1.0, 7.0, 7.0));
        assert!(Rect::around(&[(f64::NAN, 1.0), (2.0, 3.0)]).has_nan());
    }

    #[test]
    fn boxes_outside_the_picture_are_recognized() {
        let cases = [
            (Rect::new(0.0, 0.0, 5.0, 5.0), true),
            (Rect::new(-4.0, -4.0, 5.0, 5.0), true),
            (Rect::new(-5.0, 0.0, 5.0, 5.0), false),
            (Rect::new(160.0, 0.0, 5.0, 5.0), false),
            (Rect::new(0.0, 900.0, 5.0, 5.0), false),
        ];
        for (rect, expected) in cases {
            assert_eq!(rect.is_in_picture(160.0, 120.0), expected, "{rect:?}");
        }
    }
}
