//! The camera's motion between two frames: shift, turn and zoom of the whole picture, estimated
//! from thumbnails.
//!
//! Both frames are averaged into a grid about 96 cells wide. Exhaustive comparison on a grid of
//! half that resolution finds a whole-cell shift. Gauss-Newton on the brightness differences (Lucas
//! and Kanade 1981) then finds a similarity transform, once from that shift and once from the
//! motion of the frame before. Straight edges and repeating patterns fit at many places along them:
//! of two motions that explain the picture about as well the steadier one wins, and every step is
//! drawn a little toward the motion before. A motion that explains too little of the difference
//! between the frames (water, sky, a single texture) counts as none. The target's own cells are
//! left out. The cost is a few million operations, whatever the frame's size.

use crate::bbox::FrameBox;
use crate::frame::Frame;

/// Cells across the thumbnail.
const COLUMNS: usize = 96;
/// Pixels that are averaged per cell and axis.
const SAMPLES: usize = 4;
/// Largest shift that the coarse search considers, in coarse cells.
const REACH: i32 = 8;
/// Most Gauss-Newton steps.
const ITERATIONS: usize = 6;
/// Distance from the target at which a cell counts half, as a share of the thumbnail's width: the
/// ground farther away moves otherwise.
const NEAR: f64 = 0.25;
/// Standard deviation that every thumbnail is brought to.
const CONTRAST: f32 = 40.0;
/// Least standard deviation that is raised to it in full.
const LEAST_CONTRAST: f32 = 4.0;
/// Brightness difference beyond which a cell counts as something that moves on its own.
const OUTLIER: f64 = 24.0;
/// Distance of two shifts, in cells, within which they lead to the same motion.
const ALIKE: f64 = 2.0;
/// Share of the steadier motion's mean difference that another motion must stay below to win.
const SURPRISE: f64 = 0.8;
/// Share of the mean difference that a motion must explain, per cell of it: a large motion needs
/// more support. Water, sky and a single texture give none.
const SUPPORT: f64 = 0.05;
/// Share that supports any motion.
const FULL_SUPPORT: f64 = 0.15;
/// Mean difference above which two pictures have nothing in common; independent ones have 20.
const NOISE: f64 = 16.0;

/// Weight of the motion before, as a share of the picture's weight along its best direction.
const STEADY: f64 = 0.02;

/// A similarity transform of frame positions from one frame to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    a: f64, // 1 + a: zoom times cosine of the turn
    b: f64, // zoom times sine of the turn
    x: f64,
    y: f64,
}

impl Default for Motion {
    fn default() -> Motion {
        Motion::shift(0.0, 0.0)
    }
}

impl Motion {
    /// A shift without turn and zoom, in pixels.
    pub fn shift(x: f64, y: f64) -> Motion {
        Motion {
            a: 0.0,
            b: 0.0,
            x,
            y,
        }
    }

    /// Where a position of the earlier frame lies in the later one.
    pub fn apply(&self, x: f64, y: f64) -> (f64, f64) {
        let (dx, dy) = self.turn(x, y);
        (dx + self.x, dy + self.y)
    }

    /// A difference of positions in the later frame.
    pub fn turn(&self, x: f64, y: f64) -> (f64, f64) {
        (x + self.a * x - self.b * y, y + self.b * x + self.a * y)
    }

    /// The box moved with the picture. Its size stays: the ground grows as a camera flies toward
    /// it, but a target that the camera follows does not.
    pub(crate) fn carry(&self, bbox: &FrameBox) -> FrameBox {
        let (cx, cy) = self.apply(bbox.cx.into(), bbox.cy.into());
        FrameBox {
            cx: cx as f32,
            cy: cy as f32,
            ..*bbox
        }
    }
}

/// Brightness per cell, less the picture's mean and at the same contrast for all pictures, because
/// exposure may change from frame to frame.
#[derive(Clone, Debug, Default)]
struct Thumbnail {
    values: Vec<f32>,
    columns: usize,
    rows: usize,
    cell: usize, // pixels a side
}

impl Thumbnail {
    fn take(&mut self, frame: &Frame<'_>) {
        self.cell = frame.width().div_ceil(COLUMNS).max(1);
        self.columns = frame.width() / self.cell;
        self.rows = frame.height() / self.cell;
        self.values.clear();
        let samples = SAMPLES.min(self.cell);
        let pick = |i: usize| (2 * i + 1) * self.cell / (2 * samples);
        for row in 0..self.rows {
            for column in 0..self.columns {
                let mut sum = 0u32;
                for i in 0..samples {
                    let y = row * self.cell + pick(i);
                    for j in 0..samples {
                        let pixel = frame.bgr(column * self.cell + pick(j), y);
                        let [blue, green, red] = pixel.map(u32::from);
                        sum += blue + 2 * green + red;
                    }
                }
                self.values
                    .push(sum as f32 / (4 * samples * samples) as f32);
            }
        }
        self.normalize();
    }

