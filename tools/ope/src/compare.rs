//! Several trackers on one benchmark: side by side, per attribute, per sequence, with their plots.

use crate::error::Error;
use crate::results::Results;
use crate::score::{Evaluation, Missing, Score};
use sequences::curves::{Curves, PRECISION_BINS, SUCCESS_BINS};
use sequences::dataset::Attributes;
use sequences::plot::{self, Axes, Series};
use sequences::{Annotation, Convention, Notes};
use std::collections::HashSet;

/// Trackers under one rule on the same sequences.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// The rule.
    pub convention: Convention,
    /// Each tracker's boxes, beside the annotations.
    pub trackers: Vec<Evaluation>,
    /// Each tracker's scores, in the same order.
    pub scores: Vec<Score>,
    /// Attributes of the sequences.
    pub attributes: Attributes,
}

/// A tracker's precision and AUC over some sequences, in percent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Precision at 20 pixels.
    pub precision: f64,
    /// Area under the success curve.
    pub auc: f64,
}

impl Summary {
    /// Precision and AUC of curves.
    pub fn of(curves: &Curves) -> Summary {
        Summary {
            precision: 100.0 * curves.precision(),
            auc: 100.0 * curves.auc(),
        }
    }
}

impl Comparison {
    /// Reads the results of each tracker; trackers of one name are numbered.
    ///
    /// If missing sequences are skipped, only those that every tracker has are compared.
    ///
    /// # Errors
    /// As of [`Evaluation::read`] and [`Evaluation::score`].
    pub fn read(
        annotations: &[Annotation],
        results: &[Results],
        convention: Convention,
        missing: Missing,
        attributes: Attributes,
        notes: &mut Notes,
    ) -> Result<Comparison, Error> {
        let mut trackers = Vec::new();
        for results in results {
            trackers.push(Evaluation::read(annotations, results, missing, notes)?);
        }
        number_equal_names(&mut trackers);
        keep_common(&mut trackers, annotations, notes);
        let scores: Result<_, _> = trackers
            .iter()
            .map(|tracker| tracker.score(convention, notes))
            .collect();
        Ok(Comparison {
            convention,
            scores: scores?,
            trackers,
            attributes,
        })
    }

    /// The indices of the trackers, highest precision first.
    pub fn ranking(&self) -> Vec<usize> {
        let mut places: Vec<usize> = (0..self.scores.len()).collect();
        places.sort_by(|a, b| {
            self.scores[*b]
                .precision
                .total_cmp(&self.scores[*a].precision)
        });
        places
    }

    /// Each attribute with its number of sequences and each tracker's scores on them.
    pub fn per_attribute(&self) -> Vec<(String, usize, Vec<Summary>)> {
        let mut rows = Vec::new();
        for (attribute, sequences) in &self.attributes {
            let on = |score: &Score| {
                let having = score
                    .per_sequence
                    .iter()
                    .filter(|(name, _)| sequences.contains(name));
                Some((
                    having.clone().count(),
                    Summary::of(&Curves::mean(having.map(|(_, curves)| curves))?),
                ))
            };
            let found: Option<Vec<_>> = self.scores.iter().map(on).collect();
            if let Some(found) = found {
                let count = found.first().map_or(0, |(count, _)| *count);
                rows.push((
                    attribute.clone(),
                    count,
                    found.into_iter().map(|(_, summary)| summary).collect(),
                ));
            }
        }
        rows
    }

    /// Each sequence with each tracker's scores on it.
    pub fn per_sequence(&self) -> Vec<(String, Vec<Summary>)> {
        let Some(first) = self.scores.first() else {
            return Vec::new();
        };
        let row = |(i, (name, _)): (usize, &(String, Curves))| {
            let summaries = self
                .scores
                .iter()
                .filter_map(|score| score.per_sequence.get(i));
            (
                name.clone(),
                summaries.map(|(_, curves)| Summary::of(curves)).collect(),
            )
        };
        first.per_sequence.iter().enumerate().map(row).collect()
    }

    /// Rate of frames within each center error; the legend says precision at 20 pixels.
    pub fn precision_plot(&self) -> String {
        let axes = Axes {
            title: "Precision",
            x: "center error threshold [px]",
            y: "rate of frames",
            x_min: 0.0,
            x_max: (PRECISION_BINS - 1) as f64,
            y_max: 1.0,
        };
        let series = self.series(|score| {
            let points = score
                .curves
                .precision
                .iter()
                .enumerate()
                .map(|(i, v)| (i as f64, *v));
            (score.precision, points.collect())
        });
        plot::lines(&axes, &series, false)
    }

