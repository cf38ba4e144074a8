//! A model: weights, checked against their architecture and laid out for the kernels.

use crate::config::TrackConfig;
use crate::error::ModelError;
use crate::net::backbone::Backbone;
use crate::net::dr::Dr;
use crate::net::head::Head;
use crate::net::neck::Neck;
use kernels::conv::{Algorithm, Conv, ConvShape};
use kernels::quant::Quantization;
use kernels::{Isa, Size};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;
use weights_format::{
    Architecture, Header, InputNormalization, Layer, LayerKind, ReadError, Weights,
};

/// A model that trackers share: cloning it is cheap.
#[derive(Clone, Debug)]
pub struct Model {
    inner: Arc<Inner>,
}

#[derive(Debug)]
struct Inner {
    header: Header,
    isa: Isa,
    precision: Precision,
    layers: Layers,
    plan: Vec<LayerPlan>,
}

/// The arithmetic of the convolutions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Single precision throughout.
    F32,
    /// Integers with exact sums where the weights file's calibration allows it: bytes, or 16 bits
    /// where Winograd's algorithm is faster with them. Single precision elsewhere.
    Int8,
}

impl Precision {
    /// The faster precision: integers if the weights are calibrated and `isa` multiplies integers
    /// faster than `f32`.
    pub fn best(weights: &Weights, isa: Isa) -> Precision {
        if weights.header.calibration.is_some() && isa.has_fast_integers() {
            Precision::Int8
        } else {
            Precision::F32
        }
    }

    /// The precision with this [`name`](Self::name).
    pub fn from_name(name: &str) -> Option<Precision> {
        [Precision::F32, Precision::Int8]
            .into_iter()
            .find(|precision| precision.name() == name)
    }

    /// Name in reports and options.
    pub fn name(self) -> &'static str {
        match self {
            Precision::F32 => "f32",
            Precision::Int8 => "int8",
        }
    }
}

/// The network's convolutions, ready to run.
#[derive(Debug)]
pub(crate) struct Layers {
    pub backbone: Backbone,
    pub encoder: Dr,
    pub neck: Neck,
    pub head: Head,
}

/// The way one layer runs.
#[derive(Clone, Debug)]
pub struct LayerPlan {
    /// The layer and its shapes.
    pub layer: Layer,
    /// The algorithm of a convolution; `None` for the others.
    pub algorithm: Option<Algorithm>,
    /// Quantization of a convolution's input; `None` where it stays in `f32`.
    pub input: Option<Quantization>,
}

/// The built-in models; the first is the standard one.
static BUILTIN: [(&str, &[u8]); 2] = [
    ("drmim-p50", include_bytes!("builtin/drmim-p50.safetensors")),
    ("drmim-p75", include_bytes!("builtin/drmim-p75.safetensors")),
];

/// Names of models that were built in once, and the model that takes their place for one release.
const RETIRED: [(&str, &str); 1] = [("drmim-p82", "drmim-p75")];

/// Whether a file begins as PyTorch's checkpoints do: as a zip archive or as a pickle.
fn is_checkpoint(path: &Path) -> bool {
    let mut start = [0; 4];
    let read = File::open(path).and_then(|mut file| file.read_exact(&mut start));
    read.is_ok() && (&start == b"PK\x03\x04" || matches!(start, [0x80, 2..=5, ..]))
}

/// Whether a file was refused because its metadata are those of a training checkpoint.
fn is_of_trainer(error: &ReadError) -> bool {
    match error {
        ReadError::File { error, .. } => is_of_trainer(error),
        ReadError::Metadata { field, .. } => field == "trainer",
        _ => false,
    }
}

impl Model {
    /// The standard built-in model: DR-MIM at the paper's pruning ratio.
    pub fn builtin(isa: Isa) -> Model {
        Model::from_weights(&Model::builtin_weights(), isa)
            .expect("the built-in weights fit their architecture")
    }

