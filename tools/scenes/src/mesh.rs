//! Things made of flat quads, in meters around their own middle on the ground: x forward, y left, z
//! up.

use crate::math::{Rgb, V3, cos_turns, lerp, scaled, sin_turns, v3};

/// A flat, convex quad (a triangle repeats its last corner), seen from its outer side only.
#[derive(Clone, Copy)]
pub(crate) struct Face {
    pub corners: [V3; 4],
    pub normal: V3,
    pub color: Rgb,
    /// Share of mirrored sunlight, 0 matt..1 glass.
    pub gloss: f32,
}

#[derive(Clone, Default)]
pub(crate) struct Mesh {
    pub faces: Vec<Face>,
}

/// One end of a tapered block: a level or sloping rectangle.
#[derive(Clone, Copy)]
pub(crate) struct Ring {
    pub back: f32,
    pub front: f32,
    pub half: f32,
    pub z_back: f32,
    pub z_front: f32,
}

/// A level ring.
pub(crate) fn ring(back: f32, front: f32, half: f32, z: f32) -> Ring {
    Ring {
        back,
        front,
        half,
        z_back: z,
        z_front: z,
    }
}

/// Colors of a block's faces.
#[derive(Clone, Copy)]
pub(crate) struct Coat {
    pub side: Rgb,
    pub front: Rgb,
    pub back: Rgb,
    pub top: Rgb,
    pub gloss: f32,
}

/// One color all over.
pub(crate) fn coat(color: Rgb, gloss: f32) -> Coat {
    Coat {
        side: color,
        front: color,
        back: color,
        top: color,
        gloss,
    }
}

impl Mesh {
    /// Adds a quad whose outer side is the one away from `inside`.
    pub fn quad(&mut self, corners: [V3; 4], inside: V3, color: Rgb, gloss: f32) {
        let [a, b, c, d] = corners;
        let mut normal = (c - a).cross(d - b).unit();
        if normal.dot((a + c) * 0.5 - inside) < 0.0 {
            normal = normal * -1.0;
        }
        self.faces.push(Face {
            corners,
            normal,
            color,
            gloss,
        });
    }

    /// A block between two rings: four sides and a top (its underside is never seen).
    pub fn block(&mut self, lo: Ring, hi: Ring, coat: Coat) {
        let corners = |r: Ring| {
            [
                v3(r.back, -r.half, r.z_back),
                v3(r.front, -r.half, r.z_front),
                v3(r.front, r.half, r.z_front),
                v3(r.back, r.half, r.z_back),
            ]
        };
        let l = corners(lo);
        let h = corners(hi);
        let inside = (0..4).fold(V3::default(), |sum, i| sum + (l[i] + h[i]) * 0.125);
        for (i, color) in [coat.side, coat.front, coat.side, coat.back]
            .into_iter()
            .enumerate()
        {
            let j = (i + 1) % 4;
            self.quad([l[i], l[j], h[j], h[i]], inside, color, coat.gloss);
        }
        self.quad(h, inside, coat.top, coat.gloss);
    }

    /// A box given by its middle on the ground, its size and the height of its foot.
    pub fn cuboid(&mut self, middle: (f32, f32), size: V3, z: f32, coat: Coat) {
        let first = self.faces.len();
        let a = size.x * 0.5;
        let half = size.y * 0.5;
        self.block(ring(-a, a, half, z), ring(-a, a, half, z + size.z), coat);
        self.shift(first, v3(middle.0, middle.1, 0.0));
    }

    /// A thin plate on the right and left side (y = -half and half) between two heights.
    pub fn plates(&mut self, x: (f32, f32), half: f32, z: (f32, f32), color: Rgb, gloss: f32) {
        for y in [-half, half] {
            let corners = [
                v3(x.0, y, z.0),
                v3(x.1, y, z.0),
                v3(x.1, y, z.1),
                v3(x.0, y, z.1),
            ];
            self.quad(corners, v3(0.0, 0.0, 0.5 * (z.0 + z.1)), color, gloss);
        }
    }

    /// A plate facing forward or backward at `x`, seen from the side away from the middle.
    pub fn end_plate(&mut self, x: f32, y: (f32, f32), z: (f32, f32), color: Rgb) {
        let corners = [
            v3(x, y.0, z.0),
            v3(x, y.1, z.0),
            v3(x, y.1, z.1),
            v3(x, y.0, z.1),
        ];
        self.quad(corners, v3(0.0, 0.0, 0.5 * (z.0 + z.1)), color, 0.2);
    }

