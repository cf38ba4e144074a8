//! The ground as a texture with mip levels: painted once per flight, darkened by shadows, then
//! sampled for each frame.

use crate::camera::Camera;
use crate::fill;
use crate::ground::{Column, Painter};
use crate::land::PERIOD;
use crate::math::{V3, bilinear, gathered, lerp_lanes, lerp_packed, pack, spread};
use crate::palette::Palette;
use crate::rng::{NOISE_SIDE, Noise, hash};

/// Most texels of a map's finest level.
const MOST_TEXELS: f32 = 4e6;
const LEVELS: usize = 4;
/// Pixels between exact perspective divisions; positions between them are interpolated.
const SPAN: usize = 32;

/// A rectangle of ground in meters.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Extent {
    pub x: (f32, f32),
    pub y: (f32, f32),
}

struct Level {
    /// Packed colors, the fourth byte the share of open water; one column and row more than it
    /// counts, wrapped round.
    texels: Vec<u32>,
    nx: usize,
    ny: usize,
}

pub(crate) struct Map {
    pub texel: f32,
    origin: (f32, f32),
    nx: usize,
    ny: usize,
    levels: Vec<Level>,
    /// Shade per texel of the finest level, 0..255.
    shade: Vec<u8>,
    ripples: Vec<i8>,
}

impl Map {
    /// An empty map of an area, with texels of about the given size in meters (larger if the area
    /// is).
    pub fn new(extent: Extent, texel: f32) -> Map {
        let width = (extent.x.1 - extent.x.0).clamp(8.0, PERIOD);
        let height = (extent.y.1 - extent.y.0).clamp(8.0, 2.0 * PERIOD);
        let texel = texel.max((width * height / MOST_TEXELS).sqrt());
        let round = |meters: f32| ((meters / texel / 8.0).ceil() as usize).max(1) * 8;
        let nx = round(width);
        let ny = round(height);
        // A map of the whole period must repeat exactly.
        let texel = if width >= PERIOD {
            PERIOD / nx as f32
        } else {
            texel
        };
        let noise = Noise::table();
        let at = |i: usize| ((i & 511) as f32, (i >> 9) as f32);
        let ripples = (0..NOISE_SIDE * NOISE_SIDE).map(|i| {
            let (u, v) = at(i);
            (noise.at(u * 5.0, v * 7.0) * 16.0 + noise.at(u, v) * 8.0).clamp(-40.0, 40.0) as i8
        });
        let origin = (extent.x.0, extent.y.0);
        let ripples = ripples.collect();
        Map {
            texel,
            origin,
            nx,
            ny,
            levels: Vec::new(),
            shade: vec![0; nx * ny],
            ripples,
        }
    }

    /// Texel coordinates of a world point; x is not reduced to the map's period.
    fn place(&self, p: V3) -> (f32, f32) {
        (
            (p.x - self.origin.0) / self.texel,
            (p.y - self.origin.1) / self.texel,
        )
    }

    /// Shades the shadow that a polygon in the air throws on the ground, where it falls in the map.
    pub fn cast(&mut self, corners: [V3; 4], sun: V3) {
        let flat = corners.map(|c| self.place(c - sun * (c.z / sun.z)));
        let nx = self.nx;
        let shade = &mut self.shade;
        fill::polygon(&flat, nx, self.ny, |y, a, b| {
            shade[y * nx + a..y * nx + b].fill(230)
        });
    }

    /// The same for a ball of leaves, through which some light falls.
    pub fn cast_ball(&mut self, middle: V3, radius: f32, sun: V3) {
        let at = self.place(middle - sun * (middle.z / sun.z));
        let r = radius / self.texel;
        let nx = self.nx;
        let shade = &mut self.shade;
        fill::ellipse(at, (r, r), nx, self.ny, |y, a, b| {
            shade[y * nx + a..y * nx + b]
                .iter_mut()
                .for_each(|s| *s = (*s).max(206));
        });
    }

    /// How much of the sun a place on the ground is cut off from, 0..1.
    pub fn shade_at(&self, p: V3) -> f32 {
        let (u, v) = self.place(p);
        let i = (u.floor() as i64).rem_euclid(self.nx as i64) as usize;
        let j = (v.max(0.0) as usize).min(self.ny - 1);
        f32::from(self.shade[j * self.nx + i]) / 255.0
    }

