"""Trackers as objects: options, models, threads, fork, copies, flight mode."""

import copy
import os
import pickle
import signal
import sys
import threading
import time

import numpy as np
import pytest
import track_cpu
from conftest import follow

KINDS = [track_cpu.Tracker, track_cpu.FlightTracker]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "options, words",
    [
        ({"threads": 0}, "threads is 0, expected a number from 1 to 256"),
        ({"threads": -1}, "threads is -1, expected"),
        ({"threads": 257}, "threads is 257, expected"),
        ({"precision": "int4"}, 'precision is "int4", expected "f32" or "int8"'),
        ({"order": "gbr"}, 'order is "gbr", expected "bgr"'),
    ],
)
def test_option_without_meaning_is_refused(kind, options, words):
    with pytest.raises(ValueError, match=words):
        kind(**options)


@pytest.mark.parametrize(
    "options, words",
    [
        ({"fps": 0}, "fps is 0, expected a number from 0.1 to 1000"),
        ({"fps": float("nan")}, "fps is NaN, expected"),
        ({"present": 1.5}, "present is 1.5, expected 0 to 1"),
        ({"patience": -1}, "patience is -1, expected"),
        ({"coast": float("inf")}, "coast is inf, expected"),
        ({"confirm": 0}, "confirm is 0, expected 1 to 1000 looks"),
        ({"searches": -3}, "searches is -3, expected"),
        ({"deadline": 1e300}, "deadline is 1.*, expected"),
    ],
)
def test_flight_option_without_meaning_is_refused(model, options, words):
    with pytest.raises(ValueError, match=words):
        track_cpu.FlightTracker(model, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_update_before_init_is_an_error(kind, model, pictures):
    with pytest.raises(RuntimeError, match="no target yet: call init before update"):
        kind(model).update(pictures[0])


@pytest.mark.parametrize("kind", KINDS)
def test_attributes_cannot_be_set(kind, model):
    tracker = kind(model)
    for name in ("score", "threads", "order", "model", "other"):
        with pytest.raises(AttributeError):
            setattr(tracker, name, 1)


# Models


def test_model_tells_what_it_is(model):
    assert model.name and model.precision in ("f32", "int8") and model.isa
    assert repr(model).startswith(f'Model("{model.name}", precision="{model.precision}") on ')
    assert track_cpu.builtin_models[0] == "drmim-p50"


def test_model_is_shared_between_trackers(pictures, box):
    for precision in ("f32", "int8"):
        model = track_cpu.Model(precision=precision)
        trackers = [track_cpu.Tracker(model), track_cpu.FlightTracker(model)]
        trackers.append(track_cpu.Tracker(trackers[0].model))

        assert {tracker.model.precision for tracker in trackers} == {precision}
        assert follow(trackers[0], pictures[:4], box) == follow(trackers[2], pictures[:4], box)


def test_precision_other_than_the_models_is_refused():
    model = track_cpu.Model(precision="f32")

    with pytest.raises(ValueError, match='precision is "int8", but the Model is loaded as f32'):
        track_cpu.Tracker(model, precision="int8")
    assert track_cpu.Tracker(model, precision="f32").model.precision == "f32"


def test_every_builtin_model_tracks(pictures, box):
    for name in track_cpu.builtin_models:
        assert len(follow(track_cpu.Tracker(name), pictures[:3], box)) == 2


def test_model_that_cannot_be_used_is_an_error(tmp_path):
    text = tmp_path / "text.safetensors"
    text.write_text("no weights")
    checkpoint = tmp_path / "model.pth"
    checkpoint.write_bytes(b"PK\x03\x04" + bytes(100))
    for name, error, words in [
        ("no-such-model", track_cpu.ModelError, "no-such-model; built in are drmim-p50"),
        (tmp_path / "none.safetensors", FileNotFoundError, "none.safetensors"),
        (tmp_path, OSError, str(tmp_path)),
        (text, track_cpu.ModelError, "text.safetensors"),
        (str(checkpoint), track_cpu.ModelError, "PyTorch checkpoint, expected a weights file"),
        ("a\0b", track_cpu.ModelError, "built in are drmim-p50"),
        (7, TypeError, "expected .*PathLike.*, not int|model is a int, expected"),
        (None, TypeError, "expected .*PathLike.*, not None|model is a None"),
    ]:
        for make in (track_cpu.Model, track_cpu.Tracker, track_cpu.FlightTracker):
            with pytest.raises(error, match=words):
                make(name)
    assert issubclass(track_cpu.ModelError, ValueError)


def test_retired_name_warns_and_works():
    with pytest.warns(DeprecationWarning, match="drmim-p75 takes its place"):
        assert track_cpu.Model("drmim-p82").name == track_cpu.Model("drmim-p75").name


# Threads and processes


def test_interpreter_is_free_during_an_update(model, pictures, box):
    tracker = track_cpu.Tracker(model)
    tracker.init(pictures[0], box)
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(1e-4)

    other = threading.Thread(target=tick)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(60)  # a thread runs until it lets another one run
    try:
        other.start()
        spans = []
        for picture in pictures:
            started = time.perf_counter()
            tracker.update(picture)
            spans.append((started, time.perf_counter()))
    finally:
        done.set()
        other.join()
        sys.setswitchinterval(interval)

    assert any(start < tick < end for tick in ticks for start, end in spans)


@pytest.mark.parametrize("threads", [1, 2])
def test_calls_from_two_threads_wait_for_each_other(model, pictures, box, threads):
    tracker = track_cpu.Tracker(model, threads=threads)
    tracker.init(pictures[0], box)
    failures = []

    def update():
        try:
            for picture in pictures[:8]:
                ok, found = tracker.update(picture)
                assert ok and np.isfinite(found).all() and 0.0 <= tracker.score <= 1.0
        except BaseException as failure:
            failures.append(failure)

    others = [threading.Thread(target=update) for _ in range(3)]
    for other in others:
        other.start()
    for other in others:
        other.join()

    assert failures == []


def in_child(work):
    """Whether `work` returns True in a forked child, within a minute."""
    child = os.fork()
    if child == 0:
        code = 1
        try:
            code = 0 if work() else 1
        finally:
            os._exit(code)
    for _ in range(600):
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.WIFEXITED(status) and os.WEXITSTATUS(status) == 0
        time.sleep(0.1)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
@pytest.mark.parametrize("kind", KINDS)
def test_tracker_in_a_forked_child_works_or_is_an_error(kind, model, pictures, box):
    alone, pooled = kind(model), kind(model, threads=2)
    for tracker in (alone, pooled):
        tracker.init(pictures[0], box)
        tracker.update(pictures[1])
    expected = kind(model)
    expected.init(pictures[0], box)
    expected.update(pictures[1])
    expected = expected.update(pictures[2])

    def alone_works():
        return alone.update(pictures[2]) == expected

    def pooled_refuses_and_ends():
        nonlocal pooled
        for call in (
            lambda: pooled.update(pictures[2]),
            lambda: pooled.init(pictures[0], box),
            lambda: pooled.score,
        ):
            try:
                call()
                return False
            except RuntimeError as error:
                if "forked after this tracker was made" not in str(error):
                    return False
        del pooled
        return True

    def new_one_works():
        tracker = kind(model, threads=2)
        tracker.init(pictures[0], box)
        tracker.update(pictures[1])
        return tracker.update(pictures[2]) == expected

    assert in_child(alone_works)
    assert in_child(pooled_refuses_and_ends)
    assert in_child(new_one_works)
    assert pooled.update(pictures[2]) == expected


@pytest.mark.parametrize("make", [track_cpu.Model, *KINDS])
@pytest.mark.parametrize("call", [copy.copy, copy.deepcopy, pickle.dumps])
def test_copy_and_pickle_are_errors(make, call):
    with pytest.raises(TypeError, match=f"a {make.__name__} cannot be copied or pickled"):
        call(make())


def test_results_can_be_pickled(model, pictures, box):
    tracker = track_cpu.Tracker(model)
    tracker.init(pictures[0], box)
    track = tracker(pictures[1])

    assert pickle.loads(pickle.dumps(track)) == track


# Flight mode


def test_hidden_target_is_not_believed_and_later_found_again(model, pictures, box):
    tracker = track_cpu.FlightTracker(model, fps=10)
    assert (tracker.state, tracker.presence, tracker.ok, tracker.track) == (None, 0.0, False, None)
    tracker.init(pictures[0], box)
    assert (tracker.state, tracker.presence, tracker.ok, tracker.score) == ("tracking", 1, True, 1)
    seen = [tracker(picture) for picture in pictures[1:8]]
    hidden = [tracker(np.zeros_like(pictures[0])) for _ in range(30)]
    again = [tracker(picture) for picture in [pictures[8]] * 15]

    assert all(track.ok and track.presence >= track_cpu.BELIEVED for track in seen)
    assert not any(track.ok for track in hidden[2:])
    assert {"coasting", "lost"} <= {track.state for track in hidden}
    assert hidden[-1].state == "lost" and hidden[-1].presence < 0.4
    assert again[-1].ok and again[-1].state in ("reacquired", "tracking")
    assert tracker.track == again[-1]


def test_time_between_pictures_counts(model, pictures, box):
    states = {}
    for elapsed in (None, 0.5):
        tracker = track_cpu.FlightTracker(model)
        tracker.init(pictures[0], box)
        black = np.zeros_like(pictures[0])
        states[elapsed] = [tracker(black, elapsed).state for _ in range(8)]

    assert "lost" in states[0.5] and "lost" not in states[None]


@pytest.mark.parametrize("elapsed", [-1, float("nan"), float("inf"), 1e300])
def test_time_that_cannot_be_is_refused(model, pictures, box, elapsed):
    tracker = track_cpu.FlightTracker(model)
    tracker.init(pictures[0], box)

    with pytest.raises(ValueError, match="elapsed is .*, expected"):
        tracker.update(pictures[1], elapsed=elapsed)


def test_candidates_begin_with_the_box(model, pictures, box):
    tracker = track_cpu.FlightTracker(model)
    tracker.init(pictures[0], box)
    tracker.update(pictures[1])

    candidates = tracker.candidates

    assert 1 <= len(candidates) <= 5
    assert all(0 <= found.score <= 1 and -1.01 <= found.similarity <= 1.01 for found in candidates)
    assert candidates[0].score == pytest.approx(tracker.score)


def test_stopped_tracker_has_no_target(model, pictures, box):
    tracker = track_cpu.FlightTracker(model, deadline=0.05, recover=False)
    tracker.init(pictures[0], box)
    tracker.update(pictures[1])

    tracker.stop()

    assert tracker.track is None
    with pytest.raises(RuntimeError, match="no target yet"):
        tracker.update(pictures[2])
