//! Searching for a target that is not where it should be.
//!
//! Every look of a frame goes to one of three places: ahead, where the target should be; to the
//! best lead, a place that may show the target and is confirmed over several frames; or elsewhere,
//! where the target's colors are or the sweep's next tile lies. What a look elsewhere finds becomes
//! a lead.

use super::camera::Motion;
use super::evidence::Finding;
use super::judge::Judge;
use super::options::{Budget, FlightOptions};
use super::presence::sigmoid;
use super::state::{Standing, State};
use super::sweep::Sweep;
use super::target::Target;
use crate::bbox::FrameBox;
use crate::error::TrackError;
use crate::frame::Frame;
use crate::tracker::{Extent, Tracker};
use std::time::{Duration, Instant};

/// What a look elsewhere takes in: a wide one shows three times the places of a full one.
const ELSEWHERE: Extent = Extent::Wide;
/// Work of such a look, in full ones.
const ELSEWHERE_WORK: f64 = 1.7;
/// Step of a sweep, as a share of the side that a look covers.
const TILE_SHARE: f64 = 0.9;
/// Seconds of coasting during which a surely similar object far away is another object.
const SOON: f64 = 0.33;
/// Least distance of such an object from the predicted place, in target sides.
const FAR: f64 = 2.0;
/// Standard deviations of the predicted place that are added to that distance.
const SIGMAS: f64 = 3.0;
/// Share of a tile around a visited place that the colors do not lead back to.
const VISITED: f32 = 0.8;
/// Seconds for which a visited place is remembered.
const REMEMBERED: f64 = 0.5;
/// Most visited places that are remembered.
const MOST_VISITED: usize = 128;
/// Largest factor by which a side of the target grows or shrinks while it is not seen.
const MOST_RESIZED: f32 = 2.0;
/// Looks after which a doubtful place that stays the best is accepted.
const PATIENT: u32 = 10;
/// Least mean log-odds of a doubtful place.
const DOUBTFUL: f64 = -0.7;
/// Most places that wait for a closer look.
const MAX_LEADS: usize = 8;
/// Frames from one look at the predicted place to the next while the target is lost: most looks
/// then go elsewhere.
const AHEAD_EVERY: u32 = 3;
/// Looks that confirm a place ahead of a coasting target.
const CONFIRM_AHEAD: u32 = 2;

/// How much of a frame's time or searches is left.
#[derive(Clone, Copy, Debug)]
pub(super) struct Allowance {
    budget: Budget,
    started: Instant,
    spent: u32, // searches
}

impl Allowance {
    /// Starts to count.
    pub(super) fn start(budget: Budget) -> Allowance {
        Allowance {
            budget,
            started: Instant::now(),
            spent: 0,
        }
    }

    /// One search has been made.
    pub(super) fn spend(&mut self) {
        self.spent += 1;
    }

    /// Searches made so far.
    pub(super) fn spent(&self) -> u32 {
        self.spent
    }

    /// Whether another search fits that takes `cost`; the first one of a frame always does.
    fn affords(&self, cost: Duration) -> bool {
        let fits = match self.budget {
            Budget::Searches(most) => self.spent < most,
            Budget::Deadline(deadline) => self.started.elapsed() + cost * 5 / 4 < deadline,
        };
        fits || self.spent == 0
    }
}

/// What a search works with but does not own.
pub(super) struct Means<'a> {
    pub tracker: &'a mut Tracker,
    pub judge: &'a mut Judge,
    pub options: &'a FlightOptions,
    pub frame: &'a Frame<'a>,
    /// The target as predicted for this frame.
    pub target: &'a Target,
    pub standing: &'a Standing,
}

impl Means<'_> {
    /// Where the target should be, within the frame.
    fn predicted(&self) -> FrameBox {
        self.tracker.clamped(self.frame, &self.target.motion.bbox())
    }

    /// Looks at one place; the findings are the judge's.
    fn look(
        &mut self,
        around: FrameBox,
        extent: Extent,
        zoom: f64,
        window_influence: f64,
        expected: bool,
    ) -> Result<Option<Finding>, TrackError> {
        self.tracker
            .look(self.frame, around, extent, zoom, window_influence)?;
        let expected = expected.then_some(self.target);
        let finding = self.judge.examine(self.tracker, self.frame, expected);
        self.judge.recognize(self.target, false);
        Ok(finding)
    }

    /// Frame pixels by which looks elsewhere are stepped for a target of this size.
    fn tile_side(&self, size: &FrameBox) -> f64 {
        TILE_SHARE * self.tracker.covered_side(size, ELSEWHERE)
    }
}

