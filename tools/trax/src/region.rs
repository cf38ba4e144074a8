//! Where an object is, as text.

use crate::error::Error;
use std::fmt;

/// Largest side of a mask, in pixels.
const MAX_SIDE: u64 = 1 << 15;

/// An axis-aligned box in pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rectangle {
    /// Left edge.
    pub x: f64,
    /// Top edge.
    pub y: f64,
    /// Width.
    pub w: f64,
    /// Height.
    pub h: f64,
}

impl Rectangle {
    /// A box from left, top, width and height.
    pub const fn new(x: f64, y: f64, w: f64, h: f64) -> Rectangle {
        Rectangle { x, y, w, h }
    }
}

impl fmt::Display for Rectangle {
    /// `x,y,w,h` to four digits, as the reference client writes it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Rectangle { x, y, w, h } = self;
        write!(f, "{x:.4},{y:.4},{w:.4},{h:.4}")
    }
}

/// A region by the box that stands for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Region {
    /// `x,y,w,h`.
    Rectangle(Rectangle),
    /// `x,y,x,y,...` of three points or more.
    ///
    /// Four points become the box of the same center that has the proportions of the box around
    /// them and an area between that one's and theirs, as trackers of the VOT challenges take it
    /// (docs/method.md, section 4.5); others the box around them.
    Polygon(Rectangle),
    /// `mask:x,y,w,h,runs...`: an offset, a size and run lengths row by row, outside and inside in
    /// turn, outside first.
    ///
    /// The box around the pixels inside stands for it.
    Mask(Rectangle),
}

impl Region {
    /// The region that a text describes.
    ///
    /// # Errors
    /// If it is neither rectangle, polygon nor mask, or encloses nothing.
    pub fn parse(text: &str) -> Result<Region, Error> {
        match text
            .strip_prefix("mask:")
            .or_else(|| text.strip_prefix('m'))
        {
            Some(mask) => mask_bounds(mask)
                .map(Region::Mask)
                .ok_or_else(|| Error::part("region", "mask:x,y,w,h,runs with pixels inside", text)),
            None => from_numbers(text).ok_or_else(|| {
                Error::part(
                    "region",
                    "x,y,w,h, three points or more, or a mask, in finite numbers",
                    text,
                )
            }),
        }
    }

    /// The box that stands for it.
    pub fn rectangle(&self) -> Rectangle {
        match self {
            Region::Rectangle(rectangle) | Region::Polygon(rectangle) | Region::Mask(rectangle) => {
                *rectangle
            }
        }
    }
}

