//! Houses, barns, blocks of flats, sheds and stacks of containers.

use crate::math::{Rgb, V3, lerp, mix, v3};
use crate::mesh::{Coat, Mesh, coat, ring, tone};
use crate::rng::Rng;

const PANE: Rgb = [70.0, 82.0, 96.0];

/// Windows in a row on the long sides of a wall.
fn windows(m: &mut Mesh, rng: &mut Rng, x: (f32, f32), half: f32, floors: &[f32], pane: Rgb) {
    let n = ((x.1 - x.0) / 2.6).max(1.0) as usize;
    for &z in floors {
        for i in 0..n {
            let c = lerp(x.0, x.1, (i as f32 + 0.5) / n as f32);
            m.plates(
                (c - 0.62, c + 0.62),
                half + 0.03,
                (z - 0.1, z + 1.35),
                [226.0, 222.0, 214.0],
                0.0,
            );
            m.plates(
                (c - 0.5, c + 0.5),
                half + 0.05,
                (z, z + 1.25),
                tone(pane, rng.range(0.8, 1.25)),
                0.5,
            );
        }
    }
}

/// One slope of a roof in rows of tiles: `eave` and `ridge` are its lower and upper edge.
fn slope(m: &mut Mesh, rng: &mut Rng, eave: (V3, V3), ridge: (V3, V3), color: Rgb) {
    let rows = 6;
    let columns = 5;
    let inside = (eave.0 + eave.1 + ridge.0 + ridge.1) * 0.25 + v3(0.0, 0.0, -5.0);
    let at = |i: usize, j: usize| {
        let (u, v) = (i as f32 / columns as f32, j as f32 / rows as f32);
        (eave.0 + (eave.1 - eave.0) * u) * (1.0 - v) + (ridge.0 + (ridge.1 - ridge.0) * u) * v
    };
    for j in 0..rows {
        let row = rng.range(0.95, 1.04);
        for i in 0..columns {
            let c = tone(color, row * rng.range(0.95, 1.05));
            m.quad(
                [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)],
                inside,
                c,
                0.0,
            );
        }
    }
}

