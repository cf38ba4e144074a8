//! What is pasted into the search picture around its target: distractors, masks, shadows and
//! occluders.

use super::cutout::{Cutout, Place};
use super::picture::Picture;
use crate::rng::Rng;
use std::f32::consts::TAU;
use std::sync::Arc;
use track_cpu::BBox;

/// Where pasted look-alikes stand: shares of those that cover and that touch the target; the others
/// keep apart.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Crowd {
    /// Share that cover 10 to 50 % of the target's box.
    pub overlap: f32,
    /// Share that stand directly beside the target.
    pub adjacent: f32,
}

/// Pastes `count` things of about the target's size near it.
pub fn distractors(
    picture: &mut Picture,
    bbox: &BBox,
    count: usize,
    crowd: Crowd,
    mut next: impl FnMut(&mut Rng) -> Option<Cutout>,
    rng: &mut Rng,
) {
    let target = bbox.center();
    let reach = 2.0 * (bbox.w + bbox.h); // about the search crop
    for _ in 0..count {
        let Some(cutout) = next(rng) else { continue };
        let side = (bbox.w * bbox.h).sqrt() * rng.range(-0.5, 0.35).exp();
        let root = cutout.aspect().sqrt();
        let size = [side * root, side / root];
        if rng.sometimes(crowd.overlap) {
            cutout.paste(picture, &covering(bbox, size, rng));
            continue;
        }
        // Two draws, so that `adjacent` is a share of all.
        if rng.sometimes(crowd.adjacent / (1.0 - crowd.overlap).max(1e-6)) {
            cutout.paste(picture, &touching(bbox, size, rng));
            continue;
        }
        for _ in 0..6 {
            let center = [
                target.cx + rng.range(-reach, reach),
                target.cy + rng.range(-reach, reach),
            ];
            let apart = (center[0] - target.cx).abs() > (size[0] + bbox.w) / 2.0
                || (center[1] - target.cy).abs() > (size[1] + bbox.h) / 2.0;
            if apart {
                let angle = rng.range(-0.5, 0.5);
                cutout.paste(
                    picture,
                    &Place {
                        center,
                        size,
                        angle,
                    },
                );
                break;
            }
        }
    }
}

/// A place at which a thing of `size` covers 10 to 50 % of a box.
fn covering(bbox: &BBox, size: [f32; 2], rng: &mut Rng) -> Place {
    let target = bbox.center();
    let box_size = [bbox.w, bbox.h];
    let (sin, cos) = rng.range(0.0, TAU).sin_cos();
    let share = rng.range(0.1, 0.5);
    let covered = |distance: f32| {
        let offset = [cos * distance, sin * distance];
        let side = |k: usize| {
            let apart = (size[k] + box_size[k]) / 2.0 - offset[k].abs();
            apart.clamp(0.0, size[k].min(box_size[k])) / box_size[k]
        };
        side(0) * side(1)
    };
    // The covered share falls with the distance: bisection. A small thing covers less than asked
    // for.
    let (mut near, mut far) = (0.0, size[0] + size[1] + bbox.w + bbox.h);
    for _ in 0..24 {
        let middle = (near + far) / 2.0;
        if covered(middle) > share {
            near = middle;
        } else {
            far = middle;
        }
    }
    Place {
        center: [target.cx + cos * far, target.cy + sin * far],
        size,
        angle: 0.0,
    }
}

/// A place directly beside a box: left, right, above or below, with a gap of at most a tenth of the
/// box.
fn touching(bbox: &BBox, size: [f32; 2], rng: &mut Rng) -> Place {
    let target = bbox.center();
    let box_size = [bbox.w, bbox.h];
    let (k, sign) = (rng.below(2), if rng.chance(0.5) { 1.0 } else { -1.0 });
    let gap = rng.range(0.0, 0.1) * box_size[k];
    let mut center = [target.cx, target.cy];
    center[k] += sign * ((size[k] + box_size[k]) / 2.0 + gap);
    center[1 - k] += rng.range(-0.5, 0.5) * box_size[1 - k];
    Place {
        center,
        size,
        angle: 0.0,
    }
}

