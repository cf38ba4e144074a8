"""Cycles of stretches of instructions, by llvm-mca."""

import collections
import json
import subprocess

ITERATIONS = 100

Cpu = collections.namedtuple(
    "Cpu", "clock_ghz target qemu qemu_cpu mcpu features decode dispatch in_order"
)

# `decode`: instructions that the front end decodes per cycle. `dispatch`: micro-operations that it
# passes on per cycle, where LLVM's model has another number (0: LLVM's). Sources: what Arm and AMD
# publish of these cores; the A76 is Neoverse N1's core.
AARCH64 = ("aarch64-unknown-linux-musl", "qemu-aarch64")
X86_64 = ("x86_64-unknown-linux-gnu", "qemu-x86_64")
FP16 = "+dotprod,+fullfp16"
CPUS = {
    "zen3": Cpu(3.2, *X86_64, "max", "znver3", "", 8, 0, False),
    "cortex-a55": Cpu(1.8, *AARCH64, "cortex-a76", "cortex-a55", "+dotprod", 2, 0, True),
    "cortex-a72": Cpu(1.8, *AARCH64, "cortex-a72", "cortex-a72", "", 3, 0, False),
    "cortex-a76": Cpu(2.4, *AARCH64, "cortex-a76", "neoverse-n1", FP16, 4, 8, False),
}


def of(mca, cpu, stretches, loops):
    """Cycles per run of each stretch (lists of instructions), repeated without end.

    `loops` says of each whether it repeats itself, so that a run waits for results of the one
    before.
    """
    lines = []
    for i, stretch in enumerate(stretches):
        lines += [f"# LLVM-MCA-BEGIN {i}", *stretch, f"# LLVM-MCA-END {i}"]
    if len(stretches) == 1:
        lines = stretches[0]  # between marks llvm-mca loses instructions of macros
    command = [mca, f"-mtriple={cpu.target}", f"-mcpu={cpu.mcpu}", f"-iterations={ITERATIONS}"]
    command += ["-json", "-skip-unsupported-instructions=any"]
    if cpu.features:
        command.append(f"-mattr={cpu.features}")
    if cpu.dispatch:
        command.append(f"-dispatch={cpu.dispatch}")
    text = "\n".join(lines) + "\n"
    result = subprocess.run(command, input=text, capture_output=True, text=True)
    if result.returncode:
        raise SystemExit(f"{mca} failed: {result.stderr[-2000:]}")
    return parse(result.stdout, cpu, loops)


def parse(output, cpu, loops):
    """Cycles per run of each stretch from llvm-mca's JSON."""
    cycles = [0.0] * len(loops)
    for region in json.loads(output)["CodeRegions"]:
        i, summary = int(region["Name"] or 0), region["SummaryView"]
        decoding = summary["Instructions"] / cpu.decode / ITERATIONS
        # Straight code that follows other code finds its inputs ready; only a processor that
        # executes in order waits for each result inside it.
        waits = loops[i] or cpu.in_order
        busy = summary["TotalCycles"] / ITERATIONS if waits else summary["BlockRThroughput"]
        cycles[i] = max(busy, decoding)
    return cycles
