"""Times engines in turn and writes the table of docs/results.md.

    bench.py TRACK_CPU FOLDER DOCUMENT [ROUNDS]

Every engine is a process of its own, stopped unless it is its turn. Turns go round, so that
whatever slows the machine slows all engines. Times are medians over all passes.
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
            command = [track_cpu, "bench", "worker", "--widths", channels]
            command += ["--threads", str(threads), "--precision", precision]
        pin = ["taskset", "-c", ",".join(map(str, range(os.cpu_count())[-threads:]))]
        environment = dict(os.environ, OMP_NUM_THREADS=str(threads))
        self.process = subprocess.Popen(
            pin + command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            env=environment,
            start_new_session=True,
        )
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
    lines = [line for line in open("/proc/cpuinfo") if line.startswith("model name")]
    model = lines[0].split(":")[1].strip() if lines else platform.machine()
    return f"{model}, {os.cpu_count()} cores, Linux {platform.release().split('-')[0]}"


versions, columns = {""}, {}
versions.discard("")
counts = [n for n in (1, 2, 4) if n <= os.cpu_count()]
for widths in network.WIDTHS:
    for threads in counts:
        columns[widths, threads] = table(widths, threads, versions)
versions.discard("")
program = subprocess.check_output([track_cpu, "--version"], text=True).strip()
lines = [f"{machine()}; {time.strftime('%Y-%m-%d')}; {program}, {', '.join(sorted(versions))}.", ""]
titles = [f"{widths}, {n} thread{'s' * (n > 1)}" for widths, n in columns]
lines += ["| | | " + " | ".join(titles) + " |", "|---|---|" + "---|" * len(columns)]
for precision, names in ENGINES.items():
    others = [(precision, name) for name in names if name != "track-cpu"]
    best = {column: min(found[key] for key in others) for column, found in columns.items()}
    for name, title in names.items():
        cells = []
        for column, found in columns.items():
            ms = found[precision, name]
            ours = f"**{ms:.2f}** ({ms / best[column]:.2f}x)"
            cells.append(ours if title is None else f"{ms:.2f}")
        lines.append(f"| {precision} | {title or '**track-cpu**'} | " + " | ".join(cells) + " |")
text = document.read_text()
before, rest = text.split("<!-- table -->\n", 1)
after = rest.split("<!-- /table -->", 1)[1]
document.write_text(before + "<!-- table -->\n" + "\n".join(lines) + "\n<!-- /table -->" + after)
macs = {widths: network.search_pass(widths)[1] / 1e9 for widths in network.WIDTHS}
print("\n".join(lines), f"\nmultiply-accumulates: {macs}", file=sys.stderr)