/// What the searches of one frame came to.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Outcome {
    /// The likeliest finding where the target should be, if that was looked at.
    pub ahead: Option<Finding>,
    /// A place that is now confirmed: its box, and what spoke for it last.
    pub found: Option<(FrameBox, Finding)>,
}

/// What a look at the predicted place came to.
#[derive(Clone, Copy, Debug, Default)]
struct Ahead {
    finding: Option<Finding>,
    is_promising: bool,
}

/// A place that may show the target but is not confirmed.
#[derive(Clone, Copy, Debug)]
struct Tentative {
    bbox: FrameBox,
    confirmed: u32, // looks in a row that speak for it
    needed: u32,    // looks in a row that confirm it
    looks: u32,     // all looks
    log_odds: f64,  // sum over all looks
}

impl Tentative {
    /// A place for closer looks.
    fn new(bbox: FrameBox, needed: u32) -> Tentative {
        Tentative {
            bbox,
            confirmed: 0,
            needed,
            looks: 0,
            log_odds: 0.0,
        }
    }

    /// Takes one more look into account.
    fn note(&mut self, log_odds: f64) {
        if log_odds >= 0.0 {
            self.confirmed += 1;
        } else {
            self.confirmed = 0;
        }
        self.looks += 1;
        self.log_odds += log_odds;
    }

    /// Mean log-odds of all looks.
    fn mean(&self) -> f64 {
        self.log_odds / f64::from(self.looks.max(1))
    }

    /// Whether it is not worth another look.
    fn is_refuted(&self) -> bool {
        self.confirmed == 0 && self.mean() < DOUBTFUL
    }

    /// Whether it is the target: a place that looks right in a few looks, or a doubtful one that
    /// stays the best there is.
    fn is_found(&self) -> bool {
        self.confirmed >= self.needed || self.looks >= PATIENT && self.mean() >= DOUBTFUL
    }
}

/// A place that deserves a closer look.
#[derive(Clone, Copy, Debug)]
struct Lead {
    log_odds: f64,
    bbox: FrameBox,
}

/// A place that was looked at lately.
#[derive(Clone, Copy, Debug)]
struct Visit {
    bbox: FrameBox,
    age: f64, // in seconds
}

/// What is remembered of a search from frame to frame.
#[derive(Clone, Debug)]
pub(super) struct Search {
    tentative: Option<Tentative>,
    leads: Vec<Lead>,     // the best last
    takes_lead: bool,     // the next free look goes to a lead
    follows_colors: bool, // the next look elsewhere goes to the target's colors
    sweep: Sweep,
    visited: Vec<Visit>,
    cost: Duration, // running mean of one look
    frames: u32,    // searched in
}

impl Default for Search {
    fn default() -> Search {
        Search {
            tentative: None,
            leads: Vec::new(),
            takes_lead: false,
            follows_colors: false,
            sweep: Sweep::default(),
            visited: Vec::new(),
            cost: Duration::from_millis(20),
            frames: 0,
        }
    }
}

impl Search {
    /// Forgets everything but what a look costs: another target.
    pub(super) fn reset(&mut self) {
        self.give_up();
        self.takes_lead = false;
        self.follows_colors = false;
        self.frames = 0;
    }

    /// Drops all places.
    pub(super) fn give_up(&mut self) {
        self.tentative = None;
        self.leads.clear();
        self.sweep.clear();
        self.visited.clear();
    }

    /// Carries all places into the next frame, `dt` seconds later.
    pub(super) fn predict(&mut self, motion: &Motion, dt: f64) {
        for lead in &mut self.leads {
            lead.bbox = motion.carry(&lead.bbox);
        }
        self.visited.retain(|visit| visit.age < REMEMBERED);
        for visit in &mut self.visited {
            visit.bbox = motion.carry(&visit.bbox);
            visit.age += dt;
        }
        if let Some(tentative) = &mut self.tentative {
            tentative.bbox = motion.carry(&tentative.bbox);
        }
    }

