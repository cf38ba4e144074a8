//! What the tracking thread and its clients share: commands in, the newest report and pictures out.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use crate::command::{Command, Outcome, Pending, Receipt};
use crate::health::{Health, Pulse};
use crate::picture::Picture;
use crate::report::{Freshness, Report, View};
use crate::ring::Ring;

/// Most commands that wait; further ones are refused.
const MAX_WAITING: usize = 32;

/// Limit of the time between two frames, which extends how long a report stays fresh.
const MAX_INTERVAL: Duration = Duration::from_secs(1);

/// Limits on the age of reports and the silence of a source.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Age of a frame above which its report is stale.
    pub max_age: Duration,
    /// Silence after which a source is stalled.
    pub stall: Duration,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            max_age: Duration::from_millis(250),
            stall: Duration::from_secs(2),
        }
    }
}

/// The newest report.
#[derive(Clone, Debug, Default)]
struct Published {
    number: u64,
    report: Arc<Report>,
    interval: Duration, // between the last two frames
}

/// The state shared by the tracking thread, the feeding thread and all clients.
#[derive(Debug)]
pub struct Hub {
    limits: Limits,
    stop: AtomicBool,
    commands: Mutex<VecDeque<Pending>>,
    published: Mutex<Published>,
    changed: Condvar,
    pulse: Mutex<Pulse>,
    viewers: AtomicUsize,
    pictures: Mutex<Ring>,
}

impl Hub {
    /// A hub without reports.
    pub fn new(limits: Limits) -> Hub {
        Hub {
            limits,
            stop: AtomicBool::new(false),
            commands: Mutex::default(),
            published: Mutex::default(),
            changed: Condvar::new(),
            pulse: Mutex::new(Pulse::new(Instant::now())),
            viewers: AtomicUsize::new(0),
            pictures: Mutex::default(),
        }
    }

    /// Asks all threads to end.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::SeqCst);
        self.changed.notify_all();
    }

    /// Whether all threads are to end.
    pub fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }

    /// The limits on ages and silence.
    pub fn limits(&self) -> Limits {
        self.limits
    }

    /// Updates or reads the pulse of the source.
    pub fn tell<T>(&self, tell: impl FnOnce(&mut Pulse) -> T) -> T {
        tell(&mut lock(&self.pulse))
    }

    /// Health of the source now.
    pub fn health(&self) -> Health {
        lock(&self.pulse).health(Instant::now(), self.limits.stall)
    }

    /// Queues a command for the tracking thread.
    ///
    /// The receipt is resolved at once if the command is invalid, if too many wait, or if it starts
    /// a target while the source delivers no frames.
    pub fn command(&self, command: Command) -> Receipt {
        if let Err(reason) = command.check() {
            return Receipt::resolved(Outcome::Refused(reason));
        }
        if command.needs_frames() && !self.health().delivers() {
            return Receipt::resolved(Outcome::NoFrames);
        }
        let mut commands = lock(&self.commands);
        if commands.len() >= MAX_WAITING {
            return Receipt::resolved(Outcome::Busy);
        }
        let (pending, receipt) = Pending::new(command, Instant::now());
        commands.push_back(pending);
        receipt
    }

    /// Takes the commands that can be carried out now, in their order: without a frame, those that
    /// need none. Expired ones are resolved.
    pub fn take_commands(&self, with_frame: bool) -> VecDeque<Pending> {
        let now = Instant::now();
        let mut commands = lock(&self.commands);
        let mut taken = VecDeque::new();
        for pending in std::mem::take(&mut *commands) {
            if pending.is_expired(now) {
                pending.resolve(Outcome::Expired);
            } else if with_frame || !pending.command.needs_frames() {
                taken.push_back(pending);
            } else {
                commands.push_back(pending);
            }
        }
        taken
    }

    /// Publishes a report, and keeps its frame if anybody watches.
    pub fn publish(&self, report: Report, frame: &Picture) {
        if let Ok(mut pictures) = self.pictures.try_lock() {
            if self.viewers() > 0 {
                pictures.add(report.frame, frame);
            } else {
                pictures.release();
            }
        }
        let mut published = lock(&self.published);
        let before = published.report.taken;
        if let (Some(before), Some(taken)) = (before, report.taken) {
            published.interval = taken.saturating_duration_since(before).min(MAX_INTERVAL);
        }
        published.number += 1;
        published.report = Arc::new(report);
        self.changed.notify_all();
    }

    /// The newest report, with its age and freshness now.
    pub fn view(&self) -> View {
        let published = lock(&self.published).clone();
        self.look_at(published)
    }

    /// The first report after number `seen`, or that one again if none comes within `patience`.
    pub fn view_after(&self, seen: u64, patience: Duration) -> View {
        let published = lock(&self.published);
        let waiting = |published: &mut Published| published.number == seen && !self.is_stopping();
        let waited = self
            .changed
            .wait_timeout_while(published, patience, waiting);
        let published = waited.unwrap_or_else(PoisonError::into_inner).0.clone();
        self.look_at(published)
    }

    fn look_at(&self, published: Published) -> View {
        let now = Instant::now();
        let age = published
            .report
            .taken
            .map(|taken| now.saturating_duration_since(taken));
        // A slow camera's report must last until the next frame; one frame may be missing.
        let fresh_for = self.limits.max_age + 2 * published.interval;
        let freshness = match age {
            Some(age) if age <= fresh_for.min(self.limits.stall) => Freshness::Fresh,
            Some(age) if age <= self.limits.stall => Freshness::Stale,
            _ => Freshness::Dead,
        };
        View {
            number: published.number,
            report: published.report,
            age,
            freshness,
            health: self.health(),
            interval: published.interval,
        }
    }

    /// Locks the pictures kept for viewers.
    pub fn pictures(&self) -> MutexGuard<'_, Ring> {
        lock(&self.pictures)
    }

    /// The number of viewers of the video.
    pub fn viewers(&self) -> usize {
        self.viewers.load(Ordering::Relaxed)
    }

    /// Counts one more viewer of the video until the token is dropped.
    pub fn watch(self: &Arc<Hub>) -> Viewer {
        self.viewers.fetch_add(1, Ordering::Relaxed);
        Viewer {
            hub: Arc::clone(self),
        }
    }
}

