//! `track`: an input, a box, and a line per frame.

use std::io::{IsTerminal, LineWriter, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use indicatif::ProgressBar;
use program::{NewFile, brief, check_outputs};
use serde_json::{Value, json};
use track_cpu::BBox;
use track_cpu::source::{BadFrames, Image, Input, OnBadFrame, Prefetch, Source};

use crate::args::track::TrackArgs;
use crate::exit::Failure;
use crate::follow::{Follower, Found, note_flight};
use crate::pictures::Pictures;
use crate::report::{progress, rounded};
use crate::statistics::Times;

/// Frames decoded ahead.
const AHEAD: usize = 3;

/// Runs the sub-command.
pub fn run(args: &TrackArgs) -> Result<(), Failure> {
    let model = args.engine.model(args.model.name())?;
    note_flight(&model, &args.engine, args.mode);
    let source = Source::open(&Input {
        location: args.input.clone(),
        raw: args.raw.format(),
        start: args.start,
        end: args.end,
        ffmpeg_args: args.raw.ffmpeg_args(),
        is_live: false,
    })?;
    check(args, &source)?;
    if let Some(note) = source.note() {
        eprintln!("note: {}", brief(note));
    }
    // On one terminal, boxes and a bar would overwrite each other.
    let bar = if args.out.is_none() && std::io::stdout().is_terminal() {
        ProgressBar::hidden()
    } else {
        progress(source.frames_left())
    };
    let mut run = Run {
        args,
        tracker: Follower::new(model, args)?,
        boxes: Boxes::create(args.out.as_deref(), args.json)?,
        bad: BadFrames::new(args.bad_frames.on_bad_frame),
        size: None,
        asking: Duration::ZERO,
        times: Vec::new(),
    };

    let mut pictures = Pictures::create(args)?;
    let began = Instant::now();
    let done = run.follow(&mut Prefetch::new(source, AHEAD), &mut pictures, &bar);
    bar.finish_and_clear();
    let filmed = pictures.finish();
    if !matches!(done, Err(Failure::ClosedPipe)) && !run.times.is_empty() {
        run.summarize(began.elapsed().saturating_sub(run.asking));
    }
    done.and(filmed).and(run.complete())
}

/// Refuses outputs that would destroy an input.
fn check(args: &TrackArgs, source: &Source) -> Result<(), Failure> {
    let pictures = Pictures::files(args);
    let mut outputs: Vec<(&str, &Path)> = Vec::new();
    outputs.extend(args.out.as_deref().map(|path| ("--out", path)));
    outputs.extend(pictures.iter().map(|(option, path)| (*option, &**path)));
    let mut inputs: Vec<&Path> = source
        .places()
        .iter()
        .map(|place| place.as_path())
        .collect();
    inputs.extend(args.model.name());
    Ok(check_outputs(&outputs, &inputs)?)
}

/// One run over an input.
struct Run<'a> {
    args: &'a TrackArgs,
    tracker: Follower,
    boxes: Boxes,
    bad: BadFrames,
    size: Option<(usize, usize)>, // of the frame before
    asking: Duration,             // until the box was drawn
    times: Vec<Duration>,         // of every frame but the first
}

