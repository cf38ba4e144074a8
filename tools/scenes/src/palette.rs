//! The colors and the light of one flight: biome, season and sun chosen from the seed.

use crate::math::{Rgb, V3, mix, scaled, v3};
use crate::rng::Rng;

/// Kind of country.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Biome {
    /// Plowed and green fields, a country road, scattered farms.
    Farmland,
    /// Streets with pavements, houses, gardens, parked cars.
    Town,
    /// A shore or a quay with boats, and a promenade behind it.
    Coast,
    /// A narrow road between dense trees.
    Forest,
    /// Lawns, gravel paths and a pond, with people.
    Park,
    /// A dual carriageway through the country.
    Highway,
}

impl Biome {
    /// Every biome.
    pub const ALL: [Biome; 6] = [
        Biome::Farmland,
        Biome::Town,
        Biome::Coast,
        Biome::Forest,
        Biome::Park,
        Biome::Highway,
    ];
}

/// Colors of the ground and of leaves, and the light on them.
pub(crate) struct Palette {
    pub grass: [Rgb; 2],
    pub crops: [Rgb; 6],
    pub soil: Rgb,
    pub floor: Rgb,
    pub sand: Rgb,
    pub asphalt: Rgb,
    pub concrete: Rgb,
    pub deep: Rgb,
    pub shallow: Rgb,
    pub leaves: [Rgb; 4],
    pub needles: Rgb,
    /// Toward the sun.
    pub sun: V3,
    /// Share of the light on level ground that comes straight from the sun, 0..1.
    pub direct: f32,
    /// Color of that light: multiplies a surface's own color.
    pub tint: Rgb,
    pub haze: Rgb,
}

impl Palette {
    pub fn new(rng: &mut Rng) -> Palette {
        let turn = rng.unit();
        let sunny = rng.chance(0.75);
        let height = if sunny {
            rng.range(0.75, 1.7)
        } else {
            rng.range(1.5, 3.0)
        };
        let sun = v3(
            crate::math::cos_turns(turn),
            crate::math::sin_turns(turn),
            height,
        )
        .unit();
        let warm = if sunny {
            ((1.25 - height) * 1.4).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let day = if sunny {
            [1.06, 1.03, 0.98]
        } else {
            [0.90, 0.93, 0.97]
        };
        let tint = scaled(mix(day, [1.10, 0.98, 0.82], warm), rng.range(0.94, 1.06));

        // Summer, late summer, autumn, spring.
        let season = rng.below(4);
        let grass = [
            [[98.0, 118.0, 62.0], [122.0, 134.0, 78.0]],
            [[148.0, 138.0, 88.0], [172.0, 156.0, 106.0]],
            [[116.0, 116.0, 66.0], [142.0, 126.0, 80.0]],
            [[92.0, 132.0, 58.0], [124.0, 152.0, 74.0]],
        ][season];
        let leaves = [
            [
                [74.0, 104.0, 46.0],
                [92.0, 118.0, 52.0],
                [62.0, 94.0, 48.0],
                [104.0, 124.0, 60.0],
            ],
            [
                [94.0, 108.0, 52.0],
                [114.0, 118.0, 62.0],
                [78.0, 98.0, 50.0],
                [128.0, 124.0, 70.0],
            ],
            [
                [168.0, 104.0, 36.0],
                [186.0, 140.0, 46.0],
                [138.0, 70.0, 38.0],
                [98.0, 100.0, 48.0],
            ],
            [
                [96.0, 132.0, 52.0],
                [116.0, 146.0, 60.0],
                [76.0, 112.0, 48.0],
                [196.0, 168.0, 172.0],
            ],
        ][season];
        let mut jitter = |c: Rgb, k: f32| {
            let all = rng.range(1.0 - k, 1.0 + k);
            [
                c[0] * all * rng.range(0.97, 1.03),
                c[1] * all,
                c[2] * all * rng.range(0.95, 1.05),
            ]
        };
        let wheat = jitter([188.0, 160.0, 104.0], 0.08);
        let soil = jitter([132.0, 104.0, 80.0], 0.12);
        let crops = [
            wheat,
            soil,
            jitter([104.0, 130.0, 66.0], 0.1),
            jitter([134.0, 148.0, 82.0], 0.1),
            if season == 3 {
                [206.0, 188.0, 70.0]
            } else {
                jitter([160.0, 146.0, 98.0], 0.1)
            },
            jitter([84.0, 108.0, 60.0], 0.1),
        ];
        let tropical = jitter([36.0, 92.0, 104.0], 0.1);
        let murky = jitter([52.0, 72.0, 70.0], 0.12);
        let deep = jitter([34.0, 62.0, 82.0], 0.1);
        let asphalt = jitter([106.0, 106.0, 108.0], 0.14);
        let concrete = jitter([170.0, 166.0, 156.0], 0.07);
        let sand = jitter([206.0, 188.0, 150.0], 0.06);
        let floor = mix(jitter([72.0, 76.0, 46.0], 0.1), leaves[0], 0.3);
        let grass = [jitter(grass[0], 0.06), jitter(grass[1], 0.06)];
        let deep = [deep, murky, tropical][rng.below(3)];
        Palette {
            grass,
            crops,
            soil,
            floor,
            sand,
            asphalt,
            concrete,
            shallow: mix(deep, sand, 0.42),
            deep,
            leaves,
            needles: [66.0, 92.0, 58.0],
            sun,
            direct: if sunny {
                rng.range(0.58, 0.72)
            } else {
                rng.range(0.12, 0.25)
            },
            tint,
            haze: mix([196.0, 206.0, 216.0], [226.0, 206.0, 180.0], warm),
        }
    }

    /// Light on a matt surface with the given outward normal: 1 on level, sunlit ground.
    pub fn light(&self, normal: V3) -> f32 {
        let sun = normal.dot(self.sun).max(0.0) / self.sun.z;
        (1.0 - self.direct) * (0.74 + 0.26 * normal.z) + self.direct * sun.min(1.45)
    }

    /// A color as lit in the shade of something, `shade` 0 (none)..1 (full).
    pub fn shaded(&self, c: Rgb, shade: f32) -> Rgb {
        let k = shade * self.direct;
        [
            c[0] * (1.0 - 0.92 * k),
            c[1] * (1.0 - 0.88 * k),
            c[2] * (1.0 - 0.78 * k),
        ]
    }
}
