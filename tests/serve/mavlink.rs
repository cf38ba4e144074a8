//! MAVLink as ground stations speak it.

use std::net::{TcpListener, TcpStream};
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::*;

use crate::support::*;

const TRACK: MavCmd = MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE;
const STOP: MavCmd = MavCmd::MAV_CMD_CAMERA_STOP_TRACKING;
const REQUEST: MavCmd = MavCmd::MAV_CMD_REQUEST_MESSAGE;

/// `serve` on a slow flight, so that a busy machine keeps up.
fn serve(extra: &[&str]) -> Serving {
    Serving::start(&[&SLOW_FLIGHT[..], extra].concat())
}

#[test]
fn ground_station_finds_the_camera_starts_and_stops_it() {
    let (station, address) = GroundStation::listen();
    let serving = serve(&["--mavlink", &address]);
    station.wait("heartbeat of a live camera", |message| match message {
        MavMessage::HEARTBEAT(heartbeat) => {
            assert_eq!(heartbeat.mavtype, MavType::MAV_TYPE_CAMERA);
            (heartbeat.system_status == MavState::MAV_STATE_ACTIVE).then_some(())
        }
        _ => None,
    });
    assert_eq!(station.status().tracking_status.bits(), 0);
    station.command(255, MavCmd::MAV_CMD_DO_SET_HOME, [0.0; 4]);
    let unsupported = station.result(MavCmd::MAV_CMD_DO_SET_HOME);
    assert_eq!(unsupported, MavResult::MAV_RESULT_UNSUPPORTED);

    station.insist(TRACK, RECTANGLE);
    let status = station.wait("box", |message| match message {
        MavMessage::CAMERA_TRACKING_IMAGE_STATUS(status) => {
            Some(status).filter(|status| status.tracking_status.bits() != 0)
        }
        _ => None,
    });
    assert!(status.rec_top_x < status.rec_bottom_x, "{status:?}");
    assert!((0.0..=1.0).contains(&status.rec_bottom_y), "{status:?}");

    station.insist(STOP, [0.0; 4]);
    station.wait_for_status(0);
    assert_eq!(serving.end(), Some(0));
}

#[test]
fn every_system_may_ask_and_only_allowed_ones_may_control() {
    let (station, address) = GroundStation::listen();
    let serving = serve(&["--mavlink", &address]);

    // MAVSDK's ground stations are system 245.
    station.wait("heartbeat", |message| {
        matches!(message, MavMessage::HEARTBEAT(_)).then_some(())
    });
    station.command(245, REQUEST, [259.0, 0.0, 0.0, 0.0]);
    let information = station.wait("camera information", |message| match message {
        MavMessage::CAMERA_INFORMATION(information) => Some(information),
        _ => None,
    });
    station.command(245, TRACK, RECTANGLE);
    let denied = station.result(TRACK);
    station.command(245, TRACK, RECTANGLE);
    station.result(TRACK);

    let size = (information.resolution_h, information.resolution_v);
    assert_eq!(size, (320, 180), "the size is told once it is known");
    assert_eq!(information.flags.bits() & 1, 0, "no capture of video");
    assert_eq!(denied, MavResult::MAV_RESULT_DENIED);
    assert_eq!(station.status().tracking_status.bits(), 0);
    let said = serving.said();
    assert_eq!(said.matches("--mav-allow 245").count(), 1, "{said}");
}

#[test]
fn commands_are_acknowledged_by_what_became_of_them() {
    let (station, address) = GroundStation::listen();
    let _serving = serve(&["--mavlink", &address]);
    station.insist(TRACK, RECTANGLE);
    station.wait_for_status(1);

    for (rectangle, expected) in [
        ([-0.05, -0.05, -0.01, -0.01], MavResult::MAV_RESULT_DENIED),
        ([0.5, 0.5, 0.5001, 0.5001], MavResult::MAV_RESULT_DENIED),
        ([0.0, 0.0, 1.0, 1.0], MavResult::MAV_RESULT_DENIED),
        ([f32::NAN, 0.0, 9.0, 1.0], MavResult::MAV_RESULT_DENIED),
        (RECTANGLE, MavResult::MAV_RESULT_ACCEPTED),
    ] {
        station.command(255, TRACK, rectangle);
        assert_eq!(station.result(TRACK), expected, "{rectangle:?}");
        // A refused box keeps the old target.
        assert_ne!(station.status().tracking_status.bits(), 0);
    }
}

