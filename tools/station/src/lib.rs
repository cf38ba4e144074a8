//! The live program around a tracker: frames come in from a camera or stream; boxes go out to
//! people, programs and autopilots.
//!
//! A station knows no tracker. It drives an [`Engine`], and reads frames through an [`Open`]
//! function, so a test can replace both:
//!
//! ```
//! use std::time::Duration;
//! use station::{Engine, Feed, FrameBox, Frames, Options, Order, Picture, Station, Tracked};
//!
//! /// Says that the target has not moved.
//! struct Still(Option<Tracked>);
//!
//! impl Engine for Still {
//!     fn start(&mut self, _: &Picture, target: FrameBox) -> Result<Tracked, String> {
//!         let tracked = Tracked::certain(target);
//!         self.0 = Some(tracked.clone());
//!         Ok(tracked)
//!     }
//!     fn stop(&mut self) {
//!         self.0 = None;
//!     }
//!     fn follow(&mut self, _: &Picture, _: Duration, _: Duration) -> Option<Tracked> {
//!         self.0.clone()
//!     }
//! }
//!
//! /// Three gray frames.
//! struct Three(usize);
//!
//! impl Frames for Three {
//!     fn next(&mut self, _: Vec<u8>) -> Result<Option<Picture>, String> {
//!         self.0 += 1;
//!         let data = vec![90; 64 * 48];
//!         let frame = Picture { data, width: 64, height: 48, order: Order::Gray };
//!         Ok((self.0 <= 3).then_some(frame))
//!     }
//! }
//!
//! let feed = Feed { open: Box::new(|| Ok(Box::new(Three(0)))), reopens: false, period: None };
//! let options = Options {
//!     every_frame: true,
//!     init: vec![FrameBox::new(20.0, 10.0, 8.0, 8.0)],
//!     ..Options::default()
//! };
//! Station::new(options).run(vec![Box::new(Still(None))], feed)?;
//! # Ok::<(), station::Error>(())
//! ```
//!
//! | file | what happens there |
//! |---|---|
//! | `station.rs` | the tracking thread: start reading here |
//! | `targets.rs` | the targets that are followed, each by an engine of its own |
//! | `feed.rs`, `camera.rs` | the feeding thread; V4L2 devices |
//! | `health.rs` | health of the source, the stall time-out |
//! | `slot.rs` | the latest frame, between the feeding and the tracking thread |
//! | `hub.rs`, `command.rs`, `report.rs` | commands in, reports out, and their ages |
//! | `commands/` | commands as JSON lines from other programs |
//! | `ring.rs` | the pictures that viewers saw, for boxes drawn in them |
//! | `lines.rs`, `log/`, `notify.rs`, `say.rs` | JSON lines, the flight log, systemd, standard error |
//! | `mavlink/` | the camera that autopilots and ground stations see |
//! | `http/` | the web page |
//! | `pick.rs` | one picture on the web page, for a box drawn by hand |
//! | `film.rs` | the video with boxes, encoded by ffmpeg |
//!
//! **Invariant:** no log, disk, link or viewer ends or delays tracking.
//! **Invariant:** nothing moves by a report that is not fresh; see [`Freshness`].

#![forbid(unsafe_code)]

mod ages;
pub mod camera;
mod command;
pub mod commands;
mod engine;
mod error;
mod feed;
pub mod film;
mod health;
pub mod http;
mod hub;
mod lines;
pub mod log;
pub mod mavlink;
mod notify;
pub mod pick;
mod picture;
mod report;
mod ring;
mod say;
mod slot;
mod station;
mod targets;

pub use command::{Command, Outcome, Pending, Receipt, Target};
pub use engine::Engine;
pub use error::Error;
pub use feed::{Feed, Frames, Open, Stopper};
pub use health::{Health, Pulse};
pub use hub::{Hub, Limits};
pub use picture::{FrameBox, Order, Picture};
pub use report::{
    BELIEVED, Candidate, Followed, Freshness, Report, State, TargetId, Tracked, View,
};
pub use station::{Options, Station};
