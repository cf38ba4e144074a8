//! The things that stand on the ground: buildings, trees, parked vehicles, planned occluders.

use crate::actors::{Actor, Body, Route, TargetKind};
use crate::land::{Land, PERIOD, nearest_copy};
use crate::map::Extent;
use crate::math::{V3, v3};
use crate::mesh::{Mesh, coat};
use crate::rng::Rng;
use crate::trees::Tree;
use crate::vehicles;

/// Number of broad-leaved crowns a flight has.
pub(crate) const CROWNS: usize = 7;

/// Kind of a thing.
pub(crate) enum Thing {
    /// Index into [`Layout::meshes`].
    Mesh(usize),
    Tree(Tree),
}

/// A thing that does not move.
pub(crate) struct Standing {
    pub thing: Thing,
    pub at: V3,
    /// Cosine and sine of its heading.
    pub heading: (f32, f32),
    /// Whether it was planned to hide the target and is never removed.
    pub planned: bool,
    /// Whether it spans what passes below it, and so hides whatever it overlaps in the view.
    pub over: bool,
}

#[derive(Default)]
pub(crate) struct Layout {
    pub meshes: Vec<Mesh>,
    pub standing: Vec<Standing>,
    /// Parked vehicles, moored boats and people standing about.
    pub parked: Vec<Actor>,
    /// Taken places: x, t, radius.
    taken: Vec<(f32, f32, f32)>,
    /// Strips across the country kept free for a bridge: x and half width.
    pub strips: Vec<(f32, f32)>,
}

/// Builds a layout over an extent of the country.
pub(crate) struct Builder<'a> {
    pub land: &'a Land,
    pub extent: Extent,
    pub rng: Rng,
    pub salt: u32,
    pub layout: Layout,
}

