//! What moves: the target, its look-alikes and the other traffic, each on a closed-form route.

use crate::land::{Land, Paving};
use crate::math::{V3, sin_turns, v3};
use crate::mesh::Mesh;
use crate::palette::Biome;
use crate::people::Look;
use crate::rng::Rng;
use crate::vehicles;

/// Kind of a target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TargetKind {
    /// A passenger car.
    Car,
    /// A delivery van.
    Van,
    /// A lorry.
    Truck,
    /// A bus or coach.
    Bus,
    /// A boat; only over [`Biome::Coast`].
    Boat,
    /// Someone on foot.
    Person,
    /// Someone on a bicycle.
    Cyclist,
}

impl TargetKind {
    /// The kinds that occur in a biome; likelier kinds occur more than once.
    pub(crate) fn of(biome: Biome) -> &'static [TargetKind] {
        use TargetKind::*;
        match biome {
            Biome::Farmland => &[Car, Car, Van, Truck, Cyclist],
            Biome::Town => &[Car, Car, Van, Bus, Person, Cyclist],
            Biome::Coast => &[Boat, Boat, Boat, Person, Car],
            Biome::Forest => &[Car, Car, Truck, Cyclist, Person],
            Biome::Park => &[Person, Person, Cyclist],
            Biome::Highway => &[Car, Car, Truck, Van, Bus],
        }
    }

    /// Usual speed in meters a second.
    pub(crate) fn speed(self) -> f32 {
        match self {
            TargetKind::Car => 10.0,
            TargetKind::Van => 9.5,
            TargetKind::Truck => 8.5,
            TargetKind::Bus => 7.5,
            TargetKind::Boat => 5.5,
            TargetKind::Person => 1.4,
            TargetKind::Cyclist => 4.5,
        }
    }

    pub(crate) fn on_foot_or_bicycle(self) -> bool {
        matches!(self, TargetKind::Person | TargetKind::Cyclist)
    }

    /// Whether two kinds look alike enough to be mistaken for each other.
    pub(crate) fn alike(self, other: TargetKind) -> bool {
        use TargetKind::*;
        self == other
            || matches!(
                (self, other),
                (Car, Van) | (Van, Car) | (Truck, Bus) | (Bus, Truck)
            )
    }
}

/// The body of an actor.
#[derive(Clone)]
pub(crate) enum Body {
    Solid(Mesh),
    Person(Look),
}

impl Body {
    pub fn new(kind: TargetKind, rng: &mut Rng) -> Body {
        let paint = vehicles::paint(rng);
        match kind {
            TargetKind::Car => Body::Solid(vehicles::car(rng, paint)),
            TargetKind::Van => Body::Solid(vehicles::van(rng, paint)),
            TargetKind::Truck => Body::Solid(vehicles::truck(rng, paint)),
            TargetKind::Bus => Body::Solid(vehicles::bus(rng)),
            TargetKind::Boat => {
                let paint = rng.pick(&[
                    [236.0, 236.0, 232.0],
                    [226.0, 222.0, 210.0],
                    [60.0, 100.0, 150.0],
                    [170.0, 50.0, 44.0],
                    [52.0, 110.0, 100.0],
                ]);
                Body::Solid(vehicles::boat(rng, paint))
            }
            TargetKind::Person => Body::Person(Look::new(rng, false)),
            TargetKind::Cyclist => Body::Person(Look::new(rng, true)),
        }
    }
}

/// A way through the country: steady motion in (x, t) with a little surge and sway.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Route {
    pub x: f32,
    pub t: f32,
    /// Meters a second in x; its sign is the direction.
    pub speed: f32,
    /// Amplitude of the surge in x in meters, and its period in seconds.
    pub surge: (f32, f32),
    /// Amplitude of the sway in t in meters, and its period in seconds.
    pub sway: (f32, f32),
    pub phase: f32,
    /// Heading of a standing actor as cosine and sine; along the line if `None`.
    pub facing: Option<(f32, f32)>,
}

impl Route {
    /// Standing still.
    pub fn parked(x: f32, t: f32, facing: Option<(f32, f32)>) -> Route {
        Route {
            x,
            t,
            speed: 0.0,
            surge: (0.0, 1.0),
            sway: (0.0, 1.0),
            phase: 0.0,
            facing,
        }
    }

    pub fn x_at(&self, seconds: f32) -> f32 {
        self.x
            + self.speed * seconds
            + self.surge.0 * sin_turns(seconds / self.surge.1 + self.phase)
    }

    /// Position on the ground.
    pub fn at(&self, land: &Land, seconds: f32) -> V3 {
        let sway = self.sway.0 * sin_turns(seconds / self.sway.1 + 1.7 * self.phase);
        land.point(self.x_at(seconds), self.t + sway)
    }

    /// Cosine and sine of the heading.
    pub fn heading(&self, land: &Land, seconds: f32) -> (f32, f32) {
        if let Some(facing) = self.facing {
            return facing;
        }
        let way = if self.speed == 0.0 {
            land.heading(self.x)
        } else {
            self.at(land, seconds + 0.08) - self.at(land, seconds - 0.08)
        };
        let way = v3(way.x, way.y, 0.0).unit();
        (way.x, way.y)
    }
}

/// The target, a look-alike or another road user, moving or standing.
pub(crate) struct Actor {
    pub kind: TargetKind,
    pub body: Body,
    pub route: Route,
}

