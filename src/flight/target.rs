//! The target's motion, with what is kept of it for the case that the present box turns out wrong.

use super::camera::Motion;
use super::kalman::Kalman;
use crate::bbox::FrameBox;
use crate::frame::Frame;

/// Seconds that the target must stay surely seen before its motion is remembered.
const ANCHOR_AGE: f64 = 0.15;
/// Seconds during which a re-acquisition may be taken back.
const PROBATION: f64 = 1.0;

/// A motion that was remembered some time ago, predicted since.
#[derive(Clone, Copy, Debug)]
struct Aged {
    motion: Kalman,
    age: f64, // in seconds
}

/// Where the target is and how it moves.
#[derive(Clone, Copy, Debug)]
pub(super) struct Target {
    /// The motion that the box of every frame corrects.
    pub motion: Kalman,
    /// The motion when the target was last surely seen, predicted since.
    anchor: Kalman,
    /// Becomes the anchor if the target stays surely seen.
    next_anchor: Option<Aged>,
    /// What was searched for before the last re-acquisition.
    probation: Option<Aged>,
}

impl Target {
    /// A target that stands still in `frame`.
    pub(super) fn new(bbox: &FrameBox, frame: &Frame<'_>) -> Target {
        Target::moving(Kalman::new(bbox).in_view(frame.width(), frame.height()))
    }

    fn moving(motion: Kalman) -> Target {
        Target {
            motion,
            anchor: motion,
            next_anchor: None,
            probation: None,
        }
    }

    /// A target that was found again at `bbox`, on probation.
    pub(super) fn found(&self, bbox: &FrameBox) -> Target {
        Target {
            probation: Some(Aged {
                motion: self.motion,
                age: 0.0,
            }),
            ..Target::moving(self.motion.found(bbox))
        }
    }

    /// Carries everything into the next frame, `dt` seconds later.
    pub(super) fn predict(&mut self, motion: &Motion, dt: f64) {
        self.motion.predict(motion, dt);
        self.anchor.predict(motion, dt);
        let aged = self.next_anchor.iter_mut().chain(&mut self.probation);
        for aged in aged {
            aged.motion.predict(motion, dt);
            aged.age += dt;
        }
    }

    /// Distance of a box from where the target should be, in target sides.
    pub(super) fn away(&self, bbox: &FrameBox) -> f64 {
        self.motion.distance(bbox)
    }

    /// Whether the target can be there, for all that is known of its motion.
    pub(super) fn can_be_at(&self, bbox: &FrameBox) -> bool {
        self.motion.distance(bbox) <= self.motion.gate()
    }

    /// Remembers the motion a few frames before the last surely seen one: in the frames just before
    /// the target hides, the box already drifts toward the occluder.
    pub(super) fn drop_anchor(&mut self, sure: bool) {
        let fresh = Aged {
            motion: self.motion,
            age: 0.0,
        };
        self.next_anchor = match self.next_anchor {
            _ if !sure => None,
            None => Some(fresh),
            Some(aged) if aged.age >= ANCHOR_AGE => {
                self.anchor = aged.motion;
                Some(fresh)
            }
            young => young,
        };
    }

    /// This target as it moved when it was last surely seen: what was half seen since may have been
    /// what hides it.
    pub(super) fn anchored(&self) -> Target {
        Target {
            motion: self.anchor,
            ..*self
        }
    }

    /// What was searched for before the last re-acquisition, as long as that is on probation.
    pub(super) fn on_probation(&mut self) -> Option<Kalman> {
        self.probation = self.probation.filter(|before| before.age <= PROBATION);
        self.probation.map(|before| before.motion)
    }

    /// Whether the last re-acquisition may still be taken back.
    pub(super) fn is_on_probation(&self) -> bool {
        self.probation.is_some()
    }

    /// Takes the last re-acquisition back: what was searched for `before` is searched for again.
    pub(super) fn take_back(&mut self, before: Kalman) {
        self.motion = before;
        self.anchor = before;
        self.probation = None;
    }
}
