//! The MAVLink camera protocol, as far as tracking needs it: <https://mavlink.io/en/services/camera.html>.

use std::sync::Arc;
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::*;

use super::MavlinkArgs;
use super::unknown::Unknown;
use crate::serve::hub::{Command, Hub};
use crate::serve::report::Report;
use track_cpu::State;

/// How often the tracking status is sent unless somebody asks otherwise.
const INTERVAL: Duration = Duration::from_millis(100);
/// Bounds of what may be asked for.
const SHORTEST: Duration = Duration::from_millis(20);
const LONGEST: Duration = Duration::from_secs(60);
/// Message numbers that may be asked for.
const CAMERA_INFORMATION: u32 = 259;
const CAMERA_SETTINGS: u32 = 260;
const VIDEO_STREAM_INFORMATION: u32 = 269;
const CAMERA_TRACKING_IMAGE_STATUS: u32 = 275;

/// What the camera knows of its clients.
pub struct Camera {
    system: u8,
    component: u8,
    allowed: Vec<u32>,
    uri: Option<String>,
    hfov: Option<f64>,
    hub: Arc<Hub>,
    began: Instant,
    interval: Option<Duration>, // `None`: nobody wants the status
    next_status: Instant,
    by_point: bool,
}

impl Camera {
    /// A camera that nobody has spoken to yet.
    pub fn new(args: &MavlinkArgs, hub: Arc<Hub>) -> Camera {
        let allowed = args
            .mav_allow
            .iter()
            .chain([&args.mav_system])
            .map(|&id| id.into())
            .collect();
        let now = Instant::now();
        Camera {
            system: args.mav_system,
            component: args.mav_component,
            allowed,
            uri: args.video_uri.clone(),
            hfov: args.hfov,
            hub,
            began: now,
            interval: Some(INTERVAL),
            next_status: now,
            by_point: false,
        }
    }

