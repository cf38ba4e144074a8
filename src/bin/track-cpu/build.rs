//! Tells the program which compiler builds it, for reports of speed.

use std::process::Command;

fn main() {
    println!("cargo:rerun-if-changed=src/bin/track-cpu/build.rs");
    let compiler = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    let output = Command::new(compiler).arg("--version").output();
    let version = output
        .ok()
        .and_then(|output| String::from_utf8(output.stdout).ok());
    let version = version
        .as_deref()
        .and_then(|text| text.split(" (").next())
        .unwrap_or("an unknown compiler");
    println!("cargo:rustc-env=TRACK_CPU_COMPILER={}", version.trim());
}
