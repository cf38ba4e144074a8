//! Parts cut out of pictures: their outline, how they turn or bend, and how they are pasted.

use super::geometry::View;
use super::photo::{apply, curves};
use super::picture::Picture;
use super::warp::blend;
use crate::rng::Rng;
use std::f32::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;
use track_cpu::BBox;

/// A part of a picture and its outline.
#[derive(Clone, Debug)]
pub struct Cutout {
    picture: Arc<Picture>,
    center: [f32; 2], // picture pixels
    half: [f32; 2],   // half width and height, likewise
    outline: Outline,
    pub(super) curves: Option<Box<[[u8; 256]; 3]>>,
    body: Option<Body>,
    /// Factors of the radius at which the picture is read, at equal angles; empty for none.
    bend: Vec<f32>,
}

/// A ball around which the picture is wrapped. As it turns, parts beside the cutout come into view.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Body {
    /// Rotation about the vertical and the horizontal axis, in radians.
    turned: [f32; 2],
    /// Unit vector toward the light: right, down, toward the viewer.
    light: [f32; 3],
}

impl Body {
    fn random(rng: &mut Rng) -> Body {
        let (height, round) = (rng.range(0.3, 1.0), rng.range(0.0, TAU));
        let flat = (1.0 - height * height).sqrt();
        Body {
            turned: [0.0; 2],
            light: [flat * round.cos(), flat * round.sin(), height],
        }
    }

    /// The same body some time later.
    fn later(self, rng: &mut Rng) -> Body {
        Body {
            turned: [rng.range(-1.0, 1.0), rng.range(-0.4, 0.4)],
            ..self
        }
    }

    /// The place of the picture that is visible at a place within the outline, both in half sizes
    /// from the center, and the brightness there.
    fn look(&self, u: f32, v: f32) -> ([f32; 2], f32) {
        let z = (1.0 - u * u - v * v).max(0.0).sqrt();
        let facing = u * self.light[0] + v * self.light[1] + z * self.light[2];
        let ((sin, cos), (rise, level)) = (self.turned[0].sin_cos(), self.turned[1].sin_cos());
        let (x, z) = (u * cos + z * sin, z * cos - u * sin);
        let (y, z) = (v * level + z * rise, z * level - v * rise);
        let at = [
            x.atan2(z) / FRAC_PI_2,
            y.clamp(-1.0, 1.0).asin() / FRAC_PI_2,
        ];
        (at, 0.6 + 0.5 * facing.max(0.0))
    }
}

/// An outline around the origin, in `-1..1` both ways.
#[derive(Clone, Debug)]
enum Outline {
    Rectangle,
    /// Radii at equal angles; straight between them in angle and radius.
    Star(Vec<f32>),
}

/// Where and how a cutout is pasted, in pixels of the picture it goes into.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Center.
    pub center: [f32; 2],
    /// Width and height before turning.
    pub size: [f32; 2],
    /// Angle in radians.
    pub angle: f32,
}

impl Outline {
    fn random(rng: &mut Rng) -> Outline {
        match rng.unit() {
            u if u < 0.25 => Outline::Rectangle,
            u if u < 0.6 => Outline::Star(vec![1.0]), // ellipse
            _ => Outline::Star(
                (0..5 + rng.below(7))
                    .map(|_| rng.range(0.55, 1.0))
                    .collect(),
            ),
        }
    }

    /// How far inside a point is, as a share of the half size; negative outside.
    fn depth(&self, u: f32, v: f32) -> f32 {
        match self {
            Outline::Rectangle => 1.0 - u.abs().max(v.abs()),
            Outline::Star(radii) => radius(radii, u, v) - u.hypot(v),
        }
    }

    /// The same outline after some parts have moved in or out, and the factors from its radii to
    /// the former ones.
    ///
    /// A rectangle stays as it is.
    fn bent(&self, rng: &mut Rng) -> (Outline, Vec<f32>) {
        const LIMBS: usize = 8; // of an ellipse
        let Outline::Star(radii) = self else {
            return (self.clone(), Vec::new());
        };
        let repeats = if radii.len() == 1 { LIMBS } else { 1 };
        let before = radii.repeat(repeats);
        let after: Vec<_> = before
            .iter()
            .map(|radius| (radius * rng.factor(0.35)).clamp(0.35, 1.0))
            .collect();
        let factors = before.iter().zip(&after).map(|(b, a)| b / a).collect();
        (Outline::Star(after), factors)
    }
}

