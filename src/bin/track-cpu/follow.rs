//! What follows the target in `track`: the tracker as published, or flight mode.

use track_cpu::flight::{Budget, FlightOptions, FlightTracker};
use track_cpu::{BBox, Frame, Model, State, TrackError, Tracker};

use crate::args::{EngineArgs, Mode};
use crate::exit::Failure;

/// Searches per frame while the target is lost: a number, not a time, so that every run gives the same boxes.
const SEARCHES: u32 = 2;

/// A tracker of either mode.
pub enum Follower {
    /// As published.
    Paper(Box<Tracker>),
    /// Knows when the target is lost.
    Flight(Box<FlightTracker>),
}

/// Where the target is.
pub struct Found {
    /// Its box in frame pixels.
    pub bbox: BBox,
    /// Raw score; none for the box given.
    pub score: Option<f32>,
    /// Presence and state in flight mode.
    pub sureness: Option<(f32, State)>,
}

impl Follower {
    /// # Errors
    /// If the model's presence coefficients are wrong.
    pub fn new(model: Model, engine: &EngineArgs, mode: Mode) -> Result<Follower, Failure> {
        let options = engine.options(&model);
        Ok(match mode {
            Mode::Paper => Follower::Paper(Box::new(Tracker::with_options(model, options))),
            Mode::Flight => {
                let (threads, cores) = (engine.threads, engine.cores());
                let options = FlightOptions {
                    threads,
                    cores,
                    ..FlightOptions::new(&model)
                };
                Follower::Flight(Box::new(FlightTracker::new(model, options)?))
            }
        })
    }

    /// Takes what is inside the box as the target.
    ///
    /// # Errors
    /// As [`Tracker::init`].
    pub fn start(&mut self, frame: &Frame<'_>, bbox: BBox) -> Result<Found, TrackError> {
        let sureness = match self {
            Follower::Paper(tracker) => tracker.init(frame, bbox).map(|()| None)?,
            Follower::Flight(tracker) => tracker
                .init(frame, bbox)
                .map(|()| Some((1.0, State::Tracking)))?,
        };
        Ok(Found {
            bbox,
            score: None,
            sureness,
        })
    }

    /// Finds it in the next frame.
    ///
    /// # Errors
    /// As [`Tracker::update`].
    pub fn follow(&mut self, frame: &Frame<'_>) -> Result<Found, TrackError> {
        Ok(match self {
            Follower::Paper(tracker) => {
                let track = tracker.update(frame)?;
                Found {
                    bbox: track.bbox,
                    score: Some(track.score),
                    sureness: None,
                }
            }
            Follower::Flight(tracker) => {
                let track = tracker.update(frame, Budget::Searches(SEARCHES))?;
                let sureness = Some((track.presence, track.state));
                Found {
                    bbox: track.bbox,
                    score: Some(track.score),
                    sureness,
                }
            }
        })
    }
}
