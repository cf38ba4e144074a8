//! The tracker for C, C++ and Python: create, init, update, score, destroy, and flight mode.
//! `include/track_cpu.h` is its documentation.
//!
//! | where | what |
//! |---|---|
//! | `src/model.rs` | models that several trackers share |
//! | `src/flight.rs` | flight mode's options, track and candidates as C sees them |
//! | `include/track_cpu.h`, `include/track_cpu.hpp` | the header; classes for C++ |
//! | `install.sh` | library, headers, `pkg-config` file and CMake package into a prefix |
//! | `examples/follow.c`, `examples/follow.cpp` | raw frames to boxes in C and C++ |
//! | `examples/track_cpu.py` | the same library from Python by ctypes: a class in place of `cv2.TrackerNano` |
//!
//! Every function returns a code, 0 for success; [`track_cpu_last_error`] describes the last
//! failure. No panic crosses the boundary: it becomes a code as well. Calls from several threads on
//! one tracker wait for each other. After `fork` a tracker of several threads refuses its calls in
//! the child, since its threads exist in the parent only.
//!
//! This is the only crate besides the kernels without `forbid(unsafe_code)`, because pointers of a
//! C caller cannot be used otherwise. All unsafe code is in this file and in `src/model.rs`, which
//! hold only the boundary, and each block states what it relies on.

#![allow(
    non_camel_case_types,
    reason = "the types have the names that the C header gives them"
)]

mod failure;
mod flight;
mod model;

use failure::{Failure, guarded};
use std::ffi::c_char;
use std::time::Duration;
use track_cpu::flight::{Budget, FlightOptions, FlightTracker};
use track_cpu::shared::Shared;
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Tracker, TrackerOptions};

pub use flight::{track_cpu_candidate, track_cpu_flight_options, track_cpu_flight_track};
pub use model::{track_cpu_model, track_cpu_model_destroy, track_cpu_model_load};

/// A box in pixels: left, top, width, height.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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

/// A picture in the caller's memory.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct track_cpu_image {
    /// `height` rows, `stride` bytes apart.
    pub data: *const u8,
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Bytes from one row of the first plane to the next; 0 if there is no gap between them.
    pub stride: usize,
    /// 0 BGR, 1 RGB, 2 BGRA, 3 RGBA, 4 gray, 5 NV12, 6 NV21, 7 I420, 8 YUYV, 9 UYVY.
    pub format: u32,
}

/// A tracker; C knows it by its address only.
pub struct track_cpu_tracker {
    target: Shared<Target>,
}

/// A tracker and its last score. One call at a time uses them.
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
    // SAFETY: the caller promises that `model_path` is null or a string that ends in 0.
    let model = || unsafe { model::load(model_path, None) };
    // SAFETY: the caller promises that `out` is null or may be written to.
    unsafe { create(out, threads, model, plain) }
}

/// Makes a tracker from a model, which it shares.
///
/// # Safety
/// `model` is null or was made by [`track_cpu_model_load`] and is not destroyed; `out` is null or
/// may be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_create_from(
    model: *const track_cpu_model,
    threads: u32,
    out: *mut *mut track_cpu_tracker,
) -> i32 {
    // SAFETY: the caller promises that it is null or a model.
    let model = || unsafe { shared(model) };
    // SAFETY: the caller promises that `out` is null or may be written to.
    unsafe { create(out, threads, model, plain) }
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
    // SAFETY: the caller promises that `model_path` is null or a string that ends in 0.
    let model = || unsafe { model::load(model_path, None) };
    // SAFETY: the caller promises that `options` is null or may be read.
    let mode = |model, threads| flying(model, threads, unsafe { options.as_ref() });
    // SAFETY: the caller promises that `out` is null or may be written to.
    unsafe { create(out, threads, model, mode) }
}

/// Makes a tracker in flight mode from a model, which it shares.
///
/// # Safety
/// As of [`track_cpu_create_from`]; `options` is null or may be read.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn track_cpu_create_flight_from(
    model: *const track_cpu_model,
    threads: u32,
    options: *const track_cpu_flight_options,
    out: *mut *mut track_cpu_tracker,
) -> i32 {
    // SAFETY: the caller promises that it is null or a model.
    let model = || unsafe { shared(model) };
    // SAFETY: the caller promises that `options` is null or may be read.
    let mode = |model, threads| flying(model, threads, unsafe { options.as_ref() });
    // SAFETY: the caller promises that `out` is null or may be written to.
    unsafe { create(out, threads, model, mode) }
}

