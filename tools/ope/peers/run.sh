#!/usr/bin/env bash
# Our tracker beside OpenCV's KCF, CSRT and MOSSE on the same sequences, for docs/results.md.
#
#   tools/ope/peers/run.sh SEQUENCES [FOLDER]
#
# SEQUENCES   folders with pictures and groundtruth*.txt at any depth; a meta.json beside may say
#             {"in_train": true}, and a drmim_authors_result.txt hold the boxes that the authors of
#             DR-MIM published
# FOLDER      where results go, by default target/peers; results that exist are kept, except ours
# OPE         the program; built by cargo if not set
# MODEL       a weights file in place of the built-in model
# NANOTRACK   the folder NanoTrack/models/nanotrackv3 of HonglinChu/SiamTrackers
# PEERS_VENV  a Python environment with opencv-contrib-python, made if absent; for NanoTrackV3 also
#             onnx and onnxruntime
# DOCUMENT    the file whose part between `<!-- peers -->` and `<!-- /peers -->` is rewritten, by
#             default docs/results.md; plots go to the folder plots beside it
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../.." && pwd)
sequences=$(realpath "${1:?usage: run.sh SEQUENCES [FOLDER]}")
work=${2:-$root/target/peers}
venv=${PEERS_VENV:-$HOME/.cache/track-cpu-opencv}
document=${DOCUMENT:-$root/docs/results.md}

if ! "$venv/bin/python" -c 'import cv2' 2> /dev/null; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet opencv-contrib-python-headless
fi
if [ -n "${NANOTRACK:-}" ] && ! "$venv/bin/python" -c 'import onnx, onnxruntime' 2> /dev/null; then
    "$venv/bin/pip" install --quiet onnx onnxruntime
fi
if [ -z "${OPE:-}" ]; then
    (cd "$root" && cargo build --release -p ope)
    OPE=${CARGO_TARGET_DIR:-$root/target}/release/ope
fi
mkdir -p "$work"

# One after the other: times are of one tracker on one thread.
run() { "$OPE" run --dataset folder --root "$sequences" --out "$work" --jobs 1 "$@"; }
rm -rf "$work/folder/track-cpu"
run --name track-cpu ${MODEL:+--model "$MODEL"}
for tracker in CSRT KCF MOSSE; do
    run --name "$tracker" --tracker "$venv/bin/python $here/opencv_tracker.py $tracker {frames} {init} {out} {times}"
done
if [ -n "${NANOTRACK:-}" ]; then
    run --name NanoTrackV3 --tracker "$venv/bin/python $here/nanotrack.py $NANOTRACK {frames} {init} {out} {times}"
fi
"$venv/bin/python" "$here/tables.py" "$OPE" "$sequences" "$work" "$document"
