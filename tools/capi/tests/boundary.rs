//! The library from the other side: wrong arguments, Python.

mod common;

use common::{HEIGHT, INIT, WIDTH, expected, follows, frames, has, library, source};
use std::ffi::{CStr, CString};
use std::process::Command;
use std::ptr::{null, null_mut};
use track_cpu::flight::{Budget, FlightOptions, FlightTracker};
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model};
use track_cpu_c::*;

fn image(pixels: &[u8]) -> track_cpu_image {
    track_cpu_image {
        data: pixels.as_ptr(),
        width: WIDTH as u32,
        height: HEIGHT as u32,
        stride: 0,
        format: 1,
    }
}

fn last_error() -> String {
    // SAFETY: it is never null and lasts until the next call on this thread.
    unsafe { CStr::from_ptr(track_cpu_last_error()) }
        .to_str()
        .unwrap()
        .to_owned()
}

#[test]
fn boxes_by_the_c_interface_equal_those_in_rust() {
    let mut tracker = null_mut();
    let (mut target, mut score) = (
        track_cpu_box {
            x: 24.0,
            y: 24.0,
            w: 16.0,
            h: 16.0,
        },
        0.0,
    );
    // SAFETY: every pointer is to something that lives here, and the tracker is destroyed once.
    unsafe {
        assert_eq!(track_cpu_create(null(), 1, &mut tracker), 0);
        for (i, (pixels, expected)) in frames().iter().zip(expected()).enumerate() {
            let code = match i {
                0 => track_cpu_init(tracker, &image(pixels), &target),
                _ => track_cpu_update(tracker, &image(pixels), &mut target),
            };
            assert_eq!(
                (code, track_cpu_score(tracker, &mut score)),
                (0, 0),
                "{}",
                last_error()
            );
            assert_eq!([target.x, target.y, target.w, target.h, score], expected);
        }
        track_cpu_destroy(tracker);
        track_cpu_destroy(null_mut());
        let version = CStr::from_ptr(track_cpu_version());
        assert_eq!(version.to_str().unwrap(), env!("CARGO_PKG_VERSION"));
    }
}

#[test]
fn flight_mode_by_the_c_interface_equals_that_in_rust() {
    let pictures = frames();
    let model = Model::builtin(Isa::detect());
    let options = FlightOptions {
        coast: 2.5,
        ..FlightOptions::new(&model)
    };
    let mut flying = FlightTracker::new(model, options).unwrap();
    let [x, y, w, h] = INIT;
    let given = track_cpu_box { x, y, w, h };
    let rgb = |pixels| Frame::new(pixels, WIDTH, HEIGHT, ChannelOrder::Rgb).unwrap();
    flying
        .init(&rgb(&pictures[0]), BBox::new(x, y, w, h))
        .unwrap();
    let mut tracker = null_mut();
    let mut found = track_cpu_flight_track::default();
    let mut places = [track_cpu_candidate::default(); 5];
    let mut count = 0;
    // SAFETY: every pointer is to something that lives here, and the tracker is destroyed once.
    unsafe {
        let mut thresholds = std::mem::zeroed();
        assert_eq!(track_cpu_flight_defaults(&mut thresholds), 0);
        thresholds.coast = 2.5;
        assert_eq!(
            track_cpu_create_flight(null(), 1, &thresholds, &mut tracker),
            0
        );
        assert_eq!(track_cpu_init(tracker, &image(&pictures[0]), &given), 0);
        for pixels in &pictures[1..] {
            let elapsed = std::time::Duration::from_millis(100);
            let expected = flying
                .update_after(elapsed, &rgb(pixels), Budget::Searches(2))
                .unwrap();

            let code = track_cpu_update_flight(tracker, &image(pixels), 0.1, 0.0, &mut found);

            assert_eq!(code, 0, "{}", last_error());
            assert_eq!(found, expected.into());
            assert_eq!(
                track_cpu_candidates(tracker, places.as_mut_ptr(), 5, &mut count),
                0
            );
            assert_eq!(count as usize, flying.candidates().len());
            for (place, expected) in places.iter().zip(flying.candidates()) {
                assert_eq!(*place, (*expected).into());
            }
        }
        track_cpu_destroy(tracker);
    }
}