/// Writes a tracker of a model and a mode to `out`, or null on failure.
///
/// # Safety
/// `out` is null or may be written to.
unsafe fn create(
    out: *mut *mut track_cpu_tracker,
    threads: u32,
    model: impl FnOnce() -> Result<Model, Failure>,
    mode: impl FnOnce(Model, usize) -> Result<Mode, Failure>,
) -> i32 {
    guarded(|| {
        // SAFETY: the caller promises that it is null or may be written to.
        let out = unsafe { out.as_mut() }.ok_or(Failure::Null("out"))?;
        *out = std::ptr::null_mut();
        let most = TrackerOptions::MAX_THREADS;
        let found = threads;
        let threads = found as usize;
        if !(1..=most).contains(&threads) {
            return Err(Failure::Threads { found, most });
        }
        let tracker = mode(model()?, threads)?;
        let score = 0.0;
        *out = Box::into_raw(Box::new(track_cpu_tracker {
            target: Shared::new(Target { tracker, score }, threads),
        }));
        Ok(())
    })
}

/// The model behind a caller's pointer.
///
/// # Safety
/// `model` is null or a model.
unsafe fn shared(model: *const track_cpu_model) -> Result<Model, Failure> {
    // SAFETY: the caller promises that it is null or a model.
    let held = unsafe { model.as_ref() }.ok_or(Failure::Null("model"))?;
    Ok(held.model.clone())
}

/// A tracker without flight mode.
fn plain(model: Model, threads: usize) -> Result<Mode, Failure> {
    let options = TrackerOptions {
        threads,
        ..TrackerOptions::of(&model)
    };
    Ok(Mode::Plain(Box::new(Tracker::with_options(model, options))))
}

/// A tracker in flight mode, with the default options unless others are given.
fn flying(
    model: Model,
    threads: usize,
    options: Option<&track_cpu_flight_options>,
) -> Result<Mode, Failure> {
    let defaults = FlightOptions {
        threads,
        ..FlightOptions::new(&model)
    };
    let options = match options {
        Some(options) => options.apply_to(defaults)?,
        None => defaults,
    };
    Ok(Mode::Flight(Box::new(FlightTracker::new(model, options)?)))
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

/// Takes what is inside a box as the target, forgetting any earlier one.
///
/// # Safety
/// `tracker` is null or was made by [`track_cpu_create`] or a similar function and is not
/// destroyed; `image` and `target` are null or may be read, and so may the picture's bytes.
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
        let Mode::Flight(tracker) = &mut held.tracker else {
            return Err(Failure::Mode);
        };
        let track = if elapsed.is_zero() {
            tracker.update(&frame, budget)?
        } else {
            tracker.update_after(elapsed, &frame, budget)?
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
/// `tracker` is null or was made by [`track_cpu_create_flight`] or a similar function and is not
/// destroyed; `candidates` is null or `capacity` of them may be written there; `count` is null or
/// may be written to.
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
        let Mode::Flight(tracker) = &held.tracker else {
            return Err(Failure::Mode);
        };
        let found = tracker.candidates();
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
/// `tracker` is null or was made by [`track_cpu_create`] or a similar function and is not
/// destroyed; `out` is null or may be written to.
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

/// Destroys a tracker; does nothing for null.
///
/// # Safety
/// `tracker` is null or was made by [`track_cpu_create`] or a similar function and is neither in
/// use nor used again.
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
        5 => ChannelOrder::Nv12,
        6 => ChannelOrder::Nv21,
        7 => ChannelOrder::I420,
        8 => ChannelOrder::Yuyv,
        9 => ChannelOrder::Uyvy,
        found => return Err(Failure::Format { found }),
    };
    let (width, height) = (width as usize, height as usize);
    let stride = if stride == 0 {
        order.row_bytes(width.min(Frame::MAX_SIDE))
    } else {
        stride
    };
    // Sizes that no frame has are refused before a slice of that length could be made.
    let length = Frame::bytes(width, height, stride, order)?;
    if isize::try_from(length).is_err() {
        // `Frame` refuses this size and says so.
        return Ok(Frame::with_stride(&[], width, height, stride, order)?);
    }
    // SAFETY: it is not null; the caller promises that the bytes of its rows may be read, and they
    // fit an `isize`.
    let bytes = unsafe { std::slice::from_raw_parts(data, length) };
    Ok(Frame::with_stride(bytes, width, height, stride, order)?)
}
