//! JSON that strangers send or leave: bodies of `/start` and `/stop`, lines of commands, and flight
//! logs.
#![no_main]

use libfuzzer_sys::fuzz_target;
use station::commands::Request;
use station::http::{read_start, read_stop};
use station::log::Reader;
use station::{Command, Target};
use std::path::PathBuf;
use std::sync::LazyLock;

static LOG: LazyLock<PathBuf> = LazyLock::new(|| {
    std::env::temp_dir().join(format!("track-cpu-fuzz-{}.jsonl", std::process::id()))
});

fuzz_target!(|bytes: &[u8]| {
    let line = match Request::from_json(bytes).1 {
        Ok(Request::Command(command)) => Some(command),
        _ => None,
    };
    let bodies = [read_start(bytes), read_stop(bytes), line];
    for command in bodies.into_iter().flatten() {
        if command.check().is_ok()
            && let Command::Start { target, .. } = command
            && let Ok(bbox) = Target::in_frame(&target, (64, 48))
        {
            assert!(bbox.is_finite(), "a box in pixels");
        }
    }
    std::fs::write(&*LOG, bytes).expect("a folder for temporary files");
    if let Ok(mut log) = Reader::open(&LOG) {
        while let Ok(Some(_)) = log.next() {}
    }
});
