//! The tracker for C, C++ and Python: create, init, update, score, destroy, and flight mode.
//! `include/track_cpu.h` is its documentation.
//!
//! | where | what |
//! |---|---|
//! | `src/flight.rs` | flight mode's options, track and candidates as C sees them |
//! | `include/track_cpu.h` | the header |
//! | `examples/follow.c` | raw frames to boxes in C |
//! | `examples/track_cpu.py` | the same library from Python by ctypes: a class in place of `cv2.TrackerNano` |
//!
//! Every function returns a code, 0 for success; [`track_cpu_last_error`] describes the last
//! failure. No panic crosses the boundary: it becomes a code as well. Calls from several threads on
//! one tracker wait for each other. After `fork` a tracker of several threads refuses its calls in
//! the child, since its threads exist in the parent only.
//!
//! This is the only crate besides the kernels that is not `forbid(unsafe_code)`: a C caller's
//! pointers cannot be used otherwise. All of that code is in this file, nothing but the boundary is
//! here, and each block states what it relies on.

mod failure;
mod flight;

use failure::{Failure, guarded};
use std::ffi::{CStr, c_char};
use std::path::Path;
use std::time::Duration;
use track_cpu::flight::{Budget, FlightOptions, FlightTracker};
use track_cpu::shared::Shared;
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Tracker, TrackerOptions};

pub use flight::{track_cpu_candidate, track_cpu_flight_options, track_cpu_flight_track};

/// A box in pixels: left, top, width, height.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[allow(non_camel_case_types)]
pub struct track_cpu_box {
    /// Left edge.
    pub x: f32,
    /// Top edge.
    pub y: f32,
    /// Width.
    pub w: f32,
    /// Height.
    pub h: f32,
}

/// A picture that the caller keeps.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
#[allow(non_camel_case_types)]
pub struct track_cpu_image {
    /// `height` rows, `stride` bytes apart.
    pub data: *const u8,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Bytes from one row to the next; 0 if there is no gap between them.
    pub stride: usize,
    /// 0 BGR, 1 RGB, 2 BGRA, 3 RGBA, 4 gray.
    pub format: u32,
}

/// A tracker; C knows it by its address only.
#[allow(non_camel_case_types)]
pub struct track_cpu_tracker {
    target: Shared<Target>,
}

/// The tracker and what it last said; one call at a time uses them.
struct Target {
    tracker: Mode,
    score: f32,
}

/// A tracker of either mode.
enum Mode {
    Plain(Box<Tracker>),
    Flight(Box<FlightTracker>),
}

/// Makes a tracker from a weights file or the built-in model of that name, or from the standard
/// model if `model_path` is null.
///
/// # Safety
/// `model_path` is null or a string that ends in 0; `out` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_create(
    model_path: *const c_char,
    threads: u32,
    out: *mut *mut track_cpu_tracker,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that `out` is null or may be written to.
        let out = unsafe { out.as_mut() }.ok_or(Failure::Null("out"))?;
        *out = std::ptr::null_mut();
        // SAFETY: the caller promises that `model_path` is null or a string that ends in 0.
        let model = unsafe { model(model_path, threads) }?;
        let options = TrackerOptions {
            threads: threads as usize,
            ..TrackerOptions::of(&model)
        };
        let tracker = Tracker::with_options(model, options);
        *out = made(Mode::Plain(Box::new(tracker)), threads);
        Ok(())
    })
}

/// Makes a tracker in flight mode, with the default options if `options` is null.
///
/// # Safety
/// As of [`track_cpu_create`]; `options` is null or may be read.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_create_flight(
    model_path: *const c_char,
    threads: u32,
    options: *const track_cpu_flight_options,
    out: *mut *mut track_cpu_tracker,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that `out` is null or may be written to.
        let out = unsafe { out.as_mut() }.ok_or(Failure::Null("out"))?;
        *out = std::ptr::null_mut();
        // SAFETY: the caller promises that `model_path` is null or a string that ends in 0.
        let model = unsafe { model(model_path, threads) }?;
        let usual = FlightOptions {
            threads: threads as usize,
            ..FlightOptions::new(&model)
        };
        // SAFETY: the caller promises that it is null or may be read.
        let options = match unsafe { options.as_ref() } {
            Some(options) => options.over(usual)?,
            None => usual,
        };
        let tracker = FlightTracker::new(model, options)?;
        *out = made(Mode::Flight(Box::new(tracker)), threads);
        Ok(())
    })
}

/// Writes the default options of flight mode.
///
/// # Safety
/// `out` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_flight_defaults(out: *mut track_cpu_flight_options) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that it is null or may be written to.
        let out = unsafe { out.as_mut() }.ok_or(Failure::Null("out"))?;
        *out = track_cpu_flight_options::of(&FlightOptions::new(&Model::builtin(Isa::detect())));
        Ok(())
    })
}

