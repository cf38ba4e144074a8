//! Random numbers that are independent of restarts and thread timing: one generator per sample.

use scenes::SplitMix64;
use std::f32::consts::TAU;

/// [`SplitMix64`] with the distributions that training draws from.
///
/// A sample's generator is made from the run's seed and the sample's index alone, so that it does
/// not matter which thread makes it, when, or after which restart.
#[derive(Clone, Debug)]
pub struct Rng(SplitMix64);

impl Rng {
    /// The generator of number `index` in the `stream` of a `seed`.
    pub fn new(seed: u64, stream: u64, index: u64) -> Rng {
        let mut mixed = SplitMix64(seed);
        for part in [stream, index] {
            mixed = SplitMix64(mixed.bits() ^ part.wrapping_mul(0xd134_2543_de82_ef95));
        }
        Rng(SplitMix64(mixed.bits()))
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// Uniform in `[0, 1)`.
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1u32 << 24) as f32
    }

    /// Uniform in `[low, high)`.
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }

    /// Uniform in its logarithm, in `[low, high)`; both above 0.
    pub fn log_range(&mut self, low: f32, high: f32) -> f32 {
        self.range(low.ln(), high.ln()).exp()
    }

    /// `exp(u)` with `u` uniform within `reach` of 0: a factor that is as likely as its inverse.
    pub fn factor(&mut self, reach: f32) -> f32 {
        self.range(-reach, reach).exp()
    }

    /// One of `0..n`; `n` is above 0.
    pub fn below(&mut self, n: usize) -> usize {
        ((u128::from(self.bits()) * n as u128) >> 64) as usize
    }

    /// Whether something of probability `p` happens.
    pub fn chance(&mut self, p: f32) -> bool {
        self.unit() < p
    }

    /// Whether something of probability `p` happens; draws no bits where `p` is 0, so that samples
    /// of older options stay.
    pub fn sometimes(&mut self, p: f32) -> bool {
        p > 0.0 && self.chance(p)
    }

    /// One of some; there is at least one.
    pub fn pick<'a, T>(&mut self, from: &'a [T]) -> &'a T {
        &from[self.below(from.len())]
    }

    /// An index, as likely as its share of the weights; `cumulative` holds their running sums, the
    /// last above 0.
    pub fn weighted(&mut self, cumulative: &[f64]) -> usize {
        let total = cumulative.last().copied().unwrap_or_default();
        let at = (self.bits() >> 11) as f64 / (1u64 << 53) as f64 * total;
        cumulative
            .partition_point(|sum| *sum <= at)
            .min(cumulative.len().saturating_sub(1))
    }

    /// Normal with mean 0 and variance 1.
    pub fn normal(&mut self) -> f32 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (TAU * self.unit()).cos()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_and_normal_numbers_have_their_moments() {
        let mut rng = Rng::new(1, 2, 3);
        let n = 20_000;
        let (mut sum, mut squares, mut normal_sum, mut normal_squares) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..n {
            let (u, z) = (f64::from(rng.unit()), f64::from(rng.normal()));
            assert!((0.0..1.0).contains(&u));
            sum += u;
            squares += u * u;
            normal_sum += z;
            normal_squares += z * z;
        }
        let n = f64::from(n);
        assert!((sum / n - 0.5).abs() < 0.01 && (squares / n - 1.0 / 3.0).abs() < 0.01);
        assert!((normal_sum / n).abs() < 0.03 && (normal_squares / n - 1.0).abs() < 0.05);
    }

    #[test]
    fn weighted_draw_follows_the_weights() {
        let mut rng = Rng::new(9, 0, 0);
        let cumulative = [0.0, 1.0, 1.0, 4.0];
        let mut counts = [0; 4];
        (0..4000).for_each(|_| counts[rng.weighted(&cumulative)] += 1);
        assert_eq!((counts[0], counts[2]), (0, 0));
        assert!((900..1100).contains(&counts[1]), "{counts:?}");
    }

    #[test]
    fn every_index_has_a_different_stream() {
        let first = |seed, stream, index| Rng::new(seed, stream, index).bits();
        let mut all = vec![];
        for i in 0..10 {
            all.extend([first(0, 0, i), first(0, i + 1, 0), first(i + 1, 0, 0)]);
        }
        all.sort_unstable();
        all.dedup();
        assert_eq!(all.len(), 30);
    }
}
