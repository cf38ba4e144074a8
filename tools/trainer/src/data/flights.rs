//! Rendered flights as training data: an endless sequence of them, a few at a time.

use super::geometry::View;
use super::picture::Picture;
use crate::rng::Rng;
use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};
use track_cpu::BBox;

/// Flights that samples draw their pairs from.
///
/// The flights of a sample depend on its index alone: a window over the sequence of flights
/// advances by one flight after a fixed number of samples. A flight is rendered for the first
/// sample that uses it.
#[derive(Debug)]
pub struct Flights {
    seed: u64,
    samples_per_flight: u64,
    clips: Mutex<BTreeMap<u64, Arc<OnceLock<Clip>>>>,
}

/// Frames of one flight in which the target can be seen.
type Clip = Vec<Shot>;

#[derive(Debug)]
struct Shot {
    view: View,
    visible: f32,
}

/// Flights at a time.
const WINDOW: u64 = 6;

/// Frames rendered per flight.
const FRAMES: usize = 16;

/// Frames from one to the next: half a second.
const STRIDE: usize = 15;

impl Flights {
    /// Flights of a `seed`; every one serves about `pairs` pairs if a `share` of all samples comes
    /// from them.
    pub fn new(seed: u64, share: f64, pairs: f64) -> Flights {
        let samples_per_flight = (pairs / share.max(1e-3)).clamp(1.0, 1e9) as u64;
        Flights {
            seed,
            samples_per_flight,
            clips: Mutex::default(),
        }
    }

    /// Two frames of one flight; `None` if its target is visible in too few frames.
    pub fn draw_pair(&self, index: u64, rng: &mut Rng) -> Option<(View, View)> {
        let number = index / self.samples_per_flight + rng.below(WINDOW as usize) as u64;
        let cell = {
            let mut clips = self
                .clips
                .lock()
                .unwrap_or_else(std::sync::PoisonError::into_inner);
            // Flights before the window are no longer needed, except by samples that another thread
            // makes late.
            let oldest = (index / self.samples_per_flight).saturating_sub(WINDOW);
            *clips = clips.split_off(&oldest);
            clips.entry(number).or_default().clone()
        };
        let clip = cell.get_or_init(|| render(self.seed, number));
        let clear: Vec<_> = clip.iter().filter(|shot| shot.visible > 0.9).collect();
        if clear.is_empty() {
            return None;
        }
        Some((rng.pick(&clear).view.clone(), rng.pick(clip).view.clone()))
    }
}

/// Configuration of the flight of a number.
fn config(seed: u64, number: u64) -> FlightConfig {
    let mut rng = Rng::new(seed, 0xf119, number);
    let difficulty = *rng.pick(&[Difficulty::Easy, Difficulty::Medium, Difficulty::Hard]);
    let size = *rng.pick(&[(640, 360), (640, 360), (480, 360), (512, 288)]);
    FlightConfig {
        width: size.0,
        height: size.1,
        frames: FRAMES * STRIDE,
        seed: rng.bits(),
        difficulty,
        ..FlightConfig::default()
    }
}

fn render(seed: u64, number: u64) -> Clip {
    let flight = Flight::new(config(seed, number));
    let mut frame = FrameBuffer::default();
    let mut clip = Vec::with_capacity(FRAMES);
    for i in 0..FRAMES {
        let truth = flight.render(i * STRIDE, &mut frame);
        let (b, width, height) = (truth.bbox, frame.width as f32, frame.height as f32);
        let inside = b.x > -0.5 * b.w
            && b.y > -0.5 * b.h
            && b.x + 0.5 * b.w < width
            && b.y + 0.5 * b.h < height;
        if truth.visible > 0.4 && inside && b.w >= 4.0 && b.h >= 4.0 {
            let picture = Arc::new(Picture::new(frame.width, frame.height, frame.data.clone()));
            // Continuous edges and inclusive pixel counts give the same four numbers (`BBox`,
            // `TruthBox`).
            let view = View {
                picture,
                bbox: BBox::new(b.x, b.y, b.w, b.h),
            };
            clip.push(Shot {
                view,
                visible: truth.visible,
            });
        }
    }
    clip
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flight_of_a_sample_is_independent_of_earlier_samples() {
        let draw = |flights: &Flights, index| {
            let pair = flights.draw_pair(index, &mut Rng::new(1, 1, index));
            pair.map(|(a, b)| (a.bbox, a.picture.border, b.bbox))
        };
        let in_order = Flights::new(3, 1.0, 2.0);
        let first: Vec<_> = (0..4).map(|i| draw(&in_order, i)).collect();
        assert!(first.iter().flatten().count() >= 3);
        let backwards = Flights::new(3, 1.0, 2.0);
        let again: Vec<_> = (0..4).rev().map(|i| draw(&backwards, i)).collect();
        assert!(first.iter().eq(again.iter().rev()));
        draw(&in_order, 30);
        assert!(
            in_order
                .clips
                .lock()
                .unwrap()
                .keys()
                .all(|number| *number >= 9)
        );
    }
}
