//! Cars, vans, lorries, buses and boats.

use crate::math::{Rgb, lerp, mix, v3};
use crate::mesh::{Coat, Mesh, Ring, coat, ring, tone};
use crate::rng::Rng;

const GLASS: Rgb = [44.0, 54.0, 64.0];
const DARK: Rgb = [36.0, 36.0, 39.0];
const LAMP: Rgb = [244.0, 240.0, 222.0];
const TAIL: Rgb = [178.0, 26.0, 24.0];

const PAINTS: [Rgb; 12] = [
    [226.0, 228.0, 230.0],
    [236.0, 236.0, 232.0],
    [172.0, 176.0, 180.0],
    [122.0, 126.0, 132.0],
    [44.0, 46.0, 50.0],
    [32.0, 34.0, 40.0],
    [168.0, 30.0, 30.0],
    [34.0, 62.0, 124.0],
    [60.0, 104.0, 158.0],
    [40.0, 92.0, 66.0],
    [200.0, 150.0, 44.0],
    [138.0, 112.0, 86.0],
];

/// A paint as seen on the road.
pub(crate) fn paint(rng: &mut Rng) -> Rgb {
    rng.pick(&PAINTS)
}

fn lamps(mesh: &mut Mesh, front: f32, back: f32, half: f32, z: f32) {
    for side in [-1.0, 1.0] {
        let y = (side * (half - 0.42), side * (half - 0.06));
        mesh.end_plate(front + 0.02, y, (z, z + 0.17), LAMP);
        mesh.end_plate(back - 0.02, y, (z + 0.04, z + 0.24), TAIL);
    }
    mesh.end_plate(
        back - 0.02,
        (-0.26, 0.26),
        (z - 0.16, z - 0.04),
        [226.0, 224.0, 206.0],
    );
    mesh.end_plate(front + 0.02, (-0.5, 0.5), (z - 0.18, z + 0.02), DARK);
}

/// A passenger car: saloon, hatchback, estate or off-roader, decided by `rng`; `paint` is its
/// color.
pub(crate) fn car(rng: &mut Rng, paint: Rgb) -> Mesh {
    let mut m = Mesh::default();
    let shape = rng.below(4);
    let (length, tall) = [(4.6, 1.44), (4.0, 1.48), (4.7, 1.5), (4.6, 1.72)][shape];
    let a = length * 0.5;
    let half = rng.range(0.86, 0.93);
    let belt = tall * 0.60;
    let body = Coat {
        side: paint,
        front: paint,
        back: tone(paint, 0.96),
        top: paint,
        gloss: 0.55,
    };
    m.block(
        ring(-a + 0.1, a - 0.12, half - 0.06, 0.2),
        ring(-a, a, half, 0.42),
        coat(tone(DARK, 1.2), 0.1),
    );
    let nose = a - 0.03;
    m.block(
        ring(-a, a, half, 0.42),
        ring(-a + 0.04, nose, half - 0.02, belt - 0.16),
        body,
    );
    // Bonnet and boot slope away from the cabin.
    let cowl = a * 0.36;
    let boot = [-a * 0.62, -a * 0.92, -a * 0.93, -a * 0.94][shape];
    let upper = |back: f32, front: f32, zb: f32, zf: f32, half: f32| Ring {
        back,
        front,
        half,
        z_back: zb,
        z_front: zf,
    };
    let low = ring(-a + 0.04, nose, half - 0.02, belt - 0.16);
    m.block(
        Ring {
            back: cowl - 0.3,
            ..low
        },
        upper(cowl - 0.3, nose - 0.14, belt + 0.02, belt - 0.1, half - 0.1),
        body,
    );
    m.block(
        Ring { front: cowl, ..low },
        upper(-a + 0.1, cowl, belt - 0.02, belt + 0.02, half - 0.05),
        body,
    );
    // Cabin of glass, a painted roof and pillars.
    let roof_back = [-a * 0.36, -a * 0.72, -a * 0.84, -a * 0.80][shape];
    let roof_front = a * [0.06, 0.08, 0.08, 0.12][shape];
    let roof_half = half - 0.2;
    let glass = Coat {
        front: [62.0, 76.0, 88.0],
        top: paint,
        ..coat(GLASS, 0.9)
    };
    m.block(
        ring(boot, cowl - 0.04, half - 0.07, belt),
        ring(roof_back, roof_front, roof_half, tall - 0.05),
        glass,
    );
    let rim = ring(
        roof_back - 0.05,
        roof_front + 0.04,
        roof_half + 0.03,
        tall - 0.06,
    );
    m.block(
        rim,
        ring(roof_back + 0.06, roof_front - 0.08, roof_half - 0.08, tall),
        Coat { gloss: 0.7, ..body },
    );
    let pillar = |m: &mut Mesh, x0: f32, x1: f32, width: f32| {
        for side in [-1.0, 1.0] {
            let y0 = side * (half - 0.055);
            let y1 = side * (roof_half + 0.015);
            let p = [
                v3(x0, y0, belt),
                v3(x0 + width, y0, belt),
                v3(x1 + width, y1, tall - 0.05),
                v3(x1, y1, tall - 0.05),
            ];
            m.quad(p, v3(0.0, 0.0, belt - 1.0), paint, 0.4);
        }
    };
    let middle = lerp(roof_back, roof_front, 0.48);
    pillar(&mut m, middle - 0.05, middle - 0.05, 0.1);
    pillar(&mut m, cowl - 0.12, roof_front - 0.08, 0.1);
    pillar(
        &mut m,
        boot,
        roof_back,
        if shape == 0 { 0.16 } else { 0.34 },
    );
    if rng.chance(0.25) {
        m.lid(
            (middle - 0.2, roof_front - 0.22),
            (-0.36, 0.36),
            tall + 0.01,
            GLASS,
            0.9,
        );
    }
    if rng.chance(0.12) {
        let bars = coat(tone(DARK, 1.4), 0.1);
        m.cuboid((middle, 0.0), v3(1.3, 1.0, 0.26), tall, bars);
    }
    for side in [-1.0, 1.0] {
        m.cuboid(
            (cowl - 0.32, side * (half + 0.07)),
            v3(0.16, 0.14, 0.14),
            belt + 0.02,
            coat(paint, 0.3),
        );
    }
    m.wheels(&[-a * 0.6, a * 0.62], 0.33, half - 0.02);
    lamps(&mut m, a, -a, half, 0.56);
    m
}