    /// A level plate seen from above.
    pub fn lid(&mut self, x: (f32, f32), y: (f32, f32), z: f32, color: Rgb, gloss: f32) {
        let corners = [
            v3(x.0, y.0, z),
            v3(x.1, y.0, z),
            v3(x.1, y.1, z),
            v3(x.0, y.1, z),
        ];
        self.quad(corners, v3(0.0, 0.0, z - 1.0), color, gloss);
    }

    /// Wheels: dark hexagons with a lighter hub just outside the body's sides.
    pub fn wheels(&mut self, at: &[f32], radius: f32, half: f32) {
        for &x in at {
            for (r, y, color) in [
                (radius, half, [30.0, 30.0, 32.0]),
                (radius * 0.52, half + 0.01, [120.0, 122.0, 126.0]),
            ] {
                let z = radius;
                let (a, b) = (r * 0.55, r * 0.84);
                for side in [-y, y] {
                    let inside = v3(x, 0.0, z);
                    let p = |dx: f32, dz: f32| v3(x + dx, side, z + dz);
                    self.quad(
                        [p(-r, 0.0), p(-a, b), p(a, b), p(r, 0.0)],
                        inside,
                        color,
                        0.1,
                    );
                    self.quad(
                        [p(-r, 0.0), p(-a, -b), p(a, -b), p(r, 0.0)],
                        inside,
                        color,
                        0.1,
                    );
                }
            }
        }
    }

    /// An upright prism or cone with `n` sides around (0, 0).
    pub fn drum(&mut self, n: usize, radius: (f32, f32), z: (f32, f32), color: Rgb) {
        let p = |i: usize, r: f32, z: f32| {
            let turn = i as f32 / n as f32;
            v3(r * cos_turns(turn), r * sin_turns(turn), z)
        };
        let inside = v3(0.0, 0.0, lerp(z.0, z.1, 0.3));
        for i in 0..n {
            let side = [
                p(i, radius.0, z.0),
                p(i + 1, radius.0, z.0),
                p(i + 1, radius.1, z.1),
                p(i, radius.1, z.1),
            ];
            self.quad(side, inside, color, 0.15);
            let center = v3(0.0, 0.0, z.1);
            self.quad(
                [center, p(i, radius.1, z.1), p(i + 1, radius.1, z.1), center],
                inside,
                color,
                0.1,
            );
        }
    }

    /// Moves the faces from `first` on.
    pub fn shift(&mut self, first: usize, by: V3) {
        self.map(first, |p| p + by);
    }

    /// Turns the faces from `first` on about the z axis.
    pub fn turn(&mut self, first: usize, cos: f32, sin: f32) {
        self.map(first, |p| p.turned(cos, sin));
        self.faces[first..]
            .iter_mut()
            .for_each(|f| f.normal = f.normal.turned(cos, sin));
    }

    fn map(&mut self, first: usize, place: impl Fn(V3) -> V3) {
        for face in &mut self.faces[first..] {
            face.corners = face.corners.map(&place);
        }
    }

    /// Radius of the upright cylinder around the origin that holds everything, and its height.
    pub fn bounds(&self) -> (f32, f32) {
        let corners = self.faces.iter().flat_map(|f| f.corners);
        corners.fold((0.0f32, 0.0f32), |(r, h), p| {
            (r.max((p.x * p.x + p.y * p.y).sqrt()), h.max(p.z))
        })
    }
}

/// A color of the same hue, lighter or darker.
pub(crate) fn tone(color: Rgb, k: f32) -> Rgb {
    scaled(color, k).map(|v| v.min(255.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn block_faces_look_outward() {
        let mut mesh = Mesh::default();
        mesh.block(
            ring(-2.0, 2.0, 1.0, 0.0),
            ring(-1.5, 1.0, 0.8, 1.0),
            coat([9.0; 3], 0.0),
        );
        mesh.wheels(&[1.0], 0.3, 1.1);
        for face in &mesh.faces {
            let middle = face
                .corners
                .iter()
                .fold(V3::default(), |s, &c| s + c * 0.25);
            assert!(face.normal.dot(middle - v3(0.0, 0.0, 0.5)) > 0.0);
        }
        let (radius, height) = mesh.bounds();
        assert!((radius - 5f32.sqrt()).abs() < 1e-4 && height == 1.0);
    }
}
