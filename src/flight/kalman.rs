//! The target's own motion: a constant-velocity Kalman filter in the scene's frame of reference.
//!
//! Positions are in frame pixels. [`Motion`] carries them from one frame to the next before the
//! filter predicts, so that its velocity is the target's own and not the camera's. The state per
//! axis is position and velocity. Source: Bar-Shalom, Li, Kirubarajan, "Estimation with
//! Applications to Tracking and Navigation", section 6.2 (continuous white-noise acceleration) and
//! 11.2 (noise of adjustable level).

use super::camera::Motion;
use crate::bbox::FrameBox;
use std::f64::consts::TAU;

/// Density of the white-noise acceleration, in squared target sides per cubed second.
const ACCELERATION: f64 = 1.7;
/// Growth of the position's variance that the camera's motion leaves unexplained, in squared target
/// sides per second.
const WANDER: f64 = 0.012;
/// Standard deviation of the velocity of a target that was just given, in target sides per second.
const VELOCITY: f64 = 3.0;
/// Standard deviation of a measured center, in target sides.
const MEASUREMENT: f64 = 0.05;
/// Target sides of the gate that allow for what the model of motion leaves out.
const SLACK: f64 = 1.2;
/// Standard deviations of the gate.
const SIGMAS: f64 = 4.0;
/// Factor by which predictions are mostly better than their variance says.
const USUAL: f64 = 0.33;
/// Share of predictions that are as bad as their variance says.
const RARE: f64 = 0.25;
/// Least standard deviation of a prediction, in target sides.
const LEAST: f64 = 0.3;
/// Chance that the target is anywhere in the view; it grows with the variance.
const ANYWHERE: f64 = 0.02;
/// Most that this chance grows to: the target may be out of view.
const IN_VIEW: f64 = 0.6;
/// Squares of the target's side in a view of unknown size.
const SQUARES: f64 = 200.0;
/// Objects that a few looks in a row take for the target, per square of its side.
const LOOK_ALIKES: f64 = 0.003;
/// Share of a new observation in the running mean of surprises, per second since the last one.
const AGILITY_RATE: f64 = 3.0;
/// Largest share of one observation in that mean.
const MOST_AGILITY: f64 = 0.3;
/// Growth of the restlessness per second and unit of surprise beyond what is expected.
const RESTLESS_RATE: f64 = 3.0;
/// Longest time between two measurements that counts for it, in seconds.
const MOST_SINCE: f64 = 0.1;
/// Most surprise of one frame that counts.
const MOST_SURPRISE: f64 = 4.0;
/// Most restlessness.
const MOST_RESTLESS: f64 = 100.0;
/// Share of the velocity that is kept per second without a measurement: far predictions slow down.
const KEPT_VELOCITY: f64 = 0.74;

/// Position and velocity along one axis with their covariance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Axis {
    position: f64,
    velocity: f64,
    variance: [f64; 3], // position, both, velocity
}

impl Axis {
    /// Goes on for `dt` seconds; `acceleration` and `wander` are densities.
    fn predict(&mut self, acceleration: f64, wander: f64, dt: f64) {
        let [p, c, v] = self.variance;
        let q = acceleration * dt;
        self.position += self.velocity * dt;
        self.variance = [
            p + 2.0 * c * dt + v * dt * dt + q * dt * dt / 3.0 + wander * dt,
            c + v * dt + q * dt / 2.0,
            v + q,
        ];
    }

    /// The squared distance of a measurement from the prediction, in its variance.
    fn surprise(&self, measured: f64, variance: f64) -> f64 {
        (measured - self.position).powi(2) / (self.variance[0] + variance)
    }

    fn correct(&mut self, measured: f64, variance: f64) {
        let [p, c, v] = self.variance;
        let innovation = measured - self.position;
        let (gain, velocity_gain) = (p / (p + variance), c / (p + variance));
        self.position += gain * innovation;
        self.velocity += velocity_gain * innovation;
        self.variance = [(1.0 - gain) * p, (1.0 - gain) * c, v - velocity_gain * c];
    }
}

