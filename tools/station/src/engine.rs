//! The interface between a station and a tracker.

use std::time::Duration;

use crate::picture::{FrameBox, Picture};
use crate::report::Tracked;

/// A tracker that follows one target or none.
pub trait Engine {
    /// Takes what is inside `target` as the target, and forgets any earlier one.
    ///
    /// # Errors
    /// If the box is unusable; the text says why. The earlier target is kept.
    fn start(&mut self, picture: &Picture, target: FrameBox) -> Result<Tracked, String>;

    /// Forgets the target.
    fn stop(&mut self);

    /// Finds the target in the next picture, taken `elapsed` after the one before; `None` without a
    /// target.
    ///
    /// The search for a lost target takes at most `budget`, but always makes one attempt.
    fn follow(&mut self, picture: &Picture, elapsed: Duration, budget: Duration)
    -> Option<Tracked>;
}
