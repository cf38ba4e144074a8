"""The tracker in the shape of pysot, which need not be installed.

    from track_cpu.pysot import Tracker

    tracker = Tracker()               # where build_tracker(model) stood in tools/test.py
    tracker.init(image, box)          # image: as cv2.imread has it; box: left, top, width, height
    output = tracker.track(image)     # {"bbox": [left, top, width, height], "best_score": score}
"""

from . import Tracker as _Tracker


class Tracker:
    """What pysot.tracker.base_tracker.BaseTracker has: init and track.

    The arguments are those of track_cpu.Tracker.
    """

    def __init__(self, model="drmim-p50", **options):
        self.tracker = _Tracker(model, **options)

    def init(self, img, bbox):
        """Takes the object within bbox (left, top, width, height) as the target."""
        self.tracker.init(img, bbox)

    def track(self, img):
        """The target in the next image: a dict of "bbox" and "best_score" (0 to 1)."""
        track = self.tracker(img)
        return {"bbox": list(track.box), "best_score": track.score}