    /// The weights of the [standard model](Self::builtin).
    pub fn builtin_weights() -> Weights {
        Weights::from_bytes(BUILTIN[0].1).expect("the built-in model is a valid weights file")
    }

    /// Names of the built-in models, the standard one first.
    pub fn builtin_names() -> impl Iterator<Item = &'static str> {
        BUILTIN.iter().map(|(name, _)| *name)
    }

    /// The built-in model that takes the place of one that is no longer built in.
    pub fn successor(name: &Path) -> Option<&'static str> {
        let retired = RETIRED.iter().find(|(old, _)| name == Path::new(old));
        retired.filter(|_| !name.exists()).map(|(_, new)| *new)
    }

    /// The weights that a user asks for: the built-in model of that name or its
    /// [successor](Self::successor), or else a file. Without a name, the standard model.
    ///
    /// # Errors
    /// As [`read`](Self::read). A checkpoint, of PyTorch or of `train`, and an unknown name are
    /// errors of their own.
    pub fn find(model: Option<&Path>) -> Result<Weights, ModelError> {
        let Some(path) = model else {
            return Ok(Model::builtin_weights());
        };
        let path = Model::successor(path).map_or(path, Path::new);
        if let Some((_, bytes)) = BUILTIN.iter().find(|(name, _)| path == Path::new(name)) {
            return Ok(Weights::from_bytes(bytes)?);
        }
        Weights::read(path).map_err(|error| {
            let is_name = path.components().count() == 1 && path.extension().is_none();
            if is_checkpoint(path) {
                ModelError::Checkpoint { path: path.into() }
            } else if is_of_trainer(&error) {
                ModelError::Training { path: path.into() }
            } else if is_name && !path.exists() {
                ModelError::UnknownName {
                    name: weights_format::brief(path.display()),
                    known: Model::builtin_names().collect::<Vec<_>>().join(", "),
                }
            } else {
                error.into()
            }
        })
    }

    /// Reads a weights file.
    ///
    /// # Errors
    /// If the file cannot be read or is not a valid weights file. The message names the file and
    /// the tensor or field.
    pub fn read(path: &Path, isa: Isa) -> Result<Model, ModelError> {
        Model::from_weights(&Weights::read(path)?, isa)
    }

    /// Reads a weights file from memory.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    pub fn from_bytes(bytes: &[u8], isa: Isa) -> Result<Model, ModelError> {
        Model::from_weights(&Weights::from_bytes(bytes)?, isa)
    }

    /// Lays out weights for `isa` in the [best](Precision::best) precision, each layer for its
    /// fastest algorithm.
    ///
    /// # Errors
    /// If the weights do not fit their own architecture.
    pub fn from_weights(weights: &Weights, isa: Isa) -> Result<Model, ModelError> {
        Model::with_precision(weights, isa, Precision::best(weights, isa))
    }

    /// Lays out weights for `isa` in `precision`.
    ///
    /// # Errors
    /// If the weights do not fit their own architecture, or `int8` is asked of weights without a
    /// calibration.
    pub fn with_precision(
        weights: &Weights,
        isa: Isa,
        precision: Precision,
    ) -> Result<Model, ModelError> {
        if precision == Precision::Int8 && weights.header.calibration.is_none() {
            return Err(ModelError::NoCalibration {
                name: weights.header.provenance.name.clone(),
            });
        }
        Model::build(weights, isa, precision, None)
    }

    /// Lays out weights for `isa` in `f32`, every layer with `algorithm` where it is supported.
    ///
    /// # Errors
    /// If the weights do not fit their own architecture.
    pub fn with_algorithm(
        weights: &Weights,
        isa: Isa,
        algorithm: Algorithm,
    ) -> Result<Model, ModelError> {
        Model::build(weights, isa, Precision::F32, Some(algorithm))
    }

    fn build(
        weights: &Weights,
        isa: Isa,
        precision: Precision,
        algorithm: Option<Algorithm>,
    ) -> Result<Model, ModelError> {
        weights.check()?;
        let header = weights.header.clone();
        let builder = Builder {
            weights,
            isa,
            precision,
            algorithm,
            specs: header.architecture.layers(),
        };
        let (layers, plan) = (builder.layers(), builder.plan());
        Ok(Model {
            inner: Arc::new(Inner {
                header,
                isa,
                precision,
                layers,
                plan,
            }),
        })
    }

    /// The weights file's header.
    pub fn header(&self) -> &Header {
        &self.inner.header
    }

    /// Widths, encoder and crop sizes.
    pub fn architecture(&self) -> &Architecture {
        &self.inner.header.architecture
    }

    /// The instruction set that the weights are laid out for.
    pub fn isa(&self) -> Isa {
        self.inner.isa
    }

    /// The arithmetic of its convolutions.
    pub fn precision(&self) -> Precision {
        self.inner.precision
    }

    /// The model's own hyper-parameters of the tracker.
    pub fn config(&self) -> TrackConfig {
        TrackConfig::from(&self.inner.header.tracker)
    }

    /// Every layer in execution order with its algorithm.
    pub fn plan(&self) -> Vec<LayerPlan> {
        self.inner.plan.clone()
    }

    pub(crate) fn layers(&self) -> &Layers {
        &self.inner.layers
    }
}

