//! How many filters stay, and which.

use super::Row;
use super::chain::{Group, groups};
use super::ranks::Ranks;
use crate::error::Error;
use std::collections::BTreeMap;
use weights_format::{Architecture, Encoder, Widths};

/// How many filters of a layer stay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rule {
    /// Removes a share of the unpruned network's filters, regardless of the present number.
    Ratio(f64),
    /// Keeps filters of at least this mean rank. For a pair of necks the rank of the search side
    /// counts.
    Rank(f64),
}

/// Target size of a network.
#[derive(Clone, Debug, PartialEq)]
pub struct Targets {
    /// For layers without a rule of their own.
    pub rule: Rule,
    /// Rules of single layers, by one of [`LAYERS`].
    pub layers: BTreeMap<String, Rule>,
}

/// Layers that can have a rule of their own, in the order of [`Widths::all`]. The encoders follow
/// `backbone.conv5`.
pub const LAYERS: [&str; 13] = [
    "backbone.conv1",
    "backbone.conv2",
    "backbone.conv3",
    "backbone.conv4",
    "backbone.conv5",
    "neck.cls",
    "neck.reg",
    "head.cls1",
    "head.cls2",
    "head.cls3",
    "head.reg1",
    "head.reg2",
    "head.reg3",
];

/// Which filters stay.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Keep {
    groups: Vec<(Group, Vec<usize>)>, // indices ascending
}

impl Targets {
    /// One ratio for all layers.
    pub fn ratio(ratio: f64) -> Targets {
        Targets {
            rule: Rule::Ratio(ratio),
            layers: BTreeMap::new(),
        }
    }

    fn of(&self, group: &str) -> Rule {
        let name = index(group).map_or(group, |at| LAYERS[at]);
        self.layers.get(name).copied().unwrap_or(self.rule)
    }
}

/// Chooses the filters to keep: those of highest rank; at equal rank those of larger L1 norm; at
/// equal norm the first ones. Layers that are pruned together count by the sums of their ranks and
/// norms.
///
/// # Errors
/// If a rule asks for more filters than there are, or leaves none.
pub fn choose(
    architecture: &Architecture,
    ranks: &Ranks,
    norms: &BTreeMap<String, Vec<f64>>,
    targets: &Targets,
) -> Result<Keep, Error> {
    if let Some(name) = targets
        .layers
        .keys()
        .find(|name| !LAYERS.contains(&name.as_str()))
    {
        return Err(Error::option(
            "--layer-ratio",
            format!("one of {}", LAYERS.join(", ")),
            name,
        ));
    }
    let mut kept: Vec<(Group, Vec<usize>)> = Vec::new();
    for group in groups(architecture) {
        let sum = |of: &dyn Fn(&str) -> Option<Vec<f64>>| {
            let mut sum = vec![0.0; group.width];
            for values in group.layers.iter().filter_map(|layer| of(layer)) {
                sum.iter_mut()
                    .zip(values)
                    .for_each(|(sum, value)| *sum += value);
            }
            sum
        };
        let rank = sum(&|layer| ranks.of(layer).map(<[f64]>::to_vec));
        let norm = sum(&|layer| norms.get(layer).cloned());
        let by_rank = |count: usize| (count, highest(&rank, &norm, count));
        let (wanted, indices) = match (index(&group.name), targets.of(&group.name)) {
            (Some(at), Rule::Ratio(ratio)) => by_rank(Widths::pruned(ratio).all()[at]),
            (Some(_), Rule::Rank(least)) => {
                let decisive = group
                    .layers
                    .last()
                    .and_then(|layer| ranks.of(layer))
                    .unwrap_or(&rank);
                let indices: Vec<_> = (0..group.width).filter(|&i| decisive[i] >= least).collect();
                (indices.len(), indices)
            }
            // An encoder keeps its width relative to its features.
            (None, _) => {
                let features = architecture.widths.backbone[4];
                let left = kept
                    .iter()
                    .find(|(group, _)| group.name == "backbone.conv5");
                let left = left.map_or(features, |(_, indices)| indices.len());
                by_rank((group.width * left / features).max(1))
            }
        };
        if !(1..=group.width).contains(&wanted) {
            let expected = format!("1 to {} filters in {}", group.width, group.name);
            return Err(Error::option("--ratio", expected, wanted));
        }
        kept.push((group, indices));
    }
    Ok(Keep { groups: kept })
}

