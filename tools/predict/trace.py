"""Runs `track-cpu bench` under qemu and counts the blocks that each part of a frame executes."""

import collections
import json
import pathlib
import re
import struct
import subprocess
import tempfile

# The clock's readings after a pass has begun, in order, and what runs after each (`Stages`).
STAGES = [None, "backbone", "dr", "neck", "xcorr", "head", None, "filter", "select"]
INITS = 2  # passes before the first frame: the benchmark sets its target twice
PLUGIN = pathlib.Path(__file__).with_name("count.c")


Marks = collections.namedtuple("Marks", "clock passes convolutions pooled")


class Segments:
    """Attributes executed blocks to rows: layers, stages, and what is learned after a pass.

    The program itself tells where a row begins: it reads the clock after each stage, and calls a
    convolution for each layer. A convolution with a pool behind it calls others, band by band.
    """

    def __init__(self, marks, layers):
        self.marks = marks
        self.layers = layers  # {stage: [(name, whether a pool follows)]}
        self.rows = {}  # {(stage, name): {(address, instructions): times}}
        self.passes = 0
        self.readings = len(STAGES)
        self.calls = []  # of convolutions in this stage: [counter, whether a pool follows]
        self.pending = []  # segments between two passes: [counter, whether a layer ran]
        self.begin_pending()

    def mark(self, address):
        """What follows belongs to another row."""
        if address == self.marks.clock:
            self.read_clock()
        elif address == self.marks.passes:
            self.begin_pass()
        else:
            self.begin_layer(address in self.marks.pooled)

    def add(self, block, times):
        self.counter[block] += times

    def row(self, stage, name):
        return self.rows.setdefault((stage, name), collections.Counter())

    def begin_pending(self):
        self.counter = collections.Counter()
        self.pending.append([self.counter, False])

    def begin_pass(self):
        self.passes += 1
        if self.passes <= INITS + 1:
            self.rows.clear()
        else:
            self.finish(self.pending[:-2])
        # A pass begins right after the crop, which the clock encloses.
        for counter, _ in self.pending[-2:]:
            self.row("crop", "crop").update(counter)
        self.pending = []
        self.readings = 0
        self.counter = self.row("backbone", "around layers")

    def read_clock(self):
        self.end_stage()
        self.readings += 1
        if self.readings < len(STAGES):
            stage = STAGES[self.readings] or STAGES[self.readings + 1]
            self.counter = self.row(stage, "around layers" if stage in self.layers else stage)
        else:
            self.begin_pending()

    def begin_layer(self, is_pooled):
        if self.readings < len(STAGES):
            self.counter = collections.Counter()
            self.calls.append((self.counter, is_pooled))
        else:
            self.pending[-1][1] = True

    def end_stage(self):
        if self.calls:
            stage = STAGES[self.readings]
            for name, counter in assign(self.layers[stage], self.calls):
                self.row(stage, name).update(counter)
            self.calls = []

    def finish(self, pending):
        for counter, has_layers in pending:
            row = ("neck", "template update") if has_layers else ("filter", "learning")
            self.row(*row).update(counter)

    def per_frame(self, frames):
        """Counts per frame, `{row: {(address, instructions): times}}`."""
        self.finish(self.pending[:-1])  # what follows the last reading of the clock is the report
        if self.passes != INITS + frames:
            raise SystemExit(f"{self.passes} passes for {frames} frames: the target was lost")
        return {
            row: {block: times / frames for block, times in counter.items()}
            for row, counter in self.rows.items()
        }


def assign(layers, calls):
    """Pairs of a layer's name and one of its calls.

    Of the calls after one with a pool, each later layer takes one, the last layer the last; the
    others are bands of the layer with the pool.
    """
    groups = []
    for call in calls:
        if call[1] or not groups:
            groups.append([])
        groups[-1].append(call[0])
    names = []
    for name, is_pooled in layers:
        if is_pooled or not names:
            names.append([])
        names[-1].append(name)
    if len(groups) != len(names) or any(len(g) < len(n) for g, n in zip(groups, names)):
        raise SystemExit(f"{len(calls)} calls of convolutions for {len(layers)} layers")
    for group, (first, *others) in zip(groups, names):
        bands = len(group) - len(others)
        yield from ((first, counter) for counter in group[:bands])
        yield from zip(others, group[bands:])


def layers(info):
    """The convolutions of a search by stage, with whether a pool follows, of `bench --json`."""
    found = {}
    for layer, after in zip(info["layers"], [*info["layers"][1:], {"name": ""}]):
        stage, name = layer["name"].split(".", 1)
        if layer["algorithm"] and not name.startswith("template"):
            found.setdefault(stage, []).append((layer["name"], ".pool" in after["name"]))
    # The head runs task by task: classification, whose features centerness reads, then regression.
    found["head"].sort(key=lambda layer: layer[0].startswith(("head.reg", "head.offsets")))
    return found


def read(lines, segments):
    """Tells `segments` what the plugin wrote."""
    for line in lines:
        match line.split():
            case ["mark", address]:
                segments.mark(int(address, 16))
            case [address, instructions, times]:
                segments.add((int(address, 16), int(instructions)), int(times))


def code_address(program):
    """The address of a program's first executable segment, from its ELF headers."""
    data = pathlib.Path(program).read_bytes()
    if data[:6] != b"\x7fELF\x02\x01":
        raise SystemExit(f"{program} is no 64-bit ELF file")
    (offset,) = struct.unpack_from("<Q", data, 32)
    size, count = struct.unpack_from("<HH", data, 54)
    for i in range(count):
        kind, flags, _, address = struct.unpack_from("<IIQQ", data, offset + i * size)
        if kind == 1 and flags & 1:
            return address
    raise SystemExit(f"{program} has no code")


def plugin_version(qemu):
    """The version of the plugin interface that this qemu takes."""
    output = subprocess.run([qemu, "--version"], check=True, capture_output=True, text=True).stdout
    match = re.search(r"version (\d+)", output)
    return 1 if match and int(match[1]) < 9 else 2


def run(qemu, command, marks):
    """Runs a program under qemu; returns its JSON object and the lines that the plugin wrote."""
    with tempfile.TemporaryDirectory() as folder:
        plugin, out = f"{folder}/count.so", f"{folder}/blocks"
        version = plugin_version(qemu[0])
        compiler = ["cc", "-shared", "-fPIC", "-O2", f"-DPLUGIN_VERSION={version}", "-o", plugin]
        subprocess.run([*compiler, str(PLUGIN)], check=True)
        addresses = [marks.clock, marks.passes, *marks.convolutions]
        options = "".join(f",mark={address:x}" for address in addresses)
        options = f"{plugin},out={out},code={code_address(command[0]):x}{options}"
        result = subprocess.run([*qemu, "-plugin", options, *command], stdout=subprocess.PIPE)
        if result.returncode:
            raise SystemExit(f"failed: {' '.join([*qemu, *command])}")
        return json.loads(result.stdout), pathlib.Path(out).read_text().splitlines()
