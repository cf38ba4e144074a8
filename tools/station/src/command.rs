//! Commands of clients, and their outcomes.

use std::sync::{Arc, Condvar, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::hub::lock;
use crate::picture::FrameBox;
use crate::report::TargetId;

/// How long a command may wait to be carried out.
pub const LIFETIME: Duration = Duration::from_secs(2);

/// Side of the box around a point without a radius, as a share of the frame's height.
const POINT_SIDE: f32 = 0.12;
/// Smallest side of a box in pixels.
const MIN_SIDE: f32 = 2.0;
/// Least share of the frame's width and height of a box that counts as the whole frame.
const WHOLE: f32 = 0.95;

/// The place of a target to follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// A rectangle around it: left, top, right, bottom as shares (0 to 1) of width and height.
    Rectangle([f32; 4]),
    /// A point on it, in shares of width and height.
    Point {
        /// Share of the width.
        x: f32,
        /// Share of the height.
        y: f32,
        /// Radius of the object as a share of the width, if it is known.
        radius: Option<f32>,
    },
    /// A box around it, in pixels of the frame.
    Pixels(FrameBox),
}

impl Target {
    /// The box in pixels of a frame of this size.
    ///
    /// # Errors
    /// If the box is too small, or is the whole frame.
    pub fn in_frame(&self, (width, height): (usize, usize)) -> Result<FrameBox, String> {
        let (w, h) = (width as f32, height as f32);
        let bbox = match *self {
            Target::Rectangle([x1, y1, x2, y2]) => {
                let (left, right) = (x1.min(x2) * w, x1.max(x2) * w);
                let (top, bottom) = (y1.min(y2) * h, y1.max(y2) * h);
                FrameBox::new(left, top, right - left, bottom - top)
            }
            Target::Point { x, y, radius } => {
                let side = radius
                    .filter(|radius| *radius > 0.0)
                    .map_or(POINT_SIDE * h, |radius| 2.0 * radius.min(0.5) * w)
                    .max(8.0);
                FrameBox::new(x * w - side / 2.0, y * h - side / 2.0, side, side)
            }
            Target::Pixels(bbox) => bbox,
        };
        if bbox.w < MIN_SIDE || bbox.h < MIN_SIDE {
            return Err(format!(
                "a box of {:.1}x{:.1} pixels, expected sides of at least {MIN_SIDE}",
                bbox.w, bbox.h
            ));
        }
        if bbox.w > WHOLE * w && bbox.h > WHOLE * h {
            return Err("the box is the whole frame, expected an object in it".into());
        }
        Ok(bbox)
    }
}

/// A command of a client.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Follow a target.
    Start {
        /// Where the target is.
        target: Target,
        /// The frame in which the client saw it; `None` for the newest.
        frame: Option<u64>,
        /// The number under which it is followed; `None` for the lowest that is free.
        id: Option<TargetId>,
    },
    /// Stop following.
    Stop {
        /// The number of the target; `None` for all.
        id: Option<TargetId>,
    },
}

impl Command {
    /// Reads a start: `{"rectangle": [left, top, right, bottom]}` or `{"point": [x, y]}` in shares
    /// of the frame, or `{"box": [left, top, width, height]}` in its pixels; `"frame"`, the number
    /// of the frame in which they were seen, and `"target"`, the number of the target, if they are
    /// given. Other fields are ignored.
    ///
    /// `None` if the value is anything else.
    pub fn start(value: &Value) -> Option<Command> {
        let numbers = |field: &str| -> Option<Vec<f32>> {
            let mut numbers = Vec::new();
            for number in value.get(field)?.as_array()? {
                numbers.push(number.as_f64()? as f32);
            }
            Some(numbers)
        };
        let rectangle = numbers("rectangle");
        let point = numbers("point");
        let pixels = numbers("box");
        let target = match (rectangle.as_deref(), point.as_deref(), pixels.as_deref()) {
            (Some(&[x1, y1, x2, y2]), None, None) => Target::Rectangle([x1, y1, x2, y2]),
            (None, Some(&[x, y]), None) => Target::Point { x, y, radius: None },
            (None, None, Some(&[x, y, w, h])) => Target::Pixels(FrameBox::new(x, y, w, h)),
            _ => return None,
        };
        let frame = whole(value, "frame")?;
        let id = number(value)?;
        Some(Command::Start { target, frame, id })
    }

