//! Header and tensors together.

use crate::{
    architecture::{Architecture, LayerKind},
    error::ReadError,
    header::Header,
};
use std::{collections::BTreeMap, fmt};

/// Values with a shape, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor {
    /// `[Cout, kh, kw, Cin]` for a weight, `[Cout]` for a bias.
    pub shape: Vec<usize>,
    /// The values; their number is the shape's product.
    pub data: Vec<f32>,
}

/// A network's weights: a header and the tensors that the architecture implies.
///
/// For every convolution `<name>` of [`Architecture::layers`] there is `<name>.weight` with shape
/// `[Cout, kh, kw, Cin]` and `<name>.bias` with shape `[Cout]`. Batch normalization and the head's
/// two scalars are folded into them.
#[derive(Clone, PartialEq)]
pub struct Weights {
    /// The file's metadata.
    pub header: Header,
    tensors: BTreeMap<String, Tensor>,
}

impl fmt::Debug for Weights {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.tensors.keys();
        f.debug_struct("Weights")
            .field("header", &self.header)
            .field("tensors", &names)
            .finish_non_exhaustive()
    }
}

impl Weights {
    /// Weights without tensors.
    pub fn new(header: Header) -> Weights {
        Weights {
            header,
            tensors: BTreeMap::new(),
        }
    }

    /// Adds or replaces a tensor, which [`check`](Self::check) may refuse.
    pub fn insert(&mut self, name: impl Into<String>, tensor: Tensor) {
        self.tensors.insert(name.into(), tensor);
    }

    /// The tensor of this name.
    pub fn tensor(&self, name: &str) -> Option<&Tensor> {
        self.tensors.get(name)
    }

    /// Every tensor, in the order of the names.
    pub fn tensors(&self) -> impl Iterator<Item = (&str, &Tensor)> {
        self.tensors
            .iter()
            .map(|(name, tensor)| (name.as_str(), tensor))
    }

    /// Checks the header's bounds, and that there are exactly the tensors that the architecture
    /// implies, with the right shapes and finite values.
    ///
    /// # Errors
    /// Names the first field or tensor that is wrong.
    pub fn check(&self) -> Result<(), ReadError> {
        self.header.check()?;
        check_tensors(&self.tensors, &self.header.architecture.tensors())
    }

    /// Weights of an untrained network, for tests and benchmarks.
    ///
    /// The same seed gives the same weights on every machine. Weights are He-scaled and normal,
    /// biases are small. The scale of pixels and of the correlation's sums is divided out, so that
    /// activations stay near 1 and the head's outputs are moderate.
    ///
    /// Expects an architecture that passed [`Architecture::check`].
    pub fn random(architecture: Architecture, seed: u64) -> Weights {
        let mut random = SplitMix64(seed);
        let mut weights = Weights::new(Header::new(architecture));
        weights.header.provenance.name = format!("random-{seed}");
        let layers = architecture.layers();
        let correlation = layers
            .iter()
            .find(|layer| layer.kind == LayerKind::Correlation);
        let summands = correlation.map_or(1, |layer| layer.kernel * layer.kernel);
        for layer in layers.iter().filter(|layer| layer.kind == LayerKind::Conv) {
            let input_rms = match layer.name.as_str() {
                "backbone.conv1" => 128.0,
                "head.cls1" | "head.reg1" => summands as f64,
                _ => 1.0,
            };
            let gain = if layer.relu { 2.0 } else { 1.0 };
            let fan_in = (layer.in_channels * layer.kernel * layer.kernel) as f64;
            let scale = (gain / fan_in).sqrt() / input_rms;
            let shape = layer.weight_shape().to_vec();
            let elements = shape.iter().product();
            let data = (0..elements)
                .map(|_| (random.normal() * scale) as f32)
                .collect();
            weights.insert(format!("{}.weight", layer.name), Tensor { shape, data });
            let data = (0..layer.out_channels)
                .map(|_| (random.normal() * 0.05) as f32)
                .collect();
            weights.insert(
                format!("{}.bias", layer.name),
                Tensor {
                    shape: vec![layer.out_channels],
                    data,
                },
            );
        }
        weights
    }
}

/// Checks that `tensors` are exactly the `expected` ones, by name and shape, with finite values.
pub(crate) fn check_tensors(
    tensors: &BTreeMap<String, Tensor>,
    expected: &[(String, Vec<usize>)],
) -> Result<(), ReadError> {
    for (name, shape) in expected {
        let shaped = || format!("shape {shape:?}");
        let Some(tensor) = tensors.get(name) else {
            return Err(ReadError::tensor(name, shaped(), "no such tensor"));
        };
        if tensor.shape != *shape {
            let found = format!("shape {:?}", tensor.shape);
            return Err(ReadError::tensor(name, shaped(), found));
        }
        let elements: usize = shape.iter().product();
        if tensor.data.len() != elements {
            let expected = format!("{elements} values");
            return Err(ReadError::tensor(name, expected, tensor.data.len()));
        }
        let mut values = tensor.data.iter().enumerate();
        if let Some((i, value)) = values.find(|(_, value)| !value.is_finite()) {
            let found = format!("{value} at element {i}");
            return Err(ReadError::tensor(name, "finite values", found));
        }
    }
    let is_expected = |name: &String| expected.iter().any(|(known, _)| known == name);
    match tensors.keys().find(|name| !is_expected(name)) {
        Some(name) => Err(ReadError::tensor(name, "no tensor of this name", "one")),
        None => Ok(()),
    }
}