    /// What a message is answered with; nothing where it is not for us, no command, or not from an allowed system.
    pub fn answer(&mut self, from: u32, message: &MavMessage) -> Vec<MavMessage> {
        let (command, parameters, system, component) = match message {
            MavMessage::COMMAND_LONG(c) => (
                c.command,
                [c.param1, c.param2, c.param3, c.param4],
                c.target_system,
                c.target_component,
            ),
            MavMessage::COMMAND_INT(c) => (
                c.command,
                [c.param1, c.param2, c.param3, c.param4],
                c.target_system,
                c.target_component,
            ),
            _ => return Vec::new(),
        };
        if !self.listens(from, system, component) {
            return Vec::new();
        }
        // A broadcast to all components is acknowledged by those it concerns.
        let addressed = component == self.component;
        let (result, reply) = self.obey(command, parameters);
        if result == MavResult::MAV_RESULT_UNSUPPORTED && !addressed {
            return Vec::new();
        }
        let ack = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command, result });
        [Some(ack), reply].into_iter().flatten().collect()
    }

    /// Whether a command without a name is to be refused; one that is for all components is left to those it concerns.
    pub fn refuses(&self, from: u32, unknown: &Unknown) -> bool {
        unknown.component == self.component && self.listens(from, unknown.system, unknown.component)
    }

    /// Whether a command is for us and from somebody who may give one.
    fn listens(&self, from: u32, system: u8, component: u8) -> bool {
        let to_us = [0, self.system].contains(&system) && [0, self.component].contains(&component);
        to_us && self.allowed.contains(&from)
    }

    fn obey(&mut self, command: MavCmd, p: [f32; 4]) -> (MavResult, Option<MavMessage>) {
        use MavResult::*;
        let taken = |accepted| {
            if accepted {
                MAV_RESULT_ACCEPTED
            } else {
                MAV_RESULT_DENIED
            }
        };
        #[allow(deprecated)] // ground stations in the field still ask in the old form
        match command {
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.requested(p[0]),
            MavCmd::MAV_CMD_REQUEST_CAMERA_INFORMATION => self.requested(CAMERA_INFORMATION as f32),
            MavCmd::MAV_CMD_REQUEST_CAMERA_SETTINGS => self.requested(CAMERA_SETTINGS as f32),
            MavCmd::MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION => {
                self.requested(VIDEO_STREAM_INFORMATION as f32)
            }
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => (self.set_interval(p[0], p[1]), None),
            MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE => {
                let accepted = self.hub.command(Command::Rectangle(p));
                self.track(accepted, false);
                (taken(accepted), None)
            }
            MavCmd::MAV_CMD_CAMERA_TRACK_POINT => {
                let radius = Some(p[2]).filter(|r| r.is_finite() && *r > 0.0);
                let accepted = self.hub.command(Command::Point {
                    x: p[0],
                    y: p[1],
                    radius,
                });
                self.track(accepted, true);
                (taken(accepted), None)
            }
            MavCmd::MAV_CMD_CAMERA_STOP_TRACKING => (taken(self.hub.command(Command::Stop)), None),
            _ => (MAV_RESULT_UNSUPPORTED, None),
        }
    }

    /// Whoever starts wants to see what becomes of it.
    fn track(&mut self, accepted: bool, by_point: bool) {
        if accepted {
            self.by_point = by_point;
            self.interval.get_or_insert(INTERVAL);
        }
    }

    fn requested(&self, number: f32) -> (MavResult, Option<MavMessage>) {
        let (_, report) = self.hub.report();
        let reply = match number as u32 {
            CAMERA_INFORMATION => Some(self.information(&report)),
            CAMERA_SETTINGS => Some(MavMessage::CAMERA_SETTINGS(CAMERA_SETTINGS_DATA {
                time_boot_ms: self.time_ms(),
                mode_id: CameraMode::CAMERA_MODE_VIDEO,
            })),
            VIDEO_STREAM_INFORMATION => self.stream(&report),
            CAMERA_TRACKING_IMAGE_STATUS => Some(status(&report, self.by_point)),
            _ => None,
        };
        match reply {
            Some(_) => (MavResult::MAV_RESULT_ACCEPTED, reply),
            None => (MavResult::MAV_RESULT_UNSUPPORTED, None),
        }
    }

    fn set_interval(&mut self, number: f32, microseconds: f32) -> MavResult {
        if number as u32 != CAMERA_TRACKING_IMAGE_STATUS {
            return MavResult::MAV_RESULT_UNSUPPORTED;
        }
        self.interval = match microseconds {
            v if v.is_nan() => return MavResult::MAV_RESULT_DENIED,
            v if v < 0.0 => None,
            0.0 => Some(INTERVAL),
            v => Some(Duration::from_micros(v.min(1e9) as u64).clamp(SHORTEST, LONGEST)),
        };
        self.next_status = Instant::now();
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// The tracking status, when it is time for it.
    pub fn due(&mut self, now: Instant, report: &Report) -> Option<MavMessage> {
        let interval = self.interval?;
        if now < self.next_status {
            return None;
        }
        let next = self.next_status + interval;
        self.next_status = if next > now { next } else { now + interval };
        Some(status(report, self.by_point))
    }

    fn time_ms(&self) -> u32 {
        self.began.elapsed().as_millis() as u32 // wraps after 49 days, as the protocol has it
    }

    fn information(&self, report: &Report) -> MavMessage {
        let mut flags = CameraCapFlags::CAMERA_CAP_FLAGS_CAPTURE_VIDEO
            | CameraCapFlags::CAMERA_CAP_FLAGS_HAS_TRACKING_POINT
            | CameraCapFlags::CAMERA_CAP_FLAGS_HAS_TRACKING_RECTANGLE;
        if self.uri.is_some() {
            flags |= CameraCapFlags::CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM;
        }
        let (w, h) = report.size;
        MavMessage::CAMERA_INFORMATION(CAMERA_INFORMATION_DATA {
            time_boot_ms: self.time_ms(),
            firmware_version: version(env!("CARGO_PKG_VERSION")),
            focal_length: f32::NAN,
            sensor_size_h: f32::NAN,
            sensor_size_v: f32::NAN,
            flags,
            resolution_h: w.min(usize::from(u16::MAX)) as u16,
            resolution_v: h.min(usize::from(u16::MAX)) as u16,
            vendor_name: name("track-cpu"),
            model_name: name("tracking camera"),
            ..Default::default()
        })
    }

    fn stream(&self, report: &Report) -> Option<MavMessage> {
        let uri = self.uri.as_deref()?;
        let (w, h) = report.size;
        Some(MavMessage::VIDEO_STREAM_INFORMATION(
            VIDEO_STREAM_INFORMATION_DATA {
                framerate: 30.0,
                flags: VideoStreamStatusFlags::VIDEO_STREAM_STATUS_FLAGS_RUNNING,
                resolution_h: w.min(usize::from(u16::MAX)) as u16,
                resolution_v: h.min(usize::from(u16::MAX)) as u16,
                hfov: self.hfov.map_or(0, |degrees| degrees.round() as u16),
                stream_id: 1,
                count: 1,
                mavtype: VideoStreamType::VIDEO_STREAM_TYPE_RTSP,
                name: "track-cpu".into(),
                uri: uri.into(),
                ..Default::default()
            },
        ))
    }
}

