//! Tracking in flight: knows when the target is lost, coasts through occlusions, finds it again.
//!
//! [`FlightTracker`] wraps the plain [`Tracker`]. While the target is surely there its boxes are
//! that tracker's, bit for bit; every box comes with a `presence`, the calibrated probability that
//! it is on the target. A frame takes five steps: predict, observe, judge, decide, act.
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
mod texture;

use std::time::Duration;

use crate::bbox::{BBox, FrameBox};
use crate::error::TrackError;
use crate::frame::Frame;
use crate::model::Model;
use crate::tracker::{Extent, Position, SearchRegion, Track, Tracker, TrackerOptions};
use camera::{CameraMotion, Motion};
use evidence::Finding;
use judge::Judge;
use search::{Allowance, Means, Outcome, Search};
use state::{Limits, Sighting, Standing};
use target::Target;

pub use candidates::{Candidate, MAX_CANDIDATES};
pub use evidence::{COUNT as EVIDENCE_COUNT, Evidence, NAMES as EVIDENCE_NAMES};
use options::USUAL_RATE;
pub use options::{
    BELIEVED, Budget, Conduct, FRAME_RATES, FlightOptions, FlightTrack, ThresholdError,
    check_threshold,
};
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
    nothing: bool, // the last frame showed nothing where the target should be
    score: f32,    // of the last frame
    presence: f64, // of the last frame
}

/// Seconds of [`State::Reacquired`] before [`State::Tracking`].
const FRESH: f64 = 0.33;
/// Log-odds below which a re-acquisition is taken back.
const REFUTED: f64 = -2.0;
/// Least presence at which the plain tracker learns. It must not learn an occluder, but must learn
/// a target that is merely likely, or it would track worse than on its own.
const LEARNED_FROM: f64 = 0.4;
/// Score below which a look at the target's place is empty, if the filter agrees.
const EMPTY_SCORE: f64 = 0.3;
/// Response of the filter below which it agrees.
const EMPTY_RESPONSE: f64 = 0.3;
/// Log-odds by which another place must look more like the target than the followed box.
const BETTER: f64 = 1.0;
/// Shortest and longest time from frame to frame that counts, in seconds.
const ELAPSED: (f64, f64) = (1.0 / 240.0, 1.0);

