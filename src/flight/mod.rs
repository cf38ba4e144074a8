//! Tracking in flight: knows when the target is lost, coasts through occlusions, finds it again.
//!
//! [`FlightTracker`] wraps the plain [`Tracker`]. While the target is surely there its boxes are that
//! tracker's, bit for bit; every box comes with a `presence`, the calibrated probability that it is
//! on the target. A frame takes five steps: predict, observe, judge, decide, act.
//!
//! | file | contents |
//! |---|---|
//! | `mod.rs` | the five steps: start at [`FlightTracker::update`] |
//! | `state.rs` | the states, and `State::next`, which decides |
//! | `target.rs` | where the target is, and where it was when it was surely seen |
//! | `search.rs`, `sweep.rs` | where a lost target is searched for, and when it counts as found |
//! | `judge.rs` | from a search's findings to whether they are the target |
//! | `evidence.rs`, `candidates.rs` | what a search says about its choice and about other places |
//! | `presence.rs` | from evidence to probability; the coefficients travel with the weights |
//! | `rivals.rs`, `colors.rs` | objects beside the target that are not it; the target's colors |
//! | `camera.rs`, `kalman.rs` | the picture's motion, and the target's own |
//! | `options.rs` | options and results |

mod camera;
mod candidates;
mod colors;
mod evidence;
mod judge;
mod kalman;
mod options;
mod presence;
mod rivals;
mod search;
mod state;
mod sweep;
mod target;

use crate::bbox::{BBox, FrameBox};
use crate::error::TrackError;
use crate::frame::Frame;
use crate::model::Model;
use crate::tracker::{SearchRegion, Track, Tracker, TrackerOptions};
use camera::{CameraMotion, Motion};
use evidence::Finding;
use judge::Judge;
use kalman::Kalman;
use search::{Allowance, Means, Outcome, Search};
use state::{Limits, Sighting, Standing};
use target::Target;

pub use candidates::{Candidate, MAX_CANDIDATES};
pub use evidence::{COUNT as EVIDENCE_COUNT, Evidence, NAMES as EVIDENCE_NAMES};
pub use options::{BELIEVED, Budget, Conduct, FlightOptions, FlightTrack};
pub use presence::{NOTE as PRESENCE_NOTE, Presence, PresenceError, Weighing};
pub use state::State;

/// Follows one object and says whether it is there.
#[derive(Debug)]
pub struct FlightTracker {
    tracker: Tracker,
    options: FlightOptions,
    camera: CameraMotion,
    judge: Judge,
    search: Search,
    standing: Standing,
    target: Option<Target>,
    score: f32,    // of the last frame
    presence: f64, // of the last frame
}

/// Frames of [`State::Reacquired`] before [`State::Tracking`].
const FRESH: u32 = 10;
/// Log-odds below which a re-acquisition is taken back.
const REFUTED: f64 = -2.0;
/// Likeness of colors below which something that is likelier not the target is another object.
const FOREIGN: f64 = 0.7;

/// What the plain tracker followed in one frame.
#[derive(Clone, Copy, Debug)]
struct Sight {
    track: Track,
    finding: Option<Finding>,
    slipped: bool, // the target had left the search region
}

/// What is made of a [`Sight`].
#[derive(Clone, Copy, Debug)]
struct Verdict {
    bbox: FrameBox,
    /// Smoothed presence.
    presence: f64,
    /// Presence where it counts for learning: the smoothed one lags while the target is being hidden.
    trust: f64,
    sighting: Sighting,
    jump: Jump,
}

/// What a choice out of the target's reach means.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Jump {
    /// It is within reach.
    None,
    /// It is the target, after frames in which it could hardly be seen.
    Regained,
    /// It is a similar object that crosses the target, which is the other candidate.
    Swapped(FrameBox),
    /// It is another object, and the target is behind it.
    Impossible,
}