#[test]
fn start_without_a_camera_is_rejected_and_does_not_wait_for_one() {
    let (station, address) = GroundStation::listen();
    let serving = Serving::start(&["--input", "/dev/video77", "--quiet", "--mavlink", &address]);
    station.wait(
        "heartbeat of a camera that boots",
        |message| match message {
            MavMessage::HEARTBEAT(heartbeat) => {
                (heartbeat.system_status == MavState::MAV_STATE_BOOT).then_some(())
            }
            _ => None,
        },
    );

    station.command(255, TRACK, RECTANGLE);
    let started = station.result(TRACK);
    station.command(255, STOP, [0.0; 4]);
    let stopped = station.result(STOP);

    assert_eq!(started, MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
    assert_eq!(stopped, MavResult::MAV_RESULT_ACCEPTED);
    serving.wait_for("opening it again");
    assert_eq!(serving.end(), Some(0));
}

/// Tracking statuses that come within a time.
fn statuses(station: &GroundStation, time: Duration) -> usize {
    let end = Instant::now() + time;
    let mut count = 0;
    while Instant::now() < end {
        let message = station.next();
        count += usize::from(matches!(
            message,
            Some(MavMessage::CAMERA_TRACKING_IMAGE_STATUS(_))
        ));
    }
    count
}

#[test]
fn listening_link_serves_all_ground_stations_each_at_its_interval() {
    let port = free_udp_port();
    let listening = format!("udpin:127.0.0.1:{port}");
    let _serving = serve(&["--mavlink", &listening, "--mav-allow", "255,254"]);
    let call = |system: u8| {
        let station = GroundStation::call(port, system);
        let heard = until(|| {
            station.say_hello(system);
            station.next()
        });
        assert!(heard.is_some(), "system {system} hears nothing");
        station
    };
    let first = call(255);
    let second = call(254);
    let stranger = call(77);

    second.command(
        254,
        MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
        [275.0, -1.0, 0.0, 0.0],
    );
    second.result(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL);

    assert_eq!(statuses(&second, Duration::from_secs(2)), 0);
    assert_eq!(statuses(&stranger, Duration::from_secs(2)), 0);
    let count = statuses(&first, Duration::from_secs(2));
    assert!(count >= 10, "{count} statuses in two seconds");
}

#[test]
fn two_links_lead_to_two_ground_stations() {
    let (first, to_first) = GroundStation::listen();
    let (second, to_second) = GroundStation::listen();
    let _serving = serve(&["--mavlink", &to_first, "--mavlink", &to_second]);

    first.insist(TRACK, RECTANGLE);

    second.wait_for_status(1);
}

#[test]
fn connections_work_both_ways_and_a_dead_one_holds_up_nothing() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let outward = format!("tcpout:{}", listener.local_addr().unwrap());
    let port = free_tcp_port();
    let inward = format!("tcpin:127.0.0.1:{port}");
    let page = Page::new();
    let serving = serve(
        &[
            &["--mavlink", &outward, "--mavlink", &inward][..],
            &page.options(),
        ]
        .concat(),
    );
    // The connection outward is never accepted nor read; frames come anyway.
    let frames = until(|| page.state()["frame"].as_u64().filter(|frame| *frame > 3));
    assert!(frames.is_some(), "{}", serving.said());

    let mut stream = until(|| TcpStream::connect(("127.0.0.1", port)).ok()).unwrap();
    let mut first = [0; 1];
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    std::io::Read::read_exact(&mut stream, &mut first).unwrap();

    assert_eq!(first, [0xfd], "a MAVLink 2 message");
    assert_eq!(serving.end(), Some(0));
}
