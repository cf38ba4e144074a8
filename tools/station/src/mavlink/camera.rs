//! The MAVLink camera protocol, as far as tracking needs it:
//! <https://mavlink.io/en/services/camera.html>.
//!
//! Questions are answered to every system; only allowed ones may start, stop and set intervals.
//! A start or stop is acknowledged once the tracking thread has carried it out. The protocol knows
//! one target: a start is for [`FIRST`], a stop for all, and the status is that of the lowest.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::*;

use super::MavlinkOptions;
use super::clients::Clients;
use super::link::{Audience, Peer};
use super::unknown::Unknown;
use crate::command::{Command, Outcome, Receipt, Target};
use crate::health::Health;
use crate::hub::Hub;
use crate::report::{Freshness, State, TargetId, View};
use crate::say::say;

/// The target that ground stations start.
const FIRST: TargetId = 1;
/// How long a command may take before its client gets the result "in progress".
const PROGRESS: Duration = Duration::from_millis(250);
/// Most commands that wait for their outcome.
const MAX_PENDING: usize = 32;
/// Most refused system ids that are named on standard error.
const MAX_NAMED: usize = 16;

// Numbers of the messages that clients may request.
const CAMERA_INFORMATION: u32 = 259;
const CAMERA_SETTINGS: u32 = 260;
const STORAGE_INFORMATION: u32 = 261;
const CAMERA_CAPTURE_STATUS: u32 = 262;
const VIDEO_STREAM_INFORMATION: u32 = 269;
const VIDEO_STREAM_STATUS: u32 = 270;
const CAMERA_TRACKING_IMAGE_STATUS: u32 = 275;

/// A message and its addressees.
pub type Outgoing = (Audience, MavMessage);

/// The camera on one link, and the state of its clients.
pub struct Camera {
    system: u8,
    component: u8,
    allowed: Vec<u32>,
    uri: Option<String>,
    rate: Option<f32>,
    hfov: Option<f64>,
    hub: Arc<Hub>,
    began: Instant,
    clients: Clients,
    pending: Vec<Waiting>,
    refused: BTreeSet<u32>,      // systems that were named on standard error
    owed: BTreeSet<(Peer, u32)>, // answers that wait for the frame's size
    informed: BTreeSet<(Peer, u32)>, // answers that told the frame's size
    told_size: (usize, usize),
    by_point: bool,
}

/// A command whose outcome is not known yet.
struct Waiting {
    peer: Peer,
    command: MavCmd,
    receipt: Receipt,
    since: Instant,
    is_told: bool,
    by_point: Option<bool>,
}

/// A command that was received.
struct Asked {
    command: MavCmd,
    parameters: [f32; 4],
    system: u8,
    component: u8,
}

impl Camera {
    /// A camera without clients.
    pub fn new(options: &MavlinkOptions, hub: Arc<Hub>) -> Camera {
        Camera {
            system: options.system,
            component: options.component,
            allowed: options.allowed_systems(),
            uri: options.video_uri.clone(),
            rate: options.video_rate,
            hfov: options.hfov,
            hub,
            began: Instant::now(),
            clients: Clients::default(),
            pending: Vec::new(),
            refused: BTreeSet::new(),
            owed: BTreeSet::new(),
            informed: BTreeSet::new(),
            told_size: (0, 0),
            by_point: false,
        }
    }

    /// Answers a message; the answer is empty unless it is a command for this camera.
    pub fn answer(&mut self, peer: Peer, from: u32, message: &MavMessage) -> Vec<Outgoing> {
        let Some(asked) = read_command(message) else {
            return Vec::new();
        };
        if !self.is_for_us(asked.system, asked.component) {
            return Vec::new();
        }
        let result = self.obey(peer, from, asked.command, asked.parameters);
        let mut answers = Vec::new();
        // Only components that a broadcast concerns acknowledge it.
        let is_addressed = asked.component == self.component;
        if let Some(result) = result
            && (is_addressed || result != MavResult::MAV_RESULT_UNSUPPORTED)
        {
            answers.push((Audience::One(peer), acknowledge(asked.command, result)));
            if result == MavResult::MAV_RESULT_ACCEPTED {
                let number = requested(asked.command, asked.parameters);
                answers.extend(number.and_then(|number| self.reply(peer, number)));
            }
        }
        answers
    }

