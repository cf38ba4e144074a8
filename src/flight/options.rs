//! What goes into a [`FlightTracker`](super::FlightTracker) and what comes out.

use super::state::State;
use crate::bbox::BBox;
use crate::config::TrackConfig;
use crate::model::Model;
use kernels::par::Cores;
use std::ops::RangeInclusive;
use std::time::Duration;

/// Frames per second where nothing else is said.
pub(super) const USUAL_RATE: f64 = 30.0;

/// Frames per second that [`FlightOptions`] may have.
pub const FRAME_RATES: RangeInclusive<f64> = 0.1..=1000.0;

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
    /// Least presence at which its motion is kept for later searches, and similar objects beside it
    /// become rivals.
    pub sure: f64,
    /// Presence below which an empty look counts as absence, and no motion is learned.
    pub absent: f64,
    /// Seconds for which nothing may be seen of the target before the box is given up.
    pub patience: f64,
    /// Seconds of coasting before the target counts as lost.
    pub coast: f64,
    /// Looks in a row, one a frame, that confirm a place for a lost target.
    pub confirm: u32,
    /// Frames per second, in [`FRAME_RATES`], unless every frame comes with its time.
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
            fps: USUAL_RATE,
            conduct: Conduct::Recover,
        }
    }
}

/// The thresholds that [`FlightOptions::set`] knows by name, with what is allowed.
const THRESHOLDS: [(&str, RangeInclusive<f64>, &str); 6] = [
    ("present", 0.0..=1.0, "0 to 1"),
    ("sure", 0.0..=1.0, "0 to 1"),
    ("absent", 0.0..=1.0, "0 to 1"),
    ("patience", 0.0..=3600.0, "0 to 3600 seconds"),
    ("coast", 0.0..=3600.0, "0 to 3600 seconds"),
    ("confirm", 1.0..=1000.0, "1 to 1000 looks"),
];

/// A threshold that is refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("threshold {name} is {found}, expected {expected}")]
pub struct ThresholdError {
    /// Its name.
    pub name: String,
    /// The number given.
    pub found: f64,
    /// What was expected.
    pub expected: String,
}

impl FlightOptions {
    /// Sets the threshold of a name: `present`, `sure`, `absent`, `patience`, `coast`, `confirm`.
    ///
    /// # Errors
    /// If there is no such threshold, or the number is out of its range.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), ThresholdError> {
        check_threshold(name, value)?;
        match name {
            "present" => self.present = value,
            "sure" => self.sure = value,
            "absent" => self.absent = value,
            "patience" => self.patience = value,
            "coast" => self.coast = value,
            _ => self.confirm = value as u32,
        }
        Ok(())
    }

    /// All thresholds with their names.
    pub fn thresholds(&self) -> [(&'static str, f64); THRESHOLDS.len()] {
        [
            ("present", self.present),
            ("sure", self.sure),
            ("absent", self.absent),
            ("patience", self.patience),
            ("coast", self.coast),
            ("confirm", self.confirm.into()),
        ]
    }
}

/// Whether [`FlightOptions::set`] takes this.
///
/// # Errors
/// As of [`FlightOptions::set`].
pub fn check_threshold(name: &str, value: f64) -> Result<(), ThresholdError> {
    let wrong = |expected: String| ThresholdError {
        name: name.chars().take(40).collect(),
        found: value,
        expected,
    };
    let Some((_, allowed, expected)) = THRESHOLDS.iter().find(|(known, ..)| *known == name) else {
        let names = THRESHOLDS.each_ref().map(|(known, ..)| *known).join(", ");
        return Err(wrong(format!("one of {names}")));
    };
    if allowed.contains(&value) {
        Ok(())
    } else {
        Err(wrong((*expected).into()))
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

#[cfg(test)]
mod tests {
    use super::*;
    use kernels::Isa;

    #[test]
    fn threshold_is_set_by_name_within_its_range() {
        let mut options = FlightOptions::new(&Model::builtin(Isa::detect()));

        for (name, value) in options.thresholds() {
            assert_eq!(options.set(name, value), Ok(()), "{name}");
        }
        options.set("coast", 2.5).unwrap();
        options.set("confirm", 5.0).unwrap();

        assert_eq!((options.coast, options.confirm), (2.5, 5));
        for (name, value, part) in [
            ("present", 1.5, "threshold present is 1.5, expected 0 to 1"),
            ("sure", f64::NAN, "sure is NaN"),
            ("confirm", 0.0, "confirm is 0, expected 1 to 1000 looks"),
            ("patients", 1.0, "expected one of present, sure"),
        ] {
            let before = options;
            let refused = options.set(name, value).unwrap_err().to_string();
            assert!(refused.contains(part), "{refused}");
            assert_eq!(options, before);
        }
    }
}
