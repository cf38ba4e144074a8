//! A value for programs in other languages: any of their threads may use it, and they may `fork`.

use std::sync::{Arc, Mutex, MutexGuard, TryLockError};

/// A value that one call at a time uses; it refuses calls that would never end.
///
/// `fork` copies the calling thread alone. The value's worker threads, and a thread that holds its
/// lock, do not exist in the child, which would wait for them forever.
#[derive(Debug)]
pub struct Shared<T> {
    value: Arc<Mutex<T>>,
    process: u32, // that made the value, and started its workers
    has_workers: bool,
}

/// Reason why a [`Shared`] value cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SharedError {
    /// The process is a child, forked after the value was made.
    #[error(
        "the process was forked after this tracker was made: make a new one in the child, or use \
         one thread"
    )]
    Forked,
    /// An earlier call ended in a panic.
    #[error("an earlier call on this tracker ended in a panic")]
    Poisoned,
}

impl<T> Shared<T> {
    /// Shares a value that runs on so many threads; one is the caller's own.
    pub fn new(value: T, threads: usize) -> Shared<T> {
        Shared {
            value: Arc::new(Mutex::new(value)),
            process: std::process::id(),
            has_workers: threads > 1,
        }
    }

    /// Waits until no other thread uses the value.
    ///
    /// # Errors
    /// If an earlier call panicked. In a forked child, if the value has worker threads or another
    /// thread holds it.
    pub fn lock(&self) -> Result<MutexGuard<'_, T>, SharedError> {
        if self.is_forked() {
            if self.has_workers {
                return Err(SharedError::Forked);
            }
            // The thread that held the lock during the fork does not exist here, so that nobody
            // would ever release it.
            return self.value.try_lock().map_err(|error| match error {
                TryLockError::WouldBlock => SharedError::Forked,
                TryLockError::Poisoned(_) => SharedError::Poisoned,
            });
        }
        self.value.lock().map_err(|_| SharedError::Poisoned)
    }

    fn is_forked(&self) -> bool {
        self.process != std::process::id()
    }
}

impl<T> Drop for Shared<T> {
    /// Leaks the value in a forked child if it has workers, which cannot be told to end there.
    fn drop(&mut self) {
        if self.has_workers && self.is_forked() {
            std::mem::forget(Arc::clone(&self.value));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    /// A value that was made by another process.
    fn inherited<T>(value: T, threads: usize) -> Shared<T> {
        let mut shared = Shared::new(value, threads);
        shared.process = shared.process.wrapping_add(1);
        shared
    }

    #[test]
    fn forked_value_is_refused_if_it_has_workers_or_is_held() {
        let with_workers = inherited(1, 2);
        let alone = inherited(1, 1);

        let held = alone.lock();
        let while_held = alone.lock().map(|value| *value);

        assert_eq!(with_workers.lock().err(), Some(SharedError::Forked));
        assert_eq!(held.map(|value| *value), Ok(1));
        assert_eq!(while_held, Err(SharedError::Forked));
        assert_eq!(alone.lock().map(|value| *value), Ok(1));
    }

    #[test]
    fn value_whose_call_panicked_is_refused() {
        let shared = Arc::new(Shared::new(1, 1));
        let other = Arc::clone(&shared);

        let call = std::thread::spawn(move || {
            let _held = other.lock();
            panic!("a call that panics, as this test wants");
        });

        assert!(call.join().is_err());
        assert_eq!(shared.lock().err(), Some(SharedError::Poisoned));
    }

    #[test]
    fn value_is_dropped_unless_its_workers_are_in_another_process() {
        struct Flag<'a>(&'a AtomicBool);
        impl Drop for Flag<'_> {
            fn drop(&mut self) {
                self.0.store(true, Ordering::Relaxed);
            }
        }
        for (is_forked, threads, expected) in [(false, 2, true), (true, 1, true), (true, 2, false)]
        {
            let dropped = AtomicBool::new(false);
            let make = if is_forked { inherited } else { Shared::new };

            drop(make(Flag(&dropped), threads));

            let found = dropped.load(Ordering::Relaxed);
            assert_eq!(found, expected, "forked {is_forked}, {threads} threads");
        }
    }
}
