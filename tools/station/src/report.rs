//! Reports: what is known about one frame, and how it is written as JSON.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::{Map, Value, json};

use crate::health::Health;
use crate::picture::FrameBox;

/// How sure the tracker is of its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Seen.
    Tracking,
    /// Followed, but perhaps not the target.
    LowConfidence,
    /// Hidden; its place is predicted.
    Coasting,
    /// Gone; it is searched for.
    Lost,
    /// Seen again a moment ago.
    Reacquired,
}

impl State {
    /// All of them.
    pub const ALL: [State; 5] = [
        State::Tracking,
        State::LowConfidence,
        State::Coasting,
        State::Lost,
        State::Reacquired,
    ];

    /// The word for logs and protocols.
    pub fn name(self) -> &'static str {
        match self {
            State::Tracking => "tracking",
            State::LowConfidence => "low_confidence",
            State::Coasting => "coasting",
            State::Lost => "lost",
            State::Reacquired => "reacquired",
        }
    }

    /// Whether the box rests on what was seen in this frame.
    pub fn is_seen(self) -> bool {
        !matches!(self, State::Coasting | State::Lost)
    }
}

/// Another object that looks like the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Its box.
    pub bbox: FrameBox,
    /// Its score, 0 to 1.
    pub score: f32,
    /// Cosine of its features with the target's, -1 to 1.
    pub similarity: f32,
}

/// Number of a target, from 1 on.
pub type TargetId = usize;

/// A target that is followed.
#[derive(Clone, Debug)]
pub struct Followed {
    /// Its number.
    pub id: TargetId,
    /// Number of the start that chose it; later starts have higher ones.
    pub start: u64,
    /// Where it is.
    pub track: Tracked,
}

/// Where a target is.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Its box.
    pub bbox: FrameBox,
    /// Probability that the box is on the target; `None` if the tracker does not estimate it.
    pub presence: Option<f32>,
    /// Raw score.
    pub score: f32,
    /// How sure the tracker is.
    pub state: State,
    /// Searches made.
    pub searches: u32,
    /// Other places that look like the target.
    pub others: Vec<Candidate>,
}

/// Least presence of a box that is acted on.
pub const BELIEVED: f32 = 0.4;

impl Tracked {
    /// Whether the box is worth acting on: the target is seen, and its presence, if the tracker
    /// estimates it, is at least
    /// [`BELIEVED`].
    pub fn is_believed(&self) -> bool {
        self.state.is_seen() && self.presence.is_none_or(|presence| presence >= BELIEVED)
    }

    /// The track of a box that was just given.
    pub fn certain(bbox: FrameBox) -> Tracked {
        Tracked {
            bbox,
            presence: Some(1.0),
            score: 1.0,
            state: State::Tracking,
            searches: 0,
            others: Vec::new(),
        }
    }
}

/// What is known about one frame.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// Index of the frame in its source.
    pub frame: u64,
    /// Milliseconds from the program's start to the frame's delivery.
    pub time_ms: f64,
    /// Time from the frame before, as the tracker was told.
    pub elapsed: Duration,
    /// Width and height of the frame in pixels.
    pub size: (usize, usize),
    /// How many targets can be followed at a time.
    pub room: usize,
    /// The targets that are followed, by rising number.
    pub targets: Vec<Followed>,
    /// Milliseconds from the frame's delivery to this report.
    pub latency_ms: f64,
    /// Milliseconds that tracking took.
    pub work_ms: f64,
    /// Frames dropped so far because a newer one was there.
    pub dropped: u64,
    /// Reports withheld so far because their frame was too old.
    pub late: u64,
    /// Starts carried out so far.
    pub starts: u64,
    /// When the frame was delivered; the report ages from here on. `None` before the first frame.
    pub taken: Option<Instant>,
}

impl Report {
    /// The target of the lowest number, by which autopilots steer.
    pub fn first(&self) -> Option<&Followed> {
        self.targets.first()
    }

    /// Whether outputs give the numbers of targets: a single target needs none.
    pub fn tells_ids(&self) -> bool {
        self.room > 1
    }

    /// The word for the state of the first target, `idle` while nothing is followed.
    pub fn state(&self) -> &'static str {
        self.first()
            .map_or("idle", |target| target.track.state.name())
    }
}

/// Whether a report may still be acted upon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freshness {
    /// The report says where the target is.
    Fresh,
    /// The report says where the target was a moment ago: nothing may move by it.
    Stale,
    /// Frames have stopped: nothing is known.
    Dead,
}