    /// Paints the ground under the shadows cast so far and makes the coarser levels.
    pub fn paint(&mut self, painter: &Painter) {
        self.soften();
        let nx = self.nx;
        let ny = self.ny;
        let columns: Vec<Column> = (0..nx)
            .map(|i| painter.column(self.origin.0 + (i as f32 + 0.5) * self.texel))
            .collect();
        let mut texels = Vec::with_capacity((nx + 1) * (ny + 1));
        for j in 0..ny {
            let y = self.origin.1 + (j as f32 + 0.5) * self.texel;
            let first = texels.len();
            for (column, &shade) in columns.iter().zip(&self.shade[j * nx..]) {
                let (color, water) = painter.paint(column, y);
                let shade = f32::from(shade) / 255.0 * (1.0 - 0.5 * water);
                texels.push(pack(
                    painter.palette.shaded(color, shade),
                    (water * 255.0) as u32,
                ));
            }
            texels.push(texels[first]);
        }
        texels.extend_from_within(ny.saturating_sub(1) * (nx + 1)..);
        self.levels = vec![Level { texels, nx, ny }];
        for k in 1..LEVELS {
            let finer = &self.levels[k - 1];
            self.levels.push(finer.halved());
        }
    }

    /// Blurs the shadows' edges.
    fn soften(&mut self) {
        let nx = self.nx;
        let ny = self.ny;
        let passes = if self.texel < 0.12 { 2 } else { 1 };
        for _ in 0..passes {
            let mut sums = vec![0u16; nx * ny];
            for (sum, row) in sums.chunks_exact_mut(nx).zip(self.shade.chunks_exact(nx)) {
                for i in 0..nx {
                    let l = row[i.saturating_sub(1)];
                    let r = row[(i + 1).min(nx - 1)];
                    sum[i] = u16::from(l) + 2 * u16::from(row[i]) + u16::from(r);
                }
            }
            for j in 0..ny {
                let up = j.saturating_sub(1) * nx;
                let low = (j + 1).min(ny - 1) * nx;
                for i in 0..nx {
                    self.shade[j * nx + i] =
                        ((sums[up + i] + 2 * sums[j * nx + i] + sums[low + i]) / 16) as u8;
                }
            }
        }
    }

    /// Draws the ground into packed pixels. `seconds` moves the ripples on water; far ground fades
    /// into haze.
    pub fn draw(
        &self,
        camera: &Camera,
        palette: &Palette,
        haze: impl Fn(f32) -> f32,
        seconds: f32,
        width: usize,
        out: &mut [u32],
    ) {
        let haze_color = spread(pack(palette.haze, 0));
        // Ripples about two pixels wide at the middle of the view.
        let span = camera.position.z / -camera.forward.z.min(-0.1);
        let unit = (1.4 * span / camera.focal).max(0.05);
        let drift = (
            (seconds * 0.9 / unit * 256.0) as i32,
            (seconds * 0.55 / unit * 256.0) as i32,
        );
        let fixed = |v: f32| (v * 65536.0) as i64;
        if self.levels.is_empty() {
            return;
        }
        // Strip by strip, not row by row: a row of the view may run across thousands of rows of the
        // map, and what it brought into the cache serves the next row only if that comes soon.
        for x0 in (0..width).step_by(SPAN) {
            for (y, row) in out.chunks_exact_mut(width).enumerate() {
                let fy = y as f32 + 0.5;
                let pixels = &mut row[x0..(x0 + SPAN).min(width)];
                let from = camera.ground(x0 as f32 + 0.5, fy);
                let to = camera.ground((x0 + SPAN) as f32 + 0.5, fy);
                let depth = (from - camera.position).dot(camera.forward);
                // Size of a pixel on the ground in texels, between its short and its long side.
                let slant = (camera.position.z / depth).max(0.1);
                let foot = depth / camera.focal / self.texel / slant.sqrt();
                let dither = (hash(x0 as i32, y as i32, 9) >> 24) as f32 / 256.0;
                let k = usize::from(foot > 1.1 + 0.5 * dither)
                    + usize::from(foot > 2.2 + dither)
                    + usize::from(foot > 4.4 + 2.0 * dither);
                let level = &self.levels[k];
                let scale = 1.0 / (1 << k) as f32;
                let (u0, v0) = self.place(from);
                let (u1, v1) = self.place(to);
                let step = (
                    fixed((u1 - u0) * scale) / SPAN as i64,
                    fixed((v1 - v0) * scale) / SPAN as i64,
                );
                let mut at = (fixed(u0 * scale - 0.5), fixed(v0 * scale - 0.5));
                let fade = (haze(depth) * 256.0) as u32;
                let world = |p: V3| {
                    (
                        (p.x / unit * 256.0) as i64 as i32,
                        (p.y / unit * 256.0) as i64 as i32,
                    )
                };
                let w0 = world(from);
                let w1 = world(to);
                for (i, pixel) in pixels.iter_mut().enumerate() {
                    let mut c = level.sample(at.0, at.1);
                    let water = (c >> 48) as u32;
                    if water > 8 {
                        let n = i as i32;
                        let wx =
                            w0.0.wrapping_add((w1.0.wrapping_sub(w0.0)) / SPAN as i32 * n);
                        let wy =
                            w0.1.wrapping_add((w1.1.wrapping_sub(w0.1)) / SPAN as i32 * n);
                        c = self.ripple(gathered(c), water, wx, wy, drift, palette.direct);
                    }
                    *pixel = gathered(lerp_lanes(c, haze_color, fade));
                    at = (at.0 + step.0, at.1 + step.1);
                }
            }
        }
    }