/// A delivery van.
pub(crate) fn van(rng: &mut Rng, paint: Rgb) -> Mesh {
    let mut m = Mesh::default();
    let a = rng.range(2.5, 2.95);
    let half = 0.98;
    let tall = rng.range(2.1, 2.5);
    let body = coat(paint, 0.4);
    m.block(
        ring(-a, a, half - 0.04, 0.25),
        ring(-a, a, half, 0.5),
        coat(DARK, 0.1),
    );
    m.block(ring(-a, a, half, 0.5), ring(-a, a - 0.06, half, 1.12), body);
    let cab = a - 0.95;
    m.block(
        ring(-a, cab, half, 1.1),
        ring(-a + 0.05, cab, half - 0.1, tall),
        body,
    );
    m.block(
        ring(cab - 0.1, a - 0.12, half, 1.1),
        ring(cab - 0.1, cab + 0.25, half - 0.14, tall - 0.06),
        Coat {
            front: GLASS,
            ..body
        },
    );
    m.plates(
        (cab - 0.55, cab + 0.42),
        half - 0.02,
        (1.16, 1.62),
        GLASS,
        0.9,
    );
    let dirt = tone(paint, 0.93);
    for i in 0..4 {
        let x = lerp(-a + 0.3, cab - 0.3, i as f32 / 3.0);
        m.lid(
            (x - 0.05, x + 0.05),
            (-half + 0.2, half - 0.2),
            tall + 0.012,
            dirt,
            0.2,
        );
    }
    if rng.chance(0.5) {
        let stripe = rng.pick(&[
            [40.0, 90.0, 160.0],
            [190.0, 60.0, 40.0],
            [60.0, 130.0, 80.0],
            [226.0, 170.0, 40.0],
        ]);
        m.plates(
            (-a + 0.2, cab - 0.7),
            half + 0.012,
            (0.75, 1.05),
            stripe,
            0.2,
        );
    }
    m.end_plate(-a - 0.01, (-half + 0.12, -0.06), (1.25, 1.75), GLASS);
    m.end_plate(-a - 0.01, (0.06, half - 0.12), (1.25, 1.75), GLASS);
    m.wheels(&[-a * 0.62, a * 0.6], 0.36, half + 0.01);
    lamps(&mut m, a, -a, half, 0.68);
    m
}