/// The model of a path or name, for so many threads.
///
/// # Safety
/// `path` is null or a string that ends in 0.
unsafe fn model(path: *const c_char, threads: u32) -> Result<Model, Failure> {
    let most = TrackerOptions::MAX_THREADS;
    if !(1..=most).contains(&(threads as usize)) {
        return Err(Failure::Threads {
            found: threads,
            most,
        });
    }
    let name = if path.is_null() {
        None
    } else {
        // SAFETY: it is not null, and the caller promises that it then is a string that ends in 0.
        let path = unsafe { CStr::from_ptr(path) };
        Some(Path::new(path.to_str().map_err(|_| Failure::Path)?))
    };
    Ok(Model::from_weights(&Model::find(name)?, Isa::detect())?)
}

/// A tracker as C holds it.
fn made(tracker: Mode, threads: u32) -> *mut track_cpu_tracker {
    let score = 0.0;
    Box::into_raw(Box::new(track_cpu_tracker {
        target: Shared::new(Target { tracker, score }, threads as usize),
    }))
}

/// Takes what is inside a box as the target, forgetting any earlier one.
///
/// # Safety
/// `tracker` is null or was made by [`track_cpu_create`] and is not destroyed; `image` and `target`
/// are null or may be read, and so may the picture's bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_init(
    tracker: *mut track_cpu_tracker,
    image: *const track_cpu_image,
    target: *const track_cpu_box,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that it is null or a tracker; only its lock gives access to
        // what changes.
        let tracker = unsafe { tracker.as_ref() }.ok_or(Failure::Null("tracker"))?;
        // SAFETY: the caller promises that it is null or may be read.
        let image = unsafe { image.as_ref() }.ok_or(Failure::Null("image"))?;
        // SAFETY: the caller promises that it is null or may be read.
        let target = unsafe { target.as_ref() }.ok_or(Failure::Null("target"))?;
        // SAFETY: the caller promises that the picture's bytes may be read.
        let frame = unsafe { frame(image) }?;
        let mut held = tracker.target.lock()?;
        let bbox = BBox::new(target.x, target.y, target.w, target.h);
        match &mut held.tracker {
            Mode::Plain(tracker) => tracker.init(&frame, bbox)?,
            Mode::Flight(tracker) => tracker.init(&frame, bbox)?,
        }
        held.score = 1.0;
        Ok(())
    })
}

/// Finds the target in the next picture.
///
/// # Safety
/// As of [`track_cpu_init`]; `out` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_update(
    tracker: *mut track_cpu_tracker,
    image: *const track_cpu_image,
    out: *mut track_cpu_box,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that it is null or a tracker; only its lock gives access to
        // what changes.
        let tracker = unsafe { tracker.as_ref() }.ok_or(Failure::Null("tracker"))?;
        // SAFETY: the caller promises that it is null or may be read.
        let image = unsafe { image.as_ref() }.ok_or(Failure::Null("image"))?;
        // SAFETY: the caller promises that it is null or may be written to.
        let out = unsafe { out.as_mut() }.ok_or(Failure::Null("out"))?;
        // SAFETY: the caller promises that the picture's bytes may be read.
        let frame = unsafe { frame(image) }?;
        let mut held = tracker.target.lock()?;
        let (bbox, score) = match &mut held.tracker {
            Mode::Plain(tracker) => {
                let track = tracker.update(&frame)?;
                (track.bbox, track.score)
            }
            Mode::Flight(tracker) => {
                let track = tracker.update(&frame, Budget::Searches(flight::SEARCHES))?;
                (track.bbox, track.presence)
            }
        };
        held.score = score;
        *out = bbox.into();
        Ok(())
    })
}

/// Finds the target of a tracker in flight mode in the next picture, or says that it is not there.
///
/// # Safety
/// As of [`track_cpu_init`]; `out` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_update_flight(
    tracker: *mut track_cpu_tracker,
    image: *const track_cpu_image,
    elapsed: f64,
    deadline: f64,
    out: *mut track_cpu_flight_track,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that it is null or a tracker; only its lock gives access to
        // what changes.
        let tracker = unsafe { tracker.as_ref() }.ok_or(Failure::Null("tracker"))?;
        // SAFETY: the caller promises that it is null or may be read.
        let image = unsafe { image.as_ref() }.ok_or(Failure::Null("image"))?;
        // SAFETY: the caller promises that it is null or may be written to.
        let out = unsafe { out.as_mut() }.ok_or(Failure::Null("out"))?;
        // SAFETY: the caller promises that the picture's bytes may be read.
        let frame = unsafe { frame(image) }?;
        let seconds = |name, value: f64| {
            Duration::try_from_secs_f64(value).map_err(|_| Failure::Number {
                name,
                found: value,
                expected: "seconds, 0 or more",
            })
        };
        let elapsed = seconds("elapsed", elapsed)?;
        let deadline = seconds("deadline", deadline)?;
        let budget = if deadline.is_zero() {
            Budget::Searches(flight::SEARCHES)
        } else {
            Budget::Deadline(deadline)
        };
        let mut held = tracker.target.lock()?;
        let Mode::Flight(flying) = &mut held.tracker else {
            return Err(Failure::Mode);
        };
        let track = if elapsed.is_zero() {
            flying.update(&frame, budget)?
        } else {
            flying.update_after(elapsed, &frame, budget)?
        };
        held.score = track.presence;
        *out = track.into();
        Ok(())
    })
}