/// Hides 15 to 45 % of the target, from one of its sides on, behind a patch of `background`, its
/// picture as it was taken.
pub fn mask(picture: &mut Picture, background: &Arc<Picture>, bbox: &BBox, rng: &mut Rng) {
    let share = rng.range(0.15, 0.45);
    let (k, low) = (rng.below(2), rng.chance(0.5));
    let mut size = [bbox.w, bbox.h];
    size[k] *= share;
    let mut center = [bbox.center().cx, bbox.center().cy];
    let whole = [bbox.w, bbox.h][k];
    center[k] += if low { -1.0 } else { 1.0 } * whole * (1.0 - share) / 2.0;
    // The patch is cut out beside the target: a whole box and more away, back inside the picture
    // where that is outside.
    let (sin, cos) = rng.range(0.0, TAU).sin_cos();
    let away = (bbox.w.hypot(bbox.h)) * rng.range(1.0, 1.8);
    let limit = [picture.width as f32, picture.height as f32];
    let from = [bbox.center().cx + cos * away, bbox.center().cy + sin * away];
    let from =
        [0, 1].map(|k| from[k].clamp(size[k] / 2.0, (limit[k] - size[k] / 2.0).max(size[k] / 2.0)));
    Cutout::patch(background, from, size).paste(
        picture,
        &Place {
            center,
            size,
            angle: 0.0,
        },
    );
}

/// Darkens the ground beside the target: a slanted copy of its ellipse that begins at its lower
/// edge, spares the target.
pub fn shadow(picture: &mut Picture, bbox: &BBox, rng: &mut Rng) {
    let target = bbox.center();
    let strength = rng.range(0.35, 0.7);
    let length = bbox.h * rng.range(0.4, 1.2);
    let slant = rng.range(-1.5, 1.5);
    let foot = bbox.y + 0.9 * bbox.h;
    let (half_w, half_h) = (bbox.w / 2.0, bbox.h / 2.0);
    let reach = length * slant.abs() + bbox.w;
    let span = |from: f32, to: f32, limit: usize| {
        from.clamp(0.0, limit as f32) as usize..to.clamp(0.0, limit as f32) as usize
    };
    for y in span(foot - length / 2.0, foot + length, picture.height) {
        for x in span(target.cx - reach, target.cx + reach, picture.width) {
            let (px, py) = (x as f32 - target.cx, y as f32);
            let on_target = (px / half_w).hypot((py - target.cy) / half_h) < 1.0;
            // In the shadow's own upright coordinates.
            let v = (py - foot) / (length / 2.0) - 1.0;
            let u = (px - (py - foot) * slant) / half_w;
            let depth = 1.0 - u.hypot(v);
            if on_target || depth <= 0.0 {
                continue;
            }
            let gain = 1.0 - (1.0 - strength) * (depth * 4.0).min(1.0);
            let at = (y * picture.width + x) * 3;
            for value in &mut picture.data[at..at + 3] {
                *value = (f32::from(*value) * gain) as u8;
            }
        }
    }
}

