//! What is told about one frame, and how.

use serde_json::{Value, json};
use track_cpu::flight::Candidate;
use track_cpu::{BBox, State};

use crate::report::rounded;

/// What is told about one frame.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Index of the frame in its source.
    pub frame: u64,
    /// Milliseconds since the program began at which the frame was delivered.
    pub time_ms: f64,
    /// The frame's width and height in pixels.
    pub size: (usize, usize),
    /// `None` while nothing is followed.
    pub track: Option<Tracked>,
    /// Milliseconds from the frame's delivery to this report.
    pub latency_ms: f64,
    /// Milliseconds that tracking took.
    pub work_ms: f64,
    /// Frames dropped so far, because a newer one was there.
    pub dropped: u64,
    /// Reports withheld so far, because their frame was too old.
    pub late: u64,
}

/// Where the target is.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Its box in frame pixels.
    pub bbox: BBox,
    /// Probability that the box is on it; `None` in the paper's mode.
    pub presence: Option<f32>,
    /// Raw score.
    pub score: f32,
    /// How sure that is.
    pub state: State,
    /// Searches made.
    pub searches: u32,
    /// Other places that look like it.
    pub candidates: Vec<Candidate>,
}

impl Report {
    /// Word for the state, `idle` while nothing is followed.
    pub fn state(&self) -> &'static str {
        self.track
            .as_ref()
            .map_or("idle", |track| track.state.name())
    }

    /// One JSON object.
    pub fn to_json(&self) -> Value {
        let mut value = json!({
            "frame": self.frame,
            "time_ms": rounded(self.time_ms, 1),
            "size": [self.size.0, self.size.1],
            "state": self.state(),
            "latency_ms": rounded(self.latency_ms, 2),
            "work_ms": rounded(self.work_ms, 2),
            "dropped": self.dropped,
            "late": self.late,
        });
        if let Some(track) = &self.track {
            value["box"] = numbers(&track.bbox);
            value["presence"] = track
                .presence
                .map_or(Value::Null, |p| rounded(f64::from(p), 4));
            value["score"] = rounded(f64::from(track.score), 4);
            value["searches"] = track.searches.into();
            let others = track.candidates.iter().skip(1).take(3);
            value["others"] = others
                .map(|c| json!({ "box": numbers(&c.bbox), "score": rounded(f64::from(c.score), 3), "similarity": rounded(f64::from(c.similarity), 3) }))
                .collect();
        }
        value
    }
}

fn numbers(bbox: &BBox) -> Value {
    [bbox.x, bbox.y, bbox.w, bbox.h]
        .map(|v| rounded(f64::from(v), 2))
        .to_vec()
        .into()
}
