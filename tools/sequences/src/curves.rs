//! The curves of one sequence, and their means over sequences.

/// Overlap and errors of one frame's result.
///
/// Some rules give -1 to a frame that cannot be compared. It then counts as no overlap, but as
/// within every error threshold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judgment {
    /// Intersection over union.
    pub overlap: f64,
    /// Distance of the centers in pixels of the original video.
    pub error: f64,
    /// Distance of the centers, with each component divided by the annotated width or height.
    pub norm_error: f64,
}

impl Judgment {
    /// A frame without a result, which meets no threshold.
    pub const MISS: Judgment = Judgment {
        overlap: f64::NAN,
        error: f64::NAN,
        norm_error: f64::NAN,
    };
}

/// The mean; 0 without values.
pub fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut sum = 0.0; // the standard library's sum of nothing is -0.0
    let mut count: u32 = 0;
    for value in values {
        sum += value;
        count += 1;
    }
    sum / f64::from(count.max(1))
}

/// Thresholds of the precision curve: 0, 1, ... 50 pixels of center error.
pub const PRECISION_BINS: usize = 51;
/// Thresholds of the success curve: 0, 0.05, ... 1 of overlap.
pub const SUCCESS_BINS: usize = 21;
/// Index of the precision that is quoted: 20 pixels, or 0.20 of the target's size.
pub const QUOTED_PRECISION: usize = 20;
/// Index of the success rate that is quoted: overlap above one half.
pub const QUOTED_SUCCESS: usize = 10;

/// Rates of hits over thresholds, in `[0, 1]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Curves {
    /// Rate of frames with a center error of at most 0, 1, ... 50 pixels.
    pub precision: [f64; PRECISION_BINS],
    /// Rate of frames with a normalized center error of at most 0, 0.01, ... 0.5.
    pub norm_precision: [f64; PRECISION_BINS],
    /// Rate of frames with an overlap above 0, 0.05, ... 1.
    pub success: [f64; SUCCESS_BINS],
}

impl Curves {
    const ZERO: Curves = Curves {
        precision: [0.0; PRECISION_BINS],
        norm_precision: [0.0; PRECISION_BINS],
        success: [0.0; SUCCESS_BINS],
    };

    /// Threshold `i` of the success curve.
    pub fn overlap_threshold(i: usize) -> f64 {
        i as f64 * 0.05
    }

    /// The rates of `judgments` that meet each threshold, per `frames` frames; `None` without
    /// frames.
    pub fn of(judgments: impl IntoIterator<Item = Judgment>, frames: usize) -> Option<Curves> {
        if frames == 0 {
            return None;
        }
        let mut curves = Curves::ZERO;
        for judgment in judgments {
            for i in 0..PRECISION_BINS {
                curves.precision[i] += f64::from(judgment.error <= i as f64);
                curves.norm_precision[i] += f64::from(judgment.norm_error <= i as f64 / 100.0);
            }
            for i in 0..SUCCESS_BINS {
                curves.success[i] += f64::from(judgment.overlap > Curves::overlap_threshold(i));
            }
        }
        curves.scale(1.0 / frames as f64);
        Some(curves)
    }

    /// The unweighted mean over sequences; `None` without sequences.
    pub fn mean<'a>(sequences: impl IntoIterator<Item = &'a Curves>) -> Option<Curves> {
        let mut sum = Curves::ZERO;
        let mut count = 0;
        for curves in sequences {
            for (sum, rate) in sum.rates().zip(curves.clone().rates()) {
                *sum += *rate;
            }
            count += 1;
        }
        sum.scale(1.0 / f64::from(count.max(1)));
        (count > 0).then_some(sum)
    }

    fn scale(&mut self, factor: f64) {
        for rate in self.rates() {
            *rate *= factor;
        }
    }

    fn rates(&mut self) -> impl Iterator<Item = &mut f64> {
        self.precision
            .iter_mut()
            .chain(&mut self.norm_precision)
            .chain(&mut self.success)
    }

    /// Precision at 20 pixels.
    pub fn precision(&self) -> f64 {
        self.precision[QUOTED_PRECISION]
    }

    /// Area under the success curve: the mean of its 21 values.
    ///
    /// A perfect tracker has 20/21, because no overlap exceeds 1.
    pub fn auc(&self) -> f64 {
        self.success.iter().sum::<f64>() / SUCCESS_BINS as f64
    }

    /// Rate of frames with an overlap above one half.
    pub fn success_rate(&self) -> f64 {
        self.success[QUOTED_SUCCESS]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mean_of_nothing_is_a_positive_zero() {
        assert_eq!(mean([]).to_bits(), 0);
        assert_eq!(mean([1.0, 2.0]), 1.5);
    }

    const fn judgment(error: f64, overlap: f64) -> Judgment {
        Judgment {
            overlap,
            error,
            norm_error: error / 100.0,
        }
    }

    #[test]
    fn error_thresholds_include_their_value_and_overlap_thresholds_do_not() {
        let judgments = [judgment(20.0, 0.5), judgment(20.001, 0.501)];

        let curves = Curves::of(judgments, 2).unwrap();

        assert_eq!((curves.precision(), curves.precision[21]), (0.5, 1.0));
        assert_eq!((curves.success_rate(), curves.success[9]), (0.5, 1.0));
        assert_eq!(curves.norm_precision[QUOTED_PRECISION], 0.5);
    }

    #[test]
    fn perfect_box_has_an_auc_of_20_of_21() {
        let perfect = Curves::of([judgment(0.0, 1.0)], 1).unwrap();

        assert!((perfect.auc() - 20.0 / 21.0).abs() < 1e-15);
    }

    #[test]
    fn mean_counts_every_sequence_alike() {
        let short = Curves::of([judgment(0.0, 1.0)], 1).unwrap();
        let long = Curves::of([judgment(0.0, 1.0), judgment(30.0, 0.0)], 2).unwrap();

        let mean = Curves::mean([&short, &long]).unwrap();

        assert_eq!(mean.precision(), 0.75);
        assert_eq!(Curves::mean([]), None);
        assert_eq!(Curves::of([], 0), None);
    }

    #[test]
    fn missing_frame_passes_no_threshold() {
        let curves = Curves::of([Judgment::MISS], 1).unwrap();

        assert_eq!(curves.precision[50], 0.0);
        assert_eq!(curves.norm_precision[50], 0.0);
        assert_eq!(curves.success[0], 0.0);
    }
}