/// Pastes something over a side of the target.
pub fn occlude(picture: &mut Picture, bbox: &BBox, cutout: &Cutout, rng: &mut Rng) {
    let (sin, cos) = rng.range(0.0, TAU).sin_cos();
    let target = bbox.center();
    let center = [
        target.cx + cos * bbox.w * 0.45,
        target.cy + sin * bbox.h * 0.45,
    ];
    let size = [bbox.w * rng.range(0.4, 0.65), bbox.h * rng.range(0.4, 0.65)];
    cutout.paste(
        picture,
        &Place {
            center,
            size,
            angle: 0.0,
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::plain;

    #[test]
    fn distant_distractors_spare_the_target() {
        let white = plain(255, 60, 60);
        let mut rng = Rng::new(8, 0, 0);
        let bbox = BBox::new(80.0, 60.0, 24.0, 16.0);
        let mut pasted = 0;
        for _ in 0..50 {
            let mut canvas = Picture::clone(&plain(0, 200, 150));
            let next = |rng: &mut Rng| {
                let mut cutout = Cutout::random(&white, 1.0, 20.0, rng);
                cutout.curves = None;
                Some(cutout)
            };
            distractors(&mut canvas, &bbox, 2, Crowd::default(), next, &mut rng);
            pasted += usize::from(canvas.data.iter().any(|v| *v > 128));
            for y in 62..74 {
                for x in 83..101 {
                    assert_eq!(canvas.data[(y * 200 + x) * 3], 0);
                }
            }
        }
        assert!(pasted > 40, "{pasted}");
    }

    /// Share of a box's pixels that are bright, and whether anything is.
    fn bright_share(canvas: &Picture, bbox: &BBox) -> f32 {
        let mut count = 0;
        for y in bbox.y as usize..(bbox.y + bbox.h) as usize {
            for x in bbox.x as usize..(bbox.x + bbox.w) as usize {
                count += usize::from(canvas.data[(y * canvas.width + x) * 3] > 128);
            }
        }
        count as f32 / bbox.area()
    }

    #[test]
    fn overlapping_distractor_covers_a_bounded_share() {
        let white = plain(255, 60, 60);
        let mut rng = Rng::new(12, 0, 0);
        let crowd = Crowd {
            overlap: 1.0,
            adjacent: 0.0,
        };
        let (mut touched, mut most) = (0, 0.0f32);
        for i in 0..200 {
            let bbox = [
                BBox::new(83.0, 62.0, 18.0, 12.0),
                BBox::new(70.0, 40.0, 16.0, 50.0),
            ][i % 2];
            let mut canvas = Picture::clone(&plain(0, 200, 150));
            let next = |rng: &mut Rng| {
                let mut cutout = Cutout::random(&white, rng.factor(0.8), 20.0, rng);
                cutout.curves = None;
                Some(cutout)
            };

            distractors(&mut canvas, &bbox, 1, crowd, next, &mut rng);

            let share = bright_share(&canvas, &bbox);
            touched += usize::from(share > 0.0);
            most = most.max(share);
        }
        assert!(touched > 150, "{touched} of 200 cover anything");
        assert!((0.3..0.6).contains(&most), "{most}");
    }

    #[test]
    fn adjacent_distractor_touches_but_does_not_cover() {
        let white = plain(255, 60, 60);
        let mut rng = Rng::new(13, 0, 0);
        let crowd = Crowd {
            overlap: 0.0,
            adjacent: 1.0,
        };
        for _ in 0..100 {
            let bbox = BBox::new(83.0, 62.0, 18.0, 12.0);
            let mut canvas = Picture::clone(&plain(0, 200, 150));
            let next = |_: &mut Rng| Some(Cutout::patch(&white, [30.0; 2], [20.0; 2]));

            distractors(&mut canvas, &bbox, 1, crowd, next, &mut rng);

            assert!(bright_share(&canvas, &bbox) < 0.1, "an edge pixel at most");
            let around = BBox::new(bbox.x - 4.0, bbox.y - 4.0, bbox.w + 8.0, bbox.h + 8.0);
            assert!(bright_share(&canvas, &around) > 0.02);
        }
    }

    #[test]
    fn mask_hides_a_bounded_share_and_nothing_outside_the_target() {
        let white = plain(255, 200, 150);
        let mut rng = Rng::new(14, 0, 0);
        for _ in 0..100 {
            let bbox = BBox::new(60.0, 50.0, 40.0, 24.0);
            let mut canvas = Picture::clone(&plain(0, 200, 150));

            mask(&mut canvas, &white, &bbox, &mut rng);

            let share = bright_share(&canvas, &bbox);
            assert!((0.1..0.5).contains(&share), "{share}");
            let everywhere = BBox::new(0.0, 0.0, 200.0, 150.0);
            let all = bright_share(&canvas, &everywhere) * everywhere.area() / bbox.area();
            assert!(
                all < share * 1.2 + 0.05,
                "{all} of {share} lie on the target"
            );
        }
    }

    #[test]
    fn shadow_darkens_the_ground_and_spares_the_target() {
        let mut rng = Rng::new(15, 0, 0);
        let bbox = BBox::new(60.0, 50.0, 40.0, 24.0);
        for _ in 0..50 {
            let mut canvas = Picture::clone(&plain(200, 200, 150));

            shadow(&mut canvas, &bbox, &mut rng);

            let center = (62 * 200 + 80) * 3;
            assert_eq!(canvas.data[center], 200);
            let dark = canvas.data.iter().filter(|value| **value < 180).count() / 3;
            assert!(dark > 100, "{dark} dark pixels");
        }
    }
}
