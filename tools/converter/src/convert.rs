//! From a checkpoint to weights.

use crate::{
    architecture::{convolutions, infer, parameters},
    checkpoint::{self, Checkpoint},
    error::{Error, Refusal, brief},
    fold::{BatchNorm, Convolution},
    names::{self, EncoderNames, Role},
};
use std::{
    collections::BTreeSet,
    fs::File,
    io::{self, Read},
    path::Path,
};
use weights_format::{
    Architecture, Header, InputNormalization, Layer, Provenance, Storage, Tensor, Unfolded, Weights,
};

/// Choices that the checkpoint does not determine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Options {
    /// Name of the model; that of the file where `None`.
    pub name: Option<String>,
    /// Type of the weights in the file.
    pub storage: Storage,
    /// Whether a ReLU follows the encoder's convolutions.
    pub encoder_relu: bool,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            name: None,
            storage: Storage::F32,
            encoder_relu: true,
        }
    }
}

/// A converted checkpoint.
#[derive(Clone, Debug)]
pub struct Conversion {
    /// The deployed network, complete and checked.
    pub weights: Weights,
    /// Tensors that only training needs, and everything beside the state dict.
    pub ignored: Vec<String>,
    /// Tensors that belong to no known network.
    pub unknown: Vec<String>,
}

/// A converted checkpoint without folding.
#[derive(Clone, Debug)]
pub struct Unfolding {
    /// The network as it is trained, complete and checked.
    pub unfolded: Unfolded,
    /// Tensors that only training needs, and everything beside the state dict.
    pub ignored: Vec<String>,
    /// Tensors that belong to no known network.
    pub unknown: Vec<String>,
}

/// Converts the checkpoint at `path`.
///
/// # Errors
/// [`Error::Unreadable`] or [`Error::Refused`], with the path.
pub fn convert(path: &Path, options: &Options) -> Result<Conversion, Error> {
    let bytes = read_file(path)?;
    let stem = || brief(path.file_stem().unwrap_or_default().to_string_lossy());
    let options = Options {
        name: Some(options.name.clone().unwrap_or_else(stem)),
        ..options.clone()
    };
    let mut conversion = convert_bytes(&bytes, &options).map_err(refused(path))?;
    conversion.weights.header.provenance.source = source(path);
    Ok(conversion)
}

/// Converts a checkpoint in memory.
///
/// # Errors
/// Says which part of the file, which byte of the pickle or which tensor is wrong, what was
/// expected there and what was found.
pub fn convert_bytes(bytes: &[u8], options: &Options) -> Result<Conversion, Refusal> {
    let Opened {
        mut checkpoint,
        encoder,
        architecture,
    } = open(bytes, options)?;
    let mut weights = Weights::new(Header {
        storage: options.storage,
        provenance: Provenance {
            name: options.name.clone().unwrap_or_default(),
            source: "PyTorch checkpoint".into(),
            notes: [("converter".into(), env!("CARGO_PKG_VERSION").into())].into(),
        },
        ..Header::new(architecture)
    });
    let layers = convolutions(&architecture);
    for layer in &layers {
        let folded = fold(&mut checkpoint, layer, encoder)?;
        let weight = Tensor {
            shape: layer.weight_shape().to_vec(),
            data: folded.weight_ohwi(),
        };
        let bias = Tensor {
            shape: vec![layer.out_channels],
            data: folded.bias.iter().map(|&bias| bias as f32).collect(),
        };
        weights.insert(format!("{}.weight", layer.name), weight);
        weights.insert(format!("{}.bias", layer.name), bias);
    }
    let (ignored, unknown) = rest(&checkpoint, &layers, encoder)?;
    weights
        .check()
        .map_err(|error| Refusal::new("converted weights", "values that fit f32", error))?;
    Ok(Conversion {
        weights,
        ignored,
        unknown,
    })
}

/// The checkpoint at `path` as the trainer takes it: values as they are, batch normalization apart.
///
/// # Errors
/// [`Error::Unreadable`] or [`Error::Refused`], with the path.
pub fn unfold(path: &Path, options: &Options) -> Result<Unfolding, Error> {
    let bytes = read_file(path)?;
    let mut unfolding = unfold_bytes(&bytes, options).map_err(refused(path))?;
    unfolding.unfolded.source = source(path);
    Ok(unfolding)
}

/// As [`unfold`], from memory.
///
/// # Errors
/// As [`convert_bytes`].
pub fn unfold_bytes(bytes: &[u8], options: &Options) -> Result<Unfolding, Refusal> {
    let Opened {
        mut checkpoint,
        encoder,
        architecture,
    } = open(bytes, options)?;
    let layers = convolutions(&architecture);
    let mut unfolded = Unfolded {
        architecture,
        input: InputNormalization::default(),
        source: "PyTorch checkpoint".into(),
        tensors: Default::default(),
    };
    let mut insert = |name: String, shape: Vec<usize>, values: Vec<f64>| {
        let data = values.into_iter().map(|value| value as f32).collect();
        unfolded.tensors.insert(name, Tensor { shape, data });
    };
    for layer in &layers {
        let outputs = [layer.out_channels];
        let shape = [
            layer.out_channels,
            layer.in_channels,
            layer.kernel,
            layer.kernel,
        ];
        let names = parameters(layer, encoder);
        let weight = checkpoint.load(&names[0], &shape)?;
        let ohwi = Convolution {
            shape,
            weight,
            bias: Vec::new(),
        }
        .weight_ohwi();
        let ohwi = ohwi.into_iter().map(f64::from).collect();
        insert(
            format!("{}.weight", layer.name),
            layer.weight_shape().to_vec(),
            ohwi,
        );
        let ours = ["bias"].into_iter().chain(names::OUR_BATCH_NORM);
        for (theirs, ours) in names[1..].iter().zip(ours) {
            let values = checkpoint.load(theirs, &outputs)?;
            insert(format!("{}.{ours}", layer.name), outputs.to_vec(), values);
        }
    }
    for name in names::SCALARS {
        insert(name.to_owned(), Vec::new(), checkpoint.load(name, &[])?);
    }
    let (ignored, unknown) = rest(&checkpoint, &layers, encoder)?;
    unfolded
        .check()
        .map_err(|error| Refusal::new("parameters", "values that can be trained", error))?;
    Ok(Unfolding {
        unfolded,
        ignored,
        unknown,
    })
}