    /// Reads a stop, which may name its `"target"`; other fields are ignored.
    ///
    /// `None` if it names no number.
    pub fn stop(value: &Value) -> Option<Command> {
        let id = number(value)?;
        Some(Command::Stop { id })
    }

    /// Whether it can only be carried out on a frame.
    pub fn needs_frames(&self) -> bool {
        matches!(self, Command::Start { .. })
    }

    /// Checks its numbers.
    ///
    /// # Errors
    /// If a number is not finite or far outside of the frame, or the box is empty.
    pub fn check(&self) -> Result<(), String> {
        let Command::Start { target, .. } = self else {
            return Ok(());
        };
        let within = |share: &f32| (-0.05..=1.05).contains(share);
        let is_sound = match target {
            Target::Rectangle(r) => r.iter().all(within) && r[0] != r[2] && r[1] != r[3],
            Target::Point { x, y, .. } => within(x) && within(y),
            Target::Pixels(bbox) => bbox.is_finite() && bbox.w > 0.0 && bbox.h > 0.0,
        };
        if is_sound {
            Ok(())
        } else {
            Err("expected a rectangle, point or box within the frame".into())
        }
    }
}

/// The number of the target that a command names, if it names one; `None` if that is no number.
fn number(value: &Value) -> Option<Option<TargetId>> {
    let id = whole(value, "target")?;
    match id {
        None => Some(None),
        Some(id) => TargetId::try_from(id).ok().map(Some),
    }
}

/// A whole number, if the field is there; `None` if it is anything else.
fn whole(value: &Value, field: &str) -> Option<Option<u64>> {
    match value.get(field) {
        None | Some(Value::Null) => Some(None),
        Some(number) => number.as_u64().map(Some),
    }
}

/// The outcome of a command.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// It was carried out.
    Done,
    /// A target of this number is followed.
    Started(TargetId),
    /// It cannot be carried out, for this reason. An earlier target stays.
    Refused(String),
    /// The source delivers no frames.
    NoFrames,
    /// No frame came within `LIFETIME`.
    Expired,
    /// Too many commands wait.
    Busy,
}

impl Outcome {
    /// A sentence for people.
    pub fn words(&self) -> String {
        match self {
            Outcome::Done | Outcome::Started(_) => "done".into(),
            Outcome::Refused(reason) => format!("refused: {reason}"),
            Outcome::NoFrames => "refused: the source delivers no frames".into(),
            Outcome::Expired => "refused: no frame came in time".into(),
            Outcome::Busy => "refused: too many commands wait".into(),
        }
    }
}

type Shared = Arc<(Mutex<Option<Outcome>>, Condvar)>;

/// A client's side of a command.
#[derive(Clone, Debug)]
pub struct Receipt(Shared);

impl Receipt {
    /// A receipt whose outcome is known.
    pub fn resolved(outcome: Outcome) -> Receipt {
        Receipt(Arc::new((Mutex::new(Some(outcome)), Condvar::new())))
    }

    /// The outcome, once it is known.
    pub fn outcome(&self) -> Option<Outcome> {
        lock(&self.0.0).clone()
    }

    /// Waits for the outcome. A command that is not resolved in time has expired.
    pub fn wait(&self, patience: Duration) -> Outcome {
        let (outcome, known) = &*self.0;
        let waited = known.wait_timeout_while(lock(outcome), patience, |outcome| outcome.is_none());
        let outcome = waited
            .unwrap_or_else(std::sync::PoisonError::into_inner)
            .0
            .clone();
        outcome.unwrap_or(Outcome::Expired)
    }
}

/// The tracking thread's side of a command.
#[derive(Debug)]
pub struct Pending {
    /// The command.
    pub command: Command,
    until: Instant,
    receipt: Shared,
}

impl Pending {
    /// A command that starts to wait now, and its receipt.
    pub(crate) fn new(command: Command, now: Instant) -> (Pending, Receipt) {
        let shared: Shared = Arc::default();
        let pending = Pending {
            command,
            until: now + LIFETIME,
            receipt: Arc::clone(&shared),
        };
        (pending, Receipt(shared))
    }

    /// Whether it has waited too long.
    pub fn is_expired(&self, now: Instant) -> bool {
        now >= self.until
    }

