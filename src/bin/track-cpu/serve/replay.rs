//! `replay`: a flight log done again, box for box.

use std::path::PathBuf;

use serde_json::{Value, json};
use station::log::{Asked, Entry, Reader, frame_name};
use station::{Engine, FrameBox, Picture, TargetId};
use track_cpu::flight::{Budget, check_threshold};
use track_cpu::source::{Input, Source};
use track_cpu::{Isa, Precision};

use super::args::ReplayArgs;
use super::engine::TrackerEngine;
use super::feed::{Rendered, parse_flight, picture};
use crate::args::{EngineArgs, MAX_TARGETS, Mode, Search};
use crate::exit::Failure;
use crate::report::print;

/// Runs `replay`.
pub fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let mut log = Reader::open(&args.log)?;
    let mut engines = engines(args, &log)?;
    let mut frames = Frames::open(args, &log)?;
    // The head of a log whose earlier files are gone: what was followed is only known at a start.
    let mut is_known = log.head()["continues"].is_null();

    let mut count = 0u64;
    let mut skipped = 0u64;
    let mut differing = 0u64;
    let mut first = None;
    while let Some(entry) = log.next()? {
        is_known |= !entry.asked.is_empty();
        if !is_known {
            skipped += 1;
            continue;
        }
        let found = repeat(&mut engines, &entry, &mut frames, &log)?;
        let logged = entry.found.iter().map(|found| (found.id, bits(found.bbox)));
        count += 1;
        if found != logged.collect::<Vec<_>>() {
            differing += 1;
            first.get_or_insert(entry.frame);
        }
    }
    let result = json!({
        "frames": count,
        "skipped": skipped,
        "differing": differing,
        "first_difference": first,
    });
    print(&result.to_string())?;
    match differing {
        0 => Ok(()),
        n => Err(Failure::SelfTest(format!(
            "{n} of {count} boxes differ from the log"
        ))),
    }
}

fn bits(b: FrameBox) -> [u32; 4] {
    [b.x, b.y, b.w, b.h].map(f32::to_bits)
}

/// The trackers that the log's first line describes, one for each target.
fn engines(args: &ReplayArgs, log: &Reader) -> Result<Vec<TrackerEngine>, Failure> {
    let head = log.head();
    let text = |field: &str| head[field].as_str().map(str::to_string);
    let isa = text("isa").and_then(|name| Isa::from_name(&name).ok());
    let isa =
        isa.ok_or_else(|| log.wrong("was made with an instruction set that this machine lacks"))?;
    let mode = text("mode").and_then(|name| Mode::from_name(&name));
    let mode = mode.ok_or_else(|| log.wrong("names no known mode"))?;
    let model = args
        .model
        .clone()
        .or_else(|| text("model").map(PathBuf::from));
    let precision = text("precision").and_then(|name| Precision::from_name(&name));
    let precision = precision.ok_or_else(|| log.wrong("names no known precision"))?;
    let engine = EngineArgs {
        threads: 1,
        pin: None,
        isa: Some(isa),
        precision: Some(precision),
        as_published: false,
        correction: head["correction"].as_f64(),
        template_update: head["template_update"].as_f64(),
        // Older logs lack these.
        online_filter: Some(head["online_filter"].as_f64().unwrap_or(0.0)),
        unstretch: Some(head["unstretch"].as_f64().unwrap_or(0.0)),
        voting: Some(head["voting"].as_f64().unwrap_or(0.0)),
        search: Search::Full,
    };
    // Older logs have no thresholds of their own.
    let mut thresholds = Vec::new();
    for entry in head["thresholds"].as_array().into_iter().flatten() {
        let threshold = entry[0].as_str().zip(entry[1].as_f64());
        let (name, value) = threshold.ok_or_else(|| log.wrong("names an unreadable threshold"))?;
        check_threshold(name, value).map_err(|error| log.wrong(&error.to_string()))?;
        thresholds.push((name.to_string(), value));
    }
    // Logs of one target need not say so.
    let targets = head["targets"].as_u64().unwrap_or(1);
    if !(1..=MAX_TARGETS as u64).contains(&targets) {
        return Err(log.wrong("names no possible number of targets").into());
    }
    let model = engine.model(model.as_deref())?;
    let mut engines = Vec::new();
    for _ in 0..targets {
        engines.push(TrackerEngine::new(
            model.clone(),
            &engine,
            mode,
            &thresholds,
        )?);
    }
    Ok(engines)
}

