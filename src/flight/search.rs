//! Finding a target that is not where it should be.

use super::camera::Motion;
use super::evidence::Finding;
use super::kalman::Kalman;
use super::presence::Smoothed;
use super::{Budget, FlightTracker, State};
use crate::bbox::CenterBox;
use crate::error::TrackError;
use crate::frame::Frame;
use std::time::{Duration, Instant};

/// A place that looks like the target but is not yet taken for it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tentative {
    pub bbox: CenterBox,
    confirmed: u32, // looks in a row that speak for it,
    needed: u32,    // so many are enough
    looks: u32,     // all of them,
    log_odds: f64,  // and their sum
}

impl Tentative {
    /// A place for closer looks.
    fn new(bbox: CenterBox, needed: u32) -> Tentative {
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
        self.confirmed = if log_odds >= 0.0 {
            self.confirmed + 1
        } else {
            0
        };
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

    /// Whether it is taken for the target: what is surely right in a few looks, or what is doubtful and stays the best there is.
    fn is_found(&self) -> bool {
        self.confirmed >= self.needed || self.looks >= PATIENT && self.mean() >= DOUBTFUL
    }
}

/// Share of the frame's side by which a search at zoom 1 is stepped in a sweep: cells cover 136 of 303 crop pixels.
const TILE_SHARE: f64 = 120.0 / 303.0;
/// Frames of coasting during which what surely looks like the target
const SOON: u32 = 10;
/// this far from where it should be, in its sides and in standard deviations of that place more, is another object.
const FAR: f64 = 2.0;
const SIGMAS: f64 = 3.0;
/// Log-odds that speak against what is rather where a known rival should be: most of what is known to be a rival is one.
const CLAIMED: f64 = 3.0;
/// Share of what one search covers that its colors need not bring us back to,
const VISITED: f32 = 0.8;
/// for so many frames,
const REMEMBERED: u32 = 15;
/// of so many places at most.
const MOST_VISITED: usize = 128;
/// Most that a side of the target grows or shrinks by while it is not seen.
const MOST_RESIZED: f32 = 2.0;
/// Looks that something doubtful must last,
const PATIENT: u32 = 10;
/// and the least mean of its log-odds.
const DOUBTFUL: f64 = -0.7;
/// Most places that wait for a closer look.
const MAX_LEADS: usize = 8;

/// What was found, of a size that the target can have come to since it was last seen.
pub(super) fn resized(found: &CenterBox, last: &CenterBox) -> CenterBox {
    let side = |found: f32, last: f32| found.clamp(last / MOST_RESIZED, last * MOST_RESIZED);
    CenterBox {
        w: side(found.w, last.w),
        h: side(found.h, last.h),
        ..*found
    }
}

impl FlightTracker {
    /// Looks where the target should be, then wherever it may be, as long as the budget lasts; returns the searches made.
    pub(super) fn seek(
        &mut self,
        frame: &Frame<'_>,
        motion: &Motion,
        budget: Budget,
        started: Instant,
    ) -> Result<u32, TrackError> {
        if let Some(kalman) = &mut self.kalman {
            kalman.coast();
            kalman.bound(frame.width(), frame.height());
        }
        self.carry_places(motion);
        if self.state == State::Coasting && self.frames_in_state > self.options.coast {
            self.enter(State::Lost);
        }
        self.search(frame, budget, started, 0)
    }

    /// Looks for the target where it should be since it was last surely seen, while the tracker goes on following what is doubted; returns the
    /// searches made, with the one for what is followed.
    pub(super) fn look_beside(
        &mut self,
        frame: &Frame<'_>,
        motion: &Motion,
        budget: Budget,
        started: Instant,
    ) -> Result<u32, TrackError> {
        self.carry_places(motion);
        let (kalman, evidence, followed) = (self.kalman, self.evidence, self.tracker.target_box());
        self.kalman = self.anchor;
        let searches = self.search(frame, budget, started, 1)?;
        if self.state != State::Reacquired {
            (self.kalman, self.evidence) = (kalman, evidence);
            followed
                .into_iter()
                .for_each(|bbox| self.tracker.place(bbox));
        }
        Ok(searches)
    }

    /// Carries the places that are remembered into the next frame.
    fn carry_places(&mut self, motion: &Motion) {
        let carry = |bbox: &CenterBox| motion.carry(bbox);
        for (_, bbox) in &mut self.leads {
            *bbox = carry(bbox);
        }
        self.visited.retain(|(_, age)| *age < REMEMBERED);
        for (bbox, age) in &mut self.visited {
            (*bbox, *age) = (carry(bbox), *age + 1);
        }
        if let Some(tentative) = &mut self.tentative {
            tentative.bbox = carry(&tentative.bbox);
        }
    }

