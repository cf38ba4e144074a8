//! Random numbers of the shapes that this program needs.

use scenes::SplitMix64;

/// Random numbers from a seed.
#[derive(Clone, Debug)]
pub struct Chance(SplitMix64);

impl Chance {
    /// Numbers that this seed alone decides.
    pub fn new(seed: u64) -> Chance {
        Chance(SplitMix64(seed))
    }

    /// A number in `[0, 1)`.
    pub fn unit(&mut self) -> f32 {
        (self.0.bits() >> 40) as f32 / (1 << 24) as f32
    }

    /// An index below `n`; 0 if `n` is.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.unit() * n as f32) as usize).min(n.saturating_sub(1))
    }

    /// A number in `[low, high)`.
    pub fn between(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// A number of mean 0 and variance 1: the sum of twelve uniform ones.
    pub fn normal(&mut self) -> f32 {
        let mut sum = -6.0;
        for _ in 0..12 {
            sum += self.unit();
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_a_seed_have_the_stated_range_and_moments() {
        let mut chance = Chance::new(7);

        let units: Vec<f32> = (0..4000).map(|_| chance.unit()).collect();
        let normals: Vec<f32> = (0..4000).map(|_| chance.normal()).collect();

        assert!(units.iter().all(|u| (0.0..1.0).contains(u)));
        let mean = |values: &[f32]| values.iter().sum::<f32>() / values.len() as f32;
        assert!((mean(&units) - 0.5).abs() < 0.02);
        assert!(mean(&normals).abs() < 0.05);
        let squares: Vec<f32> = normals.iter().map(|n| n * n).collect();
        assert!((mean(&squares) - 1.0).abs() < 0.1);
        assert_eq!(Chance::new(7).unit(), Chance::new(7).unit());
        assert_eq!(chance.below(0), 0);
    }
}
