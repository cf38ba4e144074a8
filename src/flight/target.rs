//! The target's motion, with what is kept of it for the case that the present box turns out wrong.

use super::camera::Motion;
use super::kalman::Kalman;
use crate::bbox::FrameBox;

/// Frames that the target must stay surely seen before its motion is remembered.
const ANCHOR_AGE: u32 = 4;
/// Frames during which a re-acquisition may be taken back.
const PROBATION: u32 = 30;

/// A motion that was remembered some frames ago, predicted since.
#[derive(Clone, Copy, Debug)]
struct Aged {
    motion: Kalman,
    age: u32, // in frames
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
    /// A target that stands still.
    pub(super) fn new(bbox: &FrameBox) -> Target {
        let motion = Kalman::new(bbox);
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
                age: 0,
            }),
            ..Target::new(bbox)
        }
    }

    /// Carries everything into the next frame.
    pub(super) fn predict(&mut self, motion: &Motion) {
        self.motion.predict(motion);
        self.anchor.predict(motion);
        let aged = self.next_anchor.iter_mut().chain(&mut self.probation);
        for aged in aged {
            aged.motion.predict(motion);
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
            age: 0,
        };
        self.next_anchor = match self.next_anchor {
            _ if !sure => None,
            None => Some(fresh),
            Some(aged) if aged.age == ANCHOR_AGE => {
                self.anchor = aged.motion;
                Some(fresh)
            }
            Some(aged) => Some(Aged {
                age: aged.age + 1,
                ..aged
            }),
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

    /// What was searched for before the last re-acquisition, as long as that is on probation; counts
    /// a frame of it.
    pub(super) fn on_probation(&mut self) -> Option<Kalman> {
        let before = self.probation?;
        let age = before.age + 1;
        self.probation = (before.age < PROBATION).then_some(Aged { age, ..before });
        Some(before.motion)
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
