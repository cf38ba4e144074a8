"""Cycles of stretches of instructions, by llvm-mca."""

import collections
import json
import subprocess

ITERATIONS = 100

Cpu = collections.namedtuple(
    "Cpu", "clock_ghz target qemu qemu_cpu mcpu features decode dispatch"
)

# `decode`: instructions that the front end decodes per cycle. `dispatch`: micro-operations that it
# passes on per cycle, where LLVM's model has another number (0: LLVM's). Both are of Arm's software
# optimization guides (the A76 is Neoverse N1's core), of AMD's for Zen 3.
AARCH64 = ("aarch64-unknown-linux-musl", "qemu-aarch64")
X86_64 = ("x86_64-unknown-linux-gnu", "qemu-x86_64")
CPUS = {
    "zen3": Cpu(3.2, *X86_64, "max", "znver3", "", 8, 0),
    "cortex-a55": Cpu(1.8, *AARCH64, "cortex-a76", "cortex-a55", "+dotprod", 2, 0),
    "cortex-a72": Cpu(1.8, *AARCH64, "cortex-a72", "cortex-a72", "", 3, 0),
    "cortex-a76": Cpu(2.4, *AARCH64, "cortex-a76", "neoverse-n1", "+dotprod,+fullfp16", 4, 8),
}


def of(mca, cpu, stretches):
    """Cycles per run of each stretch (lists of instructions), repeated without end."""
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
    return parse(result.stdout, cpu, len(stretches))


def parse(output, cpu, count):
    """Cycles per run of `count` stretches from llvm-mca's JSON."""
    cycles = [0.0] * count
    for region in json.loads(output)["CodeRegions"]:
        summary = region["SummaryView"]
        decoding = summary["Instructions"] / cpu.decode
        cycles[int(region["Name"] or 0)] = max(summary["TotalCycles"], decoding) / ITERATIONS
    return cycles
