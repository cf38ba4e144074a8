//! Pruning by rank: filters whose feature maps have low rank are removed, with the inputs they
//! feed.
//!
//! | file | what is in it |
//! |---|---|
//! | `ranks` | mean ranks of feature maps over crops of the data |
//! | `chain` | which layer feeds which, and which layers are pruned together |
//! | `choose` | how many filters stay, and which |
//! | `slice` | parameters of the smaller network |
//!
//! Source: HRank, as P-SiamFC++ and DR-MIM use it (docs/method.md, section 3.6).

mod chain;
mod choose;
mod ranks;
mod slice;
#[cfg(test)]
mod tests;

pub use choose::{Keep, LAYERS, Rule, Targets, choose};
pub use ranks::{Ranks, norms};

use crate::error::Error;
use crate::fit::{Fit, FitOptions, Position};
use std::fmt;

/// Pruning of one layer, or of two that are pruned together.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The layer.
    pub layer: String,
    /// How many filters it had.
    pub of: usize,
    /// How many stay.
    pub kept: usize,
    /// Mean rank of the kept and of the removed filters.
    pub ranks: [Option<f64>; 2],
}

/// A pruned network and the choice behind it.
pub struct Pruned {
    /// The network, as a fresh run.
    pub fit: Fit,
    /// The choice in each layer.
    pub rows: Vec<Row>,
}

/// Prunes a network to `targets`, keeping the filters of highest rank in every layer. The result is
/// a fresh run with the same options and data.
///
/// # Errors
/// If a target is larger than what there is, or the smaller network cannot be built.
pub fn prune(source: &Fit, ranks: &Ranks, targets: &Targets) -> Result<Pruned, Error> {
    let architecture = *source.network().architecture();
    let norms = norms(source)?;
    let keep = choose(&architecture, ranks, &norms, targets)?;
    let smaller = keep.architecture(&architecture);
    let Position {
        options,
        data,
        data_options,
        ..
    } = source.position().clone();
    let mut position = Position::start(
        FitOptions {
            architecture: smaller,
            ..options
        },
        data,
        data_options,
    );
    position.history = source.history();
    position.history.push(format!(
        "pruned by rank over {} pairs to {}",
        ranks.pairs,
        widths(&smaller)
    ));
    let parameters = slice::slice(source, &smaller, &keep)?;
    let fit = Fit::with_parameters(position, parameters)?;
    let rows = keep.rows(ranks);
    Ok(Pruned { fit, rows })
}

/// Widths in words: `48/128/192/192/128, 128, 128`.
fn widths(architecture: &weights_format::Architecture) -> String {
    let all = architecture.widths.all().map(|width| width.to_string());
    let parts = [&all[..5], &all[5..7], &all[7..10], &all[10..]];
    parts.map(|part| part.join("/")).join(", ")
}

impl fmt::Display for Pruned {
    /// A line per layer.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<18}{:>6}{:>6}{:>14}{:>14}",
            "layer", "kept", "of", "rank, kept", "rank, gone"
        )?;
        let number = |rank: Option<f64>| rank.map_or("-".into(), |rank| format!("{rank:.3}"));
        for Row {
            layer,
            of,
            kept,
            ranks,
        } in &self.rows
        {
            let [high, low] = ranks.map(number);
            writeln!(f, "{layer:<18}{kept:>6}{of:>6}{high:>14}{low:>14}")?;
        }
        let architecture = self.fit.network().architecture();
        writeln!(
            f,
            "{} parameters, {:.1} MMAC per search crop",
            architecture.parameters(),
            architecture.macs_search() as f64 / 1e6
        )
    }
}
