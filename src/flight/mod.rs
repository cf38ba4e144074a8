//! Tracking in flight: knows when the target is lost, coasts through occlusions and finds the target again.
//!
//! [`FlightTracker`] wraps the paper's [`Tracker`]. As long as the target is surely there its boxes are
//! that tracker's, bit for bit; every box comes with a `presence`, the calibrated probability that it is on the target.
//!
//! | file | what happens there |
//! |---|---|
//! | `mod.rs` | a frame in each state: start at [`FlightTracker::update`] |
//! | `search.rs` | where a lost target is looked for, and when it is taken as found |
//! | `options.rs` | options, states, results |
//! | `evidence.rs`, `candidates.rs` | what the last search says about its choice and about other places |
//! | `presence.rs` | evidence -> probability; coefficients travel with the weights |
//! | `rivals.rs` | objects seen beside the target, which are not it |
//! | `camera.rs`, `kalman.rs` | where the target should be: the picture's motion and the target's own |
//! | `sweep.rs`, `colors.rs` | in which order the frame is searched for a lost target |

mod camera;
mod candidates;
mod colors;
mod evidence;
mod kalman;
mod options;
mod presence;
mod rivals;
mod search;
mod sweep;

use std::time::{Duration, Instant};

use crate::bbox::{BBox, CenterBox};
use crate::error::TrackError;
use crate::frame::Frame;
use crate::model::Model;
use crate::tracker::{SearchRegion, Track, Tracker, TrackerOptions};
use camera::CameraMotion;
use colors::Colors;
use evidence::{Finding, Witness};
use kalman::Kalman;
use presence::Smoothed;
use rivals::Rivals;
use search::Tentative;
use sweep::Sweep;

pub use candidates::{Candidate, MAX_CANDIDATES};
pub use evidence::{COUNT as EVIDENCE_COUNT, Evidence, NAMES as EVIDENCE_NAMES};
pub use options::{BELIEVED, Budget, Conduct, FlightOptions, FlightTrack, State};
pub use presence::{NOTE as PRESENCE_NOTE, Presence, PresenceError, Weighing};

/// Follows one object and says whether it is there.
#[derive(Debug)]
pub struct FlightTracker {
    tracker: Tracker,
    options: FlightOptions,
    presence: Presence,
    witness: Witness,
    rivals: Rivals,
    camera: CameraMotion,
    smoothed: Smoothed,
    kalman: Option<Kalman>,
    anchor: Option<Kalman>, // as it was when the target was surely seen, predicted since
    probation: Option<(Kalman, u32)>, // of the last re-acquisition: what was looked for, as predicted since; age in frames
    next_anchor: Option<(Kalman, u32)>, // becomes the anchor if the target stays surely seen; age in frames
    state: State,
    frames_in_state: u32,
    faint: u32,   // frames in a row below `absent`, or of other colors
    doubted: u32, // frames in a row that are not believed
    calm: u32, // frames since the last that was not believed, or since the target was found again
    score: f32,
    probability: f64,
    tentative: Option<Tentative>,
    leads: Vec<(f64, CenterBox)>, // places that deserve a closer look, best last: log-odds and box
    closer_look: bool,            // the next free search is one
    sweep: Sweep,
    colors: Colors,
    by_colors: bool,                // the next look elsewhere is where the colors are
    visited: Vec<(CenterBox, u32)>, // places looked at lately; age in frames
    search_cost: Duration,
    evidence: Option<Evidence>,
}

