//! Draws a frame of a flight: ground, trails and shadows, then everything that stands or moves,
//! from far to near.

use std::borrow::Cow;

use crate::actors::{self, TargetKind};
use crate::camera::Camera;
use crate::flight::{Flight, RATE};
use crate::land::{Paving, nearest_copy};
use crate::layout::Thing;
use crate::math::{V3, mix, sin_turns, v3};
use crate::mesh::Mesh;
use crate::raster::{Frame, Stand};
use crate::trees::Crown;
use crate::{FrameBuffer, Truth, TruthBox};

/// The parts of a frame that are drawn. Tests switch parts off.
#[derive(Clone, Copy)]
pub(crate) struct Show {
    pub target: bool,
    /// The target's shadow and trail.
    pub shade: bool,
    /// Blur and noise.
    pub lens: bool,
}

enum Drawn<'a> {
    Actor(usize, Cow<'a, Mesh>, Stand),
    Standing(usize, V3),
}

impl Flight {
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

    pub(crate) fn box_in(&self, actor: usize, seconds: f32, camera: &Camera) -> TruthBox {
        let mesh = self.actors[actor].mesh(seconds);
        let stand = self.stand(actor, seconds, camera);
        Frame::bounds(&mesh, &stand, camera).to_box()
    }

    pub(crate) fn box_of(&self, actor: usize, seconds: f32) -> TruthBox {
        self.box_in(actor, seconds, &self.camera(seconds))
    }

