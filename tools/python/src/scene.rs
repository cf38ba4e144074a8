//! Rendered flights, for the demo and the tests.

use numpy::{PyArray1, PyArray3, PyArrayMethods};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use scenes::{Difficulty, FlightConfig, FrameBuffer};

use crate::failure::Failure;
use crate::results::Corners;

/// A rendered flight over a procedural country, with the target's exact box in every picture.
///
/// `frames` is 1 to 100000, `width` and `height` are 16 to 4096 pixels. `difficulty` is "easy",
/// "medium" or "hard". The same arguments give the same bytes on every machine.
/// `flight[i]` is picture i: an array (H, W, 3) of uint8 in the order RGB, the target's box (left,
/// top, width, height in pixels, hidden parts included), and the share of it that is seen, 0 to 1.
///
/// Raises ValueError for other arguments, IndexError for another picture.
#[pyclass(frozen, module = "track_cpu.demo")]
pub struct Flight {
    flight: scenes::Flight,
    frames: usize,
}

#[pymethods]
impl Flight {
    #[new]
    #[pyo3(signature = (frames = 300, *, seed = 7, difficulty = "easy", width = 640, height = 360))]
    fn new(
        py: Python<'_>,
        frames: i64,
        seed: u64,
        difficulty: &str,
        width: i64,
        height: i64,
    ) -> PyResult<Flight> {
        let frames = within("frames", frames, 1, 100_000)?;
        let difficulty: Difficulty = difficulty.parse().map_err(Failure::Argument)?;
        let config = FlightConfig {
            width: within("width", width, 16, 4096)?,
            height: within("height", height, 16, 4096)?,
            frames,
            seed,
            difficulty,
            ..FlightConfig::default()
        };
        let flight = py.detach(|| scenes::Flight::new(config));
        Ok(Flight { flight, frames })
    }

    fn __len__(&self) -> usize {
        self.frames
    }

    fn __getitem__<'py>(
        &self,
        py: Python<'py>,
        index: isize,
    ) -> PyResult<(Bound<'py, PyArray3<u8>>, Corners, f32)> {
        let from_end = index.wrapping_add_unsigned(self.frames);
        let index = usize::try_from(if index < 0 { from_end } else { index });
        let index = index.ok().filter(|index| *index < self.frames);
        let index = index.ok_or_else(|| PyIndexError::new_err("no such picture"))?;
        let mut buffer = FrameBuffer::default();
        let truth = py.detach(|| self.flight.render(index, &mut buffer));
        let shape = [buffer.height, buffer.width, 3];
        let picture = PyArray1::from_vec(py, buffer.data).reshape(shape)?;
        let truth_box = (truth.bbox.x, truth.bbox.y, truth.bbox.w, truth.bbox.h);
        Ok((picture, truth_box, truth.visible))
    }
}

fn within(name: &str, found: i64, least: usize, most: usize) -> Result<usize, Failure> {
    let number = usize::try_from(found).ok();
    let number = number.filter(|number| (least..=most).contains(number));
    number.ok_or_else(|| {
        Failure::Argument(format!(
            "{name} is {found}, expected a number from {least} to {most}"
        ))
    })
}
