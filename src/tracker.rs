//! The tracker: start reading here. [`Tracker::update`] tells the whole story.

use crate::adaptive::Adaptive;
use crate::bbox::{BBox, CenterBox};
use crate::config::TrackConfig;
use crate::correction::Correction;
use crate::crop::{self, Cropper, Region};
use crate::error::TrackError;
use crate::extent::{Extent, Views};
use crate::frame::Frame;
use crate::model::Model;
use crate::net::Network;
use crate::online::OnlineFilter;
use crate::select::{Choice, Selector};
use crate::stages::{Lap, Stages};
use kernels::par::{Cores, Threads};

/// Follows one object from frame to frame.
///
/// Several trackers may share one [`Model`]; each has its own target, buffers and threads.
#[derive(Debug)]
pub struct Tracker {
    config: TrackConfig,
    network: Network,
    views: Views,
    filter: OnlineFilter,
    adaptive: Option<Adaptive>,
    cropper: Cropper,
    crop: Vec<u8>,
    target: Option<Target>,
    seen: Option<Seen>,
    stages: Stages,
}

/// Where the last search looked and what it chose: for those who judge the choice.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// The box it looked around.
    pub around: CenterBox,
    /// Crop pixels per frame pixel.
    pub scale: f64,
    /// The cell that it chose, if any was usable.
    pub choice: Option<Choice>,
    /// How much of the region it looked at.
    extent: Extent,
}

/// How a tracker is to run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerOptions {
    /// Threads that one frame is spread over.
    pub threads: usize,
    /// Processor cores that they are held on.
    pub cores: Cores,
    /// Hyper-parameters.
    pub config: TrackConfig,
    /// How much of the search region is looked at.
    pub search: SearchRegion,
}

impl TrackerOptions {
    /// One thread, the hyper-parameters that the model was made for, the whole search region.
    pub fn of(model: &Model) -> TrackerOptions {
        TrackerOptions {
            threads: 1,
            cores: Cores::ANY,
            config: model.config(),
            search: SearchRegion::Full,
        }
    }
}

/// How much of the search region a tracker looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SearchRegion {
    /// All of it, in every frame.
    #[default]
    Full,
    /// Its middle, while the target is easy to follow: nearly twice as fast then.
    Adaptive,
}

/// Where the target is in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// The target's box in frame pixels. It may reach beyond the frame's edge.
    pub bbox: BBox,
    /// Classification score times centerness of the chosen cell, in `[0, 1]`; 0 if the network gave no usable number
    /// and the box is the previous one.
    pub score: f32,
    /// The same after penalty and window: what the choice maximized, and what video_analyst reports.
    pub penalized_score: f32,
}

/// What is remembered of the target.
#[derive(Clone, Copy, Debug)]
struct Target {
    bbox: CenterBox,
    border: [u8; 3], // mean color of the first frame, BGR
    correction: Correction,
}

/// Score from which on the template is updated; the filter learns from here on by its own response, too.
const LEARNED_FROM: f64 = 0.3;
/// Score below which the target is looked for in a wider region, if there is a filter that knows it,
const SLIPPED: f64 = 0.15;
/// and what it must have there: as penalized score,
const REGAINED_SCORE: f64 = 0.3;
/// and as the filter's response.
const REGAINED_RESPONSE: f64 = 0.4;

impl Tracker {
    /// A tracker with [`TrackerOptions::of`] the model.
    pub fn new(model: Model) -> Tracker {
        let options = TrackerOptions::of(&model);
        Tracker::with_options(model, options)
    }

    /// A tracker with other options.
    pub fn with_options(model: Model, options: TrackerOptions) -> Tracker {
        Tracker {
            config: options.config,
            views: Views::new(model.architecture()),
            filter: OnlineFilter::default(),
            adaptive: (options.search == SearchRegion::Adaptive).then(Adaptive::default),
            network: Network::with_threads(model, Threads::pinned(options.threads, options.cores)),
            cropper: Cropper::default(),
            crop: Vec::new(),
            target: None,
            seen: None,
            stages: Stages::default(),
        }
    }

    /// Takes the object within `bbox` as the target, forgetting any earlier one.
    ///
    /// # Errors
    /// If a number of the box is not finite, its width or height is not above 0, or it does not touch the frame. The
    /// earlier target is then kept.
    pub fn init(&mut self, frame: &Frame<'_>, bbox: BBox) -> Result<(), TrackError> {
        let BBox { x, y, w, h } = bbox;
        if !bbox.is_finite() || w <= 0.0 || h <= 0.0 {
            return Err(TrackError::BadBox { x, y, w, h });
        }
        let (width, height) = (frame.width(), frame.height());
        if x >= width as f32 || y >= height as f32 || x + w <= 0.0 || y + h <= 0.0 {
            return Err(TrackError::BoxOutside {
                x,
                y,
                w,
                h,
                width,
                height,
            });
        }
        let mut target = Target {
            bbox: bbox.center(),
            border: frame.mean_bgr(),
            correction: Correction::NONE,
        };
        self.cut(
            frame,
            &target,
            self.network.model().architecture().template_size,
        );
        self.network.set_template(&self.crop);
        if let Some(adaptive) = &mut self.adaptive {
            adaptive.reset();
        }
        self.filter.clear();
        if self.config.correction > 0.0 || self.config.online_filter > 0.0 {
            target.correction = self.first_look(frame, &target);
        }
        self.target = Some(target);
        Ok(())
    }

