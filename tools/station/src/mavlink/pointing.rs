//! Pointing at the first target: gimbal rates from a PI controller, and the angles for a precise
//! landing.
//!
//! Nothing moves by a report that is not fresh: rates go to zero, control of the gimbal is given
//! back, and then nothing is sent. If another owner takes control, this program leaves it to them
//! until a target is chosen again.

use std::time::{Duration, Instant};

use ::mavlink::dialects::common::*;

use super::MavlinkOptions;
use crate::picture::FrameBox;
use crate::report::{Report, State, View};
use crate::say::say;

/// Component id of the gimbal manager, which is the autopilot.
const MANAGER: u8 = 1;
/// Time between gimbal commands.
const PERIOD: Duration = Duration::from_millis(50);
/// Rate per angle, 1/s.
const PROPORTIONAL: f64 = 1.5;
/// Rate per angle and second, 1/s^2.
const INTEGRAL: f64 = 0.4;
/// Largest rate, rad/s.
const MAX_RATE: f64 = 0.8;
/// Largest error that is ignored, rad: jitter of the box must not shake the camera.
const DEAD_BAND: f64 = 0.004;
/// How many times zero rates are sent when there is nothing to follow, since a link may lose some.
const ZEROS: u32 = 5;
/// How long a gimbal manager may take to report who is in control.
const GRACE: Duration = Duration::from_secs(1);
/// Parameter of DO_GIMBAL_MANAGER_CONFIGURE: leave unchanged.
const UNCHANGED: f32 = -1.0;
/// Parameter of DO_GIMBAL_MANAGER_CONFIGURE: give control back if it is ours.
const RELEASE: f32 = -3.0;

/// Angles from the camera's axis to the middle of a box: right and down, in radians.
///
/// Square pixels, no distortion: `atan((u - cx) / f)` with `f` from the horizontal field of view.
pub fn angles(bbox: &FrameBox, size: (usize, usize), hfov_degrees: f64) -> (f64, f64) {
    let (w, h) = (size.0 as f64, size.1 as f64);
    let focal = 0.5 * w / (0.5 * hfov_degrees.to_radians()).tan();
    let u = f64::from(bbox.x + bbox.w / 2.0);
    let v = f64::from(bbox.y + bbox.h / 2.0);
    let right = ((u - 0.5 * w) / focal).atan();
    let down = ((v - 0.5 * h) / focal).atan();
    (right, down)
}

/// A PI controller of one axis.
#[derive(Clone, Copy, Debug, Default)]
struct Axis {
    integral: f64,
}

impl Axis {
    fn rate(&mut self, error: f64, seconds: f64) -> f64 {
        let error = if error.abs() < DEAD_BAND { 0.0 } else { error };
        let rate = PROPORTIONAL * error + INTEGRAL * (self.integral + error * seconds);
        if rate.abs() < MAX_RATE {
            self.integral += error * seconds; // at the limit it must not wind up
        }
        rate.clamp(-MAX_RATE, MAX_RATE)
    }
}

/// The controller of the gimbal and the source of landing angles.
pub struct Pointing {
    gimbal: bool,
    landing_target: bool,
    hfov: f64,
    system: u8,
    component: u8,
    yaw: Axis,
    pitch: Axis,
    next: Option<Instant>,
    control: Control,
    owner: (u8, u8), // as the gimbal manager last reported; (0, 0) is nobody
}

/// Who moves the gimbal, as far as this program knows.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Control {
    /// Nothing is asked of it.
    Free,
    /// This program, since this moment.
    Ours { since: Instant },
    /// This program sends the remaining zero rates, then gives control back.
    Stopping { zeros: u32 },
    /// Another owner; this program waits for a target that is chosen after this many starts.
    Theirs { starts: u64 },
}

