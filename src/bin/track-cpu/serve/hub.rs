//! What the tracking thread and its clients share: commands in, the newest report and picture out.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use track_cpu::source::Image;
use track_cpu::{BBox, Frame};

use super::report::Report;

/// Most commands that wait; more are refused.
const MAX_WAITING: usize = 32;

/// What a client may ask for; places are shares of the frame's width and height, 0..1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Command {
    /// Follow what is inside this rectangle: left, top, right, bottom.
    Rectangle([f32; 4]),
    /// Follow what is at this point; the radius is a share of the width, or not known.
    Point {
        /// Horizontally.
        x: f32,
        /// Vertically.
        y: f32,
        /// Of the object.
        radius: Option<f32>,
    },
    /// Follow what is inside this box of frame pixels.
    Box(BBox),
    /// Follow nothing.
    Stop,
}

/// Side of the box around a point without a radius, as a share of the frame's height.
const POINT_SIDE: f32 = 0.12;

impl Command {
    /// The box in pixels of a frame, where this starts tracking; no claim that it is a good one.
    pub fn bbox(&self, frame: &Frame<'_>) -> Option<BBox> {
        let (w, h) = (frame.width() as f32, frame.height() as f32);
        match *self {
            Command::Rectangle([x1, y1, x2, y2]) => {
                let (left, right) = (x1.min(x2) * w, x1.max(x2) * w);
                let (top, bottom) = (y1.min(y2) * h, y1.max(y2) * h);
                Some(BBox::new(left, top, right - left, bottom - top))
            }
            Command::Point { x, y, radius } => {
                let side = radius
                    .filter(|r| *r > 0.0)
                    .map_or(POINT_SIDE * h, |r| 2.0 * r.min(0.5) * w)
                    .max(8.0);
                Some(BBox::new(
                    x * w - side / 2.0,
                    y * h - side / 2.0,
                    side,
                    side,
                ))
            }
            Command::Box(bbox) => Some(bbox),
            Command::Stop => None,
        }
    }

    /// Whether its numbers make sense for a client's request.
    pub fn is_sound(&self) -> bool {
        let within = |v: &f32| (-0.05..=1.05).contains(v);
        match self {
            Command::Rectangle(r) => r.iter().all(within) && r[0] != r[2] && r[1] != r[3],
            Command::Point { x, y, .. } => within(x) && within(y),
            Command::Box(bbox) => bbox.is_finite() && bbox.w > 0.0 && bbox.h > 0.0,
            Command::Stop => true,
        }
    }
}

/// The newest report and its number.
type Published = (u64, Arc<Report>);

/// The meeting point.
#[derive(Debug)]
pub struct Hub {
    stop: AtomicBool,
    commands: Mutex<VecDeque<Command>>,
    report: Mutex<Published>,
    changed: Condvar,
    viewers: AtomicUsize,
    streams: AtomicUsize,
    picture: Mutex<Option<Image>>,
}

impl Hub {
    /// Nothing has happened yet.
    pub fn new() -> Hub {
        Hub {
            stop: AtomicBool::new(false),
            commands: Mutex::default(),
            report: Mutex::new((0, Arc::default())),
            changed: Condvar::new(),
            viewers: AtomicUsize::new(0),
            streams: AtomicUsize::new(0),
            picture: Mutex::default(),
        }
    }

