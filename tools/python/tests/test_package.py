"""The package: OpenCV's shape, toolkits, the command line, type stubs."""

import ast
import inspect
import os
import re
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import track_cpu
import track_cpu.got10k
import track_cpu.pysot
import track_cpu.pytracking
from conftest import WIDTH, follow, run
from track_cpu import _native, demo

PACKAGE = Path(track_cpu.__file__).parent


def test_tracker_stands_where_opencvs_stood(model, pictures, box, boxes):
    cv2 = pytest.importorskip("cv2", reason="opencv-python is not installed")
    whole = tuple(round(number) for number in box)

    def drop_in(tracker):
        assert tracker.init(pictures[0], whole) is None
        results = [tracker.update(picture) for picture in pictures[1:4]]
        return [(type(ok), len(found)) for ok, found in results]

    assert drop_in(track_cpu.Tracker(model)) == drop_in(cv2.TrackerMIL_create())
    assert drop_in(track_cpu.FlightTracker(model)) == drop_in(cv2.TrackerMIL_create())
    nano = getattr(cv2, "TrackerNano", None)
    if nano is None:
        pytest.skip("this OpenCV has no TrackerNano")
    methods = {name for name in dir(nano) if name[0].islower()} - {"create"}
    assert {"init", "update"} <= methods <= set(dir(track_cpu.Tracker)) & set(
        dir(track_cpu.FlightTracker)
    )


def test_example_beside_opencv_follows_a_flight_and_times_it():
    example = Path(__file__).parents[1] / "examples" / "beside_opencv.py"
    nano = os.environ.get("NANOTRACK")  # folder of the models

    options = ["--nano", nano] if nano else []
    done = run([sys.executable, example, "--frames", "8", *options], text=True)

    assert done.returncode == 0, done.stderr
    _, ours, theirs, *rest = done.stdout.splitlines()
    overlap = re.fullmatch(r"track_cpu drmim-p50 +8 +[\d.]+ +[\d.]+  ([\d.]+) with the truth", ours)
    assert float(overlap[1]) > 0.8, ours
    if theirs.startswith("skipped: cv2.TrackerNano: "):
        pytest.skip(theirs)
    assert float(re.fullmatch(r"mean IoU of both: ([\d.]+)", rest[0])[1]) > 0.5, rest


def save(pictures, folder):
    Image = pytest.importorskip("PIL.Image", reason="pillow is not installed")
    files = []
    for index, picture in enumerate(pictures):
        files.append(folder / f"frame{index + 1}.png")  # frame10 comes after frame9
        Image.fromarray(picture[..., ::-1].copy()).save(files[-1])
    return files


@pytest.mark.parametrize("order", ["bgr", "rgb"])
def test_got10k_adapter_gives_the_trackers_boxes(tmp_path, model, pictures, box, boxes, order):
    files = save(pictures[:5], tmp_path)
    tracker = track_cpu.got10k.Tracker(model, name="ours", order=order)

    found, seconds = tracker.track([str(file) for file in files], np.array(box))

    assert (tracker.name, tracker.is_deterministic) == ("ours", True)
    assert found.shape == (5, 4) and seconds.shape == (5,) and (seconds > 0).all()
    assert found.tolist() == [list(box), *map(list, boxes[:4])]
    with pytest.raises(ValueError, match="visualize is True"):
        tracker.track(files, box, visualize=True)


def test_got10k_adapter_has_what_the_toolkits_trackers_have():
    trackers = pytest.importorskip("got10k.trackers", reason="got10k is not installed")
    for name in ("init", "update", "track"):
        ours = inspect.signature(getattr(track_cpu.got10k.Tracker, name))
        theirs = inspect.signature(getattr(trackers.Tracker, name))
        assert list(ours.parameters) == list(theirs.parameters)


def test_pysot_adapter_gives_the_trackers_boxes(model, pictures, box, boxes):
    tracker = track_cpu.pysot.Tracker(model)
    tracker.init(pictures[0], list(box))

    outputs = [tracker.track(picture) for picture in pictures[1:4]]

    assert [tuple(output["bbox"]) for output in outputs] == boxes[:3]
    assert all(0 < output["best_score"] <= 1 for output in outputs)


def test_pytracking_adapter_gives_the_trackers_boxes(model, pictures, box, boxes):
    class Params:
        threads = 2

    Params.model = model
    tracker = track_cpu.pytracking.Tracker(Params)
    assert tracker.initialize(pictures[0][..., ::-1], {"init_bbox": list(box)}) == {}

    outputs = [tracker.track(picture[..., ::-1], {}) for picture in pictures[1:4]]

    assert [tuple(output["target_bbox"]) for output in outputs] == boxes[:3]


# The command line


def command(*arguments, **options):
    return run([sys.executable, "-m", "track_cpu", *map(str, arguments)], text=True, **options)


def test_demo_tracks_a_rendered_flight():
    done = command("demo", "--frames", 20)

    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("easy flight 7, 20 frames: mean IoU 0.")
    assert float(done.stdout.split("mean IoU ")[1].split(",")[0]) > 0.5


@pytest.mark.parametrize("mode", ["plain", "flight"])
def test_folder_is_tracked_in_natural_order(tmp_path, pictures, box, boxes, mode):
    save(pictures[:12], tmp_path)
    (tmp_path / "notes.txt").write_text("no image")

    done = command("track", tmp_path, "--init", ",".join(map(repr, box)), "--mode", mode)

    assert done.returncode == 0, done.stderr
    lines = [line.split(",") for line in done.stdout.splitlines()]
    expected = [[f"{number:.3f}" for number in found] for found in [box, *boxes[:11]]]
    assert [line[:4] for line in lines] == expected
    assert [line[5:] for line in lines] == [["tracking"] if mode == "flight" else []] * 12