impl Builder<'_> {
    pub fn free(&self, x: f32, t: f32, radius: f32) -> bool {
        let clear = |&(ox, ot, r): &(f32, f32, f32)| {
            let (dx, dt) = (nearest_copy(ox, x) - x, ot - t);
            dx * dx + dt * dt > (r + radius) * (r + radius)
        };
        let open = |&(sx, half): &(f32, f32)| (nearest_copy(sx, x) - x).abs() > half + radius;
        self.layout.strips.iter().all(open) && self.layout.taken.iter().all(clear)
    }

    /// Whether (x, t) lies inside the extent and a margin.
    pub fn wanted(&self, p: V3) -> bool {
        let x = self.extent.x.0 + (p.x - self.extent.x.0).rem_euclid(PERIOD);
        let e = &self.extent;
        (x < e.x.1 + 12.0 || x > e.x.0 + PERIOD - 12.0) && p.y > e.y.0 - 12.0 && p.y < e.y.1 + 12.0
    }

    pub fn tree(&mut self, x: f32, t: f32, tree: Tree) {
        let at = self.land.point(x, t);
        let open = |&(sx, half): &(f32, f32)| (nearest_copy(sx, x) - x).abs() > half + tree.radius;
        if self.wanted(at) && self.layout.strips.iter().all(open) {
            self.layout.standing.push(Standing {
                thing: Thing::Tree(tree),
                at,
                heading: (1.0, 0.0),
                planned: false,
                over: false,
            });
        }
    }

    /// Puts a mesh at (x, t), along the main line or (`across`) square to it, if its place is free.
    pub fn place(&mut self, x: f32, t: f32, across: bool, mesh: Mesh) -> bool {
        let at = self.land.point(x, t);
        let radius = mesh.bounds().0;
        if !self.wanted(at) || !self.free(x, t, radius * 0.8) {
            return false;
        }
        let h = self.land.heading(x);
        let heading = if across { (-h.y, h.x) } else { (h.x, h.y) };
        self.layout.taken.push((x, t, radius * 0.85));
        self.layout.standing.push(Standing {
            thing: Thing::Mesh(self.layout.meshes.len()),
            at,
            heading,
            planned: false,
            over: false,
        });
        self.layout.meshes.push(mesh);
        true
    }

    pub fn park(&mut self, kind: TargetKind, x: f32, t: f32, across: bool) {
        let p = self.land.point(x, t);
        if !self.wanted(p) || !self.free(x, t, 1.2) {
            return;
        }
        let body = Body::new(kind, &mut self.rng);
        let h = self.land.heading(x);
        let s = self.rng.sign();
        let facing = if across {
            (-h.y * s, h.x * s)
        } else {
            (h.x * s, h.y * s)
        };
        self.layout.taken.push((x, t, 1.6));
        self.layout.parked.push(Actor {
            kind,
            body,
            route: Route::parked(x, t, Some(facing)),
        });
    }

    pub fn stand(&mut self, x: f32, t: f32) {
        if self.wanted(self.land.point(x, t)) && self.free(x, t, 0.4) {
            let turn = self.rng.unit();
            let facing = (crate::math::cos_turns(turn), crate::math::sin_turns(turn));
            let body = Body::new(TargetKind::Person, &mut self.rng);
            self.layout.parked.push(Actor {
                kind: TargetKind::Person,
                body,
                route: Route::parked(x, t, Some(facing)),
            });
        }
    }

    fn occluder(&mut self, thing: Thing, at: V3, over: bool) {
        self.layout.standing.push(Standing {
            thing,
            at,
            heading: (1.0, 0.0),
            planned: true,
            over,
        });
    }

    /// A bridge across the main line whose middle, `z` above the ground, is at `over`.
    pub fn bridge(&mut self, over: V3, half: f32) {
        let surface = if half > 3.0 {
            [112.0, 112.0, 114.0]
        } else {
            [168.0, 150.0, 126.0]
        };
        let rim = self.rng.pick(&[
            [186.0, 182.0, 174.0],
            [150.0, 146.0, 140.0],
            [124.0, 140.0, 132.0],
        ]);
        let first = self.layout.meshes.len();
        let mut pier = Mesh::default();
        pier.cuboid(
            (0.0, 0.0),
            v3(half * 1.1, 0.9, over.z - 0.9),
            0.0,
            coat(rim, 0.0),
        );
        self.layout
            .meshes
            .extend([vehicles::deck(half, over.z, surface, rim), pier]);
        let low = (((self.extent.y.0 - over.y) / 8.0).floor() as i32 - 2).max(-60);
        let high = (((self.extent.y.1 - over.y) / 8.0).ceil() as i32 + 2).min(60);
        for k in low..=high {
            let at = v3(over.x, over.y + 8.0 * k as f32, 0.0);
            let t = self.land.t_of(at);
            let clear = self
                .land
                .along
                .iter()
                .all(|r| (t - r.at).abs() > r.half + 1.2)
                && !(8.0..30.0).contains(&t);
            self.occluder(Thing::Mesh(first), at, true);
            if k % 3 == 0 && clear {
                self.occluder(Thing::Mesh(first + 1), at, false);
            }
        }
        self.layout.strips.push((over.x, half + 1.0));
    }

    /// A canopy with the middle of its roof at `over`.
    pub fn canopy(&mut self, over: V3, radius: f32) {
        let mesh = vehicles::canopy(&mut self.rng, radius, over.z - 0.15 * radius);
        let at = v3(over.x, over.y, 0.0);
        let thing = Thing::Mesh(self.layout.meshes.len());
        self.layout.meshes.push(mesh);
        self.occluder(thing, at, true);
        self.layout.taken.push((at.x, self.land.t_of(at), radius));
    }

    /// A tree whose crown's middle is at `crown`; false if its trunk would stand in the way of
    /// traffic.
    pub fn screen(&mut self, crown: V3, radius: f32) -> bool {
        let at = v3(crown.x, crown.y, 0.0);
        if self.land.clearance(at.x, self.land.t_of(at)) < 0.6 {
            return false;
        }
        let tree = Tree {
            crown: self.rng.below(CROWNS),
            radius,
            height: crown.z,
            tiers: 1,
            taper: 1.0,
        };
        self.occluder(Thing::Tree(tree), at, false);
        true
    }
}
