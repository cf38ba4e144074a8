//! The command line.

use clap::{Parser, ValueEnum};
use converter::Options;
use std::path::PathBuf;
use weights_format::Storage;

/// Convert a PyTorch checkpoint of DR-MIM / SiamFC++-AlexNet to a weights file, and back
///
/// Reads zip archives (torch 1.6 and later) and legacy streams, as data: nothing in them is
/// executed. For a weights file, batch normalization and the head's scalars are folded in; tensors
/// that only training needs are ignored and listed.
///
/// `--to trainer` keeps them apart: what it writes, `train fit --init` and `train prune` take.
/// `--to pytorch` goes the other way, from a file of this project to a state dict under
/// video_analyst's names, in a .pth or .safetensors file.
#[derive(Debug, Parser)]
#[command(version, after_help = program::exit_help())]
pub struct Args {
    /// The checkpoint (.pth, .pt, .pkl); for `--to pytorch` a weights file, a checkpoint of the
    /// trainer, or what `--to trainer` wrote.
    pub checkpoint: PathBuf,
    /// What to write.
    #[arg(long, value_enum, default_value_t = To::Weights)]
    pub to: To,
    /// The file to write; replaced if it exists.
    #[arg(long, value_name = "FILE", required_unless_present = "dry_run")]
    pub out: Option<PathBuf>,
    /// Type of the weights in the file (biases are always f32).
    #[arg(long, value_enum, default_value_t = Dtype::F32)]
    pub dtype: Dtype,
    /// Print the network layer by layer and write nothing.
    #[arg(long)]
    pub dry_run: bool,
    /// Name of the model [default: that of the checkpoint].
    #[arg(long)]
    pub name: Option<String>,
    /// The encoder E2 has no ReLU. The tensors do not say whether it has.
    #[arg(long)]
    pub encoder_linear: bool,
}

/// What to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum To {
    /// A weights file for the tracker.
    Weights,
    /// Parameters for the trainer, nothing folded.
    Trainer,
    /// A PyTorch state dict.
    Pytorch,
}

/// Type of the weights in the file.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Dtype {
    /// Half precision: half the size, a relative error of about 0.0002.
    F16,
    /// Single precision, exactly as folded.
    F32,
}

impl Args {
    /// The options of the conversion.
    pub fn options(&self) -> Options {
        Options {
            name: self.name.clone(),
            storage: match self.dtype {
                Dtype::F16 => Storage::F16,
                Dtype::F32 => Storage::F32,
            },
            encoder_relu: !self.encoder_linear,
        }
    }
}