    /// Water with two trains of ripples running through each other, and glints where both are high.
    #[inline(always)]
    fn ripple(&self, c: u32, water: u32, x: i32, y: i32, drift: (i32, i32), direct: f32) -> u64 {
        let at = |u: i32, v: i32| {
            i32::from(
                self.ripples[((v >> 8) & 511) as usize * NOISE_SIDE + ((u >> 8) & 511) as usize],
            )
        };
        let (a, b) = (
            at(x.wrapping_add(drift.0), y.wrapping_add(drift.1)),
            at(
                y.wrapping_sub(drift.1),
                x.wrapping_mul(2).wrapping_sub(drift.0),
            ),
        );
        let mut lift = (a + b) * water as i32 / 340;
        if direct > 0.4 && a + b > 34 {
            lift += (a + b - 34) * 5 * water as i32 / 255;
        }
        let add = |shift: u32| (((c >> shift & 255) as i32 + lift).clamp(0, 255) as u32) << shift;
        spread(add(0) | add(8) | add(16))
    }
}

impl Level {
    fn halved(&self) -> Level {
        let nx = (self.nx / 2).max(1);
        let ny = (self.ny / 2).max(1);
        let mut texels = Vec::with_capacity((nx + 1) * (ny + 1));
        for j in 0..ny {
            let first = texels.len();
            for i in 0..nx {
                let at = 2 * j * (self.nx + 1) + 2 * i;
                let top = lerp_packed(self.texels[at], self.texels[at + 1], 128);
                let low = lerp_packed(
                    self.texels[at + self.nx + 1],
                    self.texels[at + self.nx + 2],
                    128,
                );
                texels.push(lerp_packed(top, low, 128));
            }
            texels.push(texels[first]);
        }
        texels.extend_from_within((ny - 1) * (nx + 1)..);
        Level { texels, nx, ny }
    }

    /// Bilinear sample, as lanes, at 16.16 texel coordinates, wrapping in x and clamping in y.
    #[inline(always)]
    fn sample(&self, u: i64, v: i64) -> u64 {
        let mut i = (u >> 16) as i32;
        let n = self.nx as i32;
        if i as u32 >= n as u32 {
            i = i.rem_euclid(n);
        }
        let j = ((v >> 16) as i32).clamp(0, self.ny as i32 - 1);
        let (a, b) = ((u >> 8 & 255) as u32, (v >> 8 & 255) as u32);
        let at = j as usize * (self.nx + 1) + i as usize;
        let top = &self.texels[at..at + 2];
        let low = &self.texels[at + self.nx + 1..at + self.nx + 3];
        bilinear(top, low, a, b)
    }
}
