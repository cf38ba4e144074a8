//! `replay`: a flight log done again, box for box.

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

use scenes::{Flight, FrameBuffer};
use serde_json::{Value, json};
use track_cpu::source::{Image, Input, Source};
use track_cpu::{BBox, ChannelOrder, Isa, Precision};

use super::args::ReplayArgs;
use super::engine::Engine;
use super::log::{self, Asked};
use super::sources::parse_flight;
use crate::args::{EngineArgs, Mode, Search};
use crate::exit::Failure;
use crate::report::print;
use track_cpu::flight::Budget;

/// Longest line of a log that is read.
const MAX_LINE: u64 = 1 << 16;

/// Runs the sub-command.
pub fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let mut lines = Lines::open(&args.log)?;
    let head = lines
        .next()?
        .ok_or_else(|| lines.wrong("is empty, expected its first line"))?;
    if head["log"] != "track-cpu" || head["version"] != log::VERSION {
        let found = format!(
            "starts with log {}, version {}",
            head["log"], head["version"]
        );
        return Err(lines.wrong(&format!(
            "{found}, expected track-cpu, version {}",
            log::VERSION
        )));
    }
    let text = |field: &str| head[field].as_str().map(str::to_string);
    let isa = text("isa").and_then(|name| Isa::from_name(&name).ok());
    let isa = isa
        .ok_or_else(|| lines.wrong("was made with an instruction set that this machine has not"))?;
    let mode = text("mode").and_then(|name| Mode::from_name(&name));
    let mode = mode.ok_or_else(|| lines.wrong("names no known mode"))?;
    let path = args
        .model
        .clone()
        .or_else(|| text("model").map(PathBuf::from));
    let precision = text("precision").and_then(|name| Precision::from_name(&name));
    let precision = precision.ok_or_else(|| lines.wrong("names no known precision"))?;
    let engine_args = EngineArgs {
        threads: 1,
        pin: None,
        isa: Some(isa),
        precision: Some(precision),
        as_published: false,
        correction: head["correction"].as_f64(),
        template_update: head["template_update"].as_f64(),
        online_filter: Some(head["online_filter"].as_f64().unwrap_or(0.0)), // older logs had none
        search: Search::Full,
    };
    let mut engine = Engine::new(engine_args.model(path.as_deref())?, &engine_args, mode)?;
    let mut frames = match &args.frames {
        Some(folder) => Frames::Saved(folder.clone()),
        None => Frames::open(&text("input").unwrap_or_default(), &head, &lines)?,
    };

    let (mut count, mut differing, mut first) = (0u64, 0u64, None);
    while let Some(line) = lines.next()? {
        let logged =
            Logged::read(&line).ok_or_else(|| lines.wrong("holds a line that is none of a log"))?;
        let image = frames.get(logged.frame, &lines)?;
        let found = again(&mut engine, &logged, &image);
        count += 1;
        if found.map(bits) != logged.bbox.map(bits) {
            differing += 1;
            first.get_or_insert(logged.frame);
        }
    }
    let result = json!({ "frames": count, "differing": differing, "first_difference": first });
    print(&result.to_string())?;
    match differing {
        0 => Ok(()),
        n => Err(Failure::SelfTest(format!(
            "{n} of {count} boxes differ from the log"
        ))),
    }
}

fn bits(b: BBox) -> [u32; 4] {
    [b.x, b.y, b.w, b.h].map(f32::to_bits)
}

/// Does what the log says was done at a frame.
fn again(engine: &mut Engine, logged: &Logged, image: &Image) -> Option<BBox> {
    let frame = image.frame();
    let mut fresh = None;
    for asked in &logged.asked {
        fresh = match asked {
            Asked::Start(bbox) => engine.start(&frame, *bbox).ok(),
            Asked::Stop => {
                engine.stop();
                None
            }
        };
    }
    let budget = Budget::Searches(logged.searches);
    fresh
        .or_else(|| engine.follow(&frame, budget))
        .map(|track| track.bbox)
}

