"""The network's search pass as ONNX with random weights, at several widths, for other engines.

The graph is what runs once per frame: SiamFC++-AlexNet for one crop of 303 x 303, with the template
features as constant kernels of the two depthwise correlations. A name that ends in "+encoder" has
DR-MIM's encoder E2 behind the backbone. Speed depends on shapes alone.
"""

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

WIDTHS = {
    "half": (48, 128, 192, 192, 128, 128),  # drmim-p50
    "full": (96, 256, 384, 384, 256, 256),
    "small": (24, 64, 96, 96, 64, 64),  # drmim-p75
}
SIDE = 303


def crop(seed):
    """An input of the network, [1, 3, 303, 303]."""
    return np.random.default_rng(seed).normal(0, 1, (1, 3, SIDE, SIDE)).astype(np.float32)


class Builder:
    """Collects nodes. Every method returns its output's name and shape."""

    def __init__(self):
        self.nodes, self.constants, self.macs = [], [], 0
        self.random = np.random.default_rng(7)

    def constant(self, name, array):
        self.constants.append(numpy_helper.from_array(array.astype(np.float32), name))
        return name

    def node(self, kind, inputs, name, **attributes):
        self.nodes.append(helper.make_node(kind, inputs, [name], name=name, **attributes))
        return name

    def conv(self, name, source, shape, stride=1, relu=True, pad=0):
        (channels, side), out, kernel = shape
        deviation = np.sqrt((2 if relu else 1) / (channels * kernel**2))
        weights = self.random.normal(0, deviation, (out, channels, kernel, kernel))
        bias = self.random.normal(0, 0.05, out)
        inputs = [source, self.constant(f"{name}.w", weights), self.constant(f"{name}.b", bias)]
        sizes = {"kernel_shape": [kernel] * 2, "strides": [stride] * 2, "pads": [pad] * 4}
        made = self.node("Conv", inputs, name, **sizes)
        side = (side + 2 * pad - kernel) // stride + 1
        self.macs += side**2 * out * channels * kernel**2
        return (self.node("Relu", [made], f"{name}.relu") if relu else made), (out, side)

    def correlation(self, name, source, shape, kernel=4):
        channels, side = shape
        template = self.random.normal(0, 0.25, (channels, 1, kernel, kernel))
        weights = self.constant(f"{name}.w", template)
        made = self.node("Conv", [source, weights], name, kernel_shape=[kernel] * 2, group=channels)
        side -= kernel - 1
        self.macs += side**2 * channels * kernel**2
        return made, (channels, side)

    def pool(self, name, source, shape):
        channels, side = shape
        ceil = (side - 3) % 2
        sizes = {"kernel_shape": [3, 3], "strides": [2, 2], "ceil_mode": ceil}
        return self.node("MaxPool", [source], name, **sizes), (channels, (side - 3 + ceil) // 2 + 1)


def tensor(name, shape):
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, shape)


def search_pass(name):
    """The model and its multiply-accumulates, for one of `WIDTHS`, with "+encoder" or without."""
    widths, _, encoder = name.partition("+")
    c1, c2, c3, c4, c5, neck = WIDTHS[widths]
    build = Builder()
    at, size = build.conv("conv1", "x", ((3, SIDE), c1, 11), stride=2)
    at, size = build.pool("pool1", at, size)
    at, size = build.conv("conv2", at, (size, c2, 5))
    at, size = build.pool("pool2", at, size)
    at, size = build.conv("conv3", at, (size, c3, 3))
    at, size = build.conv("conv4", at, (size, c4, 3))
    features, shape = build.conv("conv5", at, (size, c5, 3), relu=False)
    if encoder:
        features, shape = build.conv("encoder", features, (shape, c5, 3), pad=1)
    towers = []
    for task in ("cls", "reg"):
        at, size = build.conv(f"neck.{task}", features, (shape, neck, 3), relu=False)
        at, size = build.correlation(f"correlation.{task}", at, size)
        for layer in (1, 2, 3):
            at, size = build.conv(f"head.{task}{layer}", at, (size, neck, 3))
        towers.append(at)
    score, _ = build.conv("score", towers[0], (size, 1, 1), relu=False)
    centerness, _ = build.conv("centerness", towers[0], (size, 1, 1), relu=False)
    offsets, _ = build.conv("offsets", towers[1], (size, 4, 1), relu=False)
    factors = [build.node("Sigmoid", [value], f"{value}.p") for value in (score, centerness)]
    outputs = [build.node("Mul", factors, "scores"), build.node("Exp", [offsets], "ltrb")]
    side = size[1]
    graph = helper.make_graph(
        build.nodes,
        "search",
        [tensor("x", [1, 3, SIDE, SIDE])],
        [tensor(name, [1, n, side, side]) for name, n in zip(outputs, (1, 4))],
        build.constants,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    onnx.checker.check_model(model)
    return model, build.macs
