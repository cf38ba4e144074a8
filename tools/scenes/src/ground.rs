//! The painted ground: the color of every texel of the country without the things on it.

use crate::land::{Land, PERIOD, Paving, Road, nearest_copy};
use crate::math::{Rgb, floor, mix, scaled, smooth_step, wrap};
use crate::palette::{Biome, Palette};
use crate::rng::{NOISE_SIDE, Noise, hash_unit};

/// Paints one texel at a time. Coordinates and texel size in meters.
pub(crate) struct Painter<'a> {
    pub land: &'a Land,
    pub palette: &'a Palette,
    pub texel: f32,
    pub salt: u32,
    noise: &'static Noise,
    /// Features of the finest noise in a period: chosen to be a few texels wide.
    detail: f32,
    shift: (f32, f32),
}

/// A column of texels: its x, the main line's y there and its foreshortening, and the distances to
/// the roads across.
pub(crate) struct Column {
    x: f32,
    line: f32,
    scale: f32,
    across: Vec<(Road, f32)>,
}

/// A place in the coordinates of a road.
#[derive(Clone, Copy)]
struct OnRoad {
    /// Meters to the side of the road's middle.
    across: f32,
    /// Meters along the road.
    along: f32,
    /// Whether another road crosses here.
    is_junction: bool,
}

/// A place with its noise: slow, middling and fine noise, and grain, each in -1..1.
struct Spot {
    x: f32,
    t: f32,
    slow: f32,
    middle: f32,
    fine: f32,
    grain: f32,
}

