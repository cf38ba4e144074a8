"""The tracker in the shape of the got10k toolkit, which need not be installed.

    from got10k.experiments import ExperimentDTB70
    from track_cpu.got10k import Tracker

    experiment = ExperimentDTB70("/data/DTB70")
    tracker = Tracker()
    experiment.run(tracker)
    experiment.report([tracker.name])

The toolkit's boxes go to the tracker as they are.
"""

import time

import numpy as np

from . import Tracker as _Tracker


class Tracker:
    """What got10k.trackers.Tracker has: name, is_deterministic, init, update and track.

    `name` is the folder of the results. The other arguments are those of track_cpu.Tracker.
    """

    is_deterministic = True

    def __init__(self, model="drmim-p50", *, name="track-cpu", **options):
        self.name = name
        self.tracker = _Tracker(model, **options)

    def init(self, image, box):
        """Takes the object within box (left, top, width, height) as the target.

        `image` is a PIL image, as the toolkit gives it, or an array as track_cpu.Tracker takes it.
        """
        self.tracker.init(image, box)

    def update(self, image):
        """The target's box in the next image: an array (4,) of left, top, width, height."""
        _, box = self.tracker.update(image)
        return np.array(box)

    def track(self, img_files, box, visualize=False):
        """Tracks a list of image files: boxes (N, 4), and seconds (N,) without reading.

        The first box is the one given. `visualize` is not supported: ValueError.
        """
        from PIL import Image

        if visualize:
            raise ValueError("visualize is True, expected False: this adapter has no window")
        boxes = np.zeros((len(img_files), 4))
        times = np.zeros(len(img_files))
        for index, path in enumerate(img_files):
            with Image.open(path) as file:
                image = np.asarray(file.convert("RGB"))
            if self.tracker.order == "bgr":
                image = image[..., ::-1]  # the same bytes, read the other way
            started = time.perf_counter()
            if index == 0:
                self.init(image, box)
                boxes[index] = box
            else:
                boxes[index] = self.update(image)
            times[index] = time.perf_counter() - started
        return boxes, times