impl Pointing {
    /// A controller with nothing to follow.
    pub fn new(options: &MavlinkOptions) -> Pointing {
        Pointing {
            gimbal: options.gimbal,
            landing_target: options.landing_target,
            hfov: options.hfov.unwrap_or(60.0),
            system: options.system,
            component: options.component,
            yaw: Axis::default(),
            pitch: Axis::default(),
            next: None,
            control: Control::Free,
            owner: (0, 0),
        }
    }

    /// Takes a message of the vehicle that says who controls the gimbal.
    pub fn hear(&mut self, from: u32, message: &MavMessage) {
        if let MavMessage::GIMBAL_MANAGER_STATUS(status) = message
            && from == u32::from(self.system)
        {
            self.owner = (status.primary_control_sysid, status.primary_control_compid);
        }
    }

    /// The messages to send now; `is_new` says that the report was not seen before.
    pub fn due(&mut self, now: Instant, view: &View, is_new: bool) -> Vec<MavMessage> {
        let mut out = Vec::new();
        let report = &view.report;
        let target = view
            .first()
            .filter(|target| target.track.state != State::Lost);
        let at = target.map(|target| angles(&target.track.bbox, report.size, self.hfov));
        if self.landing_target
            && is_new
            && let (Some(target), Some(at)) = (target, at)
            && target.track.is_believed()
        {
            out.push(self.landing(target.track.bbox, report, at));
        }
        if self.gimbal && self.next.is_none_or(|next| now >= next) {
            self.next = Some(now + PERIOD);
            match target.zip(at) {
                Some((target, at)) => {
                    let chosen = (target.start, report.starts);
                    self.follow(now, at, chosen, &mut out);
                }
                None => self.rest(&mut out),
            }
        }
        out
    }

    /// Turns toward a target, unless another owner controls the gimbal. `start` is the number of
    /// the target's start, of `starts` so far.
    fn follow(
        &mut self,
        now: Instant,
        (right, down): (f64, f64),
        (start, starts): (u64, u64),
        out: &mut Vec<MavMessage>,
    ) {
        let ours = (self.system, self.component);
        let is_taken = self.owner != (0, 0) && self.owner != ours;
        match self.control {
            Control::Theirs { starts: before } if start <= before && is_taken => return,
            Control::Ours { since } if is_taken && now > since + GRACE => {
                let (system, component) = self.owner;
                say!(
                    "mavlink: {system}/{component} controls the gimbal; it is left to them until \
                     a target is chosen again"
                );
                self.control = Control::Theirs { starts };
                self.reset();
                return;
            }
            Control::Ours { .. } => {}
            _ => {
                self.control = Control::Ours { since: now };
                let [system, component] = [self.system, self.component].map(f32::from);
                out.push(self.configure(system, component));
            }
        }
        let seconds = PERIOD.as_secs_f64();
        let yaw = self.yaw.rate(right, seconds);
        let pitch = -self.pitch.rate(down, seconds);
        out.push(self.rates(pitch, yaw));
    }

    /// Stops a gimbal that may be moving, then gives it back.
    fn rest(&mut self, out: &mut Vec<MavMessage>) {
        self.reset();
        let left = match self.control {
            Control::Free | Control::Theirs { .. } => return,
            Control::Ours { .. } => ZEROS,
            Control::Stopping { zeros } => zeros,
        };
        if left > 0 {
            out.push(self.rates(0.0, 0.0));
            self.control = Control::Stopping { zeros: left - 1 };
        } else {
            out.push(self.configure(RELEASE, RELEASE));
            self.control = Control::Free;
        }
    }

    /// Resets the integrals of both controllers.
    fn reset(&mut self) {
        self.yaw = Axis::default();
        self.pitch = Axis::default();
    }

    /// Zero rates and the gimbal given back, if it may be moving.
    pub fn release(&self) -> Vec<MavMessage> {
        match self.control {
            Control::Free | Control::Theirs { .. } => Vec::new(),
            _ => vec![self.rates(0.0, 0.0), self.configure(RELEASE, RELEASE)],
        }
    }