/// One frame's line.
struct Logged {
    frame: u64,
    asked: Vec<Asked>,
    searches: u32,
    bbox: Option<BBox>,
}

impl Logged {
    fn read(line: &Value) -> Option<Logged> {
        let asked = line["asked"]
            .as_array()?
            .iter()
            .map(log::read_asked)
            .collect::<Option<_>>()?;
        let bbox = match &line["box"] {
            Value::Null => None,
            value => Some(log::read_box(value)?),
        };
        let searches = line["searches"]
            .as_u64()
            .map_or(Some(0), |n| u32::try_from(n).ok())?;
        Some(Logged {
            frame: line["frame"].as_u64()?,
            asked,
            searches,
            bbox,
        })
    }
}

/// The log's lines, each of bounded length.
struct Lines {
    path: PathBuf,
    reader: BufReader<File>,
    number: u64,
}

impl Lines {
    fn open(path: &Path) -> Result<Lines, Failure> {
        let file = File::open(path);
        let wrong = |error: std::io::Error| Failure::Log {
            log: path.display().to_string(),
            reason: error.to_string(),
        };
        Ok(Lines {
            path: path.to_path_buf(),
            reader: BufReader::new(file.map_err(wrong)?),
            number: 0,
        })
    }

    fn next(&mut self) -> Result<Option<Value>, Failure> {
        let mut line = String::new();
        self.number += 1;
        let read = self.reader.by_ref().take(MAX_LINE).read_line(&mut line);
        let read = read.map_err(|error| self.wrong(&error.to_string()))?;
        if read == 0 {
            return Ok(None);
        }
        if !line.ends_with('\n') {
            // The flight may have ended while this line was written.
            return if read as u64 == MAX_LINE {
                Err(self.wrong("is too long"))
            } else {
                Ok(None)
            };
        }
        let value = serde_json::from_str(&line);
        value
            .map(Some)
            .map_err(|error| self.wrong(&format!("is no JSON: {error}")))
    }

    fn wrong(&self, reason: &str) -> Failure {
        let log = format!("{} line {}", self.path.display(), self.number);
        Failure::Log {
            log,
            reason: reason.to_string(),
        }
    }
}

/// The frames of a flight, asked for in rising order.
enum Frames {
    Saved(PathBuf),
    Rendered(Box<Flight>),
    Read { source: Box<Source>, next: u64 },
}

impl Frames {
    fn open(input: &str, head: &Value, lines: &Lines) -> Result<Frames, Failure> {
        if head["repeats"] != true {
            return Err(lines.wrong("is of an input that cannot be read again: give --frames"));
        }
        if let Some(flight) = input.strip_prefix("flight:") {
            let config = parse_flight(flight).map_err(|reason| lines.wrong(&reason))?;
            return Ok(Frames::Rendered(Box::new(Flight::new(config))));
        }
        Ok(Frames::Read {
            source: Box::new(Source::open(&Input::new(input))?),
            next: 0,
        })
    }

    fn get(&mut self, index: u64, lines: &Lines) -> Result<Image, Failure> {
        let missing = || lines.wrong(&format!("speaks of frame {index}, which the input has not"));
        match self {
            Frames::Saved(folder) => {
                let mut source = Source::open(&Input::new(folder.join(log::frame_name(index))))?;
                Ok(source.next().ok_or_else(missing)??)
            }
            Frames::Rendered(flight) => {
                let index = usize::try_from(index)
                    .ok()
                    .filter(|i| *i < flight.len())
                    .ok_or_else(missing)?;
                let mut buffer = FrameBuffer::default();
                flight.render(index, &mut buffer);
                let FrameBuffer {
                    width,
                    height,
                    data,
                } = buffer;
                Ok(Image {
                    data,
                    width,
                    height,
                    order: ChannelOrder::Rgb,
                    name: None,
                })
            }
            Frames::Read { source, next } => {
                if index < *next {
                    return Err(missing());
                }
                loop {
                    let image = source.next().ok_or_else(missing)??;
                    *next += 1;
                    if *next > index {
                        return Ok(image);
                    }
                }
            }
        }
    }
}