    fn normalize(&mut self) {
        let count = self.values.len().max(1) as f32;
        let mean = self.values.iter().sum::<f32>() / count;
        let variance = self
            .values
            .iter()
            .map(|v| (v - mean) * (v - mean))
            .sum::<f32>()
            / count;
        let gain = CONTRAST / variance.sqrt().max(LEAST_CONTRAST);
        self.values.iter_mut().for_each(|v| *v = gain * (*v - mean));
    }

    fn at(&self, column: usize, row: usize) -> f64 {
        f64::from(self.values[row * self.columns + column])
    }

    /// Bilinear interpolation with its gradient; `None` outside.
    fn sample(&self, x: f64, y: f64) -> Option<(f64, f64, f64)> {
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        let (i, j) = (x as usize, y as usize);
        if i + 1 >= self.columns || j + 1 >= self.rows {
            return None;
        }
        let (u, v) = (x - i as f64, y - j as f64);
        let [a, b, c, d] = [
            self.at(i, j),
            self.at(i + 1, j),
            self.at(i, j + 1),
            self.at(i + 1, j + 1),
        ];
        let (top, low) = (a + (b - a) * u, c + (d - c) * u);
        Some((
            top + (low - top) * v,
            (b - a) * (1.0 - v) + (d - c) * v,
            low - top,
        ))
    }

    /// Averages into half the resolution.
    fn halve(&self, into: &mut Thumbnail) {
        (into.columns, into.rows, into.cell) = (self.columns / 2, self.rows / 2, 2 * self.cell);
        into.values.clear();
        for row in 0..into.rows {
            for column in 0..into.columns {
                let four = [(0, 0), (1, 0), (0, 1), (1, 1)];
                let sum: f64 = four
                    .iter()
                    .map(|(i, j)| self.at(2 * column + i, 2 * row + j))
                    .sum();
                into.values.push((sum / 4.0) as f32);
            }
        }
    }
}

/// Estimates the motion from each frame to the next.
#[derive(Clone, Debug, Default)]
pub struct CameraMotion {
    before: Thumbnail,
    now: Thumbnail,
    coarse_before: Thumbnail,
    coarse_now: Thumbnail,
    last: Fit,
    noise: bool,
}

/// A motion about the middle of the thumbnail, in cells, and how well it explains the picture.
#[derive(Clone, Copy, Debug, Default)]
struct Fit {
    motion: [f64; 4], // as of `Motion`: a, b, x, y
    difference: f64,  // mean brightness difference before the last step
}

impl CameraMotion {
    /// The motion since the last frame, judged mostly by the surroundings of the box `without` in
    /// that frame; the box itself is left out. No motion if the frame's size changed, or if none
    /// has support.
    pub(crate) fn observe(&mut self, frame: &Frame<'_>, without: Option<&FrameBox>) -> Motion {
        std::mem::swap(&mut self.before, &mut self.now);
        std::mem::swap(&mut self.coarse_before, &mut self.coarse_now);
        self.now.take(frame);
        self.now.halve(&mut self.coarse_now);
        let same = |a: &Thumbnail, b: &Thumbnail| {
            (a.columns, a.rows, a.cell) == (b.columns, b.rows, b.cell)
        };
        if !same(&self.before, &self.now) || self.now.columns < 8 || self.now.rows < 8 {
            self.last = Fit::default();
            self.noise = false;
            return Motion::default();
        }
        let (x, y) = self.coarse_shift(without);
        let [_, _, last_x, last_y] = self.last.motion;
        let steady = self.refine(self.last.motion, without);
        // Both starts usually lead to the same motion.
        let alike = (x - last_x).abs().max((y - last_y).abs()) <= ALIKE;
        let other = if alike && steady.is_some() {
            None
        } else {
            self.refine([0.0, 0.0, x, y], without)
        };
        self.last = match (steady, other) {
            (Some(steady), Some(other)) if other.difference >= SURPRISE * steady.difference => {
                steady
            }
            (steady, other) => other.or(steady).unwrap_or_default(),
        };
        let still = self.difference([0.0; 4], without);
        let explained = self.difference(self.last.motion, without);
        self.noise = explained >= NOISE;
        let [_, _, x, y] = self.last.motion;
        let needed = (SUPPORT * x.hypot(y)).min(FULL_SUPPORT);
        if self.noise || explained > (1.0 - needed) * still {
            self.last = Fit::default();
        }
        self.in_frame(self.last.motion)
    }