    fn rates(&self, pitch: f64, yaw: f64) -> MavMessage {
        MavMessage::GIMBAL_MANAGER_SET_PITCHYAW(GIMBAL_MANAGER_SET_PITCHYAW_DATA {
            flags: GimbalManagerFlags::empty(),
            pitch: f32::NAN,
            yaw: f32::NAN,
            pitch_rate: pitch as f32,
            yaw_rate: yaw as f32,
            target_system: self.system,
            target_component: MANAGER,
            gimbal_device_id: 0,
        })
    }

    /// Asks the gimbal manager to put a system and component in control.
    fn configure(&self, system: f32, component: f32) -> MavMessage {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
            param1: system,
            param2: component,
            param3: UNCHANGED,
            param4: UNCHANGED,
            param5: f32::NAN,
            param6: f32::NAN,
            param7: 0.0,
            target_system: self.system,
            target_component: MANAGER,
            confirmation: 0,
        })
    }

    fn landing(&self, bbox: FrameBox, report: &Report, (right, down): (f64, f64)) -> MavMessage {
        let corner = FrameBox {
            w: 0.0,
            h: 0.0,
            ..bbox
        };
        let (left, top) = angles(&corner, report.size, self.hfov);
        MavMessage::LANDING_TARGET(LANDING_TARGET_DATA {
            time_usec: (report.time_ms * 1e3) as u64,
            angle_x: right as f32,
            angle_y: down as f32,
            distance: 0.0,
            size_x: (2.0 * (right - left)) as f32,
            size_y: (2.0 * (down - top)) as f32,
            target_num: 0,
            frame: MavFrame::MAV_FRAME_BODY_FRD,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::health::Health;
    use crate::report::{Followed, Freshness, Tracked};
    use std::sync::Arc;

    fn pointing() -> Pointing {
        Pointing::new(&MavlinkOptions {
            gimbal: true,
            landing_target: true,
            hfov: Some(90.0),
            ..MavlinkOptions::default()
        })
    }

    /// A target right of and below the middle.
    fn view(state: State, freshness: Freshness) -> View {
        let track = Tracked {
            state,
            ..Tracked::certain(FrameBox::new(500.0, 400.0, 20.0, 20.0))
        };
        let report = Report {
            size: (640, 480),
            targets: vec![Followed {
                id: 1,
                start: 1,
                track,
            }],
            starts: 1,
            ..Report::default()
        };
        View {
            number: 1,
            report: Arc::new(report),
            age: Some(Duration::ZERO),
            freshness,
            health: Health::Live,
            interval: Duration::ZERO,
        }
    }

    fn rates(messages: &[MavMessage]) -> Option<(f32, f32)> {
        messages.iter().find_map(|message| match message {
            MavMessage::GIMBAL_MANAGER_SET_PITCHYAW(r) => Some((r.pitch_rate, r.yaw_rate)),
            _ => None,
        })
    }

    /// First parameter of the command to the gimbal manager, if there is one.
    fn control(messages: &[MavMessage]) -> Option<f32> {
        messages.iter().find_map(|message| match message {
            MavMessage::COMMAND_LONG(command) => Some(command.param1),
            _ => None,
        })
    }

    fn owned_by(system: u8, component: u8) -> MavMessage {
        MavMessage::GIMBAL_MANAGER_STATUS(GIMBAL_MANAGER_STATUS_DATA {
            primary_control_sysid: system,
            primary_control_compid: component,
            ..Default::default()
        })
    }

    #[test]
    fn right_edge_of_a_right_angled_view_is_at_45_degrees() {
        let (right, down) = angles(&FrameBox::new(640.0, 240.0, 0.0, 0.0), (640, 480), 90.0);

        assert!((right - 45f64.to_radians()).abs() < 1e-9);
        assert!(down.abs() < 1e-9);
    }

    #[test]
    fn gimbal_turns_toward_the_target_and_landing_angles_are_told() {
        let mut pointing = pointing();
        let start = Instant::now();
        let seen = view(State::Tracking, Freshness::Fresh);

        let messages = pointing.due(start, &seen, true);

        assert_eq!(control(&messages), Some(1.0), "takes control first");
        let (pitch, yaw) = rates(&messages).unwrap();
        assert!(yaw > 0.1 && pitch < -0.1, "{pitch} {yaw}");
        let has_landing = messages
            .iter()
            .any(|m| matches!(m, MavMessage::LANDING_TARGET(l) if l.angle_x > 0.2));
        assert!(has_landing);
        assert!(pointing.due(start, &seen, false).is_empty(), "not yet due");
    }

    #[test]
    fn disbelieved_target_is_kept_in_view_but_is_no_landing_target() {
        let mut doubted = view(State::LowConfidence, Freshness::Fresh);
        let report = Arc::get_mut(&mut doubted.report).unwrap();
        report.targets[0].track.presence = Some(0.39);

        let messages = pointing().due(Instant::now(), &doubted, true);

        assert!(rates(&messages).is_some());
        let has_landing = messages
            .iter()
            .any(|m| matches!(m, MavMessage::LANDING_TARGET(_)));
        assert!(!has_landing);
    }

    #[test]
    fn gimbal_stops_and_is_given_back_when_there_is_nothing_to_follow() {
        for (state, freshness) in [
            (State::Lost, Freshness::Fresh),
            (State::Tracking, Freshness::Stale),
            (State::Tracking, Freshness::Dead),
        ] {
            let mut pointing = pointing();
            let mut now = Instant::now();
            pointing.due(now, &view(State::Tracking, Freshness::Fresh), true);

            let mut messages = Vec::new();
            for _ in 0..40 {
                now += PERIOD;
                messages.extend(pointing.due(now, &view(state, freshness), false));
            }

            assert_eq!(messages.len(), ZEROS as usize + 1, "then silence");
            for message in &messages[..ZEROS as usize] {
                assert_eq!(rates(std::slice::from_ref(message)), Some((0.0, 0.0)));
            }
            assert_eq!(control(&messages), Some(RELEASE));
            assert!(pointing.release().is_empty());
        }
    }

    #[test]
    fn integral_restarts_after_a_stall() {
        let mut pointing = pointing();
        let mut now = Instant::now();
        let seen = view(State::Tracking, Freshness::Fresh);
        let first = rates(&pointing.due(now, &seen, true));
        for _ in 0..100 {
            now += PERIOD;
            pointing.due(now, &seen, false);
        }
        now += PERIOD;
        pointing.due(now, &view(State::Tracking, Freshness::Stale), false);

        now += PERIOD;
        let again = rates(&pointing.due(now, &seen, true));

        assert_eq!(first, again);
    }

    #[test]
    fn gimbal_is_left_to_another_owner_until_a_target_is_chosen_again() {
        let mut pointing = pointing();
        let mut now = Instant::now();
        let seen = view(State::Tracking, Freshness::Fresh);
        pointing.due(now, &seen, true);
        pointing.hear(255, &owned_by(255, 190));
        now += GRACE + PERIOD;
        assert!(
            rates(&pointing.due(now, &seen, false)).is_some(),
            "255 is not the vehicle"
        );

        pointing.hear(1, &owned_by(255, 190));
        for _ in 0..20 {
            now += PERIOD;
            assert!(pointing.due(now, &seen, false).is_empty());
        }

        let mut chosen = seen.clone();
        Arc::make_mut(&mut chosen.report).targets[0].start += 1;
        now += PERIOD;
        let messages = pointing.due(now, &chosen, true);
        assert_eq!(control(&messages), Some(1.0));
        assert!(rates(&messages).is_some());
    }

    #[test]
    fn rates_are_bounded_and_do_not_wind_up() {
        let mut axis = Axis::default();
        for _ in 0..1000 {
            assert!(axis.rate(1.0, 0.05) <= MAX_RATE);
        }

        assert!(axis.rate(-0.2, 0.05) < 0.0, "turns round at once");
        assert_eq!(Axis::default().rate(0.5 * DEAD_BAND, 0.05), 0.0);
    }
}
