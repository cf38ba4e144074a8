"""Prints the toolkit's analysis of a workspace as a Markdown table: figures.py WORKSPACE"""

import glob
import json
import sys

with open(f"{sys.argv[1]}/analysis/latest.json") as file:
    report = json.load(file)
results = report["results"]


def analysis(experiment, name):
    """The result of one analysis for the first tracker."""
    names = [each["name"] for each in results[experiment]["parameters"]["analyses"]]
    return results[experiment]["results"][names.index(name)][0]


def seconds(experiment):
    """Seconds per frame as the toolkit's client measured them, reading of the pictures included."""
    times = []
    for path in glob.glob(f"{sys.argv[1]}/results/*/{experiment}/*/*_time.value"):
        with open(path) as file:
            times += [float(line) for line in file]
    return sorted(time for time in times if time > 0)


rows = []
for experiment, title in [("baseline", "multi-start"), ("supervised", "supervised")]:
    accuracy, robustness = analysis(experiment, "ar")[:2]
    if experiment == "supervised":
        robustness = f"{robustness:.2f} failures"
    else:
        robustness = f"{robustness:.3f}"
    rows.append((title, f"{accuracy:.3f}", robustness, f"{analysis(experiment, 'eao')[0]:.3f}"))
accuracy = analysis("realtime", "accuracy")[0]
while isinstance(accuracy, list):
    accuracy = accuracy[0]
rows.append(("realtime, 20 frames a second", f"{accuracy:.3f}", "", ""))
curve = analysis("longterm", "prc")[0]
f, precision, recall = max((2 * p * r / (p + r) if p + r else 0, p, r) for r, p in curve)
rows.append(("long-term", f"precision {precision:.3f}", f"recall {recall:.3f}", f"F {f:.3f}"))

sequences = report["sequences"]
frames = sum(sequence["length"] for sequence in sequences.values())
times = seconds("longterm")
median = times[len(times) // 2]
print(f"\n{len(sequences)} sequences, {frames} frames; {1000 * median:.1f} ms a frame (median, at the client)\n")
print("| experiment | accuracy | robustness | EAO |\n|---|---|---|---|")
for row in rows:
    print("| " + " | ".join(row) + " |")