    /// Whether to refuse a command without a name. One for all components is left to those it
    /// concerns.
    pub fn refuses(&self, unknown: &Unknown) -> bool {
        unknown.component == self.component && self.is_for_us(unknown.system, unknown.component)
    }

    fn is_for_us(&self, system: u8, component: u8) -> bool {
        [0, self.system].contains(&system) && [0, self.component].contains(&component)
    }

    /// Carries a command out; `None` if its result is not known yet.
    fn obey(&mut self, peer: Peer, from: u32, command: MavCmd, p: [f32; 4]) -> Option<MavResult> {
        if let Some(number) = requested(command, p) {
            return Some(if self.knows(number) {
                MavResult::MAV_RESULT_ACCEPTED
            } else {
                MavResult::MAV_RESULT_UNSUPPORTED
            });
        }
        let radius = Some(p[2]).filter(|radius| radius.is_finite() && *radius > 0.0);
        let start = |target| Command::Start {
            target,
            frame: None,
            id: Some(FIRST),
        };
        let (order, by_point) = match command {
            MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE => (start(Target::Rectangle(p)), Some(false)),
            MavCmd::MAV_CMD_CAMERA_TRACK_POINT => {
                let [x, y, ..] = p;
                (start(Target::Point { x, y, radius }), Some(true))
            }
            MavCmd::MAV_CMD_CAMERA_STOP_TRACKING => (Command::Stop { id: None }, None),
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL if p[0] as u32 == CAMERA_TRACKING_IMAGE_STATUS => {
                if !self.may_control(from) {
                    return Some(MavResult::MAV_RESULT_DENIED);
                }
                return Some(self.clients.set_interval(peer, from, p[1]));
            }
            _ => return Some(MavResult::MAV_RESULT_UNSUPPORTED),
        };
        if !self.may_control(from) {
            return Some(MavResult::MAV_RESULT_DENIED);
        }
        // A client that repeats itself gets one answer.
        self.pending
            .retain(|waiting| (waiting.peer, waiting.command) != (peer, command));
        if self.pending.len() >= MAX_PENDING {
            return Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED);
        }
        if by_point.is_some() {
            self.clients.wants_status(peer, from);
        }
        self.pending.push(Waiting {
            peer,
            command,
            receipt: self.hub.command(order),
            since: Instant::now(),
            is_told: false,
            by_point,
        });
        None
    }

    /// Whether a system may control the camera; a refusal is reported once.
    fn may_control(&mut self, from: u32) -> bool {
        if self.allowed.contains(&from) {
            return true;
        }
        if self.refused.len() < MAX_NAMED && self.refused.insert(from) {
            say!(
                "mavlink: system {from} may not control the camera; \
                 allow it with --mav-allow {from}"
            );
        }
        false
    }

    fn knows(&self, number: u32) -> bool {
        match number {
            CAMERA_INFORMATION
            | CAMERA_SETTINGS
            | STORAGE_INFORMATION
            | CAMERA_CAPTURE_STATUS
            | CAMERA_TRACKING_IMAGE_STATUS => true,
            VIDEO_STREAM_INFORMATION | VIDEO_STREAM_STATUS => self.uri.is_some(),
            _ => false,
        }
    }

    /// The requested message; one with the frame's size waits until the size is known.
    fn reply(&mut self, peer: Peer, number: u32) -> Option<Outgoing> {
        let view = self.hub.view();
        let tells_size = matches!(
            number,
            CAMERA_INFORMATION | VIDEO_STREAM_INFORMATION | VIDEO_STREAM_STATUS
        );
        if tells_size && view.report.size == (0, 0) {
            if self.owed.len() < MAX_PENDING {
                self.owed.insert((peer, number));
            }
            return None;
        }
        if tells_size && self.informed.len() < MAX_PENDING {
            self.informed.insert((peer, number));
        }
        Some((Audience::One(peer), self.message(number, &view)?))
    }

    fn message(&self, number: u32, view: &View) -> Option<MavMessage> {
        Some(match number {
            CAMERA_INFORMATION => self.information(view),
            CAMERA_SETTINGS => MavMessage::CAMERA_SETTINGS(CAMERA_SETTINGS_DATA {
                time_boot_ms: self.time_ms(),
                mode_id: CameraMode::CAMERA_MODE_VIDEO,
            }),
            STORAGE_INFORMATION => MavMessage::STORAGE_INFORMATION(STORAGE_INFORMATION_DATA {
                time_boot_ms: self.time_ms(),
                status: StorageStatus::STORAGE_STATUS_NOT_SUPPORTED,
                ..Default::default()
            }),
            CAMERA_CAPTURE_STATUS => {
                MavMessage::CAMERA_CAPTURE_STATUS(CAMERA_CAPTURE_STATUS_DATA {
                    time_boot_ms: self.time_ms(),
                    ..Default::default()
                })
            }
            VIDEO_STREAM_INFORMATION => self.stream_information(view)?,
            VIDEO_STREAM_STATUS => self.stream_status(view),
            CAMERA_TRACKING_IMAGE_STATUS => status(view, self.by_point),
            _ => return None,
        })
    }

    /// The messages to send now: results of commands, delayed answers, the tracking status.
    ///
    /// `peers` are those that are remembered, and whether each one gets telemetry.
    pub fn due(&mut self, now: Instant, view: &View, peers: &[(Peer, bool)]) -> Vec<Outgoing> {
        let mut out = self.results(now);
        let is_there = |peer: Peer| peers.iter().any(|(known, _)| *known == peer);
        self.clients.forget(|peer| !is_there(peer));
        self.owed.retain(|(peer, _)| is_there(*peer));
        self.informed.retain(|(peer, _)| is_there(*peer));
        if view.report.size != (0, 0) {
            let owed = std::mem::take(&mut self.owed);
            for (peer, number) in owed {
                out.extend(self.reply(peer, number));
            }
            // A ground station asks only once, so a change of the size is sent without a request.
            let has_changed = std::mem::replace(&mut self.told_size, view.report.size);
            if has_changed != (0, 0) && has_changed != view.report.size {
                for &(peer, number) in &self.informed {
                    let message = self.message(number, view);
                    out.extend(message.map(|message| (Audience::One(peer), message)));
                }
            }
        }
        for &(peer, is_trusted) in peers {
            if is_trusted && self.clients.is_status_due(peer, now) {
                out.push((Audience::One(peer), status(view, self.by_point)));
            }
        }
        out
    }

    fn results(&mut self, now: Instant) -> Vec<Outgoing> {
        let mut out = Vec::new();
        let by_point = &mut self.by_point;
        self.pending.retain_mut(|waiting| {
            let result = match waiting.receipt.outcome() {
                Some(Outcome::Done | Outcome::Started(_)) => MavResult::MAV_RESULT_ACCEPTED,
                Some(Outcome::Refused(_)) => MavResult::MAV_RESULT_DENIED,
                Some(_) => MavResult::MAV_RESULT_TEMPORARILY_REJECTED,
                None if !waiting.is_told && now >= waiting.since + PROGRESS => {
                    waiting.is_told = true;
                    MavResult::MAV_RESULT_IN_PROGRESS
                }
                None => return true,
            };
            let answer = acknowledge(waiting.command, result);
            out.push((Audience::One(waiting.peer), answer));
            if result == MavResult::MAV_RESULT_ACCEPTED {
                *by_point = waiting.by_point.unwrap_or(*by_point);
            }
            result == MavResult::MAV_RESULT_IN_PROGRESS
        });
        out
    }

    fn time_ms(&self) -> u32 {
        self.began.elapsed().as_millis() as u32 // wraps after 49 days, as in the protocol
    }

    fn information(&self, view: &View) -> MavMessage {
        let mut flags = CameraCapFlags::CAMERA_CAP_FLAGS_HAS_TRACKING_POINT
            | CameraCapFlags::CAMERA_CAP_FLAGS_HAS_TRACKING_RECTANGLE;
        if self.uri.is_some() {
            flags |= CameraCapFlags::CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM;
        }
        let (resolution_h, resolution_v) = resolution(view);
        MavMessage::CAMERA_INFORMATION(CAMERA_INFORMATION_DATA {
            time_boot_ms: self.time_ms(),
            firmware_version: version(env!("CARGO_PKG_VERSION")),
            focal_length: f32::NAN,
            sensor_size_h: f32::NAN,
            sensor_size_v: f32::NAN,
            flags,
            resolution_h,
            resolution_v,
            vendor_name: name("track-cpu"),
            model_name: name("tracking camera"),
            ..Default::default()
        })
    }

    fn stream_information(&self, view: &View) -> Option<MavMessage> {
        let uri = self.uri.as_deref()?;
        let (resolution_h, resolution_v) = resolution(view);
        Some(MavMessage::VIDEO_STREAM_INFORMATION(
            VIDEO_STREAM_INFORMATION_DATA {
                framerate: self.rate.unwrap_or(view.frame_rate()),
                flags: stream_flags(view),
                resolution_h,
                resolution_v,
                hfov: self.hfov.map_or(0, |degrees| degrees.round() as u16),
                stream_id: 1,
                count: 1,
                mavtype: stream_type(uri),
                name: "track-cpu".into(),
                uri: uri.into(),
                ..Default::default()
            },
        ))
    }

    fn stream_status(&self, view: &View) -> MavMessage {
        let (resolution_h, resolution_v) = resolution(view);
        MavMessage::VIDEO_STREAM_STATUS(VIDEO_STREAM_STATUS_DATA {
            framerate: self.rate.unwrap_or(view.frame_rate()),
            flags: stream_flags(view),
            resolution_h,
            resolution_v,
            hfov: self.hfov.map_or(0, |degrees| degrees.round() as u16),
            stream_id: 1,
            ..Default::default()
        })
    }
}

