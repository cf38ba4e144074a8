//! Single steps: whether the tracker finds a target that it was near in the previous frame.
//!
//! In one-pass evaluation a single slip decides a sequence, so that figures of nearly equal
//! networks differ by points. Here the tracker is placed near the truth before every frame, off by
//! a quarter of a side in changing directions, and every frame counts. The template is that of the
//! first frame with the model's updates.

use crate::boxes::{from_tracker, to_tracker};
use crate::error::Error;
use crate::picture::decode;
use crate::run::failure;
use sequences::{Rect, Sequence};
use serde::Serialize;
use track_cpu::{Model, Tracker, TrackerOptions};

/// Distance from the truth at which the tracker is placed, in sides of the target (the root of its
/// area).
const OFF: f64 = 0.25;
/// Angle by which the direction changes from frame to frame, in radians.
const TURN: f64 = 2.4;
/// Greatest distance of the centers of a target that is found, in sides of the target.
const FOUND: f64 = 0.3;

/// The result of the steps through one sequence.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Steps {
    /// Frames that count: those with the target whose previous frame has it as well.
    pub frames: usize,
    /// Share of them in which the target was found, in `[0, 1]`.
    pub found: f64,
    /// Mean IoU with the truth.
    pub iou: f64,
}

/// Steps through a sequence on this thread.
///
/// # Errors
/// If a picture cannot be read, or the tracker refuses the first box.
pub fn steps(model: &Model, sequence: &Sequence) -> Result<Steps, Error> {
    let annotation = &sequence.annotation;
    let wrong = |reason: String| failure(&annotation.name, reason);
    let mut tracker = Tracker::with_options(model.clone(), TrackerOptions::of(model));
    let mut before: Option<Rect> = None;
    let mut steps = Steps::default();
    let mut started = false;
    for (i, (path, truth)) in sequence.frames.iter().zip(&annotation.boxes).enumerate() {
        let truth = (annotation.is_present(i) && truth.is_usable()).then_some(*truth);
        let image = decode(path).map_err(wrong)?;
        let frame = image.frame();
        match (truth, before) {
            (Some(truth), Some(before)) => {
                let mut near = to_tracker(before).center();
                let off = OFF * before.side();
                let angle = TURN * i as f64;
                near.cx += (off * angle.cos()) as f32;
                near.cy += (off * angle.sin()) as f32;
                tracker.place(near);
                let found = from_tracker(
                    tracker
                        .update(&frame)
                        .map_err(|error| wrong(error.to_string()))?
                        .bbox,
                );
                let (dx, dy) = found.offset(&truth);
                steps.frames += 1;
                steps.found += f64::from(dx.hypot(dy) < FOUND * truth.side());
                steps.iou += found.iou(&truth);
            }
            (Some(truth), None) if !started => {
                tracker
                    .init(&frame, to_tracker(truth))
                    .map_err(|error| wrong(error.to_string()))?;
                started = true;
            }
            _ => {}
        }
        before = truth;
    }
    let count = steps.frames.max(1) as f64;
    Ok(Steps {
        frames: steps.frames,
        found: steps.found / count,
        iou: steps.iou / count,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::Flights;
    use scenes::Difficulty;
    use sequences::{Dataset, Notes};
    use testing::Folder;
    use track_cpu::Isa;

    #[test]
    fn target_of_an_easy_flight_is_found_in_every_visible_frame() {
        let folder = Folder::new("step");
        let flights = Flights {
            seed: 5,
            count: 1,
            frames: 8,
            size: (480, 270),
            difficulty: Difficulty::Easy,
        };
        flights.write(folder.path(), |_| {}).unwrap();
        let dataset: Dataset = "folder".parse().unwrap();
        let mut sequence = dataset
            .load(folder.path(), &mut Notes::default())
            .unwrap()
            .remove(0);
        let model = Model::builtin(Isa::detect());
        let all = steps(&model, &sequence).unwrap();
        assert_eq!((all.frames, all.found), (7, 1.0), "{all:?}");
        assert!(all.iou > 0.6, "{all:?}");
        // A frame without a box is not a step, and neither is the next one, which would start at
        // it.
        sequence.annotation.boxes[4].w = f64::NAN;
        assert_eq!(steps(&model, &sequence).unwrap().frames, 5);
        // Boxes that are elsewhere are not found.
        for (i, bbox) in sequence.annotation.boxes.iter_mut().enumerate().skip(1) {
            (bbox.x, bbox.y) = if i % 2 == 0 {
                (0.0, 0.0)
            } else {
                (440.0, 240.0)
            };
        }
        assert!(steps(&model, &sequence).unwrap().found < 0.5);
    }
}