/// Sebastiano Vigna's SplitMix64.
struct SplitMix64(u64);

impl SplitMix64 {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A normal value of mean 0 and variance 1: the sum of twelve 16-bit uniforms.
    ///
    /// Unlike `ln` or `cos`, sums of integers are the same on every platform.
    fn normal(&mut self) -> f64 {
        let quarters = |bits: u64| {
            [
                bits & 0xffff,
                bits >> 16 & 0xffff,
                bits >> 32 & 0xffff,
                bits >> 48,
            ]
        };
        let sum: u64 = (0..3).flat_map(|_| quarters(self.next())).sum();
        sum as f64 / 65535.0 - 6.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::architecture::{Encoder, Widths};

    fn small() -> Weights {
        Weights::random(
            Architecture::new(Widths::pruned(0.9), Some(Encoder::standard(25))),
            7,
        )
    }

    #[test]
    fn random_weights_are_complete_and_depend_on_the_seed_alone() {
        let weights = small();
        weights.check().unwrap();
        assert_eq!(weights, small());
        let other = Weights::random(weights.header.architecture, 8);
        assert_ne!(
            weights.tensor("head.offsets.weight"),
            other.tensor("head.offsets.weight")
        );
        assert_eq!(weights.header.pruning_ratio, Some(0.9));
    }

    #[test]
    fn random_weights_are_normal_and_he_scaled() {
        let weights = Weights::random(Architecture::new(Widths::pruned(0.5), None), 3);
        for (name, variance) in [
            (
                "backbone.conv1.weight",
                2.0 / (121.0 * 3.0) / (128.0 * 128.0),
            ),
            ("backbone.conv2.weight", 2.0 / (25.0 * 48.0)),
            ("backbone.conv5.weight", 1.0 / (9.0 * 192.0)),
            ("head.cls1.weight", 2.0 / (9.0 * 128.0) / 256.0),
            ("head.reg1.weight", 2.0 / (9.0 * 128.0) / 256.0),
            ("head.reg2.weight", 2.0 / (9.0 * 128.0)),
        ] {
            let data = &weights.tensor(name).unwrap().data;
            let n = data.len() as f64;
            let sigma = f64::sqrt(variance);
            let moment = |power| {
                data.iter()
                    .map(|&x| (f64::from(x) / sigma).powi(power))
                    .sum::<f64>()
                    / n
            };
            assert!(
                moment(1).abs() < 4.0 / n.sqrt(),
                "{name}: mean {}",
                moment(1)
            );
            assert!(
                (moment(2) - 1.0).abs() < 6.0 / n.sqrt(),
                "{name}: variance {}",
                moment(2)
            );
            assert!(
                (moment(4) - 2.9).abs() < 0.3,
                "{name}: fourth moment {}",
                moment(4)
            );
        }
    }

    #[test]
    fn check_of_invalid_weights_names_the_tensor_or_field() {
        let refused = |f: &dyn Fn(&mut Weights)| {
            let mut weights = small();
            f(&mut weights);
            weights.check().unwrap_err().to_string()
        };
        let tensor = |w: &Weights, name: &str| w.tensor(name).unwrap().clone();
        for (message, expected) in [
            (
                refused(&|w| drop(w.tensors.remove("dr.e2.0.bias"))),
                "\"dr.e2.0.bias\": expected shape [25], found no such",
            ),
            (
                refused(&|w| w.insert("x", tensor(w, "head.score.bias"))),
                "\"x\": expected no tensor of this name",
            ),
            (
                refused(&|w| w.insert("head.score.bias", tensor(w, "head.offsets.bias"))),
                "\"head.score.bias\": expected shape [1], found shape [4]",
            ),
            (
                refused(&|w| {
                    w.tensors
                        .get_mut("head.offsets.bias")
                        .unwrap()
                        .data
                        .truncate(3)
                }),
                "\"head.offsets.bias\": expected 4 values, found 3",
            ),
            (
                refused(&|w| w.tensors.get_mut("head.offsets.bias").unwrap().data[2] = f32::NAN),
                "\"head.offsets.bias\": expected finite values, found NaN at element 2",
            ),
            (
                refused(&|w| w.header.architecture.widths.neck_cls = 0),
                "widths[5] is 0",
            ),
            (
                refused(&|w| w.header.tracker.size_lr = f64::NAN),
                "tracker.size_lr",
            ),
        ] {
            assert!(
                message.contains(expected),
                "{message:?} does not say {expected:?}"
            );
        }
    }
}