    /// Rate of frames above each overlap; the legend says the area under the curve.
    pub fn success_plot(&self) -> String {
        let axes = Axes {
            title: "Success",
            x: "overlap threshold",
            y: "rate of frames",
            x_min: 0.0,
            x_max: 1.0,
            y_max: 1.0,
        };
        let series = self.series(|score| {
            let points =
                (0..SUCCESS_BINS).map(|i| (Curves::overlap_threshold(i), score.curves.success[i]));
            (score.auc, points.collect())
        });
        plot::lines(&axes, &series, true)
    }

    /// Precision over speed (frames / total time), on a logarithmic axis where speeds are far
    /// apart; `None` if no tracker has times.
    pub fn speed_plot(&self) -> Option<String> {
        let rates = self
            .trackers
            .iter()
            .map(|tracker| tracker.speed.map(|speed| speed.frames_per_time));
        let fastest = rates.clone().flatten().fold(0.0, f64::max);
        let slowest = rates.clone().flatten().fold(f64::INFINITY, f64::min);
        let point = |((tracker, score), rate): ((&Evaluation, &Score), Option<f64>)| Series {
            label: tracker.tracker.clone(),
            points: rate
                .map(|rate| (rate, score.precision))
                .into_iter()
                .collect(),
        };
        let series: Vec<Series> = self
            .trackers
            .iter()
            .zip(&self.scores)
            .zip(rates)
            .map(point)
            .collect();
        let axes = Axes {
            title: "Precision and speed",
            x: "frames per second (frames / total time)",
            y: "precision at 20 px [%]",
            x_min: if fastest > FAR_APART * slowest {
                nice(slowest / 5.0)
            } else {
                0.0
            },
            x_max: nice(fastest),
            y_max: 100.0,
        };
        (fastest > 0.0).then(|| plot::points(&axes, &series))
    }

    /// AUC per attribute; `None` where there are fewer than three attributes.
    pub fn attribute_plot(&self) -> Option<String> {
        let rows = self.per_attribute();
        let spokes: Vec<String> = rows
            .iter()
            .map(|(name, count, _)| format!("{name} ({count})"))
            .collect();
        let series = |(i, tracker): (usize, &Evaluation)| Series {
            label: tracker.tracker.clone(),
            points: rows
                .iter()
                .map(|(.., summaries)| (0.0, summaries[i].auc))
                .collect(),
        };
        let series: Vec<Series> = self.trackers.iter().enumerate().map(series).collect();
        (rows.len() >= 3).then(|| plot::radar("AUC per attribute [%]", &spokes, &series))
    }

    fn series(&self, curve: impl Fn(&Score) -> (f64, Vec<(f64, f64)>)) -> Vec<Series> {
        let one = |(tracker, score): (&Evaluation, &Score)| {
            let (value, points) = curve(score);
            Series {
                label: format!("{} [{value:.1}]", tracker.tracker),
                points,
            }
        };
        self.trackers.iter().zip(&self.scores).map(one).collect()
    }
}

/// Numbers trackers of one name: `x`, `x (2)`.
fn number_equal_names(trackers: &mut [Evaluation]) {
    for i in 0..trackers.len() {
        let same = trackers[..i]
            .iter()
            .filter(|t| t.tracker == trackers[i].tracker)
            .count();
        if same > 0 {
            trackers[i].tracker = format!("{} ({})", trackers[i].tracker, same + 1);
        }
    }
}

/// Keeps the sequences that all trackers have, and notes how many each loses.
fn keep_common(trackers: &mut [Evaluation], annotations: &[Annotation], notes: &mut Notes) {
    let has = |t: &Evaluation, name: &str| t.sequences.iter().any(|s| s.annotation.name == name);
    let common: HashSet<&str> = annotations
        .iter()
        .map(|a| a.name.as_str())
        .filter(|name| trackers.iter().all(|t| has(t, name)))
        .collect();
    for tracker in trackers {
        let before = tracker.sequences.len();
        tracker
            .sequences
            .retain(|s| common.contains(s.annotation.name.as_str()));
        let left = tracker.sequences.len();
        if left < before {
            let text = format!("compared on {left} of its {before} sequences: those that all have");
            notes.add(&tracker.tracker, text);
        }
    }
}

