"""Times engines in turn and writes the tables of docs/results.md: `bench.py TRACK_CPU FOLDER DOCUMENT [ROUNDS]`.

Every engine is a process of its own that is stopped unless it is its turn; turns go round, so that whatever slows the machine slows all of
them. Medians over all passes.
"""

import os
import pathlib
import platform
import shlex
import signal
import statistics
import subprocess
import sys
import time

import network

track_cpu, folder, document = sys.argv[1], pathlib.Path(sys.argv[2]), pathlib.Path(sys.argv[3])
rounds = int(sys.argv[4]) if len(sys.argv) > 4 else 5
here = pathlib.Path(__file__).parent
ENGINES = {
    "f32": {"track-cpu": None, "mnn": "MNN", "ort": "ONNX Runtime", "openvino": "OpenVINO"},
    "int8": {"track-cpu": None, "openvino-int8": "OpenVINO", "ort-int8": "ONNX Runtime"},
}


class Engine:
    def __init__(self, name, precision, widths, threads):
        command = [sys.executable, str(here / "worker.py"), name, widths, str(threads), str(folder)]
        if name == "track-cpu":
            channels = ",".join(map(str, network.WIDTHS[widths]))
            options = f"bench --worker --widths {channels} --threads {threads} --precision {precision}"
            command = [track_cpu, *shlex.split(options)]
        pin = ["taskset", "-c", ",".join(map(str, range(os.cpu_count())[-threads:]))]
        environment = dict(os.environ, OMP_NUM_THREADS=str(threads))
        self.process = subprocess.Popen(
            pin + command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment,
            start_new_session=True,
        )  # fmt: skip
        self.version, self.times = None, []
        while not (line := self.process.stdout.readline()).startswith("READY"):
            if not line:
                raise SystemExit(f"{name} did not start; try: {shlex.join(command)}")
        self.version = line[5:].strip()
        self.signal(signal.SIGSTOP)

    def signal(self, which):
        os.killpg(self.process.pid, which)

    def turn(self, passes):
        self.signal(signal.SIGCONT)
        self.process.stdin.write(f"1\n{passes}\n")
        self.process.stdin.flush()
        self.process.stdout.readline()
        self.times += map(float, self.process.stdout.readline().split())
        self.signal(signal.SIGSTOP)

    def end(self):
        self.signal(signal.SIGKILL)
        self.process.wait()


def table(widths, threads, versions):
    """Medians in ms by precision and engine, measured in one go."""
    engines = {(p, n): Engine(n, p, widths, threads) for p, names in ENGINES.items() for n in names}
    for done in range(rounds):
        order = list(engines)
        turn = done % len(order)
        for key in order[turn:] + order[:turn]:
            engines[key].turn(12)
        print(f"{widths}, {threads} threads: round {done + 1} of {rounds}", file=sys.stderr)
    for engine in engines.values():
        engine.end()
        versions.add(engine.version)
    return {key: statistics.median(engine.times) for key, engine in engines.items()}


def machine():
    model = next((line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), platform.machine())
    return f"{model}, {os.cpu_count()} cores, Linux {platform.release().split('-')[0]}"


versions, columns = {""}, {}
versions.discard("")
counts = [n for n in (1, 2, 4) if n <= os.cpu_count()]
for widths in network.WIDTHS:
    for threads in counts:
        columns[widths, threads] = table(widths, threads, versions)
versions.discard("")
program = subprocess.run([track_cpu, "--version"], capture_output=True, text=True, check=True).stdout.strip()
lines = [f"{machine()}; {time.strftime('%Y-%m-%d')}; {program}, {', '.join(sorted(versions))}.", ""]
lines += ["| | | " + " | ".join(f"{w}, {n} thread{'s' * (n > 1)}" for w, n in columns) + " |", "|---|---|" + "---|" * len(columns)]
for precision, names in ENGINES.items():
    best = {c: min(ms for (p, n), ms in found.items() if p == precision and n != "track-cpu") for c, found in columns.items()}
    for name, title in names.items():
        cells = []
        for column, found in columns.items():
            ms = found[precision, name]
            cells.append(f"**{ms:.2f}** ({ms / best[column]:.2f}x)" if title is None else f"{ms:.2f}")
        lines.append(f"| {precision} | {title or '**track-cpu**'} | " + " | ".join(cells) + " |")
text = document.read_text()
before, rest = text.split("<!-- table -->\n", 1)
after = rest.split("<!-- /table -->", 1)[1]
document.write_text(before + "<!-- table -->\n" + "\n".join(lines) + "\n<!-- /table -->" + after)
macs = {widths: network.search_pass(widths)[1] / 1e9 for widths in network.WIDTHS}
print("\n".join(lines), f"\nmultiply-accumulates: {macs}", file=sys.stderr)