/// A lorry: cab, and a box, tarpaulin or tank behind it.
pub(crate) fn truck(rng: &mut Rng, paint: Rgb) -> Mesh {
    let mut m = Mesh::default();
    let a = rng.range(3.8, 6.2);
    let half = 1.22;
    m.block(
        ring(-a, a, 0.8, 0.45),
        ring(-a, a, 0.8, 0.95),
        coat(DARK, 0.1),
    );
    let cab = a - 2.1;
    let shell = Coat {
        top: tone(paint, 1.03),
        ..coat(paint, 0.5)
    };
    m.block(
        ring(cab, a, half - 0.06, 0.4),
        ring(cab, a, half - 0.04, 1.5),
        shell,
    );
    m.block(
        ring(cab, a - 0.03, half - 0.05, 1.5),
        ring(cab + 0.1, a - 0.3, half - 0.14, 2.7),
        Coat {
            front: GLASS,
            ..shell
        },
    );
    m.plates((a - 1.35, a - 0.35), half - 0.035, (1.55, 2.2), GLASS, 0.9);
    m.block(
        ring(cab + 0.1, a - 1.0, half - 0.2, 2.7),
        ring(cab + 0.1, a - 1.6, half - 0.3, 3.25),
        shell,
    );
    let box_color = rng.pick(&[
        [226.0, 226.0, 222.0],
        [208.0, 210.0, 212.0],
        [60.0, 92.0, 148.0],
        [168.0, 62.0, 44.0],
        [196.0, 186.0, 150.0],
    ]);
    let back = cab - 0.35;
    match rng.below(3) {
        0 => {
            // Open load of earth or grain.
            let load = rng.pick(&[
                [140.0, 112.0, 84.0],
                [196.0, 170.0, 110.0],
                [110.0, 108.0, 106.0],
            ]);
            m.block(
                ring(-a, back, half, 0.95),
                ring(-a, back, half, 1.9),
                coat(box_color, 0.2),
            );
            m.block(
                ring(-a + 0.15, back - 0.15, half - 0.12, 1.88),
                ring(-a * 0.5, back * 0.3, 0.3, 2.4),
                coat(load, 0.0),
            );
        }
        _ => {
            m.block(
                ring(-a, back, half, 0.95),
                ring(-a, back, half, 3.35),
                coat(box_color, 0.25),
            );
            let n = ((back + a) / 1.2) as usize;
            for i in 0..=n {
                let x = lerp(-a + 0.08, back - 0.08, i as f32 / n as f32);
                m.lid(
                    (x - 0.05, x + 0.05),
                    (-half + 0.04, half - 0.04),
                    3.365,
                    tone(box_color, 0.86),
                    0.1,
                );
                m.plates(
                    (x - 0.05, x + 0.05),
                    half + 0.012,
                    (1.0, 3.3),
                    tone(box_color, 0.9),
                    0.1,
                );
            }
            if rng.chance(0.6) {
                let badge = rng.pick(&[
                    [190.0, 50.0, 40.0],
                    [40.0, 80.0, 150.0],
                    [230.0, 180.0, 50.0],
                    [50.0, 120.0, 80.0],
                ]);
                m.plates(
                    (lerp(-a, back, 0.25), lerp(-a, back, 0.75)),
                    half + 0.02,
                    (1.8, 2.6),
                    badge,
                    0.2,
                );
            }
        }
    }
    m.wheels(&[-a + 0.9, -a + 2.0, a - 1.2], 0.5, half - 0.02);
    lamps(&mut m, a, -a, half, 0.8);
    m
}

