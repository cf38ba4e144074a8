//! Clips with their truth, frame by frame: rendered flights and real footage.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use ope::starts;
use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer, TruthBox};
use sequences::{Notes, Rect, Sequence};
use track_cpu::source::{Image, Input, Source};
use track_cpu::{BBox, ChannelOrder, Frame};

use crate::panning::{Panning, View};
use crate::{Failure, FlightArgs, FootageArgs};

/// Share of the target that must be visible for it to count as there.
pub const VISIBLE: f32 = 0.25;
/// Share below which it counts as gone.
pub const GONE: f32 = 0.05;
/// Least IoU of a box that is on an object.
pub const ON: f32 = 0.3;
/// IoU below which it is off it.
pub const OFF: f32 = 0.1;
/// Most frames of one pass of a virtual camera.
const MOST_FRAMES: usize = 420;
/// Step through the pictures that occlude: neighbors are often alike.
const STILLS_STEP: usize = 37;

/// What is true of one frame.
#[derive(Clone, Debug)]
pub struct Truth {
    /// Where the target is; where it was last while it is gone from footage.
    pub bbox: BBox,
    /// Share of it that is visible.
    pub visible: f32,
    /// Other objects that look like it, where they are known.
    pub others: Vec<BBox>,
}

/// A clip that can be played.
#[derive(Clone, Debug)]
pub enum Clip {
    /// A rendered flight.
    Flight {
        /// What it looks like.
        config: FlightConfig,
    },
    /// Real footage.
    Footage(Footage),
}

/// A pass over a real sequence, perhaps with a virtual camera.
#[derive(Clone, Debug)]
pub struct Footage {
    name: String,
    sequence: String,
    frames: Vec<PathBuf>,
    boxes: Vec<Option<BBox>>,
    panning: Option<Panning>,
    stills: Vec<PathBuf>,
}

/// Whether a box is on the target; `None` where it is neither on nor off it.
pub fn is_on(found: &BBox, truth: &Truth) -> Option<bool> {
    let iou = found.iou(&truth.bbox);
    if truth.visible <= GONE || iou < OFF {
        Some(false)
    } else if truth.visible >= VISIBLE && iou >= ON {
        Some(true)
    } else {
        None
    }
}

/// The tracker's box of an annotated one.
pub fn tracked(rect: &Rect) -> BBox {
    let [x, y, w, h] = rect.to_f32();
    BBox::new(x, y, w, h)
}

/// How hard the flight of a seed is: two of three are hard.
pub fn difficulty(seed: u64) -> Difficulty {
    if seed.is_multiple_of(3) {
        Difficulty::Medium
    } else {
        Difficulty::Hard
    }
}

/// The rendered flights of seeds from `first` on, then all passes over the sequences.
///
/// # Errors
/// If there are none, or a folder cannot be read or holds nothing.
pub fn all(flights: &FlightArgs, first: u64, footage: &FootageArgs) -> Result<Vec<Clip>, Failure> {
    let mut clips = rendered(flights, first);
    clips.extend(recorded(footage)?);
    if clips.is_empty() {
        return Err(Failure::Nothing(
            "no clips: expected --flights above 0, or --sequences".into(),
        ));
    }
    Ok(clips)
}

/// The rendered flights of seeds from `first` on.
fn rendered(args: &FlightArgs, first: u64) -> Vec<Clip> {
    let width = args.width.clamp(64, 4096);
    let config = |seed| FlightConfig {
        width,
        height: width * 9 / 16,
        frames: args.frames.clamp(2, 100_000),
        seed,
        difficulty: difficulty(seed),
        twins: args.twins,
        ..Default::default()
    };
    (0..args.flights)
        .map(|index| Clip::Flight {
            config: config(first.saturating_add(index)),
        })
        .collect()
}

