//! People on foot and on bicycles, with limbs that move.

use crate::math::{Rgb, V3, cos_turns, sin_turns, v3};
use crate::mesh::{Mesh, coat, ring, tone};
use crate::rng::Rng;

/// Looks of one person.
#[derive(Clone, Copy)]
pub(crate) struct Look {
    shirt: Rgb,
    trousers: Rgb,
    skin: Rgb,
    hair: Rgb,
    height: f32,
    bag: Option<Rgb>,
    pub cyclist: bool,
}

impl Look {
    pub fn new(rng: &mut Rng, cyclist: bool) -> Look {
        let clothes = [
            [186.0, 42.0, 40.0],
            [36.0, 66.0, 130.0],
            [228.0, 228.0, 222.0],
            [42.0, 44.0, 48.0],
            [226.0, 186.0, 60.0],
            [64.0, 122.0, 78.0],
            [206.0, 116.0, 150.0],
            [112.0, 148.0, 190.0],
            [214.0, 112.0, 44.0],
        ];
        Look {
            shirt: rng.pick(&clothes),
            trousers: rng.pick(&[
                [44.0, 54.0, 86.0],
                [40.0, 40.0, 44.0],
                [150.0, 134.0, 104.0],
                [84.0, 86.0, 90.0],
            ]),
            skin: rng.pick(&[
                [224.0, 180.0, 150.0],
                [196.0, 148.0, 114.0],
                [128.0, 88.0, 64.0],
            ]),
            hair: rng.pick(&[
                [42.0, 32.0, 26.0],
                [96.0, 66.0, 40.0],
                [186.0, 156.0, 100.0],
                [30.0, 30.0, 34.0],
            ]),
            height: rng.range(1.58, 1.92),
            bag: rng.chance(0.3).then(|| rng.pick(&clothes)),
            cyclist,
        }
    }

    /// The body at a phase of its stride, in turns; `stride` is 0 for someone standing still, 1 for
    /// a walk.
    pub fn mesh(&self, phase: f32, stride: f32) -> Mesh {
        if self.cyclist {
            self.ride(phase)
        } else {
            self.walk(phase, stride)
        }
    }

    /// A limb of square cross-section from `a` to `b`.
    fn limb(m: &mut Mesh, a: V3, b: V3, thick: f32, color: Rgb) {
        let axis = (b - a).unit();
        let across = axis.cross(v3(0.31, 1.0, 0.17)).unit() * thick;
        let deep = axis.cross(across).unit() * thick;
        let ends = [
            across + deep,
            across - deep,
            across * -1.0 - deep,
            deep - across,
        ];
        let inside = (a + b) * 0.5;
        for i in 0..4 {
            let p = ends[i];
            let q = ends[(i + 1) % 4];
            m.quad([a + p, a + q, b + q, b + p], inside, color, 0.0);
        }
        m.quad(ends.map(|e| a + e), inside, color, 0.0);
        m.quad(ends.map(|e| b + e), inside, color, 0.0);
    }

    /// Head with hair, around `at`.
    fn head(&self, m: &mut Mesh, at: V3, k: f32) {
        let first = m.faces.len();
        m.block(
            ring(-0.07, 0.08, 0.07, -0.13),
            ring(-0.1, 0.1, 0.095, -0.02),
            coat(self.skin, 0.0),
        );
        m.block(
            ring(-0.1, 0.1, 0.095, -0.02),
            ring(-0.1, 0.08, 0.09, 0.06),
            crate::mesh::Coat {
                front: self.skin,
                ..coat(self.hair, 0.0)
            },
        );
        m.block(
            ring(-0.1, 0.08, 0.09, 0.06),
            ring(-0.05, 0.03, 0.05, 0.125),
            coat(self.hair, 0.1),
        );
        for face in &mut m.faces[first..] {
            face.corners = face.corners.map(|c| c * (k * 1.06) + at);
        }
    }