/// The command of a message, if it is one.
fn read_command(message: &MavMessage) -> Option<Asked> {
    match message {
        MavMessage::COMMAND_LONG(c) => Some(Asked {
            command: c.command,
            parameters: [c.param1, c.param2, c.param3, c.param4],
            system: c.target_system,
            component: c.target_component,
        }),
        MavMessage::COMMAND_INT(c) => Some(Asked {
            command: c.command,
            parameters: [c.param1, c.param2, c.param3, c.param4],
            system: c.target_system,
            component: c.target_component,
        }),
        _ => None,
    }
}

/// The number of the message that a command asks for, in the new form or in an old one.
#[expect(
    deprecated,
    reason = "ground stations in the field still ask in the old forms"
)]
fn requested(command: MavCmd, p: [f32; 4]) -> Option<u32> {
    match command {
        MavCmd::MAV_CMD_REQUEST_MESSAGE => Some(p[0] as u32),
        MavCmd::MAV_CMD_REQUEST_CAMERA_INFORMATION => Some(CAMERA_INFORMATION),
        MavCmd::MAV_CMD_REQUEST_CAMERA_SETTINGS => Some(CAMERA_SETTINGS),
        MavCmd::MAV_CMD_REQUEST_STORAGE_INFORMATION => Some(STORAGE_INFORMATION),
        MavCmd::MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS => Some(CAMERA_CAPTURE_STATUS),
        MavCmd::MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION => Some(VIDEO_STREAM_INFORMATION),
        MavCmd::MAV_CMD_REQUEST_VIDEO_STREAM_STATUS => Some(VIDEO_STREAM_STATUS),
        _ => None,
    }
}

