//! Tracking in flight: knows when the target is lost, coasts through occlusions and finds the target again.
//!
//! [`FlightTracker`] wraps the paper's [`Tracker`]. As long as the target is there its boxes are the paper's, bit for bit;
//! every box comes with a `presence`, the calibrated probability that it is on the target.
//!
//! | file | what happens there |
//! |---|---|
//! | `mod.rs` | the states and what happens in each: start at [`FlightTracker::update`] |
//! | `evidence.rs`, `candidates.rs` | what the last search says about its choice and about other places |
//! | `presence.rs` | evidence -> probability; coefficients travel with the weights |
//! | `camera.rs`, `kalman.rs` | where the target should be: the picture's motion and the target's own |
//! | `sweep.rs` | in which order the frame is searched for a lost target |

mod camera;
mod candidates;
mod evidence;
mod kalman;
mod presence;
mod sweep;

use std::time::{Duration, Instant};

use crate::bbox::{BBox, CenterBox};
use crate::config::TrackConfig;
use crate::error::TrackError;
use crate::frame::Frame;
use crate::model::Model;
use crate::tracker::{Tracker, TrackerOptions};
use camera::{CameraMotion, Motion};
use evidence::{Finding, Witness};
use kalman::Kalman;
use presence::Smoothed;
use sweep::Sweep;

pub use candidates::{Candidate, MAX_CANDIDATES};
pub use evidence::{COUNT as EVIDENCE_COUNT, Evidence, NAMES as EVIDENCE_NAMES};
pub use presence::{NOTE as PRESENCE_NOTE, Presence, PresenceError};

/// How sure the tracker is of its target.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum State {
    /// The box is on the target.
    Tracking,
    /// The box may be on the target.
    LowConfidence,
    /// The target is hidden; the box is predicted from its motion and the camera's.
    Coasting,
    /// The target is gone and searched for; the box is where it would be.
    Lost,
    /// The target has just been found again.
    Reacquired,
}

impl State {
    /// Whether the box rests on what was seen in this frame.
    pub fn is_seen(self) -> bool {
        matches!(self, State::Tracking | State::LowConfidence | State::Reacquired)
    }

    /// A word for logs and protocols.
    pub fn name(self) -> &'static str {
        match self {
            State::Tracking => "tracking",
            State::LowConfidence => "low_confidence",
            State::Coasting => "coasting",
            State::Lost => "lost",
            State::Reacquired => "reacquired",
        }
    }
}

/// How a [`FlightTracker`] is to run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightOptions {
    /// Threads that one frame is spread over.
    pub threads: usize,
    /// Hyper-parameters of the paper's tracker.
    pub config: TrackConfig,
    /// Presence from which on the target counts as seen.
    pub present: f64,
    /// Presence from which on its motion is believed.
    pub sure: f64,
    /// Presence below which it counts as gone.
    pub absent: f64,
    /// Frames below `absent` before the box is no longer believed.
    pub patience: u32,
    /// Frames of coasting before the target counts as lost.
    pub coast: u32,
    /// Frames in a row that a place must look like the target before a lost one is taken as found.
    pub confirm: u32,
    /// Whether to coast and to search; without, the paper's tracker runs on and only `presence` tells.
    pub recover: bool,
}

impl FlightOptions {
    /// The defaults for a model: one thread, its own hyper-parameters.
    pub fn new(model: &Model) -> FlightOptions {
        FlightOptions {
            threads: 1,
            config: model.config(),
            present: 0.5,
            sure: 0.8,
            absent: 0.05,
            patience: 8,
            coast: 30,
            confirm: 3,
            recover: true,
        }
    }
}

/// How much work one frame may be; the first search is always made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Budget {
    /// As many searches as should fit into this time.
    Deadline(Duration),
    /// Exactly so many searches, where there is something to search for: the same on every machine.
    Searches(u32),
}

/// Where the target is in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlightTrack {
    /// The target's box in frame pixels; predicted where the state says so.
    pub bbox: BBox,
    /// Raw score of the last search; no probability.
    pub score: f32,
    /// Probability that the box is on the target.
    pub presence: f32,
    /// How sure that is.
    pub state: State,
    /// Searches made for this frame.
    pub searches: u32,
}