/// The newest report, with its age and freshness at one moment.
#[derive(Clone, Debug)]
pub struct View {
    /// Number of the report; 0 before the first.
    pub number: u64,
    /// The report.
    pub report: Arc<Report>,
    /// Time since its frame was delivered; `None` before the first frame.
    pub age: Option<Duration>,
    /// Whether it may be acted upon.
    pub freshness: Freshness,
    /// Health of the source.
    pub health: Health,
    /// Time between the last two frames; zero before them.
    pub interval: Duration,
}

impl View {
    /// The targets, if it is known now where they are.
    pub fn targets(&self) -> &[Followed] {
        if self.freshness == Freshness::Fresh {
            &self.report.targets
        } else {
            &[]
        }
    }

    /// The first target, if it is known now where it is.
    pub fn first(&self) -> Option<&Followed> {
        self.targets().first()
    }

    /// Frames per second, from the time between the last two; 30 before there are two.
    pub fn frame_rate(&self) -> f32 {
        if self.interval.is_zero() {
            30.0
        } else {
            1.0 / self.interval.as_secs_f32()
        }
    }

    /// The word for the first target's state.
    pub fn state(&self) -> &'static str {
        self.state_of(self.report.first())
    }

    /// The word for a state: the tracker's, `idle` without a target, `stale` with an old report.
    pub fn state_of(&self, target: Option<&Followed>) -> &'static str {
        match target {
            None => "idle",
            Some(_) if self.freshness != Freshness::Fresh => "stale",
            Some(target) => target.track.state.name(),
        }
    }

    /// A JSON object per target, by rising number, or one without a target; a report that may not
    /// be acted upon has no box.
    pub fn to_lines(&self) -> Vec<Value> {
        let targets = &self.report.targets;
        if targets.is_empty() {
            return vec![self.line(None)];
        }
        targets
            .iter()
            .map(|target| self.line(Some(target)))
            .collect()
    }

    /// One JSON object: the line of the first target and, where there is room for several, a list
    /// of all.
    pub fn to_json(&self) -> Value {
        let report = &self.report;
        let mut value = self.line(report.first());
        if report.tells_ids() {
            value["room"] = report.room.into();
            value["targets"] = report
                .targets
                .iter()
                .map(|target| Value::Object(self.fields(target)))
                .collect();
        }
        value
    }

    fn line(&self, target: Option<&Followed>) -> Value {
        let report = &self.report;
        let age_ms = self
            .age
            .map_or(Value::Null, |age| rounded(age.as_secs_f64() * 1e3, 1));
        let mut value = json!({
            "frame": report.frame,
            "time_ms": rounded(report.time_ms, 1),
            "size": [report.size.0, report.size.1],
            "source": self.health.name(),
            "state": self.state_of(target),
            "age_ms": age_ms,
            "latency_ms": rounded(report.latency_ms, 2),
            "work_ms": rounded(report.work_ms, 2),
            "dropped": report.dropped,
            "late": report.late,
        });
        for (name, field) in target
            .map(|target| self.fields(target))
            .into_iter()
            .flatten()
        {
            value[name] = field;
        }
        value
    }

    /// The fields of one target.
    fn fields(&self, target: &Followed) -> Map<String, Value> {
        let mut fields = Map::new();
        let mut tell = |name: &str, value: Value| fields.insert(name.into(), value);
        if self.report.tells_ids() {
            tell("target", target.id.into());
        }
        tell("state", self.state_of(Some(target)).into());
        if self.freshness == Freshness::Fresh {
            let track = &target.track;
            let presence = track.presence.map(|p| rounded(f64::from(p), 4));
            tell("box", numbers(&track.bbox));
            tell("presence", presence.unwrap_or(Value::Null));
            tell("score", rounded(f64::from(track.score), 4));
            tell("searches", track.searches.into());
            tell(
                "others",
                track.others.iter().take(3).map(candidate).collect(),
            );
        }
        fields
    }
}

fn candidate(candidate: &Candidate) -> Value {
    json!({
        "box": numbers(&candidate.bbox),
        "score": rounded(f64::from(candidate.score), 3),
        "similarity": rounded(f64::from(candidate.similarity), 3),
    })
}

fn numbers(bbox: &FrameBox) -> Value {
    [bbox.x, bbox.y, bbox.w, bbox.h]
        .map(|number| rounded(f64::from(number), 2))
        .to_vec()
        .into()
}

/// A number with a given count of decimals; NaN, which JSON lacks, becomes null.
fn rounded(number: f64, decimals: i32) -> Value {
    let scale = 10f64.powi(decimals);
    Value::from((number * scale).round() / scale)
}
