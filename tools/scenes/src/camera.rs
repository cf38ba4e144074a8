//! The camera: its position, its direction, and how it follows the target through a flight.

use crate::math::{V3, cos_turns, lerp, sin_turns, smooth_step, v3};
use crate::rng::Rng;

/// Nearest depth that is projected, in meters.
const NEAR: f32 = 0.5;

/// A pinhole camera: position, an orthonormal basis, and focal length and center in pixels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Camera {
    pub position: V3,
    pub right: V3,
    pub down: V3,
    pub forward: V3,
    pub focal: f32,
    pub center: (f32, f32),
}

impl Camera {
    /// Pixel x, pixel y (edges at whole numbers) and depth in meters.
    #[inline(always)]
    pub fn project(&self, p: V3) -> (f32, f32, f32) {
        let d = p - self.position;
        let depth = d.dot(self.forward).max(NEAR);
        let k = self.focal / depth;
        (
            self.center.0 + k * d.dot(self.right),
            self.center.1 + k * d.dot(self.down),
            depth,
        )
    }

    /// Direction through a pixel position, not of unit length (its depth is 1).
    pub fn ray(&self, x: f32, y: f32) -> V3 {
        self.forward
            + self.right * ((x - self.center.0) / self.focal)
            + self.down * ((y - self.center.1) / self.focal)
    }

    /// Where the ray through a pixel meets the ground. Rays near or above the horizon are bent down
    /// to 5 degrees below.
    #[inline(always)]
    pub fn ground(&self, x: f32, y: f32) -> V3 {
        let ray = self.ray(x, y);
        let slant = (-ray.z).max(0.087);
        self.position + ray * (self.position.z / slant)
    }
}

/// Amplitudes of the camera's motion.
#[derive(Clone, Copy)]
pub(crate) struct Manner {
    /// Amplitude of the target's wandering in the view, as a share of half the view.
    pub wander: f32,
    /// Amplitude of the shake in pixels of a 640 wide view.
    pub shake: f32,
    /// Relative range of the climb and descent.
    pub climb: f32,
    /// Turns of yaw over ten seconds.
    pub yaw: f32,
}

/// A time during which the target is out of view.
#[derive(Clone, Copy)]
pub(crate) struct Exit {
    /// Seconds.
    pub from: f32,
    pub until: f32,
    /// Direction in the view: -1 left, 1 right.
    pub side: f32,
}

/// A closed-form flight plan: the pose at any time, given where the target is.
pub(crate) struct Plan {
    pub manner: Manner,
    /// Distance to the target at the start, in meters.
    pub distance: f32,
    pub focal: f32,
    pub size: (f32, f32),
    /// Depression of the view below the horizon at the start, in turns.
    pub pitch: f32,
    pub yaw: f32,
    pub exits: Vec<Exit>,
    phases: [f32; 16],
}

impl Plan {
    pub fn new(size: (f32, f32), distance: f32, focal: f32, manner: Manner, rng: &mut Rng) -> Plan {
        let phases = std::array::from_fn(|_| rng.unit());
        let pitch = rng.range(36.0, 68.0) / 360.0;
        Plan {
            manner,
            distance,
            focal,
            size,
            pitch,
            yaw: rng.unit(),
            exits: Vec::new(),
            phases,
        }
    }

    /// A slow, smooth, zero-mean wave of about unit size with the given period in seconds.
    fn sway(&self, k: usize, seconds: f32, period: f32) -> f32 {
        0.7 * sin_turns(seconds / period + self.phases[k])
            + 0.3 * sin_turns(seconds * 2.3 / period + self.phases[k + 1])
    }

    /// Shake: fast, of about unit size.
    fn tremble(&self, k: usize, seconds: f32) -> f32 {
        let wave = |rate: f32, k: usize| sin_turns(seconds * rate + self.phases[k % 16]);
        // The slow beat makes quiet and rough stretches, like gusts.
        let gust = 0.55 + 0.45 * wave(0.31, k + 5);
        gust * (0.45 * wave(1.7, k) + 0.35 * wave(4.1, k + 1) + 0.25 * wave(9.3, k + 2))
    }

