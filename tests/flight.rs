//! Flight mode through the public API: the plain tracker's boxes while the target is there, and
//! what happens when it is not.

#![cfg(feature = "cli")]

use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer};
use track_cpu::flight::{
    Budget, Conduct, FlightOptions, FlightTrack, FlightTracker, Presence, Weighing,
};
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, State, TrackError, Tracker};

const WIDTH: usize = 320;
const HEIGHT: usize = 180;

/// Frames of an easy flight and the target's first box.
fn flight(frames: usize) -> (Vec<Vec<u8>>, BBox) {
    let difficulty = Difficulty::Easy;
    let flight = Flight::new(FlightConfig {
        width: WIDTH,
        height: HEIGHT,
        frames,
        seed: 7,
        difficulty,
        ..Default::default()
    });
    let mut buffer = FrameBuffer::default();
    let first = flight.render(0, &mut buffer).bbox;
    let pictures = (0..frames).map(|index| {
        flight.render(index, &mut buffer);
        buffer.data.clone()
    });
    (
        pictures.collect(),
        BBox::new(first.x, first.y, first.w, first.h),
    )
}

fn frame(data: &[u8]) -> Frame<'_> {
    Frame::new(data, WIDTH, HEIGHT, ChannelOrder::Rgb).unwrap()
}

fn tracker(recover: bool) -> FlightTracker {
    let model = Model::builtin(Isa::detect());
    let conduct = if recover {
        Conduct::Recover
    } else {
        Conduct::Tell
    };
    let options = FlightOptions {
        conduct,
        ..FlightOptions::new(&model)
    };
    FlightTracker::new(model, options).unwrap()
}

fn follow(tracker: &mut FlightTracker, data: &[u8], searches: u32) -> FlightTrack {
    tracker
        .update(&frame(data), Budget::Searches(searches))
        .unwrap()
}

#[test]
fn visible_target_gets_the_boxes_of_the_plain_tracker() {
    let (frames, first) = flight(30);
    let mut plain = Tracker::new(Model::builtin(Isa::detect()));
    let (mut watched, mut flying) = (tracker(false), tracker(true));
    plain.init(&frame(&frames[0]), first).unwrap();
    watched.init(&frame(&frames[0]), first).unwrap();
    flying.init(&frame(&frames[0]), first).unwrap();
    for data in &frames[1..] {
        let expected = plain.update(&frame(data)).unwrap();
        let (watched, flying) = (follow(&mut watched, data, 1), follow(&mut flying, data, 1));
        assert_eq!(
            (watched.bbox, watched.score),
            (expected.bbox, expected.score)
        );
        assert_eq!((flying.bbox, flying.score), (expected.bbox, expected.score));
        assert!(
            flying.state.is_seen() && flying.presence > 0.5,
            "{flying:?}"
        );
    }
}

/// A jolt of the camera: the picture, and with it the target, leaps farther than the search region
/// reaches.
#[test]
fn leaping_target_is_followed_as_by_the_plain_tracker() {
    let (frames, first) = flight(16);
    let leap = (1.6 * first.w.max(first.h)) as usize;
    let leapt = |data: &Vec<u8>| -> Vec<u8> {
        let rows = data.chunks_exact(3 * WIDTH);
        rows.flat_map(|row| [&row[3 * (WIDTH - leap)..], &row[..3 * (WIDTH - leap)]].concat())
            .collect()
    };
    let frames: Vec<Vec<u8>> = frames
        .iter()
        .enumerate()
        .map(|(i, data)| if i < 12 { data.clone() } else { leapt(data) })
        .collect();
    let mut plain = Tracker::new(Model::builtin(Isa::detect()));
    let mut flying = tracker(true);
    plain.init(&frame(&frames[0]), first).unwrap();
    flying.init(&frame(&frames[0]), first).unwrap();
    let mut before = first;
    for (i, data) in frames.iter().enumerate().skip(1) {
        let (expected, found) = (
            plain.update(&frame(data)).unwrap(),
            follow(&mut flying, data, 1),
        );
        assert_eq!(found.bbox, expected.bbox, "frame {i}: {found:?}");
        let moved = found.bbox.x - before.x;
        assert!(
            (moved - if i == 12 { leap as f32 } else { 0.0 }).abs() < 0.3 * leap as f32,
            "frame {i} by {moved} of {leap}"
        );
        before = found.bbox;
    }
}

