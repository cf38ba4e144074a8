//! How good a probability is.

use sequences::curves;

/// Area under the ROC curve: the chance that a positive has the higher number than a negative, ties
/// counting half. `None` without both.
pub fn auroc(samples: &[(f64, bool)]) -> Option<f64> {
    let mut sorted = samples.to_vec();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut rank_sum, mut at) = (0.0, 0);
    while at < sorted.len() {
        let end = at
            + sorted[at..]
                .iter()
                .take_while(|s| s.0 == sorted[at].0)
                .count()
                .max(1);
        let rank = (at + end + 1) as f64 / 2.0; // mean of the ranks at+1..=end
        rank_sum += rank * sorted[at..end].iter().filter(|s| s.1).count() as f64;
        at = end;
    }
    let positives = sorted.iter().filter(|s| s.1).count() as f64;
    let negatives = sorted.len() as f64 - positives;
    (positives > 0.0 && negatives > 0.0)
        .then(|| (rank_sum - positives * (positives + 1.0) / 2.0) / (positives * negatives))
}

/// Mean squared difference of the probability and the truth.
pub fn brier(samples: &[(f64, bool)]) -> f64 {
    let error = |(p, on): &(f64, bool)| (p - f64::from(u8::from(*on))).powi(2);
    curves::mean(samples.iter().map(error))
}

/// Mean logistic loss.
pub fn log_loss(samples: &[(f64, bool)]) -> f64 {
    let loss = |(p, on): &(f64, bool)| -(if *on { *p } else { 1.0 - p }).max(1e-9).ln();
    curves::mean(samples.iter().map(loss))
}

/// A line per tenth of probability: frames, mean probability, share on target; and the expected
/// calibration error.
pub fn reliability(samples: &[(f64, bool)]) -> String {
    let (mut lines, mut error) = (String::from("presence    frames  mean   on target\n"), 0.0);
    for bin in 0..10 {
        let (low, high) = (f64::from(bin) / 10.0, f64::from(bin + 1) / 10.0);
        let within: Vec<_> = samples
            .iter()
            .filter(|(p, _)| *p >= low && (*p < high || bin == 9))
            .collect();
        if within.is_empty() {
            continue;
        }
        let count = within.len() as f64;
        let mean = within.iter().map(|s| s.0).sum::<f64>() / count;
        let on = within.iter().filter(|s| s.1).count() as f64 / count;
        error += count * (mean - on).abs() / samples.len() as f64;
        lines += &format!(
            "{low:.1} - {high:.1} {:>8}  {mean:.3}  {on:.3}\n",
            within.len()
        );
    }
    format!(
        "{lines}expected calibration error {error:.4}, Brier score {:.4}",
        brier(samples)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_of_known_samples() {
        let sample = |p: f64, on: bool| (p, on);
        assert_eq!(auroc(&[sample(0.1, false), sample(0.9, true)]), Some(1.0));
        assert_eq!(auroc(&[sample(0.9, false), sample(0.1, true)]), Some(0.0));
        assert_eq!(
            auroc(&[sample(0.5, false), sample(0.5, true), sample(0.5, true)]),
            Some(0.5)
        );
        let mixed = [
            sample(0.1, false),
            sample(0.4, true),
            sample(0.35, false),
            sample(0.8, true),
            sample(0.38, true),
            sample(0.39, false),
        ];
        assert_eq!(auroc(&mixed), Some(8.0 / 9.0));
        assert_eq!(auroc(&[sample(0.5, true)]), None);
    }

    #[test]
    fn sure_and_right_probability_has_no_error() {
        let samples = [(1.0, true), (0.0, false)];
        assert_eq!(brier(&samples), 0.0);
        assert!(reliability(&samples).contains("calibration error 0.0000"));
        assert!(log_loss(&[(0.5, true)]) > 0.69);
    }
}