/// Lays out each layer's weights; expects weights that passed their check.
struct Builder<'a> {
    weights: &'a Weights,
    isa: Isa,
    precision: Precision,
    algorithm: Option<Algorithm>, // `None`: the best for each layer
    specs: Vec<Layer>,
}

impl Builder<'_> {
    fn layers(&self) -> Layers {
        let encoder = self.weights.header.architecture.encoder;
        Layers {
            backbone: Backbone {
                conv1: self.first_conv(),
                conv2: self.conv("backbone.conv2"),
                conv3: self.conv("backbone.conv3"),
                conv4: self.conv("backbone.conv4"),
                conv5: self.conv("backbone.conv5"),
            },
            encoder: Dr {
                conv: encoder.map(|_| self.conv("dr.e2.0")),
            },
            neck: Neck {
                template_cls: self.conv("neck.template_cls"),
                template_reg: self.conv("neck.template_reg"),
                search_cls: self.conv("neck.search_cls"),
                search_reg: self.conv("neck.search_reg"),
            },
            head: Head {
                cls: ["head.cls1", "head.cls2", "head.cls3"].map(|name| self.conv(name)),
                reg: ["head.reg1", "head.reg2", "head.reg3"].map(|name| self.conv(name)),
                score: self.conv("head.score"),
                centerness: self.conv("head.centerness"),
                offsets: self.conv("head.offsets"),
            },
        }
    }

    fn conv(&self, name: &str) -> Conv {
        let (layer, weight, bias) = self.parts(name);
        Conv::new(
            self.isa,
            self.algorithm(layer),
            conv_shape(layer),
            weight,
            bias,
        )
    }

    /// conv1 with the input normalization folded in, which is exact because conv1 has no padding.
    fn first_conv(&self) -> Conv {
        let (layer, weight, bias) = self.parts("backbone.conv1");
        let (weight, bias) = fold_normalization(&self.weights.header.input, weight, bias);
        Conv::new(
            self.isa,
            self.algorithm(layer),
            conv_shape(layer),
            &weight,
            &bias,
        )
    }

    /// The algorithm of a convolution, chosen for the larger of its input maps.
    fn algorithm(&self, layer: &Layer) -> Algorithm {
        let shape = conv_shape(layer);
        let out = layer.out_search.max(layer.out_template);
        let size = Size::square((out - 1) * shape.stride + shape.kernel - 2 * shape.pad);
        if let Some(quantization) = self.quantization(layer) {
            return Algorithm::plan_integers(self.isa, &shape, size, quantization);
        }
        match self.algorithm {
            Some(asked) => asked.supported(&shape),
            None => Algorithm::plan(&shape, size),
        }
    }

    /// Quantization of a convolution's input; `None` where it stays in `f32`.
    fn quantization(&self, layer: &Layer) -> Option<Quantization> {
        let calibration = self.weights.header.calibration.as_ref()?;
        if self.precision == Precision::F32 {
            return None;
        }
        if layer.name == "backbone.conv1" {
            return Some(Quantization::PIXELS);
        }
        let range = calibration.inputs.get(&layer.name)?;
        Some(Quantization::of_range(range.low, range.high))
    }

    fn plan(&self) -> Vec<LayerPlan> {
        let algorithm =
            |layer: &Layer| (layer.kind == LayerKind::Conv).then(|| self.algorithm(layer));
        let plan = |layer: &Layer| LayerPlan {
            layer: layer.clone(),
            algorithm: algorithm(layer),
            input: self.quantization(layer),
        };
        self.specs.iter().map(plan).collect()
    }

    fn parts(&self, name: &str) -> (&Layer, &[f32], &[f32]) {
        let layer = self
            .specs
            .iter()
            .find(|s| s.name == name)
            .expect("every architecture has this layer");
        let tensor = |suffix: &str| {
            let tensor = self.weights.tensor(&format!("{name}.{suffix}"));
            &tensor.expect("checked weights have every tensor").data[..]
        };
        (layer, tensor("weight"), tensor("bias"))
    }
}

