//! Import from other forms of a network.

use super::{INPUT, Network};
use crate::error::Error;
use autodiff::{Parameters, Tensor};
use weights_format::{InputNormalization, LayerKind, Unfolded, Weights};

/// The variance with which a normalization of scale 1, shift 0 and mean 0 is the identity on f32
/// values: 1 minus epsilon.
const IDENTITY_VARIANCE: f32 = 1.0 - 1e-5;

impl Network {
    /// Sets the deployed network's parameters to those of a weights file. Its normalizations are
    /// folded in, so those here change nothing: fit for evaluation, but not for training before
    /// [`statistics::unfold`](crate::fit) gave them the data's statistics.
    ///
    /// # Errors
    /// If the weights are another network's.
    pub fn import(&self, parameters: &mut Parameters, weights: &Weights) -> Result<(), Error> {
        weights.check()?;
        for layer in self
            .architecture
            .layers()
            .iter()
            .filter(|layer| layer.kind == LayerKind::Conv)
        {
            let name = &layer.name;
            for part in ["weight", "bias"] {
                let name = format!("{name}.{part}");
                if let Some(tensor) = weights.tensor(&name) {
                    set(parameters, &name, &tensor.shape, tensor.data.clone())?;
                }
            }
            if layer.bn {
                let parts = [
                    ("scale", 1.0),
                    ("shift", 0.0),
                    ("mean", 0.0),
                    ("variance", IDENTITY_VARIANCE),
                ];
                for (part, value) in parts {
                    let values = vec![value; layer.out_channels];
                    set(
                        parameters,
                        &format!("{name}.bn.{part}"),
                        &[layer.out_channels],
                        values,
                    )?;
                }
            }
        }
        set(parameters, "head.si", &[], vec![1.0])?;
        set(parameters, "head.bi", &[], vec![0.0])?;
        translate(parameters, &weights.header.input);
        Ok(())
    }

    /// Sets the deployed network's parameters to given ones.
    ///
    /// # Errors
    /// If they are another network's.
    pub fn import_unfolded(
        &self,
        parameters: &mut Parameters,
        unfolded: &Unfolded,
    ) -> Result<(), Error> {
        for (name, tensor) in &unfolded.tensors {
            set(parameters, name, &tensor.shape, tensor.data.clone())?;
        }
        translate(parameters, &unfolded.input);
        Ok(())
    }
}

fn set(
    parameters: &mut Parameters,
    name: &str,
    shape: &[usize],
    values: Vec<f32>,
) -> Result<(), Error> {
    let restored = parameters.restore(name, Tensor::new(shape, values));
    restored.map_err(|error| Error::option("--init", "the parameters of this network", error))
}

/// Makes the first convolution, which expects `input`, expect what training feeds it.
fn translate(parameters: &mut Parameters, input: &InputNormalization) {
    let ids = ["backbone.conv1.weight", "backbone.conv1.bias"].map(|name| parameters.find(name));
    let [Some(weight), Some(bias)] = ids else {
        return;
    };
    let mut values = [weight, bias].map(|id| parameters[id].value.data().to_vec());
    let [w, b] = &mut values;
    input.translate(&INPUT, w, b);
    for (id, values) in [weight, bias].into_iter().zip(values) {
        parameters[id].value.data_mut().copy_from_slice(&values);
    }
}
