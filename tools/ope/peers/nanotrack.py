"""NanoTrackV3 over one sequence, for `ope run --tracker`.

    ope run ... --tracker 'python nanotrack.py MODELS {frames} {init} {out} {times}'

MODELS holds nanotrack_backbone.onnx and nanotrack_head.onnx as HonglinChu/SiamTrackers publishes
them under NanoTrack/models/nanotrackv3. Needs numpy, onnx, onnxruntime and opencv-python-headless.
One thread; the clock runs during init and update only.

The network is theirs. Cropping and the choice of a box follow SiamRPN++ (Li et al., CVPR 2019) with
the constants of their configv3.yaml.
"""

import pathlib
import sys
import time

import cv2
import numpy as np
import onnx
import onnxruntime

TEMPLATE = 127  # side of the template crop in pixels
SEARCH = 255  # side of the search crop
STRIDE = 16  # pixels of the search crop per cell of the score map
CELLS = 15  # cells along a side of the score map
CONTEXT = 0.5  # context around the target, as a share of width + height
WINDOW = 0.455  # weight of the Hann window
PENALTY = 0.138  # strength of the penalty on changes of size and aspect
RATE = 0.348  # rate at which the size follows
LEAST_SIDE = 10  # least width and height of a box in pixels


def session(path):
    """A network on one thread. Both crops go through one backbone: its input has no fixed size."""
    model = onnx.load(path)
    for value in [*model.graph.input, *model.graph.output]:
        for axis in (2, 3):
            value.type.tensor_type.shape.dim[axis].dim_param = f"{value.name}_{axis}"
    del model.graph.value_info[:]
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])


def crop(image, center, side, size, fill):
    """A square of whole pixels around a center, padded with the mean color: [1, 3, size, size]."""
    half = (side + 1) / 2
    left, top = (int(np.floor(c - half + 0.5)) for c in center)
    height, width = image.shape[:2]
    pads = [max(0, -top), max(0, top + side - height), max(0, -left), max(0, left + side - width)]
    if any(pads):
        image = cv2.copyMakeBorder(image, *pads, cv2.BORDER_CONSTANT, value=fill)
    left, top = left + pads[2], top + pads[0]
    patch = image[top : top + side, left : left + side]
    if side != size:
        patch = cv2.resize(patch, (size, size))
    return np.ascontiguousarray(patch.transpose(2, 0, 1)[np.newaxis], dtype=np.float32)


class Tracker:
    def __init__(self, models):
        folder = pathlib.Path(models)
        self.backbone = session(folder / "nanotrack_backbone.onnx")
        self.head = session(folder / "nanotrack_head.onnx")
        self.window = np.outer(np.hanning(CELLS), np.hanning(CELLS)).ravel()
        steps = (np.arange(CELLS) - CELLS // 2) * STRIDE
        self.points = np.stack(np.meshgrid(steps, steps)).reshape(2, -1)

    def features(self, patch):
        return self.backbone.run(None, {"input": patch})[0]

    def context_side(self):
        return np.sqrt(np.prod(self.size + CONTEXT * self.size.sum()))

    def init(self, image, box):
        x, y, w, h = box
        self.center = np.array([x + (w - 1) / 2, y + (h - 1) / 2])
        self.size = np.array([w, h])
        # Their crop writes the mean color into bytes, which cuts off its fraction.
        self.fill = [int(value) for value in image.mean(axis=(0, 1))]
        side = round(float(self.context_side()))
        self.template = self.features(crop(image, self.center, side, TEMPLATE, self.fill))

    def update(self, image):
        context = self.context_side()
        scale = TEMPLATE / context
        side = round(float(context * SEARCH / TEMPLATE))
        search = self.features(crop(image, self.center, side, SEARCH, self.fill))
        scores, offsets = self.head.run(None, {"input1": self.template, "input2": search})
        scores = scores.reshape(2, -1).astype(np.float64)
        score = 1 / (1 + np.exp(scores[0] - scores[1]))
        left, top, right, bottom = offsets.reshape(4, -1).astype(np.float64)
        centers = self.points + np.stack([right - left, bottom - top]) / 2
        sides = np.stack([left + right, top + bottom])

        def ratio(change):
            return np.maximum(change, 1 / change)

        def padded(w, h):
            return np.sqrt((w + (w + h) / 2) * (h + (w + h) / 2))

        size_change = ratio(padded(*sides) / padded(*(self.size * scale)))
        aspect_change = ratio((self.size[0] / self.size[1]) / (sides[0] / sides[1]))
        penalty = np.exp(-(size_change * aspect_change - 1) * PENALTY)
        best = np.argmax(penalty * score * (1 - WINDOW) + self.window * WINDOW)

        rate = penalty[best] * score[best] * RATE
        height, width = image.shape[:2]
        limits = np.array([width, height])
        self.center = np.clip(self.center + centers[:, best] / scale, 0, limits)
        size = self.size * (1 - rate) + sides[:, best] / scale * rate
        self.size = np.clip(size, LEAST_SIDE, limits)
        return [*(self.center - self.size / 2), *self.size]


def main():
    models, frames, init, out, times = sys.argv[1:]
    cv2.setNumThreads(1)
    tracker = Tracker(models)
    box = [float(number) for number in init.split(",")]
    with open(frames) as file:
        paths = file.read().splitlines()
    with open(out, "w") as boxes, open(times, "w") as seconds:
        for i, path in enumerate(paths):
            image = cv2.imread(path)
            if image is None:
                sys.exit(f"{path}: cannot be read")
            start = time.perf_counter()
            if i == 0:
                tracker.init(image, box)
            else:
                box = tracker.update(image)
            seconds.write(f"{time.perf_counter() - start:.8f}\n")
            boxes.write(",".join(f"{value:.3f}" for value in box) + "\n")


main()
