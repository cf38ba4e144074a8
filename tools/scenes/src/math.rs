//! Vectors, colors and a sine that gives the same bits on every machine.

use std::f32::consts::TAU;
use std::ops::{Add, Mul, Sub};

/// A point or direction in meters: x and y on the ground, z up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct V3 {
    pub x: f32,
    pub y: f32,
    pub z: f32,
}

/// Red, green, blue, 0..255.
pub(crate) type Rgb = [f32; 3];

pub(crate) const fn v3(x: f32, y: f32, z: f32) -> V3 {
    V3 { x, y, z }
}

impl Add for V3 {
    type Output = V3;
    fn add(self, o: V3) -> V3 {
        v3(self.x + o.x, self.y + o.y, self.z + o.z)
    }
}

impl Sub for V3 {
    type Output = V3;
    fn sub(self, o: V3) -> V3 {
        v3(self.x - o.x, self.y - o.y, self.z - o.z)
    }
}

impl Mul<f32> for V3 {
    type Output = V3;
    fn mul(self, k: f32) -> V3 {
        v3(self.x * k, self.y * k, self.z * k)
    }
}

impl V3 {
    pub fn dot(self, o: V3) -> f32 {
        self.x * o.x + self.y * o.y + self.z * o.z
    }

    pub fn cross(self, o: V3) -> V3 {
        v3(
            self.y * o.z - self.z * o.y,
            self.z * o.x - self.x * o.z,
            self.x * o.y - self.y * o.x,
        )
    }

    pub fn length(self) -> f32 {
        self.dot(self).sqrt()
    }

    /// The direction of `self`; x for a vector too short to have one.
    pub fn unit(self) -> V3 {
        let length = self.length();
        if length > 1e-9 {
            self * (1.0 / length)
        } else {
            v3(1.0, 0.0, 0.0)
        }
    }

    /// Turned about the z axis by the angle whose cosine and sine are given.
    pub fn turned(self, cos: f32, sin: f32) -> V3 {
        v3(
            self.x * cos - self.y * sin,
            self.x * sin + self.y * cos,
            self.z,
        )
    }
}

/// Sine of an angle in turns, by a polynomial that gives the same bits on every platform.
pub(crate) fn sin_turns(turns: f32) -> f32 {
    let mut r = turns - floor(turns + 0.5) as f32;
    if r > 0.25 {
        r = 0.5 - r;
    } else if r < -0.25 {
        r = -0.5 - r;
    }
    let a = r * TAU;
    let q = a * a;
    a * (1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0))))
}

/// Cosine of an angle in turns.
pub(crate) fn cos_turns(turns: f32) -> f32 {
    sin_turns(turns + 0.25)
}

/// The largest whole number not above `v`, without the library call of `f32::floor`.
#[inline(always)]
pub(crate) fn floor(v: f32) -> i32 {
    let i = v as i32;
    i - i32::from(i as f32 > v)
}

/// The smallest whole number not below `v`, and not below 0.
#[inline(always)]
pub(crate) fn ceil(v: f32) -> usize {
    let i = v.max(0.0) as usize;
    i + usize::from((i as f32) < v)
}

/// `v` modulo `period`, in 0..period.
#[inline(always)]
pub(crate) fn wrap(v: f32, period: f32) -> f32 {
    v - period * floor(v / period) as f32
}