/// Follows one object and says whether it is there.
#[derive(Debug)]
pub struct FlightTracker {
    tracker: Tracker,
    options: FlightOptions,
    presence: Presence,
    witness: Witness,
    camera: CameraMotion,
    smoothed: Smoothed,
    kalman: Option<Kalman>,
    anchor: Option<Kalman>, // as it was when the target was surely seen, predicted since
    next_anchor: Option<(Kalman, u32)>, // becomes the anchor if the target stays surely seen; age in frames
    state: State,
    frames_in_state: u32,
    faint: u32, // frames in a row below `absent`
    score: f32,
    probability: f64,
    tentative: Option<Tentative>,
    leads: Vec<(f64, CenterBox)>, // places that deserve a closer look, best last: log-odds and box
    closer_look: bool,            // the next free search is one
    sweep: Sweep,
    search_cost: Duration,
    evidence: Option<Evidence>,
}

/// A place that looks like the target but is not yet taken for it.
#[derive(Clone, Copy, Debug)]
struct Tentative {
    bbox: CenterBox,
    confirmed: u32,
    needed: u32,
}

/// Share of the frame's side by which a search at zoom 1 is stepped in a sweep: cells cover 136 of 303 crop pixels.
const TILE_SHARE: f64 = 120.0 / 303.0;
/// Frames that the target must stay surely seen before its motion is remembered.
const ANCHOR_AGE: u32 = 4;
/// Most places that wait for a closer look.
const MAX_LEADS: usize = 8;
/// Frames of [`State::Reacquired`] before [`State::Tracking`].
const FRESH: u32 = 10;
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
    pub fn with_presence(model: Model, options: FlightOptions, presence: Presence) -> FlightTracker {
        let tracker_options = TrackerOptions { threads: options.threads, config: options.config };
        FlightTracker {
            tracker: Tracker::with_options(model, tracker_options),
            options,
            presence,
            witness: Witness::default(),
            camera: CameraMotion::default(),
            smoothed: Smoothed::default(),
            kalman: None,
            anchor: None,
            next_anchor: None,
            state: State::Tracking,
            frames_in_state: 0,
            faint: 0,
            score: 0.0,
            probability: 1.0,
            tentative: None,
            leads: Vec::new(),
            closer_look: false,
            sweep: Sweep::default(),
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
        self.camera = CameraMotion::default();
        self.camera.observe(frame, None);
        self.smoothed = Smoothed::default();
        self.kalman = Some(Kalman::new(&bbox.center()));
        (self.anchor, self.next_anchor) = (self.kalman, None);
        self.enter(State::Tracking);
        (self.faint, self.score, self.probability, self.evidence) = (0, 0.0, 1.0, None);
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
        let next = self.next_anchor.iter_mut().map(|(kalman, _)| kalman);
        self.anchor.iter_mut().chain(next).for_each(|kalman| kalman.predict(&motion));
        self.frames_in_state = self.frames_in_state.saturating_add(1);
        let searches = if self.state.is_seen() {
            self.follow(frame)?;
            1
        } else {
            self.seek(frame, &motion, budget, started)?
        };
        let bbox = match (self.state.is_seen(), self.tracker.target_box()) {
            (true, Some(bbox)) => bbox,
            _ => self.predicted(frame),
        };
        let (score, presence) = (self.score, self.probability as f32);
        Ok(FlightTrack { bbox: bbox.corner(), score, presence, state: self.state, searches })
    }

    /// The paper's tracker, watched.
    fn follow(&mut self, frame: &Frame<'_>) -> Result<(), TrackError> {
        let track = self.tracker.update(frame)?;
        self.score = track.score;
        let finding = self.judge(true);
        let Some(finding) = finding else {
            self.probability = 0.0;
            self.doubt();
            return Ok(());
        };
        self.probability = self.smoothed.add(&self.presence, &finding.evidence);
        let mut bbox = track.bbox.center();
        if self.options.recover && !self.is_within_reach(&finding.bbox) {
            // Too far in one frame: another object, or the target behind one.
            let Some(other) = self.rival() else {
                self.probability = self.probability.min(self.options.absent);
                self.smoothed = Smoothed::default();
                self.enter(State::Coasting);
                return Ok(());
            };
            bbox = CenterBox { cx: other.cx, cy: other.cy, ..bbox };
            self.tracker.place(bbox);
        }
        // The smoothed presence lags where the target is just being hidden.
        let probability = self.probability.min(self.presence.alone(&finding.evidence));
        if let Some(kalman) = &mut self.kalman {
            if probability >= self.options.absent {
                kalman.correct(&bbox, probability);
            }
            if probability >= self.options.present {
                kalman.resize(&bbox);
            }
        }
        self.drop_anchor(probability >= self.options.sure);
        if self.probability < self.options.absent {
            self.doubt();
            return Ok(());
        }
        self.faint = 0;
        if self.probability < self.options.present {
            self.enter(State::LowConfidence);
            return Ok(());
        }
        self.witness.learn(&finding.evidence, probability);
        if self.state != State::Reacquired || self.frames_in_state >= FRESH {
            self.enter(State::Tracking);
        }
        Ok(())
    }

    /// Remembers the motion from a while before the last frame in which the target was surely seen: in those just before it
    /// hides, the box is already drawn towards what hides it.
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

    /// One more frame without the target: in the end the box is no longer believed.
    fn doubt(&mut self) {
        self.faint += 1;
        if self.options.recover && self.faint >= self.options.patience {
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
            c.score >= RIVAL_SCORE * chosen.score && c.similarity >= chosen.similarity - RIVAL_SIMILARITY
        };
        let near = others.iter().filter(alike).filter(|c| self.is_within_reach(&c.bbox.center()));
        near.max_by(|a, b| a.score.total_cmp(&b.score)).map(|c| c.bbox.center())
    }

    /// Whether the target can be there, for all that is known of its motion.
    fn is_within_reach(&self, bbox: &CenterBox) -> bool {
        self.kalman.is_none_or(|kalman| kalman.distance(bbox) <= kalman.gate())
    }

    /// Looks where the target should be, then wherever it may be, as long as the budget lasts; returns the searches made.
    fn seek(
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
        let carry = |bbox: &CenterBox| motion.carry(bbox);
        for (_, bbox) in &mut self.leads {
            *bbox = carry(bbox);
        }
        if let Some(tentative) = &mut self.tentative {
            tentative.bbox = carry(&tentative.bbox);
        }
        if self.state == State::Coasting && self.frames_in_state > self.options.coast {
            self.enter(State::Lost);
        }
        let mut verified = false;
        for searches in 1.. {
            let began = Instant::now();
            let ahead = self.state == State::Coasting || self.frames_in_state.is_multiple_of(3);
            if searches == 1 && ahead && self.tentative.is_none() {
                verified = self.look_ahead(frame)?;
            } else if !verified && (self.tentative.is_some() || self.closer_look && self.take_lead()) {
                // Once a frame: it takes one frame after the other to confirm a place.
                (verified, self.closer_look) = (true, false);
                if self.verify(frame)? {
                    return Ok(searches);
                }
            } else {
                self.closer_look = true;
                self.look_elsewhere(frame)?;
            }
            self.search_cost = (3 * self.search_cost + began.elapsed()) / 4;
            let more = match budget {
                Budget::Searches(most) => searches < most,
                Budget::Deadline(deadline) => started.elapsed() + self.search_cost * 5 / 4 < deadline,
            };
            if !more {
                return Ok(searches);
            }
        }
        unreachable!("the loop ends by its budget")
    }

    /// Looks around the predicted place; `true` if something there may be the target.
    fn look_ahead(&mut self, frame: &Frame<'_>) -> Result<bool, TrackError> {
        let predicted = self.predicted(frame);
        self.tracker.look(frame, predicted, 1.0, self.options.config.window_influence)?;
        let Some(finding) = self.judge(true) else { return Ok(false) };
        self.score = finding.score;
        self.probability = self.smoothed.add(&self.presence, &finding.evidence).min(self.options.present);
        let promising = self.presence.alone(&finding.evidence) >= self.options.present
            && self.is_within_reach(&finding.bbox);
        if promising {
            let needed = if self.state == State::Coasting { 2 } else { self.options.confirm };
            let bbox = CenterBox { cx: finding.bbox.cx, cy: finding.bbox.cy, ..predicted };
            self.tentative = Some(Tentative { bbox, confirmed: 1, needed });
        }
        Ok(promising)
    }

    /// Looks at the sweep's next tile, in a wider region, and keeps what it finds there as a lead.
    fn look_elsewhere(&mut self, frame: &Frame<'_>) -> Result<(), TrackError> {
        let size = self.predicted(frame);
        let tile = self.sweep.next().or_else(|| {
            let side = f64::from(size.w * size.h).sqrt();
            let radius = self.kalman.map_or(0.0, |kalman| kalman.gate()) * side;
            let frame_size = (frame.width(), frame.height());
            self.sweep.plan(frame_size, self.tile_side(&size), (size.cx, size.cy), radius);
            self.sweep.next()
        });
        let Some(((cx, cy), zoom)) = tile else { return Ok(()) };
        self.tracker.look(frame, CenterBox { cx, cy, ..size }, zoom, 0.0)?;
        let Some(finding) = self.judge(false) else { return Ok(()) };
        if self.is_within_reach(&finding.bbox) {
            let odds = self.presence.log_odds(&finding.evidence);
            self.leads.push((odds, CenterBox { cx: finding.bbox.cx, cy: finding.bbox.cy, ..size }));
            self.leads.sort_by(|a, b| a.0.total_cmp(&b.0));
            let excess = self.leads.len().saturating_sub(MAX_LEADS);
            self.leads.drain(..excess);
        }
        Ok(())
    }

    /// Takes the best lead for a closer look, if there is one.
    fn take_lead(&mut self) -> bool {
        if self.tentative.is_none() {
            let lead = self.leads.pop();
            self.tentative =
                lead.map(|(_, bbox)| Tentative { bbox, confirmed: 0, needed: self.options.confirm });
        }
        self.tentative.is_some()
    }

    /// Tracks the tentative place for one frame; `true` if it is now taken for the target.
    fn verify(&mut self, frame: &Frame<'_>) -> Result<bool, TrackError> {
        let Some(mut tentative) = self.tentative.take() else { return Ok(false) };
        let back = self.tracker.target_box();
        self.tracker.place(tentative.bbox);
        let track = self.tracker.update(frame)?;
        let Some(finding) = self.judge(false) else { return Ok(false) };
        if self.presence.alone(&finding.evidence) < self.options.present {
            back.into_iter().for_each(|bbox| self.tracker.place(bbox));
            return Ok(false);
        }
        tentative.bbox = track.bbox.center();
        tentative.confirmed += 1;
        if tentative.confirmed < tentative.needed {
            self.tentative = Some(tentative);
            return Ok(false);
        }
        self.kalman = Some(Kalman::new(&tentative.bbox));
        (self.anchor, self.next_anchor) = (self.kalman, None);
        self.smoothed = Smoothed::default();
        self.probability = self.smoothed.add(&self.presence, &finding.evidence);
        self.score = finding.score;
        self.enter(State::Reacquired);
        self.faint = 0;
        self.give_up_search();
        Ok(true)
    }

    fn judge(&mut self, expected: bool) -> Option<Finding> {
        let kalman = self.kalman.filter(|_| expected);
        let distance = |bbox: &CenterBox| kalman.map_or(0.0, |kalman| kalman.distance(bbox));
        let tracker = &self.tracker;
        let finding = self.witness.judge(tracker.network(), tracker.selector(), tracker.seen()?, distance);
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
    }

    /// Where the target should be, as far as that is in the frame.
    fn predicted(&self, frame: &Frame<'_>) -> CenterBox {
        let bbox = self.kalman.map_or_else(CenterBox::default, |kalman| kalman.bbox());
        bbox.clamped(frame.width(), frame.height(), self.options.config.min_size)
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
        Ok(self.judge(false).map(|finding| (finding.bbox.corner(), finding.evidence)))
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
