//! Light, color and picture quality of a pair's crops.

use super::augment::Augment;
use super::filters;
use crate::rng::Rng;
use std::f32::consts::{PI, TAU};

/// A new value for each value of each channel.
type Curves = [[u8; 256]; 3];

/// Changes the crops of one pair, `[side, side, 3]` BGR each: the template, the search crop, and
/// the template of the search picture.
///
/// A `still` gets more changes between its crops, since it shows no change over time.
pub fn develop(crops: [Vec<u8>; 3], still: bool, augment: &Augment, rng: &mut Rng) -> [Vec<u8>; 3] {
    let shared = rng
        .chance(augment.shared_color)
        .then(|| curves(rng, 0.3, 0.25, 0.12));
    let own_chance = augment.own_color * if still { 2.0 } else { 1.0 };
    let own = rng.chance(own_chance).then(|| curves(rng, 0.2, 0.2, 0.06));
    let ramp = rng
        .chance(augment.side_light)
        .then(|| (rng.range(0.0, TAU), rng.range(0.15, 0.6)));
    let saturation = if rng.chance(augment.gray) {
        Some(0.0)
    } else {
        rng.chance(augment.saturation).then(|| rng.range(0.4, 1.3))
    };
    let inverted = still && rng.chance(augment.invert);
    let coarse = rng
        .chance(augment.low_resolution)
        .then(|| rng.range(0.3, 1.6).exp());
    let quality = if still { 1.6 } else { 0.8 };
    let mut number = 0;
    crops.map(|mut crop| {
        let side = ((crop.len() / 3) as f64).sqrt() as usize;
        if let Some(factor) = coarse {
            crop = filters::low_resolution(&crop, side, factor);
        }
        if let Some(curves) = &shared {
            apply(&mut crop, curves);
        }
        if let Some(curves) = own.as_ref().filter(|_| number > 0) {
            apply(&mut crop, curves);
        }
        if let Some((angle, reach)) = ramp.filter(|_| number > 0) {
            side_light(&mut crop, side, angle, reach);
        }
        if let Some(share) = saturation {
            saturate(&mut crop, share);
        }
        if inverted {
            crop.iter_mut().for_each(|v| *v = 255 - *v);
        }
        number += 1;
        degrade(crop, side, quality, augment, rng)
    })
}

/// Random curves: a gamma, a contrast, a brightness, and a gain per channel, each at most that far
/// in its logarithm.
pub fn curves(rng: &mut Rng, gamma: f32, contrast: f32, channel: f32) -> Curves {
    let (power, slope) = (rng.factor(gamma), rng.factor(contrast));
    let lift = rng.range(-contrast, contrast) * 0.35;
    [(); 3].map(|()| {
        let gain = rng.factor(channel);
        std::array::from_fn(|value| {
            let bright = ((value as f32 / 255.0).powf(power) - 0.5) * slope + 0.5 + lift;
            (bright * gain * 255.0 + 0.5).clamp(0.0, 255.0) as u8
        })
    })
}

/// Maps every value by the curve of its channel.
pub fn apply(image: &mut [u8], curves: &Curves) {
    for pixel in image.chunks_exact_mut(3) {
        for (value, curve) in pixel.iter_mut().zip(curves) {
            *value = curve[usize::from(*value)];
        }
    }
}

/// Brighter by the share `reach` at one side of the crop, darker at the other.
fn side_light(image: &mut [u8], side: usize, angle: f32, reach: f32) {
    let (sin, cos) = angle.sin_cos();
    let place = |i: usize| 2.0 * i as f32 / side as f32 - 1.0;
    for (y, row) in image.chunks_exact_mut(3 * side).enumerate() {
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let gain = 1.0 + reach * (cos * place(x) + sin * place(y)).clamp(-1.0, 1.0);
            pixel
                .iter_mut()
                .for_each(|value| *value = (f32::from(*value) * gain) as u8); // saturates
        }
    }
}

/// `share` of the color, 0 for gray.
fn saturate(image: &mut [u8], share: f32) {
    let share = (share * 256.0) as i32;
    for pixel in image.chunks_exact_mut(3) {
        let [b, g, r] = [pixel[0], pixel[1], pixel[2]].map(i32::from);
        let gray = (29 * b + 150 * g + 77 * r) >> 8;
        for value in pixel {
            *value = (gray + (((i32::from(*value) - gray) * share) >> 8)).clamp(0, 255) as u8;
        }
    }
}

fn degrade(mut crop: Vec<u8>, side: usize, more: f32, augment: &Augment, rng: &mut Rng) -> Vec<u8> {
    if rng.chance(augment.blur * more) {
        crop = filters::blur(&crop, side, rng.range(0.4, 1.8));
    }
    if rng.chance(augment.motion_blur * more) {
        crop = filters::motion_blur(&crop, side, 3 + rng.below(11), rng.range(0.0, PI));
    }
    if rng.chance(augment.noise * more) {
        filters::noise(&mut crop, rng.range(2.0, 9.0), rng);
    }
    if rng.chance(augment.jpeg * more) {
        crop = filters::jpeg(&crop, side, 22 + rng.below(54) as u8);
    }
    crop
}

#[cfg(test)]
mod tests {
    use super::*;

    fn crops() -> [Vec<u8>; 3] {
        let mut rng = Rng::new(1, 0, 0);
        [31, 61, 31].map(|side| (0..side * side * 3).map(|_| rng.bits() as u8).collect())
    }

    #[test]
    fn crops_without_augmentation_stay() {
        assert_eq!(
            develop(crops(), true, &Augment::none(), &mut Rng::new(0, 0, 0)),
            crops()
        );
    }

    #[test]
    fn saturation_scales_the_distance_from_gray() {
        let gray = Augment {
            gray: 1.0,
            ..Augment::none()
        };
        for crop in develop(crops(), false, &gray, &mut Rng::new(0, 0, 0)) {
            assert!(crop.chunks(3).all(|p| p[0] == p[1] && p[1] == p[2]));
        }
        let mut pixel = [0, 100, 200];
        saturate(&mut pixel, 0.5);
        assert_eq!(pixel, [59, 109, 159]); // gray is 118
    }

    #[test]
    fn shared_colors_change_all_crops_and_own_spare_the_template() {
        let same = [vec![40; 27], vec![40; 27], vec![40; 27]];
        let mut rng = Rng::new(2, 0, 0);
        let shared = Augment {
            shared_color: 1.0,
            ..Augment::none()
        };
        let own = Augment {
            own_color: 1.0,
            ..Augment::none()
        };
        for _ in 0..20 {
            let [z, x, again] = develop(same.clone(), false, &shared, &mut rng);
            assert!(z == x && x == again);
            let [z, x, again] = develop(same.clone(), false, &own, &mut rng);
            assert!(z == same[0] && x == again);
        }
    }

    #[test]
    fn side_light_brightens_one_side() {
        let mut image = vec![100; 21 * 21 * 3];
        side_light(&mut image, 21, 0.0, 0.5);
        let at = |x: usize| image[(7 * 21 + x) * 3];
        assert!(
            (50..55).contains(&at(0))
                && (97..100).contains(&at(10))
                && (143..150).contains(&at(20))
        );
    }

    #[test]
    fn strong_augmentation_keeps_the_sizes_of_crops() {
        let mut rng = Rng::new(3, 0, 0);
        for _ in 0..40 {
            for (found, given) in develop(crops(), true, &Augment::strong(), &mut rng)
                .iter()
                .zip(crops())
            {
                assert_eq!(found.len(), given.len());
            }
        }
    }
}
