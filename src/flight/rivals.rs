//! Rivals: objects that were seen beside the target and therefore are not it. Each is followed on
//! its own, so that it is still known when target and rival have crossed, or when only one of them
//! comes out from behind a bridge.

use super::camera::Motion;
use super::candidates::Candidate;
use super::kalman::Kalman;
use crate::bbox::FrameBox;

/// Most rivals that are followed.
const MOST: usize = 8;
/// Least score of a candidate that may be a known rival.
const SCORE: f32 = 0.1;
/// Least score of a candidate that may be a new rival.
const NEW_SCORE: f32 = 0.3;
/// Least distance from the target, in its sides, of a candidate that is not a part of it.
const APART: f64 = 0.8;
/// Least distance from its prediction, in sides, within which a rival is recognized.
const SAME: f64 = 0.6;
/// Most of that distance, which grows with the prediction's variance.
const MOST_REACH: f64 = 1.5;
/// Times that a rival must have been seen before it counts.
const KNOWN: u32 = 4;
/// Seconds without being seen after which it is forgotten.
const FORGOTTEN: f64 = 1.5;

#[derive(Clone, Copy, Debug)]
struct Rival {
    kalman: Kalman,
    seen: u32,
    unseen: f64, // seconds since
}

impl Rival {
    /// Distance from its prediction, in sides, within which it is recognized.
    fn reach(&self) -> f64 {
        (SAME + self.kalman.spread()).min(MOST_REACH)
    }
}

/// The target's rivals.
#[derive(Clone, Debug, Default)]
pub(super) struct Rivals {
    known: Vec<Rival>,
}

impl Rivals {
    /// Forgets all of them.
    pub(super) fn clear(&mut self) {
        self.known.clear();
    }

    /// Carries them into the next frame, `dt` seconds later.
    pub(super) fn predict(&mut self, motion: &Motion, dt: f64) {
        for rival in &mut self.known {
            rival.kalman.predict(motion, dt);
            rival.unseen += dt;
        }
        self.known.retain(|rival| rival.unseen <= FORGOTTEN);
    }

    /// Recognizes them among the candidates of a search. `target` is where the target is, or should
    /// be; if it was surely `seen` there, any other similar object is a rival, known or new.
    pub(super) fn observe(&mut self, candidates: &[Candidate], target: &Kalman, seen: bool) {
        for candidate in candidates.iter().filter(|c| c.score >= SCORE) {
            let bbox = candidate.bbox.center();
            let away = target.distance(&bbox);
            let near = self
                .known
                .iter_mut()
                .map(|rival| (rival.kalman.distance(&bbox), rival));
            let nearest = near
                .filter(|(_, rival)| rival.unseen > 0.0)
                .min_by(|a, b| a.0.total_cmp(&b.0));
            match nearest {
                Some((distance, rival)) if distance <= rival.reach().min(away) => {
                    rival.kalman.correct(&bbox, 1.0);
                    rival.kalman.resize(&bbox);
                    rival.seen += 1;
                    rival.unseen = 0.0;
                }
                _ if seen && away >= APART && candidate.score >= NEW_SCORE => self.add(&bbox),
                _ => {}
            }
        }
        if seen {
            // A rival at the target's place is the target, or hidden by it.
            let at = target.bbox();
            self.known
                .retain(|rival| rival.unseen > 0.0 || rival.kalman.distance(&at) >= 0.5 * APART);
        }
    }

    /// Follows a box from now on as a known rival.
    pub(super) fn meet(&mut self, bbox: &FrameBox) {
        let near = self
            .known
            .iter_mut()
            .find(|rival| rival.kalman.distance(bbox) <= rival.reach());
        match near {
            Some(rival) => rival.seen = rival.seen.max(KNOWN),
            None => {
                self.add(bbox);
                self.known
                    .last_mut()
                    .into_iter()
                    .for_each(|rival| rival.seen = KNOWN);
            }
        }
    }

    fn add(&mut self, bbox: &FrameBox) {
        if self.known.len() == MOST {
            let least = (0..MOST).min_by(|&a, &b| {
                let (a, b) = (&self.known[a], &self.known[b]);
                a.seen.cmp(&b.seen).then(b.unseen.total_cmp(&a.unseen))
            });
            self.known.remove(least.unwrap_or(0));
        }
        self.known.push(Rival {
            kalman: Kalman::new(bbox),
            seen: 1,
            unseen: 0.0,
        });
    }

    /// Whether a box is likelier on a known rival than on the target, which would be `away` sides
    /// from where it should be.
    pub(super) fn claim(&self, bbox: &FrameBox, away: f64) -> bool {
        let known = self.known.iter().filter(|rival| rival.seen >= KNOWN);
        known
            .map(|rival| (rival.kalman.distance(bbox), rival))
            .any(|(d, rival)| d < rival.reach().min(away))
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
            h: 20.0,
        }
    }

    fn seen_at(cx: f32, cy: f32) -> Candidate {
        Candidate {
            bbox: at(cx, cy).corner(),
            score: 0.6,
            similarity: 0.8,
        }
    }

    /// A target that stands and a rival that comes toward it, 2 pixels a frame.
    fn meeting() -> (Rivals, Kalman) {
        let (mut rivals, target) = (Rivals::default(), Kalman::new(&at(100.0, 50.0)));
        for step in 0..20 {
            rivals.predict(&Motion::default(), FRAME);
            let candidates = [
                seen_at(100.0, 50.0),
                seen_at(180.0 - 2.0 * step as f32, 50.0),
            ];
            rivals.observe(&candidates, &target, true);
        }
        (rivals, target)
    }

    #[test]
    fn rival_that_crossed_the_target_is_still_known() {
        let (mut rivals, target) = meeting();
        assert!(rivals.claim(&at(142.0, 50.0), 2.1));
        assert!(!rivals.claim(&at(100.0, 50.0), 0.0));
        for _ in 0..30 {
            rivals.predict(&Motion::default(), FRAME); // both are hidden
        }
        let (rival, away) = (at(82.0, 50.0), target.distance(&at(82.0, 50.0)));
        assert!(rivals.claim(&rival, away));
        assert!(
            !rivals.claim(&at(100.0, 50.0), 0.0),
            "where the target should be it is the target"
        );
    }

    #[test]
    fn faint_or_overlapping_candidate_is_no_rival() {
        let (mut rivals, target) = (Rivals::default(), Kalman::new(&at(100.0, 50.0)));
        for _ in 0..10 {
            rivals.predict(&Motion::default(), FRAME);
            rivals.observe(&[seen_at(110.0, 50.0)], &target, true);
            rivals.observe(
                &[Candidate {
                    score: 0.05,
                    ..seen_at(160.0, 50.0)
                }],
                &target,
                true,
            );
            rivals.observe(&[seen_at(40.0, 50.0)], &target, false); // may be the target itself
        }
        for x in [110.0, 160.0, 40.0] {
            assert!(!rivals.claim(&at(x, 50.0), 3.0), "{x}");
        }
    }

    #[test]
    fn rivals_are_bounded_and_forgotten() {
        let (mut rivals, target) = (Rivals::default(), Kalman::new(&at(0.0, 0.0)));
        for x in 1..40 {
            rivals.observe(&[seen_at(100.0 * x as f32, 0.0)], &target, true);
        }
        assert_eq!(rivals.known.len(), MOST);
        rivals.meet(&at(3900.0, 0.0));
        assert!(rivals.claim(&at(3900.0, 0.0), 9.0));
        for _ in 0..50 {
            rivals.predict(&Motion::default(), FRAME);
        }
        assert!(rivals.known.is_empty());
    }
}