/// What the plain tracker followed in one frame.
#[derive(Clone, Copy, Debug)]
struct Sight {
    before: Option<Position>, // where the target was
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
    /// Presence where it counts for learning: the smoothed one lags while the target is being
    /// hidden.
    trust: f64,
    sighting: Sighting,
    /// Whether the picture shows nothing at all.
    nothing: bool,
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
            nothing: false,
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
        self.target = Some(Target::new(&bbox.center(), frame));
        self.nothing = false;
        self.score = 0.0;
        self.presence = 1.0;
        Ok(())
    }

    /// Finds the target in the next frame, or says that it is not there. The frame comes at the
    /// rate of the options.
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn update(&mut self, frame: &Frame<'_>, budget: Budget) -> Result<FlightTrack, TrackError> {
        // A rate that is no number must not panic below.
        let fps = Some(self.options.fps).filter(|fps| !fps.is_nan());
        let elapsed = 1.0 / fps.unwrap_or(USUAL_RATE).clamp(1.0, 1000.0);
        self.update_after(Duration::from_secs_f64(elapsed), frame, budget)
    }

    /// Finds the target in a frame that was taken `elapsed` after the last one.
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn update_after(
        &mut self,
        elapsed: Duration,
        frame: &Frame<'_>,
        budget: Budget,
    ) -> Result<FlightTrack, TrackError> {
        let mut allowance = Allowance::start(budget);
        let mut target = self.target.ok_or(TrackError::NoTarget)?;
        self.predict(elapsed, frame, &mut target);
        if self.standing.state.is_seen() {
            let sight = self.observe(frame, &target)?;
            let verdict = self.judge(&sight);
            self.act(frame, &sight, &verdict, &mut target);
            allowance.spend();
            if self.is_searched_beside() {
                self.search_beside(frame, &mut target, &mut allowance)?;
            }
        } else {
            self.seek(frame, &mut target, &mut allowance)?;
        }
        self.target = Some(target);
        Ok(self.report(frame, &target, allowance.spent()))
    }

    /// Carries all that is remembered into the next frame.
    fn predict(&mut self, elapsed: Duration, frame: &Frame<'_>, target: &mut Target) {
        let dt = elapsed.as_secs_f64().clamp(ELAPSED.0, ELAPSED.1);
        let resized = self.tracker.adapt_to(frame).is_some_and(|c| c.from != c.to);
        if resized && let Some(position) = self.tracker.position() {
            // Nothing else that is remembered holds in other pixels.
            *target = Target::new(&position.shown, frame);
            self.judge.rivals.clear();
            self.search.give_up();
        }
        let mut motion = self.camera.observe(frame, Some(&target.motion.bbox()));
        if self.nothing {
            motion = Motion::default(); // the estimate rests on noise
        }
        target.predict(&motion, dt);
        self.judge.predict(&motion, dt, self.camera.is_noise());
        self.search.predict(&motion, dt);
        self.standing.tick(dt);
    }

    /// The plain tracker's look at the frame, and its wider look if the target may have left the
    /// search region.
    fn observe(&mut self, frame: &Frame<'_>, target: &Target) -> Result<Sight, TrackError> {
        let before = self.tracker.position();
        let track = self.tracker.find(frame)?;
        let mut sight = Sight {
            before,
            track,
            finding: self.judge.examine(&self.tracker, frame, Some(target)),
            slipped: self.tracker.has_slipped(&track),
        };
        if let Some(before) = before.filter(|_| sight.slipped)
            && let Some(wider) = self.tracker.look_wider(frame, before)
        {
            sight.track = wider;
            sight.finding = self.judge.examine(&self.tracker, frame, Some(target));
        }
        Ok(sight)
    }

    /// Whether what was seen is the target.
    fn judge(&mut self, sight: &Sight) -> Verdict {
        let mut verdict = Verdict {
            bbox: sight.track.bbox.center(),
            presence: 0.0,
            trust: 0.0,
            sighting: Sighting::Absent,
            nothing: true,
        };
        let Some(finding) = &sight.finding else {
            return verdict;
        };
        let look = self.judge.look_odds(finding);
        verdict.nothing = self.judge.is_nothing(finding);
        verdict.presence = self.judge.smooth(look, self.standing.dt);
        verdict.trust = verdict.presence.min(presence::sigmoid(look));
        let is_empty = verdict.nothing
            || f64::from(sight.track.score) < EMPTY_SCORE
                && finding.evidence.response < EMPTY_RESPONSE;
        verdict.sighting = if verdict.presence < self.options.absent && is_empty {
            Sighting::Absent
        } else if verdict.presence < self.options.present {
            Sighting::Doubtful
        } else {
            Sighting::Present
        };
        verdict
    }

    /// Moves on to the next state, and learns what may be learned.
    fn act(&mut self, frame: &Frame<'_>, sight: &Sight, verdict: &Verdict, target: &mut Target) {
        self.score = sight.track.score;
        self.presence = verdict.presence;
        self.nothing = verdict.nothing;
        if verdict.nothing
            && let Some(before) = sight.before
        {
            self.tracker.restore(before);
            target.motion.move_to(&before.shown);
        }
        if verdict.trust >= self.options.absent {
            target.motion.correct(&verdict.bbox, verdict.trust);
        }
        if verdict.trust >= self.options.present {
            target.motion.resize(&verdict.bbox);
        }
        if let Some(finding) = &sight.finding
            && self.takes_back(finding, verdict, target)
        {
            return;
        }
        let sure = verdict.trust >= self.options.sure;
        self.judge.recognize(target, sure);
        target.drop_anchor(sure);
        let is_believed = verdict.presence >= f64::from(BELIEVED);
        if self.standing.count_belief(is_believed) {
            self.search.give_up();
        }
        self.decide(verdict.sighting, target);
        self.learn(frame, sight, verdict, target);
    }

    /// Takes the last re-acquisition back if what was found is doubted and moves as the target
    /// never would have; returns whether it does. One frame's odd motion alone refutes nothing.
    fn takes_back(&mut self, finding: &Finding, verdict: &Verdict, target: &mut Target) -> bool {
        let Some(before) = target.on_probation() else {
            return false;
        };
        let bbox = &verdict.bbox;
        let log_odds = self.judge.again_odds(finding) + before.log_ratio(bbox);
        let refuted = verdict.presence < f64::from(BELIEVED) && log_odds < REFUTED;
        if refuted {
            self.judge.rivals.meet(bbox);
            self.decide(Sighting::Impossible, target);
            target.take_back(before);
        }
        refuted
    }

    /// Learns the target's appearance.
    ///
    /// The plain tracker learns unless the target is disbelieved, on probation or not to be seen.
    /// What presence rests on is learned only from a target that is surely seen.
    fn learn(&mut self, frame: &Frame<'_>, sight: &Sight, verdict: &Verdict, target: &Target) {
        let is_present = verdict.sighting == Sighting::Present;
        if let Some(finding) = sight.finding.filter(|_| is_present)
            && self.standing.is_calm()
        {
            let dt = self.standing.dt;
            // Light and looks change: a target that is only likely counts, too, but less.
            let trust = (2.0 * verdict.trust - 1.0).max(0.0) as f32;
            self.judge.colors.learn(frame, &verdict.bbox, trust, dt);
            if !sight.slipped {
                self.judge.learn(&finding.evidence, verdict.trust, dt);
            }
        }
        let tells = self.options.conduct == Conduct::Tell;
        let may_learn = verdict.trust >= LEARNED_FROM && !target.is_on_probation();
        if !sight.slipped && !verdict.nothing && (tells || may_learn) {
            self.tracker.learn();
        }
    }

    /// Moves on to the next state. Coasting starts where the target should be by its motion when it
    /// was last surely seen: the boxes since have followed what hides it. In a picture of nothing
    /// they have followed nothing, and stay.
    fn decide(&mut self, sighting: Sighting, target: &mut Target) {
        let recovers = self.options.conduct == Conduct::Recover;
        let limits = Limits {
            patience: recovers.then_some(self.options.patience),
            coast: self.options.coast,
            fresh: FRESH,
        };
        let changes = self.standing.advance(sighting, &limits);
        if changes && self.standing.state == State::Coasting {
            if !self.nothing {
                *target = target.anchored();
            }
            self.search.give_up();
        }
    }

    /// Searches for a target that is not seen: where it should be, then wherever it may be.
    fn seek(
        &mut self,
        frame: &Frame<'_>,
        target: &mut Target,
        allowance: &mut Allowance,
    ) -> Result<(), TrackError> {
        target.motion.coast(self.standing.dt);
        target.motion.bound(frame.width(), frame.height());
        self.decide(Sighting::Unseen, target);
        let outcome = self.search(frame, target, allowance)?;
        if let Some(finding) = &outcome.ahead {
            let log_odds = self.judge.look_odds(finding);
            let presence = self.judge.smooth(log_odds, self.standing.dt);
            self.nothing = self.judge.is_nothing(finding);
            self.score = finding.score;
            self.presence = presence.min(self.options.present);
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
    /// keeps following what is doubted. Only a place that looks clearly better is taken instead.
    fn search_beside(
        &mut self,
        frame: &Frame<'_>,
        target: &mut Target,
        allowance: &mut Allowance,
    ) -> Result<(), TrackError> {
        let followed = self.tracker.position();
        let evidence = self.judge.evidence().copied();
        let anchored = target.anchored();
        let outcome = self.search(frame, &anchored, allowance)?;
        let again = self.judge.presence.again;
        let odds = evidence.map_or(f64::NEG_INFINITY, |evidence| again.log_odds(&evidence));
        let is_better = outcome
            .found
            .is_some_and(|(_, finding)| self.judge.again_odds(&finding) >= odds + BETTER);
        if is_better {
            *target = anchored;
            self.take_over(&outcome, target);
            return Ok(());
        }
        self.judge.restore(evidence);
        if let Some(position) = followed {
            self.tracker.restore(position);
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
        let log_odds = self.judge.look_odds(finding);
        self.presence = self.judge.smooth(log_odds, self.standing.dt);
        self.score = finding.score;
        self.decide(Sighting::Found, target);
        self.search.give_up();
    }

    /// The frame's result: the tracker's box if the target is seen, the predicted one if not.
    fn report(&self, frame: &Frame<'_>, target: &Target, searches: u32) -> FlightTrack {
        let state = self.standing.state;
        let bbox = match self.tracker.position() {
            Some(position) if state.is_seen() => position.shown,
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
        self.tracker.clamped(frame, &target.motion.bbox())
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
        self.tracker
            .look(frame, around.center(), Extent::Full, 1.0, 0.0)?;
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

    /// Log-odds of a box by its place alone, and whether a search would consider it; `None` without
    /// a target.
    pub fn place_odds(&self, bbox: BBox) -> Option<(f64, bool)> {
        let target = self.target?;
        let bbox = bbox.center();
        Some((target.motion.log_ratio(&bbox), target.can_be_at(&bbox)))
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
