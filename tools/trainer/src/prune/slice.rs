//! Parameters of the smaller network: a selection of the same values.

use super::chain::{input, statistics_inputs};
use super::choose::Keep;
use crate::error::Error;
use crate::fit::Fit;
use crate::network::{Network, StatisticsNets};
use autodiff::{Parameters, Tensor};
use weights_format::Architecture;

/// What is left of every parameter, by name.
///
/// # Errors
/// If the smaller network cannot be built.
pub fn slice(
    source: &Fit,
    smaller: &Architecture,
    keep: &Keep,
) -> Result<Vec<(String, Tensor)>, Error> {
    let nets = source.network().statistics_nets();
    let larger = source.network().architecture();
    let mut left = Parameters::new();
    Network::new(&mut left, *smaller, nets)?;
    let deployed = source.deployed();
    let mut sliced = Vec::new();
    for parameter in left.iter() {
        let name = parameter.name();
        let Some(id) = deployed.find(name) else {
            return Err(Error::option(
                "parameters",
                format!("a tensor {name:?}"),
                "none",
            ));
        };
        let value = &deployed[id].value;
        let value = match owner(name) {
            Owner::Nothing => value.clone(),
            Owner::Layer(layer) => {
                let outputs = keep
                    .of(layer)
                    .map_or(value.clone(), |kept| take(value, 0, kept));
                let feeding =
                    input(larger, layer).and_then(|layer| keep.of(&layer).map(<[usize]>::to_vec));
                match feeding {
                    Some(kept) if name.ends_with(".weight") && value.shape().len() == 4 => {
                        take(&outputs, 3, &kept)
                    }
                    _ => outputs,
                }
            }
            Owner::Statistics { global } => {
                let positions = if global && nets == StatisticsNets::Full {
                    positions(larger)
                } else {
                    1
                };
                take(value, 1, &statistics_inputs_kept(larger, keep, positions))
            }
        };
        sliced.push((name.to_owned(), value));
    }
    Ok(sliced)
}

/// What determines the extents of a parameter.
enum Owner<'a> {
    /// A layer's filters and those of the layer before it.
    Layer(&'a str),
    /// What a statistics network sees.
    Statistics { global: bool },
    /// Nothing that pruning changes.
    Nothing,
}

fn owner(name: &str) -> Owner<'_> {
    match name {
        "mi.global.0.weight" => return Owner::Statistics { global: true },
        "mi.local.0.weight" => return Owner::Statistics { global: false },
        "head.si" | "head.bi" => return Owner::Nothing,
        _ if name.starts_with("mi.") => return Owner::Nothing,
        _ => {}
    }
    let parts = [
        ".bn.scale",
        ".bn.shift",
        ".bn.mean",
        ".bn.variance",
        ".weight",
        ".bias",
    ];
    match parts.iter().find_map(|part| name.strip_suffix(part)) {
        Some(layer) => Owner::Layer(layer),
        None => Owner::Nothing,
    }
}

/// Cells of the maps that the encoders see.
fn positions(architecture: &Architecture) -> usize {
    let layers = architecture.layers();
    let encoder = layers.iter().find(|layer| layer.name == "dr.e2.0");
    encoder.map_or(1, |layer| layer.out_template.pow(2))
}

/// Inputs of a statistics network that stay: features, then the related and unrelated codes
/// together, each flattened channel by channel.
fn statistics_inputs_kept(
    architecture: &Architecture,
    keep: &Keep,
    positions: usize,
) -> Vec<usize> {
    let Some(layers) = statistics_inputs(architecture) else {
        return Vec::new();
    };
    let encoded = architecture.encoder.map_or(0, |encoder| encoder.width);
    let features = architecture
        .layers()
        .iter()
        .find(|layer| layer.name == layers[0])
        .map_or(0, |layer| layer.out_channels);
    let starts = [0, features, features + encoded];
    let channels = layers.iter().zip(starts).flat_map(|(layer, start)| {
        keep.of(layer)
            .into_iter()
            .flatten()
            .map(move |channel| start + channel)
    });
    channels
        .flat_map(|channel| (0..positions).map(move |at| channel * positions + at))
        .collect()
}

/// Selects indices of a tensor along one of its extents.
fn take(tensor: &Tensor, axis: usize, indices: &[usize]) -> Tensor {
    let shape = tensor.shape();
    let inner: usize = shape[axis + 1..].iter().product();
    let outer: usize = shape[..axis].iter().product();
    let mut values = Vec::with_capacity(outer * indices.len() * inner);
    for o in 0..outer {
        for &i in indices {
            values.extend(&tensor.data()[(o * shape[axis] + i) * inner..][..inner]);
        }
    }
    let mut shape = shape.to_vec();
    shape[axis] = indices.len();
    Tensor::new(&shape, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selection_works_along_every_extent() {
        let tensor = Tensor::new(&[2, 3, 2], (0..12).map(|v| v as f32).collect());
        assert_eq!(
            take(&tensor, 0, &[1]).data(),
            [6.0, 7.0, 8.0, 9.0, 10.0, 11.0]
        );
        assert_eq!(
            take(&tensor, 1, &[0, 2]).data(),
            [0.0, 1.0, 4.0, 5.0, 6.0, 7.0, 10.0, 11.0]
        );
        let last = take(&tensor, 2, &[1]);
        assert_eq!(
            (last.shape(), last.data()),
            (&[2, 3, 1][..], &[1.0, 3.0, 5.0, 7.0, 9.0, 11.0][..])
        );
    }
}
