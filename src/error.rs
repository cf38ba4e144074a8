//! Errors, grouped by who is at fault.

use std::path::PathBuf;

/// Pixels that cannot be a [`Frame`](crate::Frame).
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// A side is 0 or too large.
    #[error("frame is {width}x{height} pixels, expected sides from 1 to {max}")]
    Size {
        /// Width found.
        width: usize,
        /// Height found.
        height: usize,
        /// Largest side accepted.
        max: usize,
    },
    /// The stride is shorter than a row.
    #[error("frame stride is {stride} bytes, expected at least {expected}")]
    Stride {
        /// Stride found.
        stride: usize,
        /// Bytes of one row.
        expected: usize,
    },
    /// The data ends before the last pixel.
    #[error("frame data holds {found} bytes, expected at least {expected}")]
    Data {
        /// Bytes found.
        found: usize,
        /// Bytes needed.
        expected: usize,
    },
    /// The picture has another number of planes.
    #[error("frame of {found} planes, expected {expected}")]
    Planes {
        /// Planes found.
        found: usize,
        /// Planes of this order.
        expected: usize,
    },
}

/// Reason why the tracker refused a call.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum TrackError {
    /// The box is not a box: a number is not finite, or a side is not positive.
    #[error("box {x},{y},{w},{h}: expected finite numbers and a width and height above 0")]
    BadBox {
        /// Left edge found.
        x: f32,
        /// Top edge found.
        y: f32,
        /// Width found.
        w: f32,
        /// Height found.
        h: f32,
    },
    /// The box does not touch the frame.
    #[error("box {x},{y},{w},{h} lies outside the {width}x{height} frame")]
    BoxOutside {
        /// Left edge found.
        x: f32,
        /// Top edge found.
        y: f32,
        /// Width found.
        w: f32,
        /// Height found.
        h: f32,
        /// Frame width.
        width: usize,
        /// Frame height.
        height: usize,
    },
    /// The box is in shares of the frame, as YOLO writes them.
    #[error(
        "box {x},{y},{w},{h}: expected pixels, found shares of the frame; multiply left and width \
         by the frame's width, top and height by its height"
    )]
    Shares {
        /// Left edge found.
        x: f32,
        /// Top edge found.
        y: f32,
        /// Width found.
        w: f32,
        /// Height found.
        h: f32,
    },
    /// `update` was called before `init`.
    #[error("the tracker has no target yet: call init before update")]
    NoTarget,
}

/// Reason why a model could not be loaded.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file is a checkpoint of PyTorch.
    #[error(
        "{0}: a PyTorch checkpoint, expected a weights file: `convert {0} --out NAME.safetensors` \
         makes one of it",
        weights_format::brief(path.display())
    )]
    Checkpoint {
        /// The file.
        path: PathBuf,
    },
    /// The file is a checkpoint of this project's trainer.
    #[error(
        "{0}: a training checkpoint, expected a weights file: \
         `train export {0} --out NAME.safetensors` makes one of it",
        weights_format::brief(path.display())
    )]
    Training {
        /// The file.
        path: PathBuf,
    },
    /// Neither a file nor a built-in model has this name.
    #[error("no file and no built-in model has the name {name}; built in are {known}")]
    UnknownName {
        /// The name as given.
        name: String,
        /// The built-in models.
        known: String,
    },
    /// The weights file is unreadable or invalid.
    #[error(transparent)]
    Weights(#[from] weights_format::ReadError),
    /// The file describes a network that cannot run.
    #[error(transparent)]
    Architecture(#[from] weights_format::ArchitectureError),
    /// The weights have no calibration, which precision `int8` needs.
    #[error(
        "model '{name}' has no calibration, which precision int8 needs: \
         make one with `train quantize`"
    )]
    NoCalibration {
        /// Name in the weights file.
        name: String,
    },
}

/// Reason why frames could not be read.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A file or folder could not be opened or read.
    #[error("{path}: {error}")]
    Io {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        error: std::io::Error,
    },
    /// A picture could not be decoded.
    #[error("{path}: {reason}")]
    Decode {
        /// The file, or `-` for standard input.
        path: PathBuf,
        /// The expected and the found.
        reason: String,
    },
    /// The input holds no frames.
    #[error("{input}: {reason}")]
    Empty {
        /// The input as given.
        input: String,
        /// The expected content.
        reason: String,
    },
    /// The program that decodes is missing or failed.
    #[error("{input}: {program} {reason}")]
    Program {
        /// The input as given.
        input: String,
        /// The program.
        program: &'static str,
        /// The failure.
        reason: String,
    },
    /// A stream or option does not describe frames.
    #[error("{input}: {reason}")]
    Format {
        /// The input as given.
        input: String,
        /// The expected and the found.
        reason: String,
    },
}
