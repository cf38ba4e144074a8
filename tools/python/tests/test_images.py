"""Pictures: every layout of an array, copied only where needed; PIL images; what is none."""

import tracemalloc

import numpy as np
import pytest
import track_cpu
from conftest import HEIGHT, WIDTH, follow


def padded(picture):
    """The same picture within a larger one."""
    around = np.full((HEIGHT + 9, WIDTH + 17, 3), 77, np.uint8)
    around[4 : 4 + HEIGHT, 8 : 8 + WIDTH] = picture
    return around[4 : 4 + HEIGHT, 8 : 8 + WIDTH]


def with_alpha(picture):
    alpha = np.full((HEIGHT, WIDTH, 1), 99, np.uint8)
    return np.ascontiguousarray(np.concatenate([picture, alpha], axis=2))


def every_second_row(picture):
    doubled = np.repeat(picture, 2, axis=0)
    return doubled[::2]


def every_second_column(picture):
    doubled = np.repeat(picture, 2, axis=1)
    return doubled[:, ::2]


def read_only(picture):
    return np.frombuffer(picture.tobytes(), np.uint8).reshape(picture.shape)


def flipped_twice(picture):
    return np.ascontiguousarray(picture[::-1, ::-1])[::-1, ::-1]


def planes(picture):
    return np.ascontiguousarray(picture.transpose(2, 0, 1)).transpose(1, 2, 0)


LENT = [
    ("contiguous", "bgr", lambda picture: picture),
    ("cut-out", "bgr", padded),
    ("reversed channels", "rgb", lambda picture: picture[..., ::-1]),
    ("reversed channels of a cut-out", "rgb", lambda picture: padded(picture)[..., ::-1]),
    ("copied RGB", "rgb", lambda picture: np.ascontiguousarray(picture[..., ::-1])),
    ("four channels", "bgr", with_alpha),
    ("three of four channels", "bgr", lambda picture: with_alpha(picture)[..., :3]),
    ("three of four, reversed", "rgb", lambda picture: with_alpha(picture)[..., 2::-1]),
    ("every second row", "bgr", every_second_row),
    ("read-only memory", "bgr", read_only),
]
COPIED = [
    ("every second column", "bgr", every_second_column),
    ("mirrored", "bgr", flipped_twice),
    ("planes", "bgr", planes),
    ("Fortran order", "bgr", np.asfortranarray),
]


@pytest.mark.parametrize("name, order, form", LENT + COPIED, ids=lambda value: str(value)[:32])
def test_boxes_do_not_depend_on_the_layout(model, pictures, box, boxes, name, order, form):
    tracker = track_cpu.Tracker(model, order=order)
    few = [form(picture) for picture in pictures[:6]]

    assert follow(tracker, few, box) == boxes[:5], name


@pytest.mark.parametrize("is_copied, cases", [(False, LENT), (True, COPIED)])
def test_only_layouts_that_no_frame_has_are_copied(model, pictures, box, is_copied, cases):
    for name, order, form in cases:
        picture = form(pictures[0])
        tracker = track_cpu.Tracker(model, order=order)
        tracker.init(picture, box)

        tracemalloc.start()
        tracker.update(picture)
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()

        assert (most >= picture.nbytes) == is_copied, f"{name}: {most} bytes"


def test_gray_is_the_same_as_three_equal_channels(model, pictures, box):
    gray = [picture[..., 1].copy() for picture in pictures[:6]]
    expected = follow(
        track_cpu.Tracker(model), [np.repeat(g[..., None], 3, axis=2) for g in gray], box
    )

    for form in (
        lambda g: g,
        lambda g: g[..., None],
        lambda g: np.repeat(g, 2, axis=0)[::2],
        lambda g: np.repeat(g, 2, axis=1)[:, ::2],
    ):
        assert follow(track_cpu.Tracker(model), [form(g) for g in gray], box) == expected


def test_one_channel_of_a_view_is_that_channel(model, pictures, box):
    channel = [picture[..., 2] for picture in pictures[:4]]
    expected = follow(track_cpu.Tracker(model), [c.copy() for c in channel], box)

    assert follow(track_cpu.Tracker(model), channel, box) == expected


