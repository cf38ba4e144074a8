//! Rendered flights, frame by frame, with their truth.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer, Truth, TruthBox};
use track_cpu::{BBox, ChannelOrder, Frame};

use crate::{Failure, FlightArgs};

/// Share of the target that must be visible for it to count as there.
pub const VISIBLE: f32 = 0.25;
/// Share below which it counts as gone.
pub const GONE: f32 = 0.05;
/// IoU from which on a box is on an object.
pub const ON: f32 = 0.3;
/// IoU below which it is off it.
pub const OFF: f32 = 0.1;

/// A true box as the tracker takes it.
pub fn bbox(truth: &TruthBox) -> BBox {
    BBox::new(truth.x, truth.y, truth.w, truth.h)
}

/// Whether a box is on the target; `None` where that is a matter of taste.
pub fn is_on(found: &BBox, truth: &Truth) -> Option<bool> {
    let iou = found.iou(&bbox(&truth.bbox));
    if truth.visible <= GONE || iou < OFF {
        Some(false)
    } else if truth.visible >= VISIBLE && iou >= ON {
        Some(true)
    } else {
        None
    }
}

/// How hard the flight of a seed is: two of three are hard.
pub fn difficulty(seed: u64) -> Difficulty {
    if seed.is_multiple_of(3) {
        Difficulty::Medium
    } else {
        Difficulty::Hard
    }
}

/// Shows every frame of a flight to `each`.
pub fn play(
    args: &FlightArgs,
    seed: u64,
    mut each: impl FnMut(usize, &Frame<'_>, &Truth) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let (width, height) = (
        args.width.clamp(64, 4096),
        args.width.clamp(64, 4096) * 9 / 16,
    );
    let frames = args.frames.clamp(2, 100_000);
    let flight = Flight::new(FlightConfig {
        width,
        height,
        frames,
        seed,
        difficulty: difficulty(seed),
        twins: args.twins,
        ..Default::default()
    });
    let mut buffer = FrameBuffer::default();
    for index in 0..frames {
        let truth = flight.render(index, &mut buffer);
        let frame = Frame::new(&buffer.data, buffer.width, buffer.height, ChannelOrder::Rgb)
            .map_err(|error| Failure::Nothing(format!("seed {seed} frame {index}: {error}")))?;
        each(index, &frame, &truth)?;
    }
    Ok(())
}

/// What `work` makes of each seed from `first` on, in their order.
pub fn each_seed<T: Send>(
    args: &FlightArgs,
    first: u64,
    work: impl Fn(u64) -> Result<T, Failure> + Sync,
) -> Result<Vec<T>, Failure> {
    let (next, done) = (AtomicU64::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..args.jobs.clamp(1, 64) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed);
                    if index >= args.flights {
                        return;
                    }
                    let result = work(first.saturating_add(index));
                    eprintln!("flight {} of {}", index + 1, args.flights);
                    if let Ok(mut done) = done.lock() {
                        done.push((index, result));
                    }
                }
            });
        }
    });
    let mut done = done
        .into_inner()
        .map_err(|_| Failure::Nothing("a flight failed".into()))?;
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, result)| result).collect()
}
