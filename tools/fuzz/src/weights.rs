//! Weights files and training checkpoints of our own.
#![no_main]

use libfuzzer_sys::fuzz_target;
use track_cpu::{Isa, Model};
use weights_format::{Unfolded, Weights};

fuzz_target!(|bytes: &[u8]| {
    if let Ok(weights) = Weights::from_bytes(bytes) {
        let _ = Model::from_weights(&weights, Isa::detect());
    }
    let _ = Unfolded::from_bytes(bytes);
});