def yuv(picture, order):
    """A picture in YUV (BT.601, limited range, the corner's chroma), and the same in BGR."""
    blue, green, red = (picture[..., channel].astype(float) for channel in range(3))
    luma = 16 + (65.5 * red + 128.6 * green + 25 * blue) / 255
    u = 128 + (-37.8 * red - 74.2 * green + 112 * blue) / 255
    v = 128 + (112 * red - 93.8 * green - 18.2 * blue) / 255
    down = 1 if order in ("yuyv", "uyvy") else 2
    y, u, v = (
        plane.round().astype(np.uint8) for plane in (luma, u[::down, ::2], v[::down, ::2])
    )
    whole_u, whole_v = (
        plane.repeat(2, axis=1).repeat(down, axis=0).astype(int) - 128 for plane in (u, v)
    )
    light = 298 * (y.astype(int) - 16) + 128
    bgr = [light + 516 * whole_u, light - 100 * whole_u - 208 * whole_v, light + 409 * whole_v]
    bgr = (np.stack(bgr, axis=2) >> 8).clip(0, 255).astype(np.uint8)
    pairs = {"nv12": (u, v), "nv21": (v, u)}
    if order in pairs:
        chroma = np.stack(pairs[order], axis=2).reshape(len(u), -1)
        return np.concatenate([y, chroma]), bgr
    if order == "i420":
        return np.concatenate([y.ravel(), u.ravel(), v.ravel()]).reshape(-1, y.shape[1]), bgr
    chroma = np.stack([u, v], axis=2).reshape(y.shape)
    return np.stack([y, chroma] if order == "yuyv" else [chroma, y], axis=2), bgr


@pytest.mark.parametrize("order", ["nv12", "nv21", "i420", "yuyv", "uyvy"])
def test_yuv_gives_the_boxes_of_the_converted_pictures(model, pictures, box, order):
    few = [yuv(picture, order) for picture in pictures[:5]]
    expected = follow(track_cpu.Tracker(model), [bgr for _, bgr in few], box)

    def padded(array):
        around = np.full((len(array), array.shape[1] + 6, *array.shape[2:]), 77, np.uint8)
        around[:, : array.shape[1]] = array
        return around[:, : array.shape[1]]

    for form in (lambda array: array, padded):
        tracker = track_cpu.Tracker(model, order=order)
        assert tracker.order == order
        assert follow(tracker, [form(array) for array, _ in few], box) == expected


@pytest.mark.parametrize(
    "order, shape",
    [
        ("nv12", (100, 64)),
        ("nv12", (96, 63)),
        ("i420", (1, 64)),
        ("nv21", (96, 64, 3)),
        ("yuyv", (64, 64)),
        ("uyvy", (64, 63, 2)),
        ("bgr", (64, 64, 2)),
    ],
)
def test_shape_that_no_picture_has_is_refused(model, order, shape):
    with pytest.raises(ValueError, match="expected"):
        track_cpu.Tracker(model, order=order).init(np.zeros(shape, np.uint8), (8, 8, 16, 16))


def test_order_matters(model, pictures, box, boxes):
    assert follow(track_cpu.Tracker(model, order="rgb"), pictures, box) != boxes


def test_sides_of_one_pixel_are_taken(model, pictures, box):
    tracker = track_cpu.Tracker(model)
    tracker.init(pictures[0], box)
    for shape in [(1, 200, 3), (200, 1, 3), (1, 1), (1, 1, 4), (2, 1, 1)]:
        ok, found = tracker.update(np.zeros(shape, np.uint8)[..., ::1])
        assert ok and np.isfinite(found).all(), shape
        columns = np.zeros((shape[0], 5 * shape[1], *shape[2:]), np.uint8)[:, ::5]
        ok, found = tracker.update(columns)
        assert ok and np.isfinite(found).all(), shape


def test_size_may_change(model, pictures, box):
    tracker = track_cpu.Tracker(model)
    tracker.init(pictures[0], box)

    _, found = tracker.update(np.repeat(np.repeat(pictures[0], 2, axis=0), 2, axis=1))

    assert found[2] == pytest.approx(2 * box[2], rel=0.3)


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L"])
def test_pil_image_is_rgb_whatever_the_order(model, pictures, box, mode):
    Image = pytest.importorskip("PIL.Image", reason="pillow is not installed")
    images = [Image.fromarray(picture[..., ::-1].copy()).convert(mode) for picture in pictures[:4]]
    arrays = [np.asarray(image) for image in images]
    expected = follow(track_cpu.Tracker(model, order="rgb"), arrays, box)

    for order in ("bgr", "rgb"):
        assert follow(track_cpu.Tracker(model, order=order), images, box) == expected


@pytest.mark.parametrize("mode", ["P", "1", "CMYK", "YCbCr", "HSV", "I", "F", "LA", "I;16"])
def test_pil_image_of_another_mode_is_refused(model, mode):
    Image = pytest.importorskip("PIL.Image", reason="pillow is not installed")

    with pytest.raises(ValueError, match=f"mode {mode}, expected .*convert"):
        track_cpu.Tracker(model).init(Image.new(mode, (64, 48)), (1, 2, 30, 20))


class Interface:
    """What is no array, but says how to make one."""

    def __init__(self, array):
        self.array = array

    @property
    def __array_interface__(self):
        return self.array.__array_interface__


