#!/usr/bin/env bash
# track-cpu under the real VOT toolkit.
#
#   tools/ope/vot/run.sh [FOLDER]       writes FOLDER, by default target/vot, from scratch
#
# Runs `vot test` at every protocol version, then multi-start, supervised, realtime and long-term
# experiments over rendered flights, and their analysis. Fails if the toolkit or the tracker reports
# an error.
#
# TRACK_CPU, OPE      the programs; built by cargo if not set
# VOT_VENV            a Python environment with the toolkit (600 MB), made if absent
# FLIGHTS, FRAMES     how many flights, and frames in each; DIFFICULTY: easy, medium or hard
# TRACK_CPU_OPTIONS   options of `track-cpu trax`, such as --model FILE
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
root=$(cd "$here/../../.." && pwd)
work=${1:-$root/target/vot}
venv=${VOT_VENV:-$HOME/.cache/track-cpu-vot}
flights=${FLIGHTS:-3} frames=${FRAMES:-100} difficulty=${DIFFICULTY:-medium}

step() { printf '\n== %s\n' "$*"; }

if [ ! -x "$venv/bin/vot" ]; then
    step "toolkit"
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet vot-toolkit==0.7.4 attributee==0.1.9
fi
if [ -z "${TRACK_CPU:-}" ] || [ -z "${OPE:-}" ]; then
    step "programs"
    (cd "$root" && cargo build --release --bin track-cpu && cargo build --release -p ope)
    target=${CARGO_TARGET_DIR:-$root/target}/release
    TRACK_CPU=${TRACK_CPU:-$target/track-cpu} OPE=${OPE:-$target/ope}
fi
track_cpu=$(realpath "$TRACK_CPU")

step "workspace of $flights rendered flights ($difficulty) in $work"
rm -rf "$work"
mkdir -p "$work"
work=$(cd "$work" && pwd)
"$OPE" render --out "$work/sequences" --count "$flights" --frames "$frames" --difficulty "$difficulty"
for version in 4 3 1; do
    name=track-cpu
    [ "$version" = 4 ] || name=track-cpu-trax$version
    cat <<INI
[$name]
label = $name
protocol = trax
command = $track_cpu trax --protocol $version ${TRACK_CPU_OPTIONS:-}
timeout = 60

INI
done > "$work/trackers.ini"

# The toolkit always exits with 0; only its log says whether it succeeded.
log=$work/log.txt
vot() {
    (cd "$work" && "$venv/bin/vot" --registry "$work/trackers.ini" "$@" 2>&1) | tee -a "$log" | tr '\r' '\n' |
        grep -v '^ *$' | tail -n "${tail:-4}"
    if grep -n -i -E 'error|exception|traceback|interrupted' "$log"; then
        echo "the toolkit reported an error, see $log" >&2
        exit 1
    fi
}

for tracker in track-cpu track-cpu-trax3 track-cpu-trax1; do
    step "vot test $tracker"
    vot test "$tracker"
    tail -n 3 "$log" | grep -q 'Test concluded' || { echo "the test did not conclude" >&2; exit 1; }
done
step "vot evaluate"
vot initialize "$here/stack.yaml" --workspace "$work" --nodownload
vot evaluate --workspace "$work" track-cpu
tail -n 3 "$log" | grep -q 'Evaluation concluded' || { echo "the evaluation did not conclude" >&2; exit 1; }
step "vot analysis"
vot analysis --workspace "$work" --format json --name latest track-cpu
"$venv/bin/python" "$here/figures.py" "$work"