/// All passes over the sequences that are asked for; none without a folder.
///
/// # Errors
/// If a folder cannot be read or holds nothing.
fn recorded(args: &FootageArgs) -> Result<Vec<Clip>, Failure> {
    let Some(folder) = &args.sequences else {
        return Ok(Vec::new());
    };
    let whole: Vec<Sequence> = load(folder, &args.only)?;
    let stills = match &args.stills {
        Some(folder) => pictures(folder)?,
        None => Vec::new(),
    };
    let mut clips = Vec::new();
    for sequence in whole {
        let name = sequence.annotation.name.clone();
        for pass in 0..args.panning {
            let seed = args.virtual_from.saturating_add(pass);
            clips.extend(virtual_camera(&sequence, &stills, seed)?);
        }
        if args.panning > 0 && !args.plain_too {
            continue;
        }
        let passes = if args.four_starts {
            starts::sequences(vec![sequence])
        } else {
            vec![sequence]
        };
        for pass in passes {
            clips.push(Clip::Footage(Footage {
                name: pass.annotation.name.clone(),
                sequence: name.clone(),
                boxes: boxes(&pass),
                frames: pass.frames,
                panning: None,
                stills: Vec::new(),
            }));
        }
    }
    Ok(clips)
}

/// The sequences below a folder, or those of them with these names.
///
/// # Errors
/// If the folder cannot be read or holds none.
pub fn load(folder: &Path, only: &[String]) -> Result<Vec<Sequence>, Failure> {
    let mut notes = Notes::default();
    let mut sequences = sequences::find(folder, &mut notes)?;
    eprint!("{notes}");
    sequences.retain(|sequence| {
        let name = &sequence.annotation.name;
        let last = name.rsplit('/').next().unwrap_or(name);
        only.is_empty() || only.iter().any(|wanted| wanted == name || wanted == last)
    });
    if sequences.is_empty() {
        return Err(Failure::Nothing(format!(
            "{}: no sequence of the names asked for",
            folder.display()
        )));
    }
    Ok(sequences)
}

/// A sequence as a virtual camera shows it; `None` if it is not suited.
fn virtual_camera(
    sequence: &Sequence,
    stills: &[PathBuf],
    seed: u64,
) -> Result<Option<Clip>, Failure> {
    let frames: Vec<PathBuf> = sequence.frames.iter().take(MOST_FRAMES).cloned().collect();
    let boxes: Vec<Option<BBox>> = boxes(sequence).into_iter().take(MOST_FRAMES).collect();
    let Some(first) = frames.first() else {
        return Ok(None);
    };
    let first = read(first)?;
    let name = &sequence.annotation.name;
    let hash = name.bytes().fold(seed, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3) // FNV-1a
    });
    let size = (first.width, first.height);
    let plan = Panning::plan(size, &boxes, stills.len(), hash);
    Ok(plan.map(|panning| {
        Clip::Footage(Footage {
            name: format!("{name}.virtual{seed}"),
            sequence: name.clone(),
            frames,
            boxes,
            stills: stills.to_vec(),
            panning: Some(panning),
        })
    }))
}

fn boxes(sequence: &Sequence) -> Vec<Option<BBox>> {
    let annotation = &sequence.annotation;
    let usable = |(i, bbox): (usize, &Rect)| {
        (bbox.is_usable() && annotation.is_present(i)).then(|| tracked(bbox))
    };
    annotation.boxes.iter().enumerate().map(usable).collect()
}

/// Reads one picture.
///
/// # Errors
/// If it cannot be read.
pub fn read(path: &Path) -> Result<Image, Failure> {
    let wrong = |error: &dyn std::fmt::Display| Failure::File(path.into(), error.to_string());
    let mut source = Source::open(&Input::new(path)).map_err(|error| wrong(&error))?;
    let image = source.next().ok_or_else(|| wrong(&"no picture"))?;
    image.map_err(|error| wrong(&error))
}

/// Some pictures of a folder.
fn pictures(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let wrong = |error: std::io::Error| Failure::File(folder.into(), error.to_string());
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(wrong)? {
        paths.push(entry.map_err(wrong)?.path());
    }
    paths.sort();
    Ok(paths.into_iter().step_by(STILLS_STEP).collect())
}

impl Clip {
    /// A name for tables.
    pub fn name(&self) -> String {
        match self {
            Clip::Flight { config } => format!("seed {}", config.seed),
            Clip::Footage(footage) => footage.name.clone(),
        }
    }

    /// What must not be split between fitting and measuring.
    pub fn group(&self) -> String {
        match self {
            Clip::Flight { config } => format!("seed {}", config.seed),
            Clip::Footage(footage) => footage.sequence.clone(),
        }
    }

    /// A number that differs between clips.
    pub fn seed(&self) -> u64 {
        match self {
            Clip::Flight { config } => config.seed,
            Clip::Footage(footage) => footage.frames.len() as u64,
        }
    }

