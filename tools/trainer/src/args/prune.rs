//! `prune`.

use super::training::ratio_of;
use super::{Data, wrong};
use std::path::PathBuf;
use trainer::Error;
use trainer::prune::{LAYERS, Rule, Targets};

#[derive(Debug, clap::Args)]
pub struct Prune {
    /// The network: a checkpoint, a weights file, or what `convert --to trainer` wrote.
    #[arg(value_name = "FILE")]
    pub network: PathBuf,
    /// The checkpoint to write; replaced if it exists.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Share of the filters that go from every layer of the full network, whatever is left of it
    /// now.
    #[arg(long, default_value_t = 0.5)]
    pub ratio: f64,
    /// A layer's own ratio, such as backbone.conv5=0.3; may be given several times.
    #[arg(long, value_name = "LAYER=R")]
    pub layer_ratio: Vec<String>,
    /// Of this layer keep the filters of at least that mean rank, such as head.cls2=0.5; may be
    /// given several times.
    #[arg(long, value_name = "LAYER=RANK")]
    pub layer_rank: Vec<String>,
    /// Pairs of crops over which ranks are averaged.
    #[arg(long, default_value_t = 96)]
    pub pairs: usize,
    /// Threads that compute [default: one per core].
    #[arg(long)]
    pub threads: Option<usize>,
    /// The checkpoint's own data where none is given.
    #[command(flatten)]
    pub data: Data,
}

impl Prune {
    /// How many filters stay.
    pub fn targets(&self) -> Result<Targets, Error> {
        let mut targets = Targets::ratio(ratio_of("--ratio", self.ratio)?);
        for text in &self.layer_ratio {
            let (layer, ratio) = named("--layer-ratio", text)?;
            targets
                .layers
                .insert(layer, Rule::Ratio(ratio_of("--layer-ratio", ratio)?));
        }
        for text in &self.layer_rank {
            let (layer, rank) = named("--layer-rank", text)?;
            targets.layers.insert(layer, Rule::Rank(rank));
        }
        if !(1..=100_000).contains(&self.pairs) {
            return Err(wrong("--pairs", "1 to 100000", &self.pairs));
        }
        Ok(targets)
    }
}

/// `LAYER=NUMBER`.
fn named(option: &str, text: &str) -> Result<(String, f64), Error> {
    let parts = text
        .split_once('=')
        .and_then(|(layer, number)| Some((layer, number.parse::<f64>().ok()?)));
    match parts {
        Some((layer, number)) if LAYERS.contains(&layer) && number.is_finite() => {
            Ok((layer.into(), number))
        }
        _ => Err(wrong(
            option,
            &format!("LAYER=NUMBER with a layer of {}", LAYERS.join(", ")),
            &text,
        )),
    }
}
