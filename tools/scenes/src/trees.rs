//! Crowns of leaves as heaps of small discs, drawn once per frame from the camera's side and then
//! stamped many times.

use crate::math::{Rgb, V3, mix, v3};
use crate::palette::Palette;
use crate::rng::Rng;

/// A tuft of leaves: a disc facing the camera.
#[derive(Clone, Copy)]
pub(crate) struct Tuft {
    pub at: V3,
    pub radius: f32,
    pub color: Rgb,
}

/// A crown around its own middle, about one meter in radius.
pub(crate) struct Crown {
    pub tufts: Vec<Tuft>,
}

/// A tree: crowns stacked on a trunk.
#[derive(Clone, Copy)]
pub(crate) struct Tree {
    /// Index of the crown.
    pub crown: usize,
    /// Radius of the widest crown in meters.
    pub radius: f32,
    /// Height of the middle of the lowest crown.
    pub height: f32,
    /// Crowns above one another, each smaller: 1 for a round tree, more for a conifer or poplar.
    pub tiers: usize,
    /// Radius of the top crown over that of the lowest.
    pub taper: f32,
}

impl Tree {
    pub fn round(rng: &mut Rng, crowns: usize) -> Tree {
        let radius = rng.range(1.9, 3.9);
        Tree {
            crown: rng.below(crowns),
            radius,
            height: radius * rng.range(1.15, 1.5),
            tiers: 1,
            taper: 1.0,
        }
    }

    pub fn conifer(rng: &mut Rng, crowns: usize) -> Tree {
        let radius = rng.range(1.6, 2.5);
        Tree {
            crown: crowns,
            radius,
            height: radius * 1.05,
            tiers: 3,
            taper: 0.4,
        }
    }

    pub fn bush(rng: &mut Rng, crowns: usize) -> Tree {
        let radius = rng.range(0.5, 1.2);
        Tree {
            crown: rng.below(crowns),
            radius,
            height: radius * 0.55,
            tiers: 1,
            taper: 1.0,
        }
    }

    /// Height above ground and radius of each crown, from the lowest up.
    pub fn crowns(&self) -> impl Iterator<Item = (f32, f32)> + '_ {
        let mut z = self.height;
        (0..self.tiers).map(move |i| {
            let k = i as f32 / (self.tiers.max(2) - 1) as f32;
            let radius = self.radius * (1.0 + (self.taper - 1.0) * k);
            let at = (z, radius);
            z += radius * 1.15;
            at
        })
    }
}

/// Makes a flight's crowns: broad-leaved ones of varied shape and color, then one of needles.
pub(crate) fn crowns(rng: &mut Rng, palette: &Palette, broad: usize) -> Vec<Crown> {
    let mut all: Vec<Crown> = (0..broad)
        .map(|i| crown(rng, palette, palette.leaves[i % 4], false))
        .collect();
    all.push(crown(rng, palette, palette.needles, true));
    all
}

fn direction(rng: &mut Rng) -> V3 {
    loop {
        let p = v3(
            rng.range(-1.0, 1.0),
            rng.range(-1.0, 1.0),
            rng.range(-1.0, 1.0),
        );
        if p.length() < 1.0 {
            return p.unit();
        }
    }
}

fn crown(rng: &mut Rng, palette: &Palette, leaf: Rgb, needles: bool) -> Crown {
    let mut tufts = Vec::new();
    let boughs: Vec<(V3, f32)> = if needles {
        vec![(v3(0.0, 0.0, -0.1), 0.86)]
    } else {
        let n = 5 + rng.below(4);
        let bough = |i: usize, rng: &mut Rng| {
            let side = direction(rng);
            let reach = if i == 0 { 0.0 } else { rng.range(0.42, 0.6) };
            (
                v3(
                    side.x * reach,
                    side.y * reach,
                    side.z.abs() * reach * 0.75 - 0.12,
                ),
                rng.range(0.42, 0.56),
            )
        };
        (0..n).map(|i| bough(i, rng)).collect()
    };
    let each = 700 / boughs.len();
    for (middle, size) in boughs {
        for _ in 0..each {
            let out = direction(rng);
            if out.z < -0.55 {
                continue;
            }
            let mut at = middle + out * (size * rng.range(0.84, 1.08));
            if needles {
                // A cone: wide below, narrow above, in whorls.
                let k = (0.95 - at.z * 0.62).max(0.1) * rng.range(0.8, 1.12);
                at = v3(at.x * k, at.y * k, at.z * 0.9);
            }
            let normal = (out + at.unit() * 0.6).unit();
            let depth = ((at.z + 0.9) / 1.7).clamp(0.0, 1.0) * (0.35 + 0.65 * at.length().min(1.0));
            let light = palette.light(normal) * (0.56 + 0.68 * depth) * rng.range(0.82, 1.18);
            let leaf = mix(leaf, palette.leaves[rng.below(4)], 0.12);
            let warm = rng.range(0.95, 1.06);
            let color = [
                leaf[0] * light * warm * palette.tint[0],
                leaf[1] * light * palette.tint[1],
                leaf[2] * light * palette.tint[2] / warm,
            ];
            tufts.push(Tuft {
                at,
                radius: rng.range(0.05, 0.115),
                color,
            });
        }
    }
    Crown { tufts }
}
