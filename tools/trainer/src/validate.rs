//! Accuracy of weights, by tracking sequences and rendered flights with the real tracker.
//!
//! The figures are precision at 20 pixels of the original video and success AUC by the rule of the
//! got10k toolkit (docs/method.md, section 4.2). Frames without the target do not count.

use crate::data::picture::Picture;
use crate::data::sequences::{self, Sequence};
use crate::data::skipped::Skipped;
use crate::error::Error;
use ::sequences::{Annotation, Convention, Rect};
use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;
use track_cpu::{BBox, Isa, Model, Tracker};
use weights_format::Weights;

/// The clips on which weights are judged.
#[derive(Clone, Debug, Default)]
pub struct Validation {
    clips: Vec<Clip>,
    max_frames: usize,
}

/// Passes over each sequence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Passes {
    /// From the first frame on.
    #[default]
    One,
    /// From the first and the middle frame forwards, from the last and the middle frame backwards.
    ///
    /// A pass starts at the frame nearest to these that shows the target, as
    /// `ope run --four-starts` does.
    Four,
}

#[derive(Clone, Debug)]
enum Clip {
    Video(Sequence), // in the order of its pass
    Flight(FlightConfig),
}

/// What the name of a pass ends with.
const SUFFIXES: [&str; 3] = [".middle", ".backwards", ".middle-backwards"];

/// Name of the sequence of a pass.
pub fn sequence_of(pass: &str) -> &str {
    SUFFIXES
        .iter()
        .rev() // the longest first
        .find_map(|suffix| pass.strip_suffix(suffix))
        .unwrap_or(pass)
}

/// The four passes over a sequence; fewer where nothing is left behind a start.
fn four_passes(whole: &Sequence) -> Vec<Sequence> {
    let n = whole.frames.len();
    let starts = [
        ("", 0, false),
        (SUFFIXES[0], n / 2, false),
        (SUFFIXES[1], n.saturating_sub(1), true),
        (SUFFIXES[2], n.div_ceil(2).saturating_sub(1), true),
    ];
    let mut passes = Vec::new();
    for (suffix, nominal, backwards) in starts {
        let visible = (0..n).filter(|i| whole.boxes[*i].is_some());
        let Some(start) = visible.min_by_key(|i| i.abs_diff(nominal)) else {
            continue;
        };
        let order: Vec<usize> = if backwards {
            (0..=start).rev().collect()
        } else {
            (start..n).collect()
        };
        if order.len() > 1 {
            passes.push(Sequence {
                name: format!("{}{suffix}", whole.name),
                frames: order.iter().map(|i| whole.frames[*i].clone()).collect(),
                boxes: order.iter().map(|i| whole.boxes[*i]).collect(),
                ..whole.clone()
            });
        }
    }
    passes
}

/// Accuracy on one clip, or the mean over clips; in percent.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Accuracy {
    /// Share of frames whose center is at most 20 pixels off.
    pub precision: f64,
    /// Mean of the success rates at 21 thresholds of the IoU.
    pub auc: f64,
}

/// Accuracy on all clips.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// Per pass over a clip: its name, whether its video is also trained on, its accuracy.
    pub clips: Vec<(String, bool, Accuracy)>,
    /// Mean over real sequences whose videos are not trained on.
    pub clean: Option<Accuracy>,
    /// Mean over all real sequences.
    pub real: Option<Accuracy>,
    /// Mean over rendered flights.
    pub flights: Option<Accuracy>,
    /// How long it took.
    pub seconds: f64,
}

impl Report {
    /// The figure by which weights are compared.
    ///
    /// It is the AUC over real sequences that are not trained on, else over all real ones, else
    /// over flights.
    pub fn score(&self) -> Option<f64> {
        self.clean
            .or(self.real)
            .or(self.flights)
            .map(|accuracy| accuracy.auc)
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "precision/AUC")?;
        for (name, accuracy) in [
            ("not trained on", self.clean),
            ("all sequences", self.real),
            ("rendered flights", self.flights),
        ] {
            if let Some(Accuracy { precision, auc }) = accuracy {
                write!(f, ", {name} {precision:.1}/{auc:.1}")?;
            }
        }
        write!(f, " ({:.0} s)", self.seconds)
    }
}

/// Flights for validation have seeds of their own, far from those that training draws.
const FLIGHT_SEED: u64 = 0x5ee_d0ff_1195;

