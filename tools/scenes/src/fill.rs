//! The pixels that a convex polygon or a disc covers, as spans of rows.

use crate::math::ceil;

/// Calls `row(y, first, end)` for every row in which the convex polygon covers pixel centers,
/// within `width` x `height`.
#[inline(always)]
pub(crate) fn polygon<const N: usize>(
    corners: &[(f32, f32); N],
    width: usize,
    height: usize,
    mut row: impl FnMut(usize, usize, usize),
) {
    let (mut low, mut high) = (f32::MAX, f32::MIN);
    for c in corners {
        (low, high) = (low.min(c.1), high.max(c.1));
    }
    let first = ceil(low - 0.5);
    let end = ceil(high - 0.5).min(height);
    for y in first..end {
        let level = y as f32 + 0.5;
        let (mut left, mut right) = (f32::MAX, f32::MIN);
        for i in 0..N {
            let (a, b) = (corners[i], corners[(i + 1) % N]);
            if (a.1 <= level) != (b.1 <= level) {
                let x = a.0 + (b.0 - a.0) * ((level - a.1) / (b.1 - a.1));
                (left, right) = (left.min(x), right.max(x));
            }
        }
        let from = ceil(left - 0.5);
        let to = ceil(right - 0.5).min(width);
        if from < to {
            row(y, from, to);
        }
    }
}

/// Calls `row(y, first, end)` for every row in which the ellipse covers pixel centers.
#[inline(always)]
pub(crate) fn ellipse(
    center: (f32, f32),
    radius: (f32, f32),
    width: usize,
    height: usize,
    mut row: impl FnMut(usize, usize, usize),
) {
    let first = ceil(center.1 - radius.1 - 0.5);
    let end = ceil(center.1 + radius.1 - 0.5).min(height);
    for y in first..end {
        let v = (y as f32 + 0.5 - center.1) / radius.1;
        let half = radius.0 * (1.0 - v * v).max(0.0).sqrt();
        let from = ceil(center.0 - half - 0.5);
        let to = ceil(center.0 + half - 0.5).min(width);
        if from < to {
            row(y, from, to);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rectangle_covers_exactly_its_pixels_and_is_clipped() {
        let mut area = 0;
        polygon(
            &[(2.0, 3.0), (7.0, 3.0), (7.0, 5.0), (2.0, 5.0)],
            100,
            100,
            |y, a, b| {
                assert!((3..5).contains(&y) && (a, b) == (2, 7));
                area += b - a;
            },
        );
        assert_eq!(area, 10);
        polygon(
            &[(-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0)],
            4,
            4,
            |_, a, b| area += b - a,
        );
        assert_eq!(area, 26);
        polygon(
            &[(f32::NAN, 0.0), (1e30, -1e30), (1e30, 9.0)],
            4,
            4,
            |_, _, _| (),
        );
    }

    #[test]
    fn disc_covers_its_area() {
        let mut area = 0;
        ellipse((50.0, 50.0), (20.0, 10.0), 100, 100, |_, a, b| {
            area += b - a
        });
        assert!((area as f32 - std::f32::consts::PI * 200.0).abs() < 15.0);
    }
}
