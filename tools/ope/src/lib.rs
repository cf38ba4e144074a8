//! One-pass evaluation: runs trackers over benchmarks, scores, compares and diagnoses their boxes.
//!
//! A tracker is given the first frame's box and runs once through every sequence. Its boxes are
//! then compared with the annotations by a rule of [`sequences::Convention`].
//!
//! | step | module |
//! |---|---|
//! | rendered flights as a benchmark | [`render`] |
//! | a tracker over a benchmark, this repository's or another program | [`run`] |
//! | four passes over each sequence in place of one | [`starts`] |
//! | this repository's tracker, placed near the target in every frame | [`step`] |
//! | folders of boxes and times | [`results`] |
//! | one tracker on one benchmark: means over sequences, speed | [`score`], [`speed`] |
//! | several trackers: tables, plots, a page | [`compare`], [`report`] |
//! | why a tracker scores as it does: shape, losses | [`diagnosis`] |
//! | other toolkits' layouts | [`export`] |

#![forbid(unsafe_code)]

mod boxes;
pub mod compare;
pub mod diagnosis;
pub mod error;
pub mod export;
mod picture;
pub mod render;
pub mod report;
pub mod results;
pub mod run;
pub mod score;
pub mod speed;
pub mod starts;
pub mod step;
pub mod table;

pub use error::Error;
pub use results::Results;
pub use score::{Evaluation, Score};
pub use speed::Speed;
