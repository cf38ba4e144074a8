#!/usr/bin/env bash
# Trains drmim-p50 from random weights: 7.5 hours on two cores.
#
#   tools/trainer/recipes/drmim-p50.sh DATA OUT
#
# DATA               video/index.csv, stills/boxes.csv, stills/images/ and sequences/ (to validate
#                    on); docs/results.md, "Model cards", says what they held
# OUT                folder for the runs and p50.safetensors
# TRAIN, FLIGHTLAB   the programs, where they are not on the PATH
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
data=$(realpath "${1:?usage: drmim-p50.sh DATA OUT}")
mkdir -p "${2:?usage: drmim-p50.sh DATA OUT}"
cd "$2"
train=${TRAIN:-train}

# A run with its seed: the sources of pairs are named once, their shares differ.
fit() { # NAME SEED VIDEO BOXES SCENES PASTE PATCHES OPTIONS...
    local name=$1 seed=$2 video=$3 boxes=$4 scenes=$5 paste=$6 patches=$7
    shift 7
    "$train" fit --out "$name" --seed "$seed" \
        --data "$data/video/index.csv:$video" --data "$data/stills/boxes.csv:$boxes" \
        --data "scenes:$scenes" --data "paste:$data/stills:$paste" \
        --data "patches:$data/stills:$patches" "$@"
}

fit a 1 0.45 0.2 0.15 0.1 0.1 --minutes 112 --early-share 0.6 --validate-flights 6
# Run b was cut off after 25,200 pairs, about 27 minutes; c starts from its last checkpoint.
export train data
export -f fit
timeout 27m bash -c "fit b 2 0.5 0.2 0.1 0.1 0.1 --init a/final.safetensors --pairs 140000 \
    --rate 6e-4 --early-share 0.55" || [ $? = 124 ]
later=(--rate 6e-4 --warmup-share 0.02)
fit c 3 0.5 0.2 0.1 0.1 0.1 "${later[@]}" --init b/checkpoint.safetensors --pairs 78000 \
    --early-share 0.4
fit e 5 0.5 0.2 0.1 0.1 0.1 "${later[@]}" --init c/final.safetensors --pairs 110000 \
    --early-share 0.7
fit f 6 0.45 0.2 0.1 0.15 0.1 "${later[@]}" --init e/final.safetensors --minutes 66 \
    --early-share 0.55 --validate-flights 6 --validate-minutes 60
"$train" average e/final.safetensors f/best.safetensors --out ef.safetensors
fit g 8 0.45 0.2 0.1 0.15 0.1 "${later[@]}" --init ef.safetensors --minutes 38 \
    --early-share 0.5 --validate-flights 6 --validate-minutes 60
"$train" average e/final.safetensors f/best.safetensors g/final.safetensors --out mean.safetensors

"$here/finish.sh" "$data" mean.safetensors drmim-p50 p50.safetensors