    /// Draws a frame without blur and noise, and returns it with its truth.
    pub(crate) fn draw(&self, seconds: f32, show: Show) -> (Frame, Truth) {
        let camera = self.camera(seconds);
        let (width, height) = (self.config.width, self.config.height);
        let mut frame = Frame::new(width, height);
        self.map.draw(
            &camera,
            &self.palette,
            |d| self.haze_at(d),
            seconds,
            width,
            &mut frame.pixels,
        );
        let sees = |at: V3, radius: f32, tall: f32| {
            let p = camera.project(at + v3(0.0, 0.0, 0.5 * tall));
            let reach = camera.focal / p.2 * (radius + 0.5 * tall) + 2.0;
            let ahead = (at - camera.position).dot(camera.forward) > 1.0;
            let inside = p.0 > -reach
                && p.1 > -reach
                && p.0 < width as f32 + reach
                && p.1 < height as f32 + reach;
            (ahead && inside).then_some(p.2)
        };

        // Moving things: wakes and shadows first, on the ground.
        let mut order: Vec<(f32, Drawn)> = Vec::new();
        let mut truth = Truth {
            bbox: self.box_in(0, seconds, &camera),
            visible: 0.0,
            distractors: Vec::new(),
        };
        for i in 0..self.actors.len() {
            let mut stand = self.stand(i, seconds, &camera);
            let reach = if self.actors[i].kind == TargetKind::Boat {
                18.0
            } else {
                14.0
            };
            let depth = sees(stand.at, reach, 2.0);
            if depth.is_none() && i > 0 {
                continue;
            }
            stand.shade = self.map.shade_at(stand.at);
            let mesh = self.actors[i].mesh(seconds);
            if i > 0 && self.actors[i].kind.alike(self.actors[0].kind) {
                let bounds = Frame::bounds(&mesh, &stand, &camera);
                if bounds.meets(width, height) {
                    truth.distractors.push(bounds.to_box());
                }
            }
            if i > 0 || (show.target && show.shade) {
                self.trail(&mut frame, i, seconds, &camera);
                frame.shadow(&mesh, &stand, &camera, &self.palette);
            }
            order.push((depth.unwrap_or(0.0), Drawn::Actor(i, mesh, stand)));
        }
        for (i, s) in self.layout.standing.iter().enumerate() {
            let at = v3(
                nearest_copy(
                    s.at.x,
                    camera.position.x + camera.forward.x * self.plan.distance,
                ),
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
        self.lift_spans(&mut order, &camera);
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
        let drawn = |(crown, &size): (&Crown, &f32)| {
            (size > 0.0).then(|| frame.sprite(crown, &camera, size))
        };
        let sprites: Vec<_> = self.crowns.iter().zip(&largest).map(drawn).collect();
        for (_, drawn) in order {
            match drawn {
                Drawn::Actor(0, ..) if !show.target => {}
                Drawn::Actor(i, mesh, stand) => {
                    frame.mesh(&mesh, &stand, &camera, &self.palette, i == 0)
                }
                Drawn::Standing(i, at) => {
                    let s = &self.layout.standing[i];
                    let haze = self.haze_at((at - camera.position).length());
                    match &s.thing {
                        Thing::Mesh(m) => {
                            let stand = Stand {
                                at,
                                heading: s.heading,
                                shade: 0.0,
                                haze,
                            };
                            frame.mesh(
                                &self.layout.meshes[*m],
                                &stand,
                                &camera,
                                &self.palette,
                                false,
                            );
                        }
                        Thing::Tree(tree) => {
                            for (z, radius) in tree.crowns() {
                                let p = camera.project(at + v3(0.0, 0.0, z));
                                if let Some(sprite) = &sprites[tree.crown] {
                                    let size = camera.focal / p.2 * radius;
                                    frame.stamp(
                                        sprite,
                                        (p.0, p.1),
                                        size,
                                        (self.palette.haze, haze),
                                    );
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

    /// Moves a bridge or canopy in front of everything that may pass below it. Seen from above, it
    /// hides them, whichever center is nearer.
    fn lift_spans(&self, order: &mut [(f32, Drawn)], camera: &Camera) {
        let spot = |at: V3, depth: f32, radius: f32| {
            let p = camera.project(at);
            (p.0, p.1, camera.focal / depth * radius)
        };
        let below: Vec<_> = order
            .iter()
            .filter_map(|(depth, drawn)| match drawn {
                Drawn::Actor(_, mesh, stand) => {
                    Some((*depth, spot(stand.at, *depth, mesh.bounds().0 + 2.0)))
                }
                Drawn::Standing(..) => None,
            })
            .collect();
        for (depth, drawn) in order.iter_mut() {
            let Drawn::Standing(i, at) = drawn else {
                continue;
            };
            let s = &self.layout.standing[*i];
            let Thing::Mesh(m) = s.thing else { continue };
            if !s.over {
                continue;
            }
            let (radius, z) = self.sizes[m];
            let (x, y, reach) = spot(*at + v3(0.0, 0.0, z), *depth, radius);
            let meets = |&&(_, (ox, oy, r)): &&(f32, (f32, f32, f32))| {
                (x - ox) * (x - ox) + (y - oy) * (y - oy) < (reach + r) * (reach + r)
            };
            let nearest = below
                .iter()
                .filter(meets)
                .map(|b| b.0)
                .fold(f32::MAX, f32::min);
            *depth = depth.min(nearest - 0.01);
        }
    }

    /// Foam behind a moving boat, dust behind a vehicle on a dirt road.
    fn trail(&self, frame: &mut Frame, actor: usize, seconds: f32, camera: &Camera) {
        let a = &self.actors[actor];
        let speed = a.route.speed.abs();
        let dusty = self.land.along[0].paving == Paving::Dirt && !a.kind.on_foot_or_bicycle();
        let boat = a.kind == TargetKind::Boat;
        if speed < 1.0 || !(boat || dusty) {
            return;
        }
        let (length, count) = if boat { (3.2, 150) } else { (1.1, 26) };
        let slant = (-camera.forward.z).clamp(0.3, 1.0);
        let center_x = self.actors[0].route.x_at(seconds);
        let color = if boat {
            [236.0, 241.0, 242.0]
        } else {
            mix(self.palette.soil, self.palette.haze, 0.55)
        };
        let back = match &a.body {
            actors::Body::Solid(mesh) => mesh.bounds().0 * 0.85 / speed,
            actors::Body::Person(_) => 0.0,
        };
        for i in 0..count {
            let age = length * (i as f32 + 0.5) / count as f32;
            let then = seconds - age - if boat { back * 0.2 } else { back };
            let mut p = a.route.at(&self.land, then);
            p.x = nearest_copy(p.x, center_x);
            let (cos, sin) = a.route.heading(&self.land, then);
            // Each bit of foam keeps its place on the water while it ages.
            let id = (then * count as f32 / length).floor() as i32;
            let chance = |k| crate::rng::hash_unit(id, k, actor as u32);
            let fade = 1.0 - age / length;
            let (side, radius, strength) = if boat && i % 3 != 0 {
                // The arms of the bow wave.
                let arm = if i % 3 == 1 { 1.0 } else { -1.0 };
                (
                    arm * (0.7 + 0.30 * age * speed.min(6.0)),
                    0.36 + 0.25 * chance(1) + 0.25 * age,
                    0.36 * fade,
                )
            } else if boat {
                (
                    (chance(2) - 0.5) * (1.0 + age),
                    0.45 + 0.5 * chance(1) + 0.25 * age,
                    0.5 * fade * fade,
                )
            } else {
                (
                    (chance(2) - 0.5) * (1.2 + 2.0 * age),
                    0.9 + 1.8 * age,
                    0.16 * fade,
                )
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

    /// Renders the frame `index`, or the last frame beyond the end, and returns its truth.
    ///
    /// Equal flights give equal bytes for equal indices, in any order of rendering, because only
    /// integer and basic IEEE operations are used. `out` is resized to the flight's view.
    pub fn render(&self, index: usize, out: &mut FrameBuffer) -> Truth {
        self.render_with(
            index,
            out,
            Show {
                target: true,
                shade: true,
                lens: true,
            },
        )
    }

    pub(crate) fn render_with(&self, index: usize, out: &mut FrameBuffer, show: Show) -> Truth {
        let seconds = self.seconds(index);
        let (frame, truth) = self.draw(seconds, show);
        out.width = self.config.width;
        out.height = self.config.height;
        out.data.resize(3 * out.width * out.height, 0);
        let noise = if show.lens {
            self.config
                .noise
                .unwrap_or(self.preset.noise)
                .clamp(0.0, 60.0)
        } else {
            0.0
        };
        let smear = if show.lens {
            self.smear(seconds)
        } else {
            (0.0, 0.0)
        };
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

    /// Pixels by which the view turns while the shutter is open.
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
