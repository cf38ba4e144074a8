"""Follows one object through video on a CPU: the DR-MIM tracker with hand-written SIMD kernels.

    import cv2, track_cpu

    video = cv2.VideoCapture("flight.mp4")
    tracker = track_cpu.Tracker()
    tracker.init(video.read()[1], (300, 120, 40, 24))     # left, top, width, height in pixels
    while (image := video.read()[1]) is not None:
        ok, (x, y, w, h) = tracker.update(image)

Tracker stands where cv2.TrackerNano stood. FlightTracker also says whether the target is there:
its `ok` is False while the target is hidden or lost, and it finds the target again. Both share a
Model; `help(track_cpu.Tracker)` has shapes, units and errors.

| module | what is in it |
|---|---|
| track_cpu.got10k, track_cpu.pysot, track_cpu.pytracking | the tracker in these toolkits' shape |
| track_cpu.demo | a rendered flight, tracked |
| python -m track_cpu | the demo, or a video on the command line |
"""

import numpy  # noqa: F401 (the native module uses its C interface)

from ._native import (
    BELIEVED,
    FlightTracker,
    Model,
    ModelError,
    Tracker,
    __version__,
    builtin_models,
)
from ._results import Candidate, FlightTrack, Track

__all__ = [
    "BELIEVED",
    "Candidate",
    "FlightTrack",
    "FlightTracker",
    "Model",
    "ModelError",
    "Track",
    "Tracker",
    "__version__",
    "builtin_models",
]
