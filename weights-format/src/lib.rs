//! The tracker's weights file: bytes <-> named, typed, checked tensors.
//!
//! [`Weights`] are a network's tensors with the metadata that give them a meaning. A file is
//! refused unless it has exactly the tensors of its architecture, all finite. `FORMAT.md` is the
//! normative description.
//!
//! ```
//! use weights_format::{Architecture, Encoder, Weights, Widths};
//!
//! let architecture = Architecture::new(Widths::pruned(0.8), Some(Encoder::standard(51)));
//! let bytes = Weights::random(architecture, 1).to_bytes()?;
//! let weights = Weights::from_bytes(&bytes)?;
//! assert_eq!(weights.tensor("backbone.conv1.weight").unwrap().shape, [19, 11, 11, 3]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | file | what is in it |
//! |---|---|
//! | `architecture` | widths, encoder, crop sizes; the layers and tensors that follow from them |
//! | `header` | a file's metadata and their bounds |
//! | `weights` | header and tensors together: insert, look up, check, random |
//! | `container` | bytes: the safetensors container, f32 and f16 |
//! | `unfolded` | a network before folding, exchanged between PyTorch and the trainer |
//! | `file` | paths: bounded reading, atomic writing |

#![forbid(unsafe_code)]

pub mod architecture;
mod container;
mod error;
mod file;
mod header;
mod unfolded;
mod weights;

pub use architecture::{
    Architecture, ArchitectureError, Branch, Encoder, EncoderPosition, Layer, LayerKind, Widths,
};
pub use container::{MAX_FILE_BYTES, MAX_HEADER_BYTES};
pub use error::{ReadError, WriteError, brief};
pub use header::{
    Calibration, ChannelOrder, Header, InputNormalization, Provenance, Range, Storage,
    TrackerParams,
};
pub use unfolded::Unfolded;
pub use weights::{Tensor, Weights};
