#!/usr/bin/env python3
"""Predicts the time of a frame on a processor that is not at hand; README.md says how.

    tools/predict/predict.py --cpu cortex-a76 [--model NAME] [--precision NAME] [--json]
    tools/predict/predict.py --cpu cortex-a76 --loop FILE.s
"""

import argparse
import json
import os
import pathlib
import re
import subprocess
import sys

import cycles
import listing
import trace

ROOT = pathlib.Path(__file__).resolve().parents[2]
CLOCK = re.compile(r"std::time::Instant>?::now$")
PASS = re.compile(r"track_cpu::net::Network>?::search_timed$")
POOLED = re.compile(r"kernels::conv::.*::run_pooled$")
CONVOLUTION = re.compile(r"kernels::conv::.*::run_between$")
FRAMES = 2
COVERED = 0.999  # share of the executed instructions whose cycles are modeled one by one
STAGES = ["crop", "backbone", "dr", "neck", "xcorr", "head", "filter", "select"]


def build(target):
    """Builds the program with symbols that name type parameters; returns its path."""
    folder = pathlib.Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "predict"
    environment = {**os.environ, "CARGO_TARGET_DIR": str(folder)}
    environment["RUSTFLAGS"] = "-C symbol-mangling-version=v0"
    if "musl" in target:  # without a C compiler for it, as tools/static.sh
        variable = f"CARGO_TARGET_{target.upper().replace('-', '_')}_LINKER"
        environment.setdefault(variable, "rust-lld")
    command = ["cargo", "build", "--release", "--locked", "--bin", "track-cpu", "--target", target]
    subprocess.run(command, cwd=ROOT, check=True, env=environment)
    return str(folder / target / "release" / "track-cpu")


def marks(functions):
    """Where the program reads the clock, begins a pass, and begins a convolution."""

    def all_of(pattern):
        return [body[0].address for name, body in functions if pattern.search(name)]

    clock, passes, pooled, convolutions = map(all_of, (CLOCK, PASS, POOLED, CONVOLUTION))
    if len(clock) != 1 or len(passes) != 1 or len(pooled) != 1 or len(convolutions) != 1:
        raise SystemExit("the program lacks the expected functions: was it stripped?")
    return trace.Marks(clock[0], passes[0], pooled + convolutions, pooled)


def count(functions, program, cpu, arguments):
    """Executed blocks per frame and row, and what the program said about itself."""
    where = marks(functions)
    command = [program, "bench", "--frames", str(FRAMES), "--threads", "1", "--json"]
    command += ["--model", arguments.model]
    if arguments.precision:
        command += ["--precision", arguments.precision]
    qemu = [arguments.qemu or cpu.qemu, "-cpu", cpu.qemu_cpu]
    info, lines = trace.run(qemu, command, where)
    segments = trace.Segments(where, trace.layers(info))
    trace.read(lines, segments)
    return segments.per_frame(FRAMES), info


def stretches(functions, rows):
    """Every stretch that ran: its function, its instructions, how often it ran in each row."""
    columns = {row: listing.executions(functions, blocks) for row, blocks in rows.items()}
    found = []
    for name, body in functions:
        for first, end in listing.stretches(body, list(columns.values())):
            address = body[first].address
            times = {row: c[address] for row, c in columns.items() if c[address]}
            found.append((name, body[first:end], times))
    return found


def predict(found, cpu, mca):
    """Cycles per row, and per row and function.

    What rarely runs costs as much per instruction as the rest.
    """
    sizes = [len(body) * sum(times.values()) for _, body, times in found]
    total, seen, chosen = sum(sizes), 0, []
    for i in sorted(range(len(found)), key=lambda i: -sizes[i]):
        if seen >= COVERED * total:
            break
        chosen.append(i)
        seen += sizes[i]
    bodies = [found[i][1] for i in chosen]
    loops = [listing.is_loop(body) for body in bodies]
    costs = cycles.of(mca, cpu, [listing.source(body) for body in bodies], loops)
    per_run = dict(zip(chosen, costs))
    rate = sum(per_run[i] * sum(found[i][2].values()) for i in chosen) / seen
    rows, parts = {}, {}
    for i, (name, body, times) in enumerate(found):
        cost = per_run.get(i, rate * len(body))
        for row, n in times.items():
            rows[row] = rows.get(row, 0.0) + cost * n
            parts[row, name] = parts.get((row, name), 0.0) + cost * n
    return rows, parts