/// Radius in the direction of a point, linear in angle between radii at equal angles.
fn radius(radii: &[f32], u: f32, v: f32) -> f32 {
    let at = (v.atan2(u) / TAU + 0.5) * radii.len() as f32;
    let (first, share) = (at as usize, at.fract());
    let radius = |i: usize| radii[i % radii.len()];
    radius(first) + (radius(first + 1) - radius(first)) * share
}

impl Cutout {
    /// A random textured part of a picture, of `aspect` = width over height and sides of about
    /// `side` pixels.
    pub fn random(picture: &Arc<Picture>, aspect: f32, side: f32, rng: &mut Rng) -> Cutout {
        let bbox = textured_box(picture, aspect, side, rng);
        Cutout::of(
            &View {
                picture: picture.clone(),
                bbox,
            },
            rng,
        )
    }

    /// The contents of a target's box.
    pub fn of(view: &View, rng: &mut Rng) -> Cutout {
        let center = view.bbox.center();
        Cutout {
            picture: view.picture.clone(),
            center: [center.cx, center.cy],
            half: [view.bbox.w / 2.0, view.bbox.h / 2.0],
            outline: Outline::random(rng),
            curves: rng
                .chance(0.5)
                .then(|| Box::new(curves(rng, 0.35, 0.3, 0.15))),
            body: None,
            bend: Vec::new(),
        }
    }

    /// A rectangle of a picture around `center`, unchanged.
    pub fn patch(picture: &Arc<Picture>, center: [f32; 2], size: [f32; 2]) -> Cutout {
        Cutout {
            picture: picture.clone(),
            center,
            half: size.map(|s| s / 2.0),
            outline: Outline::Rectangle,
            curves: None,
            body: None,
            bend: Vec::new(),
        }
    }

    /// The same thing in plainly other colors: one channel brighter, another darker.
    pub fn recolored(self, rng: &mut Rng) -> Cutout {
        let mut gains = [
            rng.range(0.35, 0.9),
            rng.range(-0.9, -0.35),
            rng.range(-0.3, 0.3),
        ];
        for i in (1..gains.len()).rev() {
            gains.swap(i, rng.below(i + 1));
        }
        let curve = |gain: f32| {
            std::array::from_fn(|value| (value as f32 * gain.exp() + 0.5).min(255.0) as u8)
        };
        Cutout {
            curves: Some(Box::new(gains.map(curve))),
            ..self
        }
    }

    /// The same thing after some of its parts have moved; what is on them moves along.
    pub fn bent(self, rng: &mut Rng) -> Cutout {
        let (outline, bend) = self.outline.bent(rng);
        Cutout {
            outline,
            bend,
            ..self
        }
    }

    /// The same thing some time later: a ball has turned.
    pub fn later(&self, rng: &mut Rng) -> Cutout {
        Cutout {
            body: self.body.map(|body| body.later(rng)),
            ..self.clone()
        }
    }

    /// The same cutout on a ball.
    pub fn rounded(self, rng: &mut Rng) -> Cutout {
        Cutout {
            body: Some(Body::random(rng)),
            ..self
        }
    }

    /// Width over height.
    pub fn aspect(&self) -> f32 {
        self.half[0] / self.half[1]
    }

    /// Pastes into `picture` and returns the tight box of the visible part; `None` if fewer than 12
    /// pixels are visible.
    pub fn paste(&self, picture: &mut Picture, place: &Place) -> Option<BBox> {
        let (sin, cos) = place.angle.sin_cos();
        let half = place.size.map(|s| (s / 2.0).max(0.5));
        let reach = [
            half[0] * cos.abs() + half[1] * sin.abs() + 2.0,
            half[0] * sin.abs() + half[1] * cos.abs() + 2.0,
        ];
        let span = |k: usize, limit: usize| {
            let from = (place.center[k] - reach[k]).clamp(0.0, limit as f32) as usize;
            let to = (place.center[k] + reach[k] + 1.0).clamp(0.0, limit as f32) as usize;
            from..to
        };
        let (columns, rows) = (span(0, picture.width), span(1, picture.height));
        let softness = half[0].min(half[1]); // the edge is one pixel wide
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        let mut count = 0;
        for y in rows {
            for x in columns.clone() {
                let (dx, dy) = (x as f32 - place.center[0], y as f32 - place.center[1]);
                let u = (dx * cos + dy * sin) / half[0];
                let v = (dy * cos - dx * sin) / half[1];
                let cover = (self.outline.depth(u, v) * softness + 0.5).clamp(0.0, 1.0);
                if cover <= 0.0 {
                    continue;
                }
                if cover > 0.5 {
                    count += 1;
                    low = [low[0].min(x), low[1].min(y)];
                    high = [high[0].max(x), high[1].max(y)];
                }
                let color = self.sample(u, v);
                let at = (y * picture.width + x) * 3;
                for (value, color) in picture.data[at..at + 3].iter_mut().zip(color) {
                    let mixed = f32::from(*value) + (f32::from(color) - f32::from(*value)) * cover;
                    *value = (mixed + 0.5) as u8;
                }
            }
        }
        let size = |k: usize| (high[k] + 1 - low[k]) as f32;
        (count >= 12).then(|| BBox::new(low[0] as f32, low[1] as f32, size(0), size(1)))
    }

