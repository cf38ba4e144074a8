//! The tracking thread: takes the newest frame, carries out commands, tracks, and publishes
//! reports.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::ages::Ages;
use crate::command::{Command, Outcome, Pending, Target};
use crate::commands::{self, Place};
use crate::engine::Engine;
use crate::error::Error;
use crate::feed::{Feed, Feeder};
use crate::film::{Film, FilmOptions};
use crate::health::Health;
use crate::http::{self, HttpOptions};
use crate::hub::{Hub, Limits};
use crate::lines::Lines;
use crate::log::{Asked, Log, LogOptions};
use crate::mavlink::{self, MavlinkOptions};
use crate::notify::Notifier;
use crate::picture::FrameBox;
use crate::report::{Report, TargetId};
use crate::say::{self, say};
use crate::slot::{Next, Shot, Slot};
use crate::targets::Targets;

/// How long the tracking thread waits for a frame before it looks at commands and the source.
const PATIENCE: Duration = Duration::from_millis(50);
/// How long the other threads may take to end.
const END_TIMEOUT: Duration = Duration::from_millis(1500);
/// Time between two JSON lines while the source delivers no frames.
const REMINDER: Duration = Duration::from_secs(1);

/// Options of a station.
#[derive(Clone, Debug)]
pub struct Options {
    /// Track every frame however long that takes, rather than the newest one.
    pub every_frame: bool,
    /// Time for one frame.
    pub deadline: Duration,
    /// Time from frame to frame where every frame is tracked: such frames have no live time.
    pub period: Duration,
    /// Limits on the age of frames and the silence of the source.
    pub limits: Limits,
    /// The targets in the first frame.
    pub init: Vec<FrameBox>,
    /// Whether JSON lines go to standard output.
    pub print: bool,
    /// Address to which JSON lines are sent as datagrams.
    pub udp: Option<String>,
    /// The flight log.
    pub log: Option<LogOptions>,
    /// First line of the flight log.
    pub head: Value,
    /// The MAVLink camera.
    pub mavlink: MavlinkOptions,
    /// The web page.
    pub http: HttpOptions,
    /// The video with boxes burned in.
    pub film: Option<FilmOptions>,
    /// Where commands come from as JSON lines.
    pub commands: Vec<Place>,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            every_frame: false,
            deadline: Duration::from_millis(33),
            period: Duration::from_micros(33_333),
            limits: Limits::default(),
            init: Vec::new(),
            print: false,
            udp: None,
            log: None,
            head: Value::Null,
            mavlink: MavlinkOptions::default(),
            http: HttpOptions::default(),
            film: None,
            commands: Vec::new(),
        }
    }
}

/// A station that has been set up, but reads no frame yet.
pub struct Station {
    options: Options,
    hub: Arc<Hub>,
}

impl Station {
    /// A station with these options.
    pub fn new(options: Options) -> Station {
        let hub = Arc::new(Hub::new(options.limits));
        Station { options, hub }
    }

    /// A function that ends the running station from another thread, such as a signal handler's.
    pub fn stopper(&self) -> impl Fn() + Send + Sync + 'static {
        let hub = Arc::clone(&self.hub);
        move || hub.stop()
    }

    /// Runs until the source ends or the station is stopped, and follows as many targets at a time
    /// as there are engines.
    ///
    /// # Errors
    /// If an option is unusable, or a source that is not opened again fails.
    pub fn run(self, engines: Vec<Box<dyn Engine + '_>>, feed: Feed) -> Result<(), Error> {
        let ran = self.run_threads(Targets::new(engines), feed);
        say::flush(END_TIMEOUT);
        ran
    }

    /// Starts the outputs and the feeder, tracks on this thread, and ends all threads again.
    fn run_threads(self, targets: Targets<'_>, feed: Feed) -> Result<(), Error> {
        let Station { options, hub } = self;
        let began = Instant::now();
        let log = options
            .log
            .clone()
            .map(|log| Log::create(log, options.head.clone()))
            .transpose()?;
        let lines = Lines::new(
            options.print,
            options.commands.contains(&Place::Stdin),
            options.udp.as_deref(),
            options.every_frame,
        )?;
        let mut threads = mavlink::start(&options.mavlink, &hub)?;
        if targets.room() > 1 && !options.mavlink.links.is_empty() {
            say!("mavlink: reports, and steers by, the target of the lowest number");
        }
        if let Some(page) = http::start(&options.http, &hub)? {
            threads.extend(page.threads);
        }
        threads.extend(commands::start(&options.commands, &hub, lines.printer())?);
        let slot = Arc::new(Slot::default());
        let film = options
            .film
            .clone()
            .map(|film| {
                let slot = Arc::clone(&slot);
                Film::start(film, move |picture| slot.recycle(picture))
            })
            .transpose()?;
        let feeder = feed.start(options.every_frame, Arc::clone(&slot), Arc::clone(&hub));

        let mut tracking = Tracking {
            options: &options,
            began,
            targets,
            hub: &hub,
            slot: &slot,
            log,
            lines,
            film,
            notifier: Notifier::connect(),
            health: Health::Waiting,
            reminder: began + REMINDER,
            ages: Ages::new(),
            late: 0,
            before: None,
        };
        let ran = tracking.run(&feeder);
        let Tracking {
            log,
            lines,
            film,
            ages,
            late,
            ..
        } = tracking;

        hub.stop();
        slot.close();
        feeder.end(END_TIMEOUT);
        if let Some(log) = log {
            log.finish();
        }
        lines.finish();
        if let Some(film) = film {
            let _ = film.finish(); // a failure is already reported
        }
        let until = Instant::now() + END_TIMEOUT;
        while threads.iter().any(|thread| !thread.is_finished()) && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(10));
        }
        say!(
            "{ages}; {} dropped for newer ones, {late} too old",
            slot.dropped()
        );
        ran
    }
}

