"""Messages of the type sensor_msgs/Image as arrays, and their times."""

import numpy as np

# Encoding: bytes per pixel, and whether the colors run from blue to red.
ENCODINGS = {
    "bgr8": (3, True),
    "rgb8": (3, False),
    "bgra8": (4, True),
    "rgba8": (4, False),
    "mono8": (1, True),
    "8UC1": (1, True),
    "8UC3": (3, True),
    "8UC4": (4, True),
}


def array(message):
    """The pixels as an array of uint8 in the order BGR, without a copy: (H, W) or (H, W, 3).

    Raises ValueError for another encoding, or if the sizes do not agree.
    """
    if message.encoding not in ENCODINGS:
        known = ", ".join(ENCODINGS)
        raise ValueError(f"encoding is {message.encoding!r}, expected one of {known}")
    channels, is_bgr = ENCODINGS[message.encoding]
    height, width, step = message.height, message.width, message.step
    row = width * channels
    if height < 1 or width < 1 or step < row:
        found = f"{width} x {height} pixels with a step of {step}"
        raise ValueError(f"image has {found}, expected at least {row} bytes a row")
    data = np.frombuffer(message.data, np.uint8)
    needed = (height - 1) * step + row
    if len(data) < needed:
        raise ValueError(f"image has {len(data)} bytes, expected {needed}")
    shape, strides = (height, width, channels), (step, channels, 1)
    pixels = np.lib.stride_tricks.as_strided(data[:needed], shape, strides, writeable=False)
    if channels == 1:
        return pixels[..., 0]
    return pixels[..., :3] if is_bgr else pixels[..., 2::-1]


def seconds(message):
    """The time at which an image was taken; None if its publisher does not say."""
    stamp = message.header.stamp
    return stamp.sec + 1e-9 * stamp.nanosec or None
