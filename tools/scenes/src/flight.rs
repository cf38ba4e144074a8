//! A flight: everything that is planned before the first frame.

use crate::FlightConfig;
use crate::actors::{self, Actor, TargetKind};
use crate::camera::{Camera, Exit, Plan};
use crate::ground::Painter;
use crate::land::{Land, PERIOD, nearest_copy};
use crate::layout::{Builder, CROWNS, Layout, Thing};
use crate::map::{Extent, Map};
use crate::math::v3;
use crate::palette::{Biome, Palette};
use crate::preset::Preset;
use crate::rng::Rng;
use crate::trees::{self, Crown};

/// Frames a second.
pub(crate) const RATE: f32 = 30.0;

/// A seeded flight over a procedural country, ready to render any of its frames.
pub struct Flight {
    pub(crate) config: FlightConfig,
    pub(crate) land: Land,
    pub(crate) palette: Palette,
    pub(crate) preset: Preset,
    /// The target first.
    pub(crate) actors: Vec<Actor>,
    pub(crate) plan: Plan,
    pub(crate) layout: Layout,
    /// Radius and height of each of the layout's meshes.
    pub(crate) sizes: Vec<(f32, f32)>,
    pub(crate) map: Map,
    pub(crate) crowns: Vec<Crown>,
    pub(crate) haze: f32,
    /// Height of the point the camera follows.
    pub(crate) aim: f32,
    /// Seconds at which an occluder was planned.
    pub(crate) occlusions: Vec<f32>,
    /// Seed of the ground's noise.
    pub(crate) salt: u32,
}

impl Flight {
    /// Plans the flight and paints its country.
    ///
    /// Width and height are clamped to 1..=8192, frames to at least 1. The call takes some tenths
    /// of a second for the default size, and memory for at most a few million texels of ground.
    pub fn new(config: FlightConfig) -> Flight {
        let mut flight = Flight::unpainted(config);
        let (extent, texel) = flight.extent();
        let mut map = Map::new(extent, texel);
        flight.cast_shadows(&mut map);
        map.paint(&Painter::new(
            &flight.land,
            &flight.palette,
            map.texel,
            flight.salt,
        ));
        flight.map = map;
        flight
    }

    /// A flight with black ground, for tests of geometry.
    pub(crate) fn unpainted(config: FlightConfig) -> Flight {
        let mut config = config;
        config.width = config.width.clamp(1, 8192);
        config.height = config.height.clamp(1, 8192);
        config.frames = config.frames.max(1);
        let seed = config.seed;
        let mut rng = Rng::new(seed, 1);
        let (biome, kind) = choose(&config, &mut rng);
        let palette = Palette::new(&mut Rng::new(seed, 2));
        let land = Land::new(biome, &mut Rng::new(seed, 3));
        let preset = Preset::of(config.difficulty);
        let count = config.distractors.unwrap_or(preset.distractors).min(64);
        let twins = config.twins.unwrap_or(preset.twins);
        let actors = actors::cast(
            &land,
            kind,
            preset.pace,
            count,
            twins,
            &mut Rng::new(seed, 4),
        );

        // How far away: so that the target has a good size in the view.
        let size = (config.width as f32, config.height as f32);
        let focal = 1.07 * size.0.max(size.1);
        let small = kind.on_foot_or_bicycle();
        let reach = {
            let mesh = actors[0].mesh(0.0);
            let (radius, height) = mesh.bounds();
            (2.0 * radius).max(height)
        };
        let wished = if small {
            rng.range(30.0, 52.0)
        } else {
            rng.range(46.0, 88.0)
        };
        let scale = (size.0 / 640.0).min(size.1 / 360.0);
        let wished = (wished * scale)
            .max(22.0)
            .min(110.0f32.max(wished))
            .min(0.42 * size.0.min(size.1));
        let distance = (reach * focal / wished.max(0.5)).min(600.0);
        let plan = Plan::new(size, distance, focal, preset.manner, &mut Rng::new(seed, 5));
        let haze = rng.range(preset.haze.0, preset.haze.1);
        let aim = if small { 0.9 } else { 0.7 };
        let empty = Extent {
            x: (0.0, 8.0),
            y: (0.0, 8.0),
        };
        let mut flight = Flight {
            config,
            land,
            palette,
            preset,
            actors,
            plan,
            layout: Layout::default(),
            sizes: Vec::new(),
            map: Map::new(empty, 1.0),
            crowns: Vec::new(),
            haze,
            aim,
            occlusions: Vec::new(),
            salt: crate::rng::hash(seed as i32, (seed >> 32) as i32, 11),
        };
        flight.build(seed);
        flight
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.config.frames
    }

