"""Boxes: those of the program, near the target, the same however the tracker is made."""

import json

import numpy as np
import pytest
import track_cpu
from conftest import HEIGHT, WIDTH, follow, run
from track_cpu.demo import Flight, iou


def by_program(program, pictures, box, *options):
    command = [program, "track", "--input", "-", "--raw", f"{WIDTH}x{HEIGHT}", "--pix", "bgr24"]
    command += ["--init", ",".join(map(repr, box)), "--json", *options]
    done = run(command, input=b"".join(picture.tobytes() for picture in pictures))
    assert done.returncode == 0, done.stderr.decode()
    return [json.loads(line) for line in done.stdout.splitlines()][1:]


@pytest.mark.parametrize("precision", ["f32", "int8"])
def test_boxes_equal_those_of_the_program(program, pictures, box, precision):
    expected = by_program(program, pictures, box, "--precision", precision)

    tracker = track_cpu.Tracker(precision=precision)
    tracker.init(pictures[0], box)
    found = [tracker(picture) for picture in pictures[1:]]

    assert [track.box for track in found] == [
        pytest.approx(line["box"], abs=6e-4) for line in expected
    ]
    assert [track.score for track in found] == [
        pytest.approx(line["score"], abs=1e-6) for line in expected
    ]


def test_boxes_in_flight_mode_equal_those_of_the_program(program, pictures, box):
    pictures = pictures[:8] + [np.zeros_like(pictures[0])] * 30 + pictures[8:]
    expected = by_program(program, pictures, box, "--mode", "flight")

    tracker = track_cpu.FlightTracker()
    tracker.init(pictures[0], box)
    found = [tracker(picture) for picture in pictures[1:]]

    assert [track.box for track in found] == [
        pytest.approx(line["box"], abs=6e-4) for line in expected
    ]
    assert [track.state for track in found] == [line["state"] for line in expected]
    assert [track.presence for track in found] == [
        pytest.approx(line["presence"], abs=1e-4) for line in expected
    ]


def test_boxes_lie_on_the_target(boxes):
    flight = Flight(len(boxes) + 1, width=WIDTH, height=HEIGHT)

    overlaps = [iou(box, flight[index + 1][1]) for index, box in enumerate(boxes)]

    assert min(overlaps) > 0.4 and sum(overlaps) / len(overlaps) > 0.6


@pytest.mark.parametrize("options", [{"threads": 2}, {"model": "drmim-p50"}, {"precision": None}])
def test_boxes_do_not_depend_on_threads_or_on_how_the_model_is_named(
    model, pictures, box, boxes, options
):
    tracker = track_cpu.Tracker(**{"model": model, **options})

    assert follow(tracker, pictures, box) == boxes


def test_call_update_and_score_tell_the_same(model, pictures, box):
    called, updated = track_cpu.Tracker(model), track_cpu.Tracker(model)
    called.init(pictures[0], box)
    updated.init(pictures[0], box)
    assert called.score == 1.0

    track = called(pictures[1])
    ok, found = updated.update(pictures[1])

    assert track == (ok, found, updated.score)
    assert updated.getTrackingScore() == updated.score == called.score
    assert 0.0 < track.score < 1.0


def test_published_tracker_finds_other_boxes(model, pictures, box, boxes):
    published = follow(track_cpu.Tracker(model, as_published=True), pictures, box)

    assert published != boxes
    assert min(iou(a, b) for a, b in zip(published, boxes)) > 0.3


def test_second_init_forgets_the_first(model, pictures, box, boxes):
    tracker = track_cpu.Tracker(model)
    tracker.init(pictures[5], (3, 4, 50, 60))
    tracker.update(pictures[6])

    assert follow(tracker, pictures, box) == boxes
