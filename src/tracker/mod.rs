//! The tracker: start reading here. [`Tracker::update`] tells the whole story.
//!
//! | file | what happens there |
//! |---|---|
//! | `mod.rs` | a target's first frame, and every later one |
//! | `view.rs` | which part of the surroundings one search takes in |
//! | `crop.rs` | the crop around the target; from frame to crop pixels and back |
//! | `select.rs` | from score map and offsets to one box |
//! | `filter.rs` | the correlation filter that is learned while tracking |
//! | `correction.rs` | what the first frame tells about the network's errors |
//! | `adaptive.rs` | a smaller search region while the target is easy to follow |

mod adaptive;
mod correction;
pub mod crop;
mod filter;
mod select;
mod view;

use crate::bbox::{BBox, CropBox, FrameBox};
use crate::config::TrackConfig;
use crate::error::TrackError;
use crate::frame::{Frame, FrameSize};
use crate::model::Model;
use crate::net::Network;
use crate::stages::{Lap, Stages};
use adaptive::Adaptive;
use correction::Correction;
use crop::{Cropper, Placement, Region};
use filter::OnlineFilter;
use kernels::par::{Cores, Threads};
use view::Views;

#[cfg(test)]
pub(crate) use crop::CropSize;
pub(crate) use select::{Choice, Selector};
pub(crate) use view::Extent;

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
    size_change: Option<SizeChange>,
    stages: Stages,
}

/// Where the last search looked and which cell it chose.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// The box in the middle of the search region.
    pub around: FrameBox,
    /// Where the search crop lies in the frame.
    pub placement: Placement,
    /// The chosen cell; `None` if no cell was usable.
    pub choice: Option<Choice>,
    extent: Extent,
}

/// How a tracker runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerOptions {
    /// Threads that one frame is spread over.
    pub threads: usize,
    /// Processor cores that the threads are pinned to.
    pub cores: Cores,
    /// Hyper-parameters.
    pub config: TrackConfig,
    /// How much of the search region is searched.
    pub search: SearchRegion,
}

impl TrackerOptions {
    /// The largest number of threads.
    pub const MAX_THREADS: usize = Threads::MAX;

    /// One thread, the model's own hyper-parameters, the whole search region.
    pub fn of(model: &Model) -> TrackerOptions {
        TrackerOptions {
            threads: 1,
            cores: Cores::ANY,
            config: model.config(),
            search: SearchRegion::Full,
        }
    }
}

/// How much of the search region a tracker searches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SearchRegion {
    /// All of it, in every frame.
    #[default]
    Full,
    /// Its middle while the target is easy to follow, at 0.62 of the work.
    Adaptive,
}

/// Where the target is in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// The target's box in frame pixels; it may reach beyond the frame's edge.
    pub bbox: BBox,
    /// Classification score times centerness of the chosen cell, in `[0, 1]`.
    ///
    /// 0 if no output of the network was finite; the box is then the previous one.
    pub score: f32,
    /// The score after penalty and window: the maximized value, which video_analyst reports.
    pub penalized_score: f32,
}

/// A change of the frame's size, as of a stream that switches its resolution.
///
/// The picture is taken to be stretched, not cropped: positions and lengths scale with the sides.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SizeChange {
    /// Size of the frame before.
    pub from: FrameSize,
    /// Size of the frame after.
    pub to: FrameSize,
}

impl SizeChange {
    /// Factor of horizontal lengths.
    pub fn x(&self) -> f32 {
        self.to.width as f32 / self.from.width as f32
    }

    /// Factor of vertical lengths.
    pub fn y(&self) -> f32 {
        self.to.height as f32 / self.from.height as f32
    }

    /// A box of the frame before in pixels of the frame after.
    pub fn rescale(&self, bbox: &FrameBox) -> FrameBox {
        // Pixel `i` covers `i - 0.5 .. i + 0.5`, so that the frame's edge is at -0.5.
        let position = |at: f32, factor: f32| (at + 0.5) * factor - 0.5;
        FrameBox {
            cx: position(bbox.cx, self.x()),
            cy: position(bbox.cy, self.y()),
            w: bbox.w * self.x(),
            h: bbox.h * self.y(),
        }
    }
}

