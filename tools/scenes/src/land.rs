//! The plan of the country: a winding main line with roads beside and across it.
//!
//! Places are given as (x, t): x along the world, t meters to the left of the main line. The plan
//! repeats in x after [`PERIOD`] meters, so that flights have no longest length.

use crate::math::{V3, cos_turns, floor, sin_turns, v3};
use crate::palette::Biome;
use crate::rng::Rng;

/// Meters after which the country repeats in x.
pub(crate) const PERIOD: f32 = 768.0;

/// `x` moved by whole periods to lie as near as possible to `near`.
pub(crate) fn nearest_copy(x: f32, near: f32) -> f32 {
    x - PERIOD * floor((x - near) / PERIOD + 0.5) as f32
}

/// Surface of a road.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Paving {
    Asphalt,
    Dirt,
    Gravel,
}

/// A road, along the main line or across it.
#[derive(Clone, Copy)]
pub(crate) struct Road {
    /// t of its middle (a road along), or x (a road across).
    pub at: f32,
    pub half: f32,
    /// Width of the pavement on each side, 0 for none.
    pub walk: f32,
    pub lane: f32,
    pub paving: Paving,
    pub marked: bool,
    /// Half width of a green strip in the middle.
    pub median: f32,
}

/// Water to the left of a shore line.
#[derive(Clone, Copy)]
pub(crate) struct Water {
    /// t of the shore; water is where t is greater.
    pub from: f32,
    /// t of the far bank.
    pub to: f32,
    /// A straight concrete edge in place of a beach.
    pub quay: bool,
}

pub(crate) struct Land {
    pub biome: Biome,
    pub along: Vec<Road>,
    pub across: Vec<Road>,
    pub water: Option<Water>,
    /// A town's blocks: their length in x and in t.
    pub blocks: Option<(f32, f32)>,
    /// A park's pond: x and t of its middle, and its radius.
    pub pond: Option<(f32, f32, f32)>,
    waves: [(f32, f32, f32); 4],
}

fn road(at: f32, half: f32, walk: f32, paving: Paving) -> Road {
    let marked = paving == Paving::Asphalt && half > 2.6;
    Road {
        at,
        half,
        walk,
        lane: half * 0.5,
        paving,
        marked,
        median: 0.0,
    }
}

impl Land {
    pub fn new(biome: Biome, rng: &mut Rng) -> Land {
        use Paving::{Asphalt, Dirt, Gravel};
        let bend = match biome {
            Biome::Town => 0.05,
            Biome::Highway => 0.10,
            Biome::Coast => 0.07,
            _ => 0.22,
        };
        let waves = [1.0, 2.0, 3.0, 5.0].map(|k: f32| {
            let slope = bend * rng.range(0.2, 0.75);
            (k, slope * PERIOD / (k * std::f32::consts::TAU), rng.unit())
        });
        let mut water = None;
        let mut blocks = None;
        let mut pond = None;
        let mut across = Vec::new();
        let along = match biome {
            Biome::Farmland => {
                for i in 0..4 {
                    let paving = rng.pick(&[Dirt, Dirt, Asphalt]);
                    across.push(road(
                        i as f32 * 192.0 + rng.range(20.0, 160.0),
                        2.3,
                        0.0,
                        paving,
                    ));
                }
                vec![road(0.0, rng.range(2.9, 3.6), 0.0, Asphalt)]
            }
            Biome::Town => {
                let gap = rng.pick(&[64.0, 76.8, 96.0]);
                for i in 0..(PERIOD / gap) as usize {
                    across.push(road((i as f32 + 0.5) * gap, 3.4, 2.0, Asphalt));
                }
                let block = rng.range(52.0, 66.0);
                let walk = rng.range(2.0, 3.2);
                blocks = Some((gap, block));
                // The main street has room for parked cars beside its two lanes.
                let street =
                    |k: f32| road(k * block, if k == 0.0 { 5.4 } else { 3.2 }, walk, Asphalt);
                let mut streets = [0.0, -2.0, -1.0, 1.0, 2.0].map(street).to_vec();
                streets[0].lane = 1.7;
                streets
            }
            Biome::Coast => {
                let quay = rng.chance(0.5);
                let far = if rng.chance(0.35) {
                    rng.range(70.0, 130.0)
                } else {
                    1e6
                };
                water = Some(Water {
                    from: 0.0,
                    to: far,
                    quay,
                });
                vec![road(if quay { -34.0 } else { -30.0 }, 3.3, 2.4, Asphalt)]
            }
            Biome::Forest => {
                across.push(road(rng.range(0.0, PERIOD), 1.7, 0.0, Dirt));
                let paving = rng.pick(&[Asphalt, Asphalt, Dirt]);
                vec![road(
                    0.0,
                    if paving == Dirt { 2.3 } else { 3.0 },
                    0.0,
                    paving,
                )]
            }
            Biome::Park => {
                for i in 0..8 {
                    across.push(road(
                        i as f32 * 96.0 + rng.range(10.0, 80.0),
                        1.4,
                        0.0,
                        Gravel,
                    ));
                }
                pond = Some((
                    rng.range(20.0, 140.0),
                    -rng.range(19.0, 24.0),
                    rng.range(8.0, 13.0),
                ));
                vec![
                    road(0.0, 2.0, 0.0, Gravel),
                    road(rng.range(32.0, 44.0), 1.4, 0.0, Gravel),
                    road(-rng.range(44.0, 52.0), 3.3, 2.2, Asphalt),
                ]
            }
            Biome::Highway => {
                let mut main = road(0.0, 10.4, 0.0, Asphalt);
                (main.lane, main.median) = (3.6, 1.5);
                vec![main, road(-rng.range(42.0, 60.0), 2.2, 0.0, Dirt)]
            }
        };
        Land {
            biome,
            along,
            across,
            water,
            blocks,
            pond,
            waves,
        }
    }

