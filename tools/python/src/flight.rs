//! `FlightTracker`: boxes with a presence, and a search for a lost target.

use std::ops::RangeInclusive;
use std::time::Duration;

use pyo3::prelude::*;
use track_cpu::flight::{Budget, Candidate, Conduct, FRAME_RATES};
use track_cpu::shared::Shared;
use track_cpu::{FlightOptions, FlightTrack, State};

use crate::failure::Failure;
use crate::image::{Image, Order};
use crate::model::{Engine, Model, Source, uncopied};
use crate::results::{self, Corners, bbox, corners};

/// Searches per picture while the target is lost, as in `track-cpu track --mode flight`.
const SEARCHES: u32 = 2;

/// Follows one object, says whether it is there, and finds it again after it was hidden.
///
/// Model, pictures, boxes, errors, threads and fork are as in Tracker. While the target is surely
/// seen, boxes are those of Tracker. `tracker(image)` does what `tracker.update(image)` does, and
/// returns a FlightTrack: ok, box, score, presence, state, searches. The other options are:
///
/// - fps: pictures per second, 0.1 to 1000, unless update is told the time; 30.
/// - present: least presence at which the target counts as seen, 0 to 1; 0.5.
/// - sure: least presence of a sure sight, which makes look-alikes beside it rivals, 0 to 1; 0.8.
/// - absent: presence below which an empty look counts as absence, 0 to 1; 0.01.
/// - patience: seconds without the target before its box is given up; 0.5.
/// - coast: seconds of prediction before the target counts as lost; 1.0.
/// - confirm: looks in a row that confirm a place for a lost target; 3.
/// - recover: False leaves the tracker alone and only reports presence; True.
/// - searches: searches per picture for a target that is not seen, 1 to 1000; 2.
/// - deadline: seconds for each picture, in place of a number of searches. Results then depend on
///   the machine's speed.
#[pyclass(frozen, subclass, module = "track_cpu")]
pub struct FlightTracker {
    held: Shared<Held>,
    model: track_cpu::Model,
    budget: Budget,
    threads: usize,
    order: Order,
}

/// The tracker and its last result.
struct Held {
    tracker: track_cpu::FlightTracker,
    last: Option<FlightTrack>,
}