    /// Whether the last picture has nothing in common with the one before.
    pub(crate) fn is_noise(&self) -> bool {
        self.noise
    }

    /// Mean brightness difference that a motion in cells leaves.
    fn difference(&self, [a, b, x, y]: [f64; 4], without: Option<&FrameBox>) -> f64 {
        let (before, now) = (&self.before, &self.now);
        let (mx, my) = (before.columns as f64 / 2.0, before.rows as f64 / 2.0);
        let hole = Hole::new(without, before.cell);
        let half = NEAR * before.columns as f64;
        let (mut sum, mut weights) = (0.0, 0.0);
        for row in 0..before.rows {
            for column in 0..before.columns {
                let (column_at, row_at) = (column as f64, row as f64);
                let (u, v) = (column_at - mx, row_at - my);
                let to = (u + a * u - b * v + x + mx, v + b * u + a * v + y + my);
                let Some((value, ..)) = now.sample(to.0, to.1) else {
                    continue;
                };
                if !hole.contains(column_at, row_at) {
                    let near = hole.nearness(column_at, row_at, half);
                    sum += near * (before.at(column, row) - value).abs().min(OUTLIER);
                    weights += near;
                }
            }
        }
        sum / f64::max(weights, 1.0)
    }

    /// The whole-cell shift of least mean absolute difference, in cells of the fine grid.
    fn coarse_shift(&self, without: Option<&FrameBox>) -> (f64, f64) {
        let before = &self.coarse_before;
        let (columns, rows) = (before.columns as i32, before.rows as i32);
        let (reach_x, reach_y) = (REACH.min(columns / 3), REACH.min(rows / 3));
        let hole = Hole::new(without, before.cell);
        let mut best = ((0, 0), self.coarse_difference((0, 0), &hole));
        for dy in -reach_y..=reach_y {
            for dx in -reach_x..=reach_x {
                let difference = self.coarse_difference((dx, dy), &hole);
                if difference < best.1 {
                    best = ((dx, dy), difference);
                }
            }
        }
        (2.0 * f64::from(best.0.0), 2.0 * f64::from(best.0.1))
    }

    fn coarse_difference(&self, (dx, dy): (i32, i32), hole: &Hole) -> f64 {
        let (before, now) = (&self.coarse_before, &self.coarse_now);
        let (columns, rows) = (before.columns as i32, before.rows as i32);
        let (mut sum, mut count) = (0.0, 0u32);
        for row in (-dy).max(0)..(rows - dy).min(rows) {
            for column in (-dx).max(0)..(columns - dx).min(columns) {
                if hole.contains(f64::from(column), f64::from(row)) {
                    continue;
                }
                let difference = before.at(column as usize, row as usize)
                    - now.at((column + dx) as usize, (row + dy) as usize);
                sum += difference.abs().min(OUTLIER);
                count += 1;
            }
        }
        // Half the picture must overlap for a comparison to mean something.
        if 2 * count < (columns * rows) as u32 {
            f64::MAX
        } else {
            sum / f64::from(count)
        }
    }