    /// Looks for the target as long as the allowance lasts, or until it is found.
    pub(super) fn run(
        &mut self,
        means: &mut Means<'_>,
        allowance: &mut Allowance,
    ) -> Result<Outcome, TrackError> {
        let mut outcome = Outcome::default();
        // A place is looked at once a frame: confirming it takes one frame after the other.
        let mut verified = false;
        self.frames = self.frames.wrapping_add(1);
        while allowance.affords(self.cost) {
            let began = Instant::now();
            let mut work = 1.0; // in full looks
            let coasts = means.standing.state == State::Coasting;
            let is_due = coasts || self.frames.is_multiple_of(AHEAD_EVERY);
            let is_doubtful = self.tentative.is_none_or(|place| place.confirmed == 0);
            if allowance.spent() == 0 && is_due && is_doubtful {
                let ahead = self.look_ahead(means)?;
                outcome.ahead = ahead.finding;
                verified = ahead.is_promising;
            } else if !verified
                && (self.takes_lead || self.tentative.is_some())
                && self.take_lead(means.options.confirm)
            {
                verified = true;
                self.takes_lead = false;
                outcome.found = self.verify(means)?;
                if outcome.found.is_some() {
                    allowance.spend();
                    return Ok(outcome);
                }
            } else if allowance.affords(self.cost.mul_f64(ELSEWHERE_WORK)) {
                work = ELSEWHERE_WORK;
                self.takes_lead = true;
                self.look_elsewhere(means)?;
            } else {
                break;
            }
            allowance.spend();
            self.cost = (3 * self.cost + began.elapsed().div_f64(work)) / 4;
        }
        Ok(outcome)
    }

    /// Looks around the predicted place and takes the likeliest finding there for a tentative
    /// place, if it is likely at all.
    fn look_ahead(&mut self, means: &mut Means<'_>) -> Result<Ahead, TrackError> {
        let predicted = means.predicted();
        let window_influence = means.options.config.window_influence;
        means.look(predicted, Extent::Full, 1.0, window_influence, true)?;
        let Some((log_odds, finding)) = likeliest(means) else {
            return Ok(Ahead::default());
        };
        let is_promising = log_odds >= 0.0;
        if is_promising {
            let needed = if means.standing.state == State::Coasting {
                CONFIRM_AHEAD
            } else {
                means.options.confirm
            };
            let bbox = FrameBox {
                cx: finding.bbox.cx,
                cy: finding.bbox.cy,
                ..predicted
            };
            let mut tentative = Tentative::new(bbox, needed);
            tentative.note(log_odds);
            self.tentative = Some(tentative);
        }
        Ok(Ahead {
            finding: Some(finding),
            is_promising,
        })
    }

    /// Looks where the target's colors are or at the sweep's next tile, by turns, and keeps what it
    /// finds there as leads.
    fn look_elsewhere(&mut self, means: &mut Means<'_>) -> Result<(), TrackError> {
        let size = means.predicted();
        let colored = if self.follows_colors {
            self.colored_place(means, &size)
        } else {
            None
        };
        self.follows_colors = !self.follows_colors;
        let place = colored
            .map(|place| (place, 1.0))
            .or_else(|| self.next_tile(means, &size));
        let Some(((cx, cy), zoom)) = place else {
            return Ok(());
        };
        let around = FrameBox { cx, cy, ..size };
        if self.visited.len() == MOST_VISITED {
            self.visited.remove(0);
        }
        self.visited.push(Visit {
            bbox: around,
            age: 0.0,
        });
        means.look(around, ELSEWHERE, zoom, 0.0, false)?;
        for i in 0..means.judge.findings().len() {
            let finding = means.judge.findings()[i];
            suspect(means, &finding);
            if means.target.can_be_at(&finding.bbox) {
                self.add_lead(Lead {
                    log_odds: means.judge.belief(&finding, means.target),
                    bbox: resized(&finding.bbox, &size),
                });
            }
        }
        Ok(())
    }

    fn add_lead(&mut self, lead: Lead) {
        self.leads.push(lead);
        self.leads.sort_by(|a, b| a.log_odds.total_cmp(&b.log_odds));
        let excess = self.leads.len().saturating_sub(MAX_LEADS);
        self.leads.drain(..excess);
    }

    /// The place within reach that has the target's colors most and was not looked at lately.
    fn colored_place(&self, means: &mut Means<'_>, size: &FrameBox) -> Option<(f32, f32)> {
        let seen = 0.5 * VISITED * means.tile_side(size) as f32;
        let target = means.target;
        means.judge.colors.hottest(means.frame, size, |cx, cy| {
            let is_near = |visit: &Visit| {
                (visit.bbox.cx - cx).abs() <= seen && (visit.bbox.cy - cy).abs() <= seen
            };
            target.can_be_at(&FrameBox { cx, cy, ..*size }) && !self.visited.iter().any(is_near)
        })
    }

    /// The sweep's next tile and its zoom; a sweep that has ended starts over.
    fn next_tile(&mut self, means: &Means<'_>, size: &FrameBox) -> Option<((f32, f32), f64)> {
        self.sweep.next().or_else(|| {
            let side = f64::from(size.w * size.h).sqrt();
            let radius = means.target.motion.gate() * side;
            let frame_size = (means.frame.width(), means.frame.height());
            let center = (size.cx, size.cy);
            self.sweep
                .plan(frame_size, means.tile_side(size), center, radius);
            self.sweep.next()
        })
    }