/// A gabled house or barn along x. `size` is length, width and height of the eaves.
pub(crate) fn house(rng: &mut Rng, size: V3, barn: bool) -> Mesh {
    let mut m = Mesh::default();
    let walls = [
        [232.0, 226.0, 212.0],
        [222.0, 206.0, 176.0],
        [206.0, 200.0, 192.0],
        [190.0, 150.0, 122.0],
        [238.0, 236.0, 230.0],
    ];
    let roofs = [
        [164.0, 84.0, 62.0],
        [142.0, 74.0, 58.0],
        [104.0, 98.0, 96.0],
        [86.0, 84.0, 90.0],
        [152.0, 104.0, 78.0],
    ];
    let barns = [
        [140.0, 58.0, 48.0],
        [126.0, 104.0, 82.0],
        [168.0, 168.0, 164.0],
    ];
    let wall = if barn {
        rng.pick(&barns)
    } else {
        rng.pick(&walls)
    };
    let roof = if barn {
        rng.pick(&[
            [148.0, 148.0, 150.0],
            [120.0, 112.0, 106.0],
            [150.0, 88.0, 70.0],
        ])
    } else {
        rng.pick(&roofs)
    };
    let a = size.x * 0.5;
    let b = size.y * 0.5;
    let h = size.z;
    let top = h + b * rng.range(0.62, 0.9);
    m.block(ring(-a, a, b, 0.0), ring(-a, a, b, h), coat(wall, 0.0));
    let over = 0.45;
    for side in [-1.0, 1.0] {
        let x = side * a;
        m.quad(
            [v3(x, -b, h), v3(x, b, h), v3(x, 0.0, top), v3(x, 0.0, top)],
            v3(0.0, 0.0, h),
            wall,
            0.0,
        );
        let drop = over * (top - h) / b;
        let y = side * (b + over);
        let eave = (v3(-a - over, y, h - drop), v3(a + over, y, h - drop));
        let ridge = (v3(-a - over, 0.0, top), v3(a + over, 0.0, top));
        slope(&mut m, rng, eave, ridge, roof);
        // Gutter: a thin pale edge below the eave.
        let low = v3(0.0, 0.0, -0.16);
        m.quad(
            [eave.0, eave.1, eave.1 + low, eave.0 + low],
            v3(0.0, 0.0, h),
            tone(roof, 0.6),
            0.0,
        );
    }
    m.cuboid(
        (0.0, 0.0),
        v3(2.0 * (a + over), 0.3, 0.1),
        top - 0.06,
        coat(tone(roof, 0.88), 0.0),
    );
    if barn {
        m.end_plate(
            a + 0.03,
            (-b * 0.45, b * 0.45),
            (0.0, h * 0.85),
            tone(wall, 0.6),
        );
        m.end_plate(
            -a - 0.03,
            (-b * 0.45, b * 0.45),
            (0.0, h * 0.85),
            tone(wall, 0.6),
        );
    } else {
        let floors: &[f32] = if h > 4.5 { &[0.9, 3.5] } else { &[0.9] };
        windows(&mut m, rng, (-a + 0.6, a - 0.6), b, floors, PANE);
        m.plates(
            (-0.5, 0.5),
            b + 0.06,
            (0.0, 2.1),
            rng.pick(&[[96.0, 66.0, 48.0], [52.0, 70.0, 84.0]]),
            0.1,
        );
        for side in [-1.0, 1.0] {
            m.end_plate(side * (a + 0.03), (-1.9, -0.8), (1.0, 2.2), PANE);
            m.end_plate(side * (a + 0.03), (0.8, 1.9), (1.0, 2.2), PANE);
        }
        let x = a * rng.range(-0.6, 0.6);
        m.cuboid(
            (x, b * 0.25),
            v3(0.75, 0.6, 1.5),
            top - 1.1,
            Coat {
                top: [52.0, 48.0, 46.0],
                ..coat([150.0, 96.0, 80.0], 0.0)
            },
        );
        if rng.chance(0.35) {
            // Solar panels on one slope.
            let side = rng.sign();
            let p = |x: f32, v: f32| v3(x, side * (b + over) * (1.0 - v), lerp(h, top, v) + 0.12);
            for i in 0..3 {
                let x = -a * 0.7 + i as f32 * a * 0.4;
                let quad = [
                    p(x, 0.3),
                    p(x + a * 0.37, 0.3),
                    p(x + a * 0.37, 0.78),
                    p(x, 0.78),
                ];
                m.quad(quad, v3(0.0, 0.0, -5.0), [34.0, 42.0, 66.0], 0.7);
            }
        }
    }
    m
}

