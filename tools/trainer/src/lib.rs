//! Trains, prunes and exports the DR-MIM tracker on a CPU.

#![forbid(unsafe_code)]

pub mod calibrate;
pub mod data;
pub mod error;
pub mod fit;
pub mod network;
pub mod plot;
pub mod prune;
pub mod rng;
pub mod show;
pub mod study;
pub mod targets;
#[cfg(test)]
mod testing;
pub mod validate;

pub use error::Error;
