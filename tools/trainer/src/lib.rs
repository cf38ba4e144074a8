//! Trains, prunes and exports the DR-MIM tracker on a CPU.

#![forbid(unsafe_code)]

pub mod data;
pub mod error;
pub mod rng;
pub mod show;
#[cfg(test)]
mod testing;

pub use error::Error;
