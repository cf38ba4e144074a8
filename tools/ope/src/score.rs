//! One tracker on one benchmark: scores per sequence and their mean.

use crate::error::Error;
use crate::results::Results;
use crate::speed::Speed;
use sequences::annotation::are_shares;
use sequences::{Annotation, Convention, Curves, Notes, Rect};
use serde::Serialize;

/// The results of one tracker beside the annotations, sequence by sequence.
#[derive(Clone, Debug)]
pub struct Evaluation {
    /// The tracker's name.
    pub tracker: String,
    /// One per annotated sequence that has results.
    pub sequences: Vec<Evaluated>,
    /// Speed, if the results include times.
    pub speed: Option<Speed>,
}

/// One sequence's annotation and what the tracker found.
#[derive(Clone, Debug)]
pub struct Evaluated {
    /// The truth.
    pub annotation: Annotation,
    /// The tracker's boxes, one per frame, as in its file.
    pub boxes: Vec<Rect>,
}

/// The treatment of sequences without results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Missing {
    /// Refuse: a mean over fewer sequences is not the benchmark's.
    Refuse,
    /// Leave them out with a note.
    Skip,
}

/// A tracker's scores under one rule, in percent.
#[derive(Clone, Debug, Serialize)]
pub struct Score {
    /// The rule's name.
    pub convention: &'static str,
    /// Precision at 20 pixels.
    pub precision: f64,
    /// Area under the success curve.
    pub auc: f64,
    /// Normalized precision: the curve's mean under got10k and drop (as LaSOT), its value at 0.20
    /// under pysot and OTB.
    pub norm_precision: f64,
    /// Rate of frames with an overlap above one half.
    pub success_rate: f64,
    /// Sequences in the mean.
    pub sequences: usize,
    /// The mean curves.
    #[serde(skip)]
    pub curves: Curves,
    /// The curves of each sequence in the mean, with its name.
    #[serde(skip)]
    pub per_sequence: Vec<(String, Curves)>,
}

impl Evaluation {
    /// Reads the results of every annotated sequence.
    ///
    /// # Errors
    /// If a file cannot be used, if sequences without results are refused and there are any, or if
    /// no sequence has results.
    pub fn read(
        annotations: &[Annotation],
        results: &Results,
        missing: Missing,
        notes: &mut Notes,
    ) -> Result<Evaluation, Error> {
        let tracker = results.name();
        let mut sequences = Vec::new();
        let mut times = Vec::new();
        let mut without = Vec::new();
        for annotation in annotations {
            let name = &annotation.name;
            let Some(boxes) = results.boxes(name)? else {
                without.push(name.as_str());
                continue;
            };
            let annotated = annotation.boxes.len();
            let found = boxes.len();
            if found < annotated {
                let missing = annotated - found;
                let text = format!("{missing} of {annotated} frames have no result: misses");
                notes.add(format!("{tracker}: {name}"), text);
            } else if found > annotated {
                let text = format!("{found} results for {annotated} frames: the first count");
                notes.add(format!("{tracker}: {name}"), text);
            }
            if are_shares(&boxes) {
                let text = "no number exceeds 1: these are shares of the picture, not pixels";
                notes.add(format!("{tracker}: {name}"), text);
            }
            times.extend(results.times(name)?);
            sequences.push(Evaluated {
                annotation: annotation.clone(),
                boxes,
            });
        }
        if !without.is_empty() && (missing == Missing::Refuse || sequences.is_empty()) {
            let found = format!("none for {} of them: {}", without.len(), without.join(" "));
            let expected = format!("results of {} sequences", annotations.len());
            return Err(Error::content(results.folder(), expected, found));
        }
        if !without.is_empty() {
            let text = format!(
                "{} of {} sequences have no results and are left out: {}",
                without.len(),
                annotations.len(),
                without.join(" ")
            );
            notes.add(&tracker, text);
        }
        for name in results.names()? {
            if !annotations.iter().any(|a| a.name == name) {
                let text = format!("results of {name}, which is not annotated, are not used");
                notes.add(&tracker, text);
            }
        }
        let uncounted = times
            .iter()
            .flatten()
            .filter(|t| !(**t > 0.0 && t.is_finite()))
            .count();
        if uncounted > 0 {
            let text = format!("{uncounted} times are not above 0 and do not count");
            notes.add(&tracker, text);
        }
        let speed = Speed::of(times.iter().map(Vec::as_slice));
        Ok(Evaluation {
            tracker,
            sequences,
            speed,
        })
    }

