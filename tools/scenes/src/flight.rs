//! A flight: everything decided at the start, then any frame of it on request.

use crate::actors::{self, Actor, TargetKind};
use crate::camera::{Camera, Exit, Manner, Plan};
use crate::ground::Painter;
use crate::land::{Land, PERIOD, nearest_copy};
use crate::layout::{Builder, CROWNS, Layout, Thing};
use crate::map::{Extent, Map};
use crate::math::{V3, sin_turns, v3};
use crate::palette::{Biome, Palette};
use crate::raster::{Frame, Stand};
use crate::rng::Rng;
use crate::trees::{self, Crown};
use crate::{Difficulty, FlightConfig, Truth, TruthBox};

/// Frames a second.
pub(crate) const RATE: f32 = 30.0;

/// How a difficulty shapes a flight.
struct Preset {
    pace: f32,
    manner: Manner,
    distractors: usize,
    alike: f32,
    occlusions: bool,
    exits: bool,
    /// Standard deviation of the sensor's noise, of 255.
    noise: f32,
    /// Share of the time between frames that the shutter is open.
    shutter: f32,
    haze: (f32, f32),
    /// Chance that something that happens to hide the target is left standing.
    clutter: f32,
}

impl Preset {
    fn of(difficulty: Difficulty) -> Preset {
        match difficulty {
            Difficulty::Easy => Preset {
                pace: 0.7,
                manner: Manner { wander: 0.22, shake: 0.4, climb: 0.10, yaw: 0.02 },
                distractors: 3,
                alike: 0.0,
                occlusions: false,
                exits: false,
                noise: 1.0,
                shutter: 0.0,
                haze: (0.0, 0.06),
                clutter: 0.0,
            },
            Difficulty::Medium => Preset {
                pace: 1.0,
                manner: Manner { wander: 0.42, shake: 1.4, climb: 0.18, yaw: 0.06 },
                distractors: 6,
                alike: 0.25,
                occlusions: true,
                exits: false,
                noise: 2.2,
                shutter: 0.35,
                haze: (0.02, 0.14),
                clutter: 0.3,
            },
            Difficulty::Hard => Preset {
                pace: 1.4,
                manner: Manner { wander: 0.6, shake: 3.2, climb: 0.27, yaw: 0.11 },
                distractors: 12,
                alike: 0.55,
                occlusions: true,
                exits: true,
                noise: 4.5,
                shutter: 0.6,
                haze: (0.05, 0.28),
                clutter: 0.6,
            },
        }
    }
}

/// What of a frame is drawn: everything, but for tests that look at one part of it.
#[derive(Clone, Copy)]
pub(crate) struct Show {
    pub target: bool,
    /// The target's shadow and trail.
    pub shade: bool,
    /// Blur and noise.
    pub lens: bool,
}

/// A seeded flight over a procedural country, ready to render any of its frames.
pub struct Flight {
    pub(crate) config: FlightConfig,
    pub(crate) land: Land,
    palette: Palette,
    preset: Preset,
    /// The target first.
    pub(crate) actors: Vec<Actor>,
    pub(crate) plan: Plan,
    layout: Layout,
    /// Radius and height of each of the layout's meshes.
    sizes: Vec<(f32, f32)>,
    map: Map,
    crowns: Vec<Crown>,
    haze: f32,
    /// Height of the point the camera follows.
    pub(crate) aim: f32,
    /// Seconds at which an occluder was planned.
    pub(crate) occlusions: Vec<f32>,
    /// Sets the ground's chance apart from other flights'.
    salt: u32,
}

impl Flight {
    /// Plans the flight and paints its country.
    ///
    /// Width and height are taken as at least 1 and at most 8192, frames as at least 1. This is the slow part: some
    /// tenths of a second for the default size. It takes memory for at most a few million texels of ground.
    pub fn new(config: FlightConfig) -> Flight {
        let mut flight = Flight::unpainted(config);
        let (extent, texel) = flight.extent();
        let mut map = Map::new(extent, texel);
        flight.cast_shadows(&mut map);
        map.paint(&Painter::new(&flight.land, &flight.palette, map.texel, flight.salt));
        flight.map = map;
        flight
    }

