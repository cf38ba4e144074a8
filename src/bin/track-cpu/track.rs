//! `track`: an input, a box, and a line per frame.

use std::fs::File;
use std::io::{IsTerminal, LineWriter, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use serde_json::json;
use track_cpu::BBox;
use track_cpu::source::{Input, Prefetch, Source};

use crate::args::TrackArgs;
use crate::exit::Failure;
use crate::follow::{Follower, Found};
use crate::painter::Painter;
use crate::report::{progress, rounded};
use crate::statistics::Times;

/// Frames decoded ahead.
const AHEAD: usize = 3;

/// Runs the sub-command.
pub fn run(args: &TrackArgs) -> Result<(), Failure> {
    let model = args.engine.model(args.model.as_deref())?;
    let input = Input {
        location: args.input.clone(),
        raw: args.raw(),
        start: args.start,
        end: args.end,
    };
    let source = Source::open(&input)?;
    // On one terminal, boxes and a bar would overwrite each other.
    let bar = match args.out.is_none() && std::io::stdout().is_terminal() {
        true => ProgressBar::hidden(),
        false => progress(source.frames_left()),
    };
    let mut frames = Prefetch::new(source, AHEAD);
    let mut boxes = Boxes::create(args.out.as_deref(), args.json)?;
    let painter = args.overlay.as_deref().map(Painter::create).transpose()?;
    let mut tracker = Follower::new(model, &args.engine, args.mode)?;

    let began = Instant::now();
    let mut times = Vec::new();
    let mut step = |index: usize, frames: &mut Prefetch| -> Result<bool, Failure> {
        let Some(image) = frames.next() else {
            return Ok(false);
        };
        let image = image.map_err(|error| Failure::Frame {
            frame: index,
            error,
        })?;
        let frame = image.frame();
        let started = Instant::now();
        let found = match index == args.start {
            true => tracker.start(&frame, args.init)?,
            false => tracker.follow(&frame)?,
        };
        let took = started.elapsed();
        if index > args.start {
            times.push(took);
        }
        boxes.write(index, &found, took)?;
        match &painter {
            None => frames.recycle(image),
            Some(painter) => {
                let drawing = painter.add(index, image, found);
                painter.drawn().for_each(|image| frames.recycle(image));
                if !drawing {
                    return Ok(false);
                }
            }
        }
        bar.inc(1);
        Ok(true)
    };
    let mut done = Ok(());
    for index in args.start.. {
        match step(index, &mut frames) {
            Ok(true) => {}
            Ok(false) => break,
            Err(failure) => {
                done = Err(failure);
                break;
            }
        }
    }
    bar.finish_and_clear();
    let filmed = painter.map_or(Ok(()), Painter::finish);
    if !matches!(done, Err(Failure::ClosedPipe)) && !times.is_empty() {
        summarize(args, &times, began.elapsed());
    }
    done.and(filmed)
}

fn summarize(args: &TrackArgs, times: &[Duration], all: Duration) {
    let (frames, tracking) = (times.len() + 1, Times::new(times));
    let total = frames as f64 / all.as_secs_f64();
    let to = |path: &Option<std::path::PathBuf>, what| {
        path.as_ref().map_or(String::new(), |path| {
            format!("; {what} in {}", path.display())
        })
    };
    eprintln!(
        "{frames} frames: {:.1} FPS tracking, {total:.1} FPS with reading and writing{}{}",
        tracking.fps(),
        to(&args.out, "boxes"),
        to(&args.overlay, "pictures"),
    );
}

/// One line per frame, written out as soon as it is there.
struct Boxes {
    out: LineWriter<Box<dyn Write>>,
    file: Option<String>,
    json: bool,
}

impl Boxes {
    fn create(path: Option<&Path>, json: bool) -> Result<Boxes, Failure> {
        let out: Box<dyn Write> = match path {
            Some(path) => {
                Box::new(File::create(path).map_err(|error| Failure::output(path, error))?)
            }
            None => Box::new(std::io::stdout()),
        };
        Ok(Boxes {
            out: LineWriter::new(out),
            file: path.map(|path| path.display().to_string()),
            json,
        })
    }

    fn write(&mut self, frame: usize, found: &Found, took: Duration) -> Result<(), Failure> {
        let BBox { x, y, w, h } = found.bbox;
        let line = if self.json {
            let numbers = [x, y, w, h].map(|v| rounded(f64::from(v), 3));
            let score = found.score.map(|score| rounded(f64::from(score), 6));
            let milliseconds = rounded(took.as_secs_f64() * 1e3, 3);
            let mut line = json!({ "frame": frame, "box": numbers, "score": score, "milliseconds": milliseconds });
            if let Some((presence, state)) = found.sureness {
                line["presence"] = rounded(f64::from(presence), 4);
                line["state"] = state.name().into();
            }
            line.to_string()
        } else {
            format!("{x:.3},{y:.3},{w:.3},{h:.3}")
        };
        writeln!(self.out, "{line}").map_err(|error| match &self.file {
            Some(file) => Failure::Output {
                output: file.clone(),
                reason: error.to_string(),
            },
            None => Failure::stdout(&error),
        })
    }
}