#[test]
fn bad_flight_argument_gives_a_code_and_a_message() {
    let pictures = frames();
    let [x, y, w, h] = INIT;
    let mut tracker = null_mut();
    let mut found = track_cpu_flight_track::default();
    let told = |code: i32, part: &str| {
        assert!(
            code == 1 && last_error().contains(part),
            "{code} {}",
            last_error()
        );
    };
    // SAFETY: every pointer is null or to something that lives here.
    unsafe {
        let mut usual = std::mem::zeroed();
        assert_eq!(track_cpu_flight_defaults(&mut usual), 0);
        for (bad, part) in [
            (
                track_cpu_flight_options {
                    present: 1.5,
                    ..usual
                },
                "present is 1.5, expected 0 to 1",
            ),
            (
                track_cpu_flight_options {
                    coast: f64::NAN,
                    ..usual
                },
                "coast is NaN",
            ),
            (
                track_cpu_flight_options { fps: 0.0, ..usual },
                "fps is 0, expected 0.1 to 1000",
            ),
            (
                track_cpu_flight_options {
                    confirm: 0,
                    ..usual
                },
                "confirm is 0",
            ),
            (
                track_cpu_flight_options {
                    tell_only: 2,
                    ..usual
                },
                "tell_only is 2, expected 0 or 1",
            ),
        ] {
            told(track_cpu_create_flight(null(), 1, &bad, &mut tracker), part);
            assert!(tracker.is_null());
        }
        told(track_cpu_flight_defaults(null_mut()), "out is null");
        assert_eq!(track_cpu_create(null(), 1, &mut tracker), 0);
        let picture = image(&pictures[0]);
        let (mut place, mut count) = (track_cpu_candidate::default(), 0);
        told(
            track_cpu_update_flight(tracker, &picture, 0.0, 0.0, &mut found),
            "flight mode",
        );
        told(
            track_cpu_candidates(tracker, &mut place, 1, &mut count),
            "flight mode",
        );
        track_cpu_destroy(tracker);
        assert_eq!(track_cpu_create_flight(null(), 1, null(), &mut tracker), 0);
        assert_eq!(
            track_cpu_init(tracker, &picture, &track_cpu_box { x, y, w, h }),
            0
        );
        for elapsed in [-1.0, f64::NAN, f64::INFINITY] {
            told(
                track_cpu_update_flight(tracker, &picture, elapsed, 0.0, &mut found),
                "expected seconds, 0 or more",
            );
        }
        told(
            track_cpu_candidates(tracker, null_mut(), 1, &mut count),
            "candidates is null",
        );
        assert_eq!(
            track_cpu_update_flight(tracker, &picture, 1e9, 1e-9, &mut found),
            0
        );
        assert_eq!(track_cpu_candidates(tracker, &mut place, 0, &mut count), 0);
        assert_eq!(count, 0);
        track_cpu_destroy(tracker);
    }
}

