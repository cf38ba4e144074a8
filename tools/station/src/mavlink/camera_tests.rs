use super::*;
use crate::hub::Limits;
use crate::picture::{FrameBox, Picture};
use crate::report::{Followed, Report, Tracked};

const PEER: Peer = 1;
/// One peer, which gets no telemetry.
const PEERS: [(Peer, bool); 1] = [(PEER, false)];

/// A camera beside a live source of frames of 200 x 100 pixels.
fn live_camera(options: MavlinkOptions) -> (Camera, Arc<Hub>) {
    let (camera, hub) = camera_without_frames(options);
    hub.tell(|pulse| pulse.frame(Instant::now()));
    publish(&hub, (200, 100), None);
    (camera, hub)
}

fn camera_without_frames(options: MavlinkOptions) -> (Camera, Arc<Hub>) {
    let hub = Arc::new(Hub::new(Limits::default()));
    (Camera::new(&options, Arc::clone(&hub)), hub)
}

fn publish(hub: &Hub, size: (usize, usize), track: Option<Tracked>) {
    let picture = Picture::dot();
    let targets = track.into_iter().map(|track| Followed {
        id: FIRST,
        start: 1,
        track,
    });
    let report = Report {
        size,
        targets: targets.collect(),
        taken: Some(Instant::now()),
        ..Report::default()
    };
    hub.publish(report, &picture);
}

fn ask(camera: &mut Camera, system: u32, command: MavCmd, p: [f32; 4]) -> Vec<MavMessage> {
    let [param1, param2, param3, param4] = p;
    let data = COMMAND_LONG_DATA {
        command,
        param1,
        param2,
        param3,
        param4,
        target_system: 1,
        target_component: 100,
        ..Default::default()
    };
    let answers = camera.answer(PEER, system, &MavMessage::COMMAND_LONG(data));
    answers.into_iter().map(|(_, message)| message).collect()
}

/// What the camera sends by itself, without the status.
fn later(camera: &mut Camera, hub: &Hub) -> Vec<MavMessage> {
    let due = camera.due(Instant::now(), &hub.view(), &PEERS);
    due.into_iter().map(|(_, message)| message).collect()
}

fn result(answers: &[MavMessage]) -> MavResult {
    match answers.first() {
        Some(MavMessage::COMMAND_ACK(ack)) => ack.result,
        other => panic!("expected an acknowledgement, found {other:?}"),
    }
}

const RECTANGLE: [f32; 4] = [0.1, 0.2, 0.3, 0.4];

#[test]
#[expect(deprecated, reason = "the old form is tested as well")]
fn camera_is_discovered_in_both_forms_by_every_system() {
    let (mut camera, _) = live_camera(MavlinkOptions {
        video_uri: Some("rtsp://10.0.0.2/main".into()),
        ..MavlinkOptions::default()
    });

    for (system, command, p) in [
        (255, MavCmd::MAV_CMD_REQUEST_MESSAGE, 259.0),
        (245, MavCmd::MAV_CMD_REQUEST_CAMERA_INFORMATION, 1.0),
    ] {
        let answers = ask(&mut camera, system, command, [p, 0.0, 0.0, 0.0]);
        assert_eq!(result(&answers), MavResult::MAV_RESULT_ACCEPTED);
        let Some(MavMessage::CAMERA_INFORMATION(information)) = answers.get(1) else {
            panic!("{answers:?}")
        };
        // Tracking by point and rectangle and a video stream, but no capture of video.
        assert_eq!(information.flags.bits() & 1793, 1792);
        assert_eq!(
            (information.resolution_h, information.resolution_v),
            (200, 100)
        );
    }
    let request = MavCmd::MAV_CMD_REQUEST_MESSAGE;
    let answers = ask(&mut camera, 255, request, [269.0, 0.0, 0.0, 0.0]);
    let Some(MavMessage::VIDEO_STREAM_INFORMATION(stream)) = answers.get(1) else {
        panic!("{answers:?}")
    };
    assert_eq!(stream.uri.to_str(), Ok("rtsp://10.0.0.2/main"));
    for (number, expected) in [
        (260.0, MavResult::MAV_RESULT_ACCEPTED),
        (261.0, MavResult::MAV_RESULT_ACCEPTED),
        (262.0, MavResult::MAV_RESULT_ACCEPTED),
        (270.0, MavResult::MAV_RESULT_ACCEPTED),
        (1.0, MavResult::MAV_RESULT_UNSUPPORTED),
    ] {
        let answers = ask(&mut camera, 255, request, [number, 0.0, 0.0, 0.0]);
        assert_eq!(result(&answers), expected, "{number}");
    }
}

