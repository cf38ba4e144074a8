//! The native module of the Python package `track-cpu`: `track_cpu._native`.
//!
//! | file | what is in it |
//! |---|---|
//! | `image.rs` | a NumPy array or PIL image as a [`track_cpu::Frame`], without a copy if possible |
//! | `model.rs` | `Model`, and what every tracker is made from |
//! | `tracker.rs`, `flight.rs` | `Tracker`, `FlightTracker` |
//! | `results.rs` | boxes from Python and results for Python |
//! | `failure.rs` | errors as Python exceptions |
//! | `scene.rs` | rendered flights for the demo and the tests |
//!
//! Doc comments of classes and methods are Python's docstrings; `python/track_cpu/_native.pyi` has
//! the types. The interpreter's lock is released while a picture is worked on, so that other Python
//! threads run. Calls from several threads on one tracker wait for each other.

#![forbid(unsafe_code)]

mod failure;
mod flight;
mod image;
mod model;
mod results;
mod scene;
mod tracker;

#[pyo3::pymodule(name = "_native")]
mod native {
    use pyo3::prelude::*;
    use pyo3::types::PyTuple;

    #[pymodule_export]
    use crate::failure::ModelError;
    #[pymodule_export]
    use crate::flight::FlightTracker;
    #[pymodule_export]
    use crate::model::Model;
    #[pymodule_export]
    use crate::scene::Flight;
    #[pymodule_export]
    use crate::tracker::Tracker;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        let names: Vec<&str> = track_cpu::Model::builtin_names().collect();
        module.add("builtin_models", PyTuple::new(module.py(), names)?)?;
        module.add("BELIEVED", track_cpu::flight::BELIEVED)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
