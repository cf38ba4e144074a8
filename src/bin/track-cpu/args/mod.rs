//! The command lines: one file per sub-command, and what they share.
//!
//! | file | what it holds |
//! |---|---|
//! | `engine.rs` | `ModelArg`, `EngineArgs`, `Mode`: how the tracker runs, for every sub-command |
//! | `input.rs` | `RawArgs`, `BadFrameArg`: how frames are read |
//! | `values.rs` | numbers, boxes and sizes of the command line |
//! | the others | one sub-command each |

pub mod bench;
pub mod compare;
pub mod demo;
pub mod doctor;
pub mod engine;
pub mod info;
pub mod input;
pub mod random;
pub mod track;
pub mod trax;
pub mod values;

#[cfg(feature = "serve")]
pub use engine::Search;
pub use engine::{EngineArgs, Mode, ModelArg};
#[cfg(feature = "serve")]
pub use values::{MAX_TARGETS, bbox, frame_rate, pixel_format, size, targets, threshold};