impl Run<'_> {
    /// From the first frame to the last: frame, box, line, picture.
    fn follow(
        &mut self,
        frames: &mut Prefetch,
        pictures: &mut Pictures,
        bar: &ProgressBar,
    ) -> Result<(), Failure> {
        let mut index = self.args.start;
        let Some(first) = frames.next() else {
            return Ok(()); // a source has a frame or gives an error
        };
        let first = first.map_err(Failure::at_frame(index))?;
        self.see_size(index, &first);
        let init = match self.args.init {
            Some(init) => init,
            None => {
                let init = self.ask(&first)?;
                bar.reset(); // its rate is that of tracking
                init
            }
        };
        let started = Instant::now();
        let mut found = self.tracker.start(&first.frame(), init)?;
        self.see_box(init);
        self.boxes.write(index, &found, started.elapsed())?;
        let mut is_painting = pictures.add(index, first, found, frames);
        let mut steps = 0; // from the last frame that could be read
        bar.inc(1);

        while is_painting && let Some(image) = frames.next() {
            index += 1;
            steps += 1;
            match image {
                Ok(image) => {
                    self.see_size(index, &image);
                    let started = Instant::now();
                    found = self.tracker.follow(&image.frame(), steps)?;
                    steps = 0;
                    let took = started.elapsed();
                    self.times.push(took);
                    self.boxes.write(index, &found, took)?;
                    is_painting = pictures.add(index, image, found, frames);
                }
                Err(error) => {
                    let bad = self.bad.pass(error).map_err(Failure::at_frame(index))?;
                    eprintln!("warning: frame {index}: {bad}");
                    if bad.is_held {
                        self.boxes.write(index, &found.held(), Duration::ZERO)?;
                    }
                }
            }
            bar.inc(1);
        }
        let found = index + 1;
        if let Some(end) = self.args.end.filter(|end| is_painting && *end > found) {
            eprintln!("note: --end {end}: the input has {found} frames");
        }
        Ok(())
    }

    /// Asks for the box on a web page, and names it so that the run can be repeated.
    #[cfg(feature = "serve")]
    fn ask(&mut self, first: &Image) -> Result<BBox, Failure> {
        let began = Instant::now();
        let init = crate::serve::pick::ask(first, |init| {
            let started = self.tracker.start(&first.frame(), init);
            started.map(|_| ()).map_err(|error| error.to_string())
        })?;
        let BBox { x, y, w, h } = init;
        eprintln!("note: --init {x},{y},{w},{h}");
        self.asking = began.elapsed();
        Ok(init)
    }

    /// Refuses to go on: a program without a web page demands the box on its command line.
    #[cfg(not(feature = "serve"))]
    fn ask(&mut self, _: &Image) -> Result<BBox, Failure> {
        Err(Failure::Output {
            output: "--init".into(),
            reason: "expected a box".into(),
        })
    }

    /// Reports a frame whose size differs from that of the frame before.
    fn see_size(&mut self, index: usize, image: &Image) {
        let size = (image.width, image.height);
        if let Some((w, h)) = self.size.filter(|before| *before != size) {
            let (width, height) = size;
            eprintln!("note: frame {index}: {width}x{height} pixels, {w}x{h} before");
        }
        self.size = Some(size);
    }

    /// Reports a box most of which lies outside of the first frame: a typing error, perhaps.
    fn see_box(&self, init: BBox) {
        let Some((width, height)) = self.size else {
            return;
        };
        let BBox { x, y, w, h } = init;
        let inside_w = (x + w).min(width as f32) - x.max(0.0);
        let inside_h = (y + h).min(height as f32) - y.max(0.0);
        if inside_w * inside_h < 0.5 * w * h {
            eprintln!(
                "note: --init: most of box {x},{y},{w},{h} lies outside the {width}x{height} frame"
            );
        }
    }

    fn summarize(&self, all: Duration) {
        let frames = self.times.len() + 1;
        let tracking = Times::new(&self.times).fps();
        let total = frames as f64 / all.as_secs_f64();
        let mut text = format!(
            "{frames} frames: {tracking:.1} FPS tracking, {total:.1} FPS with reading and writing"
        );
        for (what, path) in [("boxes", &self.args.out), ("pictures", &self.args.overlay)] {
            if let Some(path) = path {
                text += &format!("; {what} in {}", path.display());
            }
        }
        eprintln!("{text}");
    }

    /// An error if frames could not be read.
    fn complete(&self) -> Result<(), Failure> {
        let consequence = match self.args.bad_frames.on_bad_frame {
            OnBadFrame::Skip => "they have no line",
            OnBadFrame::Hold | OnBadFrame::Stop => "their lines hold the box before",
        };
        match self.bad.count() {
            0 => Ok(()),
            count => Err(Failure::BadFrames { count, consequence }),
        }
    }
}

/// One line per frame, written out as soon as it is known.
enum Boxes {
    Stdout(Format),
    File(LineWriter<NewFile>, Format, String),
}

/// How a line is written.
#[derive(Clone, Copy)]
enum Format {
    Numbers,
    Json,
}

impl Boxes {
    fn create(path: Option<&Path>, json: bool) -> Result<Boxes, Failure> {
        let format = if json { Format::Json } else { Format::Numbers };
        let Some(path) = path else {
            return Ok(Boxes::Stdout(format));
        };
        let file = NewFile::create(path).map_err(|error| Failure::output(path, error))?;
        let name = path.display().to_string();
        Ok(Boxes::File(LineWriter::new(file), format, name))
    }

    /// Writes a line. A file takes its place with the first one, so that a refused run leaves the
    /// file of the run before, and a running one can be watched.
    fn write(&mut self, frame: usize, found: &Found, took: Duration) -> Result<(), Failure> {
        match self {
            Boxes::Stdout(format) => {
                let line = format.line(frame, found, took);
                writeln!(std::io::stdout(), "{line}").map_err(|error| Failure::stdout(&error))
            }
            Boxes::File(file, format, name) => {
                let line = format.line(frame, found, took);
                let written = writeln!(file, "{line}").and_then(|()| file.get_mut().keep());
                written.map_err(|error| Failure::Output {
                    output: name.clone(),
                    reason: error.to_string(),
                })
            }
        }
    }
}

impl Format {
    fn line(self, frame: usize, found: &Found, took: Duration) -> String {
        let BBox { x, y, w, h } = found.bbox;
        match self {
            Format::Numbers => format!("{x:.3},{y:.3},{w:.3},{h:.3}"),
            Format::Json => {
                let numbers = [x, y, w, h].map(|v| rounded(f64::from(v), 3));
                let mut line = json!({
                    "frame": frame,
                    "box": numbers,
                    "score": found.score.map(|score| rounded(f64::from(score), 6)),
                    "milliseconds": rounded(took.as_secs_f64() * 1e3, 3),
                });
                if let Some((presence, state)) = found.sureness {
                    line["presence"] = rounded(f64::from(presence), 4);
                    line["state"] = state.name().into();
                }
                if found.is_held {
                    line["held"] = true.into();
                    line["milliseconds"] = Value::Null;
                    if found.sureness.is_some() {
                        line["presence"] = Value::Null; // nothing was seen
                    }
                }
                line.to_string()
            }
        }
    }
}
