"""The node over a rendered flight, as a robot's other nodes see it."""

import numpy as np
import pytest
from conftest import DEFINITIONS
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger
from track_cpu.demo import Flight, iou
from track_cpu_interfaces.srv import Start
from track_cpu_ros import images
from track_cpu_ros.node import centered, corners

FLIGHT = Flight(8, width=320, height=200)


def image(index, encoding="rgb8", gap=0):
    """A picture of the flight as a message, 40 ms after the one before."""
    pixels = FLIGHT[index][0]
    channels, is_bgr = images.ENCODINGS[encoding]
    if channels == 4:
        pixels = np.dstack([pixels, np.full(pixels.shape[:2], 255, np.uint8)])
    if channels == 1:
        pixels = pixels[..., :1]
    elif is_bgr:
        pixels[..., :3] = pixels[..., 2::-1].copy()
    height, width = pixels.shape[:2]
    rows = pixels.reshape(height, -1)
    rows = np.hstack([rows, np.zeros((height, gap), np.uint8)])
    made = Image(height=height, width=width, encoding=encoding, step=rows.shape[1])
    made.data = rows.tobytes()
    made.header.frame_id = "camera"
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(10**9 + 40_000_000 * index, 10**9)
    return made


def start(node, box):
    return node.callbacks["~/start"](Start.Request(box=centered(box)))


def sent(node, topic):
    return node.publishers_by_topic[topic].sent


def test_flight_is_followed_in_detections_and_states(node):
    node.callbacks["image"](image(0))
    answer = start(node, FLIGHT[0][1])
    for index in range(1, 8):
        node.callbacks["image"](image(index))

    assert answer.success, answer.message
    states = sent(node, "~/state")
    assert [state.state for state in states] == ["idle"] + 7 * ["tracking"]
    last, found = states[-1], sent(node, "~/detections")[-1]
    assert last.believed and last.presence > 0.4 and last.header.frame_id == "camera"
    assert found.header.stamp.nanosec == image(7).header.stamp.nanosec
    (detection,) = found.detections
    assert iou(corners(detection.bbox), FLIGHT[7][1]) > 0.7
    assert detection.results[0].hypothesis.class_id == "target"
    assert detection.results[0].hypothesis.score == last.presence


@pytest.mark.parametrize("encoding", ["bgr8", "rgba8", "bgra8", "8UC3"])
@pytest.mark.parametrize("gap", [0, 5])
def test_encodings_and_steps_show_the_same_picture(encoding, gap):
    expected = images.array(image(1))

    pixels = images.array(image(1, encoding, gap))

    assert (pixels == expected).all() and pixels.base is not None


def test_gray_image_has_two_dimensions():
    assert images.array(image(1, "mono8", gap=3)).shape == (200, 320)


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"encoding": "bayer_rggb8"}, "encoding is 'bayer_rggb8', expected one of bgr8"),
        ({"step": 959}, "expected at least 960 bytes a row"),
        ({"height": 201}, "192000 bytes, expected 192960"),
        ({"height": 2**32 - 1, "width": 2**32 - 1}, "expected at least"),
        ({"height": 0}, "320 x 0 pixels"),
        ({"data": b""}, "0 bytes"),
    ],
)
def test_image_that_is_none_is_refused_and_said_once(node, changes, words):
    bad = image(1)
    for name, value in changes.items():
        setattr(bad, name, value)
    with pytest.raises(ValueError, match=words):
        images.array(bad)

    node.callbacks["image"](image(0))
    assert start(node, FLIGHT[0][1]).success
    node.callbacks["image"](bad)
    node.callbacks["image"](bad)
    node.callbacks["image"](image(1))

    assert len(node.warnings) == 1 and words.split(",")[0] in node.warnings[0]
    assert len(sent(node, "~/state")) == 2 and sent(node, "~/state")[-1].believed


def test_start_without_image_or_outside_it_fails_and_says_why(node):
    early = start(node, FLIGHT[0][1])
    node.callbacks["image"](image(0))
    outside = start(node, (900.0, 20.0, 30.0, 30.0))

    assert not early.success and early.message == "no image has arrived"
    assert not outside.success and "outside the 320x200 frame" in outside.message
    node.callbacks["image"](image(1))
    assert sent(node, "~/state")[-1].state == "idle"


def test_stop_forgets_the_target(node):
    node.callbacks["image"](image(0))
    assert start(node, FLIGHT[0][1]).success

    stopped = node.callbacks["~/stop"](Trigger.Request())
    again = node.callbacks["~/stop"](Trigger.Request())
    node.callbacks["image"](image(1))

    assert stopped.success and not again.success and again.message == "no target"
    assert sent(node, "~/state")[-1].state == "idle"
    assert sent(node, "~/detections")[-1].detections == []


def test_time_between_images_is_that_of_their_stamps(node, monkeypatch):
    node.callbacks["image"](image(0))
    assert start(node, FLIGHT[0][1]).success
    times = []

    class Recorder:
        track = object()

        def __call__(self, pixels, elapsed=None):
            times.append(elapsed)
            return tracker(pixels, elapsed=elapsed)

    tracker, node.tracker = node.tracker, Recorder()
    unstamped = image(3)
    unstamped.header.stamp.sec = unstamped.header.stamp.nanosec = 0
    for message in (image(2), image(1), unstamped, image(4), image(5)):
        node.callbacks["image"](message)

    assert times == [pytest.approx(0.08), None, None, None, pytest.approx(0.04)]


def test_definitions_are_those_of_ros():
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags is not installed")
    real = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE).fielddefs

    for name, definition in DEFINITIONS.items():
        if name in real:
            fields = [line.split()[1] for line in definition.strip().splitlines()]
            assert fields == [field for field, _ in real[name][1]], name
