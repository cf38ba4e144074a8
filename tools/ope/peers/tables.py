"""Scores the results of run.sh, on all sequences and on parts of them, into a Markdown document."""

import json
import os
import pathlib
import platform
import shutil
import subprocess
import sys

OPE, SEQUENCES, WORK, DOCUMENT = sys.argv[1], *map(pathlib.Path, sys.argv[2:])
MARKS = "<!-- peers -->", "<!-- /peers -->"
TITLES = {"track-cpu": "**track-cpu**", "authors": "DR-MIM, the authors' boxes", "NanoTrackV3": "NanoTrackV3"}
PEERS = ["track-cpu", "CSRT", "KCF", "MOSSE"]
if (WORK / "folder" / "NanoTrackV3").exists():
    PEERS.append("NanoTrackV3")


def score(sequences, results):
    """The scores of a folder of results on some sequences under the got10k rule."""
    part = WORK / "part"
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    for sequence in sequences:
        (part / sequence.name).symlink_to(sequence)
    command = [OPE, "score", "--dataset", "folder", "--root", part, "--results", results]
    done = subprocess.run(command + ["--convention", "got10k", "--json"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    if done.returncode:
        sys.exit(done.stderr.decode())
    return json.loads(done.stdout)


def meta(sequence):
    path = sequence / "meta.json"
    return json.loads(path.read_text()) if path.exists() else {}


def machine():
    """What the speeds were measured on, and how busy it was."""
    cpu = platform.machine()
    if (info := pathlib.Path("/proc/cpuinfo")).exists():
        names = [line.split(":", 1)[1].strip() for line in info.read_text().splitlines() if line.startswith("model name")]
        cpu = names[0] if names else cpu
    load = os.getloadavg()[0]
    return f"{cpu}, {os.cpu_count()} cores, load {load:.1f}" + (" (others were running: FPS is too low)" if load > 2 else "")


everything = sorted({pathlib.Path(folder) for folder, _, files in os.walk(SEQUENCES)
                     if any(name.lower().startswith("groundtruth") for name in files)}, key=lambda path: path.name)
clean = [sequence for sequence in everything if not meta(sequence).get("in_train")]
published = [sequence for sequence in everything if (sequence / "drmim_authors_result.txt").exists()]

authors = WORK / "folder" / "authors"
authors.mkdir(parents=True, exist_ok=True)
for sequence in published:
    shutil.copy(sequence / "drmim_authors_result.txt", authors / f"{sequence.name}.txt")

parts = [(f"all {len(everything)}", everything)]
if len(clean) < len(everything):
    parts.append((f"the {len(clean)} not trained on", clean))
if published:
    parts.append((f"the {len(published)} UAV clips with published boxes", published))
    both = [sequence for sequence in published if sequence in clean]
    if both != published:
        parts.append((f"the {len(both)} of these not trained on", both))

lines = ["| | " + " | ".join(title for title, _ in parts) + " | FPS |", "|---|" + "---|" * (len(parts) + 1)]
for tracker in PEERS + ["authors"] * bool(published):
    results = WORK / "folder" / tracker
    cells, fps = [], ""
    for _, sequences in parts:
        if any(not (results / f"{sequence.name}.txt").exists() for sequence in sequences):
            cells.append("")
            continue
        scores = score(sequences, results)
        cells.append(f"{scores['precision']:.1f} / {scores['auc']:.1f}")
        if scores["fps"] and sequences is everything:
            fps = f"{scores['fps']['frames_per_time']:.0f}"
    lines.append("| " + " | ".join([TITLES.get(tracker, f"OpenCV {tracker}"), *cells, fps]) + " |")
table = "\n".join(lines) + f"\n\nMeasured on {machine()}."
print("\nprecision@20 / AUC, rule got10k; FPS: frames / total time on one thread\n\n" + table)

folders = [WORK / "folder" / tracker for tracker in PEERS]
plots = WORK / "plots"
subprocess.run([OPE, "compare", "--dataset", "folder", "--root", SEQUENCES, "--out", plots, *folders], check=True,
               stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

if DOCUMENT.exists() and all(mark in (text := DOCUMENT.read_text()) for mark in MARKS):
    before, rest = text.split(MARKS[0])
    _, after = rest.split(MARKS[1])
    DOCUMENT.write_text(f"{before}{MARKS[0]}\n{table}\n{MARKS[1]}{after}")
    (DOCUMENT.parent / "plots").mkdir(exist_ok=True)
    for plot in ["success.svg", "speed.svg"]:
        shutil.copy(plots / plot, DOCUMENT.parent / "plots" / plot)
    print(f"\nwritten to {DOCUMENT}")
