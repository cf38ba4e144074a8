//! Sampling a picture on an affine grid:
//! `out[j, i] = bilinear(picture, origin + i across + j down)`.
//!
//! `u8 [h, w, 3]` RGB -> `u8 [side, side, 3]` BGR; each tap outside the picture is replaced by its
//! border color. On an upright square grid the result is that of the tracker's own cropper.

use super::picture::Picture;

/// Where the samples are taken, in picture pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Of output pixel (0, 0).
    pub origin: [f64; 2],
    /// From one output column to the next.
    pub across: [f64; 2],
    /// From one output row to the next.
    pub down: [f64; 2],
    /// Side of the output.
    pub side: usize,
}

impl Grid {
    /// Whether an output pixel lies within a picture.
    pub fn meets(&self, picture: &Picture, column: usize, row: usize) -> bool {
        let at =
            |k: usize| self.origin[k] + self.across[k] * column as f64 + self.down[k] * row as f64;
        let within = |at: f64, limit: usize| (0.0..=(limit - 1) as f64).contains(&at);
        within(at(0), picture.width) && within(at(1), picture.height)
    }
}

/// Samples `picture` on `grid`.
///
/// Pseudo-code: for each row, find the run of pixels whose four taps lie inside; gather its taps by
/// channel and corner; blend each channel as one vector loop; treat the pixels beside the run one
/// by one. A slanted line meets the picture in one run, since pictures are convex.
pub fn warp(picture: &Picture, grid: &Grid) -> Vec<u8> {
    let side = grid.side;
    let mut out = vec![0; side * side * 3];
    let mut run = Run::new(side);
    // Beyond these coordinates a tap lies outside.
    let right = (picture.width - 1) as f64;
    let bottom = (picture.height - 1) as f64;
    for (j, row) in out.chunks_exact_mut(side * 3).enumerate() {
        let start = [0, 1].map(|k| grid.origin[k] + grid.down[k] * j as f64);
        let at = |i: usize| {
            let x = start[0] + grid.across[0] * i as f64;
            let y = start[1] + grid.across[1] * i as f64;
            [x, y]
        };
        let is_inside = |i: usize| {
            let [x, y] = at(i);
            x >= 0.0 && x < right && y >= 0.0 && y < bottom
        };
        let first = (0..side).position(is_inside).unwrap_or(side);
        let count = (first..side)
            .rposition(is_inside)
            .map_or(0, |last| last + 1);
        run.gather(picture, count, |i| at(first + i));
        run.blend(&mut row[first * 3..(first + count) * 3]);
        for i in (0..first).chain(first + count..side) {
            let [x, y] = at(i);
            let pixel = &mut row[i * 3..][..3];
            let is_outside = x < -1.0 || x >= right + 1.0 || y < -1.0 || y >= bottom + 1.0;
            if is_outside {
                pixel.copy_from_slice(&picture.border);
            } else {
                edge(picture, x, y, pixel);
            }
        }
    }
    out
}

/// Taps of a run of output pixels, a list for each channel and corner, and where the pixels lie
/// between them.
struct Run {
    taps: [[Vec<u8>; 4]; 3],
    x: Vec<f32>,
    y: Vec<f32>,
    planes: [Vec<u8>; 3], // the blended channels
}

impl Run {
    /// Room for a run of `length` pixels.
    fn new(length: usize) -> Run {
        let corners = || [(); 4].map(|()| vec![0; length]);
        Run {
            taps: [(); 3].map(|()| corners()),
            x: vec![0.0; length],
            y: vec![0.0; length],
            planes: [(); 3].map(|()| vec![0; length]),
        }
    }

    /// Reads the taps of `count` pixels whose taps all lie inside the picture.
    fn gather(&mut self, picture: &Picture, count: usize, at: impl Fn(usize) -> [f64; 2]) {
        let pitch = 3 * picture.width;
        let [red, green, blue] = &mut self.taps;
        // Slices of one known length spare the loop its bounds checks.
        let [red, green, blue] = [red, green, blue].map(|corners| {
            let [a, b, c, d] = corners;
            [a, b, c, d].map(|list| &mut list[..count])
        });
        let (xs, ys) = (&mut self.x[..count], &mut self.y[..count]);
        for i in 0..count {
            let [x, y] = at(i);
            // Truncation is the floor of what is not negative, without a call of a library.
            let (left, top) = (x as i32, y as i32);
            xs[i] = (x - f64::from(left)) as f32;
            ys[i] = (y - f64::from(top)) as f32;
            let place = top as usize * pitch + left as usize * 3;
            let upper = &picture.data[place..place + 6];
            let lower = &picture.data[place + pitch..place + pitch + 6];
            (red[0][i], green[0][i], blue[0][i]) = (upper[0], upper[1], upper[2]);
            (red[1][i], green[1][i], blue[1][i]) = (upper[3], upper[4], upper[5]);
            (red[2][i], green[2][i], blue[2][i]) = (lower[0], lower[1], lower[2]);
            (red[3][i], green[3][i], blue[3][i]) = (lower[3], lower[4], lower[5]);
        }
    }