#[test]
fn vanished_target_is_lost_and_found_again() {
    let (frames, first) = flight(20);
    let nothing = [96u8, 104, 92].repeat(WIDTH * HEIGHT);
    let mut tracker = tracker(true);
    tracker.init(&frame(&frames[0]), first).unwrap();
    for data in &frames[1..] {
        follow(&mut tracker, data, 2);
    }
    let states: Vec<State> = (0..75)
        .map(|_| follow(&mut tracker, &nothing, 2).state)
        .collect();
    let from = |state| {
        states
            .iter()
            .position(|s| *s == state)
            .unwrap_or_else(|| panic!("never {state:?}: {states:?}"))
    };
    assert!(from(State::Coasting) < 25, "{states:?}");
    assert!(from(State::Coasting) < from(State::Lost));
    let gone = follow(&mut tracker, &nothing, 2);
    assert!(gone.presence < 0.5 && gone.searches <= 2, "{gone:?}");

    let back: Vec<FlightTrack> = (0..60)
        .map(|_| follow(&mut tracker, &frames[19], 2))
        .collect();
    let found = back.iter().position(|t| t.state == State::Reacquired);
    assert!(found.is_some(), "{:?}", back.last());
    let mut plain = Tracker::new(Model::builtin(Isa::detect()));
    plain.init(&frame(&frames[0]), first).unwrap();
    let expected = frames[1..]
        .iter()
        .map(|data| plain.update(&frame(data)).unwrap().bbox)
        .last()
        .unwrap();
    let end = back[59];
    assert!(
        end.bbox.iou(&expected) > 0.5 && end.presence > 0.5,
        "{end:?}, expected near {expected:?}"
    );
}

/// Whatever the pictures show, presence is such that the box is neither believed nor surely wrong.
#[test]
fn doubtful_target_is_followed_on_while_it_is_searched_for_elsewhere() {
    let (frames, first) = flight(30);
    let model = Model::builtin(Isa::detect());
    let options = FlightOptions::new(&model);
    let doubtful = Weighing {
        bias: -2.0,
        weights: [0.0; track_cpu::flight::EVIDENCE_COUNT],
    };
    let nowhere = Weighing {
        bias: -9.0,
        ..doubtful
    };
    let presence = Presence {
        look: doubtful,
        again: nowhere,
        memory: 0.0,
        gain: 1.0,
        shift: 0.0,
    };
    let mut tracker = FlightTracker::with_presence(model, options, presence);
    let mut plain = Tracker::new(Model::builtin(Isa::detect()));
    tracker.init(&frame(&frames[0]), first).unwrap();
    plain.init(&frame(&frames[0]), first).unwrap();
    for (i, data) in frames.iter().enumerate().skip(1) {
        let track = follow(&mut tracker, data, 3);
        let expected = match i {
            0..14 => 1..=1,
            14..18 => 1..=3, // half a second of doubt
            _ => 3..=3,
        };
        assert!(expected.contains(&track.searches), "frame {i}: {track:?}");
        assert!(
            track.state == State::LowConfidence && !track.is_believed(),
            "frame {i}: {track:?}"
        );
        // The tracker does not learn from what it does not believe: its boxes are nearly the same.
        let iou = track.bbox.iou(&plain.update(&frame(data)).unwrap().bbox);
        assert!(iou > 0.7, "frame {i}: IoU {iou}");
    }
}

/// The noise of frame `i`, the same in every run.
fn noise(i: usize) -> Vec<u8> {
    let mut state = i as u64 + 1;
    let mut byte = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (state >> 56) as u8
    };
    (0..3 * WIDTH * HEIGHT).map(|_| byte()).collect()
}

/// The pixels of the frame of a number.
type Paint = dyn Fn(usize) -> Vec<u8>;

