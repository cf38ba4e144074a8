//! A slot for the latest frame: a newer frame replaces one that was not taken.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::picture::Picture;

/// Most buffers kept for reuse: one being filled, one in the slot, one being tracked.
const MAX_SPARE: usize = 3;

/// A frame with its index and time.
#[derive(Debug)]
pub struct Shot {
    /// The picture.
    pub picture: Picture,
    /// Its index, which keeps counting when the source is opened again.
    pub index: u64,
    /// When the source delivered it.
    pub taken: Instant,
}

/// What [`Slot::take`] returns.
#[derive(Debug)]
pub enum Next {
    /// The newest frame.
    Shot(Shot),
    /// No frame came within the time.
    Nothing,
    /// The source has ended, with the reason if it failed.
    Ended(Option<String>),
}

#[derive(Debug, Default)]
struct Content {
    shot: Option<Shot>,
    dropped: u64,
    spare: Vec<Picture>,
    ended: Option<Option<String>>,
    closed: bool,
}

/// A slot between the feeding and the tracking thread.
#[derive(Debug, Default)]
pub struct Slot {
    content: Mutex<Content>,
    changed: Condvar,
}

impl Slot {
    /// Puts a frame in; returns `false` once the reader has gone.
    ///
    /// If `every` frame counts, waits until the slot is empty.
    pub fn put(&self, shot: Shot, every: bool) -> bool {
        let mut content = self.lock();
        while every && content.shot.is_some() && !content.closed {
            content = self
                .changed
                .wait(content)
                .unwrap_or_else(PoisonError::into_inner);
        }
        if let Some(old) = content.shot.replace(shot) {
            content.dropped += 1;
            keep(&mut content.spare, old.picture);
        }
        self.changed.notify_all();
        !content.closed
    }

    /// Takes the frame, waiting for one for at most `patience`.
    pub fn take(&self, patience: Duration) -> Next {
        let until = Instant::now() + patience;
        let mut content = self.lock();
        loop {
            if let Some(shot) = content.shot.take() {
                self.changed.notify_all();
                return Next::Shot(shot);
            }
            if let Some(reason) = &content.ended {
                return Next::Ended(reason.clone());
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Next::Nothing;
            }
            content = self
                .changed
                .wait_timeout(content, left)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }

    /// Says that no frame will follow.
    pub fn end(&self, reason: Option<String>) {
        self.lock().ended = Some(reason);
        self.changed.notify_all();
    }

    /// Tells the source that no more frames are taken.
    pub fn close(&self) {
        self.lock().closed = true;
        self.changed.notify_all();
    }

    /// Whether [`close`](Self::close) was called.
    pub fn is_closed(&self) -> bool {
        self.lock().closed
    }

    /// Frames that were replaced before they were taken.
    pub fn dropped(&self) -> u64 {
        self.lock().dropped
    }

    /// Gives a picture back whose buffer may be used again.
    pub fn recycle(&self, picture: Picture) {
        keep(&mut self.lock().spare, picture);
    }

    /// A picture whose buffer may be filled.
    pub fn spare(&self) -> Option<Picture> {
        self.lock().spare.pop()
    }

    fn lock(&self) -> MutexGuard<'_, Content> {
        self.content.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Keeps a buffer for reuse, or drops it if there are enough.
fn keep(spare: &mut Vec<Picture>, picture: Picture) {
    if spare.len() < MAX_SPARE {
        spare.push(picture);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shot(index: u64) -> Shot {
        let picture = Picture::dot();
        Shot {
            picture,
            index,
            taken: Instant::now(),
        }
    }

    fn index(next: Next) -> Option<u64> {
        match next {
            Next::Shot(shot) => Some(shot.index),
            _ => None,
        }
    }

    #[test]
    fn newest_frame_replaces_older_ones_which_are_counted() {
        let slot = Slot::default();
        for i in 0..4 {
            assert!(slot.put(shot(i), false));
        }
        assert_eq!(index(slot.take(Duration::ZERO)), Some(3));
        assert_eq!(slot.dropped(), 3);
        assert!(slot.spare().is_some());
        assert!(matches!(slot.take(Duration::ZERO), Next::Nothing));
        slot.put(shot(9), false);
        slot.end(Some("unplugged".into()));
        assert_eq!(index(slot.take(Duration::ZERO)), Some(9));
        assert!(
            matches!(slot.take(Duration::ZERO), Next::Ended(Some(reason)) if reason == "unplugged")
        );
    }

    #[test]
    fn every_frame_is_kept_if_asked_for() {
        let slot = Slot::default();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for i in 0..50 {
                    assert!(slot.put(shot(i), true));
                }
                slot.end(None);
            });
            for i in 0..50 {
                assert_eq!(index(slot.take(Duration::from_secs(10))), Some(i));
            }
        });
        assert_eq!(slot.dropped(), 0);
        slot.close();
        slot.put(shot(0), true);
        assert!(!slot.put(shot(1), true), "a closed slot does not block");
    }
}