    /// Color at a place within the outline.
    fn sample(&self, u: f32, v: f32) -> [u8; 3] {
        let stretch = if self.bend.is_empty() {
            1.0
        } else {
            radius(&self.bend, u, v)
        };
        let [u, v] = [u * stretch, v * stretch];
        let ([u, v], brightness) = self.body.map_or(([u, v], 1.0), |body| body.look(u, v));
        let Picture {
            width,
            height,
            data,
            ..
        } = &*self.picture;
        let x = (self.center[0] + u * self.half[0]).clamp(0.0, (width - 1) as f32);
        let y = (self.center[1] + v * self.half[1]).clamp(0.0, (height - 1) as f32);
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let pixel = |x: usize, y: usize| &data[(y * width + x) * 3..][..3];
        let corners = [
            pixel(left, top),
            pixel(right, top),
            pixel(left, bottom),
            pixel(right, bottom),
        ];
        let mut color = [0, 1, 2].map(|k| blend(corners.map(|c| c[k]), x.fract(), y.fract()));
        if let Some(curves) = &self.curves {
            apply(&mut color, curves);
        }
        color.map(|value| (f32::from(value) * brightness) as u8)
    }
}

/// A box of `aspect` = width over height and sides about `side` pixels (at most 0.4 of the
/// picture's), the most textured of a few.
pub fn textured_box(picture: &Picture, aspect: f32, side: f32, rng: &mut Rng) -> BBox {
    let (width, height) = (picture.width as f32, picture.height as f32);
    let side = side.min(0.4 * width.min(height)).max(2.0);
    let w = (side * aspect.sqrt()).min(0.9 * width).max(2.0);
    let h = (side / aspect.sqrt()).min(0.9 * height).max(2.0);
    let mut best = (f32::MIN, BBox::default());
    for _ in 0..3 {
        let bbox = BBox::new(rng.range(0.0, width - w), rng.range(0.0, height - h), w, h);
        let texture = texture(picture, &bbox);
        if texture > best.0 {
            best = (texture, bbox);
        }
        if texture > 28.0 {
            break;
        }
    }
    best.1
}

