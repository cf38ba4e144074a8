//! PyTorch checkpoint -> weights file or the trainer's parameters, and back.
//!
//! | file | what is in it |
//! |---|---|
//! | `convert` | the conversion: checkpoint, architecture, folding, weights. Start reading here |
//! | `pytorch` | the way back: a network as a state dict |
//! | `architecture` | the network that a checkpoint's tensors describe |
//! | `names` | parameter names in PyTorch and in a weights file |
//! | `fold` | batch normalization and the head's scalars, folded into convolutions |
//! | `checkpoint` | zip archives and legacy streams as named tensors |
//! | `checkpoint/pickle` | pickle read as data |
//! | `checkpoint/torch` | storages, tensors and the functions that rebuild them |
//! | `report` | the table of layers, and the effect of rounding |
//!
//! A checkpoint is untrusted: nothing in it is executed, every size is bounded before it is
//! used, and every defect is an error that says where it is.

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