def test_object_with_an_array_interface_is_taken(model, pictures, box, boxes):
    objects = [Interface(picture) for picture in pictures[:4]]

    assert follow(track_cpu.Tracker(model), objects, box) == boxes[:3]


@pytest.mark.parametrize(
    "image, words",
    [
        (None, "image is None, expected a NumPy array.*OpenCV gives None"),
        ("frame.png", "image is a str, expected a NumPy array"),
        (b"\0" * 3072, "image is a bytes, expected"),
        ([[1, 2], [3, 4]], "image is a list, expected"),
        (7, "image is a int, expected"),
        (np.zeros((48, 64, 3), np.float32), "an array of float32, expected.*uint8.*255"),
        (np.zeros((48, 64, 3), np.uint16), "an array of uint16, expected"),
        (np.zeros((48, 64, 3), np.int8), "an array of int8, expected"),
        (np.zeros((48, 64, 3), bool), "an array of bool, expected"),
        (np.zeros((48, 64), object), "an array of object, expected"),
        (np.zeros((48, 64, 3), ">u2"), "an array of >u2, expected"),
        (Interface(np.zeros((48, 64), np.float64)), "an array of float64, expected"),
        (np.zeros((3, 48, 64), np.uint8), r"shape \[3, 48, 64\], expected"),
        (np.zeros((48, 64, 2), np.uint8), r"shape \[48, 64, 2\], expected"),
        (np.zeros((1, 48, 64, 3), np.uint8), r"shape \[1, 48, 64, 3\], expected"),
        (np.zeros(3072, np.uint8), r"shape \[3072\], expected"),
        (np.uint8(3), "expected"),
        (np.array(3, np.uint8), r"shape \[\], expected"),
        (np.zeros((0, 0, 3), np.uint8), "frame is 0x0 pixels, expected sides from 1 to 32768"),
        (np.zeros((48, 0), np.uint8), "frame is 0x48 pixels, expected sides"),
        (np.zeros((1, 40_000), np.uint8), "frame is 40000x1 pixels, expected sides"),
        (np.broadcast_to(np.uint8(3), (1 << 40, 64)), "expected sides"),
        (np.broadcast_to(np.uint8(3), (70_000, 70_000, 3)), "70000x70000 pixels, expected sides"),
    ],
)
@pytest.mark.parametrize("kind", [track_cpu.Tracker, track_cpu.FlightTracker])
def test_what_is_no_picture_is_refused(model, pictures, box, kind, image, words):
    tracker = kind(model)

    with pytest.raises(ValueError, match=words):
        tracker.init(image, (1, 2, 30, 20))
    tracker.init(pictures[0], box)
    with pytest.raises(ValueError, match=words):
        tracker.update(image)
    assert tracker.update(pictures[0])[0]


@pytest.mark.parametrize(
    "bad, words",
    [
        ((float("nan"), 2, 30, 20), "NaN.*expected finite numbers"),
        ((1, 2, float("inf"), 20), "inf.*expected finite numbers"),
        ((1, 2, 1e300, 20), "expected finite numbers"),
        ((1, 2, 0, 20), "a width and height above 0"),
        ((1, 2, 30, -20), "a width and height above 0"),
        ((5000, 2, 30, 20), "outside the 320x200 frame"),
        ((0.3, 0.4, 0.1, 0.2), "expected pixels, found shares of the frame"),
        ((1, 2, 30), "box is .*expected four numbers: left, top, width, height in pixels"),
        ((1, 2, 30, 20, 5), "expected four numbers"),
        (None, "box is None, expected four numbers"),
        ("1,2,30,20", "expected four numbers"),
        ("1234", "expected four numbers"),
        (7, "expected four numbers"),
        ([[1, 2, 30, 20]], "expected four numbers"),
        (np.zeros((4, 2)), "expected four numbers"),
        ({"x": 1, "y": 2, "w": 3, "h": 4}, "expected four numbers"),
    ],
)
@pytest.mark.parametrize("kind", [track_cpu.Tracker, track_cpu.FlightTracker])
def test_what_is_no_box_is_refused_and_the_target_kept(model, pictures, box, kind, bad, words):
    tracker, other = kind(model), kind(model)
    tracker.init(pictures[0], box)
    other.init(pictures[0], box)

    with pytest.raises(ValueError, match=words):
        tracker.init(pictures[0], bad)

    assert tracker.update(pictures[1]) == other.update(pictures[1])


@pytest.mark.parametrize("form", [list, np.array, np.float32, iter])
def test_box_of_any_four_numbers_is_taken(model, pictures, form):
    tracker, other = track_cpu.Tracker(model), track_cpu.Tracker(model)
    tracker.init(pictures[0], form([100.0, 60.0, 40.0, 30.0]))
    other.init(pictures[0], (100, 60, 40, 30))

    assert tracker.update(pictures[1]) == other.update(pictures[1])
