//! `serve`: the live program. Frames in from a camera or stream, boxes out to people, programs and autopilots.
//!
//! | file | what happens there |
//! |---|---|
//! | `sources.rs`, `camera.rs` | threads that deliver frames and open what failed again |
//! | `slot.rs` | latest frame wins |
//! | `engine.rs` | the tracker, run the same way here and in `replay.rs` |
//! | `hub.rs`, `report.rs` | commands in, reports out |
//! | `ages.rs` | how old frames were when their boxes went out |
//! | `log.rs`, `replay.rs` | the flight log and doing it again |
//! | `watchdog.rs` | signs of life for systemd |
//! | `mavlink/` | the camera that autopilots and ground stations see |
//! | `http/` | the web ground station |

mod ages;
pub mod args;
#[cfg(target_os = "linux")]
mod camera;
#[cfg(not(target_os = "linux"))]
mod camera {
    //! No cameras but through a pipe.

    /// Says so.
    pub fn run(
        path: &std::path::Path,
        _: Option<(usize, usize)>,
        _: &mut super::sources::Filler<'_>,
    ) -> Result<(), String> {
        Err(format!(
            "{}: cameras are read on Linux only: pipe the frames in (--input -)",
            path.display()
        ))
    }
}
mod engine;
mod http;
mod hub;
mod log;
mod mavlink;
pub mod replay;
mod report;
mod slot;
mod sources;
mod watchdog;

use std::io::Write;
use std::net::UdpSocket;
use std::sync::Arc;
use std::time::{Duration, Instant};

use serde_json::json;
use track_cpu::source::SourceError;

use crate::exit::Failure;
use ages::Ages;
use args::ServeArgs;
use engine::Engine;
use hub::{Command, Hub};
use log::{Asked, Log};
use report::Report;
use slot::{Next, Shot, Slot};
use sources::Feed;
use track_cpu::flight::Budget;
use watchdog::Watchdog;

/// How long the tracking thread waits for a frame before it looks whether it is to end.
const PATIENCE: Duration = Duration::from_millis(100);

/// Runs the sub-command.
pub fn run(args: &ServeArgs) -> Result<(), Failure> {
    let began = Instant::now();
    let model = args.engine.model(args.model.as_deref())?;
    let input = args.input.display().to_string();
    let wrong = |reason: String| {
        Failure::Input(SourceError::Format {
            input: input.clone(),
            reason,
        })
    };
    let feed = Feed::new(&args.input, args.raw_format(), args.raw).map_err(wrong)?;
    let head = json!({
        "log": "track-cpu",
        "version": log::VERSION,
        "input": input,
        "repeats": feed.repeats(),
        "model": args.model.as_ref().map(|path| path.display().to_string()),
        "weights": model.header().provenance.name,
        "isa": args.engine.isa().name(),
        "precision": model.precision().name(),
        "correction": model.config().correction,
        "template_update": model.config().template_update,
        "online_filter": model.config().online_filter,
        "mode": args.mode.name(),
    });
    let log = args
        .log
        .as_deref()
        .map(|path| Log::create(path, args.log_frames.as_deref(), &head))
        .transpose()?;
    let engine = Engine::new(model, &args.engine, args.mode)?;
    let hub = Arc::new(Hub::new());
    let stopper = Arc::clone(&hub);
    ctrlc::set_handler(move || stopper.stop()).map_err(|error| Failure::Output {
        output: "signals".into(),
        reason: error.to_string(),
    })?;
    let mut threads = mavlink::start(&args.mavlink, &hub)?;
    threads.extend(http::start(&args.http, &hub)?);
    let slot = Arc::new(Slot::default());
    let feeder = feed.start(args.fps, args.every_frame, Arc::clone(&slot));

    let lines = Lines::new(!args.quiet, args.udp.as_deref())?;
    let mut serving = Serving {
        args,
        began,
        engine,
        hub: &hub,
        slot: &slot,
        log,
        lines,
        ages: Ages::new(),
        late: 0,
        first: true,
    };
    let served = serving.until_the_end();
    hub.stop();
    slot.close();
    if let Some(log) = serving.log.take() {
        log.finish();
    }
    // A blocked camera must not hold up the end: its thread ends with the process.
    let until = Instant::now() + Duration::from_millis(500);
    while !feeder.is_finished() && Instant::now() < until {
        std::thread::sleep(Duration::from_millis(10));
    }
    threads.into_iter().for_each(|thread| drop(thread.join()));
    eprintln!(
        "{}; {} dropped for newer ones, {} too old",
        serving.ages,
        slot.dropped(),
        serving.late
    );
    served
}

