//! What goes into a [`FlightTracker`](super::FlightTracker) and what comes out.

use super::state::State;
use crate::bbox::BBox;
use crate::config::TrackConfig;
use crate::model::Model;
use kernels::par::Cores;
use std::time::Duration;

/// How a [`FlightTracker`](super::FlightTracker) is to run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightOptions {
    /// Threads that one frame is spread over.
    pub threads: usize,
    /// Processor cores that they are held on.
    pub cores: Cores,
    /// Hyper-parameters of the plain tracker.
    pub config: TrackConfig,
    /// Least presence at which the target counts as seen.
    pub present: f64,
    /// Least presence at which its motion is believed.
    pub sure: f64,
    /// Presence below which an empty look counts as absence.
    pub absent: f64,
    /// Seconds for which nothing may be seen of the target before the box is given up.
    pub patience: f64,
    /// Seconds of coasting before the target counts as lost.
    pub coast: f64,
    /// Looks in a row, one a frame, that confirm a place for a lost target.
    pub confirm: u32,
    /// Frames per second, unless every frame comes with its time.
    pub fps: f64,
    /// What it does about a target that may not be there.
    pub conduct: Conduct,
}

impl FlightOptions {
    /// The defaults for a model: one thread, its own hyper-parameters.
    pub fn new(model: &Model) -> FlightOptions {
        FlightOptions {
            threads: 1,
            cores: Cores::ANY,
            config: model.config(),
            present: 0.5,
            sure: 0.8,
            absent: 0.01,
            patience: 0.5,
            coast: 1.0,
            confirm: 3,
            fps: 30.0,
            conduct: Conduct::Recover,
        }
    }
}

/// What a [`FlightTracker`](super::FlightTracker) does about a target that may not be there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conduct {
    /// It coasts and searches.
    Recover,
    /// The plain tracker runs on; only `presence` tells.
    Tell,
}

/// How much work one frame may cost; the first search is always made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Budget {
    /// As many searches as should fit into this time.
    Deadline(Duration),
    /// Exactly this many searches, if there is something to search for; alike on every machine.
    Searches(u32),
}

/// Where the target is in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightTrack {
    /// The target's box in frame pixels; predicted where the state says so.
    pub bbox: BBox,
    /// Raw score of the last search; no probability.
    pub score: f32,
    /// Probability that the box is on the target.
    pub presence: f32,
    /// How sure that is.
    pub state: State,
    /// Searches made for this frame.
    pub searches: u32,
}

/// Least presence of a box that is worth acting on; few boxes on the target are below it.
pub const BELIEVED: f32 = 0.4;

impl FlightTrack {
    /// Whether the box is worth acting on: the target is seen, and its presence at least
    /// [`BELIEVED`].
    pub fn is_believed(&self) -> bool {
        self.state.is_seen() && self.presence >= BELIEVED
    }
}
