//! The command line: clap structs, nothing else.

use clap::{Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// One-pass evaluation of trackers: run, score, compare.
#[derive(Debug, Parser)]
#[command(version, about, after_help = EXAMPLES)]
pub struct Args {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

impl Args {
    /// Reads this process's command line; ends the process with help or a message where that does not parse.
    pub fn read() -> Args {
        Args::parse()
    }
}

const EXAMPLES: &str = "\
Examples:
  ope score --annotations DTB70/anno --results results/DTB70/mine

Exit codes:
  0  done
  2  a command-line argument is wrong
  3  an input cannot be used
  5  an output cannot be written";

/// The sub-commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Hold a folder of results against a folder of annotations.
    Score(ScoreArgs),
}

/// `score`.
#[derive(Debug, clap::Args)]
pub struct ScoreArgs {
    /// Folder of annotations: <sequence>.txt, <sequence>_gt.txt or <sequence>/groundtruth*.txt.
    #[arg(short, long, value_name = "DIR")]
    pub annotations: PathBuf,
    /// Folder of results: <sequence>.txt or <sequence>/<sequence>_001.txt, times in times/<sequence>_time.txt.
    #[arg(short, long, value_name = "DIR")]
    pub results: PathBuf,
    /// The rule by which frames are counted.
    #[arg(short, long, value_enum, default_value_t = Rule::All)]
    pub convention: Rule,
    /// Write JSON: percent, under --convention all an object per rule.
    #[arg(long)]
    pub json: bool,
    /// Leave out sequences that have no results, instead of refusing.
    #[arg(long)]
    pub partial: bool,
    /// Show every sequence.
    #[arg(long)]
    pub per_sequence: bool,
}

/// A rule, or all of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Rule {
    /// got10k toolkit: annotations with NaN do not count.
    Got10k,
    /// pysot: every frame counts.
    Pysot,
    /// Matlab code of OTB and UAV123: every frame counts, unusable results are the previous frame's.
    Otb,
    /// As got10k, and annotations without area do not count either.
    Drop,
    /// All of them, side by side.
    All,
}

impl Rule {
    /// The rules meant.
    pub fn conventions(self) -> &'static [ope::Convention] {
        let at = match self {
            Rule::Got10k => 0..1,
            Rule::Pysot => 1..2,
            Rule::Otb => 2..3,
            Rule::Drop => 3..4,
            Rule::All => 0..4,
        };
        &ope::Convention::ALL[at]
    }
}