/// A city bus or a coach.
pub(crate) fn bus(rng: &mut Rng) -> Mesh {
    let mut m = Mesh::default();
    let paint = rng.pick(&[
        [196.0, 44.0, 38.0],
        [232.0, 190.0, 52.0],
        [48.0, 116.0, 90.0],
        [226.0, 228.0, 228.0],
        [52.0, 94.0, 164.0],
    ]);
    let a = rng.range(5.2, 6.1);
    let half = 1.26;
    let tall = 3.05;
    m.block(
        ring(-a, a, half - 0.05, 0.3),
        ring(-a, a, half, 1.25),
        coat(paint, 0.4),
    );
    let glass = Coat {
        top: paint,
        ..coat(GLASS, 0.8)
    };
    m.block(
        ring(-a, a, half, 1.25),
        ring(-a + 0.05, a - 0.12, half - 0.04, 2.5),
        glass,
    );
    m.block(
        ring(-a + 0.05, a - 0.12, half - 0.03, 2.5),
        ring(-a + 0.15, a - 0.3, half - 0.16, tall),
        Coat {
            top: mix(paint, [235.0; 3], 0.55),
            ..coat(paint, 0.4)
        },
    );
    for i in 0..8 {
        let x = lerp(-a + 0.6, a - 1.2, i as f32 / 7.0);
        m.plates((x - 0.06, x + 0.06), half + 0.005, (1.25, 2.5), paint, 0.3);
    }
    m.cuboid(
        (-a * 0.45, 0.0),
        v3(2.4, 1.5, 0.28),
        tall,
        coat([206.0, 206.0, 204.0], 0.1),
    );
    m.cuboid(
        (a * 0.4, 0.0),
        v3(1.2, 1.2, 0.18),
        tall,
        coat([190.0, 192.0, 192.0], 0.1),
    );
    m.wheels(&[-a * 0.52, a * 0.58], 0.5, half + 0.01);
    lamps(&mut m, a, -a, half, 0.75);
    m
}

/// A motor boat, a fishing boat or a barge, its waterline at z = 0.
pub(crate) fn boat(rng: &mut Rng, paint: Rgb) -> Mesh {
    let mut m = Mesh::default();
    let kind = rng.below(3);
    let (a, half, board) = [
        (rng.range(2.6, 4.0), 1.15, 0.75),
        (rng.range(4.5, 6.5), 1.7, 1.2),
        (rng.range(3.4, 4.6), 1.3, 0.7),
    ][kind];
    // Outline from stern to bow: place along, half width, height of the board.
    let outline = [
        (-1.0, 0.82, 0.86),
        (-0.6, 0.96, 0.86),
        (0.0, 1.0, 0.9),
        (0.45, 0.82, 1.02),
        (0.78, 0.46, 1.2),
        (1.0, 0.04, 1.36),
    ];
    let at = |i: usize, side: f32, lift: f32| {
        let (x, w, z): (f32, f32, f32) = outline[i];
        let flare = lerp(0.8, 1.0, lift);
        v3(
            x * a * lerp(0.95, 1.0, lift),
            side * w * half * flare,
            z * board * lift,
        )
    };
    let deck = [
        [214.0, 202.0, 178.0],
        [170.0, 140.0, 104.0],
        [226.0, 226.0, 222.0],
    ][kind];
    let trim = rng.pick(&[
        [36.0, 52.0, 92.0],
        [150.0, 36.0, 34.0],
        [46.0, 48.0, 52.0],
        [38.0, 96.0, 96.0],
    ]);
    let inside = v3(0.0, 0.0, board * 0.4);
    for i in 0..5 {
        for side in [-1.0, 1.0] {
            for (lo, hi, color) in [(0.0, 0.3, trim), (0.3, 1.0, paint)] {
                let side_quad = [
                    at(i, side, lo),
                    at(i + 1, side, lo),
                    at(i + 1, side, hi),
                    at(i, side, hi),
                ];
                m.quad(side_quad, inside, color, 0.5);
            }
        }
        m.quad(
            [
                at(i, -1.0, 1.0),
                at(i + 1, -1.0, 1.0),
                at(i + 1, 1.0, 1.0),
                at(i, 1.0, 1.0),
            ],
            v3(0.0, 0.0, -9.0),
            paint,
            0.3,
        );
        // A planked deck a little inside the gunwale.
        if i < 4 {
            let inner = |i: usize, s: f32| {
                let p = at(i, s, 1.0);
                v3(p.x * 0.96, p.y * 0.82, p.z + 0.015)
            };
            m.quad(
                [
                    inner(i, -1.0),
                    inner(i + 1, -1.0),
                    inner(i + 1, 1.0),
                    inner(i, 1.0),
                ],
                v3(0.0, 0.0, -9.0),
                deck,
                0.1,
            );
        }
    }
    m.quad(
        [
            at(0, -1.0, 0.0),
            at(0, 1.0, 0.0),
            at(0, 1.0, 1.0),
            at(0, -1.0, 1.0),
        ],
        inside,
        paint,
        0.3,
    );
    let z = board * 0.9;
    match kind {
        0 => {
            let screen = Coat {
                top: GLASS,
                ..coat(GLASS, 0.9)
            };
            m.block(
                ring(a * 0.05, a * 0.34, half * 0.62, z),
                ring(a * 0.05, a * 0.16, half * 0.5, z + 0.5),
                screen,
            );
            for x in [-0.12, -0.5] {
                m.cuboid(
                    (a * x, 0.0),
                    v3(0.55, half * 1.1, 0.4),
                    z,
                    coat(tone(trim, 1.3), 0.1),
                );
            }
            m.cuboid((-a * 1.02, 0.0), v3(0.5, 0.45, 0.7), 0.3, coat(DARK, 0.4));
        }
        1 => {
            m.cuboid(
                (a * 0.12, 0.0),
                v3(a * 0.5, half * 1.1, 1.3),
                z,
                Coat {
                    front: GLASS,
                    ..coat([238.0, 238.0, 234.0], 0.3)
                },
            );
            m.plates(
                (a * -0.08, a * 0.32),
                half * 0.56,
                (z + 0.6, z + 1.05),
                GLASS,
                0.9,
            );
            m.cuboid(
                (a * 0.1, 0.0),
                v3(a * 0.58, half * 1.25, 0.12),
                z + 1.3,
                coat(paint, 0.3),
            );
            m.cuboid(
                (a * 0.0, 0.0),
                v3(0.12, 0.12, 1.7),
                z + 1.4,
                coat([220.0, 220.0, 216.0], 0.0),
            );
            m.cuboid(
                (-a * 0.6, 0.2),
                v3(1.1, 1.3, 0.5),
                z,
                coat([70.0, 120.0, 120.0], 0.0),
            );
        }
        _ => {
            m.block(
                ring(-a * 0.3, a * 0.42, half * 0.66, z),
                ring(-a * 0.22, a * 0.2, half * 0.5, z + 0.75),
                Coat {
                    top: paint,
                    ..coat(GLASS, 0.9)
                },
            );
            m.lid(
                (-a * 0.24, a * 0.22),
                (-half * 0.54, half * 0.54),
                z + 0.78,
                paint,
                0.5,
            );
            m.cuboid(
                (-a * 0.72, 0.0),
                v3(0.5, half * 1.2, 0.3),
                z,
                coat([190.0, 70.0, 60.0], 0.1),
            );
        }
    }
    m
}