impl Actor {
    /// The body at a time: people move their limbs.
    pub fn mesh(&self, seconds: f32) -> std::borrow::Cow<'_, Mesh> {
        match &self.body {
            Body::Solid(mesh) => std::borrow::Cow::Borrowed(mesh),
            Body::Person(look) => {
                // A stride of 1.5 m, a turn of the pedals every 5 m.
                let turn = if look.cyclist { 5.0 } else { 1.5 };
                let stride = (self.route.speed.abs() / 1.2).min(1.15);
                let phase = (self.route.x_at(seconds).abs() / turn).fract();
                std::borrow::Cow::Owned(look.mesh(phase, stride))
            }
        }
    }
}

/// Where the target's kind travels: t for the direction (+1 along x, -1 against), on the right-hand
/// side.
fn lane(land: &Land, kind: TargetKind, way: f32, rng: &mut Rng) -> f32 {
    let road = &land.along[0];
    match (land.biome, kind) {
        (_, TargetKind::Boat) => rng.range(13.0, 24.0),
        (Biome::Coast, TargetKind::Person) => rng.range(-8.0, -4.5),
        (Biome::Park, _) => road.at - way * rng.range(0.3, 1.2),
        (Biome::Town, TargetKind::Person) => road.at + rng.sign() * (road.half + 0.5 * road.walk),
        (_, TargetKind::Person) => road.at - way * (road.half + 0.3),
        (_, TargetKind::Cyclist) => road.at - way * (road.lane + 0.45),
        (Biome::Highway, _) => {
            road.at - way * (road.median + 0.5 + road.lane * rng.pick(&[0.5, 1.5]))
        }
        _ => road.at - way * road.lane,
    }
}

/// The target, then the distractors: `count` look-alikes and as many other road users.
///
/// `pace` multiplies speeds; `twins` is the chance that a look-alike has exactly the target's body.
pub(crate) fn cast(
    land: &Land,
    kind: TargetKind,
    pace: f32,
    count: usize,
    twins: f32,
    rng: &mut Rng,
) -> Vec<Actor> {
    let way = rng.sign();
    let fast = if land.biome == Biome::Highway {
        1.7
    } else {
        1.0
    };
    let pace = if land.along[0].paving == Paving::Dirt {
        0.7 * pace
    } else {
        pace
    };
    let speed = kind.speed() * pace * fast * rng.range(0.85, 1.15);
    let small = kind.on_foot_or_bicycle();
    let sway = match kind {
        TargetKind::Boat => (rng.range(1.0, 2.5), 9.0),
        TargetKind::Person => (0.18, 4.0),
        _ => (0.12, 5.0),
    };
    let period = rng.range(4.0, 7.0);
    let target = Actor {
        kind,
        body: Body::new(kind, rng),
        route: Route {
            x: rng.range(0.0, crate::land::PERIOD),
            t: lane(land, kind, way, rng),
            speed: way * speed,
            surge: (0.2 * speed * period / std::f32::consts::TAU, period),
            sway,
            phase: rng.unit(),
            facing: None,
        },
    };
    let mut actors = vec![target];
    let spread = if small {
        5.0
    } else if kind == TargetKind::Boat {
        22.0
    } else {
        17.0
    };
    let against = kind.speed() * pace * fast * rng.range(0.8, 1.0);
    let mut ahead = 0.0;
    let mut behind = 0.0;
    let mut facing = rng.range(0.2, 1.4) * spread;
    for i in 0..count {
        let copy = rng.chance(twins);
        let own = if copy {
            kind
        } else {
            rng.pick(TargetKind::of(land.biome))
        };
        let mixed = own.on_foot_or_bicycle() == small && (!small || land.biome == Biome::Park);
        let kind = if !mixed || [own, kind].contains(&TargetKind::Boat) {
            kind
        } else {
            own
        };
        let body = if copy {
            actors[0].body.clone()
        } else {
            Body::new(kind, rng)
        };
        let lead = actors[0].route;
        let gap = spread * rng.range(0.75, 1.6);
        let mut route = lead;
        match i % 3 {
            // Along with the target: same pace, before or behind it.
            0 => {
                let side = rng.sign();
                let run = if side > 0.0 { &mut ahead } else { &mut behind };
                *run += gap;
                route.x += way * side * *run;
                if small {
                    route.t += rng.range(0.7, 1.3) * rng.sign();
                }
            }
            // The other way.
            _ => {
                facing += gap * 1.4;
                route.x += way * facing;
                route.speed = -way * against;
                route.surge.0 = 0.0;
                route.t = match kind {
                    TargetKind::Boat => lead.t + rng.sign() * rng.range(8.0, 11.0),
                    TargetKind::Person => lead.t + rng.sign() * rng.range(0.8, 1.1),
                    _ => lane(land, kind, -way, rng),
                };
            }
        }
        route.phase = if i % 3 == 0 { lead.phase } else { rng.unit() };
        actors.push(Actor { kind, body, route });
    }
    // Other road users, where the target is not one of them.
    if kind == TargetKind::Boat || small {
        for i in 0..count.min(4) {
            let other = if land.biome == Biome::Park {
                TargetKind::Cyclist
            } else {
                TargetKind::Car
            };
            let side = if i % 2 == 0 { 1.0 } else { -1.0 };
            let road = &land.along[if land.biome == Biome::Park { 1 } else { 0 }];
            let route = Route {
                x: actors[0].route.x + side * (20.0 + 27.0 * i as f32),
                t: road.at - side * road.lane,
                speed: side * other.speed() * 0.8,
                surge: (0.0, 1.0),
                ..actors[0].route
            };
            let route = Route {
                sway: (0.1, 5.0),
                ..route
            };
            actors.push(Actor {
                kind: other,
                body: Body::new(other, rng),
                route,
            });
        }
    }
    actors
}