fn acknowledge(command: MavCmd, result: MavResult) -> MavMessage {
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command, result })
}

/// The heartbeat of a camera, once a second, with the health of the source.
pub fn heartbeat(health: Health) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_CAMERA,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
        base_mode: MavModeFlag::empty(),
        system_status: match health {
            Health::Waiting => MavState::MAV_STATE_BOOT,
            Health::Live | Health::Frozen => MavState::MAV_STATE_ACTIVE,
            Health::Stalled | Health::Reconnecting => MavState::MAV_STATE_CRITICAL,
            Health::Ended => MavState::MAV_STATE_POWEROFF,
        },
        mavlink_version: 3,
    })
}

/// Where the first target is, in shares of the frame.
///
/// The status is idle while nothing is followed, at most COASTING with a stale report, and an error
/// once frames have stopped or while the target is lost.
pub fn status(view: &View, by_point: bool) -> MavMessage {
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
    let report = &view.report;
    let (Some(target), (w @ 1.., h @ 1..)) = (report.first(), report.size) else {
        return MavMessage::CAMERA_TRACKING_IMAGE_STATUS(data);
    };
    let track = &target.track;
    let coasting =
        Flags::CAMERA_TRACKING_STATUS_FLAGS_ACTIVE | Flags::CAMERA_TRACKING_STATUS_FLAGS_COASTING;
    data.tracking_status = match (view.freshness, track.state) {
        (Freshness::Dead, _) | (_, State::Lost) => Flags::CAMERA_TRACKING_STATUS_FLAGS_ERROR,
        (Freshness::Stale, _) | (_, State::Coasting) => coasting,
        _ => Flags::CAMERA_TRACKING_STATUS_FLAGS_ACTIVE,
    };
    data.tracking_mode = if by_point {
        CameraTrackingMode::CAMERA_TRACKING_MODE_POINT
    } else {
        CameraTrackingMode::CAMERA_TRACKING_MODE_RECTANGLE
    };
    if view.freshness == Freshness::Dead {
        return MavMessage::CAMERA_TRACKING_IMAGE_STATUS(data);
    }
    let (w, h, b) = (w as f32, h as f32, track.bbox);
    let share = |number: f32| number.clamp(0.0, 1.0);
    if by_point {
        data.point_x = share((b.x + b.w / 2.0) / w);
        data.point_y = share((b.y + b.h / 2.0) / h);
        data.radius = share(b.w.max(b.h) / 2.0 / w);
    }
    // In both modes: ground stations draw the rectangle if there is one.
    (data.rec_top_x, data.rec_top_y) = (share(b.x / w), share(b.y / h));
    (data.rec_bottom_x, data.rec_bottom_y) = (share((b.x + b.w) / w), share((b.y + b.h) / h));
    MavMessage::CAMERA_TRACKING_IMAGE_STATUS(data)
}

