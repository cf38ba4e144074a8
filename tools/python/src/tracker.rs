//! `Tracker`: one box per picture.

use pyo3::prelude::*;
use track_cpu::shared::Shared;
use track_cpu::{Track, TrackerOptions};

use crate::failure::Failure;
use crate::image::{Image, Order};
use crate::model::{Engine, Model, Source, uncopied};
use crate::results::{self, Corners, bbox, corners};

/// Follows one object: init with its box in the first picture, then update once per picture.
///
/// `model` is a Model, the name of a built-in model or the path of a weights file; `precision` is
/// that of Model. `threads` (1 to 256) work on one picture. `as_published` leaves out first-frame
/// correction, template update and online filter. `order` says how the colors of arrays are
/// ordered: "bgr", as OpenCV has them, or "rgb". Of arrays in YUV only the pixels that are looked
/// at are converted: "nv12", "nv21" or "i420", in the shape (3 H / 2, W) that OpenCV has, "yuyv" or
/// "uyvy", in the shape (H, W, 2); W is even.
///
/// `tracker(image)` does what `tracker.update(image)` does, and returns a Track: ok, box, score.
///
/// A picture is a NumPy array of uint8 with the shape (H, W) or (H, W, 1) for gray, (H, W, 3) or
/// (H, W, 4) with an ignored fourth channel, of any strides, or a PIL image of mode L, RGB or RGBA,
/// whose colors are RGB whatever `order` says, or YUV as it says. Sides are 1 to 32768 pixels, and
/// may change from picture to picture. Arrays whose pixels lie side by side are not copied. No
/// picture is kept.
/// A box is left, top, width and height in pixels: floats, 0-based, not rounded.
///
/// Raises OSError or ModelError as Model does, ValueError for an option. Calls from several threads
/// on one tracker wait for each other. After os.fork, a tracker of several threads raises
/// RuntimeError in the child. A tracker cannot be copied or pickled.
#[pyclass(frozen, subclass, module = "track_cpu")]
pub struct Tracker {
    held: Shared<Held>,
    model: track_cpu::Model,
    threads: usize,
    order: Order,
}

/// The tracker and its last score.
struct Held {
    tracker: track_cpu::Tracker,
    score: f32,
}

#[pymethods]
impl Tracker {
    #[new]
    #[pyo3(
        signature = (
            model = Source::standard(), *, precision = None, threads = 1, as_published = false,
            order = "bgr"
        ),
        text_signature = "(model='drmim-p50', *, precision=None, threads=1, as_published=False, \
                          order='bgr')"
    )]
    fn new(
        py: Python<'_>,
        model: Source<'_>,
        precision: Option<&str>,
        threads: i64,
        as_published: bool,
        order: &str,
    ) -> PyResult<Tracker> {
        let engine = Engine::new(py, model, precision, threads, as_published, order)?;
        let options = TrackerOptions {
            threads: engine.threads,
            config: engine.config,
            ..TrackerOptions::of(&engine.model)
        };
        let tracker = track_cpu::Tracker::with_options(engine.model.clone(), options);
        let threads = tracker.threads();
        let score = 0.0;
        Ok(Tracker {
            held: Shared::new(Held { tracker, score }, threads),
            model: engine.model,
            threads,
            order: engine.order,
        })
    }

    /// Takes the object within the box as the target, forgetting any earlier one.
    ///
    /// `box` holds four numbers: left, top, width, height in pixels.
    ///
    /// Raises ValueError if the picture is none, or the box has a number that is not finite, no
    /// area, or no pixel of the picture, or is in shares of it; the earlier target is then kept.
    #[pyo3(signature = (image, r#box))]
    fn init(
        &self,
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        r#box: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let image = Image::of(image, self.order)?;
        let frame = image.frame()?;
        let target = bbox(r#box)?;
        let begun = py.detach(|| -> Result<(), Failure> {
            let mut held = self.held.lock()?;
            held.tracker.init(&frame, target)?;
            held.score = 1.0;
            Ok(())
        });
        Ok(begun?)
    }

    /// Finds the target in the next picture: (True, (left, top, width, height)).
    ///
    /// The first value is always True: this tracker always finds something. `score` tells how well
    /// it fits, and FlightTracker whether it is the target.
    ///
    /// Raises ValueError if the picture is none, RuntimeError if there is no target yet.
    fn update(&self, py: Python<'_>, image: &Bound<'_, PyAny>) -> PyResult<(bool, Corners)> {
        let track = self.find(py, image)?;
        Ok((true, corners(track.bbox)))
    }

    /// Does what update does and returns a Track: ok, box and score.
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        image: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let track = self.find(py, image)?;
        results::track(py, track)
    }

    /// How well the last box fits, 0 to 1; 1 after init, 0 before it.
    #[getter]
    fn score(&self, py: Python<'_>) -> PyResult<f32> {
        let score = py.detach(|| Ok(self.held.lock()?.score));
        score.map_err(|error: Failure| error.into())
    }

    /// The score, by the name that OpenCV's trackers have for it.
    #[pyo3(name = "getTrackingScore")]
    fn tracking_score(&self, py: Python<'_>) -> PyResult<f32> {
        self.score(py)
    }

    /// The model, to be shared with other trackers.
    #[getter]
    fn model(&self) -> Model {
        let inner = self.model.clone();
        Model { inner }
    }

    /// Threads that work on one picture: fewer than asked for if the system refused them.
    #[getter]
    fn threads(&self) -> usize {
        self.threads
    }

    /// Order of the colors of arrays: "bgr" or "rgb".
    #[getter]
    fn order(&self) -> &'static str {
        self.order.name()
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(uncopied("Tracker", "make a new one and init it"))
    }
}

impl Tracker {
    fn find(&self, py: Python<'_>, image: &Bound<'_, PyAny>) -> PyResult<Track> {
        let image = Image::of(image, self.order)?;
        let frame = image.frame()?;
        let found = py.detach(|| -> Result<Track, Failure> {
            let mut held = self.held.lock()?;
            let track = held.tracker.update(&frame)?;
            held.score = track.score;
            Ok(track)
        });
        Ok(found?)
    }
}