    /// All of a flight but its ground, which stays black: enough to know where everything is.
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
        let actors = actors::cast(&land, kind, preset.pace, count, preset.alike, &mut Rng::new(seed, 4));

        // How far away: so that the target has a good size in the view.
        let size = (config.width as f32, config.height as f32);
        let focal = 1.07 * size.0.max(size.1);
        let small = kind.on_foot_or_bicycle();
        let reach = {
            let mesh = actors[0].mesh(0.0);
            let (radius, height) = mesh.bounds();
            (2.0 * radius).max(height)
        };
        let wished = if small { rng.range(30.0, 52.0) } else { rng.range(46.0, 88.0) };
        let scale = (size.0 / 640.0).min(size.1 / 360.0);
        let wished = (wished * scale).max(22.0).min(110.0f32.max(wished)).min(0.42 * size.0.min(size.1));
        let distance = (reach * focal / wished.max(0.5)).min(600.0);
        let plan = Plan::new(size, distance, focal, preset.manner, &mut Rng::new(seed, 5));
        let haze = rng.range(preset.haze.0, preset.haze.1);
        let aim = if small { 0.9 } else { 0.7 };
        let empty = Extent { x: (0.0, 8.0), y: (0.0, 8.0) };
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

    /// Whether there is no frame; never so.
    pub fn is_empty(&self) -> bool {
        self.config.frames == 0
    }

    /// What the flight is over.
    pub fn biome(&self) -> Biome {
        self.land.biome
    }

    /// What the target is.
    pub fn target(&self) -> TargetKind {
        self.actors[0].kind
    }

    pub(crate) fn seconds(&self, index: usize) -> f32 {
        index.min(self.config.frames - 1) as f32 / RATE
    }

    /// Where the camera is at a time.
    pub(crate) fn camera(&self, seconds: f32) -> Camera {
        let target = self.actors[0].route.at(&self.land, seconds);
        self.plan.pose(seconds, target + v3(0.0, 0.0, self.aim))
    }