/// The filter: center with velocity, and the size that the target had when it was last seen well.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Kalman {
    x: Axis,
    y: Axis,
    w: f64,
    h: f64,
    restless: f64, // factor of the acceleration's density, learned from the target's surprises
    view: f64,     // area of the view in pixels
    agility: f64,  // running mean of the target's distance from its predicted place, in its sides
    since: f64,    // seconds since the last measurement
}

impl Kalman {
    /// A target that stands still.
    pub(crate) fn new(bbox: &FrameBox) -> Kalman {
        let (w, h) = (f64::from(bbox.w), f64::from(bbox.h));
        let side = (w * h).sqrt();
        let variance = [(MEASUREMENT * side).powi(2), 0.0, (VELOCITY * side).powi(2)];
        let axis = |position: f32| Axis {
            position: position.into(),
            velocity: 0.0,
            variance,
        };
        Kalman {
            x: axis(bbox.cx),
            y: axis(bbox.cy),
            w,
            h,
            restless: 1.0,
            view: SQUARES * side * side,
            agility: 0.0,
            since: 0.0,
        }
    }

    /// This target found again at a box, standing still: it is as restless as before.
    pub(crate) fn found(&self, bbox: &FrameBox) -> Kalman {
        Kalman {
            restless: self.restless,
            view: self.view,
            ..Kalman::new(bbox)
        }
    }

    /// The same target in a view of `width` x `height` pixels.
    pub(crate) fn in_view(self, width: usize, height: usize) -> Kalman {
        Kalman {
            view: (width * height) as f64,
            ..self
        }
    }

    fn side(&self) -> f64 {
        (self.w * self.h).sqrt().max(1.0)
    }

    /// Carries the state into the next frame, `dt` seconds later: the camera's motion, then the
    /// target's own.
    pub(crate) fn predict(&mut self, motion: &Motion, dt: f64) {
        let (cx, cy) = motion.apply(self.x.position, self.y.position);
        let (vx, vy) = motion.turn(self.x.velocity, self.y.velocity);
        (
            self.x.position,
            self.y.position,
            self.x.velocity,
            self.y.velocity,
        ) = (cx, cy, vx, vy);
        let area = self.side() * self.side();
        let acceleration = ACCELERATION * self.restless * area;
        self.x.predict(acceleration, WANDER * area, dt);
        self.y.predict(acceleration, WANDER * area, dt);
        self.since += dt;
    }

    /// Learns where the target was seen; the less `trust` in `(0, 1]`, the less it moves.
    pub(crate) fn correct(&mut self, bbox: &FrameBox, trust: f64) {
        let rate = (AGILITY_RATE * self.since).min(MOST_AGILITY);
        self.agility += rate * trust * (self.distance(bbox) - self.agility);
        // A half hidden target's box is off by a good part of its side.
        let variance = (MEASUREMENT * self.side() / trust.powi(2).clamp(0.01, 1.0)).powi(2);
        // Squared innovations are as large as their variance where the density is right.
        let surprise = 0.5
            * (self.x.surprise(bbox.cx.into(), variance)
                + self.y.surprise(bbox.cy.into(), variance));
        let excess = trust * (surprise.min(MOST_SURPRISE) - 1.0);
        let growth = (RESTLESS_RATE * self.since.min(MOST_SINCE) * excess).exp();
        self.restless = (self.restless * growth).clamp(1.0, MOST_RESTLESS);
        self.since = 0.0;
        self.x.correct(bbox.cx.into(), variance);
        self.y.correct(bbox.cy.into(), variance);
    }

    /// Takes over the size of a box that was seen well.
    pub(crate) fn resize(&mut self, bbox: &FrameBox) {
        (self.w, self.h) = (bbox.w.into(), bbox.h.into());
    }

    /// `dt` seconds have gone by in which the target was not seen.
    pub(crate) fn coast(&mut self, dt: f64) {
        let kept = KEPT_VELOCITY.powf(dt);
        self.x.velocity *= kept;
        self.y.velocity *= kept;
    }