/// Does what the log says was done at a frame; returns number and box of every target.
fn repeat(
    engines: &mut [TrackerEngine],
    entry: &Entry,
    frames: &mut Frames,
    log: &Reader,
) -> Result<Vec<(TargetId, [u32; 4])>, Failure> {
    let unknown = |id: TargetId| log.wrong(&format!("names target {id}, which the log lacks"));
    // An earlier frame may have to be read again, so it is read before this one.
    let mut fresh = vec![None; engines.len()];
    for asked in &entry.asked {
        match *asked {
            Asked::Start { bbox, at, id } => {
                let index = id - 1; // a log numbers them from 1 on
                let engine = engines.get_mut(index).ok_or_else(|| unknown(id))?;
                fresh[index] = match at {
                    Some(frame) => {
                        let earlier = frames.earlier(frame, log)?;
                        let _ = engine.start(&earlier, bbox); // a refused one was not logged
                        None
                    }
                    None => engine.start(&frames.get(entry.frame, log)?, bbox).ok(),
                };
            }
            Asked::Stop { id } => {
                for (index, engine) in engines.iter_mut().enumerate() {
                    if id.is_none_or(|id| id == index + 1) {
                        engine.stop();
                        fresh[index] = None;
                    }
                }
            }
        }
    }
    let picture = frames.get(entry.frame, log)?;
    let mut found = Vec::new();
    for (index, (engine, fresh)) in engines.iter_mut().zip(fresh).enumerate() {
        let id = index + 1;
        let logged = entry.found.iter().find(|found| found.id == id);
        let budget = Budget::Searches(logged.map_or(0, |found| found.searches));
        let track = fresh.or_else(|| engine.find(&picture, entry.elapsed, budget));
        found.extend(track.map(|track| (id, bits(track.bbox))));
    }
    Ok(found)
}

/// The frames of a flight.
enum Frames {
    /// Pictures in a folder.
    Saved(PathBuf),
    /// A rendered flight.
    Rendered(Box<Rendered>),
    /// An input that is read again from its beginning.
    Read {
        input: PathBuf,
        source: Box<Source>,
        next: u64,
        last: Option<(u64, Picture)>,
    },
}

impl Frames {
    fn open(args: &ReplayArgs, log: &Reader) -> Result<Frames, Failure> {
        if let Some(folder) = &args.frames {
            return Ok(Frames::Saved(folder.clone()));
        }
        let head = log.head();
        if head["repeats"] != true {
            return match &head["frames"] {
                Value::String(folder) => Ok(Frames::Saved(folder.into())),
                _ => Err(log
                    .wrong("is of an input that cannot be read again: give --frames")
                    .into()),
            };
        }
        let input = head["input"].as_str().unwrap_or_default();
        if let Some(flight) = input.strip_prefix("flight:") {
            let config = parse_flight(flight).map_err(|reason| log.wrong(&reason))?;
            return Ok(Frames::Rendered(Box::new(Rendered::new(config))));
        }
        Ok(Frames::Read {
            source: Box::new(Source::open(&Input::new(input))?),
            input: input.into(),
            next: 0,
            last: None,
        })
    }

    /// The frame of this index; they are asked for in rising order.
    fn get(&mut self, index: u64, log: &Reader) -> Result<Picture, Failure> {
        let missing = || log.wrong(&format!("names frame {index}, which the input lacks"));
        match self {
            Frames::Saved(folder) => {
                let mut source = Source::open(&Input::new(folder.join(frame_name(index))))?;
                Ok(picture(source.next().ok_or_else(missing)??))
            }
            Frames::Rendered(flight) => {
                let index = usize::try_from(index).map_err(|_| missing())?;
                Ok(flight.render(index, Vec::new()).ok_or_else(missing)?)
            }
            Frames::Read {
                source, next, last, ..
            } => {
                if let Some((_, picture)) = last.as_ref().filter(|(frame, _)| *frame == index) {
                    return Ok(picture.clone());
                }
                if index < *next {
                    return Err(missing().into());
                }
                loop {
                    let image = source.next().ok_or_else(missing)??;
                    *next += 1;
                    if *next > index {
                        let picture = picture(image);
                        *last = Some((index, picture.clone()));
                        return Ok(picture);
                    }
                }
            }
        }
    }

    /// An earlier frame, in which somebody drew a box.
    fn earlier(&mut self, index: u64, log: &Reader) -> Result<Picture, Failure> {
        let Frames::Read { input, .. } = self else {
            return self.get(index, log);
        };
        let missing = || log.wrong(&format!("names frame {index}, which the input lacks"));
        let start = usize::try_from(index).map_err(|_| missing())?;
        let mut source = Source::open(&Input {
            start,
            ..Input::new(&*input)
        })?;
        Ok(picture(source.next().ok_or_else(missing)??))
    }
}
