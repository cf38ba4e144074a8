//! One operation per file: what it computes, how it goes backwards, and the check of the one
//! against the other.

mod arithmetic;
mod batch_norm;
mod concat;
mod conv2d;
mod crop;
mod elementwise;
mod flatten;
mod global_average;
mod linear;
pub(crate) mod map;
mod max_pool;
mod reduce;
mod roll;
mod tile;
mod xcorr;

pub use batch_norm::RunningStatistics;
pub use conv2d::Conv2d;
pub(crate) use elementwise::{sigmoid, softplus};
