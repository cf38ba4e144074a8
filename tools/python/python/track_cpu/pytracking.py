"""The tracker in the shape of pytracking, which need not be installed.

Two files make it known there, pytracking/tracker/track_cpu/__init__.py:

    from track_cpu.pytracking import Tracker

    def get_tracker_class():
        return Tracker

and pytracking/parameter/track_cpu/default.py:

    from pytracking.utils import TrackerParams

    def parameters():
        return TrackerParams()        # attributes model, precision, threads, as_published are used
"""

from . import Tracker as _Tracker


class Tracker:
    """What pytracking's evaluation calls: initialize and track, on RGB images.

    `params` may have the attributes model, precision, threads and as_published, whose meaning is
    that of track_cpu.Tracker.
    """

    multiobj_mode = "parallel"  # one tracker for each target of a sequence or video

    def __init__(self, params=None):
        self.params = params
        names = ("model", "precision", "threads", "as_published")
        options = {name: getattr(params, name) for name in names if hasattr(params, name)}
        self.tracker = _Tracker(order="rgb", **options)
        self.visdom = None

    def initialize(self, image, info):
        """Takes the object within info["init_bbox"] (left, top, width, height) as the target."""
        self.tracker.init(image, info["init_bbox"])
        return {}

    def track(self, image, info=None):
        """The target in the next image: a dict of "target_bbox", left, top, width, height."""
        _, box = self.tracker.update(image)
        return {"target_bbox": list(box)}
