"""ROS where it is not installed: messages by their definitions, and a node without a network.

A message refuses fields that its definition does not have and values of other types, as the classes
that ROS generates do.
"""

import sys
import types
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
INTERFACES = Path(__file__).resolve().parents[2] / "track_cpu_interfaces"

# The definitions of ROS 2 Humble and later, without constants and comments.
DEFINITIONS = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id",
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/msg/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation",
    "geometry_msgs/msg/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance",
    "sensor_msgs/msg/Image": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n"
        "uint8 is_bigendian\nuint32 step\nuint8[] data"
    ),
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "vision_msgs/msg/BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y",
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox2D bbox\nstring id"
    ),
    "vision_msgs/msg/Detection2DArray": (
        "std_msgs/Header header\nvision_msgs/Detection2D[] detections"
    ),
}
NUMBERS = {"int32": int, "uint32": int, "uint8": int, "float32": float, "float64": float}
PLAIN = {**NUMBERS, "string": str, "bool": bool}


def without_comments(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return "\n".join(lines)


STATE = without_comments(INTERFACES / "msg" / "TargetState.msg")
DEFINITIONS["track_cpu_interfaces/msg/TargetState"] = STATE
REQUEST, RESPONSE = without_comments(INTERFACES / "srv" / "Start.srv").split("---\n")


class Message:
    FIELDS = {}

    def __init__(self, **values):
        for name, kind in self.FIELDS.items():
            setattr(self, name, values.pop(name) if name in values else kind[0]())
        assert not values, f"{type(self).__name__} has no {values}"

    def __setattr__(self, name, value):
        assert name in self.FIELDS, f"{type(self).__name__} has no {name}"
        expected = self.FIELDS[name][1]
        assert isinstance(value, expected), f"{name} is {value!r}, expected {expected}"
        super().__setattr__(name, value)


def message(name, definition, known):
    """The class of a definition: every field has a default and the type that it takes."""
    fields = {}
    for line in definition.strip().splitlines():
        kind, field = line.split()
        if kind in PLAIN:
            fields[field] = (PLAIN[kind], PLAIN[kind])
        elif kind == "uint8[]":
            fields[field] = (bytes, (bytes, np.ndarray))
        elif kind == "float64[36]":
            fields[field] = (lambda: np.zeros(36), np.ndarray)
        elif kind.endswith("[]"):
            fields[field] = (list, list)
        else:
            inner = known[kind.replace("/", "/msg/")]
            fields[field] = (inner, inner)
    return type(name, (Message,), {"FIELDS": fields})


class Publisher:
    def __init__(self, kind):
        self.kind = kind
        self.sent = []

    def publish(self, message):
        assert isinstance(message, self.kind)
        self.sent.append(message)


class Node:
    """What the node uses of rclpy.node.Node."""

    parameters = {}

    def __init__(self, name):
        self.name = name
        self.publishers_by_topic, self.callbacks, self.warnings = {}, {}, []

    def declare_parameter(self, name, default):
        value = self.parameters.get(name, default)
        assert type(value) is type(default), name
        return types.SimpleNamespace(value=value)

    def create_publisher(self, kind, topic, depth):
        publisher = self.publishers_by_topic[topic] = Publisher(kind)
        return publisher

    def create_subscription(self, kind, topic, callback, qos):
        self.callbacks[topic] = callback

    def create_service(self, kind, name, callback):
        self.callbacks[name] = lambda request: callback(request, kind.Response())

    def get_logger(self):
        return types.SimpleNamespace(warning=self.warnings.append)


def install_stand_ins():
    known = {}
    for name, definition in DEFINITIONS.items():
        package, _, short = name.split("/")
        known[name] = message(short, definition, known)
        for module in (package, f"{package}.msg"):
            sys.modules.setdefault(module, types.ModuleType(module))
        setattr(sys.modules[f"{package}.msg"], short, known[name])

    def service(module, name, request, response):
        parts = {
            "Request": message("Request", request, known),
            "Response": message("Response", response, known),
        }
        for part in (module, f"{module}.srv"):
            sys.modules.setdefault(part, types.ModuleType(part))
        setattr(sys.modules[f"{module}.srv"], name, types.SimpleNamespace(**parts))

    service("track_cpu_interfaces", "Start", REQUEST, RESPONSE)
    service("std_srvs", "Trigger", "", "bool success\nstring message")
    rclpy = types.ModuleType("rclpy")
    rclpy.node = types.ModuleType("rclpy.node")
    rclpy.node.Node = Node
    rclpy.qos = types.ModuleType("rclpy.qos")
    rclpy.qos.QoSProfile = lambda **settings: settings
    rclpy.qos.HistoryPolicy = types.SimpleNamespace(KEEP_LAST=1)
    rclpy.qos.ReliabilityPolicy = types.SimpleNamespace(BEST_EFFORT=2)
    sys.modules.update({"rclpy": rclpy, "rclpy.node": rclpy.node, "rclpy.qos": rclpy.qos})


# Always: the real node would need a running middleware. A robot's own test is `ros2 run`.
install_stand_ins()


@pytest.fixture
def node():
    from track_cpu_ros.node import TrackCpu

    Node.parameters = {"model": "drmim-p75"}
    return TrackCpu()