    fn walk(&self, phase: f32, stride: f32) -> Mesh {
        let mut m = Mesh::default();
        let k = self.height / 1.75;
        let swing = sin_turns(phase) * stride;
        let bob = 0.02 * cos_turns(2.0 * phase) * stride;
        let p = |x: f32, y: f32, z: f32| v3(x * k, y * k, (z + bob).max(0.0) * k);
        for (side, s) in [(-1.0, swing), (1.0, -swing)] {
            // The leg that comes forward bends its knee.
            let lift = 0.09 * (cos_turns(phase) * side).max(0.0) * stride;
            let hip = p(0.0, side * 0.09, 0.86);
            let knee = p(0.13 * s + lift, side * 0.1, 0.46);
            let foot = p(0.27 * s, side * 0.1, 0.06 + lift);
            Self::limb(&mut m, hip, knee, 0.085 * k, self.trousers);
            Self::limb(&mut m, knee, foot, 0.065 * k, tone(self.trousers, 0.94));
            Self::limb(
                &mut m,
                foot + v3(-0.06 * k, 0.0, -0.01),
                foot + v3(0.17 * k, 0.0, -0.02),
                0.04 * k,
                [40.0, 36.0, 34.0],
            );
            let shoulder = p(0.0, side * 0.22, 1.4);
            let elbow = p(-0.12 * s, side * 0.27, 1.14);
            let hand = p(-0.26 * s + 0.05, side * 0.25, 0.9);
            Self::limb(&mut m, shoulder, elbow, 0.055 * k, self.shirt);
            Self::limb(&mut m, elbow, hand, 0.042 * k, self.skin);
        }
        let scaled = |r: crate::mesh::Ring| crate::mesh::Ring {
            back: r.back * k,
            front: r.front * k,
            half: r.half * k,
            z_back: (r.z_back + bob) * k,
            z_front: (r.z_front + bob) * k,
        };
        let shirt = crate::mesh::Coat {
            front: tone(self.shirt, 1.04),
            back: tone(self.shirt, 0.96),
            ..coat(self.shirt, 0.0)
        };
        m.block(
            scaled(ring(-0.11, 0.11, 0.16, 0.84)),
            scaled(ring(-0.12, 0.12, 0.2, 1.2)),
            shirt,
        );
        m.block(
            scaled(ring(-0.12, 0.12, 0.2, 1.2)),
            scaled(ring(-0.08, 0.08, 0.2, 1.44)),
            shirt,
        );
        m.block(
            scaled(ring(-0.05, 0.05, 0.05, 1.42)),
            scaled(ring(-0.05, 0.05, 0.05, 1.52)),
            coat(self.skin, 0.0),
        );
        if let Some(color) = self.bag {
            m.block(
                scaled(ring(-0.26, -0.1, 0.15, 1.0)),
                scaled(ring(-0.22, -0.1, 0.13, 1.42)),
                coat(color, 0.0),
            );
        }
        self.head(&mut m, p(0.02, 0.0, 1.63), k);
        m
    }

    fn ride(&self, phase: f32) -> Mesh {
        let mut m = Mesh::default();
        let frame = tone(self.shirt, 0.8);
        // Wheels as octagonal rings.
        for x in [-0.52, 0.52] {
            for i in 0..8 {
                let at = |i: usize| {
                    let turn = (i as f32 + 0.5) / 8.0;
                    v3(
                        x + 0.33 * cos_turns(turn),
                        0.0,
                        0.36 + 0.33 * sin_turns(turn),
                    )
                };
                Self::limb(&mut m, at(i), at(i + 1), 0.025, [34.0, 34.0, 36.0]);
            }
        }
        let saddle = v3(-0.22, 0.0, 0.95);
        let crank = v3(-0.08, 0.0, 0.34);
        let bar = v3(0.4, 0.0, 1.02);
        for (a, b) in [
            (saddle, crank),
            (crank, bar),
            (v3(-0.2, 0.0, 0.82), v3(0.38, 0.0, 0.86)),
            (crank, v3(-0.52, 0.0, 0.36)),
            (bar, v3(0.52, 0.0, 0.36)),
        ] {
            Self::limb(&mut m, a, b, 0.022, frame);
        }
        Self::limb(
            &mut m,
            v3(0.4, -0.28, 1.04),
            v3(0.4, 0.28, 1.04),
            0.022,
            [40.0; 3],
        );
        for side in [-1.0f32, 1.0] {
            let turn = phase + 0.25 * side;
            let pedal = crank + v3(0.16 * cos_turns(turn), side * 0.12, 0.16 * sin_turns(turn));
            let hip = v3(-0.2, side * 0.09, 1.0);
            let knee = (hip + pedal) * 0.5 + v3(0.26, 0.0, 0.06);
            Self::limb(&mut m, hip, knee, 0.085, self.trousers);
            Self::limb(&mut m, knee, pedal, 0.06, tone(self.trousers, 0.94));
            Self::limb(
                &mut m,
                v3(0.14, side * 0.2, 1.46),
                v3(0.38, side * 0.26, 1.08),
                0.045,
                self.skin,
            );
        }
        Self::limb(
            &mut m,
            v3(-0.2, 0.0, 1.02),
            v3(0.12, 0.0, 1.5),
            0.15,
            self.shirt,
        );
        if let Some(color) = self.bag {
            Self::limb(
                &mut m,
                v3(-0.24, 0.0, 1.24),
                v3(-0.06, 0.0, 1.5),
                0.13,
                color,
            );
        }
        self.head(&mut m, v3(0.22, 0.0, 1.66), 1.0);
        m
    }
}
