//! The only source of chance: a small generator, an integer hash and a tileable noise table.

use std::sync::OnceLock;

use crate::math::{floor, lerp};

/// Sebastiano Vigna's SplitMix64: a generator of 64 bits of state, for all crates that depend on
/// this one.
#[derive(Clone, Debug)]
pub struct SplitMix64(pub u64);

impl SplitMix64 {
    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }
}

/// The random choices of a flight.
pub(crate) struct Rng(SplitMix64);

impl Rng {
    /// `stream` separates the uses of one seed, so that drawing more in one place does not change
    /// another.
    pub fn new(seed: u64, stream: u64) -> Rng {
        let mut rng = SplitMix64(seed ^ stream.wrapping_mul(0xd134_2543_de82_ef95));
        rng.bits();
        Rng(rng)
    }

    pub fn next(&mut self) -> u64 {
        self.0.bits()
    }

    /// 0..1.
    pub fn unit(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }

    pub fn range(&mut self, a: f32, b: f32) -> f32 {
        a + (b - a) * self.unit()
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }

    pub fn chance(&mut self, p: f32) -> bool {
        self.unit() < p
    }

    pub fn sign(&mut self) -> f32 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    pub fn pick<T: Copy>(&mut self, from: &[T]) -> T {
        from[self.below(from.len())]
    }
}

/// A well-mixed 32-bit hash of two integers and a salt.
#[inline(always)]
pub(crate) fn hash(a: i32, b: i32, salt: u32) -> u32 {
    let mut h = (a as u32).wrapping_mul(0x9e37_79b1) ^ (b as u32).wrapping_mul(0x85eb_ca77) ^ salt;
    h = (h ^ h >> 15).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ h >> 12).wrapping_mul(0x297a_2d39);
    h ^ h >> 15
}

/// `hash` as a number in 0..1.
#[inline(always)]
pub(crate) fn hash_unit(a: i32, b: i32, salt: u32) -> f32 {
    (hash(a, b, salt) >> 8) as f32 / (1 << 24) as f32
}

/// Side of the noise table; it repeats after as many units.
pub(crate) const NOISE_SIDE: usize = 512;

/// Fractal value noise, about -1..1, its coarsest cells 64 units wide, repeating after
/// [`NOISE_SIDE`] units.
pub(crate) struct Noise(Vec<f32>);

impl Noise {
    /// The one table, made at first use.
    pub fn table() -> &'static Noise {
        static TABLE: OnceLock<Noise> = OnceLock::new();
        TABLE.get_or_init(Noise::new)
    }

    fn new() -> Noise {
        let mut cells = vec![0.0; NOISE_SIDE * NOISE_SIDE];
        let mut amplitude = 0.55;
        for octave in 0..6 {
            let count = 8 << octave;
            let size = (NOISE_SIDE / count) as f32;
            let knot = |i: usize, j: usize| {
                hash_unit((i % count) as i32, (j % count) as i32, octave as u32) * 2.0 - 1.0
            };
            for (at, cell) in cells.iter_mut().enumerate() {
                let (u, v) = (
                    (at % NOISE_SIDE) as f32 / size,
                    (at / NOISE_SIDE) as f32 / size,
                );
                let (i, j) = (u as usize, v as usize);
                let ease = |t: f32| t * t * (3.0 - 2.0 * t);
                let (a, b) = (ease(u - i as f32), ease(v - j as f32));
                let top = lerp(knot(i, j), knot(i + 1, j), a);
                let low = lerp(knot(i, j + 1), knot(i + 1, j + 1), a);
                *cell += amplitude * lerp(top, low, b);
            }
            amplitude *= 0.62;
        }
        Noise(cells)
    }

    /// Bilinear look-up.
    #[inline(always)]
    pub fn at(&self, u: f32, v: f32) -> f32 {
        const MASK: i32 = NOISE_SIDE as i32 - 1;
        let (i, j) = (floor(u), floor(v));
        let (fu, fv) = (i as f32, j as f32);
        let cell = |i: i32, j: i32| self.0[(j & MASK) as usize * NOISE_SIDE + (i & MASK) as usize];
        let top = lerp(cell(i, j), cell(i + 1, j), u - fu);
        let low = lerp(cell(i, j + 1), cell(i + 1, j + 1), u - fu);
        lerp(top, low, v - fv)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn generator_matches_the_reference_implementation() {
        // Its first value for state 0.
        assert_eq!(SplitMix64(0).bits(), 0xe220_a839_7b1d_cdaf);
    }

    #[test]
    fn noise_repeats_after_its_side_and_varies() {
        let noise = Noise::table();
        let side = NOISE_SIDE as f32;
        assert_eq!(noise.at(3.25, 7.5), noise.at(3.25 + side, 7.5 - side));
        let values: Vec<f32> = (0..1000)
            .map(|i| noise.at(i as f32 * 37.3, i as f32 * 11.9))
            .collect();
        assert!(values.iter().any(|&v| v > 0.4) && values.iter().any(|&v| v < -0.4));
        assert!(values.iter().all(|v| v.abs() < 1.8));
    }
}