    /// Gauss-Newton from a motion in cells. `None` if it runs away.
    fn refine(&self, start: [f64; 4], without: Option<&FrameBox>) -> Option<Fit> {
        let (before, now) = (&self.before, &self.now);
        let (mx, my) = (before.columns as f64 / 2.0, before.rows as f64 / 2.0);
        let hole = Hole::new(without, before.cell);
        let mut fit = Fit {
            motion: start,
            difference: 0.0,
        };
        for _ in 0..ITERATIONS {
            let [a, b, x, y] = fit.motion;
            let (mut normal, mut right) = ([[0.0; 4]; 4], [0.0; 4]);
            let (mut sum, mut weights) = (0.0, 0.0);
            for row in 0..before.rows {
                for column in 0..before.columns {
                    let (u, v) = (column as f64 - mx, row as f64 - my);
                    if hole.contains(column as f64, row as f64) {
                        continue;
                    }
                    let (px, py) = (u + a * u - b * v + x + mx, v + b * u + a * v + y + my);
                    let Some((value, gx, gy)) = now.sample(px, py) else {
                        continue;
                    };
                    let difference = before.at(column, row) - value;
                    let near =
                        hole.nearness(column as f64, row as f64, NEAR * before.columns as f64);
                    let weight = near * OUTLIER / difference.abs().max(OUTLIER);
                    sum += near * difference.abs().min(OUTLIER);
                    weights += near;
                    let jacobian = [gx * u + gy * v, gy * u - gx * v, gx, gy];
                    for (i, ji) in jacobian.iter().enumerate() {
                        right[i] += weight * ji * difference;
                        for (j, jj) in jacobian.iter().enumerate() {
                            normal[i][j] += weight * ji * jj;
                        }
                    }
                }
            }
            fit.difference = sum / f64::max(weights, 1.0);
            // A turn or zoom by 1 moves a cell halfway to the edge by a quarter of the width.
            let shift = STEADY * 0.5 * (normal[2][2] + normal[3][3]);
            let turn = shift * (0.5 * mx).powi(2);
            for (i, pull) in [turn, turn, shift, shift].into_iter().enumerate() {
                normal[i][i] += pull;
                right[i] += pull * (self.last.motion[i] - fit.motion[i]).clamp(-1.0, 1.0);
            }
            let step = solve(normal, right)?;
            fit.motion
                .iter_mut()
                .zip(step)
                .for_each(|(value, step)| *value += step);
            let [a, b, x, y] = fit.motion;
            if a.abs() > 0.2
                || b.abs() > 0.2
                || (x - start[2]).abs() > 6.0
                || (y - start[3]).abs() > 6.0
            {
                return None;
            }
            if step[2].abs().max(step[3].abs()) < 1e-3 {
                break;
            }
        }
        Some(fit)
    }

    /// From cells around the middle to pixels around the corner; a cell's center lies half a cell
    /// in.
    fn in_frame(&self, [a, b, x, y]: [f64; 4]) -> Motion {
        let cell = self.now.cell as f64;
        let (mx, my) = (self.now.columns as f64 / 2.0, self.now.rows as f64 / 2.0);
        let (cx, cy) = ((mx + 0.5) * cell - 0.5, (my + 0.5) * cell - 0.5);
        Motion {
            a,
            b,
            x: x * cell - a * cx + b * cy,
            y: y * cell - b * cx - a * cy,
        }
    }
}

/// The cells that a box covers.
struct Hole(Option<[f64; 4]>);

impl Hole {
    fn new(bbox: Option<&FrameBox>, cell: usize) -> Hole {
        Hole(bbox.map(|b| {
            let cell = cell as f64;
            let (w, h) = (0.6 * f64::from(b.w), 0.6 * f64::from(b.h));
            let (cx, cy) = (f64::from(b.cx), f64::from(b.cy));
            [
                (cx - w) / cell - 1.0,
                (cy - h) / cell - 1.0,
                (cx + w) / cell,
                (cy + h) / cell,
            ]
        }))
    }

    /// Weight of a cell by its distance from the middle; 1 everywhere without a box.
    fn nearness(&self, column: f64, row: f64, half: f64) -> f64 {
        self.0.map_or(1.0, |[x0, y0, x1, y1]| {
            let (dx, dy) = (column - 0.5 * (x0 + x1), row - 0.5 * (y0 + y1));
            half * half / (half * half + dx * dx + dy * dy)
        })
    }

    fn contains(&self, column: f64, row: f64) -> bool {
        self.0
            .is_some_and(|[x0, y0, x1, y1]| column >= x0 && column <= x1 && row >= y0 && row <= y1)
    }
}

