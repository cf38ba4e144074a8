//! Learning rates over the steps of a training: a linear warm-up, then half a cosine down to a
//! floor.

/// `start -> peak` linearly over the first `warmup` steps, then `peak -> floor` along a cosine
/// until step `total`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WarmupCosine {
    /// Rate of the first step, if there is a warm-up.
    pub start: f64,
    /// The highest rate.
    pub peak: f64,
    /// The rate from `total` on.
    pub floor: f64,
    /// Steps of the warm-up.
    pub warmup: usize,
    /// Steps of the whole training.
    pub total: usize,
}

impl WarmupCosine {
    /// The reference implementation's: epoch 0 from 1e-6 to 0.08, then back to 1e-6
    /// (docs/method.md, section 3.5).
    pub fn paper(epochs: usize, steps_per_epoch: usize) -> WarmupCosine {
        let total = epochs * steps_per_epoch;
        WarmupCosine {
            start: 1e-6,
            peak: 0.08,
            floor: 1e-6,
            warmup: steps_per_epoch,
            total,
        }
    }

    /// The rate of one step, counted from 0.
    pub fn rate(&self, step: usize) -> f32 {
        let rate = if step < self.warmup {
            self.start + (self.peak - self.start) * step as f64 / self.warmup as f64
        } else if step < self.total {
            let done = (step - self.warmup) as f64 / (self.total - self.warmup) as f64;
            self.floor
                + (self.peak - self.floor) * (1.0 + (std::f64::consts::PI * done).cos()) / 2.0
        } else {
            self.floor
        };
        rate as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedule_has_the_reference_rates() {
        let schedule = WarmupCosine::paper(20, 12_500);
        for (epoch, step, rate) in [
            (0, 0, 1e-6),
            (0, 6250, 0.0400005),
            (1, 0, 0.08),
            (5, 0, 0.0715657),
            (10, 6250, 0.0400005),
            (15, 0, 0.0129096),
            (19, 12_499, 1.0000035e-6),
        ] {
            let found = f64::from(schedule.rate(epoch * 12_500 + step));
            assert!(
                (found / rate - 1.0).abs() < 3e-6,
                "epoch {epoch} step {step}: {found}, expected {rate}"
            );
        }
        assert_eq!(schedule.rate(usize::MAX), 1e-6);
    }

    #[test]
    fn schedule_without_warm_up_starts_at_the_peak() {
        let schedule = WarmupCosine {
            start: 0.0,
            peak: 2.0,
            floor: 1.0,
            warmup: 0,
            total: 10,
        };
        assert_eq!(
            [schedule.rate(0), schedule.rate(5), schedule.rate(10)],
            [2.0, 1.5, 1.0]
        );
        let none = WarmupCosine {
            total: 0,
            ..schedule
        };
        assert_eq!(none.rate(0), 1.0);
    }
}
