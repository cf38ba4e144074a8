//! Trains, prunes and exports the DR-MIM tracker on a CPU.
//!
//! | what | where |
//! |---|---|
//! | pairs of crops from videos, stills and rendered flights | [`data`], [`targets`] |
//! | the network in training, its losses, first values, folding | [`network`] |
//! | the loop, checkpoints, ways in and out of files | [`fit`] |
//! | accuracy, with the real tracker | [`validate`] |
//! | runs one after another | [`queue`] |
//! | smaller networks by rank | [`prune`] |
//! | runs that are compared: ratios, parts of the method | [`study`] |
//! | pictures of all that | [`show`] |

#![forbid(unsafe_code)]

pub mod calibrate;
pub mod data;
pub mod error;
pub mod fit;
pub mod network;
pub mod prune;
pub mod queue;
pub mod rng;
pub mod show;
pub mod study;
pub mod targets;
#[cfg(test)]
mod testing;
pub mod tune;
pub mod validate;

pub use error::Error;