#[test]
fn picture_of_nothing_is_no_presence_and_moves_no_box() {
    let sky = |i: usize| -> Vec<u8> {
        let rows = (0..HEIGHT).flat_map(|y| [(100 + y / 2) as u8; 3].repeat(WIDTH));
        let noise = noise(i);
        rows.zip(noise)
            .map(|(row, noise)| row + noise % 4)
            .collect()
    };
    // Columns of a thermal camera differ a little, always in the same way; the scene is flat.
    let thermal = |i: usize| -> Vec<u8> {
        let noise = noise(i);
        let gray =
            (0..WIDTH * HEIGHT).map(|at| 118 + (at % WIDTH * 7919 % 3) as u8 + noise[at] % 3);
        gray.flat_map(|value| [value; 3]).collect()
    };
    let pictures: [(&str, &Paint); 5] = [
        ("black", &|_| vec![0; 3 * WIDTH * HEIGHT]),
        ("white", &|_| vec![255; 3 * WIDTH * HEIGHT]),
        ("clear sky", &sky),
        ("noise", &noise),
        ("flat thermal picture", &thermal),
    ];
    let given = BBox::new(140.0, 80.0, 24.0, 18.0);
    for (name, picture) in pictures {
        let mut tracker = tracker(true);
        tracker.init(&frame(&picture(0)), given).unwrap();

        let tracks: Vec<FlightTrack> = (1..60)
            .map(|i| follow(&mut tracker, &picture(i), 2))
            .collect();

        for (i, track) in tracks.iter().enumerate() {
            assert!(
                i < 30 || track.presence < 0.4 && !track.is_believed(),
                "{name}, frame {i}: {track:?}"
            );
            assert!(track.bbox.iou(&given) > 0.8, "{name}, frame {i}: {track:?}");
        }
    }
}

#[test]
fn time_decides_when_a_target_is_lost_and_not_frames() {
    use std::time::Duration;
    let (frames, first) = flight(12);
    let nothing = [96u8, 104, 92].repeat(WIDTH * HEIGHT);
    for fps in [10u32, 30, 60] {
        let mut tracker = tracker(true);
        tracker.init(&frame(&frames[0]), first).unwrap();
        let elapsed = Duration::from_secs(1) / fps;
        let budget = Budget::Searches(2);
        for data in &frames[1..] {
            tracker.update_after(elapsed, &frame(data), budget).unwrap();
        }

        let mut lost_after = None;
        for i in 1..=4 * fps {
            let track = tracker
                .update_after(elapsed, &frame(&nothing), budget)
                .unwrap();
            if track.state == State::Lost {
                lost_after = Some(f64::from(i) / f64::from(fps));
                break;
            }
        }

        let seconds = lost_after.unwrap_or(f64::MAX);
        assert!((1.2..2.4).contains(&seconds), "{fps} fps: {lost_after:?}");
    }
}

#[test]
fn frame_rate_of_any_number_is_no_panic() {
    let (frames, first) = flight(2);
    for fps in [
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        -3.0,
        0.0,
        1e-300,
    ] {
        let model = Model::builtin(Isa::detect());
        let options = FlightOptions {
            fps,
            ..FlightOptions::new(&model)
        };
        let mut tracker = FlightTracker::new(model, options).unwrap();
        tracker.init(&frame(&frames[0]), first).unwrap();

        let track = follow(&mut tracker, &frames[1], 1);

        assert!(
            track.bbox.is_finite() && track.is_believed(),
            "{fps}: {track:?}"
        );
    }
}