#[test]
fn size_is_told_when_it_is_known_and_again_when_it_changes() {
    let (mut camera, hub) = camera_without_frames(MavlinkOptions::default());
    let request = MavCmd::MAV_CMD_REQUEST_MESSAGE;
    let sizes = |messages: &[MavMessage]| -> Vec<(u16, u16)> {
        messages
            .iter()
            .filter_map(|message| match message {
                MavMessage::CAMERA_INFORMATION(i) => Some((i.resolution_h, i.resolution_v)),
                _ => None,
            })
            .collect()
    };

    let early = ask(&mut camera, 255, request, [259.0, 0.0, 0.0, 0.0]);
    assert_eq!(early.len(), 1, "acknowledged, and no 0x0: {early:?}");
    assert_eq!(sizes(&later(&mut camera, &hub)), []);

    publish(&hub, (640, 360), None);
    assert_eq!(sizes(&later(&mut camera, &hub)), [(640, 360)]);
    assert_eq!(sizes(&later(&mut camera, &hub)), []);

    publish(&hub, (1280, 720), None);
    assert_eq!(sizes(&later(&mut camera, &hub)), [(1280, 720)]);
}

#[test]
fn command_is_acknowledged_once_it_is_carried_out() {
    let (mut camera, hub) = live_camera(MavlinkOptions::default());
    let rectangle = MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE;

    assert!(ask(&mut camera, 255, rectangle, RECTANGLE).is_empty());
    assert!(later(&mut camera, &hub).is_empty());
    hub.take_commands(true)[0].resolve(Outcome::Done);
    let accepted = later(&mut camera, &hub);

    ask(&mut camera, 255, rectangle, RECTANGLE);
    hub.take_commands(true)[0].resolve(Outcome::Refused("outside".into()));
    let denied = later(&mut camera, &hub);

    assert_eq!(result(&accepted), MavResult::MAV_RESULT_ACCEPTED);
    assert_eq!(result(&denied), MavResult::MAV_RESULT_DENIED);
    assert!(later(&mut camera, &hub).is_empty());
}

#[test]
fn slow_command_is_in_progress_and_a_repeated_one_is_answered_once() {
    let (mut camera, hub) = live_camera(MavlinkOptions::default());
    let rectangle = MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE;
    ask(&mut camera, 255, rectangle, RECTANGLE);
    ask(&mut camera, 255, rectangle, RECTANGLE);

    let soon = Instant::now() + PROGRESS;
    let told = camera.due(soon, &hub.view(), &PEERS);
    let again = camera.due(soon, &hub.view(), &PEERS);

    assert_eq!(told.len(), 1);
    assert_eq!(
        result(&[told[0].1.clone()]),
        MavResult::MAV_RESULT_IN_PROGRESS
    );
    assert!(again.is_empty());
}

#[test]
fn start_without_frames_is_temporarily_rejected() {
    let (mut camera, hub) = camera_without_frames(MavlinkOptions::default());
    let rectangle = MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE;

    ask(&mut camera, 255, rectangle, RECTANGLE);

    let rejected = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
    assert_eq!(result(&later(&mut camera, &hub)), rejected);
    assert!(hub.take_commands(true).is_empty(), "it does not wait");
}

