//! Failures as a code and a message; panics become one of them.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};
use track_cpu::flight::{PresenceError, ThresholdError};
use track_cpu::shared::SharedError;
use track_cpu::{FrameError, ModelError, TrackError};

/// Why a call failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// A pointer is null.
    #[error("{0} is null")]
    Null(&'static str),
    /// The number of threads is out of range.
    #[error("{found} threads, expected 1 to {most}")]
    Threads {
        /// The number that was given.
        found: u32,
        /// The largest number allowed.
        most: usize,
    },
    /// A path is not UTF-8.
    #[error("the path of the model is not UTF-8")]
    Path,
    /// A picture's format is unknown.
    #[error("image format {found}, expected 0 to 9")]
    Format {
        /// What was given.
        found: u32,
    },
    /// A number is none of those allowed.
    #[error("{name} is {found}, expected {expected}")]
    Number {
        /// Its name.
        name: &'static str,
        /// What was given.
        found: f64,
        /// What was expected.
        expected: &'static str,
    },
    /// A threshold is none of those allowed.
    #[error(transparent)]
    Threshold(#[from] ThresholdError),
    /// The tracker is not in flight mode.
    #[error("this tracker is not in flight mode: make it with track_cpu_create_flight")]
    Mode,
    /// A model cannot be used.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A model's presence coefficients cannot be used.
    #[error(transparent)]
    Presence(#[from] PresenceError),
    /// A picture is invalid.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The tracker refuses the box or the picture.
    #[error(transparent)]
    Track(#[from] TrackError),
    /// The tracker cannot be used any more.
    #[error(transparent)]
    Shared(#[from] SharedError),
    /// A defect of this library.
    #[error("a defect in track-cpu: {0}")]
    Panic(String),
}

impl Failure {
    /// The code in `track_cpu.h`.
    fn code(&self) -> i32 {
        match self {
            Failure::Null(_)
            | Failure::Threads { .. }
            | Failure::Path
            | Failure::Format { .. }
            | Failure::Number { .. }
            | Failure::Threshold(_)
            | Failure::Mode => 1, // TRACK_CPU_ARGUMENT
            Failure::Model(_) | Failure::Presence(_) => 2, // TRACK_CPU_MODEL
            Failure::Frame(_) => 3,                        // TRACK_CPU_IMAGE
            Failure::Track(_) => 4,                        // TRACK_CPU_TARGET
            Failure::Panic(_) | Failure::Shared(SharedError::Poisoned) => 5, // TRACK_CPU_DEFECT
            Failure::Shared(SharedError::Forked) => 6,     // TRACK_CPU_FORKED
        }
    }
}

thread_local! {
    static LAST: RefCell<CString> = RefCell::default();
}

/// Runs the body of a call. Keeps the message of a failure and returns its code; 0 is success.
pub fn guarded(call: impl FnOnce() -> Result<(), Failure>) -> i32 {
    let done = catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<&str>().map(|text| (*text).to_owned());
        let text = text.or_else(|| panic.downcast_ref::<String>().cloned());
        Err(Failure::Panic(text.unwrap_or_else(|| "a panic".into())))
    });
    let Err(failure) = done else { return 0 };
    let words = CString::new(failure.to_string().replace('\0', " ")).unwrap_or_default();
    // Fails while the thread ends, when no further call can ask for the message.
    let _ = LAST.try_with(|last| last.replace(words));
    failure.code()
}

/// The message of this thread's last failure, valid until the next call; `None` while it ends.
pub fn last() -> Option<*const c_char> {
    LAST.try_with(|last| last.borrow().as_ptr()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panic_in_a_call_becomes_a_code() {
        std::panic::set_hook(Box::new(|_| {}));
        assert_eq!(guarded(|| panic!("row {} is missing", 3)), 5);
        let text = LAST.with(|last| last.borrow().to_str().unwrap().to_owned());
        assert_eq!(text, "a defect in track-cpu: row 3 is missing");
        assert_eq!(guarded(|| Ok(())), 0);
        assert_eq!(guarded(|| Err(Failure::Null("out"))), 1);
    }
}
