"""Our tracker in the place of cv2.TrackerNano: one loop, both trackers, boxes and times compared.

    beside_opencv.py [VIDEO --init X,Y,W,H] [--nano FOLDER] [--model NAME]

VIDEO is a video file or a folder of images; without it, a rendered flight is tracked, whose true
boxes are known. FOLDER holds nanotrack_backbone*.onnx and nanotrack_head*.onnx: versions 1 and 2 of
HonglinChu/SiamTrackers, folder NanoTrack/models (OpenCV cannot use version 3).

Each tracker uses one thread. The clock runs during init and update only.
"""

import argparse
import statistics
import sys
import time
from pathlib import Path

import track_cpu
from track_cpu import _frames
from track_cpu.demo import LEAST_VISIBLE, Flight, iou


def ours(model):
    return track_cpu.Tracker(model)


def opencvs(folder):
    """A cv2.TrackerNano, or the reason why there is none."""
    try:
        import cv2
    except ImportError:
        return "opencv-python is not installed"
    if folder is None:
        return "no --nano FOLDER"
    if not hasattr(cv2, "TrackerNano_create"):
        return f"OpenCV {cv2.__version__} has no TrackerNano"
    parameters = cv2.TrackerNano_Params()
    for name, field in (("backbone", "backbone"), ("head", "neckhead")):
        files = sorted(Path(folder).glob(f"nanotrack_{name}*.onnx"))
        if not files:
            return f"{folder} has no nanotrack_{name}*.onnx"
        setattr(parameters, field, str(files[0]))
    cv2.setNumThreads(1)
    return cv2.TrackerNano_create(parameters)


def follow(tracker, pictures, box):
    """What a program does with either tracker: the boxes, and the seconds of each picture."""
    boxes, seconds = [], []
    for index, picture in enumerate(pictures()):
        started = time.perf_counter()
        if index == 0:
            tracker.init(picture, tuple(map(round, box)))
        else:
            _, box = tracker.update(picture)
        seconds.append(time.perf_counter() - started)
        boxes.append(box)
    return boxes, seconds


def rendered(frames):
    """The pictures of a rendered flight as a function, and its true boxes; None where hidden."""
    flight = Flight(frames)
    truths = []
    for index in range(frames):
        _, box, visible = flight[index]
        truths.append(box if visible > LEAST_VISIBLE else None)

    def pictures():
        for index in range(frames):
            yield flight[index][0][..., ::-1].copy()

    return pictures, truths


def mean_iou(boxes, others):
    overlaps = [iou(a, b) for a, b in zip(boxes[1:], others[1:]) if b is not None]
    return statistics.fmean(overlaps) if overlaps else float("nan")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("video", nargs="?")
    parser.add_argument("--init", type=lambda text: tuple(map(float, text.split(","))))
    parser.add_argument("--nano", metavar="FOLDER")
    parser.add_argument("--model", default="drmim-p50")
    parser.add_argument("--frames", type=int, default=100, help="of the rendered flight")
    args = parser.parse_args()

    if args.video is None:
        pictures, truths = rendered(args.frames)
        init = truths[0]
    elif args.init is None or len(args.init) != 4:
        parser.error("--init X,Y,W,H says where the object is in the first picture")
    else:
        init, truths = args.init, None

        def pictures():
            return _frames.read(args.video)

    print(f"{'tracker':20} {'frames':>6} {'median ms':>9} {'FPS':>6}  mean IoU")
    found = []
    for name, make in (
        (f"track_cpu {args.model}", lambda: ours(args.model)),
        ("cv2.TrackerNano", lambda: opencvs(args.nano)),
    ):
        tracker = make()
        if isinstance(tracker, str):
            print(f"skipped: {name}: {tracker}")
            continue
        boxes, seconds = follow(tracker, pictures, init)
        if len(boxes) < 2:
            sys.exit("a video needs at least two pictures")
        found.append(boxes)
        median = 1e3 * statistics.median(seconds[1:])
        fps = (len(seconds) - 1) / sum(seconds[1:])
        known = f"{mean_iou(boxes, truths):.3f} with the truth" if truths else ""
        print(f"{name:20} {len(boxes):6} {median:9.2f} {fps:6.1f}  {known}")
    if len(found) == 2:
        print(f"mean IoU of both: {mean_iou(*found):.3f}")


if __name__ == "__main__":
    main()
