//! Mean and variance per channel, in one pass over memory.

use crate::{Compute, ProcessGroup, Tensor};
use kernels::simd::{Kernel, Simd};

/// Count, mean and sum of squared distances from the mean, per channel.
#[derive(Clone, Debug)]
pub(super) struct Moments {
    pub count: f64,
    pub mean: Vec<f64>,    // [channels]
    pub squares: Vec<f64>, // [channels]
}

impl Moments {
    fn none(channels: usize) -> Moments {
        Moments {
            count: 0.0,
            mean: vec![0.0; channels],
            squares: vec![0.0; channels],
        }
    }

    /// The moments of `x` (`[.., channels]`), measured in parts of `part` values.
    pub fn of(compute: &Compute, x: &Tensor, part: usize) -> Moments {
        let (_, channels) = x.rows("batch_norm");
        let mut parts = vec![Moments::none(channels); x.shape()[0]];
        compute.each(&mut parts, 1, |i, moments| {
            let x = &x.data()[i * part..][..part];
            compute.isa().run(Measure {
                x,
                moments: &mut moments[0],
            });
        });
        let mut all = Moments::none(channels);
        for part in &parts {
            all.merge(
                part.count,
                part.mean.iter().copied().zip(part.squares.iter().copied()),
            );
        }
        all
    }

    /// Those of all processes together, given this one's.
    pub fn over(&self, processes: &dyn ProcessGroup) -> Moments {
        let channels = self.mean.len();
        let own = [&[self.count], &self.mean[..], &self.squares[..]].concat();
        let mut all = Moments::none(channels);
        for part in processes.all(&own).chunks_exact(own.len()) {
            let (mean, squares) = part[1..].split_at(channels);
            all.merge(part[0], mean.iter().copied().zip(squares.iter().copied()));
        }
        all
    }

    /// Adds a group of `count` values with the given means and squares.
    #[inline(always)]
    fn merge(&mut self, count: f64, others: impl Iterator<Item = (f64, f64)>) {
        let total = self.count + count;
        let (share, weight) = (count / total, self.count * count / total);
        for ((mean, squares), other) in self.mean.iter_mut().zip(&mut self.squares).zip(others) {
            let distance = other.0 - *mean;
            *mean += distance * share;
            *squares += other.1 + distance * distance * weight;
        }
        self.count = total;
    }
}

/// Rows that are measured together, in two passes over what then lies in the L1 cache.
const BLOCK: usize = 64;

/// Adds the rows of `x` (`[rows, channels]`) to `moments`.
struct Measure<'a> {
    x: &'a [f32],
    moments: &'a mut Moments,
}

impl Kernel for Measure<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let channels = self.moments.mean.len();
        let (mut mean, mut squares) = (vec![0.0f32; channels], vec![0.0f32; channels]);
        for block in self.x.chunks(BLOCK * channels) {
            let count = (block.len() / channels) as f32;
            mean.fill(0.0);
            for row in block.chunks_exact(channels) {
                mean.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
            }
            mean.iter_mut().for_each(|sum| *sum /= count);
            squares.fill(0.0);
            for row in block.chunks_exact(channels) {
                for ((squares, x), mean) in squares.iter_mut().zip(row).zip(&mean) {
                    *squares += (x - mean) * (x - mean);
                }
            }
            let pairs = mean
                .iter()
                .zip(&squares)
                .map(|(mean, squares)| (f64::from(*mean), f64::from(*squares)));
            self.moments.merge(f64::from(count), pairs);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::noise;

    /// A mean far from 0 costs no accuracy.
    #[test]
    fn moments_equal_their_definition() {
        let compute = Compute::new(2).unwrap();
        let (rows, channels) = (3 * 301, 5);
        let mut x = noise(&[3, 301, channels], 1);
        x.data_mut().iter_mut().for_each(|v| *v += 1000.0);
        let moments = Moments::of(&compute, &x, 301 * channels);
        assert_eq!(moments.count, rows as f64);
        for c in 0..channels {
            let values = || {
                x.data()[c..]
                    .iter()
                    .step_by(channels)
                    .map(|v| f64::from(*v))
            };
            let mean = values().sum::<f64>() / rows as f64;
            let squares: f64 = values().map(|v| (v - mean).powi(2)).sum();
            assert!(
                (moments.mean[c] - mean).abs() < 1e-4,
                "{} {mean}",
                moments.mean[c]
            );
            assert!(
                (moments.squares[c] / squares - 1.0).abs() < 1e-4,
                "{} {squares}",
                moments.squares[c]
            );
        }
    }
}
