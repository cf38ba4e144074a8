//! The tracker of `serve` and `replay`: one way to run a frame, so that both do exactly the same.

use track_cpu::flight::{Budget, Conduct, FlightOptions, FlightTracker};
use track_cpu::{BBox, Frame, Model, State, TrackError};

use super::report::Tracked;
use crate::args::{EngineArgs, Mode};
use crate::exit::Failure;

/// A tracker that may have no target.
pub struct Engine {
    tracker: FlightTracker,
    mode: Mode,
}

impl Engine {
    /// # Errors
    /// If the model's presence coefficients are wrong.
    pub fn new(model: Model, args: &EngineArgs, mode: Mode) -> Result<Engine, Failure> {
        let (threads, cores) = (args.threads, args.cores());
        let conduct = match mode {
            Mode::Flight => Conduct::Recover,
            Mode::Plain => Conduct::Tell,
        };
        let options = FlightOptions {
            threads,
            cores,
            conduct,
            ..FlightOptions::new(&model)
        };
        Ok(Engine {
            tracker: FlightTracker::new(model, options)?,
            mode,
        })
    }

    /// Takes a target.
    ///
    /// # Errors
    /// If the box is none or lies outside the frame; an earlier target is kept.
    pub fn start(&mut self, frame: &Frame<'_>, bbox: BBox) -> Result<Tracked, TrackError> {
        self.tracker.init(frame, bbox)?;
        let state = State::Tracking;
        Ok(Tracked {
            bbox,
            presence: Some(1.0),
            score: 1.0,
            state,
            searches: 0,
            candidates: Vec::new(),
        })
    }

    /// Forgets the target.
    pub fn stop(&mut self) {
        self.tracker.stop();
    }

    /// Follows the target, if there is one.
    pub fn follow(&mut self, frame: &Frame<'_>, budget: Budget) -> Option<Tracked> {
        let track = self.tracker.update(frame, budget).ok()?;
        let paper = self.mode == Mode::Plain;
        Some(Tracked {
            bbox: track.bbox,
            presence: (!paper).then_some(track.presence),
            score: track.score,
            state: if paper { State::Tracking } else { track.state },
            searches: track.searches,
            candidates: self.tracker.candidates().to_vec(),
        })
    }
}
