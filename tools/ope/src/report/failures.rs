//! Pictures of the worst failures of a comparison's first tracker.

use crate::compare::Comparison;
use crate::error::Error;
use crate::picture::{decode, jpeg, rgb};
use image::imageops;
use sequences::{Rect, Sequence};
use track_cpu::source::Image;

/// Widest picture in the page.
const WIDTH: u32 = 480;
/// Overlap below which the target is lost.
const LOST: f64 = 0.1;
/// Quality of the pictures, of 100.
const QUALITY: u8 = 72;

/// The longest run of frames in which a target was lost, and the frame in its middle.
#[derive(Clone, Debug)]
pub struct Failure {
    /// The sequence.
    pub sequence: String,
    /// The frame shown, 0-based.
    pub frame: usize,
    /// Frames in the sequence.
    pub frames: usize,
    /// Frames in the run.
    pub lost: usize,
    /// The first tracker's AUC on the sequence, in percent.
    pub auc: f64,
    /// Width of the frame in pixels.
    pub width: usize,
    /// Height of the frame in pixels.
    pub height: usize,
    /// The annotation in this frame.
    pub annotated: Rect,
    /// Each tracker's box in this frame.
    pub found: Vec<Rect>,
    /// The frame, made smaller, as JPEG in base 64.
    pub jpeg: String,
}

/// The failures of the `count` sequences on which the first tracker has the lowest AUC, lowest
/// first.
///
/// # Errors
/// If a frame to be shown cannot be read.
pub fn failures(
    comparison: &Comparison,
    sequences: &[Sequence],
    count: usize,
) -> Result<Vec<Failure>, Error> {
    let Some(first) = comparison.scores.first() else {
        return Ok(Vec::new());
    };
    let mut order: Vec<_> = first.per_sequence.iter().collect();
    order.sort_by(|a, b| a.1.auc().total_cmp(&b.1.auc()));
    let mut failures = Vec::new();
    for (name, curves) in order {
        if failures.len() == count {
            break;
        }
        let Some(sequence) = sequences.iter().find(|s| s.annotation.name == *name) else {
            continue;
        };
        if let Some(failure) = failure(comparison, sequence, 100.0 * curves.auc())? {
            failures.push(failure);
        }
    }
    Ok(failures)
}

/// The longest failure of the first tracker on a sequence; `None` if it never lost the target.
fn failure(
    comparison: &Comparison,
    sequence: &Sequence,
    auc: f64,
) -> Result<Option<Failure>, Error> {
    let name = &sequence.annotation.name;
    let of = |t: usize| {
        comparison.trackers[t]
            .sequences
            .iter()
            .find(|s| s.annotation.name == *name)
    };
    let Some(first) = of(0) else { return Ok(None) };
    let judged = comparison.convention.judge(&first.annotation, &first.boxes);
    let is_lost: Vec<bool> = judged
        .iter()
        .map(|j| j.is_some_and(|j| j.overlap < LOST && j.error >= 0.0))
        .collect();
    let Some((start, lost)) = longest(&is_lost) else {
        return Ok(None);
    };
    let frame = start + lost / 2;
    let Some(path) = sequence.frames.get(frame) else {
        return Ok(None);
    };
    let unreadable = |reason: String| Error::Sequence {
        sequence: name.clone(),
        reason,
    };
    let picture = decode(path).map_err(unreadable)?;
    let (width, height) = (picture.width, picture.height);
    let jpeg = thumbnail(&picture)
        .ok_or_else(|| unreadable(format!("{}: cannot be encoded", path.display())))?;
    let boxes = |t| {
        of(t)
            .and_then(|s| s.boxes.get(frame).copied())
            .unwrap_or_default()
    };
    Ok(Some(Failure {
        sequence: name.clone(),
        frame,
        frames: judged.len(),
        lost,
        auc,
        width,
        height,
        annotated: first.annotation.boxes[frame],
        found: (0..comparison.trackers.len()).map(boxes).collect(),
        jpeg: trax::base64::encode(&jpeg),
    }))
}

/// Start and length of the longest run of `true`.
fn longest(flags: &[bool]) -> Option<(usize, usize)> {
    let mut best: Option<(usize, usize)> = None;
    let mut start = 0;
    for (i, flag) in flags.iter().enumerate() {
        if !flag {
            start = i + 1;
        } else if best.is_none_or(|(_, length)| i + 1 - start > length) {
            best = Some((start, i + 1 - start));
        }
    }
    best
}

/// The picture as JPEG, at most [`WIDTH`] pixels wide; `None` if it has no pixels.
fn thumbnail(picture: &Image) -> Option<Vec<u8>> {
    let full = rgb(picture)?;
    let height = full.height() * WIDTH / full.width();
    let small = if full.width() > WIDTH {
        imageops::thumbnail(&full, WIDTH, height.max(1))
    } else {
        full
    };
    jpeg(&small, small.dimensions(), QUALITY).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn longest_run_of_lost_frames_is_found() {
        assert_eq!(
            longest(&[false, true, false, true, true, true, false, true]),
            Some((3, 3))
        );
        assert_eq!(longest(&[true, true]), Some((0, 2)));
        assert_eq!(longest(&[false]), None);
    }
}
