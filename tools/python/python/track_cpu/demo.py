"""A rendered flight, tracked: what `track-cpu demo` tracks.

    from track_cpu import demo
    print(demo.run(frames=100))
"""

import time
from typing import Literal, NamedTuple, Union

from . import FlightTracker, Tracker
from ._native import Flight

__all__ = ["Flight", "Summary", "iou", "run"]

# A picture counts if more of the target than this is seen.
LEAST_VISIBLE = 0.3


class Summary(NamedTuple):
    """How well and how fast a flight was tracked."""

    mean_iou: float  # over the pictures after the first in which the target is seen
    fps: float  # pictures per second of tracking, without rendering
    frames: int


def iou(a, b) -> float:
    """Intersection over union of two boxes (left, top, width, height), 0 to 1."""
    w = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    h = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    shared = max(w, 0) * max(h, 0)
    union = a[2] * a[3] + b[2] * b[3] - shared
    return shared / union if union > 0 else 0.0


def run(
    frames: int = 300,
    *,
    seed: int = 7,
    difficulty: Literal["easy", "medium", "hard"] = "easy",
    tracker: Union[Tracker, FlightTracker, None] = None,
) -> Summary:
    """Tracks a rendered flight from its first true box; `tracker` must have order="rgb".

    Raises ValueError for fewer than two frames, another difficulty or another order.
    """
    if frames < 2:
        raise ValueError(f"frames is {frames}, expected at least 2")
    tracker = Tracker(order="rgb") if tracker is None else tracker
    if tracker.order != "rgb":
        raise ValueError(f'order is "{tracker.order}", expected "rgb": that of the pictures')
    flight = Flight(frames, seed=seed, difficulty=difficulty)
    overlaps = []
    seconds = 0.0
    for index in range(frames):
        image, truth, visible = flight[index]
        if index == 0:
            tracker.init(image, truth)
            continue
        started = time.perf_counter()
        _, box = tracker.update(image)
        seconds += time.perf_counter() - started
        if visible > LEAST_VISIBLE:
            overlaps.append(iou(box, truth))
    mean = sum(overlaps) / len(overlaps) if overlaps else 0.0
    return Summary(mean, (frames - 1) / seconds, frames)