fn resolution(view: &View) -> (u16, u16) {
    let bounded = |side: usize| side.min(usize::from(u16::MAX)) as u16;
    (bounded(view.report.size.0), bounded(view.report.size.1))
}

fn stream_flags(view: &View) -> VideoStreamStatusFlags {
    if view.health.delivers() {
        VideoStreamStatusFlags::VIDEO_STREAM_STATUS_FLAGS_RUNNING
    } else {
        VideoStreamStatusFlags::empty()
    }
}

/// The type of stream that ground stations need to play an address.
fn stream_type(uri: &str) -> VideoStreamType {
    if uri.parse::<u16>().is_ok() {
        return VideoStreamType::VIDEO_STREAM_TYPE_RTPUDP; // the port to listen at
    }
    let scheme = uri.split_once("://").map_or("", |(scheme, _)| scheme);
    match scheme {
        "udp" | "rtp" => VideoStreamType::VIDEO_STREAM_TYPE_RTPUDP,
        "tcp" => VideoStreamType::VIDEO_STREAM_TYPE_TCP_MPEG,
        "mpegts" => VideoStreamType::VIDEO_STREAM_TYPE_MPEG_TS,
        _ => VideoStreamType::VIDEO_STREAM_TYPE_RTSP,
    }
}

fn name<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    for (byte, c) in bytes.iter_mut().zip(text.bytes().take(N - 1)) {
        *byte = c;
    }
    bytes
}

/// `major.minor.patch`, one byte each from the lowest on.
fn version(text: &str) -> u32 {
    text.split('.')
        .take(3)
        .enumerate()
        .map(|(i, part)| part.parse::<u8>().map_or(0, u32::from) << (8 * i))
        .sum()
}

#[cfg(test)]
#[path = "camera_tests.rs"]
mod tests;
