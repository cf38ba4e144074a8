#!/usr/bin/env bash
# Builds a track-cpu that needs nothing on the machine it is copied to: no libraries, no Rust.
#
#   tools/static.sh [TARGET]
#
# TARGET   aarch64-unknown-linux-musl (default): every 64-bit ARM board with Linux (Raspberry Pi 3
#          to 5, Jetson, RK3588); x86_64-unknown-linux-musl is for PCs. rustup installs its standard
#          library; no C compiler is needed.
#
# Prints the program's path. One program serves all boards of a target: it chooses its instructions
# when it starts.
set -euo pipefail
cd "$(dirname "$0")/.."
target=${1:-aarch64-unknown-linux-musl}
rustup target add "$target" >&2
linker=CARGO_TARGET_$(tr 'a-z-' 'A-Z_' <<< "$target")_LINKER
# Without symbols: they are half of the file.
env "$linker=rust-lld" cargo rustc --release --locked --bin track-cpu --target "$target" \
    -- -C strip=symbols >&2
echo "${CARGO_TARGET_DIR:-target}/$target/release/track-cpu"
