//! Flight mode's structs in the layout of the C header.

use crate::failure::Failure;
use crate::track_cpu_box;
use track_cpu::flight::{
    Candidate, Conduct, FRAME_RATES, FlightOptions, FlightTrack, check_threshold,
};
use track_cpu::{BBox, State};

/// Searches per picture where no deadline is given.
pub const SEARCHES: u32 = 2;

/// Thresholds and times of flight mode.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct track_cpu_flight_options {
    /// Least presence of a target that counts as seen.
    pub present: f64,
    /// Least presence at which its motion is kept for later searches, and similar objects beside it
    /// become look-alikes to avoid.
    pub sure: f64,
    /// Presence below which an empty look counts as absence.
    pub absent: f64,
    /// Seconds without a sight of the target after which the box is given up.
    pub patience: f64,
    /// Seconds of coasting before the target counts as lost.
    pub coast: f64,
    /// Pictures per second, unless every picture comes with its time.
    pub fps: f64,
    /// Looks in a row, one a picture, that confirm a place for a lost target.
    pub confirm: u32,
    /// 1 to only follow and report presence, 0 to coast and search as well.
    pub tell_only: u32,
}

/// Where the target is in one picture.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct track_cpu_flight_track {
    /// The target's box; predicted where the state says so.
    pub bbox: track_cpu_box,
    /// Raw score of the last search; no probability.
    pub score: f32,
    /// Probability that the box is on the target.
    pub presence: f32,
    /// 0 tracking, 1 low confidence, 2 coasting, 3 lost, 4 reacquired.
    pub state: u32,
    /// 1 if the box is worth acting on.
    pub believed: u32,
    /// Searches made for this picture.
    pub searches: u32,
}

/// One place where the target may be.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct track_cpu_candidate {
    /// Its box.
    pub bbox: track_cpu_box,
    /// Its score, 0 to 1.
    pub score: f32,
    /// Cosine of its features with the target's, -1 to 1.
    pub similarity: f32,
}

impl track_cpu_flight_options {
    /// The options in the layout of the C header.
    pub(crate) fn of(options: &FlightOptions) -> track_cpu_flight_options {
        track_cpu_flight_options {
            present: options.present,
            sure: options.sure,
            absent: options.absent,
            patience: options.patience,
            coast: options.coast,
            fps: options.fps,
            confirm: options.confirm,
            tell_only: u32::from(options.conduct == Conduct::Tell),
        }
    }

    /// `defaults` with these options in place of theirs.
    ///
    /// # Errors
    /// If a number is none of those allowed.
    pub(crate) fn apply_to(&self, defaults: FlightOptions) -> Result<FlightOptions, Failure> {
        let bounded = [
            ("fps", self.fps, FRAME_RATES, "0.1 to 1000"),
            ("tell_only", self.tell_only.into(), 0.0..=1.0, "0 or 1"),
        ];
        for (name, found, allowed, expected) in bounded {
            if !allowed.contains(&found) {
                return Err(Failure::Number {
                    name,
                    found,
                    expected,
                });
            }
        }
        let conduct = if self.tell_only == 1 {
            Conduct::Tell
        } else {
            Conduct::Recover
        };
        let options = FlightOptions {
            present: self.present,
            sure: self.sure,
            absent: self.absent,
            patience: self.patience,
            coast: self.coast,
            confirm: self.confirm,
            fps: self.fps,
            conduct,
            ..defaults
        };
        for (name, value) in options.thresholds() {
            check_threshold(name, value)?;
        }
        Ok(options)
    }
}

impl From<BBox> for track_cpu_box {
    fn from(bbox: BBox) -> track_cpu_box {
        track_cpu_box {
            x: bbox.x,
            y: bbox.y,
            w: bbox.w,
            h: bbox.h,
        }
    }
}

impl From<FlightTrack> for track_cpu_flight_track {
    fn from(track: FlightTrack) -> track_cpu_flight_track {
        track_cpu_flight_track {
            bbox: track.bbox.into(),
            score: track.score,
            presence: track.presence,
            state: match track.state {
                State::Tracking => 0,
                State::LowConfidence => 1,
                State::Coasting => 2,
                State::Lost => 3,
                State::Reacquired => 4,
            },
            believed: track.is_believed().into(),
            searches: track.searches,
        }
    }
}

impl From<Candidate> for track_cpu_candidate {
    fn from(candidate: Candidate) -> track_cpu_candidate {
        track_cpu_candidate {
            bbox: candidate.bbox.into(),
            score: candidate.score,
            similarity: candidate.similarity,
        }
    }
}