/// Frames that the target must stay surely seen before its motion is remembered.
const ANCHOR_AGE: u32 = 4;
/// Frames of [`State::Reacquired`] before [`State::Tracking`].
const FRESH: u32 = 10;
/// Frames after the last doubt before looks are learned again: what came out from behind something may be another object.
const CALM: u32 = 45;
/// Frames in a row that are not believed before the target is looked for elsewhere as well.
const DOUBTED: u32 = 15;
/// Frames during which a re-acquisition may be taken back,
const PROBATION: u32 = 30;
/// and log-odds below which it is.
const REFUTED: f64 = -2.0;
/// What is likelier not the target and has less of its colors than this is another object.
const FOREIGN: f64 = 0.7;
/// A rival must have this share of the chosen box's score to be taken in its place,
const RIVAL_SCORE: f32 = 0.5;
/// and fall behind its similarity by no more than this.
const RIVAL_SIMILARITY: f32 = 0.1;

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
        let FlightOptions {
            threads,
            cores,
            config,
            ..
        } = options;
        let tracker_options = TrackerOptions {
            threads,
            cores,
            config,
            search: SearchRegion::Full,
        };
        FlightTracker {
            tracker: Tracker::with_options(model, tracker_options),
            options,
            presence,
            witness: Witness::default(),
            rivals: Rivals::default(),
            camera: CameraMotion::default(),
            smoothed: Smoothed::default(),
            kalman: None,
            anchor: None,
            probation: None,
            next_anchor: None,
            state: State::Tracking,
            frames_in_state: 0,
            faint: 0,
            doubted: 0,
            calm: CALM,
            score: 0.0,
            probability: 1.0,
            tentative: None,
            leads: Vec::new(),
            closer_look: false,
            sweep: Sweep::default(),
            colors: Colors::default(),
            by_colors: false,
            visited: Vec::new(),
            search_cost: Duration::from_millis(20),
            evidence: None,
        }
    }

    /// Takes the object within `bbox` as the target, forgetting any earlier one.
    ///
    /// # Errors
    /// As [`Tracker::init`]; the earlier target is then kept.
    pub fn init(&mut self, frame: &Frame<'_>, bbox: BBox) -> Result<(), TrackError> {
        self.tracker.init(frame, bbox)?;
        self.witness.reset();
        self.rivals.clear();
        self.colors.clear();
        self.colors.learn(frame, &bbox.center(), 1.0);
        self.camera = CameraMotion::default();
        self.camera.observe(frame, None);
        self.smoothed = Smoothed::default();
        self.kalman = Some(Kalman::new(&bbox.center()));
        (self.anchor, self.next_anchor, self.probation) = (self.kalman, None, None);
        self.enter(State::Tracking);
        (self.faint, self.doubted, self.calm) = (0, 0, CALM);
        (self.score, self.probability, self.evidence) = (0.0, 1.0, None);
        (self.closer_look, self.by_colors) = (false, false);
        self.give_up_search();
        Ok(())
    }

    /// Finds the target in the next frame, or says that it is not there.
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn update(&mut self, frame: &Frame<'_>, budget: Budget) -> Result<FlightTrack, TrackError> {
        let started = Instant::now();
        let mut kalman = self.kalman.ok_or(TrackError::NoTarget)?;
        let motion = self.camera.observe(frame, Some(&kalman.bbox()));
        kalman.predict(&motion);
        self.kalman = Some(kalman);
        self.rivals.predict(&motion);
        let aged = self
            .next_anchor
            .iter_mut()
            .chain(&mut self.probation)
            .map(|(kalman, _)| kalman);
        self.anchor
            .iter_mut()
            .chain(aged)
            .for_each(|kalman| kalman.predict(&motion));
        self.frames_in_state = self.frames_in_state.saturating_add(1);
        let searches = if self.state.is_seen() {
            self.follow(frame)?;
            let doubted = self.state == State::LowConfidence && self.doubted >= DOUBTED;
            if doubted && self.options.conduct == Conduct::Recover {
                self.look_beside(frame, &motion, budget, started)?
            } else {
                1
            }
        } else {
            self.seek(frame, &motion, budget, started)?
        };
        let bbox = match (self.state.is_seen(), self.tracker.target_box()) {
            (true, Some(bbox)) => bbox,
            _ => self.predicted(frame),
        };
        let (score, presence) = (self.score, self.probability as f32);
        Ok(FlightTrack {
            bbox: bbox.corner(),
            score,
            presence,
            state: self.state,
            searches,
        })
    }

    /// The paper's tracker, watched.
    fn follow(&mut self, frame: &Frame<'_>) -> Result<(), TrackError> {
        let (recover, careful) = (
            self.options.conduct == Conduct::Recover,
            self.options.conduct != Conduct::Tell,
        );
        let before = self.tracker.target_box();
        let mut track = if careful {
            self.tracker.find(frame)
        } else {
            self.tracker.update(frame)
        }?;
        let mut finding = self.judge(frame, true);
        let slipped = careful && self.tracker.has_slipped(&track);
        if slipped && let Some((wider, there)) = self.look_wider(frame, before, &track) {
            (track, finding) = (wider, Some(there));
        }
        self.score = track.score;
        let Some(finding) = finding else {
            self.probability = 0.0;
            self.doubt();
            return Ok(());
        };
        let mut odds = self.presence.look.log_odds(&finding.evidence);
        if self.calm < CALM {
            // Nothing has been learned since the doubt: it may look as it does after a while.
            odds = odds.max(self.presence.again.log_odds(&finding.evidence));
        }
        self.probability = self.smoothed.add(&self.presence, odds);
        let mut bbox = track.bbox.center();
        let jumped = recover && !self.is_within_reach(&finding.bbox);
        if jumped && self.is_regained(&finding) {
            self.kalman = Some(Kalman::new(&bbox));
        } else if jumped {
            // Too far in one frame: another object, or the target behind one.
            let Some(other) = self.rival() else {
                self.probability = self.probability.min(self.options.absent);
                self.smoothed = Smoothed::default();
                self.enter(State::Coasting);
                return Ok(());
            };
            bbox = CenterBox {
                cx: other.cx,
                cy: other.cy,
                ..bbox
            };
            self.tracker.place(bbox);
        }
        // The smoothed presence lags where the target is just being hidden.
        let probability = self
            .probability
            .min(self.presence.look.alone(&finding.evidence));
        if let Some(kalman) = &mut self.kalman {
            if probability >= self.options.absent {
                kalman.correct(&bbox, probability);
            }
            if probability >= self.options.present {
                kalman.resize(&bbox);
            }
        }
        if self.take_back(&bbox, &finding) {
            return Ok(());
        }
        let sure = probability >= self.options.sure;
        self.recognize(sure);
        self.drop_anchor(sure);
        let foreign =
            self.probability < self.options.present && finding.evidence.colors() < FOREIGN;
        if self.probability >= f64::from(BELIEVED) {
            if self.doubted >= DOUBTED {
                self.give_up_search();
            }
            (self.doubted, self.calm) = (0, self.calm.saturating_add(1));
        } else {
            (self.doubted, self.calm) = (self.doubted.saturating_add(1), 0);
        }
        if self.probability < self.options.absent || recover && foreign {
            self.doubt();
            return Ok(());
        }
        self.faint = 0;
        if self.probability < self.options.present {
            self.enter(State::LowConfidence);
            return Ok(());
        }
        if self.calm >= CALM {
            // Light and looks change: what is only likely the target counts, too, but less.
            self.colors
                .learn(frame, &bbox, (2.0 * probability - 1.0).max(0.0) as f32);
            if !slipped {
                self.witness.learn(&finding.evidence, probability);
            }
        }
        if careful && !slipped && !jumped && self.probation.is_none() {
            self.tracker.learn();
        }
        if self.state != State::Reacquired || self.frames_in_state >= FRESH {
            self.enter(State::Tracking);
        }
        Ok(())
    }

    /// The paper's tracker's wider look for a target that may have moved out of the search region, from where it was `before`: what it found, if
    /// that looks right and the target can be there. If not, the box stays at `track`.
    fn look_wider(
        &mut self,
        frame: &Frame<'_>,
        before: Option<CenterBox>,
        track: &Track,
    ) -> Option<(Track, Finding)> {
        let evidence = self.evidence;
        let wider = self.tracker.look_wider(frame, before?)?;
        let finding = self.judge(frame, true).filter(|finding| {
            let alike = self.presence.again.alone(&finding.evidence) >= self.options.present
                && !self.rivals.claim(&finding.bbox, self.away(&finding.bbox));
            self.is_within_reach(&finding.bbox) && (alike || self.belief(finding) >= 0.0)
        });
        if finding.is_none() {
            self.tracker.place(track.bbox.center());
            self.witness.candidates.clear(); // of the wider look
            self.evidence = evidence;
        }
        finding.map(|finding| (wider, finding))
    }

    /// Takes the last re-acquisition back if what was found moves as the target never would have; `true` if so.
    fn take_back(&mut self, bbox: &CenterBox, finding: &Finding) -> bool {
        let Some((before, age)) = self.probation else {
            return false;
        };
        self.probation = (age < PROBATION).then_some((before, age + 1));
        let refuted =
            self.presence.again.log_odds(&finding.evidence) + before.log_ratio(bbox) < REFUTED;
        if refuted {
            self.rivals.meet(bbox);
            self.enter(State::Coasting);
            (self.kalman, self.anchor, self.probation) = (Some(before), Some(before), None);
        }
        refuted
    }

    /// Remembers the motion from a while before the last frame in which the target was surely seen: in those just before it
    /// hides, the box is already drawn toward what hides it.
    fn drop_anchor(&mut self, sure: bool) {
        let Some(kalman) = self.kalman else { return };
        self.next_anchor = match self.next_anchor {
            _ if !sure => None,
            None => Some((kalman, 0)),
            Some((aged, ANCHOR_AGE)) => {
                self.anchor = Some(aged);
                Some((kalman, 0))
            }
            Some((aged, age)) => Some((aged, age + 1)),
        };
    }

    /// One more frame without the target: in the end the box is given up.
    fn doubt(&mut self) {
        self.faint += 1;
        if self.options.conduct == Conduct::Recover && self.faint >= self.options.patience {
            self.enter(State::Coasting);
        } else {
            self.enter(State::LowConfidence);
        }
    }

    /// The best other candidate where the target can be, if one looks as much like it as the chosen one: two similar
    /// objects that cross.
    fn rival(&self) -> Option<CenterBox> {
        let (chosen, others) = self.witness.candidates.split_first()?;
        let alike = |c: &&Candidate| {
            c.score >= RIVAL_SCORE * chosen.score
                && c.similarity >= chosen.similarity - RIVAL_SIMILARITY
        };
        let near = others
            .iter()
            .filter(alike)
            .filter(|c| self.is_within_reach(&c.bbox.center()));
        near.max_by(|a, b| a.score.total_cmp(&b.score))
            .map(|c| c.bbox.center())
    }

    /// Whether a box that jumped is on the target once more, after frames in which it could hardly be seen.
    fn is_regained(&self, finding: &Finding) -> bool {
        self.state == State::LowConfidence
            && self.presence.look.alone(&finding.evidence) >= self.options.absent
            && !self.rivals.claim(&finding.bbox, self.away(&finding.bbox))
    }

    /// Distance from where the target should be, in its sides.
    fn away(&self, bbox: &CenterBox) -> f64 {
        self.kalman.map_or(0.0, |kalman| kalman.distance(bbox))
    }

    /// Whether the target can be there, for all that is known of its motion.
    fn is_within_reach(&self, bbox: &CenterBox) -> bool {
        self.kalman
            .is_none_or(|kalman| kalman.distance(bbox) <= kalman.gate())
    }

    /// Looks for known rivals among the last search's candidates, and for new ones where the target was surely `seen`.
    fn recognize(&mut self, seen: bool) {
        if let Some(kalman) = &self.kalman {
            self.rivals.observe(&self.witness.candidates, kalman, seen);
        }
    }

    /// What speaks for the choice of the last search, which looked at `frame`; by its motion as well if the target was `expected` there.
    fn judge(&mut self, frame: &Frame<'_>, expected: bool) -> Option<Finding> {
        let kalman = self.kalman.filter(|_| expected);
        let distance = |bbox: &CenterBox| kalman.map_or(0.0, |kalman| kalman.distance(bbox));
        let tracker = &self.tracker;
        let finding = self.witness.judge(
            tracker.network(),
            tracker.selector(),
            tracker.response(),
            tracker.seen()?,
            distance,
            |bbox| self.colors.likeness(frame, bbox),
        );
        self.evidence = finding.map(|finding| finding.evidence);
        finding
    }

    fn enter(&mut self, state: State) {
        if state != self.state {
            (self.state, self.frames_in_state) = (state, 0);
            if state == State::Coasting {
                // What was half seen since may have been what hides the target.
                self.kalman = self.anchor;
                self.give_up_search();
            }
        }
    }

    fn give_up_search(&mut self) {
        self.tentative = None;
        self.leads.clear();
        self.sweep.clear();
        self.visited.clear();
    }

    /// Where the target should be, as far as that is in the frame.
    fn predicted(&self, frame: &Frame<'_>) -> CenterBox {
        let bbox = self
            .kalman
            .map_or_else(CenterBox::default, |kalman| kalman.bbox());
        bbox.clamped(frame.width(), frame.height(), self.options.config.min_size)
    }

    /// Looks at one place without any consequence: the box found there and what speaks for it; `None` if the network
    /// gave no usable number. For calibration.
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn examine(
        &mut self,
        frame: &Frame<'_>,
        around: BBox,
    ) -> Result<Option<(BBox, Evidence)>, TrackError> {
        self.tracker.look(frame, around.center(), 1.0, 0.0)?;
        Ok(self
            .judge(frame, false)
            .map(|finding| (finding.bbox.corner(), finding.evidence)))
    }

    /// As [`examine`](Self::examine), but as a lost target is looked for: at the size last seen around (`cx`, `cy`), then once more at the place
    /// and size found there.
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn examine_twice(
        &mut self,
        frame: &Frame<'_>,
        (cx, cy): (f32, f32),
    ) -> Result<Option<(BBox, Evidence)>, TrackError> {
        let last = self.predicted(frame);
        let first = self.examine(frame, CenterBox { cx, cy, ..last }.corner())?;
        first.map_or(Ok(None), |(found, _)| {
            self.examine(frame, search::resized(&found.center(), &last).corner())
        })
    }

    /// What spoke for the last box that was judged.
    pub fn evidence(&self) -> Option<&Evidence> {
        self.evidence.as_ref()
    }

    /// The places that the last search found, the chosen one first.
    pub fn candidates(&self) -> &[Candidate] {
        &self.witness.candidates
    }

    /// The state of the last frame.
    pub fn state(&self) -> State {
        self.state
    }

    /// Whether there is a target.
    pub fn has_target(&self) -> bool {
        self.kalman.is_some()
    }

    /// Forgets the target: [`update`](Self::update) fails until the next [`init`](Self::init).
    pub fn stop(&mut self) {
        self.kalman = None;
    }

    /// The paper's tracker inside.
    pub fn tracker(&self) -> &Tracker {
        &self.tracker
    }

    /// The presence coefficients in use.
    pub fn presence(&self) -> &Presence {
        &self.presence
    }
}