impl FlightTracker {
    /// A tracker with the presence coefficients that the model brings.
    ///
    /// # Errors
    /// If the model's coefficients are there but wrong.
    pub fn new(model: Model, options: FlightOptions) -> Result<FlightTracker, PresenceError> {
        let presence = Presence::of(model.header())?;
        Ok(FlightTracker::with_presence(model, options, presence))
    }

    /// A tracker with other presence coefficients.
    pub fn with_presence(
        model: Model,
        options: FlightOptions,
        presence: Presence,
    ) -> FlightTracker {
        let tracker_options = TrackerOptions {
            threads: options.threads,
            cores: options.cores,
            config: options.config,
            search: SearchRegion::Full,
        };
        FlightTracker {
            tracker: Tracker::with_options(model, tracker_options),
            options,
            camera: CameraMotion::default(),
            judge: Judge::new(presence),
            search: Search::default(),
            standing: Standing::new(),
            target: None,
            score: 0.0,
            presence: 1.0,
        }
    }

    /// Takes the object within `bbox` as the target, forgetting any earlier one.
    ///
    /// # Errors
    /// As [`Tracker::init`]; the earlier target is then kept.
    pub fn init(&mut self, frame: &Frame<'_>, bbox: BBox) -> Result<(), TrackError> {
        self.tracker.init(frame, bbox)?;
        self.camera = CameraMotion::default();
        self.camera.observe(frame, None);
        self.judge.begin(frame, &bbox.center());
        self.search.reset();
        self.standing = Standing::new();
        self.target = Some(Target::new(&bbox.center()));
        self.score = 0.0;
        self.presence = 1.0;
        Ok(())
    }

    /// Finds the target in the next frame, or says that it is not there.
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn update(&mut self, frame: &Frame<'_>, budget: Budget) -> Result<FlightTrack, TrackError> {
        let mut allowance = Allowance::start(budget);
        let mut target = self.target.ok_or(TrackError::NoTarget)?;
        let motion = self.predict(frame, &mut target);
        if self.standing.state.is_seen() {
            let sight = self.observe(frame, &target)?;
            let verdict = self.judge(&sight, &target);
            self.act(frame, &sight, &verdict, &mut target);
            allowance.spend();
            if self.is_searched_beside() {
                self.search_beside(frame, &motion, &mut target, &mut allowance)?;
            }
        } else {
            self.seek(frame, &motion, &mut target, &mut allowance)?;
        }
        self.target = Some(target);
        Ok(self.report(frame, &target, allowance.spent()))
    }

    /// Carries all that is remembered into the next frame; returns how the picture moved.
    fn predict(&mut self, frame: &Frame<'_>, target: &mut Target) -> Motion {
        let motion = self.camera.observe(frame, Some(&target.motion.bbox()));
        target.predict(&motion);
        self.judge.predict(&motion);
        self.standing.tick();
        motion
    }

    /// The plain tracker's look at the frame.
    fn observe(&mut self, frame: &Frame<'_>, target: &Target) -> Result<Sight, TrackError> {
        let before = self.tracker.target_box();
        let careful = self.options.conduct != Conduct::Tell;
        let track = if careful {
            self.tracker.find(frame)?
        } else {
            self.tracker.update(frame)?
        };
        let finding = self.judge.examine(&self.tracker, frame, Some(target));
        let slipped = careful && self.tracker.has_slipped(&track);
        let wider = match before {
            Some(before) if slipped => self.look_wider(frame, before, &track, target),
            _ => None,
        };
        Ok(wider.unwrap_or(Sight {
            track,
            finding,
            slipped,
        }))
    }