/// "I am a camera", once a second.
pub fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_CAMERA,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: MavState::MAV_STATE_ACTIVE,
        mavlink_version: 3,
    })
}

/// Where the target is, in shares of the frame; idle while nothing is followed, an error while it is lost.
pub fn status(report: &Report, by_point: bool) -> MavMessage {
    use CameraTrackingStatusFlags as Flags;
    let mut data = CAMERA_TRACKING_IMAGE_STATUS_DATA {
        point_x: f32::NAN,
        point_y: f32::NAN,
        radius: f32::NAN,
        rec_top_x: f32::NAN,
        rec_top_y: f32::NAN,
        rec_bottom_x: f32::NAN,
        rec_bottom_y: f32::NAN,
        tracking_status: Flags::empty(),
        tracking_mode: CameraTrackingMode::CAMERA_TRACKING_MODE_NONE,
        target_data: CameraTrackingTargetData::CAMERA_TRACKING_TARGET_DATA_IN_STATUS,
    };
    let (Some(track), (w @ 1.., h @ 1..)) = (&report.track, report.size) else {
        return MavMessage::CAMERA_TRACKING_IMAGE_STATUS(data);
    };
    data.tracking_status = match track.state {
        State::Coasting => {
            Flags::CAMERA_TRACKING_STATUS_FLAGS_ACTIVE
                | Flags::CAMERA_TRACKING_STATUS_FLAGS_COASTING
        }
        State::Lost => Flags::CAMERA_TRACKING_STATUS_FLAGS_ERROR,
        _ => Flags::CAMERA_TRACKING_STATUS_FLAGS_ACTIVE,
    };
    let (w, h, b) = (w as f32, h as f32, track.bbox);
    let share = |v: f32| v.clamp(0.0, 1.0);
    if by_point {
        data.tracking_mode = CameraTrackingMode::CAMERA_TRACKING_MODE_POINT;
        data.point_x = share((b.x + b.w / 2.0) / w);
        data.point_y = share((b.y + b.h / 2.0) / h);
        data.radius = share(b.w.max(b.h) / 2.0 / w);
    } else {
        data.tracking_mode = CameraTrackingMode::CAMERA_TRACKING_MODE_RECTANGLE;
    }
    // In both modes: ground stations draw the rectangle where there is one.
    (data.rec_top_x, data.rec_top_y) = (share(b.x / w), share(b.y / h));
    (data.rec_bottom_x, data.rec_bottom_y) = (share((b.x + b.w) / w), share((b.y + b.h) / h));
    MavMessage::CAMERA_TRACKING_IMAGE_STATUS(data)
}

