//! How old frames were when their boxes were reported: a histogram of the whole run.

use std::fmt;
use std::time::Duration;

/// Width of a bin in milliseconds.
const BIN_MS: f64 = 0.5;
/// Number of bins; older frames fall into the last one.
const BINS: usize = 2000;

/// A histogram of ages.
#[derive(Clone, Debug)]
pub struct Ages {
    bins: Vec<u64>, // [BINS]
    count: u64,
    oldest: Duration,
}

impl Default for Ages {
    fn default() -> Ages {
        Ages::new()
    }
}

impl Ages {
    /// An empty histogram.
    pub fn new() -> Ages {
        Ages {
            bins: vec![0; BINS],
            count: 0,
            oldest: Duration::ZERO,
        }
    }

    /// Counts a box that was reported for a frame of this age.
    pub fn add(&mut self, age: Duration) {
        let bin = (age.as_secs_f64() * 1e3 / BIN_MS) as usize;
        self.bins[bin.min(BINS - 1)] += 1;
        self.count += 1;
        self.oldest = self.oldest.max(age);
    }

    /// Milliseconds that a share of the ages does not exceed, to half a millisecond; 0 if empty.
    pub fn percentile(&self, share: f64) -> f64 {
        let rank = (share * self.count as f64).ceil().max(1.0) as u64;
        let mut seen = 0;
        let bin = self.bins.iter().position(|count| {
            seen += count;
            seen >= rank
        });
        let edge = bin.map_or(0.0, |bin| (bin + 1) as f64 * BIN_MS);
        edge.min(self.oldest.as_secs_f64() * 1e3)
    }
}

impl fmt::Display for Ages {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (half, most) = (self.percentile(0.5), self.percentile(0.99));
        let oldest = self.oldest.as_secs_f64() * 1e3;
        write!(
            f,
            "{} boxes reported, from frame to box p50 {half:.1} ms, p99 {most:.1} ms, \
             at most {oldest:.1} ms",
            self.count
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_right_to_half_a_millisecond() {
        let mut ages = Ages::new();
        assert_eq!((ages.percentile(0.5), ages.percentile(0.99)), (0.0, 0.0));
        for ms in 1..=100 {
            ages.add(Duration::from_millis(ms));
        }
        assert!(
            (ages.percentile(0.5) - 50.5).abs() < 1e-9
                && (ages.percentile(0.99) - 99.5).abs() < 1e-9
        );
        assert!(
            (ages.percentile(1.0) - 100.0).abs() < 1e-9,
            "no more than the oldest"
        );
        ages.add(Duration::from_secs(3600));
        assert!(ages.percentile(0.5) <= 51.5 && ages.percentile(1.0) <= BINS as f64 * BIN_MS);
        assert!(ages.to_string().starts_with("101 boxes reported"), "{ages}");
    }
}
