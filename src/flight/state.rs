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

/// A sighting with its history, in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Observation {
    pub sighting: Sighting,
    /// Time in the state, this frame included.
    pub age: f64,
    /// Time for which all sightings were [`Sighting::Absent`], this one included.
    pub absent_for: f64,
}

/// Times after which a state ends, in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limits {
    /// Time of absent sightings after which the box is given up; `None` for never.
    pub patience: Option<f64>,
    /// Time of [`State::Coasting`].
    pub coast: f64,
    /// Time of [`State::Reacquired`].
    pub fresh: f64,
}

impl State {
    /// The state after an observation.
    pub(super) fn next(self, observation: Observation, limits: &Limits) -> State {
        let Observation {
            age, absent_for, ..
        } = observation;
        let is_given_up = limits
            .patience
            .is_some_and(|patience| absent_for >= patience);
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

/// The state with what led to it; all times are in seconds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Standing {
    pub state: State,
    /// Time in the state.
    pub age: f64,
    /// Seconds from the frame before to this one.
    pub dt: f64,
    /// Time for which all sightings were absent.
    absent_for: f64,
    /// Time for which no box was believed.
    doubted: f64,
    /// Time since the last box that was not believed, or since the target was found again.
    calm: f64,
}

/// Seconds after the last doubt before appearance is learned again: after an occlusion the visible
/// object may be a different one, and learning it would make the error permanent.
const CALM: f64 = 1.5;
/// Seconds of doubt before the target is searched for elsewhere as well.
const DOUBTED: f64 = 0.5;

impl Standing {
    /// A target that was just given.
    pub(super) fn new() -> Standing {
        Standing {
            state: State::Tracking,
            age: 0.0,
            dt: 0.0,
            absent_for: 0.0,
            doubted: 0.0,
            calm: CALM,
        }
    }

    /// Another frame has come, `dt` seconds after the last.
    pub(super) fn tick(&mut self, dt: f64) {
        self.dt = dt;
        self.age += dt;
    }

    /// Moves on to the next state; returns whether it is another one.
    pub(super) fn advance(&mut self, sighting: Sighting, limits: &Limits) -> bool {
        match sighting {
            Sighting::Absent => self.absent_for += self.dt,
            Sighting::Present | Sighting::Doubtful => self.absent_for = 0.0,
            Sighting::Found => {
                self.absent_for = 0.0;
                self.doubted = 0.0;
                self.calm = 0.0;
            }
            Sighting::Impossible | Sighting::Unseen => {}
        }
        let observation = Observation {
            sighting,
            age: self.age,
            absent_for: self.absent_for,
        };
        let next = self.state.next(observation, limits);
        let changes = next != self.state;
        if changes {
            self.state = next;
            self.age = 0.0;
        }
        changes
    }

    /// Counts a followed frame as believed or not; returns whether a long doubt ends with it.
    pub(super) fn count_belief(&mut self, believed: bool) -> bool {
        let ends_doubt = believed && self.is_doubted();
        if believed {
            self.doubted = 0.0;
            self.calm += self.dt;
        } else {
            self.doubted += self.dt;
            self.calm = 0.0;
        }
        ends_doubt
    }

    /// Whether what is followed has been doubted for so long that it should be searched for
    /// elsewhere.
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
            patience: Some(0.5),
            coast: 1.0,
            fresh: 0.33,
        };
        // state, sighting, seconds in the state, seconds of absent sightings, next state
        let table = [
            (Tracking, Present, 2.0, 0.0, Tracking),
            (Tracking, Doubtful, 2.0, 0.0, LowConfidence),
            (Tracking, Absent, 2.0, 0.1, LowConfidence),
            (Tracking, Absent, 2.0, 0.5, Coasting),
            (Tracking, Impossible, 2.0, 0.0, Coasting),
            (LowConfidence, Present, 0.1, 0.0, Tracking),
            (LowConfidence, Doubtful, 20.0, 0.0, LowConfidence),
            (LowConfidence, Absent, 0.4, 0.4, LowConfidence),
            (LowConfidence, Absent, 0.6, 0.6, Coasting),
            (LowConfidence, Found, 3.0, 0.0, Reacquired),
            (Coasting, Unseen, 1.0, 0.0, Coasting),
            (Coasting, Unseen, 1.1, 0.0, Lost),
            (Coasting, Found, 0.2, 0.0, Reacquired),
            (Lost, Unseen, 90.0, 0.0, Lost),
            (Lost, Found, 90.0, 0.0, Reacquired),
            (Reacquired, Present, 0.3, 0.0, Reacquired),
            (Reacquired, Present, 0.4, 0.0, Tracking),
            (Reacquired, Doubtful, 0.1, 0.0, LowConfidence),
            (Reacquired, Impossible, 0.1, 0.0, Coasting),
        ];

        for (state, sighting, age, absent_for, expected) in table {
            let observation = Observation {
                sighting,
                age,
                absent_for,
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
            coast: 1.0,
            fresh: 0.33,
        };
        let observation = Observation {
            sighting: Sighting::Absent,
            age: 30.0,
            absent_for: 30.0,
        };

        let next = State::LowConfidence.next(observation, &limits);

        assert_eq!(next, State::LowConfidence);
    }
}