#[test]
fn jump_of_the_clock_moves_no_box() {
    use std::time::Duration;
    let (frames, first) = flight(24);
    let nothing = [96u8, 104, 92].repeat(WIDTH * HEIGHT);
    let usual = Duration::from_millis(33);
    let budget = Budget::Searches(2);
    for jump in [Duration::ZERO, Duration::from_secs(3600), Duration::MAX] {
        let mut plain = Tracker::new(Model::builtin(Isa::detect()));
        let mut flying = tracker(true);
        plain.init(&frame(&frames[0]), first).unwrap();
        flying.init(&frame(&frames[0]), first).unwrap();
        let mut last = first;
        for (i, data) in frames.iter().enumerate().skip(1) {
            let expected = plain.update(&frame(data)).unwrap();
            last = expected.bbox;
            let elapsed = if i == 12 { jump } else { usual };

            let found = flying.update_after(elapsed, &frame(data), budget).unwrap();

            assert_eq!(found.bbox, expected.bbox, "{jump:?}, frame {i}: {found:?}");
            assert!(found.is_believed(), "{jump:?}, frame {i}: {found:?}");
        }
        // While nothing is seen, a jump is a second at most: the box stays near the last one.
        for i in 0..24 {
            let elapsed = if i == 20 { jump } else { usual };

            let gone = flying
                .update_after(elapsed, &frame(&nothing), budget)
                .unwrap();

            assert!(
                gone.bbox.is_finite() && gone.bbox.iou(&last) > 0.1,
                "{jump:?}: {gone:?}"
            );
        }
    }
}

#[test]
fn same_searches_give_the_same_boxes() {
    let (frames, first) = flight(6);
    let nothing = vec![30u8; 3 * WIDTH * HEIGHT];
    let run = || -> Vec<FlightTrack> {
        let mut tracker = tracker(true);
        tracker.init(&frame(&frames[0]), first).unwrap();
        let shown = frames[1..]
            .iter()
            .chain(std::iter::repeat_n(&nothing, 14))
            .chain(&frames[3..]);
        shown.map(|data| follow(&mut tracker, data, 3)).collect()
    };
    assert_eq!(run(), run());
}

#[test]
fn missing_target_is_an_error_and_strange_frames_are_not() {
    let (frames, first) = flight(1);
    let mut tracker = tracker(true);
    let budget = Budget::Searches(2);
    assert_eq!(
        tracker.update(&frame(&frames[0]), budget),
        Err(TrackError::NoTarget)
    );
    assert!(
        tracker
            .init(&frame(&frames[0]), BBox::new(0.0, 0.0, f32::NAN, 5.0))
            .is_err()
    );
    tracker.init(&frame(&frames[0]), first).unwrap();
    for (w, h) in [(1, 1), (3, 900), (WIDTH, HEIGHT), (900, 2), (640, 480)] {
        for value in [0u8, 255] {
            let data = vec![value; w * h];
            let frame = Frame::new(&data, w, h, ChannelOrder::Gray).unwrap();
            for _ in 0..3 {
                let track = tracker.update(&frame, budget).unwrap();
                assert!(
                    track.bbox.is_finite() && (0.0..=1.0).contains(&track.presence),
                    "{track:?}"
                );
            }
        }
    }
    tracker.stop();
    assert_eq!(
        tracker.update(&frame(&frames[0]), budget),
        Err(TrackError::NoTarget)
    );
}

#[test]
fn json_of_track_has_presence_and_state_in_flight_mode_only() {
    use std::io::Write;
    use std::process::{Command, Stdio};
    let run = |mode: &str| -> Vec<serde_json::Value> {
        let args = [
            "track",
            "--input",
            "-",
            "--raw",
            "64x48",
            "--pix",
            "gray",
            "--init",
            "20,15,20,16",
            "--json",
        ];
        let mut command = Command::new(env!("CARGO_BIN_EXE_track-cpu"));
        command
            .args(args)
            .args(["--mode", mode])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut program = command.stderr(Stdio::null()).spawn().unwrap();
        let pixels: Vec<u8> = (0..64 * 48 * 3).map(|i| (i * 31 % 251) as u8).collect();
        program.stdin.take().unwrap().write_all(&pixels).unwrap();
        let output = program.wait_with_output().unwrap();
        assert!(output.status.success());
        let text = String::from_utf8(output.stdout).unwrap();
        text.lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    };
    let (plain, flight) = (run("plain"), run("flight"));
    assert_eq!((plain.len(), flight.len()), (3, 3));
    assert!(
        plain
            .iter()
            .all(|line| line.get("presence").is_none() && line.get("state").is_none())
    );
    assert!(
        flight
            .iter()
            .all(|line| line["presence"].is_number() && line["state"].is_string())
    );
    assert_eq!(flight[0]["state"], "tracking");
}