/// Ratio of the fastest to the slowest tracker above which the axis of speed is logarithmic.
const FAR_APART: f64 = 8.0;

/// The least round number that is not below `value`.
fn nice(value: f64) -> f64 {
    let power = 10f64.powf(value.max(1e-9).log10().floor());
    [1.0, 2.0, 5.0, 10.0]
        .iter()
        .map(|m| m * power)
        .find(|v| *v >= value)
        .unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sequences::annotation;
    use testing::Folder;

    #[test]
    fn two_trackers_are_compared_on_common_sequences() {
        let folder = Folder::new("compare");
        for name in ["a", "b", "c"] {
            folder.write(&format!("truth/{name}.txt"), "10,10,20,20\n".repeat(4));
            folder.write(&format!("good/x/{name}.txt"), "10,10,20,20\n".repeat(4));
        }
        folder.write("bad/x/a.txt", "10,10,20,20\n".repeat(4));
        folder.write("bad/x/b.txt", "90,10,20,20\n".repeat(4));
        folder.write("bad/x/times/b_time.txt", "0.01\n".repeat(4));
        let truth = annotation::read_folder(&folder.join("truth"), &mut Notes::default()).unwrap();
        let results = ["bad/x", "good/x"].map(|at| Results::open(&folder.path().join(at)).unwrap());
        let attributes: Attributes = [("fast", "b"), ("slow", "a"), ("dark", "c")]
            .map(|(k, v)| (k.into(), vec![v.into()]))
            .into();
        let read = |missing, notes: &mut Notes| {
            Comparison::read(
                &truth,
                &results,
                Convention::Got10k,
                missing,
                attributes.clone(),
                notes,
            )
        };
        assert!(read(Missing::Refuse, &mut Notes::default()).is_err());
        let mut notes = Notes::default();
        let compared = read(Missing::Skip, &mut notes).unwrap();
        assert!(
            notes
                .to_string()
                .contains("x (2): compared on 2 of its 3 sequences"),
            "{notes}"
        );
        assert_eq!(compared.ranking(), [1, 0]);
        let precisions =
            |summaries: &[Summary]| summaries.iter().map(|p| p.precision).collect::<Vec<_>>();
        let rows = compared.per_sequence();
        assert_eq!(
            (&rows[1].0[..], precisions(&rows[1].1)),
            ("b", vec![25.0, 100.0])
        );
        let attributes = compared.per_attribute();
        assert_eq!((&attributes[0].0[..], attributes[0].1), ("fast", 1));
        assert_eq!(
            (attributes.len(), precisions(&attributes[0].2)),
            (2, vec![25.0, 100.0])
        );
        assert!(compared.attribute_plot().is_none());
        assert!(compared.precision_plot().contains("x (2) [100.0]"));
        assert!(
            compared.success_plot().contains("x [")
                && compared.speed_plot().unwrap().contains("<circle")
        );
    }

    #[test]
    fn comparison_does_not_depend_on_the_order_of_annotations() {
        let folder = Folder::new("compare-order");
        for name in ["a", "b", "c", "d"] {
            folder.write(&format!("truth/{name}.txt"), "10,10,20,20\n".repeat(4));
            folder.write(&format!("x/{name}.txt"), "10,10,20,20\n".repeat(4));
        }
        let mut truth =
            annotation::read_folder(&folder.join("truth"), &mut Notes::default()).unwrap();
        truth.reverse();
        let results = [Results::open(&folder.path().join("x")).unwrap()];
        let none = Attributes::default();
        let mut notes = Notes::default();
        let compared = Comparison::read(
            &truth,
            &results,
            Convention::Got10k,
            Missing::Refuse,
            none,
            &mut notes,
        )
        .unwrap();
        assert_eq!(
            (
                compared.trackers[0].sequences.len(),
                notes.to_string().as_str()
            ),
            (4, "")
        );
    }

    #[test]
    fn axes_end_at_round_numbers() {
        assert_eq!(
            [0.4, 92.0, 100.0, 370.2].map(nice),
            [0.5, 100.0, 100.0, 500.0]
        );
    }
}
