//! Draws meshes, crowns of leaves and soft spots into a frame, and tracks the target's visibility.

use crate::TruthBox;
use crate::camera::Camera;
use crate::fill;
use crate::math::{Rgb, V3, bilinear, gathered, lerp_lanes, lerp_packed, mix, pack, spread};
use crate::mesh::Mesh;
use crate::palette::Palette;
use crate::trees::Crown;

/// Largest side of one object in samples; larger objects are drawn coarser or clipped.
const MOST_SIDE: usize = 4096;

/// Edges of a box in pixels, continuous.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Bounds {
    pub left: f32,
    pub top: f32,
    pub right: f32,
    pub bottom: f32,
}

impl Bounds {
    /// The bounds of no point.
    pub const EMPTY: Bounds = Bounds {
        left: f32::MAX,
        top: f32::MAX,
        right: f32::MIN,
        bottom: f32::MIN,
    };

    /// Grows to include a point.
    pub fn include(&mut self, x: f32, y: f32) {
        self.left = self.left.min(x);
        self.top = self.top.min(y);
        self.right = self.right.max(x);
        self.bottom = self.bottom.max(y);
    }

    /// Whether they reach into a view of the given size.
    pub fn meets(&self, width: usize, height: usize) -> bool {
        self.right > 0.0
            && self.bottom > 0.0
            && self.left < width as f32
            && self.top < height as f32
    }

    /// The same as a box.
    pub fn to_box(self) -> TruthBox {
        TruthBox {
            x: self.left,
            y: self.top,
            w: self.right - self.left,
            h: self.bottom - self.top,
        }
    }
}

/// The picture that is being drawn.
pub(crate) struct Frame {
    pub width: usize,
    pub height: usize,
    /// Packed colors, row-major.
    pub pixels: Vec<u32>,
    pub mask: Option<Mask>,
    depth: Vec<f32>,
    samples: Vec<u32>,
}

/// How much of each pixel the target covers and shows.
pub(crate) struct Mask {
    pub x0: i32,
    pub y0: i32,
    pub width: usize,
    /// Visible share of each pixel, 0..1, row-major.
    pub seen: Vec<f32>,
    /// Pixels that the whole target covers, in view or not.
    pub total: f32,
}

impl Mask {
    #[inline(always)]
    fn hide(&mut self, x: i32, y: i32, share: f32) {
        let (i, j) = (x - self.x0, y - self.y0);
        if i >= 0
            && j >= 0
            && (i as usize) < self.width
            && let Some(seen) = self.seen.get_mut(j as usize * self.width + i as usize)
        {
            *seen *= 1.0 - share;
        }
    }

    /// Whether a rectangle of pixels meets the target's.
    fn meets(&self, x0: i32, y0: i32, x1: i32, y1: i32) -> bool {
        let (right, low) = (
            self.x0 + self.width as i32,
            self.y0 + (self.seen.len() / self.width.max(1)) as i32,
        );
        x0 < right && x1 > self.x0 && y0 < low && y1 > self.y0
    }

    /// Share of the target that is seen in a view of the given size, 0..1.
    pub fn visible(&self, width: usize, height: usize) -> f32 {
        let inside = |at: usize| {
            let (x, y) = (
                self.x0 + (at % self.width) as i32,
                self.y0 + (at / self.width) as i32,
            );
            x >= 0 && y >= 0 && (x as usize) < width && (y as usize) < height
        };
        let seen: f32 = self
            .seen
            .iter()
            .enumerate()
            .filter(|&(at, _)| inside(at))
            .map(|(_, &s)| s)
            .sum();
        if self.total > 0.0 {
            (seen / self.total).min(1.0)
        } else {
            0.0
        }
    }
}

/// Where a mesh stands and how it is lit.
#[derive(Clone, Copy)]
pub(crate) struct Stand {
    pub at: V3,
    pub heading: (f32, f32),
    /// Share of the sun it is cut off from.
    pub shade: f32,
    /// Share of haze before it.
    pub haze: f32,
}

/// A crown as seen in one frame: colors premultiplied by coverage.
pub(crate) struct Sprite {
    side: usize,
    /// Pixels to the crown's radius.
    scale: f32,
    pixels: Vec<u32>,
    /// First and past-the-last covered column of each row.
    spans: Vec<(u16, u16)>,
}

impl Frame {
    pub fn new(width: usize, height: usize) -> Frame {
        let pixels = vec![0; width * height];
        Frame {
            width,
            height,
            pixels,
            mask: None,
            depth: Vec::new(),
            samples: Vec::new(),
        }
    }

