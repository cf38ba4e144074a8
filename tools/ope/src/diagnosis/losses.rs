//! Losses: every time a tracker goes off its target, for how long, and how its box moved.

use super::{OFF, ON, overlap, visible_frames};
use crate::score::Evaluated;
use crate::starts;
use sequences::Rect;
use serde::Serialize;

/// Visible frames off the target in a row that make a loss; fewer are a slip.
const LEAST_FRAMES: usize = 5;
/// Frames before a loss in which the box may have grown or shrunk.
const BEFORE: usize = 40;
/// Area of the box, in areas of the truth, above which it has grown over something else.
const GROWN: f64 = 2.0;
/// Area of the box, in areas of the truth, below which it has shrunk onto a part.
const SHRUNK: f64 = 0.4;
/// Movement of the box's center in one frame, in sides of the truth, above which it has jumped.
const JUMP: f64 = 1.0;
/// Movement of the box's center per frame, in sides of the truth, below which it stays in place.
const STILL: f64 = 0.05;
/// Frames after a loss over which the movement of the box is measured.
const AFTER: usize = 10;

/// What a box did when it left the target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// The tracker gave no usable box.
    NoBox,
    /// The target was hidden in a frame between the last one on it and the loss.
    Hidden,
    /// The box moved by more than a side within one frame.
    Jumped,
    /// The box had grown to more than twice the target's area.
    Grew,
    /// The box had shrunk onto a part of the target.
    Shrank,
    /// The box stayed in its place in the picture while the target moved away.
    Stayed,
    /// The box slid off with something else.
    Slid,
}

impl Cause {
    /// What the box did, in words for a table.
    pub fn words(self) -> &'static str {
        match self {
            Cause::NoBox => "gave no box",
            Cause::Hidden => "was left when the target was hidden",
            Cause::Jumped => "jumped to something else",
            Cause::Grew => "grew over a neighbor or background",
            Cause::Shrank => "shrank onto a part",
            Cause::Stayed => "stayed in its place",
            Cause::Slid => "slid off with something else",
        }
    }
}

/// One loss of the target.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Loss {
    /// The pass, or the sequence where there is one pass.
    pub pass: String,
    /// The sequence.
    pub sequence: String,
    /// The first frame off the target, counted from 0 along the pass.
    pub frame: usize,
    /// The last frame on the target before the loss.
    pub last_on: usize,
    /// The frame in which the tracker is on the target again; `None` if it never is.
    pub back: Option<usize>,
    /// Visible frames until the tracker is back, or until the end of the pass.
    pub lost_for: usize,
    /// What the box did.
    pub cause: Cause,
    /// Greatest area of the box in the frames before, in areas of the truth.
    pub area_before: f64,
    /// Distance of the centers at the loss, in sides of the truth.
    pub distance: f64,
    /// The box that the tracker gave in the first frame off the target; `None` if it is not usable.
    pub went_to: Option<[f64; 4]>,
}

/// The losses of one pass.
pub fn of(pass: &Evaluated) -> Vec<Loss> {
    let visible: Vec<(usize, f64)> = visible_frames(pass)
        .map(|i| (i, overlap(pass, i)))
        .collect();
    let mut losses = Vec::new();
    let mut last_on = 0;
    let mut at = 0;
    while at < visible.len() {
        let (frame, overlap) = visible[at];
        if overlap >= OFF {
            last_on = frame;
            at += 1;
            continue;
        }
        // Off until the tracker is on the target again, or until the end.
        let off = visible[at..]
            .iter()
            .take_while(|(_, overlap)| *overlap < ON)
            .count();
        let back = visible.get(at + off).map(|(frame, _)| *frame);
        if off >= LEAST_FRAMES {
            losses.push(Loss {
                back,
                lost_for: off,
                ..loss(pass, frame, last_on)
            });
        }
        at += off;
    }
    losses
}

/// A loss whose first frame off the target is `frame`; [`of`] fills in its end.
fn loss(pass: &Evaluated, frame: usize, last_on: usize) -> Loss {
    let name = &pass.annotation.name;
    let truth = pass.annotation.boxes[frame];
    let found = pass.boxes.get(frame).copied().unwrap_or(Rect::NONE);
    let (dx, dy) = found.offset(&truth);
    let area = |i: usize| {
        let truth = &pass.annotation.boxes[i];
        let found = &pass.boxes[i];
        (found.w * found.h) / (truth.w * truth.h)
    };
    let before = frame.saturating_sub(BEFORE).max(1)..=last_on;
    let areas = before.filter(|i| pass.annotation.is_visible(*i)).map(area);
    Loss {
        pass: name.clone(),
        sequence: starts::sequence_of(name).to_owned(),
        frame,
        last_on,
        back: None,
        lost_for: 0,
        cause: cause(pass, frame, last_on),
        area_before: areas.fold(1.0, f64::max),
        distance: if found.is_usable() {
            dx.hypot(dy) / truth.side()
        } else {
            0.0
        },
        went_to: found.is_usable().then(|| found.to_array()),
    }
}

/// Why the pass lost its target: the first cause that applies. An earlier one can bring about those
/// after it.
fn cause(pass: &Evaluated, frame: usize, last_on: usize) -> Cause {
    let annotation = &pass.annotation;
    let Some(found) = pass.boxes.get(frame).filter(|found| found.is_usable()) else {
        return Cause::NoBox;
    };
    if (last_on..frame).any(|i| !annotation.is_visible(i)) {
        return Cause::Hidden;
    }
    let side = annotation.boxes[frame].side();
    let moved = |from: usize, to: usize| {
        let (dx, dy) = pass.boxes[to].offset(&pass.boxes[from]);
        dx.hypot(dy) / side
    };
    if (last_on + 1..=frame).any(|i| moved(i - 1, i) > JUMP) {
        return Cause::Jumped;
    }
    let truth = annotation.boxes[last_on];
    let last = pass.boxes[last_on];
    let area = (last.w * last.h) / (truth.w * truth.h);
    let area_at_loss = (found.w * found.h) / (side * side);
    if area.max(area_at_loss) > GROWN {
        return Cause::Grew;
    }
    if area.min(area_at_loss) < SHRUNK {
        return Cause::Shrank;
    }
    let end = (frame + AFTER).min(pass.boxes.len() - 1);
    if moved(last_on, end) < STILL * (end - last_on) as f64 {
        return Cause::Stayed;
    }
    Cause::Slid
}