def test_video_is_tracked(tmp_path, pictures, box):
    cv2 = pytest.importorskip("cv2", reason="opencv-python is not installed")
    path = tmp_path / "flight.avi"
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (width, height))
    if not writer.isOpened():
        pytest.skip("this OpenCV writes no MJPG")
    for picture in pictures[:6]:
        writer.write(picture)
    writer.release()

    done = command("track", path, "--init", ",".join(map(repr, box)))

    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) == 6


@pytest.mark.parametrize(
    "arguments, code, words",
    [
        (("track", "/nonexistent.mp4", "--init", "1,2,3,4"), 3, "/nonexistent.mp4: no such file"),
        (("track", ".", "--init", "1,2,3"), 2, "expected X,Y,W,H"),
        (("track", "{empty}", "--init", "1,2,3,4"), 3, "no images"),
        (("track", "{text}", "--init", "1,2,3,4"), 3, ""),
        (("demo", "--frames", "1"), 2, "frames is 1, expected at least 2"),
        (("demo", "--threads", "0"), 2, "threads is 0, expected"),
        (("demo", "--model", "none"), 3, "built in are drmim-p50"),
        ((), 2, "usage"),
    ],
)
def test_bad_command_line_ends_with_a_code_and_a_reason(tmp_path, arguments, code, words):
    (tmp_path / "empty").mkdir()
    text = tmp_path / "text.png"
    text.write_text("no image")

    done = command(*(part.format(empty=tmp_path / "empty", text=text) for part in arguments))

    assert done.returncode == code, done.stderr
    assert words in done.stderr and "Traceback" not in done.stderr


# Documentation and types


def readme_code():
    text = (Path(__file__).parents[1] / "README.md").read_text()
    return text.split("```python\n")[1].split("```")[0]


def docstring_code():
    lines = inspect.getdoc(track_cpu).split("\n\n", 1)[1].split("\n\nTracker")[0].splitlines()
    return "\n".join(line[4:] for line in lines)


@pytest.mark.parametrize("code", [readme_code(), docstring_code()])
def test_quick_start_works(monkeypatch, pictures, code):
    class Capture:
        """The rendered flight as OpenCV would read it."""

        def __init__(self, path):
            self.left = list(pictures)

        def read(self):
            return (True, self.left.pop(0)) if self.left else (False, None)

    opencv = types.ModuleType("cv2")
    opencv.VideoCapture = Capture
    monkeypatch.setitem(sys.modules, "cv2", opencv)
    names = {}

    exec(code, names)

    assert names["ok"] is True and 0 <= names["x"] < WIDTH


def stub_parameters(function):
    arguments = function.args
    return [argument.arg for argument in arguments.args + arguments.kwonlyargs][1:]


def test_stubs_have_what_the_module_has():
    stubs = ast.parse((PACKAGE / "_native.pyi").read_text())
    classes = {node.name: node for node in stubs.body if isinstance(node, ast.ClassDef)}

    for name, stub in classes.items():
        found = getattr(_native, name)
        described = {node.name: node for node in stub.body if isinstance(node, ast.FunctionDef)}
        if not issubclass(found, Exception):
            public = {name for name in vars(found) if not name.startswith("_")}
            assert public == {name for name in described if not name.startswith("_")}, name
        for method, node in described.items():
            if any(isinstance(part, ast.Name) for part in node.decorator_list):
                continue  # a property
            if method in ("__call__", "__getitem__", "__reduce__"):
                continue  # Python knows no names of their parameters
            if method == "__new__" and not found.__text_signature__:
                continue  # Python 3.9 does not keep it
            target = found if method == "__new__" else getattr(found, method)
            parameters = list(inspect.signature(target).parameters)
            expected = stub_parameters(node)
            assert [p for p in parameters if p != "self"] == expected, f"{name}.{method}"
    constants = {node.target.id for node in stubs.body if isinstance(node, ast.AnnAssign)}
    assert {name for name in vars(_native) if not name.startswith("__")} == (
        {name for name in constants if not name.startswith("_")} | set(classes)
    )


def test_everything_public_is_documented():
    for name in track_cpu.__all__:
        item = getattr(track_cpu, name)
        if not inspect.isclass(item):
            continue
        assert inspect.getdoc(item), name
        for method, value in vars(item).items():
            if not method.startswith("_") and name in ("Model", "Tracker", "FlightTracker"):
                assert inspect.getdoc(value), f"{name}.{method}"
    assert (PACKAGE / "py.typed").exists()


def test_rendered_flight_is_a_sequence_of_pictures():
    flight = demo.Flight(3, width=64, height=48)

    image, box, visible = flight[-1]

    assert len(flight) == 3 and image.shape == (48, 64, 3) and image.dtype == np.uint8
    assert len(box) == 4 and 0 <= visible <= 1
    assert (image == demo.Flight(3, width=64, height=48)[2][0]).all()
    for index in (3, -4, 10**10):
        with pytest.raises(IndexError):
            flight[index]
    for options in ({"frames": 0}, {"width": 8}, {"height": 10**9}, {"difficulty": "x"}):
        with pytest.raises(ValueError):
            demo.Flight(**options)