/// A checkpoint and the network that it holds.
struct Opened<'a> {
    checkpoint: Checkpoint<'a>,
    encoder: Option<EncoderNames>,
    architecture: Architecture,
}

fn open<'a>(bytes: &'a [u8], options: &Options) -> Result<Opened<'a>, Refusal> {
    let checkpoint = Checkpoint::from_bytes(bytes)?;
    if let Some(name) = checkpoint
        .names()
        .find(|name| names::role(name) == Role::Gate)
    {
        let expected = "a network without dynamic channel weighting (gates)";
        return Err(Refusal::new(format!("tensor {name:?}"), expected, "a gate"));
    }
    let encoder = EncoderNames::find(|name| checkpoint.shape(name).is_some());
    let architecture = infer(&checkpoint, encoder, options.encoder_relu)?;
    Ok(Opened {
        checkpoint,
        encoder,
        architecture,
    })
}

/// A layer with its batch normalization and the scalars of the head folded in.
fn fold(
    checkpoint: &mut Checkpoint,
    layer: &Layer,
    encoder: Option<EncoderNames>,
) -> Result<Convolution, Refusal> {
    let names = parameters(layer, encoder);
    let outputs = [layer.out_channels];
    let shape = [
        layer.out_channels,
        layer.in_channels,
        layer.kernel,
        layer.kernel,
    ];
    let weight = checkpoint.load(&names[0], &shape)?;
    let bias = checkpoint.load(&names[1], &outputs)?;
    let mut folded = Convolution {
        shape,
        weight,
        bias,
    };
    if let [scale, shift, mean, variance] = &names[2..] {
        let bn = BatchNorm {
            scale: checkpoint.load(scale, &outputs)?,
            shift: checkpoint.load(shift, &outputs)?,
            mean: checkpoint.load(mean, &outputs)?,
            variance: checkpoint.load(variance, &outputs)?,
        };
        if let Some(negative) = bn.variance.iter().find(|&&variance| variance < 0.0) {
            return Err(Refusal::new(
                format!("tensor {variance:?}"),
                "no negative variance",
                negative,
            ));
        }
        folded.fold_batch_norm(&bn);
    }
    if layer.name == "head.offsets" {
        let mut scalars = [0.0; 2];
        for (scalar, name) in scalars.iter_mut().zip(names::SCALARS) {
            *scalar = checkpoint.load(name, &[])?[0];
        }
        folded.fold_affine(scalars[0], scalars[1]);
    }
    Ok(folded)
}

/// What was not converted: ignored and unknown.
///
/// A tensor under a name of the network that has no place in this one is refused: it would change
/// what the network computes.
fn rest(
    checkpoint: &Checkpoint,
    layers: &[Layer],
    encoder: Option<EncoderNames>,
) -> Result<(Vec<String>, Vec<String>), Refusal> {
    let mut used: BTreeSet<String> = names::SCALARS.map(String::from).into();
    for layer in layers {
        used.extend(parameters(layer, encoder));
        if layer.bn {
            used.insert(format!(
                "{}.{}",
                names::prefix(&layer.name, encoder),
                names::COUNTER
            ));
        }
    }
    let (mut ignored, mut unknown) = (checkpoint.others().to_vec(), Vec::new());
    for name in checkpoint.names().filter(|name| !used.contains(*name)) {
        match names::role(name) {
            Role::Training => ignored.push(name.to_owned()),
            Role::Unknown => unknown.push(name.to_owned()),
            Role::Deployed | Role::Gate => {
                let place = format!("tensor {name:?}");
                return Err(Refusal::new(
                    place,
                    "no tensor of this name in this network",
                    "one",
                ));
            }
        }
    }
    Ok((ignored, unknown))
}

/// The bytes of the checkpoint at `path`.
fn read_file(path: &Path) -> Result<Vec<u8>, Error> {
    read(path).map_err(|error| Error::Unreadable {
        path: path.into(),
        error,
    })
}

/// Adds the path to a refusal.
fn refused(path: &Path) -> impl FnOnce(Refusal) -> Error + '_ {
    move |refusal| Error::Refused {
        path: path.into(),
        refusal,
    }
}

/// Where the weights of the checkpoint at `path` come from.
fn source(path: &Path) -> String {
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    format!("PyTorch checkpoint {}", brief(file))
}

/// Reads no more than one byte beyond the bound, whatever a file's metadata say about its length.
pub(crate) fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    File::open(path)?
        .take(checkpoint::MAX_BYTES + 1)
        .read_to_end(&mut bytes)?;
    if bytes.len() as u64 > checkpoint::MAX_BYTES {
        let message = format!("larger than {} bytes", checkpoint::MAX_BYTES);
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, message));
    }
    Ok(bytes)
}
