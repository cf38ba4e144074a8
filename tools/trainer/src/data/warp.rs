//! Sampling a picture on an affine grid: `out[j, i] = bilinear(picture, origin + i across + j down)`.
//!
//! `u8 [h, w, 3]` RGB -> `u8 [side, side, 3]` BGR; each tap outside the picture is replaced by its border color. On an
//! upright square grid the result is that of the tracker's own cropper.

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
pub fn warp(picture: &Picture, grid: &Grid) -> Vec<u8> {
    let mut out = vec![0; grid.side * grid.side * 3];
    let (width, height) = (picture.width, picture.height);
    // Beyond these coordinates a tap lies outside the picture. The last pixel of the bytes is left to the careful path,
    // since the fast one reads four bytes for a pixel of three.
    let (right, bottom) = ((width - 1) as f64, (height - 1) as f64);
    let end = picture.data.len();
    for (j, row) in out.chunks_exact_mut(grid.side * 3).enumerate() {
        let start = [0, 1].map(|k| grid.origin[k] + grid.down[k] * j as f64);
        for (i, out) in row.chunks_exact_mut(3).enumerate() {
            let x = start[0] + grid.across[0] * i as f64;
            let y = start[1] + grid.across[1] * i as f64;
            if x >= 0.0 && x < right && y >= 0.0 && y < bottom {
                // Truncation is the floor of what is not negative, without a call of a library.
                let (left, top) = (x as u32, y as u32);
                let (dx, dy) = ((x - f64::from(left)) as f32, (y - f64::from(top)) as f32);
                let upper = (top as usize * width + left as usize) * 3;
                let lower = upper + width * 3;
                if lower + 7 <= end {
                    let taps = [upper, upper + 3, lower, lower + 3]
                        .map(|at| pixel(&picture.data[at..at + 4]));
                    let [r, g, b, _] = blend_pixels(taps, dx, dy);
                    out.copy_from_slice(&[b, g, r]);
                    continue;
                }
            }
            edge(picture, x, y, out);
        }
    }
    out
}

/// The four bytes at a pixel as numbers: its three channels, and one of the next pixel.
#[inline(always)]
fn pixel(bytes: &[u8]) -> [f32; 4] {
    [0, 1, 2, 3].map(|k| f32::from(bytes[k]))
}

/// [`blend`] of four channels at once, which compiles to vector instructions.
#[inline(always)]
fn blend_pixels(taps: [[f32; 4]; 4], x: f32, y: f32) -> [u8; 4] {
    let [a, b, c, d] = taps;
    [0, 1, 2, 3].map(|k| {
        let left = a[k] + (c[k] - a[k]) * y;
        let right = b[k] + (d[k] - b[k]) * y;
        let value = left + (right - left) * x;
        (value + ROUNDING).to_bits() as u8
    })
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

/// Bilinear blend of `[top left, top right, bottom left, bottom right]`, rounded to the nearest byte.
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
    fn upright_grids_give_the_trackers_crop() {
        let picture = noise(90, 70);
        for (cx, cy, w, h, side) in [
            (40.3, 35.1, 20.0, 14.0, 127),
            (5.0, 66.6, 31.0, 9.0, 303),
            (-90.0, 20.0, 9.0, 9.0, 127),
        ] {
            let target = FrameBox { cx, cy, w, h };
            let region = Region::around(&target, scale(f64::from(w), f64::from(h), 0.5, 127), side);
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
    fn slanted_grids_give_the_same_inside_and_at_the_edge() {
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
    fn turns_and_mirrors() {
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
