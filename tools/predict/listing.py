"""A program's disassembly, and how often each of its instructions ran."""

import collections
import re
import subprocess

FUNCTION = re.compile(r"^([0-9a-f]+) <(.*)>:$")
INSTRUCTION = re.compile(r"^\s*([0-9a-f]+):\s+(\S.*)$")
TARGET = re.compile(r"0x([0-9a-f]+) <[^>]*>")
HASH = re.compile(r"\[[0-9a-f]{8,}\]|::h[0-9a-f]{16}$|(::h[0-9a-f]{16})? \(\.llvm\.\d+\)$")
# Instructions after which the next one runs only if something jumps there, or a call returns there.
LEAVES = re.compile(r"^(jmp|ret|call|ud2|b|br|bl|blr|brk|udf|syscall|svc|hlt)[ql]?(\s|$)")
# Conditional jumps: they end a block of the emulator, too.
BRANCHES = re.compile(r"^(j[a-z]+|loop[a-z]*|b\.[a-z]+|cbn?z|tbn?z)(\s|$)")


class Instruction:
    """One instruction: its address, its text, and where it may jump to."""

    def __init__(self, address, text):
        self.address = address
        self.text = re.sub(r"\s+", " ", re.sub(r"\s+(#|//|;) .*$", "", text)).strip()
        match = TARGET.search(self.text)
        is_jump = LEAVES.match(self.text) or BRANCHES.match(self.text)
        self.target = int(match[1], 16) if match and is_jump else None
        self.ends_block = bool(is_jump)


def functions(objdump, program):
    """All functions of a program: `[(name, [Instruction])]`."""
    command = [objdump, "-d", "-C", "--no-show-raw-insn", program]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        found = parse(process.stdout)
    if process.returncode:
        raise SystemExit(f"{objdump} failed for {program}")
    return found


def parse(lines):
    """[`functions`] of a listing."""
    found, body = [], []
    for line in lines:
        if match := INSTRUCTION.match(line):
            body.append(Instruction(int(match[1], 16), match[2]))
        elif match := FUNCTION.match(line):
            body = []
            found.append((HASH.sub("", match[2]), body))
    return [(name, body) for name, body in found if body]


def executions(functions, blocks):
    """How often each instruction ran: `{address: times}`, of the emulator's `blocks`.

    A block is `(address, instructions)`, and may reach across the end of a function.
    """
    order = [instruction.address for _, body in functions for instruction in body]
    place = {address: i for i, address in enumerate(order)}
    counts = collections.Counter()
    for (address, instructions), times in blocks.items():
        first = place.get(address)
        if first is not None:  # else it belongs to a library
            for at in order[first : first + instructions]:
                counts[at] += times
    return counts


def stretches(body, columns):
    """Stretches of instructions that ran equally often: `(first, last + 1)` as indices.

    `columns` holds the counts of each row of the report. A loop without branches is one stretch,
    and so is straight code around checks that never fail.
    """
    first = 0
    keys = [tuple(column.get(i.address, 0) for column in columns) for i in body]
    for i in range(1, len(body) + 1):
        if i == len(body) or keys[i] != keys[first]:
            if any(keys[first]):
                yield first, i
            first = i


def is_loop(stretch):
    """Whether a stretch ends with a jump into itself."""
    target = stretch[-1].target
    return target is not None and stretch[0].address <= target <= stretch[-1].address


def source(body):
    """Instructions as text that an assembler reads: jumps and addresses of data go nowhere."""
    return [TARGET.sub("0", instruction.text) for instruction in body]
