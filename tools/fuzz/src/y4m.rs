//! Streams of frames: y4m and PPM.
#![no_main]

use libfuzzer_sys::fuzz_target;
use std::path::PathBuf;
use std::sync::LazyLock;
use track_cpu::source::{Input, Source};

static FILE: LazyLock<PathBuf> = LazyLock::new(|| {
    std::env::temp_dir().join(format!("track-cpu-fuzz-{}.y4m", std::process::id()))
});

fuzz_target!(|bytes: &[u8]| {
    std::fs::write(&*FILE, bytes).expect("a folder for temporary files");
    if let Ok(frames) = Source::open(&Input::new(&*FILE)) {
        for image in frames.take(16) {
            let Ok(image) = image else { break };
            image.frame().mean_bgr(track_cpu::Isa::detect());
        }
    }
});