    /// Always false: a flight has at least one frame.
    pub fn is_empty(&self) -> bool {
        self.config.frames == 0
    }

    /// The country that the flight is over.
    pub fn biome(&self) -> Biome {
        self.land.biome
    }

    /// The kind of the target.
    pub fn target(&self) -> TargetKind {
        self.actors[0].kind
    }

    pub(crate) fn seconds(&self, index: usize) -> f32 {
        index.min(self.config.frames - 1) as f32 / RATE
    }

    /// The camera at a time.
    pub(crate) fn camera(&self, seconds: f32) -> Camera {
        let target = self.actors[0].route.at(&self.land, seconds);
        self.plan.pose(seconds, target + v3(0.0, 0.0, self.aim))
    }

    /// Plans the events, then furnishes the country and clears the view.
    fn build(&mut self, seed: u64) {
        let mut rng = Rng::new(seed, 6);
        let last = self.seconds(usize::MAX);
        let mut occlusions = Vec::new();
        let mut at = rng.range(3.2, 4.0);
        let mut turn = 0;
        while at < last - 0.5 && occlusions.len() + self.plan.exits.len() < 24 {
            if self.preset.exits && turn % 2 == 1 {
                self.plan.exits.push(Exit {
                    from: at + 0.6,
                    until: at + 1.3,
                    side: rng.sign(),
                });
                at += rng.range(4.0, 5.5);
            } else if self.preset.occlusions {
                occlusions.push(at);
                at += if self.preset.exits {
                    rng.range(2.2, 2.8)
                } else {
                    rng.range(7.0, 9.0)
                };
            } else {
                break;
            }
            turn += 1;
        }
        let (extent, _) = self.extent();
        let layout_rng = Rng::new(seed, 7);
        let salt = self.salt;
        let mut builder = Builder {
            land: &self.land,
            extent,
            rng: layout_rng,
            salt,
            layout: Layout::default(),
        };
        let first_x = self.actors[0].route.x_at(0.0);
        for &seconds in &occlusions {
            // The country repeats: an occluder too near to where the flight began would be met at
            // the start.
            let x = self.actors[0].route.x_at(seconds);
            if (x - first_x).abs() < PERIOD - 100.0 && self.occlude(&mut builder, seconds, &mut rng)
            {
                self.occlusions.push(seconds);
            }
        }
        builder.furnish();
        let mut layout = builder.layout;
        self.clear_sight(&mut layout, &mut rng);
        self.actors.append(&mut layout.parked);
        self.clear_start();
        self.sizes = layout.meshes.iter().map(|m| m.bounds()).collect();
        self.layout = layout;
        self.crowns = trees::crowns(&mut Rng::new(seed, 8), &self.palette, CROWNS);
    }