    /// Goes on from another place with the same velocity.
    pub(crate) fn move_to(&mut self, bbox: &FrameBox) {
        self.x.position = bbox.cx.into();
        self.y.position = bbox.cy.into();
    }

    /// Keeps the center within half a frame around the frame, so that a drifting guess stays of
    /// use.
    pub(crate) fn bound(&mut self, width: usize, height: usize) {
        let (width, height) = (width as f64, height as f64);
        self.x.position = self.x.position.clamp(-0.5 * width, 1.5 * width);
        self.y.position = self.y.position.clamp(-0.5 * height, 1.5 * height);
        self.w = self.w.clamp(1.0, width);
        self.h = self.h.clamp(1.0, height);
    }

    /// Where the target should be.
    pub(crate) fn bbox(&self) -> FrameBox {
        FrameBox {
            cx: self.x.position as f32,
            cy: self.y.position as f32,
            w: self.w as f32,
            h: self.h as f32,
        }
    }

    /// How far from the prediction the target may be, in target sides: grows while it is not seen.
    pub(crate) fn gate(&self) -> f64 {
        SLACK + SIGMAS * (self.spread() + self.agility)
    }

    /// Standard deviation of the prediction, in target sides.
    pub(crate) fn spread(&self) -> f64 {
        self.x.variance[0].max(self.y.variance[0]).sqrt() / self.side()
    }

    /// Log of how much likelier it is to find the target there than something that looks like it,
    /// by the distance from the prediction, which is mostly better than its variance says,
    /// sometimes as bad, and rarely of no use at all.
    pub(crate) fn log_ratio(&self, bbox: &FrameBox) -> f64 {
        let (d, spread) = (self.distance(bbox), self.spread());
        let density = |spread: f64| (-0.5 * (d / spread).powi(2)).exp() / (TAU * spread * spread);
        let usual = density((USUAL * spread).max(LEAST));
        let rare = density(spread.max(LEAST));
        let squares = (self.view / (self.side() * self.side())).max(1.0);
        let anywhere = (ANYWHERE * (1.0 + spread * spread)).min(IN_VIEW) / squares;
        ((1.0 - RARE) * usual + RARE * rare + anywhere).ln() - LOOK_ALIKES.ln()
    }