    /// Passes the outcome to the receipt.
    pub fn resolve(&self, outcome: Outcome) {
        *lock(&self.receipt.0) = Some(outcome);
        self.receipt.1.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn target_in_shares_becomes_a_box_in_pixels() {
        let size = (200, 100);

        let rectangle = Target::Rectangle([0.75, 0.5, 0.25, 0.1]).in_frame(size);
        let point = Target::Point {
            x: 0.5,
            y: 0.5,
            radius: Some(0.1),
        }
        .in_frame(size);

        assert_eq!(rectangle, Ok(FrameBox::new(50.0, 10.0, 100.0, 40.0)));
        assert_eq!(point, Ok(FrameBox::new(80.0, 30.0, 40.0, 40.0)));
    }

    #[test]
    fn tiny_box_and_whole_frame_are_refused() {
        for (rectangle, part) in [
            ([0.5, 0.5, 0.5001, 0.5001], "at least 2"),
            ([0.0, 0.0, 1.0, 1.0], "whole frame"),
        ] {
            let refused = Target::Rectangle(rectangle).in_frame((640, 480));

            assert!(refused.unwrap_err().contains(part), "{rectangle:?}");
        }
    }

    #[test]
    fn senseless_numbers_are_refused() {
        for target in [
            Target::Rectangle([f32::NAN, 0.0, 1.0, 1.0]),
            Target::Rectangle([0.5, 0.5, 0.5, 0.9]),
            Target::Rectangle([0.0, 0.0, 7.0, 1.0]),
            Target::Point {
                x: 0.5,
                y: f32::INFINITY,
                radius: None,
            },
        ] {
            let command = Command::Start {
                target,
                frame: None,
                id: None,
            };

            assert!(command.check().is_err(), "{target:?}");
        }
    }

    #[test]
    fn start_is_read_with_care() {
        let read = |text: &str| Command::start(&serde_json::from_str(text).unwrap());
        let id = None;
        let start = |target, frame| Some(Command::Start { target, frame, id });

        let rectangle = Target::Rectangle([0.0, 0.25, 0.5, 1.0]);
        let point = Target::Point {
            x: 0.5,
            y: 0.25,
            radius: None,
        };
        for (text, expected) in [
            (
                r#"{"rectangle": [0, 0.25, 0.5, 1]}"#,
                start(rectangle, None),
            ),
            (r#"{"point": [0.5, 0.25]}"#, start(point, None)),
            (
                r#"{"point": [0.5, 0.25], "frame": 12}"#,
                start(point, Some(12)),
            ),
            (
                r#"{"box": [12, 8.5, 40, 30]}"#,
                start(Target::Pixels(FrameBox::new(12.0, 8.5, 40.0, 30.0)), None),
            ),
            (
                r#"{"point": [0.5, 0.25], "target": 3}"#,
                Some(Command::Start {
                    target: point,
                    frame: None,
                    id: Some(3),
                }),
            ),
            ("{}", None),
            (r#"{"box": [1, 2, 3, 4], "point": [0.5, 0.25]}"#, None),
            ("[1,2,3,4]", None),
            (r#"{"rectangle": [0, 1]}"#, None),
            (r#"{"point": ["a", 1]}"#, None),
            (r#"{"point": [0.5, 0.25], "frame": -1}"#, None),
            (r#"{"point": [0.5, 0.25], "target": "3"}"#, None),
        ] {
            assert_eq!(read(text), expected, "{text}");
        }
    }

    #[test]
    fn stop_may_name_a_target() {
        for (text, expected) in [
            ("{}", Some(None)),
            (r#"{"target": null}"#, Some(None)),
            (r#"{"target": 2}"#, Some(Some(2))),
            (r#"{"target": -2}"#, None),
            (r#"{"target": [2]}"#, None),
        ] {
            let read = Command::stop(&serde_json::from_str(text).unwrap());

            assert_eq!(read, expected.map(|id| Command::Stop { id }), "{text}");
        }
    }

    #[test]
    fn command_expires_and_its_client_learns_it() {
        let now = Instant::now();
        let (pending, receipt) = Pending::new(Command::Stop { id: None }, now);

        assert!(!pending.is_expired(now));
        assert!(pending.is_expired(now + LIFETIME));
        assert_eq!(receipt.wait(Duration::ZERO), Outcome::Expired);
        pending.resolve(Outcome::Done);
        assert_eq!(receipt.wait(Duration::ZERO), Outcome::Done);
    }
}