    /// The plain tracker's wider look for a target that may have left the search region around where
    /// it was `before`, if what it finds looks right and the target can be there. If not, the box
    /// stays at `track`.
    fn look_wider(
        &mut self,
        frame: &Frame<'_>,
        before: FrameBox,
        track: &Track,
        target: &Target,
    ) -> Option<Sight> {
        let evidence = self.judge.evidence().copied();
        let wider = self.tracker.look_wider(frame, before)?;
        let finding = self.judge.examine(&self.tracker, frame, Some(target));
        let finding = finding.filter(|finding| {
            let appearance = self.judge.presence.again.alone(&finding.evidence);
            let is_alike =
                appearance >= self.options.present && !self.judge.is_claimed(&finding.bbox, target);
            target.can_be_at(&finding.bbox)
                && (is_alike || self.judge.belief(finding, target) >= 0.0)
        });
        if finding.is_none() {
            self.tracker.place(track.bbox.center());
            self.judge.drop_candidates();
            self.judge.restore(evidence);
        }
        finding.map(|finding| Sight {
            track: wider,
            finding: Some(finding),
            slipped: true,
        })
    }

    /// Whether what was seen is the target.
    fn judge(&mut self, sight: &Sight, target: &Target) -> Verdict {
        let mut verdict = Verdict {
            bbox: sight.track.bbox.center(),
            presence: 0.0,
            trust: 0.0,
            sighting: Sighting::Absent,
            jump: Jump::None,
        };
        let Some(finding) = &sight.finding else {
            return verdict;
        };
        let Presence { look, again, .. } = self.judge.presence;
        let mut log_odds = look.log_odds(&finding.evidence);
        if !self.standing.is_calm() {
            // Nothing has been learned since the doubt: the target may look as it does after a while.
            log_odds = log_odds.max(again.log_odds(&finding.evidence));
        }
        verdict.presence = self.judge.smooth(log_odds);
        verdict.jump = self.jump(finding, target);
        match verdict.jump {
            Jump::None | Jump::Regained => {}
            Jump::Swapped(other) => {
                verdict.bbox.cx = other.cx;
                verdict.bbox.cy = other.cy;
            }
            Jump::Impossible => verdict.presence = verdict.presence.min(self.options.absent),
        }
        verdict.trust = verdict.presence.min(look.alone(&finding.evidence));
        let recovers = self.options.conduct == Conduct::Recover;
        let is_doubtful = verdict.presence < self.options.present;
        let is_foreign = recovers && finding.evidence.colors < FOREIGN;
        verdict.sighting = if verdict.jump == Jump::Impossible {
            Sighting::Impossible
        } else if verdict.presence < self.options.absent || is_doubtful && is_foreign {
            Sighting::Absent
        } else if is_doubtful {
            Sighting::Doubtful
        } else {
            Sighting::Present
        };
        verdict
    }

    /// What a choice out of the target's reach means.
    fn jump(&self, finding: &Finding, target: &Target) -> Jump {
        let recovers = self.options.conduct == Conduct::Recover;
        if !recovers || target.can_be_at(&finding.bbox) {
            return Jump::None;
        }
        let appearance = self.judge.presence.look.alone(&finding.evidence);
        let is_regained = self.standing.state == State::LowConfidence
            && appearance >= self.options.absent
            && !self.judge.is_claimed(&finding.bbox, target);
        if is_regained {
            return Jump::Regained;
        }
        match self.judge.alternative(target) {
            Some(other) => Jump::Swapped(other),
            None => Jump::Impossible,
        }
    }

    /// Moves on to the next state, and learns what may be learned.
    fn act(&mut self, frame: &Frame<'_>, sight: &Sight, verdict: &Verdict, target: &mut Target) {
        self.score = sight.track.score;
        self.presence = verdict.presence;
        let Some(finding) = &sight.finding else {
            self.decide(Sighting::Absent, target);
            return;
        };
        match verdict.jump {
            Jump::None => {}
            Jump::Regained => target.motion = Kalman::new(&verdict.bbox),
            Jump::Swapped(_) => self.tracker.place(verdict.bbox),
            Jump::Impossible => {
                self.judge.forget_presence();
                self.decide(Sighting::Impossible, target);
                return;
            }
        }
        if verdict.trust >= self.options.absent {
            target.motion.correct(&verdict.bbox, verdict.trust);
        }
        if verdict.trust >= self.options.present {
            target.motion.resize(&verdict.bbox);
        }
        if self.is_refuted(finding, &verdict.bbox, target) {
            return;
        }
        let sure = verdict.trust >= self.options.sure;
        self.judge.recognize(target, sure);
        target.drop_anchor(sure);
        let ends_doubt = self.standing.count(verdict.presence >= f64::from(BELIEVED));
        if ends_doubt {
            self.search.give_up();
        }
        self.decide(verdict.sighting, target);
        if verdict.sighting == Sighting::Present {
            self.learn(frame, sight, verdict, finding, target);
        }
    }