/// The state of the tracking thread.
struct Tracking<'a> {
    options: &'a Options,
    began: Instant,
    targets: Targets<'a>,
    hub: &'a Hub,
    slot: &'a Slot,
    log: Option<Log>,
    lines: Lines,
    film: Option<Film>,
    notifier: Notifier,
    health: Health,
    reminder: Instant,
    ages: Ages,
    late: u64,
    before: Option<Instant>, // when the last frame was delivered
}

impl Tracking<'_> {
    fn run(&mut self, feeder: &Feeder) -> Result<(), Error> {
        while !self.hub.is_stopping() {
            match self.slot.take(PATIENCE) {
                Next::Nothing => {
                    for pending in self.hub.take_commands(false) {
                        if let Command::Stop { id } = pending.command {
                            pending.resolve(self.stop(id));
                        }
                    }
                }
                Next::Ended(reason) => {
                    self.hub.tell(|pulse| pulse.ended());
                    match reason {
                        Some(reason) => return Err(Error::Source(reason)),
                        None => break,
                    }
                }
                Next::Shot(shot) => self.frame(shot)?,
            }
            feeder.check(self.hub);
            self.watch_source()?;
        }
        self.notifier.stopping();
        Ok(())
    }

    /// Reports the health of the source to systemd, the log and the readers of JSON lines.
    fn watch_source(&mut self) -> Result<(), Error> {
        let health = self.hub.health();
        let reason = self.hub.tell(|pulse| pulse.reason.clone());
        self.notifier.tell(health, reason.as_deref());
        let now = Instant::now();
        let has_changed = std::mem::replace(&mut self.health, health) != health;
        if has_changed {
            let time_ms = now.duration_since(self.began).as_secs_f64() * 1e3;
            if health == Health::Stalled {
                let stall = self.options.limits.stall.as_secs_f64();
                say!("source: stalled, no frame for {stall:.1} s");
            }
            if health == Health::Frozen {
                let stall = self.options.limits.stall.as_secs_f64();
                say!("source: frozen, the same frame for {stall:.1} s; tracking goes on");
            }
            if let Some(log) = &mut self.log {
                log.source(time_ms, health, reason.as_deref());
            }
        }
        let is_silent = !health.delivers() && health != Health::Ended;
        let is_due = has_changed || now >= self.reminder;
        if is_silent && is_due && !self.options.every_frame {
            self.reminder = now + REMINDER;
            self.write_line()?;
        }
        Ok(())
    }

    /// Carries out the commands that wait, follows the targets in a frame, and reports them.
    fn frame(&mut self, shot: Shot) -> Result<(), Error> {
        let started = Instant::now();
        let commands = self.hub.take_commands(true);
        let mut asked = Vec::new();
        let before = self.before.replace(shot.taken);
        if before.is_none() {
            self.start_initial_targets(&shot, &mut asked)?;
        }
        for pending in commands {
            self.obey(&pending, &shot, &mut asked);
        }
        let every = self.options.every_frame;
        let elapsed = self.elapsed(before, shot.taken);
        let budget = self.budget(shot.taken);
        let targets = self.targets.follow(&shot.picture, elapsed, budget);
        let age = shot.taken.elapsed();
        let report = Report {
            frame: shot.index,
            time_ms: shot.taken.duration_since(self.began).as_secs_f64() * 1e3,
            elapsed,
            size: shot.picture.size(),
            room: self.targets.room(),
            targets,
            latency_ms: age.as_secs_f64() * 1e3,
            work_ms: started.elapsed().as_secs_f64() * 1e3,
            dropped: self.slot.dropped(),
            late: self.late,
            starts: self.targets.starts(),
            // A file has no live time: its frames are as new as their reports.
            taken: Some(if every { Instant::now() } else { shot.taken }),
        };
        if let Some(log) = &mut self.log {
            log.add(&asked, &report, &shot.picture);
        }
        let filmed = self.film.is_some().then(|| report.clone());
        self.publish(report, &shot, age)?;
        let left = match (&mut self.film, filmed) {
            (Some(film), Some(report)) => film.add(shot.picture, report),
            _ => Some(shot.picture),
        };
        if let Some(picture) = left {
            self.slot.recycle(picture);
        }
        Ok(())
    }

    /// Starts the targets that the options name. A refusal is an error unless a client can start
    /// one.
    fn start_initial_targets(&mut self, shot: &Shot, asked: &mut Vec<Asked>) -> Result<(), Error> {
        for &bbox in &self.options.init {
            match self.targets.start(None, &shot.picture, bbox, true) {
                Ok(id) => asked.push(Asked::Start { bbox, at: None, id }),
                Err(reason) if !self.has_clients() => return Err(Error::Refused(reason)),
                Err(reason) => say!("start refused: {reason}"),
            }
        }
        Ok(())
    }

    /// What a frame's age has left of the deadline, or all of it where every frame is tracked.
    fn budget(&self, taken: Instant) -> Duration {
        let deadline = self.options.deadline;
        if self.options.every_frame {
            deadline
        } else {
            deadline.saturating_sub(taken.elapsed())
        }
    }

    /// Publishes a report, unless its frame is too old.
    fn publish(&mut self, report: Report, shot: &Shot, age: Duration) -> Result<(), Error> {
        if age > self.options.limits.max_age && !self.options.every_frame {
            if self.late == 0 {
                let (age, max) = (age.as_millis(), self.options.limits.max_age.as_millis());
                say!("a result was {age} ms old, above --max-age-ms {max}; such ones are withheld");
            }
            self.late += 1;
            return Ok(());
        }
        for _ in &report.targets {
            self.ages.add(age);
        }
        self.hub.publish(report, &shot.picture);
        self.write_line()
    }

    /// Time from the frame `before` to one `taken` now, in whole microseconds as the log holds it.
    fn elapsed(&self, before: Option<Instant>, taken: Instant) -> Duration {
        let elapsed = match before {
            Some(before) if !self.options.every_frame => taken.saturating_duration_since(before),
            _ => self.options.period,
        };
        Duration::from_micros(u64::try_from(elapsed.as_micros()).unwrap_or(u64::MAX))
    }

    /// Carries out a command on a frame and resolves its receipt.
    fn obey(&mut self, pending: &Pending, shot: &Shot, asked: &mut Vec<Asked>) {
        let outcome = match pending.command {
            Command::Stop { id } => {
                let outcome = self.stop(id);
                if outcome == Outcome::Done {
                    asked.push(Asked::Stop { id });
                }
                outcome
            }
            Command::Start { target, frame, id } => match self.start(target, frame, id, shot) {
                Ok((id, start)) => {
                    asked.push(start);
                    Outcome::Started(id)
                }
                Err(reason) => {
                    say!("start refused: {reason}");
                    Outcome::Refused(reason)
                }
            },
        };
        pending.resolve(outcome);
    }

    fn stop(&mut self, id: Option<TargetId>) -> Outcome {
        match self.targets.stop(id) {
            Ok(()) => Outcome::Done,
            Err(reason) => Outcome::Refused(reason),
        }
    }

    /// Starts on the frame in which the client saw the target, if it is still kept.
    fn start(
        &mut self,
        target: Target,
        frame: Option<u64>,
        id: Option<TargetId>,
        shot: &Shot,
    ) -> Result<(TargetId, Asked), String> {
        let earlier = frame
            .filter(|frame| *frame != shot.index)
            .and_then(|frame| Some((frame, self.hub.pictures().find(frame)?)));
        let at = earlier.as_ref().map(|(frame, _)| *frame);
        let picture = earlier
            .as_ref()
            .map_or(&shot.picture, |(_, picture)| picture);
        let bbox = target.in_frame(picture.size())?;
        let id = self.targets.start(id, picture, bbox, at.is_none())?;
        Ok((id, Asked::Start { bbox, at, id }))
    }

    /// Writes the newest report. If its reader has gone, the program ends unless it has other
    /// outputs.
    fn write_line(&mut self) -> Result<(), Error> {
        match self.lines.write(&self.hub.view()) {
            Err(Error::ClosedPipe) if self.has_other_outputs() => {
                say!("standard output: its reader has gone; tracking goes on");
                self.lines.silence();
                Ok(())
            }
            written => written,
        }
    }

    fn has_other_outputs(&self) -> bool {
        self.options.udp.is_some() || self.options.log.is_some() || self.has_clients()
    }

    /// Whether a client may start a target.
    fn has_clients(&self) -> bool {
        let options = self.options;
        options.http.address.is_some()
            || !options.mavlink.links.is_empty()
            || !options.commands.is_empty()
    }
}
