//! A network before folding: batch normalization and the head's two scalars are tensors of their
//! own.
//!
//! PyTorch and the trainer exchange this file; the tracker never reads it. It is a safetensors
//! container of f32 tensors named `parameter.<name>`. Its only metadata key is `parameters`: an
//! object of `format` (1), `architecture`, `input` and `source`.
//!
//! The trainer's checkpoints can be read as well. They hold the same tensors beside others, and the
//! architecture under the key `trainer`.

use crate::{
    architecture::{Architecture, LayerKind},
    container,
    error::{ReadError, WriteError},
    file,
    header::InputNormalization,
    weights::{Tensor, check_tensors},
};
use safetensors::tensor::{Metadata, TensorView};
use safetensors::{Dtype, SafeTensors};
use serde::{Deserialize, Serialize};
use std::{
    collections::{BTreeMap, HashMap},
    path::Path,
};

/// Largest file accepted: the unpruned network, the optimizer's state and the networks of training.
const MAX_BYTES: u64 = 1 << 30;
/// The only version of the format that this crate reads and writes.
const FORMAT: u32 = 1;
/// The key of the container's metadata that describes the network.
const KEY: &str = "parameters";
/// The key of the same description in a checkpoint of the trainer.
const TRAINER: &str = "trainer";

/// The trained parameters of a network.
///
/// Every convolution `<name>` has `<name>.weight` (`[Cout, kh, kw, Cin]`) and `<name>.bias`
/// (`[Cout]`). One with batch normalization also has `<name>.bn.scale`, `.bn.shift`, `.bn.mean` and
/// `.bn.variance` (`[Cout]`). The scalars `head.si` and `head.bi` (`[]`) give the distances
/// `exp(si o + bi) * 8`.
#[derive(Clone, Debug, PartialEq)]
pub struct Unfolded {
    /// Determines every tensor's name and shape.
    pub architecture: Architecture,
    /// Normalization of the input pixels.
    pub input: InputNormalization,
    /// Origin of the parameters; free text.
    pub source: String,
    /// Every tensor by name.
    pub tensors: BTreeMap<String, Tensor>,
}

/// What the metadata say of a network.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Described {
    format: u32,
    architecture: Architecture,
    input: InputNormalization,
    source: String,
}

/// The part of a trainer's checkpoint that names the architecture.
#[derive(Deserialize)]
struct Checkpoint {
    options: Options,
}

#[derive(Deserialize)]
struct Options {
    architecture: Architecture,
}

impl Described {
    /// Reads the description from a container's metadata: that of a file of parameters, or that of
    /// a checkpoint of the trainer.
    fn read(metadata: &Metadata) -> Result<Described, ReadError> {
        let expected = "the description of a network";
        let wrong = |key: &str, error| ReadError::metadata(key, expected, error);
        let entries = metadata.metadata().as_ref();
        let entry = |key: &str| entries.and_then(|entries| entries.get(key));
        if let Some(text) = entry(KEY) {
            let described: Described =
                serde_json::from_str(text).map_err(|error| wrong(KEY, error))?;
            if described.format != FORMAT {
                return Err(ReadError::metadata("format", FORMAT, described.format));
            }
            return Ok(described);
        }
        let Some(text) = entry(TRAINER) else {
            return Err(ReadError::metadata(KEY, expected, "no such key"));
        };
        let Checkpoint { options } =
            serde_json::from_str(text).map_err(|error| wrong(TRAINER, error))?;
        Ok(Described {
            format: FORMAT,
            architecture: options.architecture,
            input: InputNormalization::TRAINED,
            source: "a checkpoint of the track-cpu trainer".into(),
        })
    }
}

impl Unfolded {
    /// Name and shape of every tensor of a network.
    ///
    /// Expects an architecture that passed [`Architecture::check`].
    pub fn shapes(architecture: &Architecture) -> Vec<(String, Vec<usize>)> {
        let mut shapes = Vec::new();
        for layer in architecture
            .layers()
            .iter()
            .filter(|layer| layer.kind == LayerKind::Conv)
        {
            let name = &layer.name;
            shapes.push((format!("{name}.weight"), layer.weight_shape().to_vec()));
            shapes.push((format!("{name}.bias"), vec![layer.out_channels]));
            if layer.bn {
                let parts = ["scale", "shift", "mean", "variance"];
                shapes.extend(
                    parts.map(|part| (format!("{name}.bn.{part}"), vec![layer.out_channels])),
                );
            }
        }
        shapes.extend(["head.si", "head.bi"].map(|name| (name.to_owned(), Vec::new())));
        shapes
    }

    /// Reads a file of parameters, or the deployed parameters of a trainer's checkpoint.
    ///
    /// # Errors
    /// Names the file and the wrong field or tensor.
    pub fn read(path: &Path) -> Result<Unfolded, ReadError> {
        let name = |error| ReadError::File {
            path: path.into(),
            error: Box::new(error),
        };
        let bytes = file::read_bounded(path, MAX_BYTES).map_err(name)?;
        Unfolded::from_bytes(&bytes).map_err(name)
    }

