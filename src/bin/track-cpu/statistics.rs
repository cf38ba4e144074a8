//! Summaries of measured times.

use std::time::Duration;

/// Times of many frames, in milliseconds.
#[derive(Clone, Debug)]
pub struct Times {
    sorted: Vec<f64>,
    total: f64,
    rates: f64,       // sum of 1 / time
    blocks: Vec<f64>, // medians
}

/// Blocks that a run is cut into.
const BLOCKS: usize = 10;

impl Times {
    /// Summarizes times in the order in which they were measured.
    pub fn new(times: &[Duration]) -> Times {
        let mut sorted: Vec<f64> = times.iter().map(|time| time.as_secs_f64() * 1e3).collect();
        let middle = |block: &[f64]| {
            let mut block = block.to_vec();
            block.sort_by(f64::total_cmp);
            block[block.len() / 2]
        };
        let blocks = sorted
            .chunks(sorted.len().div_ceil(BLOCKS).max(1))
            .map(middle)
            .collect();
        sorted.sort_by(f64::total_cmp);
        let total = sorted.iter().sum();
        let rates = sorted
            .iter()
            .filter(|time| **time > 0.0)
            .map(|time| 1e3 / time)
            .sum();
        Times {
            sorted,
            total,
            rates,
            blocks,
        }
    }

    /// Frames per second: frames divided by their total time, not the mean of rates. 0 without
    /// frames.
    pub fn fps(&self) -> f64 {
        if self.total > 0.0 {
            self.sorted.len() as f64 / self.total * 1e3
        } else {
            0.0
        }
    }

    /// Mean of the frames' own rates: the got10k toolkit's figure, never below [`fps`](Self::fps).
    /// 0 without frames.
    pub fn mean_of_rates(&self) -> f64 {
        if self.sorted.is_empty() {
            0.0
        } else {
            self.rates / self.sorted.len() as f64
        }
    }

    /// Medians of up to ten equal blocks of consecutive frames, in milliseconds: how steady the run
    /// was.
    pub fn blocks(&self) -> &[f64] {
        &self.blocks
    }

    /// Mean in milliseconds; 0 without frames.
    pub fn mean(&self) -> f64 {
        if self.sorted.is_empty() {
            0.0
        } else {
            self.total / self.sorted.len() as f64
        }
    }

    /// The time that a share of the frames does not exceed (nearest rank), in milliseconds; 0
    /// without frames.
    pub fn percentile(&self, share: f64) -> f64 {
        let rank = (share * self.sorted.len() as f64).ceil() as usize;
        self.sorted.get(rank.max(1) - 1).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranks_and_rates() {
        let times: Vec<Duration> = (1..=100).rev().map(Duration::from_millis).collect();
        let times = Times::new(&times);
        assert_eq!(times.percentile(0.5), 50.0);
        assert_eq!(times.percentile(0.95), 95.0);
        assert_eq!(times.percentile(0.99), 99.0);
        assert_eq!(times.percentile(1.0), 100.0);
        assert!((times.mean() - 50.5).abs() < 1e-9);
        assert!((times.fps() - 1000.0 / 50.5).abs() < 1e-9);
        let blocks: Vec<f64> = (0..10).map(|i| f64::from(96 - 10 * i)).collect();
        assert_eq!((times.blocks().len(), times.blocks()), (10, &blocks[..]));
        let uneven = Times::new(&[Duration::from_millis(10), Duration::from_millis(40)]);
        assert!((uneven.fps() - 40.0).abs() < 1e-9 && (uneven.mean_of_rates() - 62.5).abs() < 1e-9);
        assert_eq!(uneven.blocks(), [10.0, 40.0]);
        let none = Times::new(&[]);
        assert_eq!(
            (none.fps(), none.mean(), none.percentile(0.5)),
            (0.0, 0.0, 0.0)
        );
        assert!(none.mean_of_rates() == 0.0 && none.blocks().is_empty());
    }
}