    /// How hard a rendered flight is.
    pub fn difficulty(&self) -> Option<Difficulty> {
        match self {
            Clip::Flight { config } => Some(config.difficulty),
            Clip::Footage(_) => None,
        }
    }

    /// Shows every frame to `each`.
    ///
    /// # Errors
    /// If a picture cannot be read or shown.
    pub fn play(
        &self,
        each: impl FnMut(usize, &Frame<'_>, &Truth) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        match self {
            Clip::Flight { config } => play_flight(config, each),
            Clip::Footage(footage) => footage.play(each),
        }
    }
}

fn play_flight(
    config: &FlightConfig,
    mut each: impl FnMut(usize, &Frame<'_>, &Truth) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let seed = config.seed;
    let frames = config.frames;
    let flight = Flight::new(config.clone());
    let bbox = |truth: &TruthBox| BBox::new(truth.x, truth.y, truth.w, truth.h);
    let mut buffer = FrameBuffer::default();
    for index in 0..frames {
        let truth = flight.render(index, &mut buffer);
        let frame = Frame::new(&buffer.data, buffer.width, buffer.height, ChannelOrder::Rgb)
            .map_err(|error| Failure::Nothing(format!("seed {seed} frame {index}: {error}")))?;
        let truth = Truth {
            bbox: bbox(&truth.bbox),
            visible: truth.visible,
            others: truth.distractors.iter().map(bbox).collect(),
        };
        each(index, &frame, &truth)?;
    }
    Ok(())
}

impl Footage {
    fn play(
        &self,
        mut each: impl FnMut(usize, &Frame<'_>, &Truth) -> Result<(), Failure>,
    ) -> Result<(), Failure> {
        let occluders = self.occluders()?;
        let occluder = |wanted: usize| {
            let found = occluders.iter().find(|(index, _)| *index == wanted);
            found.map(|(_, image)| image)
        };
        let mut view = View::default();
        let mut last = BBox::default();
        for (index, path) in self.frames.iter().enumerate() {
            let image = read(path)?;
            let bbox = self.boxes.get(index).copied().flatten();
            last = bbox.unwrap_or(last);
            let (frame, shown, visible) = match &self.panning {
                None => (image.frame(), last, if bbox.is_some() { 1.0 } else { 0.0 }),
                Some(panning) => {
                    let (shown, visible) =
                        panning.show(index, &image, bbox, last, occluder, &mut view);
                    let frame = Frame::new(&view.data, view.width, view.height, ChannelOrder::Rgb)
                        .map_err(|error| Failure::File(path.clone(), error.to_string()))?;
                    (frame, shown, visible)
                }
            };
            let truth = Truth {
                bbox: shown,
                visible,
                others: Vec::new(),
            };
            each(index, &frame, &truth)?;
        }
        Ok(())
    }

    /// The pictures that the plan draws, with their indices.
    fn occluders(&self) -> Result<Vec<(usize, Image)>, Failure> {
        let mut occluders = Vec::new();
        for index in self.panning.iter().flat_map(Panning::occluders) {
            if let Some(path) = self.stills.get(index) {
                occluders.push((index, read(path)?));
            }
        }
        Ok(occluders)
    }
}

/// What `work` makes of each clip, in their order, on `jobs` threads.
///
/// # Errors
/// The first clip's that fails.
pub fn each_clip<T: Send>(
    clips: &[Clip],
    jobs: usize,
    work: impl Fn(&Clip) -> Result<T, Failure> + Sync,
) -> Result<Vec<T>, Failure> {
    each(jobs, clips.len(), |index| work(&clips[index]))
}

/// What `work` makes of each index below `count`, in their order, on `jobs` threads.
///
/// # Errors
/// The first index's that fails.
pub fn each<T: Send>(
    jobs: usize,
    count: usize,
    work: impl Fn(usize) -> Result<T, Failure> + Sync,
) -> Result<Vec<T>, Failure> {
    let next = AtomicU64::new(0);
    let done = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..jobs.clamp(1, 64) {
            scope.spawn(|| {
                loop {
                    let index = next.fetch_add(1, Ordering::Relaxed) as usize;
                    if index >= count {
                        return;
                    }
                    let result = work(index);
                    eprintln!("{} of {count}", index + 1);
                    if let Ok(mut done) = done.lock() {
                        done.push((index, result));
                    }
                }
            });
        }
    });
    let mut done = done
        .into_inner()
        .map_err(|_| Failure::Nothing("a worker failed".into()))?;
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, result)| result).collect()
}