/// Where the target is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Position {
    /// The box that the next search is around: the best cell's, smoothed.
    pub followed: FrameBox,
    /// The box that is reported: the cells' vote, smoothed.
    ///
    /// It never steers a search. A vote lags behind a fast target, and the search would lose it.
    pub shown: FrameBox,
}

impl Position {
    /// The target at a box that is known.
    fn at(bbox: FrameBox) -> Position {
        Position {
            followed: bbox,
            shown: bbox,
        }
    }

    /// Both boxes, mapped.
    fn map(&self, to: impl Fn(&FrameBox) -> FrameBox) -> Position {
        Position {
            followed: to(&self.followed),
            shown: to(&self.shown),
        }
    }
}

/// State of one target.
#[derive(Clone, Copy, Debug)]
struct Target {
    position: Position,
    frame: FrameSize,            // of the last frame, in whose pixels the boxes are
    first_side: f32,             // the shorter side of the first box
    first_aspect: f32,           // width over height of the first box
    border: [u8; 3],             // mean color of the first frame, BGR
    correction: Correction,      // of every cell's box
    vote_correction: Correction, // what a vote needs beyond that
}

impl Target {
    /// Smallest side of a box: [`TrackConfig::min_size`] or, if less, half of the first side.
    ///
    /// A bound near the target's own size would hold its box above the target. A bound far below
    /// would let the box collapse onto a part of it.
    fn min_size(&self, config: &TrackConfig) -> f32 {
        let half = (self.first_side / 2.0).max(LEAST_SIDE);
        config.min_size.min(half)
    }

    /// Stretch of the search region; see [`crop::stretch`].
    fn stretch(&self, config: &TrackConfig) -> f64 {
        let FrameBox { w, h, .. } = self.position.followed;
        let aspect = f64::from(w) / f64::from(h);
        crop::stretch(aspect / f64::from(self.first_aspect), config.unstretch)
    }
}

/// Least bound on a box's side in pixels, however small the target is.
const LEAST_SIDE: f32 = 2.0;
/// Least score of a frame from which template and filter learn.
const LEARNED_FROM: f64 = 0.3;
/// Score below which the tracker searches a wider region, if it has a filter.
const SLIPPED: f64 = 0.15;
/// Least penalized score of a target that is found in the wider region.
const REGAINED_SCORE: f64 = 0.3;
/// Least response of the filter to a target that is found in the wider region.
const REGAINED_RESPONSE: f64 = 0.4;

impl Tracker {
    /// A tracker with [`TrackerOptions::of`] the model.
    pub fn new(model: Model) -> Tracker {
        let options = TrackerOptions::of(&model);
        Tracker::with_options(model, options)
    }

