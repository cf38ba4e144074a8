//! PyTorch checkpoint -> weights file or the trainer's parameters, and back.
//!
//! | file | what is in it |
//! |---|---|
//! | `convert` | the story: checkpoint, architecture, folding, weights |
//! | `pytorch` | the other way: our networks as a state dict |
//! | `architecture` | the network that a checkpoint's tensors describe |
//! | `names` | PyTorch's parameter names, and ours |
//! | `fold` | batch normalization and the head's scalars, folded into convolutions |
//! | `checkpoint` | zip archives and legacy streams as named tensors |
//! | `checkpoint/pickle` | pickle read as data |
//! | `checkpoint/torch` | storages, tensors and the functions that rebuild them |
//! | `report` | tables for people |
//!
//! A checkpoint is untrusted: nothing in it is executed, every size is bounded before it is
//! used, and whatever is wrong with it is an error that says where.

#![forbid(unsafe_code)]

mod architecture;
mod checkpoint;
mod convert;
mod error;
pub mod fold;
mod names;
mod pytorch;
pub mod report;

pub use convert::{Conversion, Options, Unfolding, convert, convert_bytes, unfold, unfold_bytes};
pub use error::{Error, Refusal};
pub use pytorch::{StateDict, Values};
