//! Gives the shared library the name that programs look for: it changes with the major version.

use std::env::var;

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    let major = var("CARGO_PKG_VERSION_MAJOR").unwrap_or_default();
    let argument = match var("CARGO_CFG_TARGET_OS").as_deref() {
        Ok("macos") => format!("-Wl,-install_name,@rpath/libtrack_cpu.{major}.dylib"),
        Ok("windows") => return,
        _ => format!("-Wl,-soname,libtrack_cpu.so.{major}"),
    };
    println!("cargo:rustc-cdylib-link-arg={argument}");
}
