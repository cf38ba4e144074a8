//! From what a search shows to whether it is the target.

use super::camera::Motion;
use super::candidates::Candidate;
use super::colors::Colors;
use super::evidence::{Evidence, Finding, Witness};
use super::presence::{Presence, Smoothed};
use super::rivals::Rivals;
use super::target::Target;
use super::texture::is_blank;
use crate::bbox::FrameBox;
use crate::frame::Frame;
use crate::tracker::Tracker;

/// Log-odds against a finding that a known rival claims: known rivals are seldom the target.
const CLAIMED: f64 = 3.0;
/// Log-odds of whatever a picture that shows nothing seems to show.
const NOTHING: f64 = -8.0;

/// Everything that is known of the target's appearance, and of the objects around it.
#[derive(Debug)]
pub(super) struct Judge {
    pub presence: Presence,
    witness: Witness,
    pub rivals: Rivals,
    pub colors: Colors,
    smoothed: Smoothed,
    evidence: Option<Evidence>,
    /// Whether the target was blank when it was given.
    nothing_to_know: bool,
    /// Whether the present picture has nothing in common with the one before.
    nothing_to_see: bool,
}

impl Judge {
    pub(super) fn new(presence: Presence) -> Judge {
        Judge {
            presence,
            witness: Witness::default(),
            rivals: Rivals::default(),
            colors: Colors::default(),
            smoothed: Smoothed::default(),
            evidence: None,
            nothing_to_know: false,
            nothing_to_see: false,
        }
    }

    /// Starts over with the target in `bbox`.
    pub(super) fn begin(&mut self, frame: &Frame<'_>, bbox: &FrameBox) {
        *self = Judge::new(self.presence);
        self.colors.learn(frame, bbox, 1.0, 0.0);
        self.nothing_to_know = is_blank(frame, bbox);
    }

    /// Carries the rivals into the next frame, `dt` seconds later. A picture that has nothing in
    /// common with the one before is `noise`.
    pub(super) fn predict(&mut self, motion: &Motion, dt: f64, noise: bool) {
        self.rivals.predict(motion, dt);
        self.nothing_to_see = noise;
    }

    /// What speaks for the choice of the tracker's last search, which looked at `frame`; its motion
    /// counts if the target was `expected` there. `None` if the search chose nothing.
    pub(super) fn examine(
        &mut self,
        tracker: &Tracker,
        frame: &Frame<'_>,
        expected: Option<&Target>,
    ) -> Option<Finding> {
        let motion = |bbox: &FrameBox| expected.map_or(0.0, |target| target.away(bbox));
        let finding = self.witness.judge(
            tracker,
            motion,
            |bbox| self.colors.likeness(frame, bbox),
            |bbox| is_blank(frame, bbox),
        );
        self.evidence = finding.map(|finding| finding.evidence);
        finding
    }

    /// Whether a finding is evidence of nothing: there is nothing to be seen, or nothing to compare
    /// it with.
    pub(super) fn is_nothing(&self, finding: &Finding) -> bool {
        finding.is_blank || self.nothing_to_know || self.nothing_to_see
    }

    /// Log-odds of a finding by its appearance, for a target that was seen just before.
    pub(super) fn look_odds(&self, finding: &Finding) -> f64 {
        if self.is_nothing(finding) {
            NOTHING
        } else {
            self.presence.look.log_odds(&finding.evidence)
        }
    }

    /// Log-odds of a finding by its appearance, for a target that has been gone for a while.
    pub(super) fn again_odds(&self, finding: &Finding) -> f64 {
        if self.is_nothing(finding) {
            NOTHING
        } else {
            self.presence.again.log_odds(&finding.evidence)
        }
    }

    /// Presence after a look with these log-odds, `dt` seconds after the last.
    pub(super) fn smooth(&mut self, log_odds: f64, dt: f64) -> f64 {
        self.smoothed.add(&self.presence, log_odds, dt)
    }

    /// Forgets the presence of the frames before.
    pub(super) fn forget_presence(&mut self) {
        self.smoothed = Smoothed::default();
    }

    /// Log-odds that a finding is the target, by its appearance and by its place.
    pub(super) fn belief(&self, finding: &Finding, target: &Target) -> f64 {
        let appearance = self.again_odds(finding);
        let claimed = if self.is_claimed(&finding.bbox, target) {
            CLAIMED
        } else {
            0.0
        };
        appearance + target.motion.log_ratio(&finding.bbox) - claimed
    }

    /// Whether a box is likelier on a known rival than on the target.
    pub(super) fn is_claimed(&self, bbox: &FrameBox, target: &Target) -> bool {
        self.rivals.claim(bbox, target.away(bbox))
    }

    /// Recognizes known rivals among the last search's candidates, and takes up new ones where the
    /// target was surely `seen`.
    pub(super) fn recognize(&mut self, target: &Target, seen: bool) {
        self.rivals
            .observe(&self.witness.candidates, &target.motion, seen);
    }

    /// Learns the target's appearance from what was last examined, with some `trust` in `[0, 1]`.
    pub(super) fn learn(&mut self, evidence: &Evidence, trust: f64, dt: f64) {
        self.witness.learn(evidence, trust, dt);
    }

    /// All findings of the last search, the chosen one first.
    pub(super) fn findings(&self) -> &[Finding] {
        &self.witness.findings
    }

    /// All candidates of the last search, the chosen one first.
    pub(super) fn candidates(&self) -> &[Candidate] {
        &self.witness.candidates
    }

    /// What spoke for the last finding.
    pub(super) fn evidence(&self) -> Option<&Evidence> {
        self.evidence.as_ref()
    }

    /// Puts the evidence of an earlier finding back, in place of that of a search without
    /// consequence.
    pub(super) fn restore(&mut self, evidence: Option<Evidence>) {
        self.evidence = evidence;
    }
}
