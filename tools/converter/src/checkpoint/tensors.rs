//! A state dict in a safetensors file: a header that names tensors, then their bytes.

use super::torch::{Dtype, StorageRef, TensorRef};
use super::{Checkpoint, Storages};
use crate::error::Refusal;
use safetensors::SafeTensors;
use safetensors::tensor::Dtype as FileDtype;
use std::collections::BTreeMap;

/// Reads the header. The bytes of a tensor are read when it is loaded.
///
/// # Errors
/// If the file is no safetensors file, or one that this project wrote, which needs no conversion.
pub fn open(bytes: &[u8]) -> Result<Checkpoint<'_>, Refusal> {
    let refused = |error| Refusal::new("file", "a state dict in a safetensors file", error);
    let (header, metadata) = SafeTensors::read_metadata(bytes).map_err(refused)?;
    let ours = [
        (
            "track-cpu",
            "a weights file, which needs no conversion (--to pytorch goes back)",
        ),
        (
            "trainer",
            "a checkpoint of the trainer (`train export` makes weights of it)",
        ),
        (
            "parameters",
            "parameters for the trainer (`train export` makes weights of them)",
        ),
    ];
    for (key, found) in ours {
        if metadata
            .metadata()
            .as_ref()
            .is_some_and(|notes| notes.contains_key(key))
        {
            return Err(Refusal::new("file", "a PyTorch checkpoint", found));
        }
    }
    let data = 8 + header; // the header's length stands before it
    let mut tensors = BTreeMap::new();
    let mut ranges = BTreeMap::new();
    for (name, info) in metadata.tensors() {
        let (start, end) = info.data_offsets;
        let Some(dtype) = dtype(info.dtype) else {
            let expected = "floats of 16 to 64 bits, integers or booleans";
            let place = format!("tensor {name:?}");
            return Err(Refusal::new(place, expected, format!("{:?}", info.dtype)));
        };
        let storage = StorageRef {
            key: name.clone(),
            dtype,
            elements: (end - start) / dtype.bytes(),
        };
        // `read_metadata` has checked that the last tensor ends with the file.
        ranges.insert(name.clone(), data + start..data + end);
        super::insert(
            &mut tensors,
            &name,
            TensorRef::whole(storage, info.shape.clone())?,
        )?;
    }
    Ok(Checkpoint {
        tensors,
        others: Vec::new(),
        storages: Storages::Ranges { bytes, ranges },
    })
}

/// The type as [`Dtype`]; `None` for one that no state dict of this network has.
fn dtype(dtype: FileDtype) -> Option<Dtype> {
    Some(match dtype {
        FileDtype::F64 => Dtype::F64,
        FileDtype::F32 => Dtype::F32,
        FileDtype::F16 => Dtype::F16,
        FileDtype::BF16 => Dtype::Bf16,
        FileDtype::I64 | FileDtype::U64 => Dtype::Integer { bytes: 8 },
        FileDtype::I32 | FileDtype::U32 => Dtype::Integer { bytes: 4 },
        FileDtype::I16 | FileDtype::U16 => Dtype::Integer { bytes: 2 },
        FileDtype::I8 | FileDtype::U8 | FileDtype::BOOL => Dtype::Integer { bytes: 1 },
        _ => return None,
    })
}