#[test]
fn bad_argument_gives_a_code_and_a_message() {
    let pixels = &frames()[0];
    let (good, target) = (
        image(pixels),
        track_cpu_box {
            x: 24.0,
            y: 24.0,
            w: 16.0,
            h: 16.0,
        },
    );
    let (mut tracker, mut found, mut score) = (null_mut(), track_cpu_box::default(), 0.0);
    let told = |code: i32, expected: i32, part: &str| {
        let text = last_error();
        assert!(
            code == expected && text.contains(part),
            "{code} {text:?}, expected {expected} {part:?}"
        );
    };
    // SAFETY: every pointer is null or to something that lives here, the sizes are refused before
    // data is read, and the tracker is destroyed once.
    unsafe {
        told(track_cpu_create(null(), 1, null_mut()), 1, "out is null");
        told(
            track_cpu_create(null(), 0, &mut tracker),
            1,
            "0 threads, expected 1 to 256",
        );
        let missing = CString::new("/nonexistent.safetensors").unwrap();
        told(
            track_cpu_create(missing.as_ptr(), 1, &mut tracker),
            2,
            "/nonexistent.safetensors",
        );
        assert!(tracker.is_null());
        let binary = CString::new(b"\xff\xfe".to_vec()).unwrap();
        told(
            track_cpu_create(binary.as_ptr(), 1, &mut tracker),
            1,
            "UTF-8",
        );
        assert_eq!(track_cpu_create(null(), 1, &mut tracker), 0);

        told(
            track_cpu_update(tracker, &good, &mut found),
            4,
            "no target yet",
        );
        told(
            track_cpu_init(null_mut(), &good, &target),
            1,
            "tracker is null",
        );
        told(track_cpu_init(tracker, null(), &target), 1, "image is null");
        told(track_cpu_init(tracker, &good, null()), 1, "target is null");
        told(
            track_cpu_update(tracker, &good, null_mut()),
            1,
            "out is null",
        );
        told(track_cpu_score(null(), &mut score), 1, "tracker is null");
        told(track_cpu_score(tracker, null_mut()), 1, "out is null");
        for (bad, code, part) in [
            (
                track_cpu_image {
                    data: null(),
                    ..good
                },
                1,
                "image data is null",
            ),
            (track_cpu_image { format: 10, ..good }, 1, "image format 10"),
            (track_cpu_image { width: 0, ..good }, 3, "0x64"),
            (
                track_cpu_image {
                    height: u32::MAX,
                    ..good
                },
                3,
                "4294967295",
            ),
            (
                track_cpu_image { stride: 7, ..good },
                3,
                "stride is 7 bytes, expected at least 288",
            ),
            (
                track_cpu_image {
                    stride: usize::MAX,
                    ..good
                },
                3,
                "frame data",
            ),
        ] {
            told(track_cpu_init(tracker, &bad, &target), code, part);
        }
        for bad in [f32::NAN, f32::INFINITY, -1.0, 0.0] {
            told(
                track_cpu_init(tracker, &good, &track_cpu_box { w: bad, ..target }),
                4,
                "width and height above 0",
            );
        }
        told(
            track_cpu_init(tracker, &good, &track_cpu_box { x: 500.0, ..target }),
            4,
            "outside",
        );
        assert_eq!(track_cpu_init(tracker, &good, &target), 0);
        track_cpu_destroy(tracker);
    }
}

#[cfg(unix)]
#[test]
fn python_example_gives_the_boxes_of_rust() {
    let (Some(library), true) = (library(), has("python3")) else {
        return;
    };
    let example = source("examples/track_cpu.py");
    follows(
        Command::new("python3")
            .arg("-B")
            .arg(&example)
            .env("TRACK_CPU_LIBRARY", &library),
    );

    let script = r#"
import track_cpu
def code(call):
    try:
        call()
    except track_cpu.Error as error:
        return error.code, str(error)
tracker = track_cpu.Tracker()
gray = (bytes(64 * 48), 64, 48)
assert code(lambda: tracker.update(gray, track_cpu.GRAY))[0] == 4
assert code(lambda: tracker.init(gray, (900, 0, 5, 5), track_cpu.GRAY))[1].endswith("lies outside the 64x48 frame")
assert code(lambda: track_cpu.Tracker(model="/nonexistent"))[0] == 2
tracker.init(gray, (10, 10, 8, 8), track_cpu.GRAY)
ok, box = tracker.update(gray, track_cpu.GRAY)
assert ok and len(box) == 4 and 0 <= tracker.getTrackingScore() <= 1
class Array:  # what NumPy shows of H x W x 3, rows 400 bytes apart
    def __init__(self):
        self.bytes = __import__("ctypes").create_string_buffer(48 * 400)
        address = __import__("ctypes").addressof(self.bytes)
        self.__array_interface__ = {"typestr": "|u1", "shape": (48, 64, 3), "strides": (400, 3, 1), "data": (address, False)}
tracker.init(Array(), (10, 10, 8, 8))
assert tracker.update(Array())[0]
class Pil:  # what PIL.Image shows: packed bytes, no strides
    __array_interface__ = {"version": 3, "shape": (48, 64, 3), "typestr": "|u1", "data": bytes(48 * 64 * 3)}
tracker.init(Pil(), (10, 10, 8, 8))
def refused(call, error, part):
    try:
        call()
    except error as failure:
        assert part in str(failure), failure
    else:
        raise AssertionError(part)
refused(lambda: tracker.update(None), ValueError, "frame is None")
refused(lambda: tracker.update("frame.png"), ValueError, "frame is a str")
refused(lambda: tracker.init(gray, (1, 2, 3), track_cpu.GRAY), ValueError, "box is (1, 2, 3), expected four")
refused(lambda: track_cpu.Tracker(threads=None), ValueError, "threads is None")
class Huge:  # a view of one byte; a copy of it would take 15 GB
    __array_interface__ = {"typestr": "|u1", "shape": (70000, 70000, 3), "strides": (0, 0, 0), "data": (1, True)}
    def copy(self):
        raise AssertionError("copied")
refused(lambda: tracker.update(Huge()), ValueError, "70000 x 70000 pixels, expected at most 32768")
refused(lambda: __import__("copy").copy(tracker), TypeError, "cannot be copied")
refused(lambda: __import__("copy").deepcopy(tracker), TypeError, "cannot be copied")
refused(lambda: __import__("pickle").dumps(tracker), TypeError, "cannot be copied or pickled")
flying = track_cpu.FlightTracker(coast=2.0)
flying.init(gray, (10, 10, 8, 8), track_cpu.GRAY)
track = flying.update(gray, track_cpu.GRAY, elapsed=0.1)
assert len(track.box) == 4 and 0 <= track.presence <= 1 and track.state in track_cpu.STATES, track
assert not track.believed and flying.getTrackingScore() == track.presence, track  # all is black
assert len(flying.candidates()) <= 5 and all(len(place) == 3 for place in flying.candidates())
refused(lambda: track_cpu.FlightTracker(patients=2), TypeError, "no threshold 'patients'")
assert code(lambda: track_cpu.FlightTracker(absent=2)) == (1, "threshold absent is 2, expected 0 to 1")
print("passed", track_cpu.__version__)
"#;
    let output = Command::new("python3")
        .args(["-B", "-c", script])
        .env("PYTHONPATH", source("examples"))
        .env("TRACK_CPU_LIBRARY", &library)
        .output()
        .unwrap();
    let (out, told) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(
        output.status.success() && out.starts_with("passed"),
        "{told}"
    );
}