    /// A tracker with the given options.
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
            size_change: None,
            stages: Stages::default(),
        }
    }

    /// Takes the object within `bbox` as the target and forgets any earlier one.
    ///
    /// # Errors
    /// If a number of the box is not finite, its width or height is not above 0, or it does not
    /// touch the frame. The tracker then keeps the earlier target.
    pub fn init(&mut self, frame: &Frame<'_>, bbox: BBox) -> Result<(), TrackError> {
        check_box(frame, bbox)?;
        self.stages = Stages::default();
        let mut target = Target {
            position: Position::at(bbox.center()),
            frame: frame.size(),
            first_side: bbox.w.min(bbox.h),
            first_aspect: bbox.w / bbox.h,
            border: frame.mean_bgr(self.network.model().isa()),
            correction: Correction::NONE,
            vote_correction: Correction::NONE,
        };
        let side = self.network.model().architecture().template_size;
        self.cut(frame, &target, side);
        self.network.set_template(&self.crop);
        if let Some(adaptive) = &mut self.adaptive {
            adaptive.reset();
        }
        self.filter.clear();
        if self.config.correction > 0.0 || self.config.online_filter > 0.0 {
            self.search_first_frame(frame, &mut target);
        }
        self.target = Some(target);
        self.size_change = None;
        Ok(())
    }

    /// Searches the first frame, whose true box is known: measures the network's error and the
    /// vote's, and begins the filter.
    fn search_first_frame(&mut self, frame: &Frame<'_>, target: &mut Target) {
        let config = self.config;
        let seen = self.search(frame, target, 1.0, Extent::Full, &config);
        let selector = &self.views.of(Extent::Full).selector;
        let truth = seen.placement.to_crop(&target.position.followed);
        if config.online_filter > 0.0 {
            let spot = |response: &[f32]| selector.spot(&truth, response);
            self.filter.begin(&self.network, spot);
        }
        if let Some(Choice { bbox, vote, .. }) = seen.choice {
            target.correction = Correction::between(&bbox, &truth, config.correction);
            target.vote_correction = Correction::between(&vote, &bbox, config.correction);
        }
    }

    /// Finds the target in the next frame, near its last box, and learns its look there.
    ///
    /// The frame may have another size than the last one: see [`size_change`](Self::size_change).
    ///
    /// # Errors
    /// If there is no target yet.
    pub fn update(&mut self, frame: &Frame<'_>) -> Result<Track, TrackError> {
        self.adapt_to(frame);
        let before = self.target.ok_or(TrackError::NoTarget)?;
        let track = self.find(frame)?;
        if self.has_slipped(&track) {
            return Ok(self.look_wider(frame, before.position).unwrap_or(track));
        }
        self.learn();
        Ok(track)
    }

    /// Rescales the target if the frame's size changed, and notes the change.
    pub(crate) fn adapt_to(&mut self, frame: &Frame<'_>) -> Option<SizeChange> {
        self.size_change = None;
        let target = self.target.as_mut()?;
        let change = SizeChange {
            from: target.frame,
            to: frame.size(),
        };
        if change.from != change.to {
            target.position = target.position.map(|bbox| change.rescale(bbox));
            target.first_side *= change.x().min(change.y());
            target.first_aspect *= change.x() / change.y();
            target.frame = change.to;
            self.seen = None;
            self.size_change = Some(change);
        }
        self.size_change
    }

    /// The change of the frame's size at the last [`update`](Self::update); `None` if it stayed.
    ///
    /// The tracker rescales its target and goes on. A caller may want to tell its user.
    pub fn size_change(&self) -> Option<SizeChange> {
        self.size_change
    }

    /// Whether the target may have left the search region, and a filter could recognize it
    /// elsewhere.
    pub(crate) fn has_slipped(&self, track: &Track) -> bool {
        self.config.online_filter > 0.0 && f64::from(track.score) < SLIPPED
    }

    /// Finds the target near its last box, without learning.
    pub(crate) fn find(&mut self, frame: &Frame<'_>) -> Result<Track, TrackError> {
        let target = self.target.ok_or(TrackError::NoTarget)?;
        self.stages = Stages::default();
        let config = self.config;
        let calm = self.adaptive.as_ref().is_some_and(Adaptive::is_calm);
        let extent = if calm { Extent::Inner } else { Extent::Full };
        let mut seen = self.search(frame, &target, 1.0, extent, &config);
        if let Some(adaptive) = &mut self.adaptive
            && !adaptive.note(seen.choice.as_ref(), seen.placement.middle())
            && calm
        {
            seen = self.search(frame, &target, 1.0, Extent::Full, &config);
        }
        Ok(self.follow(frame, target, &seen))
    }

    /// Searches a wider region around the position `before`, for a target that may have moved
    /// faster than the search region reaches.
    ///
    /// The target counts as found only if network and filter agree. Nothing is learned from it.
    pub(crate) fn look_wider(&mut self, frame: &Frame<'_>, before: Position) -> Option<Track> {
        let target = Target {
            position: before,
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

    /// Moves the target to the boxes that a search chose.
    fn follow(&mut self, frame: &Frame<'_>, mut target: Target, seen: &Seen) -> Track {
        if let Some(choice) = &seen.choice {
            let Position { followed, shown } = target.position;
            let toward = |found: &CropBox, previous: &FrameBox| {
                choice.smooth(found, previous, &seen.placement, &self.config)
            };
            target.position = Position {
                followed: toward(&choice.bbox, &followed),
                shown: toward(&target.vote_correction.of(&choice.vote), &shown),
            };
        }
        let min_size = target.min_size(&self.config);
        let (width, height) = (frame.width(), frame.height());
        let clamped = |bbox: &FrameBox| bbox.clamped(width, height, min_size);
        target.position = target.position.map(clamped);
        self.target = Some(target);
        let score = seen.choice.map_or(0.0, |choice| choice.score);
        let penalized_score = seen.choice.map_or(0.0, |choice| choice.penalized_score);
        Track {
            bbox: target.position.shown.corner(),
            score: score as f32,
            penalized_score: penalized_score as f32,
        }
    }

    /// The box with its center inside the frame and its size between the bounds for this target.
    pub(crate) fn clamped(&self, frame: &Frame<'_>, bbox: &FrameBox) -> FrameBox {
        let config = &self.config;
        let min_size = self
            .target
            .map_or(config.min_size, |target| target.min_size(config));
        bbox.clamped(frame.width(), frame.height(), min_size)
    }

    /// Learns the target's look from the last search, if its choice scored high enough.
    pub(crate) fn learn(&mut self) {
        let Some(seen) = self.seen else { return };
        let Some(choice) = seen.choice else { return };
        let selector = &self.views.of(seen.extent).selector;
        let mut lap = Lap::start();

        // The template blends in the features at the chosen box.
        let share = self.config.template_update as f32;
        if share > 0.0 && choice.score >= LEARNED_FROM {
            let (template, search) = self.network.identity();
            let cells = template.size().h;
            let reach = search.size().h;
            let row = selector.window_start(choice.bbox.cy, cells, reach);
            let column = selector.window_start(choice.bbox.cx, cells, reach);
            self.network.update_template(row, column, share);
            self.stages.neck += lap.lap();
        }

        // The filter learns the chosen place at the target's smoothed size.
        if let Some(target) = self.target
            && choice.score.max(choice.response) >= LEARNED_FROM
            && selector.agrees(&choice.bbox, self.filter.response())
        {
            let mut place = seen.placement.to_crop(&target.position.followed);
            place.cx = choice.bbox.cx;
            place.cy = choice.bbox.cy;
            let spot = |response: &[f32]| selector.spot(&place, response);
            self.filter.learn(&self.network, spot);
            self.stages.filter += lap.lap();
        }
    }

    /// Searches around another box than the target's; the target stays where it is.
    ///
    /// The target is expected to have the size of `around`. The region is `zoom` times as wide as
    /// usual for its extent. `window_influence` is as in [`TrackConfig`]: 0 prefers no part of the
    /// region.
    pub(crate) fn look(
        &mut self,
        frame: &Frame<'_>,
        around: FrameBox,
        extent: Extent,
        zoom: f64,
        window_influence: f64,
    ) -> Result<Seen, TrackError> {
        let mut target = self.target.ok_or(TrackError::NoTarget)?;
        self.stages = Stages::default();
        target.position = Position::at(self.clamped(frame, &around));
        let config = TrackConfig {
            window_influence,
            ..self.config
        };
        Ok(self.search(frame, &target, zoom, extent, &config))
    }

    /// Side of the square in which a look of this extent finds the center of a target of this size,
    /// in frame pixels.
    pub(crate) fn covered_side(&self, size: &FrameBox, extent: Extent) -> f64 {
        let template = self.model().architecture().template_size;
        let context = self.config.context_amount;
        let scale = crop::scale(size.w.into(), size.h.into(), context, template);
        let cells = self.views.of(extent).selector.side();
        (cells * weights_format::Architecture::TOTAL_STRIDE) as f64 / scale
    }

    /// One search: crop, network, filter, and the best cell for a target that is expected at its
    /// box.
    fn search(
        &mut self,
        frame: &Frame<'_>,
        target: &Target,
        zoom: f64,
        extent: Extent,
        config: &TrackConfig,
    ) -> Seen {
        let mut lap = Lap::start();
        let around = target.position.followed;
        let mut zoomed = *target;
        zoomed.position.followed.w *= zoom as f32;
        zoomed.position.followed.h *= zoom as f32;
        let side = self.views.of(extent).side;
        let placement = self.cut(frame, &zoomed, side);
        self.stages.crop += lap.lap();

        let outputs = self
            .network
            .search_timed(&self.crop, side, &mut self.stages);
        target.correction.apply(&mut outputs.ltrb);
        lap.lap();

        let response = self.filter.respond(&self.network);
        self.stages.filter += lap.lap();

        let selector = &self.views.of(extent).selector;
        let previous = placement.size_in_crop(&around);
        let choice = selector.choose(self.network.outputs(), response, previous, config);
        let seen = Seen {
            around,
            placement,
            choice,
            extent,
        };
        self.seen = Some(seen);
        self.stages.select += lap.lap();
        seen
    }

    /// Moves the target to another box without a search, for a caller that knows the camera's
    /// motion. A no-op without a target.
    pub fn place(&mut self, bbox: FrameBox) {
        if let Some(target) = &mut self.target {
            target.position = Position::at(bbox);
        }
    }

    /// Where the target was last; what [`restore`](Self::restore) takes.
    pub(crate) fn position(&self) -> Option<Position> {
        self.target.map(|target| target.position)
    }

    /// Moves the target back to an earlier position. A no-op without a target.
    pub(crate) fn restore(&mut self, position: Position) {
        if let Some(target) = &mut self.target {
            target.position = position;
        }
    }

    /// The last search.
    pub(crate) fn seen(&self) -> Option<&Seen> {
        self.seen.as_ref()
    }

    /// The network with its last outputs.
    pub(crate) fn network(&self) -> &Network {
        &self.network
    }

    /// The online filter's response to the last search, a square map; empty without a filter.
    pub(crate) fn response(&self) -> &[f32] {
        self.filter.response()
    }

    /// The selector of the last search's score map.
    pub(crate) fn selector(&self) -> &Selector {
        let extent = self.seen.map_or(Extent::Full, |seen| seen.extent);
        &self.views.of(extent).selector
    }

    /// Cuts the crop of `side` pixels around the target.
    fn cut(&mut self, frame: &Frame<'_>, target: &Target, side: usize) -> Placement {
        let bbox = &target.position.followed;
        let template_size = self.network.model().architecture().template_size;
        let context = self.config.context_amount;
        let stretch = target.stretch(&self.config);
        let w = f64::from(bbox.w) / stretch;
        let h = f64::from(bbox.h) * stretch;
        let scale = crop::scale(w, h, context, template_size);
        let region = Region::around(bbox, scale, stretch, side);
        self.crop.resize(side * side * 3, 0);
        let isa = self.network.model().isa();
        let threads = self.network.threads();
        let cropper = &mut self.cropper;
        let out = &mut self.crop;
        threads.enter(|| cropper.cut(isa, threads, frame, &region, target.border, out));
        Placement::new(bbox, scale, stretch, side)
    }

    /// Time per stage of the last [`update`](Self::update), over all of its searches.
    pub fn stages(&self) -> &Stages {
        &self.stages
    }

    /// The last crop, `[side, side, 3]`, BGR: the network's input as a picture.
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

/// Refuses boxes that cannot hold a target.
fn check_box(frame: &Frame<'_>, bbox: BBox) -> Result<(), TrackError> {
    let BBox { x, y, w, h } = bbox;
    if !bbox.is_finite() || w <= 0.0 || h <= 0.0 {
        return Err(TrackError::BadBox { x, y, w, h });
    }
    let width = frame.width();
    let height = frame.height();
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
    if bbox.is_in_shares() && width > 1 && height > 1 {
        return Err(TrackError::Shares { x, y, w, h });
    }
    Ok(())
}
