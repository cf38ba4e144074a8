//! Models that C holds, to be shared by trackers.

use crate::failure::{Failure, guarded};
use std::ffi::{CStr, c_char};
use std::path::Path;
use track_cpu::{Isa, Model, Precision};

/// A model; C knows it by its address only.
pub struct track_cpu_model {
    pub(crate) model: Model,
}

/// Loads a weights file or the built-in model of that name, or the standard model if `model_path`
/// is null.
///
/// # Safety
/// `model_path` is null or a string that ends in 0; `out` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_model_load(
    model_path: *const c_char,
    precision: u32,
    out: *mut *mut track_cpu_model,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that `out` is null or may be written to.
        let out = unsafe { out.as_mut() }.ok_or(Failure::Null("out"))?;
        *out = std::ptr::null_mut();
        let precision = match precision {
            0 => None,
            1 => Some(Precision::F32),
            2 => Some(Precision::Int8),
            found => {
                return Err(Failure::Number {
                    name: "precision",
                    found: found.into(),
                    expected: "0 (the faster one), 1 (f32) or 2 (int8)",
                });
            }
        };
        // SAFETY: the caller promises that `model_path` is null or a string that ends in 0.
        let model = unsafe { load(model_path, precision) }?;
        *out = Box::into_raw(Box::new(track_cpu_model { model }));
        Ok(())
    })
}

/// Destroys a model; does nothing for null. Trackers made from it keep working.
///
/// # Safety
/// `model` is null or was made by [`track_cpu_model_load`] and is neither in use nor used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_model_destroy(model: *mut track_cpu_model) {
    guarded(|| {
        if !model.is_null() {
            // SAFETY: it came out of `Box::into_raw`, and the caller promises that this happens
            // once.
            drop(unsafe { Box::from_raw(model) });
        }
        Ok(())
    });
}

/// The model of a path or name, with the faster precision if none is given.
///
/// # Safety
/// `path` is null or a string that ends in 0.
pub(crate) unsafe fn load(
    path: *const c_char,
    precision: Option<Precision>,
) -> Result<Model, Failure> {
    let name = if path.is_null() {
        None
    } else {
        // SAFETY: it is not null, and the caller promises that it then is a string that ends in 0.
        let path = unsafe { CStr::from_ptr(path) };
        Some(Path::new(path.to_str().map_err(|_| Failure::Path)?))
    };
    let weights = Model::find(name)?;
    let isa = Isa::detect();
    let precision = precision.unwrap_or_else(|| Precision::best(&weights, isa));
    Ok(Model::with_precision(&weights, isa, precision)?)
}
