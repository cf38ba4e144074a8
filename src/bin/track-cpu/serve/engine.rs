//! The tracker of `serve` and `replay`: one way to run a frame, so that both do exactly the same.

use std::time::Duration;

use station::{Candidate, Engine, FrameBox, Picture, State, Tracked};
use track_cpu::flight::{Budget, Conduct, FlightOptions, FlightTracker};
use track_cpu::{BBox, Frame, Model};

use crate::args::{EngineArgs, Mode};
use crate::exit::Failure;
use crate::follow::flight_options;

// Station and tracker know nothing of each other, but mean the same by a believed target.
const _: () = assert!(station::BELIEVED == track_cpu::flight::BELIEVED);

/// A tracker that may have no target.
pub struct TrackerEngine {
    tracker: FlightTracker,
    mode: Mode,
}

impl TrackerEngine {
    /// # Errors
    /// If the model's presence coefficients are wrong, or a threshold is.
    pub fn new(
        model: Model,
        args: &EngineArgs,
        mode: Mode,
        thresholds: &[(String, f64)],
    ) -> Result<TrackerEngine, Failure> {
        let conduct = match mode {
            Mode::Flight => Conduct::Recover,
            Mode::Plain => Conduct::Tell,
        };
        let options = FlightOptions {
            conduct,
            ..flight_options(&model, args, thresholds)?
        };
        Ok(TrackerEngine {
            tracker: FlightTracker::new(model, options)?,
            mode,
        })
    }

    /// Finds the target in the next picture, taken `elapsed` after the one before (`None`: at the
    /// rate of the tracker's options), with this budget for the search of a lost one.
    pub fn find(
        &mut self,
        picture: &Picture,
        elapsed: Option<Duration>,
        budget: Budget,
    ) -> Option<Tracked> {
        let frame = frame(picture).ok()?;
        let track = match elapsed {
            Some(elapsed) => self.tracker.update_after(elapsed, &frame, budget),
            None => self.tracker.update(&frame, budget),
        };
        let track = track.ok()?;
        let tells_state = self.mode == Mode::Flight;
        // The first candidate is the choice itself.
        let others = self.tracker.candidates().iter().skip(1);
        Some(Tracked {
            bbox: frame_box(&track.bbox),
            presence: tells_state.then_some(track.presence),
            score: track.score,
            state: if tells_state {
                state(track.state)
            } else {
                State::Tracking
            },
            searches: track.searches,
            others: others
                .map(|other| Candidate {
                    bbox: frame_box(&other.bbox),
                    score: other.score,
                    similarity: other.similarity,
                })
                .collect(),
        })
    }
}

impl Engine for TrackerEngine {
    fn start(&mut self, picture: &Picture, target: FrameBox) -> Result<Tracked, String> {
        let bbox = BBox::new(target.x, target.y, target.w, target.h);
        self.tracker
            .init(&frame(picture)?, bbox)
            .map_err(|error| error.to_string())?;
        Ok(Tracked::certain(target))
    }

    fn stop(&mut self) {
        self.tracker.stop();
    }

    fn follow(
        &mut self,
        picture: &Picture,
        elapsed: Duration,
        budget: Duration,
    ) -> Option<Tracked> {
        self.find(picture, Some(elapsed), Budget::Deadline(budget))
    }
}

/// The picture as the tracker takes it.
pub fn frame(picture: &Picture) -> Result<Frame<'_>, String> {
    Frame::new(&picture.data, picture.width, picture.height, picture.order)
        .map_err(|error| error.to_string())
}

/// The box as the station knows it.
pub fn frame_box(bbox: &BBox) -> FrameBox {
    FrameBox::new(bbox.x, bbox.y, bbox.w, bbox.h)
}

/// The state as the station knows it.
pub fn state(state: track_cpu::State) -> State {
    match state {
        track_cpu::State::Tracking => State::Tracking,
        track_cpu::State::LowConfidence => State::LowConfidence,
        track_cpu::State::Coasting => State::Coasting,
        track_cpu::State::Lost => State::Lost,
        track_cpu::State::Reacquired => State::Reacquired,
    }
}