    /// Takes the last re-acquisition back if what was found moves as the target never would have;
    /// returns whether it does.
    fn is_refuted(&mut self, finding: &Finding, bbox: &FrameBox, target: &mut Target) -> bool {
        let Some(before) = target.on_probation() else {
            return false;
        };
        let appearance = self.judge.presence.again.log_odds(&finding.evidence);
        let refuted = appearance + before.log_ratio(bbox) < REFUTED;
        if refuted {
            self.judge.rivals.meet(bbox);
            self.decide(Sighting::Impossible, target);
            target.take_back(before);
        }
        refuted
    }

    /// Learns the appearance of a target that is present.
    fn learn(
        &mut self,
        frame: &Frame<'_>,
        sight: &Sight,
        verdict: &Verdict,
        finding: &Finding,
        target: &Target,
    ) {
        if self.standing.is_calm() {
            // Light and looks change: a target that is only likely counts, too, but less.
            let trust = (2.0 * verdict.trust - 1.0).max(0.0) as f32;
            self.judge.colors.learn(frame, &verdict.bbox, trust);
            if !sight.slipped {
                self.judge.learn(&finding.evidence, verdict.trust);
            }
        }
        let careful = self.options.conduct != Conduct::Tell;
        let in_place = verdict.jump == Jump::None && !sight.slipped;
        if careful && in_place && !target.is_on_probation() {
            self.tracker.learn();
        }
    }

    /// Moves on to the next state. Whoever starts to coast goes back to the motion of the last sure
    /// frame.
    fn decide(&mut self, sighting: Sighting, target: &mut Target) {
        let recovers = self.options.conduct == Conduct::Recover;
        let limits = Limits {
            patience: recovers.then_some(self.options.patience),
            coast: self.options.coast,
            fresh: FRESH,
        };
        let changes = self.standing.note(sighting, &limits);
        if changes && self.standing.state == State::Coasting {
            *target = target.anchored();
            self.search.give_up();
        }
    }

    /// Searches for a target that is not seen: where it should be, then wherever it may be.
    fn seek(
        &mut self,
        frame: &Frame<'_>,
        motion: &Motion,
        target: &mut Target,
        allowance: &mut Allowance,
    ) -> Result<(), TrackError> {
        target.motion.coast();
        target.motion.bound(frame.width(), frame.height());
        self.decide(Sighting::Unseen, target);
        self.search.predict(motion);
        let outcome = self.search(frame, target, allowance)?;
        if let Some(finding) = &outcome.ahead {
            let log_odds = self.judge.presence.look.log_odds(&finding.evidence);
            self.score = finding.score;
            self.presence = self.judge.smooth(log_odds).min(self.options.present);
        }
        self.take_over(&outcome, target);
        Ok(())
    }

    /// Whether what is followed is doubted so much that the target is searched for elsewhere.
    fn is_searched_beside(&self) -> bool {
        self.options.conduct == Conduct::Recover
            && self.standing.state == State::LowConfidence
            && self.standing.is_doubted()
    }

    /// Searches for the target where it should be since it was last surely seen, while the tracker
    /// keeps following what is doubted.
    fn search_beside(
        &mut self,
        frame: &Frame<'_>,
        motion: &Motion,
        target: &mut Target,
        allowance: &mut Allowance,
    ) -> Result<(), TrackError> {
        self.search.predict(motion);
        let followed = self.tracker.target_box();
        let evidence = self.judge.evidence().copied();
        let anchored = target.anchored();
        let outcome = self.search(frame, &anchored, allowance)?;
        if outcome.found.is_some() {
            *target = anchored;
            self.take_over(&outcome, target);
            return Ok(());
        }
        self.judge.restore(evidence);
        if let Some(bbox) = followed {
            self.tracker.place(bbox);
        }
        Ok(())
    }

