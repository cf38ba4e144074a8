//! The feeding thread: it opens the source, fills the slot, and opens a source that failed or fell
//! silent again.

use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::health::fingerprint;
use crate::hub::{Hub, lock};
use crate::picture::Picture;
use crate::say::say;
use crate::slot::{Shot, Slot};

/// Wait before a failed source is opened again: doubled from the first to the second value.
const RETRY: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(4));
/// How often a waiting thread checks whether to end.
const TICK: Duration = Duration::from_millis(50);

/// An open source.
pub trait Frames {
    /// Waits for the next frame; `spare` is a buffer that may be used for it.
    ///
    /// Returns `None` after the last one.
    ///
    /// # Errors
    /// If the source fails; it is then closed.
    fn next(&mut self, spare: Vec<u8>) -> Result<Option<Picture>, String>;

    /// A function that another thread calls to make a blocked [`next`](Self::next) return.
    fn stopper(&self) -> Option<Stopper> {
        None
    }
}

/// Makes a blocked read return.
pub type Stopper = Box<dyn Fn() + Send>;

/// Opens a source, the first time and again after each failure.
pub type Open = Box<dyn FnMut() -> Result<Box<dyn Frames>, String> + Send>;

/// Where frames come from.
pub struct Feed {
    /// Opens the source.
    pub open: Open,
    /// Whether the source is opened again when it ends, fails or stalls: cameras and streams.
    pub reopens: bool,
    /// Time between frames, for sources that would deliver them as fast as they are taken.
    pub period: Option<Duration>,
}

/// The tracking thread's handle to the feeding thread.
pub struct Feeder {
    thread: JoinHandle<()>,
    stopper: Arc<Mutex<Option<Stopper>>>,
    reopens: bool,
}

impl Feed {
    /// Starts the feeding thread; with `every` frame, it waits until each one is taken.
    pub fn start(self, every: bool, slot: Arc<Slot>, hub: Arc<Hub>) -> Feeder {
        let stopper = Arc::default();
        let reopens = self.reopens;
        let mut filler = Filler {
            slot,
            hub,
            stopper: Arc::clone(&stopper),
            index: 0,
            every,
            pace: self.period.map(Pace::new),
            size: None,
        };
        let thread = std::thread::spawn(move || {
            let ended = filler.run(self);
            filler.slot.end(ended.err());
        });
        Feeder {
            thread,
            stopper,
            reopens,
        }
    }
}

impl Feeder {
    /// Closes a source that has been silent for too long, so that it is opened again.
    pub fn check(&self, hub: &Hub) {
        let stall = hub.limits().stall;
        let is_overdue = hub.tell(|pulse| pulse.is_overdue(Instant::now(), stall));
        if self.reopens
            && is_overdue
            && let Some(stop) = lock(&self.stopper).take()
        {
            hub.tell(|pulse| pulse.silenced(stall));
            stop();
        }
    }

