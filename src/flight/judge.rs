//! From what a search shows to whether it is the target.

use super::camera::Motion;
use super::candidates::Candidate;
use super::colors::Colors;
use super::evidence::{Evidence, Finding, Witness};
use super::presence::{Presence, Smoothed};
use super::rivals::Rivals;
use super::target::Target;
use crate::bbox::FrameBox;
use crate::frame::Frame;
use crate::tracker::Tracker;

/// Log-odds against a finding that a known rival claims: most of what is known to be a rival is one.
const CLAIMED: f64 = 3.0;
/// Share of the chosen box's score that a rival must have to be taken in its place.
const RIVAL_SCORE: f32 = 0.5;
/// Most that such a rival's similarity may fall behind the chosen box's.
const RIVAL_SIMILARITY: f32 = 0.1;

/// Everything that is known of the target's appearance, and of the objects around it.
#[derive(Debug)]
pub(super) struct Judge {
    pub presence: Presence,
    witness: Witness,
    pub rivals: Rivals,
    pub colors: Colors,
    smoothed: Smoothed,
    evidence: Option<Evidence>,
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
        }
    }

    /// Starts anew with the target in `bbox`.
    pub(super) fn begin(&mut self, frame: &Frame<'_>, bbox: &FrameBox) {
        *self = Judge::new(self.presence);
        self.colors.learn(frame, bbox, 1.0);
    }

    /// Carries the rivals into the next frame.
    pub(super) fn predict(&mut self, motion: &Motion) {
        self.rivals.predict(motion);
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
            tracker.network(),
            tracker.selector(),
            tracker.response(),
            tracker.seen()?,
            motion,
            |bbox| self.colors.likeness(frame, bbox),
        );
        self.evidence = finding.map(|finding| finding.evidence);
        finding
    }

    /// Presence after a look with these log-odds.
    pub(super) fn smooth(&mut self, log_odds: f64) -> f64 {
        self.smoothed.add(&self.presence, log_odds)
    }

    /// Forgets the presence of the frames before.
    pub(super) fn forget_presence(&mut self) {
        self.smoothed = Smoothed::default();
    }

    /// Log-odds that a finding is the target, by its appearance and by its place.
    pub(super) fn belief(&self, finding: &Finding, target: &Target) -> f64 {
        let appearance = self.presence.again.log_odds(&finding.evidence);
        let claimed = if self.is_claimed(&finding.bbox, target) {
            CLAIMED
        } else {
            0.0
        };
        appearance + target.motion.log_ratio(&finding.bbox) - claimed
    }

    /// Whether a box is rather on a known rival than on the target.
    pub(super) fn is_claimed(&self, bbox: &FrameBox, target: &Target) -> bool {
        self.rivals.claim(bbox, target.away(bbox))
    }

    /// Recognizes known rivals among the last search's candidates, and takes up new ones where the
    /// target was surely `seen`.
    pub(super) fn recognize(&mut self, target: &Target, seen: bool) {
        self.rivals
            .observe(&self.witness.candidates, &target.motion, seen);
    }

    /// The best other candidate where the target can be, if it looks as much like the target as the
    /// chosen one: two similar objects cross.
    pub(super) fn alternative(&self, target: &Target) -> Option<FrameBox> {
        let (chosen, others) = self.witness.candidates.split_first()?;
        let mut best: Option<&Candidate> = None;
        for other in others {
            let alike = other.score >= RIVAL_SCORE * chosen.score
                && other.similarity >= chosen.similarity - RIVAL_SIMILARITY;
            let better = best.is_none_or(|best| other.score >= best.score);
            if alike && better && target.can_be_at(&other.bbox.center()) {
                best = Some(other);
            }
        }
        best.map(|candidate| candidate.bbox.center())
    }

    /// Learns the target's appearance from what was last examined, with some `trust` in `[0, 1]`.
    pub(super) fn learn(&mut self, evidence: &Evidence, trust: f64) {
        self.witness.learn(evidence, trust);
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

    /// Puts the evidence of an earlier finding back, in place of that of a search without consequence.
    pub(super) fn restore(&mut self, evidence: Option<Evidence>) {
        self.evidence = evidence;
    }

    /// Drops the candidates of a search without consequence.
    pub(super) fn drop_candidates(&mut self) {
        self.witness.candidates.clear();
    }
}
