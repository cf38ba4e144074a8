//! The state machine of flight mode: [`State::next`] is all of it.

/// How sure the tracker is of its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum State {
    /// The box is on the target.
    Tracking,
    /// The box may be on the target.
    LowConfidence,
    /// The target is hidden; the box is predicted from its motion and the camera's.
    Coasting,
    /// The target is gone and searched for; the box is where it would be.
    Lost,
    /// The target has just been found again.
    Reacquired,
}

/// What one frame showed of the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sighting {
    /// Presence says that the box is on it.
    Present,
    /// Presence says that the box may be off it.
    Doubtful,
    /// Everything speaks against the box.
    Absent,
    /// The box is where the target cannot be.
    Impossible,
    /// No search of this frame confirmed it.
    Unseen,
    /// A search confirmed it.
    Found,
}

/// A sighting with its history, in frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Observation {
    pub sighting: Sighting,
    /// Time in the state, this frame included.
    pub age: u32,
    /// Sightings in a row that were [`Sighting::Absent`], this one included.
    pub absent: u32,
}

/// Times after which a state ends, in frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Limits {
    /// Absent sightings in a row after which the box is given up; `None` for never.
    pub patience: Option<u32>,
    /// Time of [`State::Coasting`].
    pub coast: u32,
    /// Time of [`State::Reacquired`].
    pub fresh: u32,
}

impl State {
    /// The state after an observation.
    pub(super) fn next(self, observation: Observation, limits: &Limits) -> State {
        let Observation { age, absent, .. } = observation;
        let is_given_up = limits.patience.is_some_and(|patience| absent >= patience);
        match (self, observation.sighting) {
            (_, Sighting::Found) => State::Reacquired,
            (_, Sighting::Impossible) => State::Coasting,
            (_, Sighting::Absent) if is_given_up => State::Coasting,
            (_, Sighting::Absent | Sighting::Doubtful) => State::LowConfidence,
            (State::Reacquired, Sighting::Present) if age < limits.fresh => State::Reacquired,
            (_, Sighting::Present) => State::Tracking,
            (State::Coasting, Sighting::Unseen) if age > limits.coast => State::Lost,
            (state, Sighting::Unseen) => state,
        }
    }

    /// Whether the box rests on what was seen in this frame.
    pub fn is_seen(self) -> bool {
        matches!(
            self,
            State::Tracking | State::LowConfidence | State::Reacquired
        )
    }

    /// A word for logs and protocols.
    pub fn name(self) -> &'static str {
        match self {
            State::Tracking => "tracking",
            State::LowConfidence => "low_confidence",
            State::Coasting => "coasting",
            State::Lost => "lost",
            State::Reacquired => "reacquired",
        }
    }
}

/// The state with what led to it; all counts are frames.
#[derive(Clone, Copy, Debug)]
pub(super) struct Standing {
    pub state: State,
    /// Time in the state.
    pub age: u32,
    /// Absent sightings in a row.
    absent: u32,
    /// Frames in a row that were not believed.
    doubted: u32,
    /// Frames since the last that was not believed, or since the target was found again.
    calm: u32,
}

/// Frames after the last doubt before appearance is learned again: after an occlusion the visible
/// object may be a different one, and learning it would make the error permanent.
const CALM: u32 = 45;
/// Frames in a row that are not believed before the target is searched for elsewhere as well.
const DOUBTED: u32 = 15;

impl Standing {
    /// A target that was just given.
    pub(super) fn new() -> Standing {
        Standing {
            state: State::Tracking,
            age: 0,
            absent: 0,
            doubted: 0,
            calm: CALM,
        }
    }

    /// Another frame has come.
    pub(super) fn tick(&mut self) {
        self.age = self.age.saturating_add(1);
    }

    /// Moves on to the next state; returns whether it is another one.
    pub(super) fn note(&mut self, sighting: Sighting, limits: &Limits) -> bool {
        match sighting {
            Sighting::Absent => self.absent = self.absent.saturating_add(1),
            Sighting::Present | Sighting::Doubtful => self.absent = 0,
            Sighting::Found => {
                self.absent = 0;
                self.doubted = 0;
                self.calm = 0;
            }
            Sighting::Impossible | Sighting::Unseen => {}
        }
        let observation = Observation {
            sighting,
            age: self.age,
            absent: self.absent,
        };
        let next = self.state.next(observation, limits);
        let changes = next != self.state;
        if changes {
            self.state = next;
            self.age = 0;
        }
        changes
    }

    /// Counts a followed frame as believed or not; returns whether a long doubt ends with it.
    pub(super) fn count(&mut self, believed: bool) -> bool {
        let ends_doubt = believed && self.is_doubted();
        if believed {
            self.doubted = 0;
            self.calm = self.calm.saturating_add(1);
        } else {
            self.doubted = self.doubted.saturating_add(1);
            self.calm = 0;
        }
        ends_doubt
    }

    /// Whether what is followed has been doubted for so long that it should be searched for elsewhere.
    pub(super) fn is_doubted(&self) -> bool {
        self.doubted >= DOUBTED
    }

    /// Whether the last doubt is so long ago that appearance may be learned.
    pub(super) fn is_calm(&self) -> bool {
        self.calm >= CALM
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn next_state_follows_the_table() {
        use Sighting::{Absent, Doubtful, Found, Impossible, Present, Unseen};
        use State::{Coasting, Lost, LowConfidence, Reacquired, Tracking};
        let limits = Limits {
            patience: Some(8),
            coast: 30,
            fresh: 10,
        };
        // state, sighting, time in the state, absent sightings in a row, next state
        let table = [
            (Tracking, Present, 50, 0, Tracking),
            (Tracking, Doubtful, 50, 0, LowConfidence),
            (Tracking, Absent, 50, 1, LowConfidence),
            (Tracking, Absent, 50, 8, Coasting),
            (Tracking, Impossible, 50, 0, Coasting),
            (LowConfidence, Present, 1, 0, Tracking),
            (LowConfidence, Doubtful, 500, 0, LowConfidence),
            (LowConfidence, Absent, 7, 7, LowConfidence),
            (LowConfidence, Absent, 8, 8, Coasting),
            (LowConfidence, Found, 90, 0, Reacquired),
            (Coasting, Unseen, 30, 0, Coasting),
            (Coasting, Unseen, 31, 0, Lost),
            (Coasting, Found, 3, 0, Reacquired),
            (Lost, Unseen, 1000, 0, Lost),
            (Lost, Found, 1000, 0, Reacquired),
            (Reacquired, Present, 9, 0, Reacquired),
            (Reacquired, Present, 10, 0, Tracking),
            (Reacquired, Doubtful, 2, 0, LowConfidence),
            (Reacquired, Impossible, 2, 0, Coasting),
        ];

        for (state, sighting, age, absent, expected) in table {
            let observation = Observation {
                sighting,
                age,
                absent,
            };
            assert_eq!(
                state.next(observation, &limits),
                expected,
                "{state:?} {observation:?}"
            );
        }
    }

    #[test]
    fn target_that_must_not_be_given_up_stays_doubtful() {
        let limits = Limits {
            patience: None,
            coast: 30,
            fresh: 10,
        };
        let observation = Observation {
            sighting: Sighting::Absent,
            age: 900,
            absent: 900,
        };

        let next = State::LowConfidence.next(observation, &limits);

        assert_eq!(next, State::LowConfidence);
    }
}