    /// Asks everything to end.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::SeqCst);
        self.changed.notify_all();
    }

    /// Whether everything is to end.
    pub fn is_stopping(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }

    /// Hands a command to the tracking thread; `false` if it makes no sense or too many wait.
    pub fn command(&self, command: Command) -> bool {
        let mut commands = lock(&self.commands);
        let accepted = command.is_sound() && commands.len() < MAX_WAITING;
        if accepted {
            commands.push_back(command);
        }
        accepted
    }

    /// The commands that wait, in their order.
    pub fn take_commands(&self) -> VecDeque<Command> {
        std::mem::take(&mut lock(&self.commands))
    }

    /// Publishes a report, and the frame if anybody watches.
    pub fn publish(&self, report: Report, frame: &Image) {
        if self.viewers() > 0
            && let Ok(mut picture) = self.picture.try_lock()
        {
            match &mut *picture {
                Some(kept) => kept.clone_from(frame),
                None => *picture = Some(frame.clone()),
            }
        }
        let mut published = lock(&self.report);
        *published = (published.0 + 1, Arc::new(report));
        self.changed.notify_all();
    }

    /// The newest report.
    pub fn report(&self) -> Published {
        lock(&self.report).clone()
    }

    /// The newest report after number `seen`; the same again if none comes within `patience`.
    pub fn report_after(&self, seen: u64, patience: Duration) -> Published {
        let published = lock(&self.report);
        let waiting = |published: &mut Published| published.0 == seen && !self.is_stopping();
        let waited = self
            .changed
            .wait_timeout_while(published, patience, waiting);
        waited.unwrap_or_else(PoisonError::into_inner).0.clone()
    }

    /// Works on the newest picture, if there is one.
    pub fn with_picture<T>(&self, work: impl FnOnce(&Image) -> T) -> Option<T> {
        // Copied out, so that the tracking thread finds the place free.
        let image = lock(&self.picture).clone()?;
        Some(work(&image))
    }

    /// How many watch the video.
    pub fn viewers(&self) -> usize {
        self.viewers.load(Ordering::Relaxed)
    }

    /// How many watch anything.
    pub fn streams(&self) -> usize {
        self.streams.load(Ordering::Relaxed)
    }

    /// One more watches, the video or only the reports, until the token is dropped.
    pub fn watch(self: &Arc<Hub>, video: bool) -> Viewer {
        self.streams.fetch_add(1, Ordering::Relaxed);
        self.viewers
            .fetch_add(usize::from(video), Ordering::Relaxed);
        Viewer {
            hub: Arc::clone(self),
            video,
        }
    }
}

/// Somebody who watches.
#[derive(Debug)]
pub struct Viewer {
    hub: Arc<Hub>,
    video: bool,
}

impl Drop for Viewer {
    fn drop(&mut self) {
        self.hub.streams.fetch_sub(1, Ordering::Relaxed);
        self.hub
            .viewers
            .fetch_sub(usize::from(self.video), Ordering::Relaxed);
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;
    use track_cpu::ChannelOrder;

    #[test]
    fn commands_become_boxes() {
        let data = vec![0; 200 * 100];
        let frame = Frame::new(&data, 200, 100, ChannelOrder::Gray).unwrap();
        let rectangle = Command::Rectangle([0.75, 0.5, 0.25, 0.1]);
        assert_eq!(
            rectangle.bbox(&frame),
            Some(BBox::new(50.0, 10.0, 100.0, 40.0))
        );
        let point = Command::Point {
            x: 0.5,
            y: 0.5,
            radius: Some(0.1),
        };
        assert_eq!(point.bbox(&frame), Some(BBox::new(80.0, 30.0, 40.0, 40.0)));
        assert_eq!(Command::Stop.bbox(&frame), None);
    }

    #[test]
    fn senseless_and_too_many_commands_are_refused() {
        let hub = Hub::new();
        for bad in [
            Command::Rectangle([f32::NAN, 0.0, 1.0, 1.0]),
            Command::Rectangle([0.5, 0.5, 0.5, 0.9]),
            Command::Rectangle([0.0, 0.0, 7.0, 1.0]),
            Command::Point {
                x: 0.5,
                y: f32::INFINITY,
                radius: None,
            },
        ] {
            assert!(!hub.command(bad), "{bad:?}");
        }
        assert!((0..MAX_WAITING).all(|_| hub.command(Command::Stop)));
        assert!(!hub.command(Command::Stop));
        assert_eq!(hub.take_commands().len(), MAX_WAITING);
        assert!(hub.command(Command::Stop));
    }
}