fn name<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    for (byte, c) in bytes.iter_mut().zip(text.bytes().take(N - 1)) {
        *byte = c;
    }
    bytes
}

/// `major.minor.patch`, a byte each from the lowest on.
fn version(text: &str) -> u32 {
    text.split('.')
        .take(3)
        .enumerate()
        .map(|(i, part)| part.parse::<u8>().map_or(0, u32::from) << (8 * i))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::serve::report::Tracked;
    use clap::Parser;
    use track_cpu::BBox;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        args: MavlinkArgs,
    }

    fn camera(options: &[&str]) -> (Camera, Arc<Hub>) {
        let hub = Arc::new(Hub::new());
        let line = Line::parse_from([&["x"], options].concat());
        (Camera::new(&line.args, Arc::clone(&hub)), hub)
    }

    fn ask(camera: &mut Camera, system_id: u32, command: MavCmd, p: [f32; 4]) -> Vec<MavMessage> {
        let data = COMMAND_LONG_DATA {
            command,
            param1: p[0],
            param2: p[1],
            param3: p[2],
            param4: p[3],
            target_system: 1,
            target_component: 100,
            ..Default::default()
        };
        camera.answer(system_id, &MavMessage::COMMAND_LONG(data))
    }

    fn result(answers: &[MavMessage]) -> MavResult {
        match answers.first() {
            Some(MavMessage::COMMAND_ACK(ack)) => ack.result,
            other => panic!("expected an acknowledgement, found {other:?}"),
        }
    }

    #[test]
    #[allow(deprecated)]
    fn is_discovered_in_both_forms() {
        let (mut camera, _) = camera(&["--video-uri", "rtsp://10.0.0.2/main"]);
        for (command, p) in [
            (MavCmd::MAV_CMD_REQUEST_MESSAGE, 259.0),
            (MavCmd::MAV_CMD_REQUEST_CAMERA_INFORMATION, 1.0),
        ] {
            let answers = ask(&mut camera, 255, command, [p, 0.0, 0.0, 0.0]);
            assert_eq!(result(&answers), MavResult::MAV_RESULT_ACCEPTED);
            let Some(MavMessage::CAMERA_INFORMATION(information)) = answers.get(1) else {
                panic!("{answers:?}")
            };
            assert_eq!(
                information.flags.bits() & (256 | 512 | 1024),
                256 | 512 | 1024
            );
        }
        let answers = ask(
            &mut camera,
            255,
            MavCmd::MAV_CMD_REQUEST_MESSAGE,
            [269.0, 0.0, 0.0, 0.0],
        );
        let Some(MavMessage::VIDEO_STREAM_INFORMATION(stream)) = answers.get(1) else {
            panic!("{answers:?}")
        };
        assert_eq!(stream.uri.to_str(), Ok("rtsp://10.0.0.2/main"));
    }

    #[test]
    fn rectangles_points_and_stops_become_commands() {
        let (mut camera, hub) = camera(&[]);
        let rectangle = [0.1, 0.2, 0.3, 0.4];
        let mut tell = |command, p| result(&ask(&mut camera, 255, command, p));
        assert_eq!(
            tell(MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE, rectangle),
            MavResult::MAV_RESULT_ACCEPTED
        );
        let point = [0.5, 0.6, f32::NAN, 0.0];
        assert_eq!(
            tell(MavCmd::MAV_CMD_CAMERA_TRACK_POINT, point),
            MavResult::MAV_RESULT_ACCEPTED
        );
        assert_eq!(
            tell(MavCmd::MAV_CMD_CAMERA_STOP_TRACKING, [0.0; 4]),
            MavResult::MAV_RESULT_ACCEPTED
        );
        let nonsense = [f32::NAN, 0.0, 9.0, 1.0];
        assert_eq!(
            tell(MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE, nonsense),
            MavResult::MAV_RESULT_DENIED
        );
        assert_eq!(
            tell(MavCmd::MAV_CMD_DO_SET_HOME, [0.0; 4]),
            MavResult::MAV_RESULT_UNSUPPORTED
        );
        assert_eq!(
            tell(MavCmd::MAV_CMD_REQUEST_MESSAGE, [1.0, 0.0, 0.0, 0.0]),
            MavResult::MAV_RESULT_UNSUPPORTED
        );
        let taken = hub.take_commands();
        let point = Command::Point {
            x: 0.5,
            y: 0.6,
            radius: None,
        };
        assert_eq!(taken, [Command::Rectangle(rectangle), point, Command::Stop]);
    }

    #[test]
    fn strangers_and_other_addressees_are_ignored() {
        let (mut camera, hub) = camera(&["--mav-allow", "250"]);
        assert!(
            ask(
                &mut camera,
                255,
                MavCmd::MAV_CMD_CAMERA_STOP_TRACKING,
                [0.0; 4]
            )
            .is_empty()
        );
        assert_eq!(
            ask(
                &mut camera,
                250,
                MavCmd::MAV_CMD_CAMERA_STOP_TRACKING,
                [0.0; 4]
            )
            .len(),
            1
        );
        let data = COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_CAMERA_STOP_TRACKING,
            target_system: 1,
            target_component: 101,
            ..Default::default()
        };
        assert!(
            camera
                .answer(250, &MavMessage::COMMAND_LONG(data))
                .is_empty()
        );
        assert_eq!(hub.take_commands().len(), 1);
    }

    #[test]
    fn the_interval_is_honored() {
        let (mut camera, _) = camera(&[]);
        let report = Report::default();
        let start = Instant::now() + Duration::from_millis(1);
        let sent = |camera: &mut Camera, start: Instant| {
            (0..1000)
                .filter(|ms| {
                    camera
                        .due(start + Duration::from_millis(*ms), &report)
                        .is_some()
                })
                .count()
        };
        assert!((10..=11).contains(&sent(&mut camera, start)));
        let interval = MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL;
        ask(&mut camera, 255, interval, [275.0, 500_000.0, 0.0, 0.0]);
        assert!((2..=3).contains(&sent(&mut camera, start + Duration::from_secs(2))));
        ask(&mut camera, 255, interval, [275.0, -1.0, 0.0, 0.0]);
        assert_eq!(sent(&mut camera, start + Duration::from_secs(4)), 0);
        let answers = ask(&mut camera, 255, interval, [275.0, f32::NAN, 0.0, 0.0]);
        assert_eq!(result(&answers), MavResult::MAV_RESULT_DENIED);
    }

    #[test]
    fn status_tells_state_and_place() {
        let mut report = Report {
            size: (200, 100),
            ..Report::default()
        };
        let flags = |report: &Report| match status(report, false) {
            MavMessage::CAMERA_TRACKING_IMAGE_STATUS(s) => {
                (s.tracking_status.bits(), s.rec_top_x, s.rec_bottom_y)
            }
            other => panic!("{other:?}"),
        };
        assert_eq!(flags(&report).0, 0);
        for (state, expected) in [
            (State::Tracking, 1),
            (State::Coasting, 9),
            (State::Lost, 2),
            (State::Reacquired, 1),
        ] {
            let bbox = BBox::new(50.0, 60.0, 20.0, 80.0);
            let track = Tracked {
                bbox,
                presence: None,
                score: 0.5,
                state,
                searches: 1,
                candidates: Vec::new(),
            };
            report.track = Some(track);
            assert_eq!(flags(&report), (expected, 0.25, 1.0));
        }
    }

    #[test]
    fn versions() {
        assert_eq!(version("1.2.3"), 0x0003_0201);
    }
}
