//! `Model`, and what every tracker is made from.

use std::path::{Path, PathBuf};

use pyo3::exceptions::{PyDeprecationWarning, PyTypeError};
use pyo3::prelude::*;
use track_cpu::{Isa, Precision, TrackConfig, TrackerOptions};

use crate::failure::Failure;
use crate::image::Order;

/// A model, loaded once and shared by any number of trackers.
///
/// `name` is a built-in model (`track_cpu.builtin_models`) or the path of a weights file.
/// `precision` is "f32", "int8" (needs a calibrated model) or None for the faster one.
///
/// Raises OSError if the file cannot be read, ModelError if it is not a usable weights file or no
/// built-in model has the name, ValueError for another precision. A Model is immutable: threads may
/// share it, and it works after os.fork.
#[pyclass(frozen, module = "track_cpu")]
pub struct Model {
    pub inner: track_cpu::Model,
}

#[pymethods]
impl Model {
    #[new]
    #[pyo3(
        signature = (name = standard(), *, precision = None),
        text_signature = "(name='drmim-p50', *, precision=None)"
    )]
    fn new(py: Python<'_>, name: PathBuf, precision: Option<&str>) -> PyResult<Model> {
        let inner = load(py, &name, precision)?;
        Ok(Model { inner })
    }

    /// Name in the weights file.
    #[getter]
    fn name(&self) -> &str {
        &self.inner.header().provenance.name
    }

    /// Arithmetic of the network: "f32" or "int8".
    #[getter]
    fn precision(&self) -> &'static str {
        self.inner.precision().name()
    }

    /// Instruction set that the kernels use, as `track-cpu doctor` names it.
    #[getter]
    fn isa(&self) -> &'static str {
        self.inner.isa().name()
    }

    fn __repr__(&self) -> String {
        let (name, precision) = (self.name(), self.precision());
        format!("Model({name:?}, precision={precision:?}) on {}", self.isa())
    }

    fn __reduce__(&self) -> PyResult<()> {
        Err(uncopied("Model", "share it between trackers"))
    }
}

/// The argument `model` of a tracker.
pub enum Source<'py> {
    Loaded(Bound<'py, Model>),
    Named(PathBuf),
}

impl<'py> FromPyObject<'_, 'py> for Source<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Source<'py>> {
        if let Ok(model) = object.cast::<Model>() {
            return Ok(Source::Loaded(model.to_owned()));
        }
        let Ok(name) = object.extract() else {
            let kind = object.get_type().name()?.to_string();
            let expected = "a Model, the name of one or a path";
            return Err(PyTypeError::new_err(format!(
                "model is a {kind}, expected {expected}"
            )));
        };
        Ok(Source::Named(name))
    }
}

impl Source<'_> {
    pub fn standard() -> Self {
        Source::Named(standard())
    }
}

/// Name of the standard model.
fn standard() -> PathBuf {
    track_cpu::Model::builtin_names()
        .next()
        .unwrap_or_default()
        .into()
}

/// What every tracker is made from.
pub struct Engine {
    pub model: track_cpu::Model,
    pub config: TrackConfig,
    pub threads: usize,
    pub order: Order,
}

impl Engine {
    /// # Errors
    /// If the model cannot be used or an argument has no meaning.
    pub fn new(
        py: Python<'_>,
        source: Source<'_>,
        precision: Option<&str>,
        threads: i64,
        as_published: bool,
        order: &str,
    ) -> PyResult<Engine> {
        let order = Order::from_name(order)?;
        let most = TrackerOptions::MAX_THREADS;
        let counts = 1..=most;
        let Some(threads) = usize::try_from(threads).ok().filter(|n| counts.contains(n)) else {
            let words = format!("threads is {threads}, expected a number from 1 to {most}");
            return Err(Failure::Argument(words).into());
        };
        let model = match source {
            Source::Named(name) => load(py, &name, precision)?,
            Source::Loaded(model) => {
                let model = model.get().inner.clone();
                let has = model.precision().name();
                if let Some(asked) = precision.filter(|asked| *asked != has) {
                    let words = format!("precision is {asked:?}, but the Model is loaded as {has}");
                    return Err(Failure::Argument(words).into());
                }
                model
            }
        };
        let config = if as_published {
            model.config().as_published()
        } else {
            model.config()
        };
        Ok(Engine {
            model,
            config,
            threads,
            order,
        })
    }
}

fn load(py: Python<'_>, name: &Path, precision: Option<&str>) -> PyResult<track_cpu::Model> {
    let known = |name: &str| {
        let words = format!("precision is {name:?}, expected \"f32\" or \"int8\"");
        Precision::from_name(name).ok_or(Failure::Argument(words))
    };
    let precision = precision.map(known).transpose()?;
    if let Some(new) = track_cpu::Model::successor(name) {
        let words = format!(
            "{} is no longer built in; {new} takes its place",
            name.display()
        );
        let words = std::ffi::CString::new(words)?;
        PyErr::warn(py, &py.get_type::<PyDeprecationWarning>(), &words, 2)?;
    }
    let loaded = py.detach(|| {
        let weights = track_cpu::Model::find(Some(name))?;
        let isa = Isa::detect();
        let precision = precision.unwrap_or_else(|| Precision::best(&weights, isa));
        track_cpu::Model::with_precision(&weights, isa, precision)
    });
    Ok(loaded.map_err(Failure::from)?)
}

/// The error of copy, deepcopy and pickle.
pub fn uncopied(class: &str, instead: &str) -> PyErr {
    PyTypeError::new_err(format!("a {class} cannot be copied or pickled: {instead}"))
}
