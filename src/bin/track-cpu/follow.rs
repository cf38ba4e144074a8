//! What follows the target in `track`: the tracker alone, or flight mode.

use std::time::Duration;

use track_cpu::flight::{Budget, FlightOptions, FlightTracker, Presence};
use track_cpu::{BBox, Frame, Model, State, TrackError, Tracker};

use crate::args::track::TrackArgs;
use crate::args::{EngineArgs, Mode, Search};
use crate::exit::Failure;

/// Searches per frame while the target is lost: a number, not a time, so that every run gives the
/// same boxes.
const SEARCHES: u32 = 2;

/// A tracker of either mode.
pub enum Follower {
    /// The tracker alone.
    Plain(Box<Tracker>),
    /// Knows when the target is lost.
    Flight {
        /// The tracker.
        tracker: Box<FlightTracker>,
        /// Frames per second.
        fps: f64,
    },
}

/// Where the target is.
#[derive(Clone, Copy)]
pub struct Found {
    /// Its box in frame pixels.
    pub bbox: BBox,
    /// Raw score; none for the box given and for a held box.
    pub score: Option<f32>,
    /// Presence and state in flight mode.
    pub sureness: Option<(f32, State)>,
    /// Whether this is the box of the frame before, since the frame could not be read.
    pub is_held: bool,
}

impl Found {
    /// The same box for the next frame, which cannot be read.
    pub fn held(&self) -> Found {
        Found {
            score: None,
            is_held: true,
            ..*self
        }
    }
}

impl Follower {
    /// A tracker as the command line asks for it.
    ///
    /// # Errors
    /// If the model's presence coefficients are wrong.
    pub fn new(model: Model, args: &TrackArgs) -> Result<Follower, Failure> {
        let engine = &args.engine;
        let options = engine.options(&model);
        Ok(match args.mode {
            Mode::Plain => Follower::Plain(Box::new(Tracker::with_options(model, options))),
            Mode::Flight => {
                let options = flight_options(&model, engine, &args.threshold)?;
                Follower::Flight {
                    tracker: Box::new(FlightTracker::new(model, options)?),
                    fps: args.fps,
                }
            }
        })
    }

    /// Takes what is inside the box as the target.
    ///
    /// # Errors
    /// As [`Tracker::init`].
    pub fn start(&mut self, frame: &Frame<'_>, bbox: BBox) -> Result<Found, Failure> {
        let sureness = match self {
            Follower::Plain(tracker) => tracker.init(frame, bbox).map(|()| None)?,
            Follower::Flight { tracker, .. } => tracker
                .init(frame, bbox)
                .map(|()| Some((1.0, State::Tracking)))?,
        };
        Ok(Found {
            bbox,
            score: None,
            sureness,
            is_held: false,
        })
    }

    /// Finds it in the frame that comes `steps` after the last one: more than one if frames between
    /// could not be read.
    ///
    /// # Errors
    /// As [`Tracker::update`].
    pub fn follow(&mut self, frame: &Frame<'_>, steps: u32) -> Result<Found, TrackError> {
        Ok(match self {
            Follower::Plain(tracker) => {
                let track = tracker.update(frame)?;
                Found {
                    bbox: track.bbox,
                    score: Some(track.score),
                    sureness: None,
                    is_held: false,
                }
            }
            Follower::Flight { tracker, fps } => {
                let elapsed = Duration::from_secs_f64(f64::from(steps) / *fps);
                let track = tracker.update_after(elapsed, frame, Budget::Searches(SEARCHES))?;
                let sureness = Some((track.presence, track.state));
                Found {
                    bbox: track.bbox,
                    score: Some(track.score),
                    sureness,
                    is_held: false,
                }
            }
        })
    }
}

/// Tells the user if flight mode would judge these weights by the coefficients of others, or leaves
/// an option without effect.
pub fn note_flight(model: &Model, engine: &EngineArgs, mode: Mode) {
    if mode != Mode::Flight {
        return;
    }
    if !Presence::is_fitted(model.header()) {
        eprintln!(
            "note: the model has no presence coefficients, so a built-in model's are used; \
             `flightlab calibrate` fits its own"
        );
    }
    if engine.search == Search::Auto {
        eprintln!("note: --search auto has no effect in flight mode, which looks everywhere");
    }
}

/// Flight mode's options as a command line gives them.
///
/// # Errors
/// If a threshold is refused.
pub fn flight_options(
    model: &Model,
    engine: &EngineArgs,
    thresholds: &[(String, f64)],
) -> Result<FlightOptions, Failure> {
    let mut options = FlightOptions {
        threads: engine.threads,
        cores: engine.cores(),
        ..FlightOptions::new(model)
    };
    for (name, value) in thresholds {
        options.set(name, *value)?;
    }
    Ok(options)
}