/// Writes the places that the last search of a tracker in flight mode found, the chosen one first,
/// and their number.
///
/// # Safety
/// `tracker` is null or was made by [`track_cpu_create_flight`] and is not destroyed; `candidates`
/// is null or `capacity` of them may be written there; `count` is null or may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_candidates(
    tracker: *const track_cpu_tracker,
    candidates: *mut track_cpu_candidate,
    capacity: u32,
    count: *mut u32,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that it is null or a tracker.
        let tracker = unsafe { tracker.as_ref() }.ok_or(Failure::Null("tracker"))?;
        // SAFETY: the caller promises that it is null or may be written to.
        let count = unsafe { count.as_mut() }.ok_or(Failure::Null("count"))?;
        if candidates.is_null() {
            return Err(Failure::Null("candidates"));
        }
        let held = tracker.target.lock()?;
        let Mode::Flight(flying) = &held.tracker else {
            return Err(Failure::Mode);
        };
        let found = flying.candidates();
        let written = found.len().min(capacity as usize);
        for (i, candidate) in found[..written].iter().enumerate() {
            // SAFETY: it is not null, and `i` is below `capacity`, up to which the caller promises
            // that it may be written to.
            unsafe { candidates.add(i).write((*candidate).into()) };
        }
        *count = written as u32;
        Ok(())
    })
}

/// Writes how sure the tracker is of the last box, 0 to 1.
///
/// # Safety
/// `tracker` is null or was made by [`track_cpu_create`] and is not destroyed; `out` is null or may
/// be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_score(tracker: *const track_cpu_tracker, out: *mut f32) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that it is null or a tracker.
        let tracker = unsafe { tracker.as_ref() }.ok_or(Failure::Null("tracker"))?;
        // SAFETY: the caller promises that it is null or may be written to.
        let out = unsafe { out.as_mut() }.ok_or(Failure::Null("out"))?;
        *out = tracker.target.lock()?.score;
        Ok(())
    })
}

/// Ends a tracker; a no-op for null.
///
/// # Safety
/// `tracker` is null or was made by [`track_cpu_create`] and is neither in use nor used again.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_destroy(tracker: *mut track_cpu_tracker) {
    guarded(|| {
        if !tracker.is_null() {
            // SAFETY: it came out of `Box::into_raw`, and the caller promises that this happens
            // once.
            drop(unsafe { Box::from_raw(tracker) });
        }
        Ok(())
    });
}

/// Describes the last failure on this thread: a string that lasts until the next call on this
/// thread.
#[unsafe(no_mangle)]
pub extern "C" fn track_cpu_last_error() -> *const c_char {
    failure::last().unwrap_or(c"".as_ptr())
}

/// Returns the library's version.
#[unsafe(no_mangle)]
pub extern "C" fn track_cpu_version() -> *const c_char {
    const VERSION: &str = concat!(env!("CARGO_PKG_VERSION"), "\0");
    VERSION.as_ptr().cast()
}

/// The caller's picture.
///
/// # Safety
/// `image.data` is null, or as many bytes as the size, stride and format say may be read there for
/// as long as `image` lives.
unsafe fn frame(image: &track_cpu_image) -> Result<Frame<'_>, Failure> {
    let track_cpu_image {
        data,
        width,
        height,
        stride,
        format,
    } = *image;
    if data.is_null() {
        return Err(Failure::Null("image data"));
    }
    let order = match format {
        0 => ChannelOrder::Bgr,
        1 => ChannelOrder::Rgb,
        2 => ChannelOrder::Bgra,
        3 => ChannelOrder::Rgba,
        4 => ChannelOrder::Gray,
        found => return Err(Failure::Format { found }),
    };
    let (width, height) = (width as usize, height as usize);
    let row = width.saturating_mul(order.bytes_per_pixel());
    let stride = if stride == 0 { row } else { stride };
    // Sizes that no frame has are refused before a slice of that length could be made.
    let sides = 1..=Frame::MAX_SIDE;
    let length = stride
        .checked_mul(height.saturating_sub(1))
        .and_then(|gaps| gaps.checked_add(row));
    let length = match length.filter(|length| isize::try_from(*length).is_ok()) {
        Some(length) if sides.contains(&width) && sides.contains(&height) && stride >= row => {
            length
        }
        // Says what is wrong.
        _ => return Ok(Frame::with_stride(&[], width, height, stride, order)?),
    };
    // SAFETY: it is not null; the caller promises that the bytes of its rows may be read, and they
    // fit an `isize`.
    let bytes = unsafe { std::slice::from_raw_parts(data, length) };
    Ok(Frame::with_stride(bytes, width, height, stride, order)?)
}
