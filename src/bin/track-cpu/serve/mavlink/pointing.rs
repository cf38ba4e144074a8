//! What follows the target with metal: gimbal rates by a PI controller, and the angles for a precise landing.

use std::time::{Duration, Instant};

use ::mavlink::dialects::common::*;

use super::MavlinkArgs;
use crate::serve::report::Report;
use track_cpu::{BBox, State};

/// Component id of the gimbal manager: the autopilot's.
const MANAGER: u8 = 1;
/// Time between gimbal commands.
const PERIOD: Duration = Duration::from_millis(50);
/// Rate per angle, 1/s.
const PROPORTIONAL: f64 = 1.5;
/// Rate per angle and second, 1/s^2.
const INTEGRAL: f64 = 0.4;
/// Largest rate, rad/s.
const MAX_RATE: f64 = 0.8;
/// Errors below this are left alone, rad: jitter of the box must not shake the camera.
const DEAD_BAND: f64 = 0.004;
/// How long zero rates are sent after the target is gone.
const HOLD: Duration = Duration::from_secs(1);

/// Angles to the middle of a box from the camera's axis, right and down, in radians.
///
/// Square pixels, no distortion: `atan((u - cx) / f)` with `f` from the horizontal field of view.
pub fn angles(bbox: &BBox, size: (usize, usize), hfov_degrees: f64) -> (f64, f64) {
    let (w, h) = (size.0 as f64, size.1 as f64);
    let focal = 0.5 * w / (0.5 * hfov_degrees.to_radians()).tan();
    let (u, v) = (
        f64::from(bbox.x + bbox.w / 2.0),
        f64::from(bbox.y + bbox.h / 2.0),
    );
    (
        ((u - 0.5 * w) / focal).atan(),
        ((v - 0.5 * h) / focal).atan(),
    )
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
            self.integral += error * seconds; // at the limit it does not wind up
        }
        rate.clamp(-MAX_RATE, MAX_RATE)
    }
}

/// What is sent beside the camera protocol.
pub struct Pointing {
    gimbal: bool,
    landing_target: bool,
    hfov: f64,
    system: u8,
    component: u8,
    yaw: Axis,
    pitch: Axis,
    next: Option<Instant>,
    followed: Option<Instant>, // when a target was last followed
    in_control: bool,
}

impl Pointing {
    /// Nothing is followed yet.
    pub fn new(args: &MavlinkArgs) -> Pointing {
        Pointing {
            gimbal: args.gimbal,
            landing_target: args.landing_target,
            hfov: args.hfov.unwrap_or(60.0),
            system: args.mav_system,
            component: args.mav_component,
            yaw: Axis::default(),
            pitch: Axis::default(),
            next: None,
            followed: None,
            in_control: false,
        }
    }

    /// What is to be sent now; `fresh` if the report has not been seen before.
    pub fn due(&mut self, now: Instant, report: &Report, fresh: bool) -> Vec<MavMessage> {
        let mut out = Vec::new();
        let target = report
            .track
            .as_ref()
            .filter(|track| track.state != State::Lost);
        let at = target.map(|track| angles(&track.bbox, report.size, self.hfov));
        if self.landing_target
            && fresh
            && let (Some(track), Some(at)) = (target.filter(|t| t.state.is_seen()), at)
        {
            out.push(self.landing(track.bbox, report, at));
        }
        if self.gimbal && self.next.is_none_or(|next| now >= next) {
            self.next = Some(now + PERIOD);
            out.extend(self.turn(now, at));
        }
        out
    }

    fn turn(&mut self, now: Instant, at: Option<(f64, f64)>) -> Vec<MavMessage> {
        let mut out = Vec::new();
        match at {
            Some((right, down)) => {
                if !std::mem::replace(&mut self.in_control, true) {
                    out.push(self.take_control());
                }
                self.followed = Some(now);
                let seconds = PERIOD.as_secs_f64();
                let (yaw, pitch) = (
                    self.yaw.rate(right, seconds),
                    -self.pitch.rate(down, seconds),
                );
                out.push(self.rates(pitch, yaw));
            }
            None => {
                (self.yaw, self.pitch) = Default::default();
                match self.followed {
                    Some(last) if now < last + HOLD => out.push(self.rates(0.0, 0.0)),
                    _ => (self.followed, self.in_control) = (None, false),
                }
            }
        }
        out
    }

    /// Zero rates, if the gimbal may be moving.
    pub fn farewell(&self) -> Option<MavMessage> {
        self.in_control.then(|| self.rates(0.0, 0.0))
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

    fn take_control(&self) -> MavMessage {
        MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE,
            param1: self.system.into(),
            param2: self.component.into(),
            param3: -1.0,
            param4: -1.0,
            param5: f32::NAN,
            param6: f32::NAN,
            param7: 0.0,
            target_system: self.system,
            target_component: MANAGER,
            confirmation: 0,
        })
    }

    fn landing(&self, bbox: BBox, report: &Report, (right, down): (f64, f64)) -> MavMessage {
        let corner = BBox {
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
    use crate::serve::report::Tracked;

    fn pointing() -> Pointing {
        Pointing {
            gimbal: true,
            landing_target: true,
            hfov: 90.0,
            system: 1,
            component: 100,
            yaw: Axis::default(),
            pitch: Axis::default(),
            next: None,
            followed: None,
            in_control: false,
        }
    }

    fn report(bbox: BBox, state: State) -> Report {
        let track = Tracked {
            bbox,
            presence: None,
            score: 0.5,
            state,
            searches: 1,
            candidates: Vec::new(),
        };
        Report {
            size: (640, 480),
            track: Some(track),
            ..Report::default()
        }
    }

    fn rates(messages: &[MavMessage]) -> Option<(f32, f32)> {
        messages.iter().find_map(|m| match m {
            MavMessage::GIMBAL_MANAGER_SET_PITCHYAW(r) => Some((r.pitch_rate, r.yaw_rate)),
            _ => None,
        })
    }

    #[test]
    fn angles_of_a_right_angled_view() {
        let (right, down) = angles(&BBox::new(640.0, 240.0, 0.0, 0.0), (640, 480), 90.0);
        assert!((right - 45f64.to_radians()).abs() < 1e-9 && down.abs() < 1e-9);
    }

    #[test]
    fn turns_toward_the_target_and_rests_when_it_is_lost() {
        let mut pointing = pointing();
        let start = Instant::now();
        let right_and_below = BBox::new(500.0, 400.0, 20.0, 20.0);
        let messages = pointing.due(start, &report(right_and_below, State::Tracking), true);
        assert!(
            messages
                .iter()
                .any(|m| matches!(m, MavMessage::COMMAND_LONG(_))),
            "takes control first"
        );
        assert!(
            messages
                .iter()
                .any(|m| matches!(m, MavMessage::LANDING_TARGET(l) if l.angle_x > 0.2))
        );
        let (pitch, yaw) = rates(&messages).unwrap();
        assert!(yaw > 0.1 && pitch < -0.1, "{pitch} {yaw}");
        assert_eq!(
            rates(&pointing.due(start, &report(right_and_below, State::Tracking), false)),
            None
        );
        let lost = report(right_and_below, State::Lost);
        assert_eq!(
            rates(&pointing.due(start + PERIOD, &lost, true)),
            Some((0.0, 0.0))
        );
        let later = start + HOLD + 2 * PERIOD;
        assert_eq!(rates(&pointing.due(later, &lost, true)), None);
        assert!(pointing.farewell().is_none());
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