    /// The ground that the flight will see, and the size of a pixel on it where it is nearest.
    fn extent(&self) -> (Extent, f32) {
        let (width, height) = self.plan.size;
        let mut extent = Extent {
            x: (f32::MAX, f32::MIN),
            y: (f32::MAX, f32::MIN),
        };
        let mut nearest = f32::MAX;
        let step = (self.config.frames / 400).max(3);
        for index in (0..self.config.frames)
            .step_by(step)
            .chain([self.config.frames - 1])
        {
            let camera = self.camera(self.seconds(index));
            for (x, y) in [(0.0, 0.0), (width, 0.0), (0.0, height), (width, height)] {
                let p = camera.ground(x, y);
                extent.x = (extent.x.0.min(p.x - 3.0), extent.x.1.max(p.x + 3.0));
                extent.y = (extent.y.0.min(p.y - 3.0), extent.y.1.max(p.y + 3.0));
            }
            let middle = camera.ground(0.5 * width, 0.75 * height);
            nearest = nearest.min((middle - camera.position).dot(camera.forward) / camera.focal);
        }
        // A country much deeper than a period is only seen as haze.
        let middle = 0.5 * (extent.y.0 + extent.y.1);
        extent.y = (
            extent.y.0.max(middle - PERIOD),
            extent.y.1.min(middle + PERIOD),
        );
        (extent, nearest.clamp(0.02, 2.0))
    }

    /// Plans an occluder between the camera and the target at a time: a tree where there is room,
    /// or a bridge.
    fn occlude(&self, builder: &mut Builder, seconds: f32, rng: &mut Rng) -> bool {
        let camera = self.camera(seconds);
        let mesh = self.actors[0].mesh(seconds);
        let (radius, tall) = mesh.bounds();
        let target = self.actors[0].route.at(&self.land, seconds) + v3(0.0, 0.0, 0.5 * tall);
        let on_sight = |z: f32| {
            target + (camera.position - target) * ((z - target.z) / (camera.position.z - target.z))
        };
        // Whatever hides it then must not do so at the start.
        let first = self.camera(0.0).position;
        let start = self.actors[0].route.at(&self.land, 0.0) + v3(0.0, 0.0, 0.5 * tall);
        let clear = |z: f32, reach: f32| {
            let apart =
                on_sight(z) - (start + (first - start) * ((z - start.z) / (first.z - start.z)));
            apart.x.abs() > radius + reach + 1.0
        };
        let crown = (1.5 * radius + 0.5).max(2.2);
        if crown < 4.6
            && clear(1.3 * crown, crown)
            && rng.chance(0.5)
            && camera.position.z > 3.5 * crown
            && builder.screen(on_sight(1.3 * crown), crown)
        {
            return true;
        }
        let small = self.actors[0].kind.on_foot_or_bicycle();
        let z = (tall + if small { 1.8 } else { 3.0 })
            .max(4.2)
            .min(0.4 * camera.position.z)
            .max(tall + 1.2);
        let look = (target - camera.position).unit();
        let slide = 0.5 * tall / -look.z.min(-0.2);
        let half = radius
            + if small {
                slide + 0.7
            } else {
                slide * look.x.abs() + 1.4
            };
        if camera.position.z < z + 2.0 || !clear(z, half) {
            return false;
        }
        let strolling = matches!(self.land.biome, Biome::Park | Biome::Coast)
            || self.target() == TargetKind::Person;
        if small && strolling {
            builder.canopy(on_sight(z.min(tall + 1.2)), half);
        } else {
            builder.bridge(on_sight(z), half);
        }
        true
    }