    /// One sequence by its name.
    pub fn sequence(&self, name: &str) -> Option<&Evaluated> {
        self.sequences.iter().find(|s| s.annotation.name == name)
    }

    /// The scores under a rule.
    ///
    /// # Errors
    /// If no frame counts.
    pub fn score(&self, convention: Convention, notes: &mut Notes) -> Result<Score, Error> {
        let mut per_sequence = Vec::new();
        for Evaluated { annotation, boxes } in &self.sequences {
            match convention.curves(annotation, boxes) {
                Some(curves) => per_sequence.push((annotation.name.clone(), curves)),
                None => {
                    let rule = convention.name();
                    let text =
                        format!("no annotated box counts under {rule}: left out of the mean");
                    notes.add(&annotation.name, text);
                }
            }
        }
        let curves = Curves::mean(per_sequence.iter().map(|(_, curves)| curves)).ok_or(
            Error::NothingToCount {
                convention: convention.name(),
            },
        )?;
        Ok(Score {
            convention: convention.name(),
            precision: 100.0 * curves.precision(),
            auc: 100.0 * curves.auc(),
            norm_precision: 100.0 * convention.norm_precision(&curves),
            success_rate: 100.0 * curves.success_rate(),
            sequences: per_sequence.len(),
            curves,
            per_sequence,
        })
    }