    /// Blends the taps into BGR pixels.
    fn blend(&mut self, out: &mut [u8]) {
        let count = out.len() / 3;
        let (x, y) = (&self.x[..count], &self.y[..count]);
        for (corners, plane) in self.taps.iter().zip(&mut self.planes) {
            let [a, b, c, d] = corners.each_ref().map(|list| &list[..count]);
            // Only numbers in this loop: it compiles to vector instructions.
            for (i, value) in plane[..count].iter_mut().enumerate() {
                *value = blend([a[i], b[i], c[i], d[i]], x[i], y[i]);
            }
        }
        let [red, green, blue] = self.planes.each_ref().map(|plane| &plane[..count]);
        for (i, pixel) in out.chunks_exact_mut(3).enumerate() {
            pixel.copy_from_slice(&[blue[i], green[i], red[i]]);
        }
    }
}

/// One output pixel of which a tap may lie outside the picture.
fn edge(picture: &Picture, x: f64, y: f64, out: &mut [u8]) {
    let (w, h) = (picture.width as i64, picture.height as i64);
    let (left, top) = (x.floor(), y.floor());
    let (x, y) = ((x - left) as f32, (y - top) as f32);
    let (left, top) = (left as i64, top as i64);
    for (channel, out) in out.iter_mut().enumerate() {
        let tap = |dx: i64, dy: i64| {
            let (x, y) = (left.saturating_add(dx), top.saturating_add(dy));
            if !(0..w).contains(&x) || !(0..h).contains(&y) {
                return picture.border[channel];
            }
            picture.data[(y as usize * picture.width + x as usize) * 3 + 2 - channel]
        };
        *out = blend([tap(0, 0), tap(1, 0), tap(0, 1), tap(1, 1)], x, y);
    }
}

/// Added to a number from 0 to 255, it leaves the rounded value in the low bits: 2^23.
const ROUNDING: f32 = 8_388_608.0;

/// Bilinear blend of `[top left, top right, bottom left, bottom right]`, rounded to the nearest
/// byte.
#[inline(always)]
pub(super) fn blend(taps: [u8; 4], x: f32, y: f32) -> u8 {
    let [a, b, c, d] = taps.map(f32::from);
    let (left, right) = (a + (c - a) * y, b + (d - b) * y);
    let value = left + (right - left) * x;
    (value + ROUNDING).to_bits() as u8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use kernels::Isa;
    use kernels::par::Threads;
    use track_cpu::bbox::FrameBox;
    use track_cpu::crop::{Cropper, Region, scale};

    fn noise(width: usize, height: usize) -> Picture {
        let mut rng = Rng::new(5, 0, 0);
        Picture::new(
            width,
            height,
            (0..3 * width * height).map(|_| rng.bits() as u8).collect(),
        )
    }

    #[test]
    fn upright_grid_gives_the_trackers_crop() {
        let picture = noise(90, 70);
        for (cx, cy, w, h, side) in [
            (40.3, 35.1, 20.0, 14.0, 127),
            (5.0, 66.6, 31.0, 9.0, 303),
            (-90.0, 20.0, 9.0, 9.0, 127),
        ] {
            let target = FrameBox { cx, cy, w, h };
            let region = Region::around(
                &target,
                scale(f64::from(w), f64::from(h), 0.5, 127),
                1.0,
                side,
            );
            let mut expected = vec![0; side * side * 3];
            Cropper::default().cut(
                Isa::detect(),
                &Threads::new(1),
                &picture.frame(),
                &region,
                picture.border,
                &mut expected,
            );
            let step = (region.side - 1.0) / (side - 1) as f64;
            let reach = (region.side - 1.0) / 2.0;
            let grid = Grid {
                origin: [region.cx - reach, region.cy - reach],
                across: [step, 0.0],
                down: [0.0, step],
                side,
            };
            assert!(warp(&picture, &grid) == expected, "{target:?}");
        }
    }

    #[test]
    fn slanted_grid_equals_sampling_pixel_by_pixel() {
        let picture = noise(61, 47);
        let mut rng = Rng::new(6, 0, 0);
        for _ in 0..40 {
            let mut random = |reach: f32| f64::from(rng.range(-reach, reach));
            let grid = Grid {
                origin: [30.0 + random(50.0), 23.0 + random(40.0)],
                across: [random(1.2), random(1.2)],
                down: [random(1.2), random(1.2)],
                side: 49,
            };

            let found = warp(&picture, &grid);

            let mut expected = vec![0; 49 * 49 * 3];
            for (i, out) in expected.chunks_exact_mut(3).enumerate() {
                let (column, row) = ((i % 49) as f64, (i / 49) as f64);
                let start = [0, 1].map(|k| grid.origin[k] + grid.down[k] * row);
                let at = [0, 1].map(|k| start[k] + grid.across[k] * column);
                edge(&picture, at[0], at[1], out);
            }
            assert!(found == expected, "{grid:?}");
        }
    }

    #[test]
    fn quarter_turn_and_mirror_move_whole_pixels() {
        let picture = noise(9, 9);
        let pixel = |x: usize, y: usize| {
            let p = &picture.data[(y * 9 + x) * 3..][..3];
            [p[2], p[1], p[0]]
        };
        let turned = warp(
            &picture,
            &Grid {
                origin: [8.0, 0.0],
                across: [0.0, 1.0],
                down: [-1.0, 0.0],
                side: 9,
            },
        );
        let mirrored = warp(
            &picture,
            &Grid {
                origin: [8.0, 0.0],
                across: [-1.0, 0.0],
                down: [0.0, 1.0],
                side: 9,
            },
        );
        for j in 0..9 {
            for i in 0..9 {
                assert_eq!(turned[(j * 9 + i) * 3..][..3], pixel(8 - j, i));
                assert_eq!(mirrored[(j * 9 + i) * 3..][..3], pixel(8 - i, j));
            }
        }
    }
}