    /// Removes what would hide the target at the start, and some of what would hide it later.
    fn clear_sight(&self, layout: &mut Layout, rng: &mut Rng) {
        let step = 3;
        let frames = self.config.frames.min(9000);
        let sights: Vec<_> = (0..frames)
            .step_by(step)
            .map(|index| {
                let seconds = self.seconds(index);
                let camera = self.camera(seconds);
                let target = self.actors[0].route.at(&self.land, seconds) + v3(0.0, 0.0, self.aim);
                let at = camera.project(target);
                (index, camera, at, self.actors[0].mesh(seconds).bounds().0)
            })
            .collect();
        let meshes = &layout.meshes;
        layout.standing.retain(|s| {
            let (radius, height) = match &s.thing {
                Thing::Mesh(i) => meshes[*i].bounds(),
                Thing::Tree(tree) => (tree.radius, tree.height + tree.radius),
            };
            let keep = !s.planned && rng.chance(self.preset.clutter);
            sights.iter().all(|&(index, ref camera, at, reach)| {
                let start = index < 24;
                if s.planned || (keep && !start) {
                    return true;
                }
                let middle = v3(
                    nearest_copy(s.at.x, camera.position.x),
                    s.at.y,
                    0.5 * height,
                );
                let p = camera.project(middle);
                let size = camera.focal / p.2 * (radius.max(0.5 * height) + reach);
                let (dx, dy) = (p.0 - at.0, p.1 - at.1);
                p.2 > at.2 + radius + 1.0 || dx * dx + dy * dy > size * size
            })
        });
    }

    /// Removes the actors that touch the target in the first frames.
    fn clear_start(&mut self) {
        let sights: Vec<_> = [0usize, 6, 12, 18]
            .iter()
            .map(|&i| {
                (
                    self.seconds(i),
                    self.camera(self.seconds(i)),
                    self.box_of(0, self.seconds(i)),
                )
            })
            .collect();
        let touches = |actor: usize| {
            sights.iter().any(|(seconds, camera, b)| {
                let o = self.box_in(actor, *seconds, camera);
                o.x < b.x + b.w + 2.0
                    && b.x < o.x + o.w + 2.0
                    && o.y < b.y + b.h + 2.0
                    && b.y < o.y + o.h + 2.0
            })
        };
        let keep: Vec<bool> = (0..self.actors.len())
            .map(|i| i == 0 || !touches(i))
            .collect();
        let mut keep = keep.iter();
        self.actors.retain(|_| *keep.next().unwrap_or(&true));
    }

    fn cast_shadows(&self, map: &mut Map) {
        let sun = self.palette.sun;
        for s in &self.layout.standing {
            // A shadow may fall into the map from just outside of it, or from its other end.
            for at in [
                s.at,
                s.at - v3(PERIOD, 0.0, 0.0),
                s.at + v3(PERIOD, 0.0, 0.0),
            ] {
                match &s.thing {
                    Thing::Mesh(i) => {
                        for face in &self.layout.meshes[*i].faces {
                            let normal = face.normal.turned(s.heading.0, s.heading.1);
                            if normal.dot(sun) > 0.0 {
                                map.cast(
                                    face.corners
                                        .map(|c| c.turned(s.heading.0, s.heading.1) + at),
                                    sun,
                                );
                            }
                        }
                    }
                    Thing::Tree(tree) => {
                        for (z, radius) in tree.crowns() {
                            let tufts = &self.crowns[tree.crown].tufts;
                            for tuft in tufts.iter().step_by(6) {
                                let middle = at + v3(0.0, 0.0, z) + tuft.at * radius;
                                map.cast_ball(middle, tuft.radius * radius * 2.1, sun);
                            }
                        }
                    }
                }
            }
        }
    }
}

/// The biome and the kind of target of a flight, from its configuration or its seed.
fn choose(config: &FlightConfig, rng: &mut Rng) -> (Biome, TargetKind) {
    let fits = |biome: Biome, kind: TargetKind| kind != TargetKind::Boat || biome == Biome::Coast;
    let drawn = rng.pick(&Biome::ALL);
    let biome = match (config.biome, config.target) {
        (Some(biome), _) => biome,
        (None, Some(kind)) => {
            let at_home: Vec<Biome> = Biome::ALL
                .into_iter()
                .filter(|&b| TargetKind::of(b).contains(&kind))
                .collect();
            rng.pick(&at_home)
        }
        (None, None) => drawn,
    };
    let drawn = rng.pick(TargetKind::of(biome));
    let kind = config
        .target
        .filter(|&kind| fits(biome, kind))
        .unwrap_or(drawn);
    (biome, kind)
}
