//! JSON that strangers send or leave: bodies of `/start`, lines of commands, and flight logs.
#![no_main]

use libfuzzer_sys::fuzz_target;
use station::commands::Request;
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
    for command in Command::from_json(bytes).into_iter().chain(line) {
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
