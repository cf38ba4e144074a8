#!/usr/bin/env bash
# Builds wheels for x86-64 and aarch64 that install on every Linux with glibc 2.17 and Python 3.9 or
# newer: zig links them, one machine makes both.
#
#   tools/python/wheels.sh FOLDER [TARGET...]     targets of Rust; both by default
#
# Needs rustup; maturin and zig come by pip into an environment of their own.
set -euo pipefail
folder=$(mkdir -p "${1:?usage: wheels.sh FOLDER [TARGET...]}" && cd "$1" && pwd)
shift
cd "$(dirname "$0")"
targets=("$@")
[ $# -gt 0 ] || targets=(x86_64-unknown-linux-gnu aarch64-unknown-linux-gnu)

venv=${XDG_CACHE_HOME:-$HOME/.cache}/track-cpu-ci/wheels
if ! "$venv/bin/python" -c 'import maturin, ziglang' 2> /dev/null; then
    python3 -m venv --clear "$venv"
    "$venv/bin/python" -m pip --quiet --disable-pip-version-check install maturin ziglang
fi
for target in "${targets[@]}"; do
    rustup target add "$target" >&2
    PATH=$venv/bin:$PATH maturin build --release --locked --zig --target "$target" \
        --compatibility manylinux2014 --out "$folder"
done
