//! Follows one object through video on a CPU: the DR-MIM tracker with hand-written SIMD kernels.
//!
//! ```no_run
//! use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Tracker};
//!
//! fn follow(mut frames: impl Iterator<Item = Vec<u8>>) -> Result<(), Box<dyn std::error::Error>> {
//!     let mut tracker = Tracker::new(Model::builtin(Isa::detect()));
//!     let first = frames.next().ok_or("no frame")?;
//!     tracker.init(&Frame::new(&first, 640, 360, ChannelOrder::Rgb)?, BBox::new(310.0, 150.0, 40.0, 24.0))?;
//!     for pixels in frames {
//!         let track = tracker.update(&Frame::new(&pixels, 640, 360, ChannelOrder::Rgb)?)?;
//!         println!("{:?} {:.2}", track.bbox, track.score);
//!     }
//!     Ok(())
//! }
//! ```
//!
//! Read `tracker.rs` first: a frame's way to its box starts in [`Tracker::update`].

#![forbid(unsafe_code)]

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod bbox;
pub mod config;
pub mod error;
pub mod flight;
pub mod frame;
pub mod model;
pub mod net;
#[cfg(feature = "source")]
pub mod source;
pub mod stages;
pub mod tracker;

pub use bbox::BBox;
pub use config::TrackConfig;
pub use error::{FrameError, ModelError, TrackError};
pub use flight::{FlightOptions, FlightTrack, FlightTracker, State};
pub use frame::{ChannelOrder, Frame};
pub use kernels::Isa;
pub use kernels::par::Cores;
pub use model::{Model, Precision};
pub use stages::Stages;
pub use tracker::{SearchRegion, Track, Tracker, TrackerOptions, crop};
