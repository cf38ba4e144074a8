#!/usr/bin/env bash
# Times one search pass of our network beside other inference engines, for docs/results.md:
#
#   tools/peers/run.sh [ROUNDS]
#
# TRACK_CPU    the program; built by cargo if not set
# PEERS_VENV   a Python environment with the engines (8 GB), made unless it exists
# PEERS_WORK   where their models go, by default target/peers-models
# DOCUMENT     the file whose parts between `<!-- table -->` and `<!-- /table -->`, `<!-- paper -->`
#              and `<!-- /paper -->` are rewritten, by default docs/results.md
#
# Close everything else first: two noisy minutes make a wrong table.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../.." && pwd)
venv=${PEERS_VENV:-$HOME/.cache/track-cpu-peers/venv}
work=${PEERS_WORK:-$root/target/peers-models}
if ! "$venv/bin/python" -c 'import onnx, onnxruntime, openvino, nncf, MNN, ncnn, pnnx, ai_edge_litert, tensorflow, torch' 2> /dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet numpy onnx onnxruntime openvino nncf MNN ncnn pnnx \
        ai-edge-litert tensorflow-cpu torch
fi
if [ -z "${TRACK_CPU:-}" ]; then
    (cd "$root" && cargo build --release --bin track-cpu)
    TRACK_CPU=${CARGO_TARGET_DIR:-$root/target}/release/track-cpu
fi
mkdir -p "$work"
document=${DOCUMENT:-$root/docs/results.md}
"$venv/bin/python" "$here/bench.py" "$(realpath "$TRACK_CPU")" "$work" "$document" "${1:-5}"