/// A group's place in [`LAYERS`]; `None` for an encoder. Behind one encoder for both tasks, the
/// necks are one group.
fn index(group: &str) -> Option<usize> {
    let name = if group == "neck" { "neck.cls" } else { group };
    LAYERS.iter().position(|layer| *layer == name)
}

/// Indices of the `count` highest, ascending.
fn highest(ranks: &[f64], norms: &[f64], count: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..ranks.len()).collect();
    order.sort_by(|&a, &b| {
        ranks[b]
            .total_cmp(&ranks[a])
            .then(norms[b].total_cmp(&norms[a]))
            .then(a.cmp(&b))
    });
    order.truncate(count);
    order.sort_unstable();
    order
}

impl Keep {
    /// What stays of a layer, indices ascending; `None` for layers of which everything stays.
    pub fn of(&self, layer: &str) -> Option<&[usize]> {
        let group = self
            .groups
            .iter()
            .find(|(group, _)| group.layers.iter().any(|name| name == layer));
        group.map(|(_, kept)| &kept[..])
    }

    /// What is left of an architecture.
    pub fn architecture(&self, of: &Architecture) -> Architecture {
        let width = |layer: &str| self.of(layer).map_or(0, <[usize]>::len);
        let widths = Widths {
            backbone: [1, 2, 3, 4, 5].map(|i| width(&format!("backbone.conv{i}"))),
            neck_cls: width("neck.search_cls"),
            neck_reg: width("neck.search_reg"),
            head_cls: [1, 2, 3].map(|i| width(&format!("head.cls{i}"))),
            head_reg: [1, 2, 3].map(|i| width(&format!("head.reg{i}"))),
        };
        let encoder = of.encoder.map(|encoder| {
            let layer = if encoder.shared {
                "dr.e2.0"
            } else {
                "dr.e2_search.0"
            };
            Encoder {
                width: width(layer),
                ..encoder
            }
        });
        Architecture {
            widths,
            encoder,
            ..*of
        }
    }

    /// A row per group that has ranks.
    pub(super) fn rows(&self, ranks: &Ranks) -> Vec<Row> {
        let row = |(group, kept): &(Group, Vec<usize>)| {
            let mean = |stays: bool| {
                let chosen = |i: &usize| kept.binary_search(i).is_ok() == stays;
                let values: Vec<f64> = group
                    .layers
                    .iter()
                    .filter_map(|layer| ranks.of(layer))
                    .flat_map(|ranks| (0..group.width).filter(chosen).map(|i| ranks[i]))
                    .collect();
                (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
            };
            Row {
                layer: group.name.clone(),
                of: group.width,
                kept: kept.len(),
                ranks: [mean(true), mean(false)],
            }
        };
        self.groups
            .iter()
            .map(row)
            .filter(|row| row.ranks != [None, None])
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_ranks_are_ordered_by_norm_then_index() {
        let ranks = [2.0, 5.0, 2.0, 2.0, 0.0, 2.0];
        let norms = [1.0, 0.0, 3.0, 1.0, 9.0, 1.0];
        assert_eq!(highest(&ranks, &norms, 0), [0; 0]);
        assert_eq!(highest(&ranks, &norms, 2), [1, 2]);
        assert_eq!(highest(&ranks, &norms, 4), [0, 1, 2, 3]);
        assert_eq!(highest(&ranks, &norms, 6), [0, 1, 2, 3, 4, 5]);
    }
}