    /// The tight bounds of a mesh in pixels.
    pub fn bounds(mesh: &Mesh, stand: &Stand, camera: &Camera) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        let (cos, sin) = stand.heading;
        let eye = (camera.position - stand.at).turned(cos, -sin);
        for face in mesh
            .faces
            .iter()
            .filter(|f| f.normal.dot(eye - f.corners[0]) > 0.0)
        {
            for corner in face.corners {
                let (x, y, _) = camera.project(corner.turned(cos, sin) + stand.at);
                bounds.include(x, y);
            }
        }
        bounds
    }

    /// Draws a mesh. If it is the target, it also starts the frame's mask.
    pub fn mesh(
        &mut self,
        mesh: &Mesh,
        stand: &Stand,
        camera: &Camera,
        palette: &Palette,
        target: bool,
    ) {
        let bounds = Self::bounds(mesh, stand, camera);
        let Some(region) = Region::of(bounds, self, target) else {
            return;
        };
        let k = region.fineness as f32;
        self.clear(&region);
        let sun = palette.sun;
        let eye = camera.position;
        let near_shade = 1.0 - 0.8 * stand.shade * palette.direct;
        for face in &mesh.faces {
            let world = face
                .corners
                .map(|c| c.turned(stand.heading.0, stand.heading.1) + stand.at);
            let normal = face.normal.turned(stand.heading.0, stand.heading.1);
            let to_eye = eye - world[0];
            if normal.dot(to_eye) <= 0.0 {
                continue;
            }
            let mut color = face.color;
            let light = palette.light(normal) * near_shade;
            color = [
                color[0] * light * palette.tint[0],
                color[1] * light * palette.tint[1],
                color[2] * light * palette.tint[2],
            ];
            if face.gloss > 0.0 {
                // The sky in the paint, and the sun where the angle is right.
                let view = to_eye.unit();
                let half = (view + sun).unit().dot(normal).max(0.0);
                let sharp = half * half * half * half;
                let sharp = sharp * sharp * sharp * sharp;
                let sky = face.gloss * (0.06 + 0.22 * (1.0 - view.dot(normal)) * normal.z.max(0.0));
                color = mix(color, palette.haze, sky);
                color = mix(
                    color,
                    [255.0, 252.0, 244.0],
                    (0.75 * face.gloss * sharp * palette.direct * near_shade).min(0.8),
                );
            }
            let packed = pack(mix(color, palette.haze, stand.haze), 255);
            let corners = world.map(|p| {
                let (x, y, depth) = camera.project(p);
                (
                    (x - region.x0 as f32) * k,
                    (y - region.y0 as f32) * k,
                    1.0 / depth,
                )
            });
            self.face(&corners, packed, &region);
        }
        self.composite(&region, target);
    }

    /// Darkens the ground where a mesh throws its shadow.
    pub fn shadow(&mut self, mesh: &Mesh, stand: &Stand, camera: &Camera, palette: &Palette) {
        let sun = palette.sun;
        let depth_limit = (1.0 - stand.shade) * palette.direct + 0.12;
        let strength = (depth_limit.min(0.8) * 0.85 * (1.0 - stand.haze) * 256.0) as u32;
        let flat = |c: V3| {
            let p = c.turned(stand.heading.0, stand.heading.1) + stand.at;
            let (x, y, _) = camera.project(p - sun * (p.z / sun.z));
            (x, y)
        };
        let mut bounds = Bounds::EMPTY;
        for (x, y) in mesh.faces.iter().flat_map(|f| f.corners).map(flat) {
            bounds.include(x, y);
        }
        let Some(region) = Region::of(bounds, self, false) else {
            return;
        };
        let region = Region {
            fineness: region.fineness.min(2),
            ..region
        };
        let k = region.fineness as f32;
        self.clear(&region);
        let (w, h) = (
            region.width * region.fineness,
            region.height * region.fineness,
        );
        for face in &mesh.faces {
            let normal = face.normal.turned(stand.heading.0, stand.heading.1);
            if normal.dot(sun) > 0.0 {
                let corners = face
                    .corners
                    .map(flat)
                    .map(|(x, y)| ((x - region.x0 as f32) * k, (y - region.y0 as f32) * k));
                let depth = &mut self.depth;
                fill::polygon(&corners, w, h, |y, a, b| {
                    depth[y * w + a..y * w + b].fill(1.0)
                });
            }
        }
        let cells = (region.fineness * region.fineness) as u32;
        for j in 0..region.height {
            for i in 0..region.width {
                let covered = self.covered(&region, i, j);
                if covered > 0 {
                    let pixel = &mut self.pixels
                        [(region.y0 as usize + j) * self.width + region.x0 as usize + i];
                    *pixel = lerp_packed(*pixel, 0x0014_0c0a, strength * covered / cells);
                }
            }
        }
    }

    /// A soft spot on the ground (foam, dust): strongest in the middle, 0 at the edge.
    pub fn spot(&mut self, center: (f32, f32), radius: (f32, f32), color: Rgb, strength: f32) {
        let radius = (radius.0.clamp(0.5, 300.0), radius.1.clamp(0.5, 300.0));
        let packed = pack(color, 0);
        let width = self.width;
        let pixels = &mut self.pixels;
        fill::ellipse(center, radius, width, self.height, |y, a, b| {
            let v = (y as f32 + 0.5 - center.1) / radius.1;
            for x in a..b {
                let u = (x as f32 + 0.5 - center.0) / radius.0;
                let fade = (1.0 - u * u - v * v).max(0.0);
                let pixel = &mut pixels[y * width + x];
                *pixel = lerp_packed(*pixel, packed, (fade * strength * 256.0) as u32);
            }
        });
    }

    /// Draws a crown of about one meter radius as the camera sees it from afar, `scale` pixels to
    /// its meter.
    pub fn sprite(&mut self, crown: &Crown, camera: &Camera, scale: f32) -> Sprite {
        let scale = scale.clamp(2.0, 160.0);
        let side = (scale * 2.6) as usize + 4;
        let fineness = if scale < 28.0 { 2 } else { 1 };
        let region = Region {
            x0: 0,
            y0: 0,
            width: side,
            height: side,
            fineness,
        };
        self.clear(&region);
        let n = side * fineness;
        let k = scale * fineness as f32;
        let middle = 0.5 * n as f32;
        // A small crown needs fewer, larger tufts.
        let step = if scale < 10.0 {
            3
        } else if scale < 22.0 {
            2
        } else {
            1
        };
        let swell = [1.0, 1.0, 1.35, 1.6][step];
        let depth = &mut self.depth;
        let samples = &mut self.samples;
        for tuft in crown.tufts.iter().step_by(step) {
            let at = (
                middle + k * tuft.at.dot(camera.right),
                middle + k * tuft.at.dot(camera.down),
            );
            let near = 10.0 - tuft.at.dot(camera.forward);
            let color = pack(tuft.color, 255);
            let r = tuft.radius * swell * k;
            fill::ellipse(at, (r, r * 0.9), n, n, |y, a, b| {
                let row = y * n;
                for (d, s) in depth[row + a..row + b]
                    .iter_mut()
                    .zip(&mut samples[row + a..row + b])
                {
                    if near > *d {
                        (*d, *s) = (near, color);
                    }
                }
            });
        }
        let mut pixels = Vec::with_capacity(side * side);
        let mut spans = Vec::with_capacity(side);
        for j in 0..side {
            let mut span = (side as u16, 0);
            for i in 0..side {
                let (color, covered) = if fineness == 2 {
                    self.gather::<2>(&region, i, j)
                } else {
                    self.gather::<1>(&region, i, j)
                };
                if covered > 0 {
                    span = (span.0.min(i as u16), i as u16 + 1);
                }
                let mean = |sum: u32| sum / (fineness * fineness) as u32;
                pixels.push(
                    mean(color[0])
                        | mean(color[1]) << 8
                        | mean(color[2]) << 16
                        | mean(255 * covered) << 24,
                );
            }
            spans.push(span);
        }
        Sprite {
            side,
            scale,
            pixels,
            spans,
        }
    }

    /// Stamps a sprite with its middle at a pixel position, its crown `radius` pixels in radius.
    pub fn stamp(&mut self, sprite: &Sprite, center: (f32, f32), radius: f32, haze: (Rgb, f32)) {
        let scale = radius / sprite.scale;
        let half = 0.5 * sprite.side as f32 * scale;
        let x0 = (center.0 - half).floor().max(0.0) as usize;
        let y0 = (center.1 - half).floor().max(0.0) as usize;
        let x1 = ((center.0 + half).ceil().max(0.0) as usize).min(self.width);
        let y1 = ((center.1 + half).ceil().max(0.0) as usize).min(self.height);
        let inverse = 1.0 / scale;
        let step = (inverse * 65536.0) as i32;
        let haze_color = spread(pack(haze.0, 255));
        let haze_share = (haze.1 * 256.0) as u32;
        let hides = self
            .mask
            .as_ref()
            .is_some_and(|m| m.meets(x0 as i32, y0 as i32, x1 as i32, y1 as i32));
        for y in y0..y1 {
            let v = (y as f32 + 0.5 - center.1 + half) * inverse - 0.5;
            if v < 0.0 {
                continue;
            }
            let j = v as usize;
            let b = (v.fract() * 256.0) as u32;
            if j + 1 >= sprite.side {
                continue;
            }
            let s0 = sprite.spans[j];
            let s1 = sprite.spans[j + 1];
            let span = (f32::from(s0.0.min(s1.0)), f32::from(s0.1.max(s1.1)));
            let left = x0.max((center.0 - half + span.0 * scale - scale - 1.0).max(0.0) as usize);
            let right = x1.min((center.0 - half + span.1 * scale + scale + 1.0).max(0.0) as usize);
            let top = &sprite.pixels[j * sprite.side..][..sprite.side];
            let low = &sprite.pixels[(j + 1) * sprite.side..][..sprite.side];
            let pixels = &mut self.pixels[y * self.width..][..self.width];
            let mut u = (((left as f32 + 0.5 - center.0 + half) * inverse - 0.5) * 65536.0) as i32;
            for (x, pixel) in pixels.iter_mut().enumerate().take(right).skip(left) {
                let i = (u >> 16) as usize;
                let a = (u >> 8 & 255) as u32;
                u = u.wrapping_add(step);
                if i >= sprite.side - 1 {
                    continue;
                }
                let c = bilinear(&top[i..i + 2], &low[i..i + 2], a, b);
                let alpha = (c >> 48) as u32;
                if alpha == 0 {
                    continue;
                }
                if alpha >= 254 {
                    *pixel = gathered(lerp_lanes(c, haze_color, haze_share)) & 0x00ff_ffff;
                } else {
                    let cover = alpha + (alpha >> 7);
                    let c = lerp_lanes(c, lerp_lanes(0, haze_color, cover), haze_share);
                    *pixel = (gathered(c) & 0x00ff_ffff)
                        + gathered(lerp_lanes(0, spread(*pixel), 256 - cover));
                }
                if hides && let Some(mask) = &mut self.mask {
                    mask.hide(x as i32, y as i32, alpha as f32 / 255.0);
                }
            }
        }
    }

    fn clear(&mut self, region: &Region) {
        let samples = region.width * region.height * region.fineness * region.fineness;
        if self.depth.len() < samples {
            self.depth.resize(samples, 0.0);
            self.samples.resize(samples, 0);
        }
        self.depth[..samples].fill(0.0);
    }

    /// Fills one face into the region's samples where it is nearest.
    fn face(&mut self, corners: &[(f32, f32, f32); 4], color: u32, region: &Region) {
        // 1 / depth is linear over the face: its slopes from the wider of the two triangles.
        let [a, b, c, d] = *corners;
        let slopes = |p: (f32, f32, f32), q: (f32, f32, f32), r: (f32, f32, f32)| {
            let (u, v) = (
                (q.0 - p.0, q.1 - p.1, q.2 - p.2),
                (r.0 - p.0, r.1 - p.1, r.2 - p.2),
            );
            let area = u.0 * v.1 - u.1 * v.0;
            (
                area,
                (u.2 * v.1 - v.2 * u.1) / area,
                (v.2 * u.0 - u.2 * v.0) / area,
            )
        };
        let one = slopes(a, b, c);
        let two = slopes(a, c, d);
        let (area, dx, dy) = if one.0.abs() > two.0.abs() { one } else { two };
        if area.abs() < 1e-6 {
            return;
        }
        let (w, h) = (
            region.width * region.fineness,
            region.height * region.fineness,
        );
        let outline = corners.map(|p| (p.0, p.1));
        let depth = &mut self.depth;
        let samples = &mut self.samples;
        fill::polygon(&outline, w, h, |y, from, to| {
            let mut near = a.2 + (from as f32 + 0.5 - a.0) * dx + (y as f32 + 0.5 - a.1) * dy;
            let row = y * w;
            for (d, s) in depth[row + from..row + to]
                .iter_mut()
                .zip(&mut samples[row + from..row + to])
            {
                let nearer = near > *d;
                *d = if nearer { near } else { *d };
                *s = if nearer { color } else { *s };
                near += dx;
            }
        });
    }

    /// Sum of the covered samples' colors in a pixel of the region, and their number.
    #[inline(always)]
    fn gather<const N: usize>(&self, region: &Region, i: usize, j: usize) -> ([u32; 3], u32) {
        let mut even = 0;
        let mut green = 0;
        let mut covered = 0;
        let stride = region.width * N;
        for row in 0..N {
            let first = (j * N + row) * stride + i * N;
            for (&depth, &c) in self.depth[first..first + N]
                .iter()
                .zip(&self.samples[first..first + N])
            {
                if depth > 0.0 {
                    even += c & 0x00ff_00ff;
                    green += c >> 8 & 255;
                    covered += 1;
                }
            }
        }
        ([even & 0xffff, green, even >> 16], covered)
    }

    /// Number of covered samples in a pixel of the region.
    fn covered(&self, region: &Region, i: usize, j: usize) -> u32 {
        let n = region.fineness;
        let stride = region.width * region.fineness;
        let row = |r: usize| &self.depth[(j * n + r) * stride + i * n..][..n];
        (0..n).flat_map(row).map(|&d| u32::from(d > 0.0)).sum()
    }

    /// Lays the region's samples over the picture.
    fn composite(&mut self, region: &Region, target: bool) {
        match region.fineness {
            1 => self.lay::<1>(region, target),
            2 => self.lay::<2>(region, target),
            3 => self.lay::<3>(region, target),
            _ => self.lay::<4>(region, target),
        }
    }

    /// [`Frame::composite`] with `N` samples along a pixel's side.
    fn lay<const N: usize>(&mut self, region: &Region, target: bool) {
        let cells = (N * N) as u32;
        let mut mask = target.then(|| Mask {
            x0: region.x0,
            y0: region.y0,
            width: region.width,
            seen: vec![0.0; region.width * region.height],
            total: 0.0,
        });
        for j in 0..region.height {
            for i in 0..region.width {
                let (sum, covered) = self.gather::<N>(region, i, j);
                if covered == 0 {
                    continue;
                }
                let (x, y) = (region.x0 + i as i32, region.y0 + j as i32);
                let share = covered as f32 / cells as f32;
                if let Some(mask) = &mut mask {
                    mask.seen[j * region.width + i] = share;
                    mask.total += share;
                } else if let Some(mask) = &mut self.mask {
                    mask.hide(x, y, share);
                }
                if x >= 0 && y >= 0 && (x as usize) < self.width && (y as usize) < self.height {
                    let pixel = &mut self.pixels[y as usize * self.width + x as usize];
                    let rest = cells - covered;
                    let channel = |k: usize| (sum[k] + rest * (*pixel >> (8 * k) & 255)) / cells;
                    *pixel = channel(0) | channel(1) << 8 | channel(2) << 16;
                }
            }
        }
        if mask.is_some() {
            self.mask = mask;
        }
    }
}