    /// Searches as long as the budget lasts, `searches` having been made for this frame; returns them all.
    fn search(
        &mut self,
        frame: &Frame<'_>,
        budget: Budget,
        started: Instant,
        mut searches: u32,
    ) -> Result<u32, TrackError> {
        let mut verified = false;
        let is_left = |searches: u32, cost: Duration| match budget {
            Budget::Searches(most) => searches < most,
            Budget::Deadline(deadline) => started.elapsed() + cost * 5 / 4 < deadline,
        };
        while searches == 0 || is_left(searches, self.search_cost) {
            let began = Instant::now();
            let ahead = self.state == State::Coasting || self.frames_in_state.is_multiple_of(3);
            let doubtful = self
                .tentative
                .is_none_or(|tentative| tentative.confirmed == 0);
            if searches == 0 && ahead && doubtful {
                verified = self.look_ahead(frame)?;
            } else if !verified
                && (self.closer_look || self.tentative.is_some())
                && self.take_lead()
            {
                // Once a frame: it takes one frame after the other to confirm a place.
                (verified, self.closer_look) = (true, false);
                if self.verify(frame)? {
                    return Ok(searches + 1);
                }
            } else {
                self.closer_look = true;
                self.look_elsewhere(frame)?;
            }
            searches += 1;
            self.search_cost = (3 * self.search_cost + began.elapsed()) / 4;
        }
        Ok(searches)
    }

    /// Looks around the predicted place; `true` if something there may be the target.
    fn look_ahead(&mut self, frame: &Frame<'_>) -> Result<bool, TrackError> {
        let predicted = self.predicted(frame);
        self.tracker
            .look(frame, predicted, 1.0, self.options.config.window_influence)?;
        self.judge(frame, true);
        self.recognize(false);
        let believed = self
            .witness
            .findings
            .iter()
            .map(|finding| (self.belief(finding), *finding));
        let Some((log_odds, finding)) = believed.max_by(|a, b| a.0.total_cmp(&b.0)) else {
            return Ok(false);
        };
        self.score = finding.score;
        self.probability = self
            .smoothed
            .add(
                &self.presence,
                self.presence.look.log_odds(&finding.evidence),
            )
            .min(self.options.present);
        let promising = log_odds >= 0.0;
        if promising {
            let needed = if self.state == State::Coasting {
                2
            } else {
                self.options.confirm
            };
            let bbox = CenterBox {
                cx: finding.bbox.cx,
                cy: finding.bbox.cy,
                ..predicted
            };
            let mut tentative = Tentative::new(bbox, needed);
            tentative.note(log_odds);
            self.tentative = Some(tentative);
        }
        Ok(promising)
    }

    /// Log-odds that what was found is the target, by its looks and by its place.
    pub(super) fn belief(&self, finding: &Finding) -> f64 {
        let Some(kalman) = self.kalman else {
            return f64::NEG_INFINITY;
        };
        let claimed = self.rivals.claim(&finding.bbox, self.away(&finding.bbox));
        let looks = self.presence.again.log_odds(&finding.evidence);
        looks + kalman.log_ratio(&finding.bbox) - if claimed { CLAIMED } else { 0.0 }
    }

    /// Something that surely looks like the target, but is where it cannot be so soon, is a rival.
    fn suspect(&mut self, finding: &Finding) {
        let far = FAR + SIGMAS * self.kalman.map_or(0.0, |kalman| kalman.spread());
        let alike = self.presence.again.alone(&finding.evidence) >= self.options.sure;
        if alike
            && self.state == State::Coasting
            && self.frames_in_state <= SOON
            && self.away(&finding.bbox) >= far
        {
            self.rivals.meet(&finding.bbox);
        }
    }

    /// Looks where the target's colors are or at the sweep's next tile, by turns, and keeps what it finds there as a lead.
    fn look_elsewhere(&mut self, frame: &Frame<'_>) -> Result<(), TrackError> {
        let size = self.predicted(frame);
        let colored = if self.by_colors {
            self.colored_place(frame, &size)
        } else {
            None
        };
        self.by_colors = !self.by_colors;
        let place = colored
            .map(|place| (place, 1.0))
            .or_else(|| self.next_tile(frame, &size));
        let Some(((cx, cy), zoom)) = place else {
            return Ok(());
        };
        let around = CenterBox { cx, cy, ..size };
        if self.visited.len() == MOST_VISITED {
            self.visited.remove(0);
        }
        self.visited.push((around, 0));
        self.tracker.look(frame, around, zoom, 0.0)?;
        self.judge(frame, false);
        self.recognize(false);
        for i in 0..self.witness.findings.len() {
            let finding = self.witness.findings[i];
            self.suspect(&finding);
            if self.is_within_reach(&finding.bbox) {
                self.add_lead(self.belief(&finding), resized(&finding.bbox, &size));
            }
        }
        Ok(())
    }