/// A block with a flat roof, parapet and machinery. `size` is length, width and height.
pub(crate) fn flats(rng: &mut Rng, size: V3) -> Mesh {
    let mut m = Mesh::default();
    let wall = rng.pick(&[
        [206.0, 196.0, 178.0],
        [182.0, 150.0, 126.0],
        [196.0, 198.0, 200.0],
        [222.0, 216.0, 206.0],
        [166.0, 104.0, 84.0],
    ]);
    let roof = rng.pick(&[
        [150.0, 148.0, 144.0],
        [126.0, 124.0, 122.0],
        [170.0, 164.0, 152.0],
        [138.0, 142.0, 134.0],
    ]);
    let a = size.x * 0.5;
    let b = size.y * 0.5;
    let h = size.z;
    m.block(
        ring(-a, a, b, 0.0),
        ring(-a, a, b, h),
        Coat {
            top: roof,
            ..coat(wall, 0.0)
        },
    );
    // Parapet.
    for side in [-1.0, 1.0] {
        m.cuboid(
            (side * (a - 0.15), 0.0),
            v3(0.3, 2.0 * b, 0.55),
            h,
            coat(tone(wall, 1.04), 0.0),
        );
        m.cuboid(
            (0.0, side * (b - 0.15)),
            v3(2.0 * a, 0.3, 0.55),
            h,
            coat(tone(wall, 1.04), 0.0),
        );
    }
    let floors: Vec<f32> = (0..8)
        .map(|i| 0.9 + i as f32 * 3.0)
        .filter(|z| z + 1.9 < h)
        .collect();
    windows(&mut m, rng, (-a + 0.6, a - 0.6), b, &floors, PANE);
    for &z in &floors {
        for side in [-1.0, 1.0] {
            m.end_plate(side * (a + 0.03), (-b * 0.7, -b * 0.2), (z, z + 1.3), PANE);
            m.end_plate(side * (a + 0.03), (b * 0.2, b * 0.7), (z, z + 1.3), PANE);
        }
    }
    for _ in 0..rng.below(5) + 2 {
        let (x, y) = (rng.range(-a + 2.0, a - 2.0), rng.range(-b + 2.0, b - 2.0));
        let unit = v3(
            rng.range(1.0, 2.2),
            rng.range(0.9, 1.6),
            rng.range(0.6, 1.2),
        );
        m.cuboid(
            (x, y),
            unit,
            h,
            Coat {
                top: mix(wall, [150.0; 3], 0.7),
                ..coat([186.0, 188.0, 188.0], 0.1)
            },
        );
    }
    if size.x > 14.0 {
        m.cuboid(
            (a * 0.3, 0.0),
            v3(3.4, 3.0, 2.4),
            h,
            Coat {
                top: roof,
                ..coat(tone(wall, 0.96), 0.0)
            },
        );
        for i in 0..4 {
            let x = -a * 0.75 + i as f32 * 1.9;
            m.lid(
                (x, x + 1.6),
                (-b * 0.6, b * 0.1),
                h + 0.25,
                [36.0, 44.0, 68.0],
                0.7,
            );
        }
    }
    m
}

/// Shipping containers, one to three high.
pub(crate) fn containers(rng: &mut Rng) -> Mesh {
    let mut m = Mesh::default();
    let colors = [
        [164.0, 62.0, 44.0],
        [44.0, 84.0, 138.0],
        [62.0, 118.0, 84.0],
        [204.0, 160.0, 62.0],
        [178.0, 180.0, 182.0],
        [112.0, 60.0, 56.0],
    ];
    for row in 0..rng.below(3) + 1 {
        let y = row as f32 * 2.7 - 2.7;
        for level in 0..rng.below(3) + 1 {
            let color = rng.pick(&colors);
            let z = level as f32 * 2.5;
            m.cuboid((0.0, y), v3(12.0, 2.44, 2.5), z, coat(color, 0.1));
            for i in 0..8 {
                let x = -5.6 + i as f32 * 1.6;
                m.lid(
                    (x - 0.05, x + 0.05),
                    (y - 1.15, y + 1.15),
                    z + 2.515,
                    tone(color, 0.84),
                    0.0,
                );
            }
        }
    }
    m
}

/// A lamp post with its arm over the road (toward +y).
pub(crate) fn lamp() -> Mesh {
    let mut m = Mesh::default();
    let metal = coat([150.0, 154.0, 156.0], 0.2);
    m.cuboid((0.0, 0.0), v3(0.14, 0.14, 6.5), 0.0, metal);
    m.cuboid((0.0, 0.7), v3(0.1, 1.5, 0.1), 6.4, metal);
    m.cuboid(
        (0.0, 1.3),
        v3(0.24, 0.6, 0.12),
        6.3,
        coat([206.0, 206.0, 200.0], 0.2),
    );
    m
}

/// A grain silo.
pub(crate) fn silo(rng: &mut Rng) -> Mesh {
    let mut m = Mesh::default();
    let r = rng.range(1.8, 2.8);
    let h = rng.range(6.0, 10.0);
    m.drum(12, (r, r), (0.0, h), [190.0, 194.0, 198.0]);
    m.drum(12, (r * 1.04, 0.1), (h, h + r * 0.6), [170.0, 174.0, 180.0]);
    m
}