/// A parasol or market tent: an eight-sided roof of the given radius on posts, its eaves at `z`.
pub(crate) fn canopy(rng: &mut Rng, radius: f32, z: f32) -> Mesh {
    let mut m = Mesh::default();
    let stripes = rng.pick(&[
        [186.0, 60.0, 50.0],
        [60.0, 110.0, 160.0],
        [70.0, 130.0, 86.0],
        [224.0, 190.0, 90.0],
    ]);
    m.drum(
        12,
        (radius, radius * 0.1),
        (z, z + radius * 0.38),
        [232.0, 228.0, 216.0],
    );
    for (i, face) in m.faces.iter_mut().enumerate() {
        if i / 2 % 2 == 0 {
            face.color = stripes;
        }
    }
    for (x, y) in [(0.6, 0.6), (0.6, -0.6), (-0.6, 0.6), (-0.6, -0.6)] {
        m.cuboid(
            (x * radius, y * radius),
            v3(0.1, 0.1, z),
            0.0,
            coat([120.0, 116.0, 110.0], 0.0),
        );
    }
    m
}

/// A stretch of bridge deck, 8 m long in y, `half` wide in x, its upper side at `z`.
pub(crate) fn deck(half: f32, z: f32, surface: Rgb, rim: Rgb) -> Mesh {
    let mut m = Mesh::default();
    m.cuboid(
        (0.0, 0.0),
        v3(2.0 * half, 8.06, 0.9),
        z - 0.9,
        Coat {
            top: surface,
            ..coat(rim, 0.0)
        },
    );
    for side in [-1.0, 1.0] {
        m.cuboid(
            (side * (half - 0.15), 0.0),
            v3(0.3, 8.06, 0.9),
            z,
            coat(rim, 0.0),
        );
    }
    // Stretches join one another: no ends.
    m.faces.retain(|f| f.normal.y.abs() < 0.5);
    for side in [-1.0, 1.0] {
        m.lid(
            (side * (half - 0.9), side * (half - 0.75)),
            (-4.03, 4.03),
            z + 0.012,
            [214.0, 214.0, 206.0],
            0.0,
        );
    }
    if half > 3.0 {
        m.lid(
            (-0.07, 0.07),
            (-2.0, 2.0),
            z + 0.012,
            [220.0, 220.0, 212.0],
            0.0,
        );
    }
    m
}