/// A viewer of the video.
#[derive(Debug)]
pub struct Viewer {
    hub: Arc<Hub>,
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.hub.viewers.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Locks a mutex; data that a panicking thread left behind is used as it is.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::Target;
    use crate::report::{Followed, Tracked};

    const STOP: Command = Command::Stop { id: None };

    fn live_hub(limits: Limits) -> Hub {
        let hub = Hub::new(limits);
        hub.tell(|pulse| pulse.frame(Instant::now()));
        hub
    }

    fn middle() -> Command {
        Command::Start {
            target: Target::Rectangle([0.4, 0.4, 0.6, 0.6]),
            frame: None,
            id: None,
        }
    }

    #[test]
    fn start_without_frames_is_refused_at_once() {
        let hub = Hub::new(Limits::default());

        assert_eq!(hub.command(middle()).outcome(), Some(Outcome::NoFrames));
        assert_eq!(hub.command(STOP).outcome(), None);
    }

    #[test]
    fn start_waits_for_a_frame_and_stop_does_not() {
        let hub = live_hub(Limits::default());
        let start = hub.command(middle());
        let stop = hub.command(STOP);

        let without = hub.take_commands(false);
        let with = hub.take_commands(true);

        assert_eq!(without.len(), 1);
        assert_eq!(without[0].command, STOP);
        assert_eq!(with.len(), 1);
        with[0].resolve(Outcome::Done);
        assert_eq!(start.outcome(), Some(Outcome::Done));
        assert_eq!(stop.outcome(), None);
    }

    #[test]
    fn too_many_commands_are_refused() {
        let hub = live_hub(Limits::default());
        for _ in 0..MAX_WAITING {
            assert_eq!(hub.command(STOP).outcome(), None);
        }

        assert_eq!(hub.command(STOP).outcome(), Some(Outcome::Busy));
    }

    #[test]
    fn report_ages_from_fresh_to_dead() {
        let limits = Limits {
            max_age: Duration::from_millis(40),
            stall: Duration::from_millis(150),
        };
        let hub = live_hub(limits);
        let target = Followed {
            id: 1,
            start: 1,
            track: Tracked::certain(Default::default()),
        };
        let report = Report {
            taken: Some(Instant::now()),
            targets: vec![target],
            ..Report::default()
        };
        let picture = Picture::dot();

        hub.publish(report, &picture);

        assert_eq!(hub.view().state(), "tracking");
        std::thread::sleep(Duration::from_millis(60));
        assert_eq!(hub.view().state(), "stale");
        assert!(hub.view().first().is_none());
        std::thread::sleep(Duration::from_millis(120));
        assert_eq!(hub.view().freshness, Freshness::Dead);
        assert_eq!(hub.view().health, Health::Stalled);
    }
}