#[test]
fn points_stops_and_nonsense_are_told_apart() {
    let (mut camera, hub) = live_camera(MavlinkOptions::default());
    ask(
        &mut camera,
        255,
        MavCmd::MAV_CMD_CAMERA_TRACK_POINT,
        [0.5, 0.6, f32::NAN, 0.0],
    );
    ask(
        &mut camera,
        255,
        MavCmd::MAV_CMD_CAMERA_STOP_TRACKING,
        [0.0; 4],
    );
    ask(
        &mut camera,
        255,
        MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE,
        [f32::NAN, 0.0, 9.0, 1.0],
    );
    let unsupported = ask(&mut camera, 255, MavCmd::MAV_CMD_DO_SET_HOME, [0.0; 4]);

    let target = Target::Point {
        x: 0.5,
        y: 0.6,
        radius: None,
    };
    let point = Command::Start {
        target,
        frame: None,
        id: Some(FIRST),
    };
    let taken: Vec<Command> = hub
        .take_commands(true)
        .iter()
        .map(|pending| pending.command)
        .collect();
    assert_eq!(taken, [point, Command::Stop { id: None }]);
    assert_eq!(
        result(&later(&mut camera, &hub)),
        MavResult::MAV_RESULT_DENIED
    );
    assert_eq!(result(&unsupported), MavResult::MAV_RESULT_UNSUPPORTED);
}

#[test]
fn stranger_is_denied_control_and_other_addressees_are_ignored() {
    let (mut camera, hub) = live_camera(MavlinkOptions {
        allow: vec![250],
        ..MavlinkOptions::default()
    });
    let stop = MavCmd::MAV_CMD_CAMERA_STOP_TRACKING;
    let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;

    let denied = ask(&mut camera, 255, stop, [0.0; 4]);
    let slowed = ask(&mut camera, 255, interval, [275.0, -1.0, 0.0, 0.0]);
    let data = COMMAND_LONG_DATA {
        command: stop,
        target_system: 1,
        target_component: 101,
        ..Default::default()
    };
    let elsewhere = camera.answer(PEER, 250, &MavMessage::COMMAND_LONG(data));
    ask(&mut camera, 250, stop, [0.0; 4]);

    assert_eq!(result(&denied), MavResult::MAV_RESULT_DENIED);
    assert_eq!(result(&slowed), MavResult::MAV_RESULT_DENIED);
    assert!(elsewhere.is_empty());
    assert_eq!(hub.take_commands(true).len(), 1);
}

#[test]
fn status_says_state_place_and_age() {
    let hub = Hub::new(Limits::default());
    let flags = |view: &View| match status(view, false) {
        MavMessage::CAMERA_TRACKING_IMAGE_STATUS(s) => {
            (s.tracking_status.bits(), s.rec_top_x, s.rec_bottom_y)
        }
        other => panic!("{other:?}"),
    };
    publish(&hub, (200, 100), None);
    assert_eq!(flags(&hub.view()).0, 0);

    for (state, freshness, expected) in [
        (State::Tracking, Freshness::Fresh, 1),
        (State::Coasting, Freshness::Fresh, 9),
        (State::Lost, Freshness::Fresh, 2),
        (State::Reacquired, Freshness::Fresh, 1),
        (State::Tracking, Freshness::Stale, 9),
        (State::Lost, Freshness::Stale, 2),
    ] {
        let track = Tracked {
            state,
            ..Tracked::certain(FrameBox::new(50.0, 60.0, 20.0, 80.0))
        };
        publish(&hub, (200, 100), Some(track));
        let view = View {
            freshness,
            ..hub.view()
        };

        assert_eq!(
            flags(&view),
            (expected, 0.25, 1.0),
            "{state:?} {freshness:?}"
        );
    }
    let dead = View {
        freshness: Freshness::Dead,
        ..hub.view()
    };
    assert_eq!(flags(&dead).0, 2);
    assert!(flags(&dead).1.is_nan());
}

#[test]
fn version_has_a_byte_for_each_number() {
    assert_eq!(version("1.2.3"), 0x0003_0201);
}
