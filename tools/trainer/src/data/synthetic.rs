//! Synthetic pairs: a cutout before two backgrounds.

use super::cutout::{Cutout, Place};
use super::geometry::View;
use super::picture::Picture;
use crate::rng::Rng;
use std::sync::Arc;

/// Two pictures of one cutout before different backgrounds, or before the same one in another
/// place.
///
/// With `bends` the cutout changes its outline and its stretch more between them. `None` if too
/// little of it is in a picture.
pub fn made_up_pair(
    backgrounds: [&Arc<Picture>; 2],
    cutout: &Cutout,
    bends: bool,
    rng: &mut Rng,
) -> Option<(View, View)> {
    let least = |p: &Picture| p.width.min(p.height) as f32;
    let side = rng
        .log_range(14.0, 72.0)
        .min(0.25 * least(backgrounds[0]).min(least(backgrounds[1])));
    let root = cutout.aspect().sqrt();
    let size = [side * root, side / root];
    let within = |p: &Picture, rng: &mut Rng| {
        [
            p.width as f32 * rng.range(0.15, 0.85),
            p.height as f32 * rng.range(0.15, 0.85),
        ]
    };
    let first = within(backgrounds[0], rng);
    let second = if Arc::ptr_eq(backgrounds[0], backgrounds[1]) {
        let limit = [backgrounds[0].width as f32, backgrounds[0].height as f32];
        [0, 1]
            .map(|k| (first[k] + rng.range(-2.0, 2.0) * side).clamp(0.1 * limit[k], 0.9 * limit[k]))
    } else {
        within(backgrounds[1], rng)
    };
    let (most, turn) = if bends { (0.3, 0.5) } else { (0.12, 0.25) };
    let stretch = rng.factor(most);
    let angle = if rng.chance(0.6) {
        rng.range(-turn, turn)
    } else {
        0.0
    };
    let grown = rng.factor(0.2);
    let other = [size[0] * stretch * grown, size[1] / stretch * grown];
    let mut later = cutout.later(rng);
    if bends {
        later = later.bent(rng);
    }
    let view = |cutout: &Cutout, background: &Arc<Picture>, place: &Place| {
        let mut picture = Picture::clone(background);
        let bbox = cutout.paste(&mut picture, place)?;
        Some(View {
            picture: Arc::new(picture),
            bbox,
        })
    };
    let first = view(
        cutout,
        backgrounds[0],
        &Place {
            center: first,
            size,
            angle: 0.0,
        },
    )?;
    let second = view(
        &later,
        backgrounds[1],
        &Place {
            center: second,
            size: other,
            angle,
        },
    )?;
    Some((first, second))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::plain;
    use track_cpu::BBox;

    #[test]
    fn synthetic_pairs_lie_within_their_pictures() {
        let (a, b) = (plain(40, 300, 200), plain(90, 160, 220));
        let mut rng = Rng::new(9, 0, 0);
        let mut made = 0;
        for i in 0..100 {
            let cutout = Cutout::random(&a, rng.factor(1.0), 60.0, &mut rng);
            let backgrounds = if i % 2 == 0 { [&a, &a] } else { [&a, &b] };
            let Some((first, second)) = made_up_pair(backgrounds, &cutout, i % 3 == 0, &mut rng)
            else {
                continue;
            };
            made += 1;
            for view in [first, second] {
                let BBox { x, y, w, h } = view.bbox;
                assert!(x >= 0.0 && y >= 0.0 && w >= 3.0 && h >= 3.0);
                assert!(x + w <= view.picture.width as f32 && y + h <= view.picture.height as f32);
            }
        }
        assert!(made > 90, "{made}");
    }
}