    /// Ends a blocked read and waits for the thread for at most `patience`.
    pub fn end(self, patience: Duration) {
        if let Some(stop) = lock(&self.stopper).take() {
            stop();
        }
        // A blocked driver must not delay the end: its thread ends with the process.
        let until = Instant::now() + patience;
        while !self.thread.is_finished() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

struct Filler {
    slot: Arc<Slot>,
    hub: Arc<Hub>,
    stopper: Arc<Mutex<Option<Stopper>>>,
    index: u64,
    every: bool,
    pace: Option<Pace>,
    size: Option<(usize, usize)>,
}

impl Filler {
    fn run(&mut self, mut feed: Feed) -> Result<(), String> {
        let mut wait = RETRY.0;
        loop {
            let before = self.index;
            self.hub.tell(|pulse| pulse.progress(Instant::now()));
            let ended = self.deliver(&mut feed.open);
            *lock(&self.stopper) = None;
            if self.slot.is_closed() || !feed.reopens {
                return ended;
            }
            let reason = ended.err().unwrap_or_else(|| "ended".into());
            let reason = self.hub.tell(|pulse| {
                pulse.progress(Instant::now());
                pulse.failed(reason)
            });
            if self.index > before {
                wait = RETRY.0; // it worked for a while
            }
            say!(
                "source: {reason}; opening it again in {} ms",
                wait.as_millis()
            );
            self.sleep(wait);
            wait = (2 * wait).min(RETRY.1);
        }
    }

    /// Opens the source and puts its frames into the slot until it ends, fails, or the slot is
    /// closed.
    fn deliver(&mut self, open: &mut Open) -> Result<(), String> {
        let mut frames = open()?;
        *lock(&self.stopper) = frames.stopper();
        if let Some(pace) = &mut self.pace {
            pace.restart();
        }
        loop {
            let spare = self.slot.spare().map(|picture| picture.data);
            let Some(picture) = frames.next(spare.unwrap_or_default())? else {
                return Ok(());
            };
            if !self.put(picture) {
                return Ok(());
            }
        }
    }

    /// Puts a frame into the slot; returns `false` if the slot is closed.
    fn put(&mut self, picture: Picture) -> bool {
        if let Some(pace) = self.pace.as_mut().filter(|_| !self.every) {
            pace.wait(&self.hub);
        }
        let size = picture.size();
        if let Some((width, height)) = self.size.replace(size)
            && (width, height) != size
        {
            say!(
                "source: frame {}: {}x{} pixels, {width}x{height} before",
                self.index,
                size.0,
                size.1
            );
        }
        let print = fingerprint(&picture.data);
        let shot = Shot {
            picture,
            index: self.index,
            taken: Instant::now(),
        };
        self.index += 1;
        self.hub.tell(|pulse| {
            pulse.frame(shot.taken);
            pulse.picture(print, shot.taken);
        });
        let is_wanted = self.slot.put(shot, self.every);
        self.hub.tell(|pulse| pulse.frame(Instant::now()));
        is_wanted
    }

    fn sleep(&self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until && !self.slot.is_closed() {
            std::thread::sleep(TICK);
            self.hub.tell(|pulse| pulse.progress(Instant::now()));
        }
    }
}

/// Frames at a steady rate.
struct Pace {
    period: Duration,
    next: Instant,
}

impl Pace {
    fn new(period: Duration) -> Pace {
        Pace {
            period,
            next: Instant::now(),
        }
    }

    fn restart(&mut self) {
        self.next = Instant::now();
    }

    /// Waits for the next frame's time. The source counts as alive meanwhile.
    fn wait(&mut self, hub: &Hub) {
        let now = Instant::now();
        while Instant::now() < self.next && !hub.is_stopping() {
            let left = self.next.saturating_duration_since(Instant::now());
            std::thread::sleep(left.min(TICK));
            hub.tell(|pulse| pulse.progress(Instant::now()));
        }
        // A late frame delays the next ones too, which do not catch up.
        self.next = self.next.max(now) + self.period;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::health::Health;
    use crate::hub::Limits;
    use crate::slot::Next;
    use std::sync::mpsc::{Receiver, Sender, channel};

    /// A camera that delivers a number of frames and then hangs until it is stopped.
    struct Hanging {
        left: usize,
        stop: Sender<()>,
        stopped: Receiver<()>,
    }

    fn hanging(left: usize) -> Box<dyn Frames> {
        let (stop, stopped) = channel();
        Box::new(Hanging {
            left,
            stop,
            stopped,
        })
    }

    impl Frames for Hanging {
        fn next(&mut self, _: Vec<u8>) -> Result<Option<Picture>, String> {
            if self.left == 0 {
                let _ = self.stopped.recv();
                return Err("killed".into());
            }
            self.left -= 1;
            Ok(Some(Picture::dot()))
        }

        fn stopper(&self) -> Option<Stopper> {
            let stop = self.stop.clone();
            Some(Box::new(move || {
                let _ = stop.send(());
            }))
        }
    }

    fn start(reopens: bool) -> (Feeder, Arc<Slot>, Arc<Hub>) {
        let slot = Arc::new(Slot::default());
        let limits = Limits {
            stall: Duration::from_millis(150),
            ..Limits::default()
        };
        let hub = Arc::new(Hub::new(limits));
        let feed = Feed {
            open: Box::new(|| Ok(hanging(2))),
            reopens,
            period: None,
        };
        let feeder = feed.start(true, Arc::clone(&slot), Arc::clone(&hub));
        (feeder, slot, hub)
    }

    fn take(slot: &Slot) -> Option<u64> {
        match slot.take(Duration::from_secs(5)) {
            Next::Shot(shot) => Some(shot.index),
            _ => None,
        }
    }

    #[test]
    fn silent_source_is_closed_and_opened_again() {
        let (feeder, slot, hub) = start(true);
        assert_eq!((take(&slot), take(&slot)), (Some(0), Some(1)));

        std::thread::sleep(Duration::from_millis(250));
        let silent = hub.health();
        feeder.check(&hub);
        let closed = hub.health();
        let third = take(&slot);

        assert_eq!(silent, Health::Stalled);
        assert_eq!(closed, Health::Reconnecting);
        assert_eq!(third, Some(2));
        assert_eq!(hub.health(), Health::Live);
        slot.close();
        feeder.end(Duration::from_secs(1));
    }

    #[test]
    fn silent_pipe_stays_stalled() {
        let (feeder, slot, hub) = start(false);
        assert_eq!((take(&slot), take(&slot)), (Some(0), Some(1)));

        std::thread::sleep(Duration::from_millis(250));
        feeder.check(&hub);

        assert_eq!(hub.health(), Health::Stalled);
        slot.close();
        feeder.end(Duration::from_secs(1));
    }

    #[test]
    fn source_that_cannot_be_opened_is_tried_again() {
        let slot = Arc::new(Slot::default());
        let hub = Arc::new(Hub::new(Limits::default()));
        let mut attempts = 0;
        let feed = Feed {
            open: Box::new(move || {
                attempts += 1;
                if attempts == 1 {
                    return Err("no such device".into());
                }
                Ok(hanging(1))
            }),
            reopens: true,
            period: None,
        };
        let feeder = feed.start(false, Arc::clone(&slot), Arc::clone(&hub));

        assert_eq!(take(&slot), Some(0));
        slot.close();
        feeder.end(Duration::from_secs(1));
    }
}