    /// y of the main line.
    pub fn line(&self, x: f32) -> f32 {
        self.waves
            .iter()
            .map(|&(k, a, p)| a * sin_turns(k * x / PERIOD + p))
            .sum()
    }

    /// dy/dx of the main line.
    pub fn slope(&self, x: f32) -> f32 {
        let slope = |&(k, a, p): &(f32, f32, f32)| {
            a * k * std::f32::consts::TAU / PERIOD * cos_turns(k * x / PERIOD + p)
        };
        self.waves.iter().map(slope).sum()
    }

    /// Unit vector along the main line.
    pub fn heading(&self, x: f32) -> V3 {
        v3(1.0, self.slope(x), 0.0).unit()
    }

    /// The world's point at (x, t), on the ground.
    pub fn point(&self, x: f32, t: f32) -> V3 {
        let slope = self.slope(x);
        v3(x, self.line(x) + t * (1.0 + slope * slope).sqrt(), 0.0)
    }

    /// t of a world point.
    pub fn t_of(&self, p: V3) -> f32 {
        let slope = self.slope(p.x);
        (p.y - self.line(p.x)) / (1.0 + slope * slope).sqrt()
    }

    /// Meters from (x, t) to the nearest road's or water's edge; negative on them.
    pub fn clearance(&self, x: f32, t: f32) -> f32 {
        let mut least = f32::MAX;
        for r in &self.along {
            least = least.min((t - r.at).abs() - r.half - r.walk);
        }
        for r in &self.across {
            if self.crosses(r, t) {
                least = least.min((nearest_copy(r.at, x) - x).abs() - r.half - r.walk);
            }
        }
        if let Some(w) = self.water {
            least = least.min((w.from - 4.0 - t).max(t - w.to - 6.0));
        }
        if let Some((px, pt, radius)) = self.pond {
            let dx = nearest_copy(px, x) - x;
            least = least.min((dx * dx + (t - pt) * (t - pt)).sqrt() - 1.3 * radius);
        }
        least
    }

    /// Whether this road across exists at this t.
    pub fn crosses(&self, road: &Road, t: f32) -> bool {
        match self.biome {
            Biome::Park => t > self.along[2].at && t < self.along[1].at,
            Biome::Forest | Biome::Farmland => {
                t * if road.at < 0.5 * PERIOD { 1.0 } else { -1.0 } > 0.0
            }
            _ => true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_points_are_inverse_and_the_country_repeats() {
        for biome in Biome::ALL {
            let land = Land::new(biome, &mut Rng::new(3, 1));
            let p = land.point(100.0, 12.0);
            assert!((land.t_of(p) - 12.0).abs() < 1e-3);
            let q = land.point(100.0 + PERIOD, 12.0);
            assert!((p.y - q.y).abs() < 1e-2, "{biome:?}");
            let (a, b) = (land.line(100.1), land.line(99.9));
            assert!(((a - b) / 0.2 - land.slope(100.0)).abs() < 1e-2);
            assert!(land.clearance(50.0, land.along[0].at) < 0.0);
        }
    }
}