fn from_numbers(text: &str) -> Option<Region> {
    let mut first = [0.0; 8]; // what a rectangle and the rule for four points need
    let (mut count, mut low, mut high) = (0, [f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for part in text.split(',') {
        let number: f64 = part
            .trim()
            .parse()
            .ok()
            .filter(|number: &f64| number.is_finite())?;
        if let Some(slot) = first.get_mut(count) {
            *slot = number;
        }
        let axis = count % 2;
        (low[axis], high[axis]) = (low[axis].min(number), high[axis].max(number));
        count += 1;
    }
    let around = Rectangle::new(low[0], low[1], high[0] - low[0], high[1] - low[1]);
    match count {
        4 => Some(Region::Rectangle(Rectangle::new(
            first[0], first[1], first[2], first[3],
        ))),
        8 => Some(Region::Polygon(upright(&first, around))),
        _ if count >= 6 && count % 2 == 0 => Some(Region::Polygon(around)),
        _ => None,
    }
}

/// The box that stands for a rotated one.
fn upright(points: &[f64; 8], around: Rectangle) -> Rectangle {
    let [x1, y1, x2, y2, x3, y3, ..] = *points;
    let area = (x1 - x2).hypot(y1 - y2) * (x2 - x3).hypot(y2 - y3);
    let shrink = (area / (around.w * around.h)).sqrt();
    if !shrink.is_finite() {
        return around;
    }
    let mean = |axis: usize| points.iter().skip(axis).step_by(2).sum::<f64>() / 4.0;
    let (w, h) = (shrink * around.w + 1.0, shrink * around.h + 1.0);
    Rectangle::new(mean(0) - w / 2.0, mean(1) - h / 2.0, w, h)
}

/// The box around the pixels inside a mask, without drawing it.
fn mask_bounds(text: &str) -> Option<Rectangle> {
    let mut parts = text.split(',').map(str::trim);
    let offset: [i32; 2] = [parts.next()?.parse().ok()?, parts.next()?.parse().ok()?];
    let mut side = || {
        parts
            .next()?
            .parse()
            .ok()
            .filter(|side| (1..=MAX_SIDE).contains(side))
    };
    let (width, height) = (side()?, side()?);
    let (mut at, mut inside) = (0u64, false);
    let mut bounds: Option<[u64; 4]> = None; // left, top, right, bottom, all inside
    for part in parts {
        let run: u64 = part.parse().ok()?;
        let end = at.checked_add(run).filter(|end| *end <= width * height)?;
        if inside && run > 0 {
            let (top, bottom) = (at / width, (end - 1) / width);
            let (left, right) = if top == bottom {
                (at % width, (end - 1) % width)
            } else {
                (0, width - 1)
            };
            let [l, t, r, b] = bounds.unwrap_or([left, top, right, bottom]);
            bounds = Some([l.min(left), t.min(top), r.max(right), b.max(bottom)]);
        }
        (at, inside) = (end, !inside);
    }
    let [left, top, right, bottom] = bounds?.map(|v| v as f64);
    let [x, y] = offset.map(f64::from);
    Some(Rectangle::new(
        x + left,
        y + top,
        right - left + 1.0,
        bottom - top + 1.0,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangles_and_polygons() {
        let rectangle = Rectangle::new(1.0, -2.5, 3.5, 4.0);
        assert_eq!(
            Region::parse("1.0000, -2.5,3.5000,4").unwrap(),
            Region::Rectangle(rectangle)
        );
        assert_eq!(rectangle.to_string(), "1.0000,-2.5000,3.5000,4.0000");
        let triangle = Region::parse("0,0,10,0,4,6").unwrap();
        assert_eq!(
            triangle,
            Region::Polygon(Rectangle::new(0.0, 0.0, 10.0, 6.0))
        );
        // Upright: the same area, and one pixel more on each side.
        let upright = Region::parse("10,20,30,20,30,60,10,60").unwrap();
        assert_eq!(
            upright,
            Region::Polygon(Rectangle::new(9.5, 19.5, 21.0, 41.0))
        );
        // Turned by 45 degrees: half of the area around it.
        let Rectangle { x, y, w, h } = Region::parse("10,0,20,10,10,20,0,10").unwrap().rectangle();
        let side = 20.0 / 2f64.sqrt() + 1.0;
        assert!(
            (w - side).abs() + (h - side).abs() + (x - 10.0 + side / 2.0).abs() + (y - x).abs()
                < 1e-9
        );
        let flat = Region::parse("1,5,9,5,9,5,1,5").unwrap().rectangle();
        assert_eq!(flat, Rectangle::new(1.0, 5.0, 8.0, 0.0));
    }

    #[test]
    fn masks() {
        // The reference client's text of rows 1 and 2, columns 2 and 3 of a mask of 5 x 6 at 3,2.
        let expected = Region::Mask(Rectangle::new(5.0, 3.0, 2.0, 2.0));
        assert_eq!(Region::parse("mask:3,2,5,6,7,2,3,2").unwrap(), expected);
        assert_eq!(Region::parse("m3,2,5,6,7,2,3,2").unwrap(), expected);
        let over_rows = Region::parse("mask:-1,0,5,6,4,2").unwrap().rectangle();
        assert_eq!(over_rows, Rectangle::new(-1.0, 0.0, 5.0, 2.0));
        let all = Region::parse("mask:0,0,32768,32768,0,1073741824")
            .unwrap()
            .rectangle();
        assert_eq!((all.w, all.h), (32768.0, 32768.0));
    }

    #[test]
    fn what_is_no_region() {
        for text in [
            "",
            "0",
            "1,2,3",
            "1,2,3,4,5",
            "1,2,3,x",
            "nan,0,1,1",
            "1,2,inf,4",
            "1,2,3,4,5,6,7",
            "mask:",
            "m",
            "mask:0,0,5,5",
            "mask:0,0,5,5,25",
            "mask:0,0,5,5,0,26",
            "mask:0,0,0,5,1,1",
            "mask:0,0,99999,5,1,1",
            "mask:0,0,5,5,1,-1",
            "mask:0,0,5,5,18446744073709551615,1,1",
            "mask:9999999999,0,5,5,1,1",
        ] {
            assert!(Region::parse(text).is_err(), "{text}");
        }
    }
}