    /// How the network errs about a target whose true box is known; the filter learns it.
    fn first_look(&mut self, frame: &Frame<'_>, target: &Target) -> Correction {
        let config = self.config;
        let Seen { scale, choice, .. } = self.search(frame, target, 1.0, Extent::Full, &config);
        let selector = &self.views.of(Extent::Full).selector;
        let truth = selector.in_crop(&target.bbox, scale);
        if config.online_filter > 0.0 {
            self.filter
                .begin(&self.network, |response| selector.spot(&truth, response));
        }
        choice.map_or(Correction::NONE, |choice| {
            Correction::between(&choice.bbox, &truth, config.correction)
        })
    }

    /// Finds the target in the next frame, near where it was, and learns how it looks now.
    ///
    /// The frame may have another size than those before.
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn update(&mut self, frame: &Frame<'_>) -> Result<Track, TrackError> {
        let before = self.target.ok_or(TrackError::NoTarget)?;
        let track = self.find(frame)?;
        if self.has_slipped(&track) {
            return Ok(self.look_wider(frame, before.bbox).unwrap_or(track));
        }
        self.learn();
        Ok(track)
    }

    /// Whether the target may have moved out of the search region, and there is a filter that would know it elsewhere.
    pub(crate) fn has_slipped(&self, track: &Track) -> bool {
        self.config.online_filter > 0.0 && f64::from(track.score) < SLIPPED
    }

    /// Finds the target, near where it was.
    pub(crate) fn find(&mut self, frame: &Frame<'_>) -> Result<Track, TrackError> {
        let target = self.target.ok_or(TrackError::NoTarget)?;
        let config = self.config;
        let calm = self.adaptive.as_ref().is_some_and(Adaptive::is_calm);
        let extent = if calm { Extent::Inner } else { Extent::Full };
        let mut seen = self.search(frame, &target, 1.0, extent, &config);
        let (_, middle) = self.views.of(extent).selector.geometry();
        if let Some(adaptive) = &mut self.adaptive
            && !adaptive.note(seen.choice.as_ref(), middle)
            && calm
        {
            seen = self.search(frame, &target, 1.0, Extent::Full, &config);
        }
        Ok(self.follow(frame, target, &seen))
    }

    /// Looks once more, farther around, for a target that was not found where it should be: it may have moved faster than the
    /// search region reaches. It is only taken for found if the network and the filter agree, and then from where it was
    /// `before`; nothing is learned from it.
    pub(crate) fn look_wider(&mut self, frame: &Frame<'_>, before: CenterBox) -> Option<Track> {
        let target = Target {
            bbox: before,
            ..self.target?
        };
        let anywhere = TrackConfig {
            window_influence: 0.0,
            ..self.config
        };
        let seen = self.search(frame, &target, 1.0, Extent::Wide, &anywhere);
        let regained = seen.choice.is_some_and(|choice| {
            choice.score * choice.penalty >= REGAINED_SCORE && choice.response >= REGAINED_RESPONSE
        });
        regained.then(|| self.follow(frame, target, &seen))
    }

    /// Takes what a search chose for the target's new box.
    fn follow(&mut self, frame: &Frame<'_>, mut target: Target, seen: &Seen) -> Track {
        if let Some(choice) = &seen.choice {
            let selector = &self.views.of(seen.extent).selector;
            target.bbox = selector.smooth(choice, &target.bbox, seen.scale, &self.config);
        }
        target.bbox = target
            .bbox
            .clamped(frame.width(), frame.height(), self.config.min_size);
        self.target = Some(target);
        let (score, penalized_score) = seen
            .choice
            .map_or((0.0, 0.0), |c| (c.score as f32, c.penalized_score as f32));
        Track {
            bbox: target.bbox.corner(),
            score,
            penalized_score,
        }
    }

    /// Learns how the target looks from what the last search chose, if that was found well enough.
    pub(crate) fn learn(&mut self) {
        let Some(
            seen @ Seen {
                choice: Some(choice),
                extent,
                ..
            },
        ) = self.seen
        else {
            return;
        };
        let selector = &self.views.of(extent).selector;
        let mut lap = Lap::start();
        let share = self.config.template_update as f32;
        if share > 0.0 && choice.score >= LEARNED_FROM {
            let (template, search) = self.network.identity();
            let (cells, reach) = (template.size().h, search.size().h);
            let start = |center| selector.window_start(center, cells, reach);
            let (row, column) = (start(choice.bbox.cy), start(choice.bbox.cx));
            self.network.update_template(row, column, share);
            self.stages.neck += lap.lap();
        }
        if let Some(target) = self.target
            && choice.score.max(choice.response) >= LEARNED_FROM
            && selector.agrees(&choice.bbox, self.filter.response())
        {
            let CenterBox { w, h, .. } = selector.in_crop(&target.bbox, seen.scale);
            let place = CenterBox {
                w,
                h,
                ..choice.bbox
            };
            self.filter
                .learn(&self.network, |response| selector.spot(&place, response));
            self.stages.filter += lap.lap();
        }
    }

