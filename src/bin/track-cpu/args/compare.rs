//! The command line of `compare`.

use std::path::PathBuf;

use super::values::drawn;

/// `compare`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  track-cpu compare ours.txt kcf.txt csrt.txt --input clip.mp4 --out three.mp4
  track-cpu compare groundtruth.txt ours.txt --input seq/img --out sheet.png

Files hold one box per frame, x,y,w,h, separated by commas, blanks or tabs; NaN is no box. They are
those of `track --out`, of `ope run`, and of most toolkits.")]
pub struct CompareArgs {
    /// Files of boxes, one per tracker; their names become the legend.
    #[arg(value_name = "BOXES", required = true, num_args = 1..=8)]
    pub boxes: Vec<PathBuf>,
    /// The frames: folder of images, 'glob*.jpg' (quoted), video file, URL, or - for standard
    /// input.
    #[arg(short, long, value_name = "INPUT")]
    pub input: PathBuf,
    /// What to draw: a contact sheet (.png), a film (.gif, or .mp4 through ffmpeg), or a folder for
    /// JPEGs.
    #[arg(short, long, value_name = "X.png|X.gif|X.mp4|DIR", value_parser = drawn)]
    pub out: PathBuf,
}
