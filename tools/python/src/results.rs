//! Boxes from Python, and results as the named tuples of `python/track_cpu/_results.py`.

use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use track_cpu::flight::Candidate;
use track_cpu::{BBox, FlightTrack, Track};

use crate::failure::Failure;

static TRACK: PyOnceLock<Py<PyType>> = PyOnceLock::new();
static FLIGHT_TRACK: PyOnceLock<Py<PyType>> = PyOnceLock::new();
static CANDIDATE: PyOnceLock<Py<PyType>> = PyOnceLock::new();

const MODULE: &str = "track_cpu._results";

/// A box for Python: left, top, width, height.
pub type Corners = (f32, f32, f32, f32);

pub fn corners(bbox: BBox) -> Corners {
    (bbox.x, bbox.y, bbox.w, bbox.h)
}

/// A box from anything that holds four numbers.
///
/// # Errors
/// If it does not. Whether the numbers make a box, the tracker says.
pub fn bbox(object: &Bound<'_, PyAny>) -> PyResult<BBox> {
    if let Some([x, y, w, h]) = four_numbers(object) {
        return Ok(BBox::new(x, y, w, h));
    }
    let mut found = object.repr()?.to_string();
    if found.chars().count() > 80 {
        found = found.chars().take(80).chain("...".chars()).collect();
    }
    let expected = "four numbers: left, top, width, height in pixels";
    Err(Failure::Argument(format!("box is {found}, expected {expected}")).into())
}

fn four_numbers(object: &Bound<'_, PyAny>) -> Option<[f32; 4]> {
    let mut numbers = Vec::new();
    for number in object.try_iter().ok()?.take(5) {
        numbers.push(number.ok()?.extract::<f64>().ok()? as f32);
    }
    numbers.try_into().ok()
}

/// A `track_cpu.Track`.
pub fn track(py: Python<'_>, track: Track) -> PyResult<Bound<'_, PyAny>> {
    let class = TRACK.import(py, MODULE, "Track")?;
    class.call1((true, corners(track.bbox), track.score))
}

/// A `track_cpu.FlightTrack`.
pub fn flight_track(py: Python<'_>, track: FlightTrack) -> PyResult<Bound<'_, PyAny>> {
    let class = FLIGHT_TRACK.import(py, MODULE, "FlightTrack")?;
    class.call1((
        track.is_believed(),
        corners(track.bbox),
        track.score,
        track.presence,
        track.state.name(),
        track.searches,
    ))
}

/// A `track_cpu.Candidate`.
pub fn candidate(py: Python<'_>, candidate: Candidate) -> PyResult<Bound<'_, PyAny>> {
    let class = CANDIDATE.import(py, MODULE, "Candidate")?;
    class.call1((
        corners(candidate.bbox),
        candidate.score,
        candidate.similarity,
    ))
}