impl Validation {
    /// All sequences below some folders, and `flights` rendered flights; at most `max_frames`
    /// frames of each pass.
    ///
    /// # Errors
    /// If a folder cannot be read, or holds no sequence.
    pub fn open(
        folders: &[PathBuf],
        passes: Passes,
        flights: usize,
        max_frames: usize,
    ) -> Result<Validation, Error> {
        let mut clips = Vec::new();
        for folder in folders {
            let mut skipped = Skipped::default();
            let found = sequences::find(folder, &mut skipped)?;
            eprint!("{skipped}");
            let usable: Vec<Sequence> = match passes {
                Passes::One => found.into_iter().filter(|s| s.boxes[0].is_some()).collect(),
                Passes::Four => found.iter().flat_map(four_passes).collect(),
            };
            if usable.is_empty() {
                let (data, what) = (folder.display().to_string(), "sequence".into());
                return Err(Error::NoData {
                    data,
                    what,
                    skipped: skipped.count(),
                });
            }
            clips.extend(usable.into_iter().map(Clip::Video));
        }
        for i in 0..flights {
            let difficulty = [Difficulty::Easy, Difficulty::Medium, Difficulty::Hard][i % 3];
            let (seed, frames) = (FLIGHT_SEED + i as u64, max_frames.clamp(2, 120));
            clips.push(Clip::Flight(FlightConfig {
                seed,
                frames,
                difficulty,
                ..FlightConfig::default()
            }));
        }
        Ok(Validation { clips, max_frames })
    }

    /// Whether there is nothing to track.
    pub fn is_empty(&self) -> bool {
        self.clips.is_empty()
    }

    /// Tracks all clips, `threads` at a time.
    ///
    /// # Errors
    /// If the weights are not those of a network that can run.
    pub fn run(&self, weights: &Weights, threads: usize) -> Result<Report, Error> {
        let start = Instant::now();
        let model = Model::from_weights(weights, Isa::detect())?;
        let next = AtomicUsize::new(0);
        let work = || {
            let mut found = Vec::new();
            loop {
                let i = next.fetch_add(1, Ordering::Relaxed);
                let Some(clip) = self.clips.get(i) else {
                    return found;
                };
                if let Some(accuracy) = clip.track(&model, self.max_frames) {
                    found.push((i, accuracy));
                }
            }
        };
        let mut found: Vec<(usize, Accuracy)> = std::thread::scope(|scope| {
            let workers: Vec<_> = (0..threads.max(1)).map(|_| scope.spawn(work)).collect();
            workers
                .into_iter()
                .flat_map(|worker| worker.join().expect("tracking does not panic"))
                .collect()
        });
        found.sort_by_key(|(i, _)| *i);
        let mean = |select: &dyn Fn(&Clip) -> bool| {
            mean(
                found
                    .iter()
                    .filter(|(i, _)| select(&self.clips[*i]))
                    .map(|(_, accuracy)| *accuracy),
            )
        };
        Ok(Report {
            clean: mean(&|clip| matches!(clip, Clip::Video(sequence) if !sequence.in_train)),
            real: mean(&|clip| matches!(clip, Clip::Video(_))),
            flights: mean(&|clip| matches!(clip, Clip::Flight(_))),
            clips: found
                .iter()
                .map(|(i, a)| (self.clips[*i].name(), self.clips[*i].in_train(), *a))
                .collect(),
            seconds: start.elapsed().as_secs_f64(),
        })
    }
}

impl Clip {
    fn name(&self) -> String {
        match self {
            Clip::Video(sequence) => sequence.name.clone(),
            Clip::Flight(config) => format!(
                "flight {} {:?}",
                config.seed - FLIGHT_SEED,
                config.difficulty
            ),
        }
    }

    fn in_train(&self) -> bool {
        matches!(self, Clip::Video(Sequence { in_train: true, .. }))
    }

    /// Tracks the clip once; `None` if its first frame is unusable.
    fn track(&self, model: &Model, max_frames: usize) -> Option<Accuracy> {
        let mut run = Run {
            tracker: Tracker::new(model.clone()),
            pairs: Vec::new(),
        };
        match self {
            Clip::Video(sequence) => {
                let frames = sequence.frames.iter().zip(&sequence.boxes).take(max_frames);
                for (path, truth) in frames {
                    match Picture::read(path) {
                        Ok(picture) => run.frame(&picture, *truth)?,
                        Err(reason) => eprintln!("skipped: {reason}"),
                    }
                }
                Some(accuracy(&run.pairs, sequence.scale))
            }
            Clip::Flight(config) => {
                let flight = Flight::new(config.clone());
                let mut frame = FrameBuffer::default();
                for i in 0..flight.len() {
                    let truth = flight.render(i, &mut frame);
                    let picture = Picture::new(frame.width, frame.height, frame.data.clone());
                    let b = truth.bbox;
                    let bbox = (truth.visible > 0.3).then(|| BBox::new(b.x, b.y, b.w, b.h));
                    run.frame(&picture, bbox)?;
                }
                Some(accuracy(&run.pairs, 1.0))
            }
        }
    }
}

