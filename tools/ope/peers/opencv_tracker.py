"""One of OpenCV's trackers over one sequence, for `ope run --tracker`.

    ope run ... --tracker 'python opencv_tracker.py KCF {frames} {init} {out} {times}'

KCF and CSRT are in opencv-contrib-python, MOSSE in its legacy part. One thread; the clock runs
during init and update only. When a tracker reports a loss, its last box is written again.
"""

import sys
import time

import cv2

MAKERS = {
    "KCF": lambda: cv2.TrackerKCF_create(),
    "CSRT": lambda: cv2.TrackerCSRT_create(),
    "MOSSE": lambda: cv2.legacy.TrackerMOSSE_create(),
}


def main():
    name, frames, init, out, times = sys.argv[1:]
    cv2.setNumThreads(1)
    tracker = MAKERS[name]()
    box = tuple(map(float, init.split(",")))
    with open(frames) as file:
        paths = file.read().splitlines()
    with open(out, "w") as boxes, open(times, "w") as seconds:
        for i, path in enumerate(paths):
            image = cv2.imread(path)
            if image is None:
                sys.exit(f"{path}: cannot be read")
            start = time.perf_counter()
            if i == 0:
                # The new interface takes whole pixels, the legacy one does not mind.
                tracker.init(image, tuple(max(1, round(v)) if k > 1 else round(v) for k, v in enumerate(box)))
            else:
                found, new = tracker.update(image)
                if found:
                    box = new
            seconds.write(f"{time.perf_counter() - start:.8f}\n")
            boxes.write(",".join(f"{v:.3f}" for v in box) + "\n")


main()