/// Runs a Python script that prints `passed` at its end, within 60 seconds.
#[cfg(unix)]
fn python_passes(script: &str) {
    let Some(library) = library() else { return };
    if !has("python3") || !has("timeout") {
        return;
    }
    let output = Command::new("timeout")
        .args(["60", "python3", "-B", "-c", script])
        .env("PYTHONPATH", source("examples"))
        .env("TRACK_CPU_LIBRARY", &library)
        .output()
        .unwrap();
    let out = String::from_utf8_lossy(&output.stdout);
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success() && out.ends_with("passed\n"),
        "{out}{told}"
    );
}

#[cfg(unix)]
#[test]
fn tracker_used_by_four_threads_serializes_their_calls() {
    python_passes(
        r#"
import threading, track_cpu
frame = (bytes(range(256)) * 12, 64, 48)
tracker = track_cpu.Tracker("drmim-p75")
tracker.init(frame, (10, 10, 12, 12), track_cpu.GRAY)
boxes = []
def work(number):
    for i in range(6):
        if number == 0 and i % 3 == 2:
            tracker.init(frame, (10, 10, 12, 12), track_cpu.GRAY)
        boxes.append(tracker.update(frame, track_cpu.GRAY)[1])
threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
[thread.start() for thread in threads]
[thread.join() for thread in threads]
assert len(boxes) == 24 and all(len(box) == 4 for box in boxes)
print("passed")
"#,
    );
}

#[cfg(unix)]
#[test]
fn tracker_after_fork_refuses_or_works_and_never_hangs() {
    python_passes(
        r#"
import os, track_cpu
frame = (bytes(range(256)) * 12, 64, 48)
for threads, expected in ((1, 0), (2, 6)):
    tracker = track_cpu.Tracker("drmim-p75", threads=threads)
    tracker.init(frame, (10, 10, 12, 12), track_cpu.GRAY)
    child = os.fork()
    if child == 0:
        code = 0
        try:
            tracker.update(frame, track_cpu.GRAY)
        except track_cpu.Error as error:
            code = error.code
        del tracker
        os._exit(code)
    assert os.WEXITSTATUS(os.waitpid(child, 0)[1]) == expected
    tracker.update(frame, track_cpu.GRAY)
print("passed")
"#,
    );
}
