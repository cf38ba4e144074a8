//! Follows one object through video on a CPU: the DR-MIM tracker with hand-written SIMD kernels.
//!
//! [`Tracker`] gives one box per frame. [`FlightTracker`] adds the probability that the box is on
//! the target, coasts through occlusions and finds a lost target again.
//!
//! ```
//! use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Tracker};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let pixels = vec![128; 320 * 240 * 3];
//! let frame = Frame::new(&pixels, 320, 240, ChannelOrder::Rgb)?;
//!
//! let mut tracker = Tracker::new(Model::builtin(Isa::detect()));
//! tracker.init(&frame, BBox::new(110.0, 90.0, 40.0, 24.0))?;
//! let track = tracker.update(&frame)?; // once per frame
//! println!("{:?} {:.2}", track.bbox, track.score);
//! # Ok(())
//! # }
//! ```
//!
//! | module | what is in it |
//! |---|---|
//! | [`tracker`] | start here: one frame from pixels to a box |
//! | [`net`] | the forward pass, stage by stage |
//! | [`flight`] | presence, occlusion, re-detection |
//! | [`model`] | built-in models, weights files, precision |
//! | [`frame`], [`bbox`] | pixels and boxes |
//! | [`shared`] | a tracker behind an interface for another language |
//! | `source` | frames from folders, videos and pipes (feature `source`) |
//!
//! The library allocates in [`Tracker::init`] and in the first [`Tracker::update`], then no more.
//! Boxes are the same with any number of threads.

#![forbid(unsafe_code)]

#[cfg(doctest)]
#[doc = include_str!("../docs/guide/library.md")]
struct LibraryGuide;

pub mod bbox;
pub mod config;
pub mod error;
pub mod flight;
pub mod frame;
pub mod model;
pub mod net;
pub mod shared;
#[cfg(feature = "source")]
pub mod source;
pub mod stages;
pub mod tracker;

pub use bbox::BBox;
pub use config::TrackConfig;
pub use error::{FrameError, ModelError, TrackError};
pub use flight::{FlightOptions, FlightTrack, FlightTracker, State};
pub use frame::{ChannelOrder, Frame, FrameSize, Plane};
pub use kernels::Isa;
pub use kernels::par::Cores;
pub use model::{Model, Precision};
pub use stages::Stages;
pub use tracker::{SearchRegion, SizeChange, Track, Tracker, TrackerOptions, crop};
