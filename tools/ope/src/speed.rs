//! Frames per second under the two rules in use.

use serde::Serialize;

/// Speed of a tracker. The clock runs during initialization and update, not while pictures are
/// read.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Speed {
    /// Mean over sequences of the mean over frames of 1/seconds, the first frame included: the
    /// got10k toolkit's rule, which is never below the other one on a sequence.
    pub mean_of_rates: f64,
    /// All frames over all seconds.
    pub frames_per_time: f64,
    /// Sequences with times.
    pub sequences: usize,
}

impl Speed {
    /// The speed from the seconds of each frame of each sequence; `None` if no frame has a time
    /// above 0.
    ///
    /// Times that are not above 0 and finite do not count.
    pub fn of<'a>(sequences: impl IntoIterator<Item = &'a [f64]>) -> Option<Speed> {
        let mut rates = Vec::new();
        let mut frames = 0;
        let mut seconds = 0.0;
        for times in sequences {
            let times: Vec<f64> = times
                .iter()
                .copied()
                .filter(|t| *t > 0.0 && t.is_finite())
                .collect();
            if times.is_empty() {
                continue;
            }
            rates.push(times.iter().map(|t| 1.0 / t).sum::<f64>() / times.len() as f64);
            frames += times.len();
            seconds += times.iter().sum::<f64>();
        }
        let mean_of_rates = rates.iter().sum::<f64>() / rates.len() as f64;
        let sequences = rates.len();
        (sequences > 0).then(|| Speed {
            mean_of_rates,
            frames_per_time: frames as f64 / seconds,
            sequences,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speed_follows_both_rules_and_ignores_unusable_times() {
        let (a, b) = ([0.1, 0.4, 0.0, f64::NAN, -1.0], [0.5, 0.5]);
        let none: [f64; 2] = [0.0, f64::INFINITY];
        let speed = Speed::of([&a[..], &b[..], &none[..]]).unwrap();
        assert!((speed.mean_of_rates - (6.25 + 2.0) / 2.0).abs() < 1e-12);
        assert!((speed.frames_per_time - 4.0 / 1.5).abs() < 1e-12);
        assert_eq!(speed.sequences, 2);
        assert_eq!(Speed::of([&none[..]]), None);
        assert_eq!(Speed::of([]), None);
    }
}