/// Solves four equations by elimination with pivots; `None` if they are (nearly) dependent.
fn solve(mut m: [[f64; 4]; 4], mut r: [f64; 4]) -> Option<[f64; 4]> {
    for i in 0..4 {
        let pivot = (i..4).max_by(|&a, &b| m[a][i].abs().total_cmp(&m[b][i].abs()))?;
        m.swap(i, pivot);
        r.swap(i, pivot);
        if m[i][i].abs() < 1e-6 {
            return None;
        }
        for j in i + 1..4 {
            let factor = m[j][i] / m[i][i];
            let upper = m[i];
            for (lower, upper) in m[j].iter_mut().zip(upper).skip(i) {
                *lower -= factor * upper;
            }
            r[j] -= factor * r[i];
        }
    }
    for i in (0..4).rev() {
        let known: f64 = (i + 1..4).map(|j| m[i][j] * r[j]).sum();
        r[i] = (r[i] - known) / m[i][i];
    }
    r.iter().all(|v| v.is_finite()).then_some(r)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::ChannelOrder;

    const WIDTH: usize = 320;
    const HEIGHT: usize = 180;

    /// Smooth texture as seen after `motion`: the pixel at `motion(p)` shows what was at `p`.
    fn picture(motion: &Motion) -> Vec<u8> {
        let det = (1.0 + motion.a).powi(2) + motion.b.powi(2);
        let mut out = Vec::with_capacity(WIDTH * HEIGHT);
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let (u, v) = (x as f64 - motion.x, y as f64 - motion.y);
                let (u, v) = (
                    ((1.0 + motion.a) * u + motion.b * v) / det,
                    ((1.0 + motion.a) * v - motion.b * u) / det,
                );
                let wave = (0.071 * u).sin()
                    + (0.093 * v + 1.0).sin()
                    + (0.05 * (u + v)).cos() * (0.031 * u).sin();
                out.push((128.0 + 35.0 * wave) as u8);
            }
        }
        out
    }

    fn found(motion: &Motion) -> Motion {
        let mut camera = CameraMotion::default();
        let (a, b) = (picture(&Motion::default()), picture(motion));
        let frame = |data| Frame::new(data, WIDTH, HEIGHT, ChannelOrder::Gray).unwrap();
        assert_eq!(camera.observe(&frame(&a), None), Motion::default());
        camera.observe(&frame(&b), None)
    }

    #[test]
    fn moved_picture_gives_its_shift_turn_and_zoom() {
        for truth in [
            Motion::default(),
            Motion::shift(3.0, -2.0),
            Motion::shift(-31.0, 14.5),
            Motion {
                a: 0.02,
                b: -0.015,
                x: 5.0,
                y: 3.0,
            },
        ] {
            let motion = found(&truth);
            for (x, y) in [(40.0, 30.0), (160.0, 90.0), (280.0, 150.0)] {
                let ((ax, ay), (bx, by)) = (truth.apply(x, y), motion.apply(x, y));
                assert!(
                    (ax - bx).hypot(ay - by) < 0.6,
                    "{truth:?} found as {motion:?}"
                );
            }
        }
    }

    /// A bridge that looks the same all along, as seen after a shift.
    fn bridge((dx, dy): (f64, f64)) -> Vec<u8> {
        let across =
            |i: usize| (((i / WIDTH) as f64 - dy) + 0.25 * ((i % WIDTH) as f64 - dx) - 110.0).abs();
        (0..WIDTH * HEIGHT)
            .map(|i| if across(i) < 35.0 { 190 } else { 90 })
            .collect()
    }

    #[test]
    fn foggy_edge_keeps_the_motion_steady() {
        let mut camera = CameraMotion::default();
        for i in 0..70 {
            // Fog hides the ground little by little. In the end nothing tells one place along the
            // bridge from another, and the view of it that fits best is 60 pixels off.
            let (n, fog) = (f64::from(i), (f64::from(i) / 40.0).min(1.0));
            let (ground, bridge) = (picture(&Motion::shift(2.0 * n, n)), bridge((2.0 * n, n)));
            let mix =
                |(g, b): (&u8, &u8)| (f64::from(*g) * (1.0 - fog) + f64::from(*b) * fog) as u8;
            let data: Vec<u8> = ground.iter().zip(&bridge).map(mix).collect();
            let motion = camera.observe(
                &Frame::new(&data, WIDTH, HEIGHT, ChannelOrder::Gray).unwrap(),
                None,
            );
            let (x, y) = motion.apply(160.0, 90.0);
            let slip = (x - 162.0).hypot(y - 91.0);
            assert!(i == 0 || slip < 5.0, "frame {i}: {motion:?}");
        }
    }

    #[test]
    fn odd_frames_give_no_motion() {
        let mut camera = CameraMotion::default();
        for (w, h) in [(1, 1), (7, 300), (640, 2), (33, 33), (33, 33)] {
            let data = vec![77u8; w * h];
            let motion =
                camera.observe(&Frame::new(&data, w, h, ChannelOrder::Gray).unwrap(), None);
            assert_eq!(motion, Motion::default(), "{w}x{h}");
        }
    }

    #[test]
    fn independent_equations_are_solved_and_dependent_ones_refused() {
        let m = [
            [0.0, 2.0, 0.0, 1.0],
            [1.0, 0.0, 0.0, 0.0],
            [0.0, 0.0, 3.0, 0.0],
            [0.0, 1.0, 0.0, 4.0],
        ];
        let x = solve(m, [8.0, 5.0, 9.0, 18.0]).unwrap();
        for (found, expected) in x.into_iter().zip([5.0, 2.0, 3.0, 4.0]) {
            assert!((found - expected).abs() < 1e-12);
        }
        assert_eq!(solve([[1.0; 4]; 4], [1.0; 4]), None);
    }
}
