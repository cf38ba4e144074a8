//! The difficulties in numbers.

use crate::Difficulty;
use crate::camera::Manner;

/// How a difficulty shapes a flight.
pub(crate) struct Preset {
    pub pace: f32,
    pub manner: Manner,
    pub distractors: usize,
    pub twins: f32,
    pub occlusions: bool,
    pub exits: bool,
    /// Standard deviation of the sensor's noise, of 255.
    pub noise: f32,
    /// Share of the time between frames that the shutter is open.
    pub shutter: f32,
    pub haze: (f32, f32),
    /// Chance that a thing that hides the target by accident is kept.
    pub clutter: f32,
}

impl Preset {
    pub fn of(difficulty: Difficulty) -> Preset {
        match difficulty {
            Difficulty::Easy => Preset {
                pace: 0.7,
                manner: Manner {
                    wander: 0.22,
                    shake: 0.4,
                    climb: 0.10,
                    yaw: 0.02,
                },
                distractors: 3,
                twins: 0.0,
                occlusions: false,
                exits: false,
                noise: 1.0,
                shutter: 0.0,
                haze: (0.0, 0.06),
                clutter: 0.0,
            },
            Difficulty::Medium => Preset {
                pace: 1.0,
                manner: Manner {
                    wander: 0.42,
                    shake: 1.4,
                    climb: 0.18,
                    yaw: 0.06,
                },
                distractors: 6,
                twins: 0.25,
                occlusions: true,
                exits: false,
                noise: 2.2,
                shutter: 0.35,
                haze: (0.02, 0.14),
                clutter: 0.3,
            },
            Difficulty::Hard => Preset {
                pace: 1.4,
                manner: Manner {
                    wander: 0.6,
                    shake: 3.2,
                    climb: 0.27,
                    yaw: 0.11,
                },
                distractors: 12,
                twins: 0.55,
                occlusions: true,
                exits: true,
                noise: 4.5,
                shutter: 0.6,
                haze: (0.05, 0.28),
                clutter: 0.6,
            },
        }
    }
}