#[pymethods]
impl FlightTracker {
    #[new]
    #[pyo3(
        signature = (
            model = Source::standard(), *, precision = None, threads = 1, as_published = false,
            order = "bgr", fps = None, present = None, sure = None, absent = None, patience = None,
            coast = None, confirm = None, recover = true, searches = None, deadline = None
        ),
        text_signature = "(model='drmim-p50', *, precision=None, threads=1, as_published=False, \
                          order='bgr', fps=None, present=None, sure=None, absent=None, \
                          patience=None, coast=None, confirm=None, recover=True, searches=None, \
                          deadline=None)"
    )]
    #[expect(clippy::too_many_arguments, reason = "Python names them")]
    fn new(
        py: Python<'_>,
        model: Source<'_>,
        precision: Option<&str>,
        threads: i64,
        as_published: bool,
        order: &str,
        fps: Option<f64>,
        present: Option<f64>,
        sure: Option<f64>,
        absent: Option<f64>,
        patience: Option<f64>,
        coast: Option<f64>,
        confirm: Option<i32>,
        recover: bool,
        searches: Option<i64>,
        deadline: Option<f64>,
    ) -> PyResult<FlightTracker> {
        let engine = Engine::new(py, model, precision, threads, as_published, order)?;
        let standard = FlightOptions::new(&engine.model);
        let conduct = if recover {
            Conduct::Recover
        } else {
            Conduct::Tell
        };
        let mut options = FlightOptions {
            threads: engine.threads,
            config: engine.config,
            fps: number("fps", fps, FRAME_RATES, standard.fps)?,
            conduct,
            ..standard
        };
        let thresholds = [
            ("present", present),
            ("sure", sure),
            ("absent", absent),
            ("patience", patience),
            ("coast", coast),
            ("confirm", confirm.map(f64::from)),
        ];
        for (name, value) in thresholds {
            if let Some(value) = value {
                options.set(name, value).map_err(Failure::from)?;
            }
        }
        let searches = count("searches", searches, 1..=1000, SEARCHES)?;
        let deadline = deadline
            .map(|deadline| number("deadline", Some(deadline), SECONDS, 0.0))
            .transpose()?;
        let budget = deadline.map_or(Budget::Searches(searches), |deadline| {
            Budget::Deadline(Duration::from_secs_f64(deadline))
        });
        let tracker = track_cpu::FlightTracker::new(engine.model.clone(), options);
        let tracker = tracker.map_err(Failure::from)?;
        let threads = tracker.tracker().threads();
        let last = None;
        Ok(FlightTracker {
            held: Shared::new(Held { tracker, last }, threads),
            model: engine.model,
            budget,
            threads,
            order: engine.order,
        })
    }

    /// Takes the object within the box as the target, forgetting any earlier one.
    ///
    /// Arguments and errors are those of Tracker.init.
    #[pyo3(signature = (image, r#box))]
    fn init(
        &self,
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        r#box: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let image = Image::of(image, self.order)?;
        let frame = image.frame()?;
        let target = bbox(r#box)?;
        let begun = py.detach(|| -> Result<(), Failure> {
            let mut held = self.held.lock()?;
            held.tracker.init(&frame, target)?;
            held.last = Some(FlightTrack {
                bbox: target,
                score: 1.0,
                presence: 1.0,
                state: State::Tracking,
                searches: 0,
            });
            Ok(())
        });
        Ok(begun?)
    }

    /// Finds the target in the next picture: (ok, (left, top, width, height)).
    ///
    /// `ok` says whether the box is worth acting on: the target is seen, and `presence` is at least
    /// track_cpu.BELIEVED. Otherwise the box may be off the target, or is predicted. `elapsed` is
    /// the time since the picture before in seconds; None means 1 / fps.
    ///
    /// Raises ValueError if the picture is none or the time negative, RuntimeError if there is no
    /// target.
    #[pyo3(signature = (image, elapsed = None))]
    fn update(
        &self,
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        elapsed: Option<f64>,
    ) -> PyResult<(bool, Corners)> {
        let track = self.find(py, image, elapsed)?;
        Ok((track.is_believed(), corners(track.bbox)))
    }

    /// Does what update does and returns a FlightTrack: ok, box, score, presence, state, searches.
    #[pyo3(signature = (image, elapsed = None))]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
        elapsed: Option<f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let track = self.find(py, image, elapsed)?;
        results::flight_track(py, track)
    }

    /// Forgets the target: update raises RuntimeError until the next init.
    fn stop(&self, py: Python<'_>) -> PyResult<()> {
        let stopped = py.detach(|| -> Result<(), Failure> {
            let mut held = self.held.lock()?;
            held.tracker.stop();
            held.last = None;
            Ok(())
        });
        Ok(stopped?)
    }

    /// The last FlightTrack; None without a target.
    #[getter]
    fn track<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let last = self.last(py)?;
        last.map(|track| results::flight_track(py, track))
            .transpose()
    }

    /// Whether the last box is worth acting on.
    #[getter]
    fn ok(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.last(py)?.is_some_and(|track| track.is_believed()))
    }

    /// "tracking", "low_confidence", "coasting" (hidden: the box is predicted), "lost" (gone: the
    /// box is where it would be) or "reacquired"; None without a target.
    #[getter]
    fn state(&self, py: Python<'_>) -> PyResult<Option<&'static str>> {
        Ok(self.last(py)?.map(|track| track.state.name()))
    }

    /// Probability that the last box is on the target, 0 to 1; 0 without a target.
    #[getter]
    fn presence(&self, py: Python<'_>) -> PyResult<f32> {
        Ok(self.last(py)?.map_or(0.0, |track| track.presence))
    }

    /// How well the last box fits, 0 to 1, no probability; 1 after init, 0 without a target.
    #[getter]
    fn score(&self, py: Python<'_>) -> PyResult<f32> {
        Ok(self.last(py)?.map_or(0.0, |track| track.score))
    }

    /// The score, by the name that OpenCV's trackers have for it.
    #[pyo3(name = "getTrackingScore")]
    fn tracking_score(&self, py: Python<'_>) -> PyResult<f32> {
        self.score(py)
    }

    /// At most five Candidates of the last search, the chosen one first: box, score, similarity.
    #[getter]
    fn candidates<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let found = py.detach(|| -> Result<Vec<Candidate>, Failure> {
            Ok(self.held.lock()?.tracker.candidates().to_vec())
        });
        found?
            .into_iter()
            .map(|found| results::candidate(py, found))
            .collect()
    }

    /// The model, to be shared with other trackers.
    #[getter]
    fn model(&self) -> Model {
        let inner = self.model.clone();
        Model { inner }
    }

    /// Threads that work on one picture: fewer than asked for if the system refused them.
    #[getter]
    fn threads(&self) -> usize {
        self.threads
    }

    /// Order of the colors of arrays: "bgr" or "rgb".
    #[getter]
    fn order(&self) -> &'static str {
        self.order.name()
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(uncopied("FlightTracker", "make a new one and init it"))
    }
}

impl FlightTracker {
    fn find(
        &self,
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        elapsed: Option<f64>,
    ) -> PyResult<FlightTrack> {
        let image = Image::of(image, self.order)?;
        let frame = image.frame()?;
        let elapsed = elapsed
            .map(|elapsed| number("elapsed", Some(elapsed), SECONDS, 0.0))
            .transpose()?
            .map(Duration::from_secs_f64);
        let found = py.detach(|| -> Result<FlightTrack, Failure> {
            let mut held = self.held.lock()?;
            let tracker = &mut held.tracker;
            let track = match elapsed {
                Some(elapsed) => tracker.update_after(elapsed, &frame, self.budget)?,
                None => tracker.update(&frame, self.budget)?,
            };
            held.last = Some(track);
            Ok(track)
        });
        Ok(found?)
    }

    fn last(&self, py: Python<'_>) -> PyResult<Option<FlightTrack>> {
        let last =
            py.detach(|| -> Result<Option<FlightTrack>, Failure> { Ok(self.held.lock()?.last) });
        Ok(last?)
    }
}

/// Times that an option may have: up to a day.
const SECONDS: RangeInclusive<f64> = 0.0..=86_400.0;

fn number(
    name: &str,
    given: Option<f64>,
    range: RangeInclusive<f64>,
    standard: f64,
) -> Result<f64, Failure> {
    let number = given.unwrap_or(standard);
    if range.contains(&number) {
        return Ok(number);
    }
    let (least, most) = range.into_inner();
    Err(Failure::Argument(format!(
        "{name} is {number}, expected a number from {least} to {most}"
    )))
}

fn count(
    name: &str,
    given: Option<i64>,
    range: RangeInclusive<u32>,
    standard: u32,
) -> Result<u32, Failure> {
    let Some(given) = given else {
        return Ok(standard);
    };
    let number = u32::try_from(given).ok().filter(|n| range.contains(n));
    let (least, most) = range.into_inner();
    number.ok_or_else(|| {
        Failure::Argument(format!(
            "{name} is {given}, expected a whole number from {least} to {most}"
        ))
    })
}
