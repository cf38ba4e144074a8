#!/usr/bin/env bash
# Makes a weights file of a checkpoint: export, int8 ranges, shares, presence.
#
#   tools/trainer/recipes/finish.sh DATA CHECKPOINT NAME OUT.safetensors
#
# DATA, TRAIN and FLIGHTLAB are those of drmim-p50.sh.
set -euo pipefail
usage="usage: finish.sh DATA CHECKPOINT NAME OUT.safetensors"
data=${1:?$usage}
checkpoint=${2:?$usage}
name=${3:?$usage}
out=${4:?$usage}
train=${TRAIN:-train}
flightlab=${FLIGHTLAB:-flightlab}
sequences=$data/sequences

"$train" export "$checkpoint" --out "$out" --name "$name" --validate "$sequences"
"$train" quantize "$out" --out "$out" --pairs 400 --data "$data/video/index.csv:0.5" \
    --data "$data/stills/boxes.csv:0.2" --data scenes:0.3
"$train" tune "$out" --out "$out" --data scenes --pairs 400 --seed 3 --validate "$sequences"
"$flightlab" calibrate --flights 6 --frames 200 --twins 0.1 --sequences "$sequences" --virtual 1 \
    --plain-too --stills "$data/stills/images" --model "$out" --into "$out"
