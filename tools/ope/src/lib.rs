//! One-pass evaluation: how well a tracker follows, in the conventions that papers use.
//!
//! A tracker is given the first frame's box and runs once through every sequence; its boxes are then held against the
//! annotations. Toolkits agree on the curves but not on rows that annotate nothing, and so differ by up to four points on
//! the same boxes: [`Convention`] has them all, side by side.
//!
//! | step | module |
//! |---|---|
//! | files of boxes and times, as people write them | [`text`], [`annotations`], [`results`] |
//! | benchmarks as they lie on disk | [`dataset`] |
//! | rendered flights as a benchmark | [`render`] |
//! | a tracker over a benchmark, ours or another program | [`run`] |
//! | four passes over each sequence in place of one | [`starts`] |
//! | this repository's tracker, put near the target in every frame | [`step`] |
//! | one sequence: overlap and center error per frame, then curves | [`convention`], [`curves`] |
//! | several trackers: tables, plots, a page | [`compare`], [`plot`], [`report`] |
//! | other toolkits' layouts | [`export`] |
//! | one tracker on one benchmark: means over sequences, speed | [`score`], [`speed`] |

#![forbid(unsafe_code)]

pub mod annotations;
pub mod bbox;
pub mod compare;
pub mod convention;
pub mod curves;
pub mod dataset;
pub mod error;
pub mod export;
pub mod notes;
pub mod plot;
pub mod render;
pub mod report;
pub mod results;
pub mod run;
pub mod score;
pub mod speed;
pub mod starts;
pub mod step;
pub mod table;
#[cfg(test)]
mod testing;
pub mod text;

pub use annotations::Annotation;
pub use bbox::BBox;
pub use convention::Convention;
pub use curves::Curves;
pub use dataset::{Dataset, Sequence};
pub use error::Error;
pub use notes::Notes;
pub use results::Results;
pub use score::{Evaluation, Score};
pub use speed::Speed;