/// 0 below `a`, 1 above `b`, smooth between.
pub(crate) fn smooth_step(a: f32, b: f32, x: f32) -> f32 {
    let t = ((x - a) / (b - a)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

pub(crate) fn lerp(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

pub(crate) fn mix(a: Rgb, b: Rgb, t: f32) -> Rgb {
    [
        lerp(a[0], b[0], t),
        lerp(a[1], b[1], t),
        lerp(a[2], b[2], t),
    ]
}

pub(crate) fn scaled(c: Rgb, k: f32) -> Rgb {
    [c[0] * k, c[1] * k, c[2] * k]
}

/// Packs a color as 0xAABBGGRR, clamping each channel.
pub(crate) fn pack(c: Rgb, alpha: u32) -> u32 {
    let byte = |v: f32| (v + 0.5).clamp(0.0, 255.0) as u32;
    byte(c[0]) | byte(c[1]) << 8 | byte(c[2]) << 16 | alpha << 24
}

/// All four bytes of `a` and `b` mixed, `t` in 0..=256.
#[inline(always)]
pub(crate) fn lerp_packed(a: u32, b: u32, t: u32) -> u32 {
    const M: u32 = 0x00ff_00ff;
    let s = 256 - t;
    let even = ((a & M) * s + (b & M) * t) >> 8 & M;
    let odd = (((a >> 8) & M) * s + ((b >> 8) & M) * t) & !M;
    even | odd
}

/// The low byte of every 16-bit lane.
const LANES: u64 = 0x00ff_00ff_00ff_00ff;

/// A packed color with a 16-bit lane for each byte, so that all four can be weighed in one
/// multiplication.
#[inline(always)]
pub(crate) fn spread(c: u32) -> u64 {
    u64::from(c & 0x00ff_00ff) | u64::from(c & 0xff00_ff00) << 24
}

/// The packed color of [`spread`] lanes.
#[inline(always)]
pub(crate) fn gathered(lanes: u64) -> u32 {
    lanes as u32 & 0x00ff_00ff | (lanes >> 24) as u32 & 0xff00_ff00
}

/// Lanes of `a` and `b` mixed, `t` in 0..=256.
#[inline(always)]
pub(crate) fn lerp_lanes(a: u64, b: u64, t: u32) -> u64 {
    (a * u64::from(256 - t) + b * u64::from(t)) >> 8 & LANES
}

/// The mean of four neighboring texels, weighed by the place between them (`a` across, `b` down,
/// 0..256), as lanes.
#[inline(always)]
pub(crate) fn bilinear(top: &[u32], low: &[u32], a: u32, b: u32) -> u64 {
    let both = (a * b) >> 8;
    let weighed = |c: u32, w: u32| spread(c) * u64::from(w);
    let sum = weighed(top[0], 256 - a - b + both)
        + weighed(top[1], a - both)
        + weighed(low[0], b - both)
        + weighed(low[1], both);
    sum >> 8 & LANES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_follows_the_real_one() {
        for i in -400..400 {
            let turns = i as f32 * 0.017;
            let real = (f64::from(turns) * std::f64::consts::TAU).sin();
            assert!((f64::from(sin_turns(turns)) - real).abs() < 2e-5, "{turns}");
        }
    }

    #[test]
    fn floor_ceil_and_wrap_agree_with_the_standard_library() {
        for v in [-2.5, -2.0, -0.1, 0.0, 0.9, 1.0, 7.3f32] {
            assert_eq!(floor(v) as f32, v.floor());
            assert_eq!(ceil(v) as f32, v.ceil().max(0.0));
            assert!((wrap(v, 1.7) - v.rem_euclid(1.7)).abs() < 1e-6);
        }
        assert_eq!(ceil(f32::NAN), 0);
    }

    #[test]
    fn lanes_hold_a_color_and_corners_are_exact() {
        let c = 0x8012_fe7f;
        let d = 0xffff_ffff;
        assert_eq!(gathered(spread(c)), c);
        assert_eq!(gathered(lerp_lanes(spread(c), spread(d), 256)), d);
        assert_eq!(gathered(bilinear(&[c, d], &[d, d], 0, 0)), c);
        assert_eq!(gathered(bilinear(&[d, d], &[d, d], 77, 200)), d);
    }

    #[test]
    fn packed_lerp_reaches_both_ends() {
        let (a, b) = (0x01ff_8000, 0xff00_40fe);
        assert_eq!(lerp_packed(a, b, 0), a);
        assert_eq!(lerp_packed(a, b, 256), b);
        assert_eq!(lerp_packed(0x0000_0000, 0x6464_6464, 128), 0x3232_3232);
    }
}