/// The kernels' description of a convolution of the network.
pub fn conv_shape(layer: &Layer) -> ConvShape {
    ConvShape {
        in_channels: layer.in_channels,
        out_channels: layer.out_channels,
        kernel: layer.kernel,
        stride: layer.stride,
        pad: layer.pad,
        relu: layer.relu,
    }
}

/// Weights and bias that compute on pixels what `weight` (`[Cout, k, k, 3]`) and `bias` (`[Cout]`)
/// compute on `(pixel - mean) / std`.
fn fold_normalization(
    input: &InputNormalization,
    weight: &[f32],
    bias: &[f32],
) -> (Vec<f32>, Vec<f32>) {
    // w (p - mean) / std = (w / std) p - w mean / std, per channel of each kernel cell.
    let mut folded = weight.to_vec();
    let mut shifted = bias.to_vec();
    for (weights, bias) in folded
        .chunks_exact_mut(weight.len() / bias.len())
        .zip(&mut shifted)
    {
        let mut shift = 0.0;
        for pixel in weights.chunks_exact_mut(3) {
            for (channel, weight) in pixel.iter_mut().enumerate() {
                let scaled = f64::from(*weight) / f64::from(input.std[channel]);
                shift += scaled * f64::from(input.mean[channel]);
                *weight = scaled as f32;
            }
        }
        *bias = (f64::from(*bias) - shift) as f32;
    }
    (folded, shifted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn convolution_with_folded_normalization_gives_the_same_outputs() {
        let input = InputNormalization {
            mean: [114.0, 10.0, 0.0],
            std: [58.0, 2.0, 1.0],
            ..Default::default()
        };
        let weight = [0.5, -1.0, 2.0, 0.25, 3.0, -0.125]; // one output, a 1x2 kernel
        let (folded, bias) = fold_normalization(&input, &weight, &[0.75]);
        let pixels = [200.0, 3.0, 255.0, 17.0, 90.0, 1.0];
        let dot = |w: &[f32], x: &dyn Fn(usize) -> f64| -> f64 {
            (0..6).map(|i| f64::from(w[i]) * x(i)).sum()
        };
        let normalized =
            |i: usize| (pixels[i] - f64::from(input.mean[i % 3])) / f64::from(input.std[i % 3]);
        let expected = 0.75 + dot(&weight, &normalized);
        let found = f64::from(bias[0]) + dot(&folded, &|i| pixels[i]);
        assert!(
            (found - expected).abs() < 1e-4,
            "{found}, expected {expected}"
        );
    }
}