    /// Reads the bytes of a file as [`read`](Self::read) does.
    ///
    /// # Errors
    /// Names the wrong field or tensor.
    pub fn from_bytes(bytes: &[u8]) -> Result<Unfolded, ReadError> {
        let malformed = |error| ReadError::container("container", "a safetensors file", error);
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(malformed)?;
        let Described {
            architecture,
            input,
            source,
            ..
        } = Described::read(&metadata)?;
        architecture.check()?;
        input.check()?;
        let file = SafeTensors::deserialize(bytes).map_err(malformed)?;
        let mut tensors = BTreeMap::new();
        for (name, shape) in Unfolded::shapes(&architecture) {
            let expected = || format!("F32 with shape {shape:?}");
            // A training with running averages deploys those.
            let names = [format!("average.{name}"), format!("parameter.{name}")];
            let Some(view) = names.iter().find_map(|name| file.tensor(name).ok()) else {
                return Err(ReadError::tensor(&names[1], expected(), "no such tensor"));
            };
            if (view.dtype(), view.shape()) != (Dtype::F32, &shape[..]) {
                let found = format!("{:?} with shape {:?}", view.dtype(), view.shape());
                return Err(ReadError::tensor(&name, expected(), found));
            }
            let data = container::decode(view.data(), Dtype::F32);
            tensors.insert(name, Tensor { shape, data });
        }
        let unfolded = Unfolded {
            architecture,
            input,
            source,
            tensors,
        };
        unfolded.check()?;
        Ok(unfolded)
    }

    /// Checks that there are exactly the tensors of the architecture, with finite values.
    ///
    /// # Errors
    /// Names the first field or tensor that is wrong.
    pub fn check(&self) -> Result<(), ReadError> {
        self.architecture.check()?;
        self.input.check()?;
        check_tensors(&self.tensors, &Unfolded::shapes(&self.architecture))?;
        for (name, tensor) in &self.tensors {
            let negative = tensor.data.iter().find(|value| **value < 0.0);
            if let Some(value) = negative.filter(|_| name.ends_with(".bn.variance")) {
                return Err(ReadError::tensor(name, "no negative variance", value));
            }
        }
        Ok(())
    }

    /// Writes a file atomically.
    ///
    /// # Errors
    /// Those of [`check`](Self::check) and those of the file system.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        self.check()?;
        let Unfolded {
            architecture,
            input,
            source,
            ..
        } = self.clone();
        let described = Described {
            format: FORMAT,
            architecture,
            input,
            source,
        };
        let text = serde_json::to_string(&described)
            .map_err(|error| ReadError::metadata(KEY, "values that can be written", error))?;
        let bytes: Vec<Vec<u8>> = self
            .tensors
            .values()
            .map(|tensor| {
                tensor
                    .data
                    .iter()
                    .flat_map(|value| value.to_le_bytes())
                    .collect()
            })
            .collect();
        let refused = |error| ReadError::container("container", "a safetensors file", error);
        let views: Vec<_> = self
            .tensors
            .iter()
            .zip(&bytes)
            .map(|((name, tensor), bytes)| {
                let view =
                    TensorView::new(Dtype::F32, tensor.shape.clone(), bytes).map_err(refused)?;
                Ok((format!("parameter.{name}"), view))
            })
            .collect::<Result<_, ReadError>>()?;
        let metadata = HashMap::from([(KEY.to_owned(), text)]);
        let bytes = safetensors::serialize(views, Some(metadata)).map_err(refused)?;
        file::write_atomically(path, &bytes).map_err(|error| WriteError::Io {
            path: path.into(),
            error,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::architecture::{Encoder, Widths};

    fn example() -> Unfolded {
        let widths = Widths::uniform([2, 3, 4, 3, 2], 3);
        let architecture = Architecture::new(widths, Some(Encoder::standard(2)));
        let tensor = |i: usize, shape: Vec<usize>| {
            let data = (0..shape.iter().product::<usize>())
                .map(|j| (i * 7 + j) as f32 / 3.0)
                .collect();
            Tensor { shape, data }
        };
        let shapes = Unfolded::shapes(&architecture).into_iter().enumerate();
        Unfolded {
            architecture,
            input: InputNormalization::default(),
            source: "a test".into(),
            tensors: shapes
                .map(|(i, (name, shape))| (name, tensor(i, shape)))
                .collect(),
        }
    }

    #[test]
    fn parameters_survive_the_roundtrip_bit_by_bit() {
        let folder = testing::Folder::new("unfolded");
        let path = folder.join("unfolded.safetensors");
        let written = example();

        written.write(&path).unwrap();

        assert_eq!(Unfolded::read(&path).unwrap(), written);
    }

    #[test]
    fn invalid_parameters_are_named_in_the_error() {
        let refused = |change: &dyn Fn(&mut Unfolded)| {
            let mut unfolded = example();
            change(&mut unfolded);
            unfolded.check().unwrap_err().to_string()
        };
        assert!(refused(&|u| _ = u.tensors.remove("head.si")).contains("\"head.si\""));
        assert!(
            refused(&|u| u.tensors.get_mut("head.bi").unwrap().data[0] = f32::NAN).contains("NaN")
        );
        assert!(
            refused(&|u| u.tensors.get_mut("dr.e2.0.bn.variance").unwrap().data[0] = -1.0)
                .contains("negative")
        );
        assert!(
            refused(&|u| u.architecture.widths.neck_cls = 4).contains("neck.template_cls.weight")
        );
        assert!(refused(&|u| u.input.std[0] = 0.0).contains("input.std"));
        let extra = Tensor {
            shape: vec![],
            data: vec![0.0],
        };
        assert!(
            refused(&|u| _ = u.tensors.insert("more".into(), extra.clone())).contains("\"more\"")
        );
        let weights = crate::Weights::random(example().architecture, 1)
            .to_bytes()
            .unwrap();
        assert!(
            Unfolded::from_bytes(&weights)
                .unwrap_err()
                .to_string()
                .contains("no such key")
        );
        assert!(Unfolded::from_bytes(&weights[..99]).is_err());
    }
}