    /// Distance of a center from the prediction, in target sides.
    pub(crate) fn distance(&self, bbox: &FrameBox) -> f64 {
        let (dx, dy) = (
            f64::from(bbox.cx) - self.x.position,
            f64::from(bbox.cy) - self.y.position,
        );
        dx.hypot(dy) / self.side()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME: f64 = 1.0 / 30.0;

    fn at(cx: f32, cy: f32) -> FrameBox {
        FrameBox {
            cx,
            cy,
            w: 20.0,
            h: 10.0,
        }
    }

    /// A target that was seen to stand still for 30 frames.
    fn standing() -> Kalman {
        let mut kalman = Kalman::new(&at(100.0, 50.0));
        for _ in 0..30 {
            kalman.predict(&Motion::default(), FRAME);
            kalman.correct(&at(100.0, 50.0), 1.0);
        }
        kalman
    }

    #[test]
    fn moving_target_is_predicted_with_its_velocity() {
        let mut kalman = Kalman::new(&at(100.0, 50.0));
        for step in 1..=30 {
            kalman.predict(&Motion::default(), FRAME);
            kalman.correct(&at(100.0 + 3.0 * step as f32, 50.0 - step as f32), 1.0);
        }
        for _ in 0..10 {
            kalman.predict(&Motion::default(), FRAME);
        }
        let end = kalman.bbox();
        assert!(
            (end.cx - 220.0).abs() < 2.0 && (end.cy - 10.0).abs() < 2.0,
            "{end:?}"
        );
        assert!(kalman.distance(&at(220.0, 10.0)) < 0.2);
    }

    #[test]
    fn panning_camera_gives_a_still_target_no_velocity() {
        let mut kalman = Kalman::new(&at(100.0, 50.0));
        let pan = Motion::shift(-7.0, 2.0);
        for step in 1..=20 {
            kalman.predict(&pan, FRAME);
            kalman.correct(
                &at(100.0 - 7.0 * step as f32, 50.0 + 2.0 * step as f32),
                1.0,
            );
        }
        kalman.predict(&Motion::default(), FRAME);
        let still = kalman.bbox();
        assert!(
            (still.cx + 40.0).abs() < 0.5 && (still.cy - 90.0).abs() < 0.5,
            "{still:?}"
        );
    }

    #[test]
    fn distrusted_measurement_moves_the_filter_less() {
        let (mut trusting, mut wary) = (Kalman::new(&at(0.0, 0.0)), Kalman::new(&at(0.0, 0.0)));
        for (kalman, trust) in [(&mut trusting, 1.0), (&mut wary, 0.05)] {
            kalman.predict(&Motion::default(), FRAME);
            kalman.correct(&at(10.0, 0.0), trust);
        }
        assert!(wary.bbox().cx < 0.3 * trusting.bbox().cx);
    }

    #[test]
    fn unseen_target_has_a_growing_gate() {
        let mut kalman = standing();
        let seen = kalman.gate();
        assert!((SLACK..2.0).contains(&seen), "{seen}");
        for _ in 0..60 {
            kalman.predict(&Motion::default(), FRAME);
        }
        assert!(kalman.gate() > 4.0, "{}", kalman.gate());
    }

    #[test]
    fn place_near_the_prediction_speaks_for_the_target() {
        let mut kalman = standing();
        let away = |kalman: &Kalman, sides: f32| kalman.log_ratio(&at(100.0 + sides * 14.14, 50.0));
        assert!(away(&kalman, 0.0) > 2.0 && away(&kalman, 3.0) < -2.0);
        let soon = (away(&kalman, 0.0), away(&kalman, 3.0));
        for _ in 0..60 {
            kalman.predict(&Motion::default(), FRAME);
        }
        let late = (away(&kalman, 0.0), away(&kalman, 3.0));
        assert!(late.0 < soon.0 && late.1 > soon.1, "{soon:?} {late:?}");
        assert!(away(&kalman, 1000.0).is_finite());
    }

    #[test]
    fn target_that_leaps_is_expected_farther_away_than_a_calm_one() {
        let after = |leap: f32| {
            let mut kalman = Kalman::new(&at(100.0, 50.0));
            for step in 0..30 {
                kalman.predict(&Motion::default(), FRAME);
                let aside = if step % 4 < 2 { leap } else { -leap };
                kalman.correct(&at(100.0 + aside, 50.0), 1.0);
            }
            for _ in 0..15 {
                kalman.predict(&Motion::default(), FRAME);
            }
            kalman
        };
        let (calm, wild) = (after(0.0), after(7.0));
        assert_eq!(calm.restless, 1.0);
        assert!(wild.spread() > 3.0 * calm.spread());
        assert!(wild.gate() > 2.0 * calm.gate());
        let there = at(150.0, 50.0);
        assert!(wild.log_ratio(&there) > calm.log_ratio(&there) + 2.0);
        assert_eq!(wild.found(&there).restless, wild.restless);
    }

    #[test]
    fn far_place_is_likelier_in_a_view_of_few_squares() {
        let after = |width, height| {
            let mut kalman = standing().in_view(width, height);
            for _ in 0..90 {
                kalman.predict(&Motion::default(), FRAME);
            }
            kalman.log_ratio(&at(400.0, 50.0))
        };
        let (few, many) = (after(120, 80), after(1200, 800));
        assert!((few - many - 100f64.ln()).abs() < 0.1, "{few} {many}");
    }

    #[test]
    fn drifting_prediction_stays_near_the_frame() {
        let mut kalman = Kalman::new(&at(0.0, 0.0));
        for _ in 0..100 {
            kalman.predict(&Motion::shift(900.0, -900.0), FRAME);
            kalman.bound(640, 360);
        }
        let end = kalman.bbox();
        assert_eq!((end.cx, end.cy), (960.0, -180.0));
    }
}
