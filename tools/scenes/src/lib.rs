//! Seeded, procedural UAV flights with exact boxes: for the demo, the tests and training pairs.
//!
//! A [`Flight`] is a camera on a drone that follows one target (a car, a boat, a person) over a
//! country made from a seed. Frames are rendered in any order, each with its pixels and its
//! [`Truth`].
//!
//! ```
//! use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer};
//!
//! let config = FlightConfig {
//!     width: 160,
//!     height: 96,
//!     frames: 30,
//!     difficulty: Difficulty::Easy,
//!     ..Default::default()
//! };
//! let flight = Flight::new(config);
//! let mut frame = FrameBuffer::default();
//! let truth = flight.render(0, &mut frame);
//! assert_eq!(frame.data.len(), 160 * 96 * 3);
//! assert!(truth.visible > 0.9);
//! ```
//!
//! | step | module |
//! |---|---|
//! | plan the flight, with the numbers of a difficulty | `flight`, `preset` |
//! | plan the country and its colors | `land`, `palette` |
//! | paint its ground once into a texture | `ground`, `map` |
//! | place buildings, trees and parked vehicles on it | `layout`, `furnish`, `buildings`, `trees` |
//! | move vehicles, people and the camera | `actors`, `vehicles`, `people`, `camera` |
//! | draw a frame | `draw`, `raster`, `fill` |
//! | add blur and noise | `lens` |
#![forbid(unsafe_code)]

mod actors;
mod buildings;
mod camera;
mod draw;
mod fill;
mod flight;
mod furnish;
mod ground;
mod land;
mod layout;
mod lens;
mod map;
mod math;
mod mesh;
mod palette;
mod people;
mod preset;
mod raster;
mod rng;
#[cfg(test)]
mod tests;
mod trees;
mod vehicles;

pub use actors::TargetKind;
pub use flight::Flight;
pub use palette::Biome;
pub use rng::SplitMix64;

use std::fmt;
use std::str::FromStr;

/// How hard a flight is to track: speed, shake, look-alikes, occlusion, exits, noise, blur and haze
/// together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Difficulty {
    /// Calm, clear, nothing before the target.
    Easy,
    /// Some of everything, and a planned occlusion every eight seconds or so; the target stays in
    /// view.
    #[default]
    Medium,
    /// Fast and shaky, with look-alikes, occlusions, and exits from the view with a return.
    Hard,
}

impl Difficulty {
    /// All of them, the easiest first.
    pub const ALL: [Difficulty; 3] = [Difficulty::Easy, Difficulty::Medium, Difficulty::Hard];
}

impl fmt::Display for Difficulty {
    /// `easy`, `medium` or `hard`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Difficulty::Easy => "easy",
            Difficulty::Medium => "medium",
            Difficulty::Hard => "hard",
        })
    }
}

impl FromStr for Difficulty {
    type Err = String;

    /// From `easy`, `medium` or `hard`.
    fn from_str(text: &str) -> Result<Difficulty, String> {
        match text {
            "easy" => Ok(Difficulty::Easy),
            "medium" => Ok(Difficulty::Medium),
            "hard" => Ok(Difficulty::Hard),
            _ => Err(format!("expected easy, medium or hard, found {text:?}")),
        }
    }
}

/// Configuration of a flight.
#[derive(Clone, Debug, PartialEq)]
pub struct FlightConfig {
    /// Width of the view in pixels.
    pub width: usize,
    /// Height of the view in pixels.
    pub height: usize,
    /// Number of frames, 30 a second.
    pub frames: usize,
    /// Seed of everything that the other fields leave open.
    pub seed: u64,
    /// Preset for everything that makes tracking hard.
    pub difficulty: Difficulty,
    /// The country; by the seed if `None`.
    pub biome: Option<Biome>,
    /// The target; by the seed if `None`, or if it does not fit the biome (a boat away from the
    /// coast).
    pub target: Option<TargetKind>,
    /// Number of moving look-alikes, at most 64; by the difficulty if `None`.
    pub distractors: Option<usize>,
    /// Chance that a look-alike has the target's very body, 0 to 1; by the difficulty if `None`.
    pub twins: Option<f32>,
    /// Standard deviation of the sensor's noise, of 255; by the difficulty if `None`.
    pub noise: Option<f32>,
}

impl Default for FlightConfig {
    /// 300 frames of 640 x 360, seed 7, medium.
    fn default() -> FlightConfig {
        FlightConfig {
            width: 640,
            height: 360,
            frames: 300,
            seed: 7,
            difficulty: Difficulty::Medium,
            biome: None,
            target: None,
            distractors: None,
            twins: None,
            noise: None,
        }
    }
}

/// A picture: RGB bytes, row-major, three to a pixel.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameBuffer {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `3 * width * height` bytes.
    pub data: Vec<u8>,
}

/// An axis-aligned box in pixels, from `x` to `x + w` and `y` to `y + h`.
///
/// Coordinates are continuous: the left edge of the leftmost pixel is at 0, its right edge at 1. A
/// box may reach out of the view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TruthBox {
    /// Left edge.
    pub x: f32,
    /// Top edge.
    pub y: f32,
    /// Width.
    pub w: f32,
    /// Height.
    pub h: f32,
}

/// The truth about a frame, seen or not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth {
    /// Tight box of the whole target (hidden and out-of-view parts included) at mid-exposure,
    /// without its shadow, wake or motion blur.
    pub bbox: TruthBox,
    /// Share of the target's area that lies in the view and is not hidden, 0..1.
    pub visible: f32,
    /// Boxes of all other things of the target's kind that reach into the view, moving or parked,
    /// hidden or not.
    pub distractors: Vec<TruthBox>,
}