/// Standard deviation of the green channel within a box.
fn texture(picture: &Picture, bbox: &BBox) -> f32 {
    let (mut n, mut sum, mut squares) = (0.0f32, 0.0f32, 0.0f32);
    for y in (bbox.y as usize..(bbox.y + bbox.h) as usize).step_by(2) {
        for x in (bbox.x as usize..(bbox.x + bbox.w) as usize).step_by(2) {
            let value = f32::from(picture.data[(y * picture.width + x) * 3 + 1]);
            n += 1.0;
            sum += value;
            squares += value * value;
        }
    }
    (squares / n - (sum / n).powi(2)).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::plain;

    #[test]
    fn pasted_cutout_has_a_tight_box() {
        let white = plain(255, 40, 30);
        let mut rng = Rng::new(7, 0, 0);
        for i in 0..200 {
            let mut cutout = Cutout::random(&white, rng.factor(0.7), 12.0, &mut rng);
            cutout.curves = None;
            let mut canvas = Picture::clone(&plain(0, 90, 70));
            let place = Place {
                center: [rng.range(0.0, 90.0), rng.range(0.0, 70.0)],
                size: [rng.range(6.0, 40.0), rng.range(6.0, 40.0)],
                angle: rng.range(-1.0, 1.0),
            };
            let Some(bbox) = cutout.paste(&mut canvas, &place) else {
                continue;
            };
            let bright = |x: usize, y: usize| canvas.data[(y * 90 + x) * 3] > 128;
            let columns: Vec<_> = (0..90).filter(|x| (0..70).any(|y| bright(*x, y))).collect();
            let rows: Vec<_> = (0..70).filter(|y| (0..90).any(|x| bright(x, *y))).collect();
            let expected = [
                columns[0],
                rows[0],
                columns[columns.len() - 1],
                rows[rows.len() - 1],
            ];
            let found =
                [bbox.x, bbox.y, bbox.x + bbox.w - 1.0, bbox.y + bbox.h - 1.0].map(|v| v as usize);
            for (a, b) in found.iter().zip(expected) {
                assert!(a.abs_diff(b) <= 1, "{i}: {found:?}, expected {expected:?}");
            }
        }
    }

    #[test]
    fn ellipse_and_rectangle_have_their_area() {
        let white = plain(255, 40, 30);
        for outline in [Outline::Rectangle, Outline::Star(vec![1.0])] {
            let cutout = Cutout {
                outline,
                curves: None,
                ..Cutout::random(&white, 1.0, 10.0, &mut Rng::new(0, 0, 0))
            };
            let mut canvas = Picture::clone(&plain(0, 90, 70));
            let place = Place {
                center: [44.5, 30.5],
                size: [30.0, 20.0],
                angle: 0.0,
            };
            let bbox = cutout.paste(&mut canvas, &place).unwrap();
            assert_eq!(bbox, BBox::new(30.0, 21.0, 30.0, 20.0));
        }
    }

    #[test]
    fn ball_shows_its_picture_and_turns() {
        let front = Body {
            turned: [0.0; 2],
            light: [0.0, 0.0, 1.0],
        };
        assert_eq!(front.look(0.0, 0.0), ([0.0; 2], 1.1));
        let ([right, level], dim) = front.look(1.0, 0.0);
        assert!((right - 1.0).abs() < 1e-6 && level == 0.0 && (dim - 0.6).abs() < 1e-6);
        // Turned by a quarter about its upright axis, what was at the rim is in the middle.
        let turned = Body {
            turned: [FRAC_PI_2, 0.0],
            ..front
        };
        assert!((turned.look(0.0, 0.0).0[0] - 1.0).abs() < 1e-6);
        assert!((turned.look(-1.0, 0.0).0[0]).abs() < 1e-6);
        let nodding = Body {
            turned: [0.0, FRAC_PI_2],
            ..front
        };
        assert!((nodding.look(0.0, 0.0).0[1] - 1.0).abs() < 1e-3);
    }

    #[test]
    fn recolored_gray_thing_has_a_plain_color() {
        let gray = plain(100, 40, 40);
        let mut rng = Rng::new(16, 0, 0);
        for _ in 0..50 {
            let cutout = Cutout::random(&gray, 1.0, 12.0, &mut rng).recolored(&mut rng);

            let color = cutout.sample(0.0, 0.0);

            let (low, high) = (color.iter().min().unwrap(), color.iter().max().unwrap());
            assert!(f32::from(*high) > 1.8 * f32::from(*low), "{color:?}");
        }
    }

    #[test]
    fn bent_thing_carries_its_texture_along() {
        // Bright up to half of the radius: a bent outline moves the edge by the same factor.
        let data: Vec<u8> = (0..80 * 80)
            .flat_map(|i| {
                let (x, y) = ((i % 80) as f32 - 40.0, (i / 80) as f32 - 40.0);
                [if x.hypot(y) < 15.0 { 255 } else { 0 }; 3]
            })
            .collect();
        let picture = Arc::new(Picture::new(80, 80, data));
        let view = View {
            picture,
            bbox: BBox::new(10.0, 10.0, 60.0, 60.0),
        };
        let mut rng = Rng::new(17, 0, 0);
        let mut cutout = Cutout::of(&view, &mut rng);
        (cutout.outline, cutout.curves) = (Outline::Star(vec![1.0]), None);

        let bent = cutout.bent(&mut rng);

        let Outline::Star(radii) = &bent.outline else {
            panic!("an ellipse stays a star");
        };
        let spread = radii.iter().fold((1.0f32, 0.0f32), |(low, high), r| {
            (low.min(*r), high.max(*r))
        });
        assert!(spread.1 - spread.0 > 0.1, "{radii:?}");
        for (i, edge) in radii.iter().enumerate() {
            let (sin, cos) = ((i as f32 / radii.len() as f32 - 0.5) * TAU).sin_cos();
            assert_eq!(bent.sample(0.4 * edge * cos, 0.4 * edge * sin)[0], 255);
            assert_eq!(bent.sample(0.6 * edge * cos, 0.6 * edge * sin)[0], 0);
        }
    }
}