    /// Looks for the target around `around`, whose size it is expected to have, in a region `zoom` times as wide as
    /// usual; the target stays where it is. `window_influence` as in [`TrackConfig`], 0 for no regard to where in it.
    pub(crate) fn look(
        &mut self,
        frame: &Frame<'_>,
        around: CenterBox,
        zoom: f64,
        window_influence: f64,
    ) -> Result<Seen, TrackError> {
        let target = self.target.ok_or(TrackError::NoTarget)?;
        let around = around.clamped(frame.width(), frame.height(), self.config.min_size);
        let config = TrackConfig {
            window_influence,
            ..self.config
        };
        Ok(self.search(
            frame,
            &Target {
                bbox: around,
                ..target
            },
            zoom,
            Extent::Full,
            &config,
        ))
    }

    /// One pass: the best cell for a target where it is taken to be, in a region `zoom` times as wide as usual, or in less or more
    /// of it.
    fn search(
        &mut self,
        frame: &Frame<'_>,
        target: &Target,
        zoom: f64,
        extent: Extent,
        config: &TrackConfig,
    ) -> Seen {
        let mut lap = Lap::start();
        let around = target.bbox;
        let zoomed = CenterBox {
            w: around.w * zoom as f32,
            h: around.h * zoom as f32,
            ..around
        };
        let side = self.views.of(extent).side;
        let scale = self.cut(
            frame,
            &Target {
                bbox: zoomed,
                ..*target
            },
            side,
        );
        self.stages.crop = lap.lap();

        target.correction.apply(
            &mut self
                .network
                .search_timed(&self.crop, side, &mut self.stages)
                .ltrb,
        );
        lap.lap();

        let response = self.filter.respond(&self.network);
        self.stages.filter = lap.lap();

        let size = [around.w, around.h].map(|side| f64::from(side) * scale);
        let selector = &self.views.of(extent).selector;
        let choice = selector.choose(self.network.outputs(), response, size, config);
        let seen = Seen {
            around,
            scale,
            choice,
            extent,
        };
        self.seen = Some(seen);
        self.stages.select = lap.lap();
        seen
    }

    /// Moves the target to another box without looking, as one might who knows how the camera moved. Without a target nothing
    /// happens.
    pub fn place(&mut self, bbox: CenterBox) {
        if let Some(target) = &mut self.target {
            target.bbox = bbox;
        }
    }

    /// Where the target is taken to be.
    pub(crate) fn target_box(&self) -> Option<CenterBox> {
        self.target.map(|target| target.bbox)
    }

    /// What the last search saw.
    pub(crate) fn seen(&self) -> Option<&Seen> {
        self.seen.as_ref()
    }

    /// The network, for its last outputs.
    pub(crate) fn network(&self) -> &Network {
        &self.network
    }

    /// What the online filter said about the last search, a square map; empty without one.
    pub(crate) fn response(&self) -> &[f32] {
        self.filter.response()
    }

    /// What knows where the cells of the last search's score map lie.
    pub(crate) fn selector(&self) -> &Selector {
        &self
            .views
            .of(self.seen.map_or(Extent::default(), |seen| seen.extent))
            .selector
    }

    /// Cuts the crop of `side` pixels around the target and returns its scale in crop pixels per frame pixel.
    fn cut(&mut self, frame: &Frame<'_>, target: &Target, side: usize) -> f64 {
        let template_size = self.network.model().architecture().template_size;
        let (w, h) = (f64::from(target.bbox.w), f64::from(target.bbox.h));
        let scale = crop::scale(w, h, self.config.context_amount, template_size);
        let region = Region::around(&target.bbox, scale, side);
        self.crop.resize(side * side * 3, 0);
        let isa = self.network.model().isa();
        let (cropper, out, threads) = (&mut self.cropper, &mut self.crop, self.network.threads());
        threads.enter(|| cropper.cut(isa, threads, frame, &region, target.border, out));
        scale
    }

    /// Time per stage of the last [`update`](Self::update).
    pub fn stages(&self) -> &Stages {
        &self.stages
    }

    /// The crop that was cut last, `[side, side, 3]`, BGR: for looking at what the network sees.
    pub fn last_crop(&self) -> &[u8] {
        &self.crop
    }

    /// The model.
    pub fn model(&self) -> &Model {
        self.network.model()
    }

    /// Threads that one frame is spread over.
    pub fn threads(&self) -> usize {
        self.network.threads().count()
    }
}
