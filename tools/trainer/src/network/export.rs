//! Export from parameters in training to weights of the tracker.

use super::Network;
use autodiff::Parameters;
use weights_format::{Header, InputNormalization, LayerKind, Provenance, Storage, Tensor, Weights};

/// Input normalization in training.
pub const INPUT: InputNormalization = InputNormalization::TRAINED;

/// Added to the variance (docs/method.md, section 1.1).
const EPSILON: f64 = 1e-5;

impl Network {
    /// The deployed network: batch normalization and the head's scalars folded in, E1 and the
    /// statistics networks left out.
    pub fn export(
        &self,
        parameters: &Parameters,
        storage: Storage,
        provenance: Provenance,
    ) -> Weights {
        let values = |name: &str| {
            let id = parameters
                .find(name)
                .expect("a network's parameters are all there");
            parameters[id].value.data()
        };
        let header = Header {
            storage,
            provenance,
            input: INPUT,
            ..Header::new(self.architecture)
        };
        let mut weights = Weights::new(header);
        let [si, bi] = self
            .scalars
            .map(|id| f64::from(parameters[id].value.item()));
        for layer in self
            .architecture
            .layers()
            .iter()
            .filter(|layer| layer.kind == LayerKind::Conv)
        {
            let name = &layer.name;
            let of = |suffix: &str| values(&format!("{name}.{suffix}"));
            let (mut weight, mut bias) = (of("weight").to_vec(), of("bias").to_vec());
            let fan_in = weight.len() / bias.len();
            for (o, (weight, bias)) in weight.chunks_exact_mut(fan_in).zip(&mut bias).enumerate() {
                let mut factor = 1.0;
                let mut shifted = f64::from(*bias);
                if layer.bn {
                    let [scale, shift, mean, variance] =
                        ["bn.scale", "bn.shift", "bn.mean", "bn.variance"]
                            .map(|s| f64::from(of(s)[o]));
                    factor = scale / (variance + EPSILON).sqrt();
                    shifted = (shifted - mean) * factor + shift;
                }
                if name == "head.offsets" {
                    factor *= si;
                    shifted = shifted * si + bi;
                }
                weight
                    .iter_mut()
                    .for_each(|w| *w = (f64::from(*w) * factor) as f32);
                *bias = shifted as f32;
            }
            weights.insert(
                format!("{name}.weight"),
                Tensor {
                    shape: layer.weight_shape().to_vec(),
                    data: weight,
                },
            );
            weights.insert(
                format!("{name}.bias"),
                Tensor {
                    shape: vec![layer.out_channels],
                    data: bias,
                },
            );
        }
        weights
    }
}