    /// Makes the best lead the tentative place if there is none, or if the present one is doubtful
    /// and the lead is believed. Returns whether there is a tentative place.
    fn take_lead(&mut self, needed: u32) -> bool {
        let is_believed = self.leads.last().is_some_and(|lead| lead.log_odds >= 0.0);
        let is_free = self
            .tentative
            .is_none_or(|place| is_believed && place.confirmed == 0);
        if is_free && let Some(lead) = self.leads.pop() {
            let before = self.tentative.replace(Tentative::new(lead.bbox, needed));
            if let Some(before) = before {
                self.add_lead(Lead {
                    log_odds: before.mean(),
                    bbox: before.bbox,
                });
            }
        }
        self.tentative.is_some()
    }

    /// Tracks the tentative place for one frame; returns it once it is confirmed.
    fn verify(&mut self, means: &mut Means<'_>) -> Result<Option<(FrameBox, Finding)>, TrackError> {
        let Some(mut tentative) = self.tentative.take() else {
            return Ok(None);
        };
        let back = means.tracker.position();
        means.tracker.place(tentative.bbox);
        let track = means.tracker.find(means.frame)?;
        let finding = means.judge.examine(means.tracker, means.frame, None);
        let finding = finding.filter(|finding| {
            means.judge.recognize(means.target, false);
            tentative.note(means.judge.belief(finding, means.target));
            !tentative.is_refuted()
        });
        let Some(finding) = finding else {
            if let Some(position) = back {
                means.tracker.restore(position);
            }
            return Ok(None);
        };
        tentative.bbox = track.bbox.center();
        if tentative.is_found() {
            return Ok(Some((tentative.bbox, finding)));
        }
        self.tentative = Some(tentative);
        Ok(None)
    }
}

/// The likeliest finding of the last search, with its log-odds.
fn likeliest(means: &Means<'_>) -> Option<(f64, Finding)> {
    let believed = means
        .judge
        .findings()
        .iter()
        .map(|finding| (means.judge.belief(finding, means.target), *finding));
    believed.max_by(|a, b| a.0.total_cmp(&b.0))
}

/// Makes a finding a rival if it surely looks like the target, but is where the target cannot be so
/// soon.
fn suspect(means: &mut Means<'_>, finding: &Finding) {
    let far = FAR + SIGMAS * means.target.motion.spread();
    let alike = sigmoid(means.judge.again_odds(finding));
    let is_soon = means.standing.state == State::Coasting && means.standing.age <= SOON;
    let is_far = means.target.away(&finding.bbox) >= far;
    if is_soon && is_far && alike >= means.options.sure {
        means.judge.rivals.meet(&finding.bbox);
    }
}

/// A found box, its size clamped to what the target can have reached since it was last seen.
pub(super) fn resized(found: &FrameBox, last: &FrameBox) -> FrameBox {
    let side = |found: f32, last: f32| found.clamp(last / MOST_RESIZED, last * MOST_RESIZED);
    FrameBox {
        w: side(found.w, last.w),
        h: side(found.h, last.h),
        ..*found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sure_place_is_found_soon_and_doubtful_one_late() {
        let after = |log_odds: &[f64]| {
            let mut tentative = Tentative::new(FrameBox::default(), 3);
            log_odds.iter().for_each(|odds| tentative.note(*odds));
            tentative
        };
        assert!(after(&[0.1, 2.0, 0.5]).is_found());
        assert!(!after(&[0.1, 2.0, -0.1, 0.5]).is_found(), "in a row");
        let doubtful = [-0.5; PATIENT as usize];
        assert!(!after(&doubtful[1..]).is_found() && after(&doubtful).is_found());
        assert!(after(&[-1.0]).is_refuted() && !after(&[-0.5]).is_refuted());
        assert!(after(&[0.2, 0.2, -9.0]).is_refuted());
        assert!(after(&[-0.2, f64::NEG_INFINITY]).is_refuted(), "a rival");
        let rival = after(&[f64::NEG_INFINITY, 0.3]);
        assert!(!rival.is_refuted() && !rival.is_found());
    }

    #[test]
    fn returned_target_changes_size_within_bounds() {
        let last = FrameBox {
            cx: 0.0,
            cy: 0.0,
            w: 20.0,
            h: 10.0,
        };
        let found = FrameBox {
            cx: 50.0,
            cy: 60.0,
            w: 30.0,
            h: 6.0,
        };
        assert_eq!(resized(&found, &last), found);
        let far_off = FrameBox {
            w: 90.0,
            h: 1.0,
            ..found
        };
        assert_eq!(
            resized(&far_off, &last),
            FrameBox {
                w: 40.0,
                h: 5.0,
                ..found
            }
        );
    }
}
