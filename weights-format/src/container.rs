//! Weights as bytes: a safetensors container with the header under one metadata key.

use crate::{
    error::{ReadError, WriteError},
    header::{Header, Storage},
    weights::{Tensor, Weights},
};
use half::f16;
use safetensors::{Dtype, View, tensor::Metadata};
use std::{borrow::Cow, collections::HashMap};

/// Largest file accepted: more than six times the unpruned network in f32.
pub const MAX_FILE_BYTES: u64 = 256 << 20;
/// Largest JSON header accepted; the unpruned network's header has about 6,000 bytes.
pub const MAX_HEADER_BYTES: u64 = 1 << 20;

/// The key of the container's metadata that holds the [`Header`] as JSON.
const KEY: &str = "track-cpu";

/// The stored type of a tensor; biases and other vectors stay f32.
fn dtype(storage: Storage, shape: &[usize]) -> Dtype {
    match storage {
        Storage::F16 if shape.len() > 1 => Dtype::F16,
        Storage::F16 | Storage::F32 => Dtype::F32,
    }
}

impl Weights {
    /// Reads a weights file from memory and checks all of it.
    ///
    /// # Errors
    /// Names the part of the container, the metadata field or the tensor that is wrong, what was
    /// expected there and what was found.
    pub fn from_bytes(bytes: &[u8]) -> Result<Weights, ReadError> {
        let (metadata, data) = split(bytes)?;
        let mut json = None;
        for (key, value) in metadata.metadata().iter().flatten() {
            if key != KEY {
                return Err(ReadError::metadata(
                    key,
                    format!("no key but `{KEY}`"),
                    "this one",
                ));
            }
            json = Some(value);
        }
        let json = json.ok_or_else(|| ReadError::metadata(KEY, "the header", "no such key"))?;
        let header = Header::from_json(json)?;
        let mut weights = Weights::new(header);
        let storage = weights.header.storage;
        let mut found = metadata.tensors();
        for (name, shape) in weights.header.architecture.tensors() {
            let dtype = dtype(storage, &shape);
            let expected = || format!("{dtype:?} with shape {shape:?}");
            let Some(info) = found.remove(&name) else {
                return Err(ReadError::tensor(&name, expected(), "no such tensor"));
            };
            if (info.dtype, &info.shape) != (dtype, &shape) {
                let found = format!("{:?} with shape {:?}", info.dtype, info.shape);
                return Err(ReadError::tensor(&name, expected(), found));
            }
            let data = decode(&data[info.data_offsets.0..info.data_offsets.1], dtype);
            weights.insert(name, Tensor { shape, data });
        }
        if let Some(name) = found.keys().min() {
            return Err(ReadError::tensor(name, "no tensor of this name", "one"));
        }
        weights.check()?;
        Ok(weights)
    }

    /// The bytes of a weights file; the same weights always give the same bytes.
    ///
    /// # Errors
    /// If [`check`](Self::check) refuses the weights, they are larger than [`MAX_FILE_BYTES`] or
    /// [`MAX_HEADER_BYTES`] allow, or a value does not fit the storage type.
    pub fn to_bytes(&self) -> Result<Vec<u8>, WriteError> {
        self.check()?;
        let encoded: Vec<_> = self
            .tensors()
            .map(|(name, tensor)| Ok((name, Encoded::new(name, tensor, self.header.storage)?)))
            .collect::<Result<_, WriteError>>()?;
        let metadata = HashMap::from([(KEY.to_owned(), self.header.to_json())]);
        let bytes = safetensors::serialize(encoded, Some(metadata))
            .map_err(|error| ReadError::container("container", "a safetensors file", error))?;
        split(&bytes)?;
        Ok(bytes)
    }
}

/// The container's metadata and its data, in which the tensors lie back to back.
///
/// Every length is bounded before anything is allocated for it.
fn split(bytes: &[u8]) -> Result<(Metadata, &[u8]), ReadError> {
    let length = bytes.len() as u64;
    if length > MAX_FILE_BYTES {
        return Err(ReadError::container(
            "file",
            format!("at most {MAX_FILE_BYTES} bytes"),
            length,
        ));
    }
    let Some((header, rest)) = bytes.split_first_chunk() else {
        return Err(foreign(bytes));
    };
    let header = u64::from_le_bytes(*header);
    // In a file of another kind these bytes are no length, and no JSON follows them.
    if header > rest.len() as u64 && rest.first() != Some(&b'{') {
        return Err(foreign(bytes));
    }
    let most = MAX_HEADER_BYTES.min(rest.len() as u64);
    if header > most {
        return Err(ReadError::container(
            "header length",
            format!("at most {most} bytes"),
            header,
        ));
    }
    let (header, data) = rest.split_at(header as usize);
    let metadata: Metadata = serde_json::from_slice(header)
        .map_err(|error| ReadError::container("header", "the JSON of a safetensors file", error))?;
    if metadata.data_len() != data.len() {
        let expected = format!("{} bytes, as the header says", metadata.data_len());
        return Err(ReadError::container("data", expected, data.len()));
    }
    Ok((metadata, data))
}

/// The error for a file of another kind; it shows how the file begins.
fn foreign(bytes: &[u8]) -> ReadError {
    const SHOWN: usize = 32;
    let start = &bytes[..bytes.len().min(SHOWN)];
    // A character that is cut at the end does not make text binary.
    let text = match std::str::from_utf8(start) {
        Ok(text) => text,
        Err(error) if error.error_len().is_none() => {
            std::str::from_utf8(&start[..error.valid_up_to()]).unwrap_or_default()
        }
        Err(_) => "",
    };
    let line = text.lines().next().unwrap_or_default();
    let is_text =
        !line.is_empty() && !text.contains(|c: char| c.is_control() && !c.is_whitespace());
    let found = if is_text {
        format!("text that begins with {line:?}")
    } else {
        format!("{} bytes of another kind", bytes.len())
    };
    ReadError::container("file", "a weights file (safetensors)", found)
}

/// The values of a tensor from its little-endian bytes, of type F16 or F32.
pub(crate) fn decode(bytes: &[u8], dtype: Dtype) -> Vec<f32> {
    match dtype {
        Dtype::F16 => bytes
            .as_chunks()
            .0
            .iter()
            .map(|&b| f16::from_le_bytes(b).to_f32())
            .collect(),
        _ => bytes
            .as_chunks()
            .0
            .iter()
            .map(|&b| f32::from_le_bytes(b))
            .collect(),
    }
}

/// A tensor on its way into the container.
struct Encoded<'a> {
    dtype: Dtype,
    shape: &'a [usize],
    bytes: Vec<u8>,
}

impl<'a> Encoded<'a> {
    fn new(name: &str, tensor: &'a Tensor, storage: Storage) -> Result<Encoded<'a>, WriteError> {
        let dtype = dtype(storage, &tensor.shape);
        let bytes = match dtype {
            Dtype::F16 => {
                let mut bytes = Vec::with_capacity(2 * tensor.data.len());
                for &value in &tensor.data {
                    let short = f16::from_f32(value);
                    if !short.is_finite() {
                        return Err(WriteError::Overflow {
                            name: name.into(),
                            value,
                        });
                    }
                    bytes.extend(short.to_le_bytes());
                }
                bytes
            }
            _ => tensor
                .data
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect(),
        };
        Ok(Encoded {
            dtype,
            shape: &tensor.shape,
            bytes,
        })
    }
}

impl View for Encoded<'_> {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn shape(&self) -> &[usize] {
        self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}
