//! Plots of presence: ROC curves, and how often boxes of a presence are right.

use std::path::Path;

use sequences::plot::{Axes, Series, lines};

use crate::{Failure, write_text};

/// Frames with their probability and whether it came true.
pub type Samples = [(f64, bool)];

/// Bins of the calibration curve.
const BINS: usize = 20;
/// Right end of the ROC curves, in percent, and least steps between their points.
const MOST_FALSE: f64 = 30.0;
const STEPS: (f64, f64) = (0.2, 0.5);
/// Frames that a bin must have to be drawn.
const ENOUGH: usize = 20;

/// Writes `flight-roc.svg` and `flight-presence.svg` into a folder, which is made if need be.
pub fn write(folder: &Path, on_off: &Samples, visible_gone: &Samples) -> Result<(), Failure> {
    let curve = |label: &str, samples: &Samples| Series {
        label: label.into(),
        points: roc(samples),
    };
    let (x, y) = ("false positives [%]", "true positives [%]");
    let axes = Axes {
        title: "Presence tells apart",
        x,
        y,
        x_min: 0.0,
        x_max: MOST_FALSE,
        y_max: 100.0,
    };
    let series = [
        curve("visible and tracked / gone", visible_gone),
        curve("on / off the target", on_off),
    ];
    let roc = lines(&axes, &series, false);
    let (x, y) = ("presence [%]", "boxes on the target [%]");
    let axes = Axes {
        title: "Presence and truth",
        x,
        y,
        x_min: 0.0,
        x_max: 100.0,
        y_max: 100.0,
    };
    let series = [
        Series {
            label: "ideal".into(),
            points: vec![(0.0, 0.0), (100.0, 100.0)],
        },
        Series {
            label: "measured".into(),
            points: calibration(on_off),
        },
    ];
    let presence = lines(&axes, &series, false);
    let wrong = |error: std::io::Error| Failure::Unwritable(folder.into(), error.to_string());
    std::fs::create_dir_all(folder).map_err(wrong)?;
    for (name, svg) in [("flight-roc.svg", roc), ("flight-presence.svg", presence)] {
        write_text(&folder.join(name), &svg)?;
    }
    Ok(())
}

/// Points of the ROC curve in percent, from the strictest threshold to the loosest that the plot
/// shows; points that are hardly apart are left out.
fn roc(samples: &Samples) -> Vec<(f64, f64)> {
    let mut sorted = samples.to_vec();
    sorted.sort_by(|a, b| b.0.total_cmp(&a.0));
    let positives = sorted.iter().filter(|s| s.1).count().max(1) as f64;
    let negatives = sorted.iter().filter(|s| !s.1).count().max(1) as f64;
    let (mut hits, mut misses, mut points) = (0.0, 0.0, vec![(0.0, 0.0)]);
    for (i, sample) in sorted.iter().enumerate() {
        *(if sample.1 { &mut hits } else { &mut misses }) += 1.0;
        let tied = sorted.get(i + 1).is_some_and(|next| next.0 == sample.0);
        let (x, y) = (100.0 * misses / negatives, 100.0 * hits / positives);
        let last: (f64, f64) = points[points.len() - 1];
        if !tied && x <= MOST_FALSE && (x - last.0 >= STEPS.0 || y - last.1 >= STEPS.1) {
            points.push((x, y));
        }
    }
    points
}

/// Mean presence and share on the target of each bin, in percent.
fn calibration(samples: &Samples) -> Vec<(f64, f64)> {
    let mut bins = [(0usize, 0.0, 0.0); BINS];
    for (presence, on) in samples {
        let bin = &mut bins[((presence * BINS as f64) as usize).min(BINS - 1)];
        *bin = (
            bin.0 + 1,
            bin.1 + presence,
            bin.2 + f64::from(u8::from(*on)),
        );
    }
    let enough = bins.into_iter().filter(|(count, ..)| *count >= ENOUGH);
    enough
        .map(|(count, presence, on)| (100.0 * presence / count as f64, 100.0 * on / count as f64))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_of_known_samples() {
        let good: Vec<(f64, bool)> = (0..100).map(|i| (f64::from(i) / 100.0, i >= 50)).collect();
        assert_eq!(
            roc(&good)[1..].iter().filter(|(x, _)| *x == 0.0).count(),
            50
        );
        assert_eq!(
            roc(&good).iter().map(|(_, y)| *y).fold(0.0, f64::max),
            100.0
        );
        let sure = [(0.96, true); 30];
        let unsure = [(0.52, false); 30];
        let points = calibration(&[sure, unsure].concat());
        let expected = [(52.0, 0.0), (96.0, 100.0)];
        let near = |(a, b): (&(f64, f64), (f64, f64))| (a.0 - b.0).abs() + (a.1 - b.1).abs() < 1e-6;
        assert!(
            points.len() == 2 && points.iter().zip(expected).all(near),
            "{points:?}"
        );
        assert_eq!(calibration(&sure[..ENOUGH - 1]), []);
    }
}