/// The tracking thread's belongings.
struct Serving<'a> {
    args: &'a ServeArgs,
    began: Instant,
    engine: Engine,
    hub: &'a Hub,
    slot: &'a Slot,
    log: Option<Log>,
    lines: Lines,
    ages: Ages,
    late: u64,
    first: bool,
}

impl Serving<'_> {
    fn until_the_end(&mut self) -> Result<(), Failure> {
        let mut watchdog = Watchdog::start();
        while !self.hub.is_stopping() {
            watchdog.live();
            match self.slot.take(PATIENCE) {
                Next::Nothing => {}
                Next::Ended(None) => break,
                Next::Ended(Some(reason)) => {
                    let input = self.args.input.display().to_string();
                    return Err(Failure::Input(SourceError::Format { input, reason }));
                }
                Next::Shot(shot) => self.frame(shot)?,
            }
        }
        watchdog.stopping();
        Ok(())
    }

    fn frame(&mut self, shot: Shot) -> Result<(), Failure> {
        let started = Instant::now();
        let frame = shot.image.frame();
        let mut commands = self.hub.take_commands();
        if std::mem::take(&mut self.first)
            && let Some(bbox) = self.args.init
        {
            commands.push_front(Command::Box(bbox));
        }
        let (mut asked, mut fresh) = (Vec::new(), None);
        for command in commands {
            match command.bbox(&frame) {
                Some(bbox) => match self.engine.start(&frame, bbox) {
                    Ok(track) => {
                        asked.push(Asked::Start(bbox));
                        fresh = Some(track);
                    }
                    Err(error) => eprintln!("start refused: {error}"),
                },
                None => {
                    self.engine.stop();
                    asked.push(Asked::Stop);
                    fresh = None;
                }
            }
        }
        // What the frame's age has used of the deadline is gone.
        let left = self.args.deadline_ms.saturating_sub(shot.taken.elapsed());
        let budget = if self.args.every_frame {
            self.args.deadline_ms
        } else {
            left
        };
        let track = fresh.or_else(|| self.engine.follow(&frame, Budget::Deadline(budget)));
        let age = shot.taken.elapsed();
        let report = Report {
            frame: shot.index,
            time_ms: shot.taken.duration_since(self.began).as_secs_f64() * 1e3,
            size: (shot.image.width, shot.image.height),
            track,
            latency_ms: age.as_secs_f64() * 1e3,
            work_ms: started.elapsed().as_secs_f64() * 1e3,
            dropped: self.slot.dropped(),
            late: self.late,
        };
        if let Some(log) = &mut self.log {
            log.add(&asked, &report, &shot.image)?;
        }
        if age > self.args.max_age_ms && !self.args.every_frame {
            self.late += 1;
        } else {
            if report.track.is_some() {
                self.ages.add(age);
            }
            self.lines.write(&report)?;
            self.hub.publish(report, &shot.image);
        }
        self.slot.recycle(shot.image);
        Ok(())
    }
}

/// JSON lines on standard output and as datagrams.
struct Lines {
    print: bool,
    socket: Option<UdpSocket>,
}

impl Lines {
    fn new(print: bool, udp: Option<&str>) -> Result<Lines, Failure> {
        let connect = |address: &str| -> std::io::Result<UdpSocket> {
            let any = if address.starts_with('[') {
                "[::]:0"
            } else {
                "0.0.0.0:0"
            };
            let socket = UdpSocket::bind(any)?;
            socket.connect(address)?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        };
        let output = |error: std::io::Error| Failure::Output {
            output: format!("--udp {}", udp.unwrap_or_default()),
            reason: error.to_string(),
        };
        Ok(Lines {
            print,
            socket: udp.map(connect).transpose().map_err(output)?,
        })
    }

    fn write(&mut self, report: &Report) -> Result<(), Failure> {
        if !self.print && self.socket.is_none() {
            return Ok(());
        }
        let line = report.to_json().to_string();
        if let Some(socket) = &self.socket {
            let _ = socket.send(line.as_bytes()); // nobody listening is no fault of ours
        }
        if self.print {
            let mut out = std::io::stdout().lock();
            let written = writeln!(out, "{line}").and_then(|()| out.flush());
            written.map_err(|error| Failure::stdout(&error))?;
        }
        Ok(())
    }
}