impl<'a> Painter<'a> {
    pub fn new(land: &'a Land, palette: &'a Palette, texel: f32, salt: u32) -> Painter<'a> {
        let shift = (hash_unit(1, 2, salt) * 512.0, hash_unit(3, 4, salt) * 512.0);
        let detail = floor(96.0 / (20.0 * texel)) as f32;
        Painter {
            land,
            palette,
            texel,
            salt,
            noise: Noise::table(),
            detail,
            shift,
        }
    }

    /// Noise whose coarsest features are 96 / `m` meters wide; it repeats with the country.
    fn noise(&self, x: f32, y: f32, m: f32) -> f32 {
        let k = m * NOISE_SIDE as f32 / PERIOD;
        self.noise
            .at(x * k + self.shift.0 + m, y * k + self.shift.1)
    }

    /// The values that all texels at one x share.
    pub fn column(&self, x: f32) -> Column {
        let slope = self.land.slope(x);
        let near = self
            .land
            .across
            .iter()
            .map(|r| (*r, nearest_copy(r.at, x) - x));
        let across = near
            .filter(|(r, d)| d.abs() < r.half + r.walk + 2.5)
            .collect();
        Column {
            x,
            line: self.land.line(x),
            scale: 1.0 / (1.0 + slope * slope).sqrt(),
            across,
        }
    }

    /// Color without shadows, and share of open water, at a world point.
    pub fn paint(&self, column: &Column, y: f32) -> (Rgb, f32) {
        let x = column.x;
        let t = (y - column.line) * column.scale;
        let slow = self.noise(x, y, 2.0);
        let middle = self.noise(x, y, 11.0);
        let mut fine = self.noise(x, y, 64.0);
        if self.detail > 90.0 {
            fine = 0.7 * fine + 0.6 * self.noise(x, y, self.detail);
        }
        let grain =
            hash_unit((x / self.texel) as i32, (y / self.texel) as i32, self.salt) * 2.0 - 1.0;
        let spot = Spot {
            x,
            t,
            slow,
            middle,
            fine,
            grain,
        };
        let (mut color, mut water) = self.base(&spot);
        let across = column
            .across
            .iter()
            .filter(|(r, _)| self.land.crosses(r, t));
        let near_across = across.clone().any(|(r, d)| d.abs() < r.half + r.walk);
        let near_along = self
            .land
            .along
            .iter()
            .any(|r| (t - r.at).abs() < r.half + r.walk);
        for (r, d) in across {
            let place = OnRoad {
                across: *d,
                along: t,
                is_junction: near_along,
            };
            self.road(&mut color, &mut water, &spot, r, place);
        }
        for r in &self.land.along {
            let place = OnRoad {
                across: t - r.at,
                along: x,
                is_junction: near_across,
            };
            self.road(&mut color, &mut water, &spot, r, place);
        }
        let tint = self.palette.tint;
        (
            [color[0] * tint[0], color[1] * tint[1], color[2] * tint[2]],
            water,
        )
    }

    fn grass(&self, s: &Spot) -> Rgb {
        let p = self.palette;
        let c = mix(
            p.grass[0],
            p.grass[1],
            (0.5 + 0.5 * s.slow + 0.5 * s.middle).clamp(0.0, 1.0),
        );
        let worn = smooth_step(0.55, 1.1, s.middle - 0.4 * s.slow);
        scaled(
            mix(c, p.soil, 0.5 * worn),
            1.0 + 0.13 * s.fine + 0.07 * s.grain,
        )
    }

    fn base(&self, s: &Spot) -> (Rgb, f32) {
        match self.land.biome {
            Biome::Farmland | Biome::Highway => (self.fields(s), 0.0),
            Biome::Town => (self.town(s), 0.0),
            Biome::Coast => self.coast(s),
            Biome::Forest => {
                let floor = mix(
                    self.palette.floor,
                    self.palette.soil,
                    (0.25 + 0.5 * s.middle).clamp(0.0, 0.7),
                );
                let floor = scaled(floor, 1.0 + 0.22 * s.fine + 0.1 * s.grain);
                let verge = smooth_step(9.0, 5.0, s.t.abs() + 2.0 * s.middle);
                (mix(floor, self.grass(s), verge), 0.0)
            }
            Biome::Park => self.park(s),
        }
    }

    /// Fields in strips beside the road, each with its crop, furrows and tramlines.
    fn fields(&self, s: &Spot) -> Rgb {
        let margin = self.land.along[0].half + 4.5;
        let side = if s.t < 0.0 { 1 } else { 0 };
        let out = s.t.abs() - margin + 0.5 * s.middle;
        if out < 0.0 {
            return self.grass(s);
        }
        const DEPTH: f32 = 62.0;
        let strip = (out / DEPTH) as i32;
        let key = strip * 2 + side;
        let count = [5.0, 7.0, 9.0][(hash_unit(key, 5, self.salt) * 3.0) as usize];
        let width = PERIOD / count;
        let x = s.x + hash_unit(key, 6, self.salt) * PERIOD + 0.2 * s.t;
        let column = floor(x / width) as f32;
        let (dx, dt) = (x - column * width, out - strip as f32 * DEPTH);
        let edge = dx.min(width - dx).min(dt).min(DEPTH - dt) + 0.35 * s.middle;
        let field = wrap(column, count) as i32;
        let pick = |k: i32| hash_unit(field * 31 + k, key, self.salt);
        let crop = self.palette.crops[(pick(1) * 6.0) as usize % 6];
        let along = pick(2) < 0.6;
        let q = if along { s.t } else { x };
        let period = 0.7 + 1.1 * pick(3);
        let wave = |period: f32| (wrap(q / period, 1.0) - 0.5).abs() * 4.0 - 1.0;
        let depth = 0.13 * pick(4) * (period / (4.0 * self.texel)).min(1.0);
        let mut c = scaled(
            crop,
            1.0 + depth * wave(period) + 0.07 * s.fine + 0.05 * s.grain + 0.10 * s.slow,
        );
        c = mix(
            c,
            self.palette.soil,
            (0.32 * (s.middle + 0.4 * s.slow) - 0.05).clamp(0.0, 0.3),
        );
        let tram = wrap(q, 15.0) - 7.5;
        let rut = ((tram.abs() - 0.85).abs() - 0.22).max(0.0);
        c = mix(c, self.palette.soil, 0.5 * smooth_step(0.2, 0.0, rut));
        mix(self.grass(s), c, smooth_step(0.5, 1.1, edge))
    }

    /// Gardens, yards and car parks, by block and plot.
    fn town(&self, s: &Spot) -> Rgb {
        let Some((gap, depth)) = self.land.blocks else {
            return self.grass(s);
        };
        let block = Block::of(s.x, s.t, gap, depth, self.salt);
        let paved = scaled(
            mix(self.palette.concrete, [150.0, 132.0, 116.0], 0.35),
            1.0 + 0.05 * s.fine + 0.04 * s.grain + 0.05 * s.middle,
        );
        match block.kind {
            BlockKind::CarPark => {
                let (dx, dt) = (block.x, block.t);
                let inside = dx.min(gap - dx).min(dt).min(depth - dt);
                let tarmac = self.asphalt(s, 0.94);
                let bay = wrap(dx, 2.6);
                let row = wrap(dt, 17.0);
                let marked = inside > 8.0 && !(5.0..=12.0).contains(&row);
                let line = self.line(bay - 1.3, 0.13) * f32::from(u8::from(marked));
                let tarmac = mix(tarmac, [214.0, 214.0, 208.0], 0.8 * line);
                mix(self.grass(s), tarmac, smooth_step(6.6, 6.9, inside))
            }
            BlockKind::Flats => {
                let lawn =
                    smooth_step(0.05, 0.25, s.slow + 0.3 * hash_unit(block.id, 7, self.salt));
                let joint = self
                    .line(wrap(s.x, 1.2) - 0.6, 0.08)
                    .max(self.line(wrap(s.t, 1.2) - 0.6, 0.08));
                mix(mix(paved, scaled(paved, 0.86), joint), self.grass(s), lawn)
            }
            BlockKind::Houses => {
                let plot = floor(block.x / PLOT) as f32;
                let px = block.x - plot * PLOT;
                let back = (block.t - depth * 0.5).abs();
                let key = block.id * 64 + plot as i32 * 2 + i32::from(block.t > depth * 0.5);
                let garden = hash_unit(key, 8, self.salt);
                let mut c = scaled(self.grass(s), 0.86 + 0.3 * garden);
                if hash_unit(key, 9, self.salt) < 0.4 {
                    // A freshly mown lawn shows stripes.
                    c = scaled(
                        c,
                        if (px / 1.1) as i32 % 2 == 0 {
                            1.05
                        } else {
                            0.96
                        },
                    );
                }
                let drive = if hash_unit(key, 10, self.salt) < 0.5 {
                    paved
                } else {
                    self.asphalt(s, 1.05)
                };
                c = mix(
                    c,
                    drive,
                    smooth_step(1.7, 1.6, (px - 3.2).abs()) * smooth_step(8.0, 8.4, back),
                );
                let patio = smooth_step(3.0, 2.8, (px - 9.5).abs())
                    * smooth_step(2.3, 2.1, (back - 6.5).abs());
                c = mix(c, paved, patio * f32::from(u8::from(garden > 0.3)));
                if hash_unit(key, 11, self.salt) < 0.12 {
                    let pool = smooth_step(2.0, 1.85, (px - 11.0).abs())
                        * smooth_step(3.2, 3.05, (back - 4.0).abs() + 1.0);
                    c = mix(c, [92.0, 178.0, 198.0], pool);
                }
                let fence = self.line(px, 0.22).max(self.line(back, 0.22));
                mix(
                    c,
                    [96.0, 78.0, 62.0],
                    0.7 * fence * smooth_step(depth * 0.5 - 7.0, depth * 0.5 - 9.0, back),
                )
            }
        }
    }

    fn coast(&self, s: &Spot) -> (Rgb, f32) {
        let Some(w) = self.land.water else {
            return (self.grass(s), 0.0);
        };
        let p = self.palette;
        let ragged = if w.quay {
            0.0
        } else {
            3.0 * s.slow + 1.6 * s.middle
        };
        // Meters out from the near bank, or from the far one where that is nearer.
        let out = (s.t - w.from + ragged).min(w.to - s.t + 3.0 * s.slow + 1.6 * s.middle);
        let near = s.t < w.from + 20.0;
        if out > 0.0 {
            let shelf = if w.quay && near {
                0.85
            } else {
                smooth_step(0.0, 16.0, out + 3.0 * s.middle)
            };
            let mut c = scaled(
                mix(p.shallow, p.deep, shelf),
                1.0 + 0.06 * s.slow + 0.05 * s.fine,
            );
            if !(w.quay && near) {
                let foam = smooth_step(
                    1.5,
                    0.2,
                    (out - 0.8 - 1.2 * s.middle).abs() + 1.3 * s.fine.abs(),
                );
                c = mix(c, [232.0, 236.0, 234.0], 0.75 * foam);
            }
            let edge = if w.quay && near {
                smooth_step(0.0, 1.2, out)
            } else {
                1.0
            };
            return (scaled(c, 0.6 + 0.4 * edge), (out / 1.5).clamp(0.0, 1.0));
        }
        let inland = -out;
        if w.quay && near {
            let slab = self
                .line(wrap(s.x, 5.0) - 2.5, 0.1)
                .max(self.line(wrap(s.t, 5.0) - 2.5, 0.1));
            let mut c = scaled(
                p.concrete,
                0.94 + 0.06 * s.middle + 0.05 * s.fine + 0.03 * s.grain,
            );
            c = scaled(
                c,
                1.0 - 0.16 * slab - 0.22 * smooth_step(0.5, 1.0, s.middle),
            );
            c = mix(c, [206.0, 172.0, 60.0], 0.8 * self.line(inland - 1.6, 0.25));
            c = mix(c, [214.0, 210.0, 200.0], smooth_step(0.75, 0.65, inland));
            return (mix(self.grass(s), c, smooth_step(28.0, 27.8, inland)), 0.0);
        }
        let wet = smooth_step(3.2, 0.4, inland + s.middle);
        let beach = scaled(
            mix(p.sand, scaled(p.sand, 0.72), wet),
            1.0 + 0.06 * s.middle + 0.06 * s.fine + 0.05 * s.grain,
        );
        let depth = if near { 17.0 } else { 5.0 };
        (
            mix(
                beach,
                self.grass(s),
                smooth_step(depth - 3.0, depth, inland + 2.5 * s.middle),
            ),
            0.0,
        )
    }

    fn park(&self, s: &Spot) -> (Rgb, f32) {
        let stripe = floor((s.x + 0.4 * s.t) / 2.4) & 1;
        let lawn = scaled(self.grass(s), if stripe == 0 { 1.045 } else { 0.965 });
        let Some((px, pt, radius)) = self.land.pond else {
            return (lawn, 0.0);
        };
        let (dx, dt) = (nearest_copy(px, s.x) - s.x, s.t - pt);
        let inside = radius - (0.45 * dx * dx + dt * dt).sqrt() + 1.8 * s.middle;
        if inside < -2.0 {
            return (lawn, 0.0);
        }
        let p = self.palette;
        let shore = mix(p.soil, lawn, smooth_step(0.2, 1.6, -inside));
        let pond = mix(p.shallow, p.deep, smooth_step(0.0, 4.0, inside));
        let wet = smooth_step(-0.15, 0.15, inside);
        (mix(shore, pond, wet), wet * 0.6)
    }

    fn asphalt(&self, s: &Spot, k: f32) -> Rgb {
        scaled(
            self.palette.asphalt,
            k * (1.0 + 0.05 * s.middle + 0.06 * s.fine + 0.05 * s.grain),
        )
    }

    /// Coverage of a painted line `width` meters wide whose middle is `d` meters away.
    fn line(&self, d: f32, width: f32) -> f32 {
        ((0.5 * width - d.abs()) / self.texel + 0.5).clamp(0.0, (width / self.texel).min(1.0))
    }

    /// Paints a road over the color and the share of water of a place.
    fn road(&self, c: &mut Rgb, water: &mut f32, spot: &Spot, r: &Road, place: OnRoad) {
        let OnRoad {
            across: d,
            along: s,
            is_junction: junction,
        } = place;
        let a = d.abs();
        if a > r.half + r.walk + 2.5 {
            return;
        }
        let p = self.palette;
        if r.walk > 0.0 {
            let slab = self
                .line(wrap(s, 0.9) - 0.45, 0.06)
                .max(self.line(wrap(a - r.half, 0.9) - 0.45, 0.06));
            let walk = scaled(
                p.concrete,
                1.0 - 0.14 * slab + 0.05 * spot.middle + 0.04 * spot.fine + 0.03 * spot.grain,
            );
            let edge = ((r.half + r.walk - a) / self.texel + 0.5).clamp(0.0, 1.0);
            if !junction {
                *c = mix(*c, walk, edge);
                *c = mix(
                    *c,
                    [196.0, 194.0, 188.0],
                    self.line(a - r.half - 0.08, 0.18),
                );
            } else if a > r.half {
                return;
            }
        } else if r.paving != Paving::Gravel {
            // A worn, dusty shoulder.
            let dust = smooth_step(r.half + 1.3, r.half, a + 0.8 * spot.middle);
            *c = mix(
                *c,
                scaled(
                    mix(p.soil, p.concrete, 0.4),
                    1.0 + 0.1 * spot.fine + 0.07 * spot.grain,
                ),
                0.75 * dust,
            );
        }
        let ragged = if r.walk > 0.0 {
            0.0
        } else {
            0.18 * spot.middle + 0.12 * spot.fine
        };
        let edge = ((r.half - a + ragged) / self.texel + 0.5).clamp(0.0, 1.0);
        if edge <= 0.0 {
            return;
        }
        *water *= 1.0 - edge;
        let track = if r.marked {
            (a - r.lane).abs()
        } else {
            (a - 0.45 * r.half).abs()
        };
        let track = smooth_step(0.5, 0.2, (track - 0.75).abs());
        let mut surface = match r.paving {
            Paving::Asphalt => {
                let patch = hash_unit(floor(s / 9.0), floor(d / 2.0), self.salt ^ 77);
                let k = if patch < 0.06 { 0.86 } else { 1.0 };
                self.asphalt(
                    spot,
                    k * (1.0 - 0.07 * track)
                        * (1.0 + 0.05 * smooth_step(0.35, 0.0, (a - 2.0 * r.lane).abs())),
                )
            }
            Paving::Dirt => {
                let c = scaled(
                    mix(p.soil, p.sand, 0.3),
                    1.06 + 0.10 * spot.middle + 0.12 * spot.fine + 0.07 * spot.grain,
                );
                mix(
                    c,
                    self.grass(spot),
                    0.7 * smooth_step(0.5, 0.2, a + 0.4 * spot.fine),
                )
            }
            Paving::Gravel => scaled(
                mix(p.sand, p.concrete, 0.5),
                0.96 + 0.06 * spot.middle + 0.09 * spot.fine + 0.09 * spot.grain,
            ),
        };
        if r.median > 0.0 {
            surface = mix(
                surface,
                self.grass(spot),
                ((r.median - a) / self.texel + 0.5).clamp(0.0, 1.0),
            );
            surface = mix(
                surface,
                [186.0, 188.0, 190.0],
                self.line(a - r.median + 0.35, 0.2),
            );
        }
        if r.marked {
            let worn = 0.82 + 0.3 * spot.fine.min(0.0) + 0.2 * spot.middle.min(0.0);
            let dash = |on: f32, of: f32| f32::from(u8::from(wrap(s, of) < on));
            let mark = if junction {
                0.0
            } else if r.median > 0.0 {
                let inner = r.median + 0.5;
                self.line(a - inner, 0.18)
                    .max(self.line(a - inner - r.lane, 0.15) * dash(4.0, 12.0))
                    .max(self.line(a - inner - 2.0 * r.lane, 0.2))
            } else {
                let sides = if r.walk > 0.0 {
                    0.0
                } else {
                    self.line(a - r.half + 0.3, 0.13)
                };
                self.line(a, 0.14).max(0.0) * dash(3.0, 7.5) + sides
            };
            surface = mix(
                surface,
                [232.0, 232.0, 226.0],
                (worn * (mark + self.zebra(r, a, s, junction))).clamp(0.0, 0.95),
            );
        }
        *c = mix(*c, surface, edge);
    }

    /// Zebra crossings before the junctions of a town.
    fn zebra(&self, r: &Road, a: f32, s: f32, junction: bool) -> f32 {
        let Some((gap, depth)) = self.land.blocks else {
            return 0.0;
        };
        if junction || a > r.half - 0.25 {
            return 0.0;
        }
        // Meters from the middle of the nearest crossing road.
        let along = self
            .land
            .along
            .iter()
            .any(|k| k.at == r.at && k.half == r.half);
        let off = if along {
            wrap(s - 0.5 * gap, gap)
        } else {
            wrap(s, depth)
        };
        let off = off.min(if along { gap } else { depth } - off);
        let start = if along {
            self.land.across[0].half + self.land.across[0].walk
        } else {
            self.land.along[0].half + self.land.along[0].walk
        };
        if (start + 0.5..start + 3.0).contains(&off) {
            self.line(wrap(a, 1.0) - 0.5, 0.5)
        } else {
            0.0
        }
    }
}

/// Width of a garden plot in meters.
pub(crate) const PLOT: f32 = 16.0;

/// Use of a block of a town.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum BlockKind {
    Houses,
    Flats,
    CarPark,
}

/// One block of a town and a place in it.
pub(crate) struct Block {
    pub id: i32,
    pub kind: BlockKind,
    /// Meters from the block's corner.
    pub x: f32,
    pub t: f32,
}

impl Block {
    /// The block at (x, t); the roads across lie at odd multiples of `gap` / 2, those along at
    /// multiples of `depth`.
    pub fn of(x: f32, t: f32, gap: f32, depth: f32, salt: u32) -> Block {
        let shifted = x - 0.5 * gap;
        let (i, j) = (floor(shifted / gap) as f32, floor(t / depth) as f32);
        let column = wrap(i, floor(PERIOD / gap + 0.5) as f32) as i32;
        let id = column + 100 * j as i32;
        let kind = match hash_unit(id, 12, salt) {
            k if k < 0.66 => BlockKind::Houses,
            k if k < 0.9 => BlockKind::Flats,
            _ => BlockKind::CarPark,
        };
        Block {
            id,
            kind,
            x: shifted - i * gap,
            t: t - j * depth,
        }
    }
}
