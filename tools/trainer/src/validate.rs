//! Accuracy as users meet it: one-pass evaluation with the real tracker on sequences and flights that are not trained on.
//!
//! Precision at 20 pixels of the original video and success AUC by the rule of the got10k toolkit (spec section 4.2); frames
//! without the target are left out.

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

/// What is tracked to see how good weights are.
#[derive(Clone, Debug, Default)]
pub struct Validation {
    clips: Vec<Clip>,
    max_frames: usize,
}

#[derive(Clone, Debug)]
enum Clip {
    Video(Sequence),
    Flight(FlightConfig),
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
    /// Per clip: its name, whether its video is also trained on, its accuracy.
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
    /// The one number to compare by: AUC of the cleanest real sequences there are, or else of the flights.
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
            ("clean", self.clean),
            ("real", self.real),
            ("flights", self.flights),
        ] {
            if let Some(Accuracy { precision, auc }) = accuracy {
                write!(f, " {name} {precision:.1}/{auc:.1}")?;
            }
        }
        write!(f, " ({:.0} s)", self.seconds)
    }
}

/// Flights for validation have seeds of their own, far from those that training draws.
const FLIGHT_SEED: u64 = 0x5ee_d0ff_1195;

impl Validation {
    /// All sequences below some folders, and `flights` rendered flights; at most `max_frames` frames of each.
    ///
    /// # Errors
    /// If a folder cannot be read, or holds no sequence.
    pub fn open(
        folders: &[PathBuf],
        flights: usize,
        max_frames: usize,
    ) -> Result<Validation, Error> {
        let mut clips = Vec::new();
        for folder in folders {
            let mut skipped = Skipped::default();
            let found = sequences::find(folder, &mut skipped)?;
            eprint!("{skipped}");
            let usable: Vec<_> = found.into_iter().filter(|s| s.boxes[0].is_some()).collect();
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

    /// Tracks every clip, `threads` at a time.
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

    /// One pass with one tracker; `None` if its first frame cannot be used.
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

/// A tracker on its way through a clip.
struct Run {
    tracker: Tracker,
    pairs: Vec<(BBox, BBox)>, // found, true
}

impl Run {
    /// The first frame gives the target; `None` if it cannot.
    fn frame(&mut self, picture: &Picture, truth: Option<BBox>) -> Option<()> {
        let found = match self.pairs.is_empty() {
            true => {
                let bbox = truth?;
                self.tracker.init(&picture.frame(), bbox).ok()?;
                bbox
            }
            false => self.tracker.update(&picture.frame()).ok()?.bbox,
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
    fn accuracy_of_known_boxes() {
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
        let validation = Validation::open(&[], 2, 24).unwrap();
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