    /// The scores under several rules, in their order.
    ///
    /// # Errors
    /// As of [`score`](Self::score).
    pub fn scores(
        &self,
        conventions: &[Convention],
        notes: &mut Notes,
    ) -> Result<Vec<Score>, Error> {
        conventions
            .iter()
            .map(|convention| self.score(*convention, notes))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sequences::annotation;
    use testing::{Folder, shared};

    /// Precision and AUC in percent.
    fn authors(dataset: &str, convention: Convention) -> Option<(f64, f64)> {
        let truth = annotation::read_folder(
            &shared(&format!("data/gt_annotations/{dataset}"))?,
            &mut Notes::default(),
        )
        .unwrap();
        let results = Results::open(&shared(&format!("data/authors_results/{dataset}"))?).unwrap();
        let mut notes = Notes::default();
        let evaluation = Evaluation::read(&truth, &results, Missing::Refuse, &mut notes).unwrap();
        assert_eq!(notes.count(), 0, "{notes}");
        let score = evaluation.score(convention, &mut notes).unwrap();
        Some((score.precision, score.auc))
    }

    #[test]
    fn authors_boxes_score_as_published() {
        for (dataset, convention, expected) in [
            ("DTB70", Convention::Otb, "83.50 62.64"),
            ("DTB70", Convention::Got10k, "83.43 62.64"),
            ("UAVDT", Convention::Otb, "80.82 56.32"),
            ("UAVDT", Convention::Got10k, "80.82 56.54"),
        ] {
            let Some((precision, auc)) = authors(dataset, convention) else {
                return;
            };
            assert_eq!(
                format!("{precision:.2} {auc:.2}"),
                expected,
                "{dataset} {convention:?}"
            );
        }
    }

    fn evaluate(folder: &Folder, missing: Missing) -> Result<(Evaluation, Notes), String> {
        let mut notes = Notes::default();
        let truth = annotation::read_folder(&folder.join("truth"), &mut notes)
            .map_err(|e| e.to_string())?;
        let results = Results::open(&folder.path().join("found")).map_err(|e| e.to_string())?;
        let evaluation =
            Evaluation::read(&truth, &results, missing, &mut notes).map_err(|e| e.to_string())?;
        Ok((evaluation, notes))
    }

    #[test]
    fn annotations_in_any_order_find_their_results() {
        let folder = Folder::new("order");
        for name in ["a", "b", "c", "d"] {
            folder.write(&format!("truth/{name}.txt"), "10,10,20,20\n".repeat(2));
            folder.write(&format!("found/{name}.txt"), "10,10,20,20\n".repeat(2));
        }
        let mut truth =
            annotation::read_folder(&folder.join("truth"), &mut Notes::default()).unwrap();
        truth.reverse();
        let results = Results::open(&folder.path().join("found")).unwrap();
        let mut notes = Notes::default();
        let evaluation = Evaluation::read(&truth, &results, Missing::Refuse, &mut notes).unwrap();
        assert_eq!(
            (evaluation.sequences.len(), notes.to_string().as_str()),
            (4, "")
        );
    }

    #[test]
    fn mean_counts_every_sequence_alike_and_lengths_are_noted() {
        let folder = Folder::new("score");
        folder.write("truth/long.txt", "10,10,20,20\n".repeat(10));
        folder.write("truth/short.txt", "\u{feff}10 10 20 20\r\n");
        folder.write("found/long.txt", "900,900,20,20,0.5\n".repeat(12));
        folder.write("found/short.txt", "10\t10\t20\t20\n");
        folder.write("found/other.txt", "1,2,3,4\n");
        folder.write("truth/share.txt", "90,90,20,20\n");
        folder.write("found/share.txt", "0.1,0.1,0.2,0.2\n");
        folder.write("found/times/long_time.txt", "0.5\n0.25\n0\n");
        let (evaluation, notes) = evaluate(&folder, Missing::Refuse).unwrap();
        let text = notes.to_string();
        assert!(
            text.contains("long: 12 results for 10 frames: the first count"),
            "{text}"
        );
        assert!(
            text.contains("results of other, which is not annotated"),
            "{text}"
        );
        assert!(text.contains("1 times are not above 0"), "{text}");
        assert!(text.contains("share: no number exceeds 1"), "{text}");
        let score = evaluation
            .score(Convention::Got10k, &mut Notes::default())
            .unwrap();
        // 1 in 10, and twice 1 in 1: the first frame is given.
        assert!((score.precision - 70.0).abs() < 1e-9, "{score:?}");
        assert_eq!(score.sequences, 3);
        assert_eq!(evaluation.speed.unwrap().mean_of_rates, 3.0);
    }

    #[test]
    fn missing_results_are_refused_or_noted() {
        let folder = Folder::new("score");
        folder.write("truth/a.txt", "10,10,20,20\n");
        folder.write("truth/b.txt", "10,10,20,20\n");
        folder.write("found/b/b_001.txt", "10,10,20,20\n");
        let error = evaluate(&folder, Missing::Refuse).unwrap_err();
        assert!(
            error.ends_with("expected results of 2 sequences, found none for 1 of them: a"),
            "{error}"
        );
        let (evaluation, notes) = evaluate(&folder, Missing::Skip).unwrap();
        assert_eq!(evaluation.sequences.len(), 1);
        assert!(
            notes
                .to_string()
                .contains("1 of 2 sequences have no results and are left out: a")
        );
        std::fs::remove_dir_all(folder.path().join("found/b")).unwrap();
        assert!(evaluate(&folder, Missing::Skip).is_err());
        folder.write("found/a.txt", "");
        let error = evaluate(&folder, Missing::Skip).unwrap_err();
        assert!(
            error.ends_with("a.txt: expected x,y,w,h per line, found an empty file"),
            "{error}"
        );
    }

    #[test]
    fn sequence_without_a_counted_frame_is_left_out_of_the_mean() {
        let folder = Folder::new("score");
        folder.write("truth/a.txt", "NaN,NaN,NaN,NaN\nNaN,NaN,NaN,NaN\n");
        folder.write("found/a.txt", "1,2,3,4\n1,2,3,4\n");
        let (evaluation, mut notes) = evaluate(&folder, Missing::Refuse).unwrap();
        let error = evaluation
            .score(Convention::Got10k, &mut notes)
            .unwrap_err()
            .to_string();
        assert!(
            error.contains("no frame to count") && error.contains("got10k"),
            "{error}"
        );
        let score = evaluation.score(Convention::Otb, &mut notes).unwrap();
        assert_eq!((score.precision, score.auc), (100.0, 0.0));
        folder.write("truth/b.txt", "10,10,20,20\n");
        folder.write("found/b.txt", "10,10,20,20\n");
        let (evaluation, mut notes) = evaluate(&folder, Missing::Refuse).unwrap();
        let score = evaluation.score(Convention::Got10k, &mut notes).unwrap();
        assert_eq!((score.precision, score.sequences), (100.0, 1));
        assert!(
            notes
                .to_string()
                .contains("a: no annotated box counts under got10k"),
            "{notes}"
        );
    }
}
