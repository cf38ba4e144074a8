//! This repository's tracker over one sequence.

use super::{Outcome, failure};
use crate::bbox::BBox;
use crate::dataset::Sequence;
use crate::error::Error;
use std::path::Path;
use std::time::Instant;
use track_cpu::source::{Image, Input, Source};
use track_cpu::{Model, Tracker};

/// Tracks a sequence on this thread; the clock runs during `init` and `update` only.
pub fn track(model: &Model, sequence: &Sequence, first: BBox) -> Result<Outcome, Error> {
    let name = &sequence.annotation.name;
    let mut tracker = Tracker::new(model.clone());
    let mut outcome = Outcome {
        boxes: Vec::new(),
        seconds: Vec::new(),
    };
    for path in &sequence.frames {
        let image = decode(path).map_err(|reason| failure(name, reason))?;
        let frame = image.frame();
        let clock = Instant::now();
        let found = if outcome.boxes.is_empty() {
            tracker.init(&frame, first.to_track_cpu()).map(|()| first)
        } else {
            tracker.update(&frame).map(|track| BBox::from(track.bbox))
        };
        outcome.seconds.push(clock.elapsed().as_secs_f64());
        outcome
            .boxes
            .push(found.map_err(|error| failure(name, error))?);
    }
    Ok(outcome)
}

/// Reads one picture.
pub fn decode(path: &Path) -> Result<Image, String> {
    let mut source = Source::open(&Input::new(path)).map_err(|error| error.to_string())?;
    let image = source
        .next()
        .ok_or_else(|| format!("{}: no picture", path.display()))?;
    image.map_err(|error| error.to_string())
}