/// The pixels an object is drawn in, and how many samples each has along a side.
#[derive(Clone, Copy)]
struct Region {
    x0: i32,
    y0: i32,
    width: usize,
    height: usize,
    fineness: usize,
}

impl Region {
    /// The region of bounds, clipped to the view unless `whole`; `None` if it lies outside.
    fn of(bounds: Bounds, frame: &Frame, whole: bool) -> Option<Region> {
        let mut x0 = bounds.left.floor() as i32;
        let mut y0 = bounds.top.floor() as i32;
        let mut x1 = (bounds.right.ceil() as i32).saturating_add(1);
        let mut y1 = (bounds.bottom.ceil() as i32).saturating_add(1);
        if whole {
            x1 = x1.min(x0.saturating_add(MOST_SIDE as i32 / 4));
            y1 = y1.min(y0.saturating_add(MOST_SIDE as i32 / 4));
        } else {
            x0 = x0.max(0);
            y0 = y0.max(0);
            x1 = x1.min(frame.width as i32);
            y1 = y1.min(frame.height as i32);
        }
        if x0 >= x1 || y0 >= y1 {
            return None;
        }
        let (width, height) = ((x1 - x0) as usize, (y1 - y0) as usize);
        let fineness = match width * height {
            _ if whole => 4,
            0..6000 => 3,
            6000..160_000 => 2,
            _ => 1,
        };
        Some(Region {
            x0,
            y0,
            width,
            height,
            fineness,
        })
    }
}
