//! Annotated sequences and their scores: benchmark layouts, annotation files, scoring rules, curves
//! and plots.
//!
//! A sequence is a list of picture files, the frames of a video, with a box per frame. Trackers are
//! scored on it by precision (center error) and success (overlap). Toolkits agree on those curves
//! but not on frames without a usable box, so every figure names its [`Convention`].
//!
//! | task | item |
//! |---|---|
//! | read a benchmark from disk | [`Dataset::load`] |
//! | read everything below a folder | [`find`] |
//! | read a file of boxes, times or flags | [`text`] |
//! | score boxes against annotations | [`Convention::curves`], [`Curves`] |
//! | draw curves as SVG | [`plot`] |
//!
//! Every reader leaves out what it cannot use and says so in [`Notes`]; it never guesses.
//!
//! ```
//! use sequences::{Annotation, Convention, Rect};
//!
//! let truth = Annotation::new("a", vec![Rect::new(10.0, 10.0, 20.0, 20.0); 4]);
//! // Three boxes for four frames: the missing frame is a miss.
//! let found = [Rect::new(12.0, 10.0, 20.0, 20.0); 3];
//! let curves = Convention::Got10k.curves(&truth, &found).unwrap();
//! assert_eq!(curves.precision(), 0.75);
//! assert!(curves.auc() < 0.75);
//! ```

#![forbid(unsafe_code)]

pub mod annotation;
pub mod convention;
pub mod curves;
pub mod dataset;
pub mod error;
mod find;
pub mod folder;
pub mod notes;
pub mod plot;
pub mod rect;
pub mod text;

pub use annotation::Annotation;
pub use convention::Convention;
pub use curves::{Curves, Judgment};
pub use dataset::{Dataset, Sequence};
pub use error::Error;
pub use find::{find, pictures_below};
pub use notes::Notes;
pub use rect::Rect;