    /// Plans the events, then furnishes the country and clears the view.
    fn build(&mut self, seed: u64) {
        let mut rng = Rng::new(seed, 6);
        let last = self.seconds(usize::MAX);
        let mut occlusions = Vec::new();
        let (mut at, mut turn) = (rng.range(3.2, 4.0), 0);
        while at < last - 0.5 && occlusions.len() + self.plan.exits.len() < 24 {
            if self.preset.exits && turn % 2 == 1 {
                self.plan.exits.push(Exit { from: at + 0.6, until: at + 1.3, side: rng.sign() });
                at += rng.range(4.0, 5.5);
            } else if self.preset.occlusions {
                occlusions.push(at);
                at += if self.preset.exits { rng.range(2.2, 2.8) } else { rng.range(7.0, 9.0) };
            } else {
                break;
            }
            turn += 1;
        }
        let (extent, _) = self.extent();
        let layout_rng = Rng::new(seed, 7);
        let salt = self.salt;
        let mut builder =
            Builder { land: &self.land, extent, rng: layout_rng, salt, layout: Layout::default() };
        let first_x = self.actors[0].route.x_at(0.0);
        for &seconds in &occlusions {
            // The country repeats: an occluder too near to where the flight began would be met at the start.
            let x = self.actors[0].route.x_at(seconds);
            if (x - first_x).abs() < PERIOD - 100.0 && self.occlude(&mut builder, seconds, &mut rng) {
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
        let mut extent = Extent { x: (f32::MAX, f32::MIN), y: (f32::MAX, f32::MIN) };
        let mut nearest = f32::MAX;
        let step = (self.config.frames / 400).max(3);
        for index in (0..self.config.frames).step_by(step).chain([self.config.frames - 1]) {
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
        extent.y = (extent.y.0.max(middle - PERIOD), extent.y.1.min(middle + PERIOD));
        (extent, nearest.clamp(0.02, 2.0))
    }

    /// Plans something between the camera and the target at a time: a tree where there is room for one, or a bridge.
    fn occlude(&self, builder: &mut Builder, seconds: f32, rng: &mut Rng) -> bool {
        let camera = self.camera(seconds);
        let mesh = self.actors[0].mesh(seconds);
        let (radius, tall) = mesh.bounds();
        let target = self.actors[0].route.at(&self.land, seconds) + v3(0.0, 0.0, 0.5 * tall);
        let on_sight =
            |z: f32| target + (camera.position - target) * ((z - target.z) / (camera.position.z - target.z));
        // Whatever hides it then must not do so at the start.
        let first = self.camera(0.0).position;
        let start = self.actors[0].route.at(&self.land, 0.0) + v3(0.0, 0.0, 0.5 * tall);
        let clear = |z: f32, reach: f32| {
            let apart = on_sight(z) - (start + (first - start) * ((z - start.z) / (first.z - start.z)));
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
        let z = (tall + if small { 1.8 } else { 3.0 }).max(4.2).min(0.4 * camera.position.z).max(tall + 1.2);
        let look = (target - camera.position).unit();
        let slide = 0.5 * tall / -look.z.min(-0.2);
        let half = radius + if small { slide + 0.7 } else { slide * look.x.abs() + 1.4 };
        if camera.position.z < z + 2.0 || !clear(z, half) {
            return false;
        }
        let strolling =
            matches!(self.land.biome, Biome::Park | Biome::Coast) || self.target() == TargetKind::Person;
        if small && strolling {
            builder.canopy(on_sight(z.min(tall + 1.2)), half);
        } else {
            builder.bridge(on_sight(z), half);
        }
        true
    }

    /// Takes away what would hide the target at the start, and some of what would hide it later.
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
                let middle = v3(nearest_copy(s.at.x, camera.position.x), s.at.y, 0.5 * height);
                let p = camera.project(middle);
                let size = camera.focal / p.2 * (radius.max(0.5 * height) + reach);
                let (dx, dy) = (p.0 - at.0, p.1 - at.1);
                p.2 > at.2 + radius + 1.0 || dx * dx + dy * dy > size * size
            })
        });
    }

    /// Takes away the actors that touch the target in the first frames.
    fn clear_start(&mut self) {
        let sights: Vec<_> = [0usize, 6, 12, 18]
            .iter()
            .map(|&i| (self.seconds(i), self.camera(self.seconds(i)), self.box_of(0, self.seconds(i))))
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
        let keep: Vec<bool> = (0..self.actors.len()).map(|i| i == 0 || !touches(i)).collect();
        let mut keep = keep.iter();
        self.actors.retain(|_| *keep.next().unwrap_or(&true));
    }

    fn cast_shadows(&self, map: &mut Map) {
        let sun = self.palette.sun;
        for s in &self.layout.standing {
            // A shadow may fall into the map from just outside of it, or from its other end.
            for at in [s.at, s.at - v3(PERIOD, 0.0, 0.0), s.at + v3(PERIOD, 0.0, 0.0)] {
                match &s.thing {
                    Thing::Mesh(i) => {
                        for face in &self.layout.meshes[*i].faces {
                            let normal = face.normal.turned(s.heading.0, s.heading.1);
                            if normal.dot(sun) > 0.0 {
                                map.cast(face.corners.map(|c| c.turned(s.heading.0, s.heading.1) + at), sun);
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

    fn stand(&self, actor: usize, seconds: f32, camera: &Camera) -> Stand {
        let route = &self.actors[actor].route;
        let mut at = route.at(&self.land, seconds);
        if actor > 0 {
            at.x = nearest_copy(at.x, self.actors[0].route.x_at(seconds));
        }
        if self.actors[actor].kind == TargetKind::Boat {
            at.z = 0.06 * sin_turns(0.35 * seconds + at.y * 0.1) - 0.05;
        }
        Stand {
            at,
            heading: route.heading(&self.land, seconds),
            shade: 0.0,
            haze: self.haze_at((at - camera.position).length()),
        }
    }

    fn haze_at(&self, depth: f32) -> f32 {
        // Thicker with distance, `haze` at the target.
        let k = depth / self.plan.distance;
        (self.haze * (0.35 + 0.65 * k * k)).min(0.85)
    }

    fn box_in(&self, actor: usize, seconds: f32, camera: &Camera) -> TruthBox {
        let mesh = self.actors[actor].mesh(seconds);
        let b = Frame::bounds(&mesh, &self.stand(actor, seconds, camera), camera);
        TruthBox { x: b.0, y: b.1, w: b.2 - b.0, h: b.3 - b.1 }
    }

    fn box_of(&self, actor: usize, seconds: f32) -> TruthBox {
        self.box_in(actor, seconds, &self.camera(seconds))
    }

    /// Draws a frame without blur and noise; returns what the target's mask says of its visibility.
    pub(crate) fn draw(&self, seconds: f32, show: Show) -> (Frame, Truth) {
        let camera = self.camera(seconds);
        let (width, height) = (self.config.width, self.config.height);
        let mut frame = Frame::new(width, height);
        self.map.draw(&camera, &self.palette, |d| self.haze_at(d), seconds, width, &mut frame.pixels);
        let sees = |at: V3, radius: f32, tall: f32| {
            let p = camera.project(at + v3(0.0, 0.0, 0.5 * tall));
            let reach = camera.focal / p.2 * (radius + 0.5 * tall) + 2.0;
            let ahead = (at - camera.position).dot(camera.forward) > 1.0;
            let inside =
                p.0 > -reach && p.1 > -reach && p.0 < width as f32 + reach && p.1 < height as f32 + reach;
            (ahead && inside).then_some(p.2)
        };

        // Moving things: wakes and shadows first, on the ground.
        let mut order: Vec<(f32, Drawn)> = Vec::new();
        let mut truth =
            Truth { bbox: self.box_in(0, seconds, &camera), visible: 0.0, distractors: Vec::new() };
        for i in 0..self.actors.len() {
            let mut stand = self.stand(i, seconds, &camera);
            let reach = if self.actors[i].kind == TargetKind::Boat { 18.0 } else { 14.0 };
            let depth = sees(stand.at, reach, 2.0);
            if depth.is_none() && i > 0 {
                continue;
            }
            stand.shade = self.map.shade_at(stand.at);
            let mesh = self.actors[i].mesh(seconds);
            if i > 0 && self.actors[i].kind.alike(self.actors[0].kind) {
                let b = Frame::bounds(&mesh, &stand, &camera);
                if b.2 > 0.0 && b.3 > 0.0 && b.0 < width as f32 && b.1 < height as f32 {
                    truth.distractors.push(TruthBox { x: b.0, y: b.1, w: b.2 - b.0, h: b.3 - b.1 });
                }
            }
            if i == 0 && !show.target {
                continue;
            }
            if i > 0 || show.shade {
                self.trail(&mut frame, i, seconds, &camera);
                frame.shadow(&mesh, &stand, &camera, &self.palette);
            }
            order.push((depth.unwrap_or(0.0), Drawn::Actor(i, mesh, stand)));
        }
        for (i, s) in self.layout.standing.iter().enumerate() {
            let at = v3(
                nearest_copy(s.at.x, camera.position.x + camera.forward.x * self.plan.distance),
                s.at.y,
                0.0,
            );
            let (radius, tall) = match &s.thing {
                Thing::Mesh(m) => self.sizes[*m],
                Thing::Tree(tree) => (tree.radius, tree.height + tree.radius * tree.tiers as f32),
            };
            if let Some(depth) = sees(at, radius, tall) {
                order.push((depth, Drawn::Standing(i, at)));
            }
        }
        order.sort_by(|a, b| b.0.total_cmp(&a.0));

        // Crowns from this side, each drawn once, as large as it is needed.
        let mut largest = vec![0.0f32; self.crowns.len()];
        for (depth, drawn) in &order {
            if let Drawn::Standing(i, _) = drawn
                && let Thing::Tree(tree) = &self.layout.standing[*i].thing
            {
                largest[tree.crown] = largest[tree.crown].max(camera.focal / depth * tree.radius);
            }
        }
        let drawn = |(crown, &size): (&Crown, &f32)| (size > 0.0).then(|| frame.sprite(crown, &camera, size));
        let sprites: Vec<_> = self.crowns.iter().zip(&largest).map(drawn).collect();
        for (_, drawn) in order {
            match drawn {
                Drawn::Actor(i, mesh, stand) => frame.mesh(&mesh, &stand, &camera, &self.palette, i == 0),
                Drawn::Standing(i, at) => {
                    let s = &self.layout.standing[i];
                    let haze = self.haze_at((at - camera.position).length());
                    match &s.thing {
                        Thing::Mesh(m) => {
                            let stand = Stand { at, heading: s.heading, shade: 0.0, haze };
                            frame.mesh(&self.layout.meshes[*m], &stand, &camera, &self.palette, false);
                        }
                        Thing::Tree(tree) => {
                            for (z, radius) in tree.crowns() {
                                let p = camera.project(at + v3(0.0, 0.0, z));
                                if let Some(sprite) = &sprites[tree.crown] {
                                    let size = camera.focal / p.2 * radius;
                                    frame.stamp(sprite, (p.0, p.1), size, (self.palette.haze, haze));
                                }
                            }
                        }
                    }
                }
            }
        }
        if let Some(mask) = &frame.mask {
            truth.visible = mask.visible(width, height);
        }
        (frame, truth)
    }

    /// Foam behind a moving boat, dust behind a vehicle on a dirt road.
    fn trail(&self, frame: &mut Frame, actor: usize, seconds: f32, camera: &Camera) {
        let a = &self.actors[actor];
        let speed = a.route.speed.abs();
        let dusty = self.land.along[0].paving == crate::land::Paving::Dirt && !a.kind.on_foot_or_bicycle();
        let boat = a.kind == TargetKind::Boat;
        if speed < 1.0 || !(boat || dusty) {
            return;
        }
        let (length, count) = if boat { (3.4, 90) } else { (1.1, 26) };
        let slant = (-camera.forward.z).clamp(0.3, 1.0);
        let centre_x = self.actors[0].route.x_at(seconds);
        let color = if boat { [236.0, 241.0, 242.0] } else { mixed_dust(&self.palette) };
        let back = match &a.body {
            actors::Body::Solid(mesh) => mesh.bounds().0 * 0.85 / speed,
            actors::Body::Person(_) => 0.0,
        };
        for i in 0..count {
            let age = length * (i as f32 + 0.5) / count as f32;
            let then = seconds - age - if boat { back * 0.2 } else { back };
            let mut p = a.route.at(&self.land, then);
            p.x = nearest_copy(p.x, centre_x);
            let (cos, sin) = a.route.heading(&self.land, then);
            // Each bit of foam keeps its place on the water while it ages.
            let id = (then * count as f32 / length).floor() as i32;
            let chance = |k| crate::rng::hash_unit(id, k, actor as u32);
            let fade = 1.0 - age / length;
            let (side, radius, strength) = if boat && i % 3 != 0 {
                // The arms of the bow wave.
                let arm = if i % 3 == 1 { 1.0 } else { -1.0 };
                (arm * (0.7 + 0.30 * age * speed.min(6.0)), 0.30 + 0.25 * chance(1) + 0.2 * age, 0.42 * fade)
            } else if boat {
                ((chance(2) - 0.5) * (1.0 + age), 0.5 + 0.5 * chance(1) + 0.25 * age, 0.6 * fade * fade)
            } else {
                ((chance(2) - 0.5) * (1.2 + 2.0 * age), 0.9 + 1.8 * age, 0.16 * fade)
            };
            let p = p + v3(-sin * side, cos * side, if boat { 0.0 } else { 0.3 + age });
            let (x, y, depth) = camera.project(p);
            let r = radius * camera.focal / depth;
            frame.spot(
                (x, y),
                (r, r * if boat { slant } else { 0.9 }),
                color,
                strength * (0.7 + 0.3 * chance(3)),
            );
        }
    }

    /// Renders the frame `index` (a later one than the last is the last) and returns what is true of it.
    ///
    /// Equal flights give equal bytes for equal indices, in whatever order they are asked for: only integer and IEEE
    /// basic operations take part. `out` is resized to the flight's view if it has another size.
    pub fn render(&self, index: usize, out: &mut crate::FrameBuffer) -> Truth {
        self.render_with(index, out, Show { target: true, shade: true, lens: true })
    }

    pub(crate) fn render_with(&self, index: usize, out: &mut crate::FrameBuffer, show: Show) -> Truth {
        let seconds = self.seconds(index);
        let (frame, truth) = self.draw(seconds, show);
        out.width = self.config.width;
        out.height = self.config.height;
        out.data.resize(3 * out.width * out.height, 0);
        let noise =
            if show.lens { self.config.noise.unwrap_or(self.preset.noise).clamp(0.0, 60.0) } else { 0.0 };
        let smear = if show.lens { self.smear(seconds) } else { (0.0, 0.0) };
        crate::lens::develop(
            &frame.pixels,
            frame.width,
            smear,
            noise,
            self.config.seed,
            index as u64,
            &mut out.data,
        );
        truth
    }

    /// How far the view turns while the shutter is open, in pixels.
    fn smear(&self, seconds: f32) -> (f32, f32) {
        let open = self.preset.shutter / RATE;
        let shift = |seconds: f32| {
            let camera = self.camera(seconds);
            let target = self.actors[0].route.at(&self.land, seconds) + v3(0.0, 0.0, self.aim);
            let p = camera.project(target);
            (p.0, p.1)
        };
        let (a, b) = (shift(seconds - 0.5 * open), shift(seconds + 0.5 * open));
        (b.0 - a.0, b.1 - a.1)
    }
}

enum Drawn<'a> {
    Actor(usize, std::borrow::Cow<'a, crate::mesh::Mesh>, Stand),
    Standing(usize, V3),
}

fn mixed_dust(palette: &Palette) -> crate::math::Rgb {
    crate::math::mix(palette.soil, palette.haze, 0.55)
}

/// The biome and the kind of target of a flight: as asked, or by the seed.
fn choose(config: &FlightConfig, rng: &mut Rng) -> (Biome, TargetKind) {
    let fits = |biome: Biome, kind: TargetKind| kind != TargetKind::Boat || biome == Biome::Coast;
    let drawn = rng.pick(&Biome::ALL);
    let biome = match (config.biome, config.target) {
        (Some(biome), _) => biome,
        (None, Some(kind)) => {
            let at_home: Vec<Biome> =
                Biome::ALL.into_iter().filter(|&b| TargetKind::of(b).contains(&kind)).collect();
            rng.pick(&at_home)
        }
        (None, None) => drawn,
    };
    let drawn = rng.pick(TargetKind::of(biome));
    let kind = config.target.filter(|&kind| fits(biome, kind)).unwrap_or(drawn);
    (biome, kind)
}