def report(rows, parts, info, clock_ghz, measured):
    """The prediction as one object for machines."""
    algorithms = {layer["name"]: layer["algorithm"] for layer in info["layers"]}
    order = {stage: i for i, stage in enumerate(STAGES)}
    names = {name: i for i, name in enumerate(algorithms)}
    listed = []
    for row in sorted(rows, key=lambda row: (order[row[0]], names.get(row[1], len(names)))):
        kernels = sorted(
            ((n, name) for (of, name), n in parts.items() if of == row and n > 0.01 * rows[row]),
            reverse=True,
        )
        entry = {"stage": row[0], "row": row[1], "algorithm": algorithms.get(row[1])}
        entry |= {"mcycles": round(rows[row] / 1e6, 4), "ms": round(rows[row] / clock_ghz / 1e6, 4)}
        entry["functions"] = [{"mcycles": round(n / 1e6, 4), "name": name} for n, name in kernels]
        listed.append(entry)
    stages = {}
    for entry in listed:
        stages[entry["stage"]] = stages.get(entry["stage"], 0.0) + entry["ms"]
    total = sum(rows.values())
    result = {"isa": info["isa"], "model": info["model"], "precision": info["precision"]}
    result |= {"clock_ghz": clock_ghz, "mcycles": round(total / 1e6, 3)}
    result |= {"ms": round(total / clock_ghz / 1e6, 3), "rows": listed}
    result["stages_ms"] = {stage: round(stages[stage], 4) for stage in STAGES if stage in stages}
    if measured:
        result["measured_stages_ms"] = measured["stages_ms"]
        result["measured_ms"] = measured["latency_ms"]["p50"]
    return result


def text(result, cpu):
    """The same for people."""
    lines = [
        "{model} {precision} on {cpu} ({isa}), {clock_ghz} GHz, one thread: a prediction".format(
            **result, cpu=cpu
        )
    ]
    lines.append(f"\n{'row':24} {'algorithm':>16} {'Mcycles':>9} {'ms':>8}")
    frame = {"stage": "", "row": "frame", "algorithm": None, **result}
    for row in [*result["rows"], frame]:
        if row["mcycles"] >= 0.005:
            algorithm = row["algorithm"] or ""
            lines.append(f"{label(row):24} {algorithm:>16} {row['mcycles']:9.2f} {row['ms']:8.3f}")
    if "measured_ms" in result:
        lines.append(f"\n{'stage':24} {'predicted ms':>14} {'measured ms':>12} {'error':>8}")
        pairs = [(s, ms, result["measured_stages_ms"][s]) for s, ms in result["stages_ms"].items()]
        for stage, ms, measured in [*pairs, ("frame", result["ms"], result["measured_ms"])]:
            error = f"{100 * (ms / measured - 1):+.0f} %"
            lines.append(f"{stage:24} {ms:14.3f} {measured:12.3f} {error:>8}")
    return "\n".join(lines)


def label(row):
    """A row's name, which says its stage."""
    is_plain = row["row"] in (row["stage"], "frame") or "." in row["row"]
    return row["row"] if is_plain else f"{row['stage']}: {row['row']}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cpu", required=True, choices=cycles.CPUS)
    parser.add_argument("--clock", type=float, metavar="GHZ", help="[default: the board's]")
    parser.add_argument("--model", default="drmim-p50", metavar="NAME")
    parser.add_argument("--precision", choices=["f32", "int8"])
    parser.add_argument("--program", metavar="FILE", help="[default: it is built]")
    parser.add_argument("--measured", metavar="FILE", help="what `track-cpu bench --json` wrote")
    parser.add_argument("--loop", metavar="FILE", help="cycles of this loop in assembly, no more")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--qemu", metavar="FILE", help="[default: qemu-aarch64, qemu-x86_64]")
    parser.add_argument("--llvm-mca", default="llvm-mca", metavar="FILE")
    parser.add_argument("--llvm-objdump", default="llvm-objdump", metavar="FILE")
    arguments = parser.parse_args()
    cpu = cycles.CPUS[arguments.cpu]
    if arguments.loop:
        lines = pathlib.Path(arguments.loop).read_text().splitlines()
        print(f"{cycles.of(arguments.llvm_mca, cpu, [lines], [True])[0]:.2f} cycles")
        return
    program = arguments.program or build(cpu.target)
    functions = listing.functions(arguments.llvm_objdump, program)
    rows, info = count(functions, program, cpu, arguments)
    rows, parts = predict(stretches(functions, rows), cpu, arguments.llvm_mca)
    measured = None
    if arguments.measured:
        measured = json.loads(pathlib.Path(arguments.measured).read_text())
    result = report(rows, parts, info, arguments.clock or cpu.clock_ghz, measured)
    print(json.dumps(result) if arguments.json else text(result, arguments.cpu))


if __name__ == "__main__":
    sys.exit(main())
