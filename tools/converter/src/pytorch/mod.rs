//! The way back: a network of this project as a PyTorch state dict.
//!
//! | file | what is in it |
//! |---|---|
//! | `mod` | the tensors under PyTorch's names and in its layout |
//! | `pickle` | the pickle of a state dict |
//! | `write` | zip archive (`.pth`) and safetensors |

mod pickle;
mod write;

use crate::{
    architecture::{convolutions, parameters},
    error::{Error, Refusal},
    names::{self, EncoderNames},
};
use safetensors::SafeTensors;
use std::{collections::BTreeMap, path::Path};
use weights_format::{Architecture, InputNormalization, Layer, Tensor, Unfolded, Weights};

/// The variance with which a normalization of scale 1, shift 0 and mean 0 leaves f32 values as they
/// are: 1 less what PyTorch adds to it.
const IDENTITY_VARIANCE: f32 = 1.0 - 1e-5;

/// Values of a state dict's tensor.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Parameters and statistics.
    F32(Vec<f32>),
    /// A counter.
    I64(i64),
}

/// Named tensors in PyTorch's layout (OIHW), in the order of the network.
///
/// The network expects unscaled pixels, BGR in 0..=255, as video_analyst feeds them. The input
/// normalization that a network of this project was trained with goes into its first convolution.
#[derive(Clone, Debug, PartialEq)]
pub struct StateDict {
    /// Name, shape and values.
    pub entries: Vec<(String, Vec<usize>, Values)>,
    /// Whether normalizations were folded in already, and so are written as ones that change
    /// nothing.
    pub folded: bool,
}

impl StateDict {
    /// The network of a weights file, of a checkpoint of the trainer, or of what
    /// [`unfold`](crate::unfold) made.
    ///
    /// # Errors
    /// If the file cannot be read or has none of these formats.
    pub fn read(path: &Path) -> Result<StateDict, Error> {
        let bytes = crate::convert::read(path).map_err(|error| Error::Unreadable {
            path: path.into(),
            error,
        })?;
        let refused = |found: &dyn ToString| Error::Refused {
            path: path.into(),
            refusal: Refusal::new(
                "file",
                "a weights file or a checkpoint of the trainer",
                found.to_string(),
            ),
        };
        let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|error| refused(&error))?;
        let folded = header
            .metadata()
            .as_ref()
            .is_some_and(|metadata| metadata.contains_key("track-cpu"));
        Ok(if folded {
            StateDict::of_weights(&Weights::read(path)?)
        } else {
            StateDict::of_unfolded(&Unfolded::read(path)?)
        })
    }

    /// The network of a weights file: normalizations and the head's scalars, which are folded in,
    /// change nothing.
    ///
    /// Expects weights that passed [`Weights::check`].
    pub fn of_weights(weights: &Weights) -> StateDict {
        let architecture = &weights.header.architecture;
        let mut tensors: BTreeMap<String, Tensor> = weights
            .tensors()
            .map(|(name, tensor)| (name.to_owned(), tensor.clone()))
            .collect();
        for layer in convolutions(architecture).iter().filter(|layer| layer.bn) {
            let parts = [
                ("scale", 1.0),
                ("shift", 0.0),
                ("mean", 0.0),
                ("variance", IDENTITY_VARIANCE),
            ];
            for (part, value) in parts {
                let shape = vec![layer.out_channels];
                let tensor = Tensor {
                    shape,
                    data: vec![value; layer.out_channels],
                };
                tensors.insert(format!("{}.bn.{part}", layer.name), tensor);
            }
        }
        for (name, value) in names::SCALARS.into_iter().zip([1.0, 0.0]) {
            tensors.insert(
                name.to_owned(),
                Tensor {
                    shape: Vec::new(),
                    data: vec![value],
                },
            );
        }
        let entries = entries(architecture, tensors, &weights.header.input);
        StateDict {
            entries,
            folded: true,
        }
    }

    /// A network as it is trained, tensor by tensor.
    ///
    /// Expects one that passed [`Unfolded::check`].
    pub fn of_unfolded(unfolded: &Unfolded) -> StateDict {
        let entries = entries(
            &unfolded.architecture,
            unfolded.tensors.clone(),
            &unfolded.input,
        );
        StateDict {
            entries,
            folded: false,
        }
    }
}

/// Every tensor under its other name. `tensors` are all of the architecture's.
fn entries(
    architecture: &Architecture,
    mut tensors: BTreeMap<String, Tensor>,
    input: &InputNormalization,
) -> Vec<(String, Vec<usize>, Values)> {
    let encoder = architecture.encoder.map(|encoder| EncoderNames {
        shared: encoder.shared,
        numbered: encoder.layers > 1,
        layers: encoder.layers,
    });
    let mut take = |name: &str| {
        tensors
            .remove(name)
            .unwrap_or_else(|| panic!("a complete network has {name}")) // checked by the callers
    };
    let mut entries = Vec::new();
    for layer in convolutions(architecture) {
        let ours = |part: &str| format!("{}.{part}", layer.name);
        let (mut weight, mut bias) = (take(&ours("weight")).data, take(&ours("bias")).data);
        if layer.name == "backbone.conv1" {
            input.translate(&InputNormalization::default(), &mut weight, &mut bias);
        }
        let mut values = vec![oihw(&weight, &layer), bias];
        if layer.bn {
            values.extend(names::OUR_BATCH_NORM.map(|part| take(&ours(part)).data));
        }
        let [outputs, rows, columns, inputs] = layer.weight_shape();
        for (i, (name, values)) in parameters(&layer, encoder)
            .into_iter()
            .zip(values)
            .enumerate()
        {
            let shape = if i == 0 {
                vec![outputs, inputs, rows, columns]
            } else {
                vec![outputs]
            };
            entries.push((name, shape, Values::F32(values)));
        }
        if layer.bn {
            let name = format!("{}.{}", names::prefix(&layer.name, encoder), names::COUNTER);
            entries.push((name, Vec::new(), Values::I64(0)));
        }
    }
    entries.extend(
        names::SCALARS.map(|name| (name.to_owned(), Vec::new(), Values::F32(take(name).data))),
    );
    entries
}

/// `[Cout, kh, kw, Cin]` as `[Cout, Cin, kh, kw]`.
fn oihw(weight: &[f32], layer: &Layer) -> Vec<f32> {
    let (channels, area) = (layer.in_channels, layer.kernel * layer.kernel);
    weight
        .chunks_exact(channels * area)
        .flat_map(|output| {
            (0..channels * area).map(move |i| output[i % area * channels + i / area])
        })
        .collect()
}
