#!/usr/bin/env bash
# Trains drmim-p75 from run c of drmim-p50.sh: 2.6 hours on two cores.
#
#   tools/trainer/recipes/drmim-p75.sh DATA OUT
#
# DATA, OUT, TRAIN and FLIGHTLAB are those of drmim-p50.sh; OUT holds its run c.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
data=$(realpath "${1:?usage: drmim-p75.sh DATA OUT}")
cd "${2:?usage: drmim-p75.sh DATA OUT}"
train=${TRAIN:-train}
video=$data/video/index.csv
boxes=$data/stills/boxes.csv
stills=$data/stills

"$train" prune c/final.safetensors --ratio 0.75 --out pruned75.safetensors \
    --data "$video:0.5" --data "$boxes:0.5"
"$train" fit --out d --seed 4 --init pruned75.safetensors --pairs 100000 --rate 6e-4 \
    --warmup-share 0.02 --early-share 0.4 --data "$video:0.5" --data "$boxes:0.2" \
    --data scenes:0.1 --data "paste:$stills:0.1" --data "patches:$stills:0.1"
"$train" fit --out h --seed 7 --init d/final.safetensors --minutes 75 --rate 6e-4 \
    --warmup-share 0.02 --early-share 0.55 --data "$video:0.45" --data "$boxes:0.2" \
    --data scenes:0.1 --data "paste:$stills:0.15" --data "patches:$stills:0.1"
"$train" average d/final.safetensors h/final.safetensors --out mean75.safetensors
"$here/finish.sh" "$data" mean75.safetensors drmim-p75 p75.safetensors
