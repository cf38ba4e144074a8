"""Pictures and helpers that the tests share."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
import track_cpu
from track_cpu.demo import Flight

ROOT = Path(__file__).resolve().parents[3]
WIDTH, HEIGHT, FRAMES = 320, 200, 24


@pytest.fixture(scope="session")
def model():
    """The standard model, loaded once."""
    return track_cpu.Model()


@pytest.fixture(scope="session")
def pictures():
    """A rendered flight: BGR arrays (H, W, 3)."""
    flight = Flight(FRAMES, width=WIDTH, height=HEIGHT)
    return [np.ascontiguousarray(flight[index][0][..., ::-1]) for index in range(FRAMES)]


@pytest.fixture(scope="session")
def box():
    """The target's box in the first of them."""
    return Flight(FRAMES, width=WIDTH, height=HEIGHT)[0][1]


@pytest.fixture(scope="session")
def boxes(model, pictures, box):
    """What a tracker finds in them."""
    return follow(track_cpu.Tracker(model), pictures, box)


@pytest.fixture(scope="session")
def program():
    """The program track-cpu: $TRACK_CPU_PROGRAM, or where cargo builds it."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    path = Path(os.environ.get("TRACK_CPU_PROGRAM", target / "release" / "track-cpu"))
    if not path.exists():
        pytest.skip(f"no program {path}: cargo build --release makes it")
    return path


def follow(tracker, pictures, box):
    """The boxes after the first, by any tracker that has the methods of OpenCV's."""
    assert tracker.init(pictures[0], box) is None
    found = []
    for picture in pictures[1:]:
        ok, next_box = tracker.update(picture)
        assert ok is True
        found.append(next_box)
    return found


def run(command, **options):
    """Runs a program to its end and returns it with its output."""
    return subprocess.run(command, capture_output=True, timeout=300, **options)
