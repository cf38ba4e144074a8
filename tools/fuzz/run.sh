#!/bin/sh
# Fuzzes what reads strangers' bytes. Needs a C++ compiler and xz; a stable Rust is enough.
#
#   tools/fuzz/run.sh TARGET|all [SECONDS]
#   tools/fuzz/run.sh keep TARGET
#
# It starts from the seeds (tools/fuzz/src/seeds.rs) and corpus/TARGET.tar.xz. Inputs that reach new
# code gather in work/TARGET; a finding is written to work/TARGET.found-*. `keep` packs the smallest
# set of inputs with the same coverage into corpus/TARGET.tar.xz.
set -eu
cd "$(dirname "$0")"
host=$(rustc -vV | sed -n 's/^host: //p')
seconds=${2:-600}

# Coverage counters as cargo-fuzz asks for them, by options that stable compilers have.
export RUSTFLAGS="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 -Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table -Cllvm-args=-sanitizer-coverage-trace-compares --cfg fuzzing"
cargo build --release --target "$host"
programs=${CARGO_TARGET_DIR:-target}/$host/release

fuzz() {
    unpack "$1"
    echo "$1: $seconds s"
    "$programs/$1" "work/$1" "work/seeds/$1" -max_total_time="$seconds" -artifact_prefix="work/$1.found-" \
        -timeout=20 -rss_limit_mb=3000 -max_len="$(longest "$1")" -print_final_stats=1 2> "work/$1.log" || {
        tail -n 30 "work/$1.log" >&2
        return 1
    }
    grep -E 'DONE' "work/$1.log"
}

unpack() {
    mkdir -p "work/$1"
    if [ -f "corpus/$1.tar.xz" ]; then tar -xJf "corpus/$1.tar.xz" -C "work/$1"; fi
}

keep() {
    unpack "$1"
    rm -rf "work/least"
    mkdir -p "work/least" corpus
    "$programs/$1" -merge=1 "work/least" "work/$1" "work/seeds/$1" 2> "work/$1.merge.log"
    tar -C "work/least" --sort=name --mtime=@0 --owner=0 --group=0 -cJf "corpus/$1.tar.xz" .
    ls -l "corpus/$1.tar.xz"
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
    all)
        for target in weights checkpoint trax y4m mavlink http annotations commands; do
            fuzz "$target"
        done ;;
    keep) keep "$2" ;;
    *) fuzz "$1" ;;
esac
