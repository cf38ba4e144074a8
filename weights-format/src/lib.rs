//! The tracker's weights file: bytes <-> named, typed, checked tensors. `FORMAT.md` is the normative description.

#![forbid(unsafe_code)]

pub mod architecture;

pub use architecture::{Architecture, ArchitectureError, Branch, Encoder, EncoderPosition, Layer, LayerKind, Widths};
