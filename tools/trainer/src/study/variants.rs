//! The studies of the paper: pruning ratios and ablation.

use super::{Study, Variant};
use crate::data::{DataOptions, Dataset};
use crate::error::Error;
use crate::fit::{Fit, FitOptions, compute};
use crate::network::StatisticsNets;
use crate::prune::{Ranks, Targets, prune};
use std::path::Path;
use std::sync::Arc;

/// A network pruned to each of some ratios, then trained on with the same options and pairs:
/// precision against ratio.
///
/// The pruned networks are written to `out` as `pruned-<ratio>.safetensors`; those that are there
/// already are taken as they are. Ranks are means over `pairs` pairs.
///
/// # Errors
/// If a ratio asks for a larger network than `source`, or the data cannot be opened.
pub fn sweep(
    source: &mut Fit,
    ratios: &[f64],
    options: &FitOptions,
    (data, data_options): (&[String], &DataOptions),
    pairs: usize,
    (out, threads): (&Path, usize),
) -> Result<Study, Error> {
    std::fs::create_dir_all(out).map_err(Error::io(out))?;
    let mut ranks: Option<Ranks> = None;
    let mut variants = Vec::with_capacity(ratios.len());
    for &ratio in ratios {
        let path = out.join(format!("pruned-{ratio}.safetensors"));
        if !path.exists() {
            if ranks.is_none() {
                let specs: Result<Vec<_>, _> = data.iter().map(|text| text.parse()).collect();
                let dataset = Arc::new(Dataset::open(&specs?, data_options.clone())?);
                source.unfold(&compute(threads)?, &dataset, 1)?;
                ranks = Some(Ranks::measure(source, &dataset, pairs, threads)?);
            }
            if let Some(ranks) = &ranks {
                prune(source, ranks, &Targets::ratio(ratio))?
                    .fit
                    .save(&path)?;
            }
        }
        let pruned = Fit::resume(&path)?;
        let architecture = *pruned.network().architecture();
        variants.push(Variant {
            group: format!("{ratio}"),
            options: FitOptions {
                architecture,
                ..options.clone()
            },
            data_options: data_options.clone(),
            start: Some(path),
        });
    }
    Ok(Study {
        title: "ratio".into(),
        data: data.to_vec(),
        variants,
    })
}

/// Variants of [`ablation`]: everything; no mutual-information losses; no identity loss; no
/// encoders E1 and E2 and none of their losses.
pub const VARIANTS: [&str; 4] = ["full", "no-mi", "no-identity", "no-encoder"];

/// Trains the network with and without parts of DR-MIM from random weights, with the same options
/// and pairs, for each of some seeds. `groups` are some of [`VARIANTS`].
pub fn ablation(
    options: &FitOptions,
    data: &[String],
    data_options: &DataOptions,
    seeds: &[u64],
    groups: &[String],
) -> Study {
    let variant = |group: &str, seed: u64| {
        let mut options = FitOptions {
            seed,
            ..options.clone()
        };
        if matches!(group, "no-mi" | "no-encoder") {
            options.statistics_nets = StatisticsNets::None;
        }
        if matches!(group, "no-identity" | "no-encoder") {
            options.losses.identity = 0.0;
        }
        if group == "no-encoder" {
            options.architecture.encoder = None;
        }
        let data_options = DataOptions {
            seed,
            ..data_options.clone()
        };
        Variant {
            group: group.into(),
            options,
            data_options,
            start: None,
        }
    };
    let of_seed = |seed: &u64| {
        groups
            .iter()
            .map(|group| variant(group, *seed))
            .collect::<Vec<_>>()
    };
    let variants = seeds.iter().flat_map(of_seed).collect();
    Study {
        title: "variant".into(),
        data: data.to_vec(),
        variants,
    }
}
