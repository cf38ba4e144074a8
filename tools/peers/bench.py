"""Times engines in turn and writes two tables of docs/results.md: peers, and the paper's speeds.

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
    "f32": {
        "track-cpu": None,
        "mnn": "MNN",
        "ncnn": "ncnn",
        "ort": "ONNX Runtime",
        "openvino": "OpenVINO",
        "litert": "LiteRT",
        "torch": "PyTorch",
    },
    "int8": {
        "track-cpu": None,
        "openvino-int8": "OpenVINO",
        "ort-int8": "ONNX Runtime",
        "litert-int8": "LiteRT",
    },
}
# Processors with matrix units are servers' ones: there, once more without them.
AMX = "amx_int8" in pathlib.Path("/proc/cpuinfo").read_text()
if AMX:
    ENGINES["int8"]["openvino-int8"] = "OpenVINO with AMX"
    ENGINES["int8"]["openvino-int8-vnni"] = "OpenVINO"
# The networks of the paper with its frames per second on ten cores, and who runs them here.
PAPER = {
    "full": ("SiamFC++, not pruned", "-"),
    "half": ("P-SiamFC++, pruned by 0.5", "46.1"),
    "half+encoder": ("DR-MIM, pruned by 0.5", "92.1"),
}
PAPER_ENGINES = {
    "PyTorch": ("f32", "torch"),
    "track-cpu f32": ("f32", "track-cpu"),
    "track-cpu int8": ("int8", "track-cpu"),
}


class Engine:
    def __init__(self, name, precision, net, threads):
        engine = name.removesuffix("-vnni")
        command = [sys.executable, str(here / "worker.py"), engine, net, str(threads), str(folder)]
        if name == "track-cpu":
            widths, _, encoder = net.partition("+")
            channels = ",".join(map(str, network.WIDTHS[widths]))
            command = [track_cpu, "bench", "worker", "--widths", channels]
            command += ["--threads", str(threads), "--precision", precision]
            command += ["--encoder", "3x3" if encoder else "none"]
        pin = ["taskset", "-c", ",".join(map(str, range(os.cpu_count())[-threads:]))]
        environment = dict(os.environ, OMP_NUM_THREADS=str(threads))
        if name.endswith("-vnni"):
            environment["ONEDNN_MAX_CPU_ISA"] = "AVX512_CORE_VNNI"
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


def medians(keys, threads, versions):
    """Medians in ms by (network, precision, engine), all measured in turn."""
    engines = {key: Engine(key[2], key[1], key[0], threads) for key in keys}
    for done in range(rounds):
        order = list(engines)
        turn = done % len(order)
        for key in order[turn:] + order[:turn]:
            engines[key].turn(12)
        print(f"{threads} threads: round {done + 1} of {rounds}", file=sys.stderr)
    for engine in engines.values():
        engine.end()
        versions.add(engine.version)
    return {key: statistics.median(engine.times) for key, engine in engines.items()}


def machine():
    lines = [line for line in open("/proc/cpuinfo") if line.startswith("model name")]
    model = lines[0].split(":")[1].strip() if lines else platform.machine()
    return f"{model}, {os.cpu_count()} cores, Linux {platform.release().split('-')[0]}"


def threads(n):
    return f"{n} thread{'s' * (n > 1)}"


def peers_table():
    """One search pass in ms, with the ratio of ours to the best other."""
    versions, columns = set(), {}
    engines = [(precision, name) for precision, names in ENGINES.items() for name in names]
    for net in ("half", "small"):
        for n in counts:
            found = medians([(net, *engine) for engine in engines], n, versions)
            columns[net, n] = {key[1:]: ms for key, ms in found.items()}
    versions = ", ".join(sorted(filter(None, versions)))
    lines = [f"{machine()}; {time.strftime('%Y-%m-%d')}; {program}, {versions}.", ""]
    titles = [f"{net}, {threads(n)}" for net, n in columns]
    lines += ["| | | " + " | ".join(titles) + " |", "|---|---|" + "---|" * len(columns)]
    for precision, names in ENGINES.items():
        others = [(precision, name) for name in names if name != "track-cpu"]
        if AMX and precision == "int8":
            others.remove((precision, "openvino-int8"))
        best = {column: min(found[key] for key in others) for column, found in columns.items()}
        for name, title in names.items():
            cells = []
            for column, found in columns.items():
                ms = found[precision, name]
                ours = f"**{ms:.2f}** ({ms / best[column]:.2f}x)"
                cells.append(ours if title is None else f"{ms:.2f}")
            cells = [precision, title or "**track-cpu**", *cells]
            lines.append("| " + " | ".join(cells) + " |")
    return lines


def paper_table():
    """Search passes per second of the paper's networks."""
    titles = [f"{title}, {threads(n)}" for title in PAPER_ENGINES for n in counts]
    lines = ["| | paper, 10 cores | " + " | ".join(titles) + " |"]
    lines.append("|---|" + "---|" * (1 + len(titles)))
    keys = [(net, *engine) for net in PAPER for engine in PAPER_ENGINES.values()]
    found = {n: medians(keys, n, set()) for n in counts}
    for net, (title, published) in PAPER.items():
        engines = [(net, *engine) for engine in PAPER_ENGINES.values()]
        cells = [f"{1e3 / found[n][engine]:.0f}" for engine in engines for n in counts]
        lines.append(f"| {title} | {published} | " + " | ".join(cells) + " |")
    return lines


def write(mark, lines):
    """Puts the lines between the marks of the document."""
    text = document.read_text()
    before, rest = text.split(f"<!-- {mark} -->\n", 1)
    after = rest.split(f"<!-- /{mark} -->", 1)[1]
    made = before + f"<!-- {mark} -->\n" + "\n".join(lines) + f"\n<!-- /{mark} -->" + after
    document.write_text(made)
    print("\n".join(lines), file=sys.stderr)


program = subprocess.check_output([track_cpu, "--version"], text=True).strip()
counts = [n for n in (1, 2, 4) if n <= os.cpu_count()]
write("table", peers_table())
write("paper", paper_table())
