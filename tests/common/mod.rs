//! What several tests need: the shared reference data, where it is present, and safetensors files.

#![allow(dead_code)] // each test uses its own part

use std::path::PathBuf;

/// `path` within the reference data, or `None` after saying that the test is skipped.
///
/// The data lie in `$TRACK_CPU_SHARED` or in `../shared` beside the repository.
pub fn shared(path: &str) -> Option<PathBuf> {
    let beside = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let root = std::env::var_os("TRACK_CPU_SHARED").map_or(beside, PathBuf::from);
    let found = root.join(path);
    if found.exists() {
        return Some(found);
    }
    eprintln!(
        "SKIPPED: {} is not here (set TRACK_CPU_SHARED to the reference data)",
        found.display()
    );
    None
}

/// The tensors of a safetensors file as (name, shape, values).
pub fn read_tensors(path: &std::path::Path) -> Vec<(String, Vec<usize>, Vec<f32>)> {
    let bytes = std::fs::read(path).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    let floats = |data: &[u8]| {
        data.chunks_exact(4)
            .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
            .collect()
    };
    file.iter()
        .map(|(name, view)| (name.to_string(), view.shape().to_vec(), floats(view.data())))
        .collect()
}