    fn search(
        &mut self,
        frame: &Frame<'_>,
        target: &Target,
        allowance: &mut Allowance,
    ) -> Result<Outcome, TrackError> {
        let mut means = Means {
            tracker: &mut self.tracker,
            judge: &mut self.judge,
            options: &self.options,
            frame,
            target,
            standing: &self.standing,
        };
        self.search.run(&mut means, allowance)
    }

    /// Follows what a search found from this frame on.
    fn take_over(&mut self, outcome: &Outcome, target: &mut Target) {
        let Some((bbox, finding)) = &outcome.found else {
            return;
        };
        *target = target.found(bbox);
        self.judge.forget_presence();
        let log_odds = self.judge.presence.look.log_odds(&finding.evidence);
        self.presence = self.judge.smooth(log_odds);
        self.score = finding.score;
        self.decide(Sighting::Found, target);
        self.search.give_up();
    }

    /// The frame's result: the tracker's box if the target is seen, the predicted one if not.
    fn report(&self, frame: &Frame<'_>, target: &Target, searches: u32) -> FlightTrack {
        let state = self.standing.state;
        let bbox = match self.tracker.target_box() {
            Some(bbox) if state.is_seen() => bbox,
            _ => self.predicted(frame, target),
        };
        FlightTrack {
            bbox: bbox.corner(),
            score: self.score,
            presence: self.presence as f32,
            state,
            searches,
        }
    }

    /// Where the target should be, within the frame.
    fn predicted(&self, frame: &Frame<'_>, target: &Target) -> FrameBox {
        let min_size = self.options.config.min_size;
        target
            .motion
            .bbox()
            .clamped(frame.width(), frame.height(), min_size)
    }

    /// Looks at one place without any consequence, for calibration: the box found there and what
    /// speaks for it; `None` if the network gave no usable number.
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn examine(
        &mut self,
        frame: &Frame<'_>,
        around: BBox,
    ) -> Result<Option<(BBox, Evidence)>, TrackError> {
        self.tracker.look(frame, around.center(), 1.0, 0.0)?;
        let finding = self.judge.examine(&self.tracker, frame, None);
        Ok(finding.map(|finding| (finding.bbox.corner(), finding.evidence)))
    }

    /// Looks as [`examine`](Self::examine) does, in the way in which a lost target is searched for:
    /// at the size last seen around (`cx`, `cy`), then at the place and size found there.
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn examine_twice(
        &mut self,
        frame: &Frame<'_>,
        (cx, cy): (f32, f32),
    ) -> Result<Option<(BBox, Evidence)>, TrackError> {
        let target = self.target.ok_or(TrackError::NoTarget)?;
        let last = self.predicted(frame, &target);
        let Some((found, _)) = self.examine(frame, FrameBox { cx, cy, ..last }.corner())? else {
            return Ok(None);
        };
        let found = search::resized(&found.center(), &last);
        self.examine(frame, found.corner())
    }

    /// What spoke for the last box that was judged.
    pub fn evidence(&self) -> Option<&Evidence> {
        self.judge.evidence()
    }

    /// The places that the last search found, the chosen one first.
    pub fn candidates(&self) -> &[Candidate] {
        self.judge.candidates()
    }

    /// The state of the last frame.
    pub fn state(&self) -> State {
        self.standing.state
    }

    /// Whether there is a target.
    pub fn has_target(&self) -> bool {
        self.target.is_some()
    }

    /// Forgets the target: [`update`](Self::update) fails until the next [`init`](Self::init).
    pub fn stop(&mut self) {
        self.target = None;
    }

    /// The plain tracker inside.
    pub fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// The presence coefficients in use.
    pub fn presence(&self) -> &Presence {
        &self.judge.presence
    }
}