    /// The pose at a time, looking so that `target` (a point in meters) lands where the plan wants
    /// it in the view.
    pub fn pose(&self, seconds: f32, target: V3) -> Camera {
        let m = &self.manner;
        let swing = |k, period| self.sway(k, seconds, period) - self.sway(k, 0.0, period);
        let distance = self.distance * (1.0 + m.climb * swing(0, 11.0)).clamp(0.62, 1.7);
        let pitch = (self.pitch + 0.022 * swing(2, 14.0)).clamp(33.0 / 360.0, 74.0 / 360.0);
        let yaw = self.yaw + m.yaw * (seconds / 10.0).min(1e4) + 0.02 * swing(4, 9.0);
        let level = cos_turns(pitch);
        let drop = sin_turns(pitch);
        let look = v3(cos_turns(yaw) * level, sin_turns(yaw) * level, -drop);
        let position = target - look * distance;

        // Start near the middle, then let the target wander, and leave where an exit says so.
        let ease = lerp(0.45, 1.0, smooth_step(0.5, 3.0, seconds));
        let mut wander = (
            m.wander * ease * self.sway(6, seconds, 7.0),
            0.8 * m.wander * ease * self.sway(8, seconds, 5.3),
        );
        for exit in &self.exits {
            let out = smooth_step(exit.from - 1.0, exit.from, seconds)
                - smooth_step(exit.until, exit.until + 1.0, seconds);
            wander.0 = lerp(wander.0, exit.side * 1.65, out.clamp(0.0, 1.0));
        }
        let shake = m.shake * self.size.0.max(self.size.1) / 640.0;
        let offset = (
            wander.0 * self.size.0 * 0.5 + shake * self.tremble(10, seconds),
            wander.1 * self.size.1 * 0.5 + shake * self.tremble(12, seconds),
        );
        let roll = 0.0016 * m.shake.min(3.0) * self.tremble(14, seconds)
            + 0.008 * m.wander * self.sway(3, seconds, 6.1);
        self.look(position, look, offset, roll)
    }

    /// A camera at `position` in whose view the direction `look` appears `offset` pixels from the
    /// middle.
    fn look(&self, position: V3, look: V3, offset: (f32, f32), roll: f32) -> Camera {
        let right = look.cross(v3(0.0, 0.0, 1.0)).unit();
        let down = look.cross(right);
        let forward =
            (look - right * (offset.0 / self.focal) - down * (offset.1 / self.focal)).unit();
        // Turned without levelling again: the target lands exactly where it is wanted.
        let right = (right - forward * forward.dot(right)).unit();
        let down = forward.cross(right);
        let (cos, sin) = (cos_turns(roll), sin_turns(roll));
        let (right, down) = (right * cos + down * sin, down * cos - right * sin);
        let center = (self.size.0 * 0.5, self.size.1 * 0.5);
        Camera {
            position,
            right,
            down,
            forward,
            focal: self.focal,
            center,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(seed: u64) -> Plan {
        let manner = Manner {
            wander: 0.4,
            shake: 2.0,
            climb: 0.2,
            yaw: 0.1,
        };
        Plan::new((640.0, 360.0), 50.0, 680.0, manner, &mut Rng::new(seed, 2))
    }

    #[test]
    fn camera_basis_is_orthonormal_and_pixels_go_to_the_ground_and_back() {
        for seed in 0..20 {
            let camera = plan(seed).pose(seed as f32 * 0.7, v3(3.0, -4.0, 0.8));
            for (a, b) in [
                (camera.right, camera.down),
                (camera.down, camera.forward),
                (camera.forward, camera.right),
            ] {
                assert!(a.dot(b).abs() < 1e-5 && (a.length() - 1.0).abs() < 1e-5);
            }
            let (x, y, _) = camera.project(camera.ground(200.0, 300.0));
            assert!((x - 200.0).abs() < 0.02 && (y - 300.0).abs() < 0.02);
        }
    }

    #[test]
    fn target_starts_near_the_middle_and_leaves_the_view_at_an_exit() {
        let mut plan = plan(5);
        let target = v3(0.0, 0.0, 1.0);
        let (x, y, _) = plan.pose(0.0, target).project(target);
        assert!((x - 320.0).abs() < 140.0 && (y - 180.0).abs() < 80.0);
        plan.exits.push(Exit {
            from: 4.0,
            until: 5.0,
            side: 1.0,
        });
        let (x, _, _) = plan.pose(4.5, target).project(target);
        assert!(x > 740.0, "{x}");
    }
}
