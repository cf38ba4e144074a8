//! Fills the country with the things of its biome.

use crate::actors::TargetKind;
use crate::buildings;
use crate::ground::{Block, BlockKind, PLOT};
use crate::land::{Land, PERIOD, nearest_copy};
use crate::layout::{Builder, CROWNS};
use crate::math::v3;
use crate::mesh::{Mesh, coat};
use crate::palette::Biome;
use crate::rng::hash_unit;
use crate::trees::Tree;

impl Builder<'_> {
    /// Fills the extent with the things of the biome.
    pub fn furnish(&mut self) {
        match self.land.biome {
            Biome::Farmland => self.farmland(),
            Biome::Town => self.town(),
            Biome::Coast => self.coast(),
            Biome::Forest => self.scatter(4.1, 0.88, 1.2, |_, _| true),
            Biome::Park => self.park_grounds(),
            Biome::Highway => self.highway(),
        }
    }

    /// Trees on a jittered grid of the given spacing, each with a chance, `clear` meters off roads
    /// and water.
    fn scatter(&mut self, spacing: f32, chance: f32, clear: f32, ok: impl Fn(f32, f32) -> bool) {
        let conifers = [0.0, 0.15, 0.6, 0.95][self.rng.below(4)];
        let width = (self.extent.x.1 - self.extent.x.0 + 24.0).min(PERIOD);
        let nx = (width / spacing) as i32;
        let ny = ((self.extent.y.1 - self.extent.y.0 + 24.0) / spacing) as i32;
        for j in 0..ny {
            for i in 0..nx {
                let x = self.extent.x.0 - 12.0 + (i as f32 + self.rng.range(-0.25, 1.1)) * spacing;
                let y = self.extent.y.0 - 12.0 + (j as f32 + self.rng.range(-0.25, 1.1)) * spacing;
                let t = self.land.t_of(v3(x, y, 0.0));
                if !self.rng.chance(chance) || !ok(x, t) {
                    continue;
                }
                let tree = if self.rng.chance(conifers) {
                    Tree::conifer(&mut self.rng, CROWNS)
                } else {
                    Tree::round(&mut self.rng, CROWNS)
                };
                if self.land.clearance(x, t) > clear + 0.45 * tree.radius
                    && self.free(x, t, 0.7 * tree.radius)
                {
                    self.tree(x, t, tree);
                }
            }
        }
    }

    fn house(&mut self, x: f32, t: f32, across: bool) -> bool {
        let tall = self.rng.range(2.8, 5.6);
        let size = v3(self.rng.range(9.0, 12.5), self.rng.range(7.0, 9.0), tall);
        let mesh = buildings::house(&mut self.rng, size, false);
        self.place(x, t, across, mesh)
    }

    fn farmland(&mut self) {
        let half = self.land.along[0].half;
        for i in 0..7 {
            // A farmstead: house, barns, a silo, a few trees and vehicles in the yard.
            let x = i as f32 * 110.0 + self.rng.range(0.0, 70.0);
            let side = self.rng.sign();
            let t = side * (half + self.rng.range(16.0, 26.0));
            if self.land.clearance(x, t) < 12.0 || !self.house(x, t, false) {
                continue;
            }
            for k in 0..2 {
                let size = v3(
                    self.rng.range(14.0, 22.0),
                    self.rng.range(9.0, 12.0),
                    self.rng.range(4.0, 6.0),
                );
                let barn = buildings::house(&mut self.rng, size, true);
                let t = t + side * self.rng.range(4.0, 12.0);
                self.place(x + 22.0 - 44.0 * k as f32, t, k == 0, barn);
            }
            let silo = buildings::silo(&mut self.rng);
            self.place(x + 8.0, t + side * 17.0, false, silo);
            self.park(TargetKind::Car, x + 8.0, t - side * 4.0, true);
            self.park(TargetKind::Van, x - 9.5, t - side * 3.0, true);
            for _ in 0..6 {
                let x = x + self.rng.range(-26.0, 26.0);
                let t = t + side * self.rng.range(-7.0, 22.0);
                if self.free(x, t, 2.0) && self.land.clearance(x, t) > 2.5 {
                    let tree = Tree::round(&mut self.rng, CROWNS);
                    self.tree(x, t, tree);
                }
            }
        }
        self.roadside(half + 3.6, 11.0, 0.5);
        self.hedges();
        self.bales();
        self.scatter(17.0, 0.07, 2.0, |_, _| true);
    }

    /// Trees in rows along the main road, in stretches.
    fn roadside(&mut self, t: f32, step: f32, share: f32) {
        for side in [-1.0, 1.0] {
            for i in 0..(PERIOD / step) as i32 {
                let x = i as f32 * step + self.rng.range(-1.5, 1.5);
                let stretch = hash_unit(i / 6, side as i32, self.salt ^ 5) < share;
                let t = side * (t + self.rng.range(0.0, 0.8));
                if stretch && self.land.clearance(x, t) > 1.6 && self.free(x, t, 1.5) {
                    let tree = Tree::round(&mut self.rng, CROWNS);
                    self.tree(
                        x,
                        t,
                        Tree {
                            radius: tree.radius * 0.85,
                            height: tree.height * 0.95,
                            ..tree
                        },
                    );
                }
            }
        }
    }

    /// Bushes along the strips' edges.
    fn hedges(&mut self) {
        let margin = self.land.along[0].half + 4.5;
        for (row, side) in [(1.0, 1.0), (1.0, -1.0), (2.0, 1.0), (2.0, -1.0)] {
            let mut x = 0.0;
            while x < PERIOD {
                x += self.rng.range(1.0, 2.4);
                let t = side * (margin + row * 62.0 + self.rng.range(-0.5, 0.5));
                if hash_unit((x / 40.0) as i32, (row * side) as i32, self.salt ^ 6) < 0.6
                    && self.free(x, t, 0.6)
                    && self.land.clearance(x, t) > 1.0
                {
                    let tall = self.rng.chance(0.12);
                    let bush = if tall {
                        Tree::round(&mut self.rng, CROWNS)
                    } else {
                        Tree::bush(&mut self.rng, CROWNS)
                    };
                    self.tree(x, t, bush);
                }
            }
        }
    }

    fn bales(&mut self) {
        for i in 0..14 {
            let x = i as f32 * 55.0 + self.rng.range(0.0, 30.0);
            let side = self.rng.sign();
            if self.rng.chance(0.5) {
                continue;
            }
            for k in 0..6 {
                let mut bale = Mesh::default();
                bale.drum(10, (0.75, 0.72), (0.0, 1.25), [196.0, 170.0, 108.0]);
                let t = side * (18.0 + 9.0 * (k / 2) as f32 + self.rng.range(-2.0, 2.0));
                if self.land.clearance(x, t) > 8.0 {
                    let x = x + 9.0 * (k % 2) as f32 + self.rng.range(-2.0, 2.0);
                    self.place(x, t, false, bale);
                }
            }
        }
    }

    fn town(&mut self) {
        let Some((gap, depth)) = self.land.blocks else {
            return;
        };
        let street = self.land.along[0];
        let rows = ((self.extent.y.1 - self.extent.y.0) / depth) as i32 / 2 + 2;
        for column in 0..(PERIOD / gap).round() as i32 {
            for row in -rows.min(3)..rows.min(3) {
                let corner = (gap * (column as f32 + 0.5), depth * row as f32);
                let block = Block::of(
                    corner.0 + 0.5 * gap,
                    corner.1 + 0.5 * depth,
                    gap,
                    depth,
                    self.salt,
                );
                match block.kind {
                    BlockKind::Houses => {
                        for plot in 0..(gap / PLOT) as i32 {
                            let x = corner.0 + (plot as f32 + 0.62) * PLOT;
                            for back in [-1.0, 1.0] {
                                let t = corner.1
                                    + depth * 0.5
                                    + back * (depth * 0.5 - 16.0 - self.rng.range(0.0, 2.0));
                                if self.land.clearance(x, t) > 5.5 {
                                    let turned = self.rng.chance(0.25);
                                    self.house(x, t, turned);
                                    if self.rng.chance(0.5) {
                                        self.park(
                                            TargetKind::Car,
                                            x - 0.42 * PLOT,
                                            t + back * 6.0,
                                            true,
                                        );
                                    }
                                }
                            }
                        }
                    }
                    BlockKind::Flats => {
                        for k in [0.3, 0.7] {
                            let size = v3(
                                self.rng.range(14.0, 19.0),
                                self.rng.range(11.0, 14.0),
                                self.rng.pick(&[4.0, 7.0, 10.0]),
                            );
                            let mesh = buildings::flats(&mut self.rng, size);
                            let x = corner.0 + gap * k;
                            let t = corner.1 + depth * (0.5 + self.rng.range(-0.1, 0.1));
                            self.place(x, t, self.salt & 1 == 0, mesh);
                        }
                    }
                    BlockKind::CarPark => {
                        for row in 0..3 {
                            for bay in 0..(gap / 2.6) as i32 {
                                let x = bay as f32 * 2.6 + 2.6;
                                let t = row as f32 * 17.0 + [2.5, 14.5][bay as usize % 2];
                                let inside = x.min(gap - x).min(t).min(depth - t);
                                if inside > 9.5 && self.rng.chance(0.55) {
                                    self.park(TargetKind::Car, corner.0 + x, corner.1 + t, true);
                                }
                            }
                        }
                    }
                }
            }
        }
        let off_junction = |land: &Land, x: f32| {
            land.across
                .iter()
                .all(|r| (nearest_copy(r.at, x) - x).abs() > r.half + r.walk + 6.0)
        };
        for side in [-1.0, 1.0] {
            for i in 0..(PERIOD / 6.4) as i32 {
                let x = i as f32 * 6.4 + self.rng.range(-0.3, 0.3);
                if !off_junction(self.land, x) {
                    continue;
                }
                if self.rng.chance(0.42) {
                    let kind = if self.rng.chance(0.15) {
                        TargetKind::Van
                    } else {
                        TargetKind::Car
                    };
                    self.park(kind, x, side * (street.half - 1.05), false);
                }
                let curb = side * (street.half + street.walk + 0.9);
                if i % 2 == 0 && self.rng.chance(0.6) {
                    let tree = Tree::round(&mut self.rng, CROWNS);
                    self.tree(
                        x + 3.0,
                        curb,
                        Tree {
                            radius: tree.radius * 0.62,
                            height: tree.height * 0.8 + 0.8,
                            ..tree
                        },
                    );
                }
                if i % 4 == 1 {
                    let mut lamp = buildings::lamp();
                    lamp.turn(0, -side, 0.0);
                    self.place(x, side * (street.half + 0.5), false, lamp);
                }
            }
        }
        self.scatter(7.0, 0.3, 2.2, |_, _| true);
    }

    fn coast(&mut self) {
        let Some(water) = self.land.water else { return };
        let road = self.land.along[0];
        for i in 0..64 {
            let x = i as f32 * 12.0 + self.rng.range(-1.5, 1.5);
            if water.quay {
                if self.rng.chance(0.45) {
                    self.park(TargetKind::Boat, x, 2.3, false);
                }
                match self.rng.below(7) {
                    0 | 1 => {
                        let stack = buildings::containers(&mut self.rng);
                        let t = self.rng.range(-19.0, -13.0);
                        self.place(x, t, false, stack);
                    }
                    2 => {
                        let size = v3(self.rng.range(16.0, 24.0), 10.0, 5.5);
                        let shed = buildings::house(&mut self.rng, size, true);
                        self.place(x, -18.0, false, shed);
                    }
                    3 => {
                        let kind =
                            self.rng
                                .pick(&[TargetKind::Van, TargetKind::Truck, TargetKind::Car]);
                        let t = self.rng.range(-20.0, -11.0);
                        self.park(kind, x, t, self.salt & 2 == 0);
                    }
                    _ => {}
                }
            } else if i % 8 == 3 {
                // A jetty with boats on both sides.
                for k in 0..4 {
                    let mut planks = Mesh::default();
                    planks.cuboid(
                        (0.0, 0.0),
                        v3(7.0, 1.9, 0.2),
                        0.7,
                        coat([150.0, 122.0, 92.0], 0.0),
                    );
                    for p in 0..6 {
                        let x = -3.2 + 1.2 * p as f32;
                        planks.lid(
                            (x, x + 0.08),
                            (-0.95, 0.95),
                            0.915,
                            [104.0, 84.0, 64.0],
                            0.0,
                        );
                    }
                    let t = -1.0 + 7.0 * k as f32;
                    if !self
                        .layout
                        .strips
                        .iter()
                        .any(|&(sx, half)| (nearest_copy(sx, x) - x).abs() < half + 2.0)
                        && t < 11.0
                    {
                        self.place(x, t, true, planks);
                    }
                }
                self.park(TargetKind::Boat, x + 3.4, 7.0, true);
                self.park(TargetKind::Boat, x - 3.4, 5.0, true);
            }
            if self.rng.chance(0.18) {
                let t = self.rng.range(32.0, 60.0);
                if t < water.to - 5.0 {
                    self.park(TargetKind::Boat, x, t, self.salt & 4 == 0);
                }
            }
            if self.rng.chance(0.5) {
                let t = if water.quay {
                    self.rng.range(-9.0, -2.5)
                } else {
                    self.rng.range(-12.0, -7.0)
                };
                let x = x + self.rng.range(0.0, 6.0);
                self.stand(x, t);
            }
            if i % 2 == 0 {
                let t = road.at - road.half - self.rng.range(14.0, 20.0);
                self.house(x, t, false);
                let tree = Tree::round(&mut self.rng, CROWNS);
                self.tree(
                    x,
                    road.at + road.half + road.walk + 1.4,
                    Tree {
                        radius: tree.radius * 0.6,
                        ..tree
                    },
                );
            }
        }
        self.scatter(9.0, 0.3, 3.0, |_, t| t < -20.0 || t > water.to);
    }

    fn park_grounds(&mut self) {
        for i in 0..48 {
            let x = i as f32 * 16.0 + self.rng.range(-4.0, 4.0);
            let side = self.rng.sign();
            if self.land.clearance(x, side * 2.9) > 0.5 {
                let mut bench = Mesh::default();
                bench.cuboid(
                    (0.0, 0.0),
                    v3(1.8, 0.5, 0.1),
                    0.42,
                    coat([136.0, 96.0, 62.0], 0.0),
                );
                bench.cuboid(
                    (0.0, side * 0.25),
                    v3(1.8, 0.08, 0.45),
                    0.48,
                    coat([126.0, 88.0, 56.0], 0.0),
                );
                self.place(x, side * 2.9, false, bench);
            }
            for _ in 0..self.rng.below(4) {
                let t = self.rng.range(5.0, 26.0) * self.rng.sign();
                let x = x + self.rng.range(-5.0, 5.0);
                if self.land.clearance(x, t) > 1.5 {
                    self.stand(x, t);
                    if self.rng.chance(0.6) {
                        let x = x + self.rng.range(0.7, 1.3);
                        let t = t + self.rng.range(-0.8, 0.8);
                        self.stand(x, t);
                    }
                }
            }
        }
        self.scatter(9.0, 0.42, 1.6, |_, _| true);
        self.scatter(5.0, 0.06, 1.0, |_, _| true);
    }

    fn highway(&mut self) {
        let road = self.land.along[0];
        for i in 0..32 {
            let x = i as f32 * 24.0;
            let lamp = buildings::lamp();
            self.place(x, road.at, false, lamp);
        }
        self.roadside(road.half + 5.0, 8.0, 0.4);
        self.hedges();
        self.scatter(12.0, 0.12, 4.0, |_, _| true);
    }
}