    fn add_lead(&mut self, log_odds: f64, bbox: CenterBox) {
        self.leads.push((log_odds, bbox));
        self.leads.sort_by(|a, b| a.0.total_cmp(&b.0));
        let excess = self.leads.len().saturating_sub(MAX_LEADS);
        self.leads.drain(..excess);
    }

    /// The place within reach that has the target's colors most and was not looked at lately.
    fn colored_place(&mut self, frame: &Frame<'_>, size: &CenterBox) -> Option<(f32, f32)> {
        let kalman = self.kalman?;
        let seen = 0.5 * VISITED * self.tile_side(size) as f32;
        let visited = &self.visited;
        self.colors.hottest(frame, size, |cx, cy| {
            let near = |at: &CenterBox| (at.cx - cx).abs() <= seen && (at.cy - cy).abs() <= seen;
            kalman.distance(&CenterBox { cx, cy, ..*size }) <= kalman.gate()
                && !visited.iter().any(|(at, _)| near(at))
        })
    }

    /// The sweep's next tile and its zoom, of a new sweep if need be.
    fn next_tile(&mut self, frame: &Frame<'_>, size: &CenterBox) -> Option<((f32, f32), f64)> {
        self.sweep.next().or_else(|| {
            let side = f64::from(size.w * size.h).sqrt();
            let radius = self.kalman.map_or(0.0, |kalman| kalman.gate()) * side;
            let frame_size = (frame.width(), frame.height());
            self.sweep
                .plan(frame_size, self.tile_side(size), (size.cx, size.cy), radius);
            self.sweep.next()
        })
    }

    /// Takes the best lead for a closer look, unless there is a place already; what is doubtful there steps back for a lead that is believed.
    /// Returns whether there is a place now.
    fn take_lead(&mut self) -> bool {
        let believed = self
            .leads
            .last()
            .is_some_and(|(log_odds, _)| *log_odds >= 0.0);
        if self
            .tentative
            .is_none_or(|tentative| believed && tentative.confirmed == 0)
            && let Some((_, bbox)) = self.leads.pop()
        {
            let before = self
                .tentative
                .replace(Tentative::new(bbox, self.options.confirm));
            before
                .into_iter()
                .for_each(|before| self.add_lead(before.mean(), before.bbox));
        }
        self.tentative.is_some()
    }

    /// Tracks the tentative place for one frame; `true` if it is now taken for the target.
    fn verify(&mut self, frame: &Frame<'_>) -> Result<bool, TrackError> {
        let Some(mut tentative) = self.tentative.take() else {
            return Ok(false);
        };
        let back = self.tracker.target_box();
        self.tracker.place(tentative.bbox);
        let track = self.tracker.find(frame)?;
        let Some(finding) = self.judge(frame, false) else {
            return Ok(false);
        };
        self.recognize(false);
        tentative.note(self.belief(&finding));
        if tentative.is_refuted() {
            back.into_iter().for_each(|bbox| self.tracker.place(bbox));
            return Ok(false);
        }
        tentative.bbox = track.bbox.center();
        if !tentative.is_found() {
            self.tentative = Some(tentative);
            return Ok(false);
        }
        self.probation = self.kalman.map(|kalman| (kalman, 0));
        self.kalman = Some(Kalman::new(&tentative.bbox));
        (self.anchor, self.next_anchor) = (self.kalman, None);
        self.smoothed = Smoothed::default();
        self.probability = self.smoothed.add(
            &self.presence,
            self.presence.look.log_odds(&finding.evidence),
        );
        self.score = finding.score;
        self.enter(State::Reacquired);
        (self.faint, self.doubted, self.calm) = (0, 0, 0);
        self.give_up_search();
        Ok(true)
    }

    /// Frame pixels that one search covers for a target of this size.
    fn tile_side(&self, size: &CenterBox) -> f64 {
        let architecture = self.tracker.model().architecture();
        let scale = crate::crop::scale(
            size.w.into(),
            size.h.into(),
            self.options.config.context_amount,
            architecture.template_size,
        );
        TILE_SHARE * architecture.search_size as f64 / scale
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sure_is_taken_soon_and_what_is_doubtful_late() {
        let after = |log_odds: &[f64]| {
            let mut tentative = Tentative::new(CenterBox::default(), 3);
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
    fn a_target_returns_larger_or_smaller_within_bounds() {
        let last = CenterBox {
            cx: 0.0,
            cy: 0.0,
            w: 20.0,
            h: 10.0,
        };
        let found = CenterBox {
            cx: 50.0,
            cy: 60.0,
            w: 30.0,
            h: 6.0,
        };
        assert_eq!(resized(&found, &last), found);
        let far_off = CenterBox {
            w: 90.0,
            h: 1.0,
            ..found
        };
        assert_eq!(
            resized(&far_off, &last),
            CenterBox {
                w: 40.0,
                h: 5.0,
                ..found
            }
        );
    }
}
