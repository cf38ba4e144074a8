//! The command line of `info`.

use std::path::PathBuf;

use super::engine::model_help;
use super::random::RandomArgs;

/// `info`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  track-cpu info drmim-p50
  track-cpu info weights.safetensors --json
  track-cpu info --widths P50 --encoder 3x3
  track-cpu info --widths 76,224,337,334,256,256,256,230,138,224,227,145,224
      P-SiamFC++: 7,489,986 parameters

All 13 widths are conv1 to conv5, the necks (cls, reg), and the towers cls1 to cls3 and reg1 to
reg3.")]
pub struct InfoArgs {
    #[doc = "The model."]
    #[arg(value_name = "MODEL", help = model_help())]
    pub model: Option<PathBuf>,
    /// A network without a file.
    #[command(flatten)]
    pub random: RandomArgs,
    /// Print one JSON object in place of the tables.
    #[arg(long)]
    pub json: bool,
}
