//! What is measured, in which order.

use std::time::{Duration, Instant};

use track_cpu::source::{Input, Source};
use track_cpu::{Frame, Model, Tracker, TrackerOptions};

use super::clip::{Clip, there_and_back};
use crate::args::bench::MeasureArgs;
use crate::exit::Failure;
use crate::statistics::Times;

/// How long one window of the endurance run is.
const WINDOW: Duration = Duration::from_secs(10);

/// All that was measured.
pub struct Measured {
    /// `init`, once every buffer has been touched.
    pub init_ms: f64,
    /// `update`, frame by frame.
    pub frames: Times,
    /// The same per stage.
    pub stages: Vec<(&'static str, Times)>,
    /// Reading and decoding a JPEG before each `update`.
    pub decoding: Option<Decoding>,
    /// `update` with other numbers of threads.
    pub sweep: Vec<(usize, Times)>,
    /// `update` over minutes: median of each window.
    pub endurance: Vec<Window>,
}

/// Frames that come from JPEG files, one after the other on the same thread.
pub struct Decoding {
    /// Reading and decoding.
    pub decode: Times,
    /// Reading, decoding and `update`.
    pub all: Times,
}

/// A stretch of the endurance run.
pub struct Window {
    /// Seconds from the start to its end.
    pub until_s: f64,
    /// Its frames' median in milliseconds.
    pub median_ms: f64,
}

/// Updates that will be done, as far as their number is known.
pub fn steps(args: &MeasureArgs, threads: &[usize]) -> usize {
    let decoding = if args.decode { args.frames } else { 0 };
    args.frames + args.frames / 10 + decoding + threads.len() * sweep_frames(args)
}

fn sweep_frames(args: &MeasureArgs) -> usize {
    (args.frames / 4).max(2)
}

/// Measures everything that the arguments ask for; `tick` is told of each frame.
pub fn measure(
    args: &MeasureArgs,
    model: &Model,
    clip: &Clip,
    threads: &[usize],
    tick: impl Fn(),
) -> Result<Measured, Failure> {
    let frames = clip.frames()?;
    let make = |threads| {
        Tracker::with_options(
            model.clone(),
            TrackerOptions {
                threads,
                ..args.network.engine.options(model)
            },
        )
    };
    let mut tracker = make(args.network.engine.threads);
    tracker.init(&frames[0], clip.target)?; // the first call also touches every buffer
    let started = Instant::now();
    tracker.init(&frames[0], clip.target)?;
    let init_ms = started.elapsed().as_secs_f64() * 1e3;

    let mut order = there_and_back(frames.len()).map(|i| &frames[i]);
    warm_up(&mut tracker, &mut order, args.frames / 10, &tick)?;
    let (times, stages) = updates(&mut tracker, &mut order, args.frames, &tick)?;
    let decoding = if args.decode {
        Some(decoding(&mut tracker, clip, args.frames, &tick)?)
    } else {
        None
    };
    let mut sweep = Vec::new();
    for &threads in threads {
        let (mut tracker, count) = (make(threads), sweep_frames(args));
        tracker.init(&frames[0], clip.target)?;
        let mut order = there_and_back(frames.len()).map(|i| &frames[i]);
        warm_up(&mut tracker, &mut order, count / 10, &|| {})?;
        sweep.push((threads, updates(&mut tracker, &mut order, count, &tick)?.0));
    }
    let long = Duration::from_secs_f64(60.0 * args.minutes.unwrap_or(0.0));
    let endurance = endurance(&mut tracker, &mut order, long)?;
    Ok(Measured {
        init_ms,
        frames: times,
        stages,
        decoding,
        sweep,
        endurance,
    })
}

fn warm_up<'a>(
    tracker: &mut Tracker,
    order: &mut impl Iterator<Item = &'a Frame<'a>>,
    count: usize,
    tick: &impl Fn(),
) -> Result<(), Failure> {
    for frame in order.take(count) {
        tracker.update(frame)?;
        tick();
    }
    Ok(())
}

type StageTimes = Vec<(&'static str, Times)>;

fn updates<'a>(
    tracker: &mut Tracker,
    order: &mut impl Iterator<Item = &'a Frame<'a>>,
    count: usize,
    tick: &impl Fn(),
) -> Result<(Times, StageTimes), Failure> {
    let mut times = Vec::with_capacity(count);
    let mut stages: Vec<(&'static str, Vec<Duration>)> = Vec::new();
    for frame in order.take(count) {
        let started = Instant::now();
        tracker.update(frame)?;
        times.push(started.elapsed());
        for (i, (name, time)) in tracker.stages().iter().enumerate() {
            if stages.len() <= i {
                stages.push((name, Vec::with_capacity(count)));
            }
            stages[i].1.push(time);
        }
        tick();
    }
    let stages = stages
        .into_iter()
        .map(|(name, times)| (name, Times::new(&times)))
        .collect();
    Ok((Times::new(&times), stages))
}

fn decoding(
    tracker: &mut Tracker,
    clip: &Clip,
    count: usize,
    tick: &impl Fn(),
) -> Result<Decoding, Failure> {
    let pictures = clip.write()?;
    let paths: Vec<_> = pictures.paths().collect();
    let (mut decode, mut all) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for (index, i) in there_and_back(paths.len()).take(count).enumerate() {
        let started = Instant::now();
        let mut source = Source::open(&Input::new(paths[i]))?;
        let Some(image) = source.next() else { continue };
        let image = image.map_err(Failure::at_frame(index))?;
        decode.push(started.elapsed());
        tracker.update(&image.frame())?;
        all.push(started.elapsed());
        tick();
    }
    Ok(Decoding {
        decode: Times::new(&decode),
        all: Times::new(&all),
    })
}

fn endurance<'a>(
    tracker: &mut Tracker,
    order: &mut impl Iterator<Item = &'a Frame<'a>>,
    long: Duration,
) -> Result<Vec<Window>, Failure> {
    let began = Instant::now();
    let mut windows = Vec::new();
    while began.elapsed() < long {
        let (start, mut times) = (Instant::now(), Vec::new());
        while start.elapsed() < WINDOW && began.elapsed() < long {
            let Some(frame) = order.next() else { break };
            let started = Instant::now();
            tracker.update(frame)?;
            times.push(started.elapsed());
        }
        let median_ms = Times::new(&times).percentile(0.5);
        windows.push(Window {
            until_s: began.elapsed().as_secs_f64(),
            median_ms,
        });
    }
    Ok(windows)
}
