//! The command line of `demo`.

use std::path::PathBuf;

use scenes::Difficulty;

use super::values::frames;
use super::{EngineArgs, ModelArg};

/// `demo`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  track-cpu demo --seed 3 --out my-demo

The tracker is given the object's true box in the first frame, and never again. Mean IoU and
precision (share of frames whose center is at most 20 pixels off) count the frames after the first
in which more than 30 % of the object is visible. FPS counts tracking only: frames divided by total
time.")]
pub struct DemoArgs {
    /// Folder for demo.gif and sheet.png.
    #[arg(short, long, value_name = "DIR", default_value = "track-cpu-demo")]
    pub out: PathBuf,
    /// Number of the flight.
    #[arg(long, value_name = "N", default_value_t = 7)]
    pub seed: u64,
    /// How hard the object is to follow: easy is calm and clear, medium adds shake, look-alikes and
    /// occlusions, hard has more of these and exits from the view.
    #[arg(long, value_name = "LEVEL", default_value_t = Difficulty::Easy)]
    pub difficulty: Difficulty,
    /// Length of the flight.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = frames)]
    pub frames: usize,
    /// Which model.
    #[command(flatten)]
    pub model: ModelArg,
    /// End standard output with one JSON object: mean_iou, precision_20, fps, frames.
    #[arg(long)]
    pub json: bool,
    /// How the network runs.
    #[command(flatten)]
    pub engine: EngineArgs,
}
