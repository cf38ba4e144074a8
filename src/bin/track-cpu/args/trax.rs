//! The command line of `trax`.

use super::values::trax_version;
use super::{EngineArgs, ModelArg};

/// `trax`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example, in the trackers.ini of vot-toolkit:
  [track-cpu]
  label = track-cpu
  protocol = trax
  command = /path/to/track-cpu trax

Messages go over standard input and output, or over the local port that the environment variable
TRAX_SOCKET names. Regions are rectangles, polygons and masks; pictures are paths, in memory or
encoded. Answers are rectangles, with the score as `confidence`. With protocol version 4 several
objects may be followed at a time.")]
pub struct TraxArgs {
    /// Which model.
    #[command(flatten)]
    pub model: ModelArg,
    /// Version of the protocol: 1, 3 or 4.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = trax_version)]
    pub protocol: u32,
    /// How the network runs.
    #[command(flatten)]
    pub engine: EngineArgs,
}
