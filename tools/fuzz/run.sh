#!/bin/sh
# Fuzzes: tools/fuzz/run.sh TARGET|all [SECONDS]. Needs a C++ compiler; a stable Rust is enough.
#
# Starts from the seeds (tools/fuzz/src/seeds.rs) and what is in corpus/TARGET; what finds new ways through the program is
# kept in work/TARGET, and a finding is written to work/TARGET.found. `run.sh keep TARGET` puts the smallest set that
# goes all these ways into corpus/TARGET.
set -eu
cd "$(dirname "$0")"
host=$(rustc -vV | sed -n 's/^host: //p')
seconds=${2:-600}

# Coverage counters as cargo-fuzz asks for them, by options that stable compilers have.
export RUSTFLAGS="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares --cfg fuzzing"
cargo build --release --target "$host"
programs=${CARGO_TARGET_DIR:-target}/$host/release

fuzz() {
    mkdir -p "work/$1" "corpus/$1"
    echo "$1: $seconds s"
    "$programs/$1" "work/$1" "corpus/$1" "work/seeds/$1" -max_total_time="$seconds" -artifact_prefix="work/$1.found-" \
        -timeout=20 -rss_limit_mb=3000 -max_len="$(longest "$1")" -print_final_stats=1 2> "work/$1.log" || {
        tail -n 30 "work/$1.log" >&2
        return 1
    }
    grep -E 'stat::number_of_executed_units|DONE' "work/$1.log"
}

longest() {
    case $1 in
        weights | checkpoint) echo 65536 ;;
        *) echo 4096 ;;
    esac
}

mkdir -p work
"$programs/seeds" work/seeds
case ${1:-all} in
    all) for target in weights checkpoint trax y4m mavlink http; do fuzz "$target"; done ;;
    keep) "$programs/$2" -merge=1 "corpus/$2" "work/$2" "work/seeds/$2" ;;
    *) fuzz "$1" ;;
esac