/// A tracker within a clip.
struct Run {
    tracker: Tracker,
    pairs: Vec<(BBox, BBox)>, // found, true
}

impl Run {
    /// Tracks one frame; the first one gives the target. `None` if the tracker refuses it.
    fn frame(&mut self, picture: &Picture, truth: Option<BBox>) -> Option<()> {
        let found = if self.pairs.is_empty() {
            let bbox = truth?;
            self.tracker.init(&picture.frame(), bbox).ok()?;
            bbox
        } else {
            self.tracker.update(&picture.frame()).ok()?.bbox
        };
        if let Some(truth) = truth {
            self.pairs.push((found, truth));
        }
        Some(())
    }
}

/// Accuracy of `(found, true)` boxes in pictures of a `scale`, by the rule of the got10k toolkit.
fn accuracy(pairs: &[(BBox, BBox)], scale: f32) -> Accuracy {
    let rect = |b: &BBox| Rect::from([b.x, b.y, b.w, b.h]);
    let found: Vec<Rect> = pairs.iter().map(|(found, _)| rect(found)).collect();
    let truth = Annotation {
        scale: scale.into(),
        ..Annotation::new("", pairs.iter().map(|(_, truth)| rect(truth)).collect())
    };
    match Convention::Got10k.curves(&truth, &found) {
        Some(curves) => Accuracy {
            precision: 100.0 * curves.precision(),
            auc: 100.0 * curves.auc(),
        },
        None => Accuracy::default(),
    }
}

fn mean(of: impl Iterator<Item = Accuracy>) -> Option<Accuracy> {
    let all: Vec<_> = of.collect();
    let n = all.len() as f64;
    (n > 0.0).then(|| Accuracy {
        precision: all.iter().map(|a| a.precision).sum::<f64>() / n,
        auc: all.iter().map(|a| a.auc).sum::<f64>() / n,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_passes_start_where_the_target_is_visible() {
        let some = Some(BBox::new(1.0, 1.0, 9.0, 9.0));
        let whole = Sequence {
            name: "set/a".into(),
            frames: (0..6).map(|i| i.to_string().into()).collect(),
            boxes: vec![some, some, some, None, some, None],
            scale: 1.0,
            in_train: false,
        };

        let passes = four_passes(&whole);

        let order = |pass: &Sequence| -> String {
            pass.frames
                .iter()
                .map(|path| path.display().to_string())
                .collect()
        };
        let found: Vec<_> = passes.iter().map(|p| (p.name.as_str(), order(p))).collect();
        let expected = [
            ("set/a", "012345"),
            ("set/a.middle", "2345"),
            ("set/a.backwards", "43210"),
            ("set/a.middle-backwards", "210"),
        ];
        assert_eq!(
            found,
            expected.map(|(name, order)| (name, order.to_owned()))
        );
        for pass in &passes {
            assert!(pass.boxes[0].is_some() && pass.boxes.len() == pass.frames.len());
            assert_eq!(sequence_of(&pass.name), "set/a");
        }
        assert!(
            four_passes(&Sequence {
                boxes: vec![None; 6],
                ..whole
            })
            .is_empty()
        );
    }

    #[test]
    fn known_boxes_have_their_accuracy() {
        let truth = BBox::new(10.0, 10.0, 40.0, 40.0);
        let perfect = accuracy(&[(truth, truth); 3], 1.0);
        assert!(
            (perfect.precision - 100.0).abs() < 1e-9
                && (perfect.auc - 100.0 * 20.0 / 21.0).abs() < 1e-9
        );
        let beside = BBox::new(32.0, 10.0, 40.0, 40.0); // 22 pixels off, IoU 18 / 62
        let mixed = accuracy(&[(truth, truth), (beside, truth)], 1.0);
        assert!((mixed.precision - 50.0).abs() < 1e-9);
        assert!(
            (mixed.auc - (20.0 * 50.0 + 6.0 * 50.0) / 21.0).abs() < 1e-9,
            "{}",
            mixed.auc
        );
        assert_eq!(accuracy(&[(beside, truth)], 2.0).precision, 100.0);
    }

    #[test]
    fn flights_are_tracked_and_scored() {
        let validation = Validation::open(&[], Passes::One, 2, 24).unwrap();
        let random = Weights::random(crate::fit::standard(0.9), 1);
        let report = validation.run(&random, 2).unwrap();
        assert_eq!(
            (report.clips.len(), report.clean, report.real),
            (2, None, None)
        );
        assert_eq!(report.score(), report.flights.map(|a| a.auc));
        assert!(report.flights.unwrap().auc < 90.0, "{report}");
    }
}
