//! Flight mode through the public API: the paper's boxes while the target is there, and what happens when it is not.

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
fn boxes_are_the_papers_while_the_target_is_there() {
    let (frames, first) = flight(30);
    let mut paper = Tracker::new(Model::builtin(Isa::detect()));
    let (mut watched, mut flying) = (tracker(false), tracker(true));
    paper.init(&frame(&frames[0]), first).unwrap();
    watched.init(&frame(&frames[0]), first).unwrap();
    flying.init(&frame(&frames[0]), first).unwrap();
    for data in &frames[1..] {
        let expected = paper.update(&frame(data)).unwrap();
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

/// A jolt of the camera: the picture, and with it the target, leaps farther than the search region reaches.
#[test]
fn a_target_that_leaps_is_followed_as_by_the_paper() {
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
    let mut paper = Tracker::new(Model::builtin(Isa::detect()));
    let mut flying = tracker(true);
    paper.init(&frame(&frames[0]), first).unwrap();
    flying.init(&frame(&frames[0]), first).unwrap();
    let mut before = first;
    for (i, data) in frames.iter().enumerate().skip(1) {
        let (expected, found) = (
            paper.update(&frame(data)).unwrap(),
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
fn a_target_that_vanishes_is_lost_and_found_again() {
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
    let mut paper = Tracker::new(Model::builtin(Isa::detect()));
    paper.init(&frame(&frames[0]), first).unwrap();
    let expected = frames[1..]
        .iter()
        .map(|data| paper.update(&frame(data)).unwrap().bbox)
        .last()
        .unwrap();
    let end = back[59];
    assert!(
        end.bbox.iou(&expected) > 0.5 && end.presence > 0.5,
        "{end:?}, expected near {expected:?}"
    );
}

/// However it looks, its presence is such that the box is neither believed nor surely wrong.
#[test]
fn what_is_doubted_for_long_is_looked_for_elsewhere_too() {
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
    let mut paper = Tracker::new(Model::builtin(Isa::detect()));
    tracker.init(&frame(&frames[0]), first).unwrap();
    paper.init(&frame(&frames[0]), first).unwrap();
    for (i, data) in frames.iter().enumerate().skip(1) {
        let track = follow(&mut tracker, data, 3);
        assert_eq!(track.searches, if i < 15 { 1 } else { 3 }, "frame {i}");
        assert!(
            track.state == State::LowConfidence && !track.is_believed(),
            "frame {i}: {track:?}"
        );
        let iou = track.bbox.iou(&paper.update(&frame(data)).unwrap().bbox);
        assert!(iou > 0.7, "frame {i}: what is followed is kept, IoU {iou}");
    }
}

#[test]
fn the_same_searches_give_the_same_boxes() {
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
fn no_target_is_an_error_and_strange_frames_are_none() {
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
fn track_tells_presence_and_state_in_flight_mode_only() {
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
    let (paper, flight) = (run("paper"), run("flight"));
    assert_eq!((paper.len(), flight.len()), (3, 3));
    assert!(
        paper
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
