//! Summaries of measured times.

use std::time::Duration;

/// Times of many frames, in milliseconds.
#[derive(Clone, Debug)]
pub struct Times {
    sorted: Vec<f64>,
    total: f64,
}

impl Times {
    /// Summarises at least one time.
    pub fn new(times: &[Duration]) -> Times {
        let mut sorted: Vec<f64> = times.iter().map(|time| time.as_secs_f64() * 1e3).collect();
        sorted.sort_by(f64::total_cmp);
        let total = sorted.iter().sum();
        Times { sorted, total }
    }

    /// Frames per second: frames divided by their total time, not the mean of rates. 0 without frames.
    pub fn fps(&self) -> f64 {
        if self.total > 0.0 { self.sorted.len() as f64 / self.total * 1e3 } else { 0.0 }
    }

    /// Mean in milliseconds; 0 without frames.
    pub fn mean(&self) -> f64 {
        if self.sorted.is_empty() { 0.0 } else { self.total / self.sorted.len() as f64 }
    }

    /// The time that a share of the frames does not exceed (nearest rank), in milliseconds; 0 without frames.
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
        let none = Times::new(&[]);
        assert_eq!((none.fps(), none.mean(), none.percentile(0.5)), (0.0, 0.0, 0.0));
    }
}
