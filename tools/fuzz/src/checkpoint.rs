//! PyTorch checkpoints.
#![no_main]

use converter::{Options, convert_bytes, unfold_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let options = Options::default();
    let _ = convert_bytes(bytes, &options);
    let _ = unfold_bytes(bytes, &options);
});
