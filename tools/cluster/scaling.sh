#!/usr/bin/env bash
# Seconds per step of one process and of two on this machine, with the same 16 pairs per step, on
# one thread each. Usage: tools/cluster/scaling.sh [TRAIN], built with `--features mpi`.
#
# Between them runs a pair of processes that exchange nothing, with 8 pairs each: two processes
# slow each other also by sharing the memory. Repeats all three in turn, and prints medians.
set -euo pipefail

train=$(realpath "${1:-target/release/train}")
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
cd "$out"

export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1
mpi=(mpirun --oversubscribe --bind-to none --mca btl "tcp,self" --mca btl_tcp_if_include lo)
fit=("$train" fit --data scenes --early-share 0 --steps 12 --estimation-batches 0 --threads 1
    --checkpoint-minutes 1e6)
for turn in 1 2 3; do
    "${fit[@]}" --batch 16 --out "one-$turn" > /dev/null 2>&1
    "${fit[@]}" --batch 8 --out "apart-$turn" > /dev/null 2>&1 &
    "${fit[@]}" --batch 8 --out "apart-too-$turn" > /dev/null 2>&1
    wait
    "${mpi[@]}" -n 2 "${fit[@]}" --batch 8 --out "two-$turn" > /dev/null 2>&1
done

python3 - <<'PY'
import json, statistics

def read(folder):
    data = open(f"{folder}/final.safetensors", "rb").read()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    position = json.loads(header.pop("__metadata__")["trainer"])
    trained = [entry for name, entry in header.items() if name.startswith("optimizer.mean.")]
    sizes = [entry["data_offsets"][1] - entry["data_offsets"][0] for entry in trained]
    return position["seconds"] / position["step"], sum(sizes)

for name in ("one", "apart", "two"):
    runs = [read(f"{name}-{turn}") for turn in (1, 2, 3)]
    seconds = [run[0] for run in runs]
    middle, least, most = statistics.median(seconds), min(seconds), max(seconds)
    print(f"{name:6} {middle:.3f} s per step ({least:.3f} to {most:.3f})")
print(f"gradients: {runs[0][1]} bytes")
PY
