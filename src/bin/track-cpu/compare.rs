//! `compare`: the boxes of several trackers in one film or contact sheet.

use std::path::Path;

use image::{Rgb, RgbImage};
use program::check_outputs;
use sequences::{Rect, text};
use track_cpu::source::{Input, Source};
use track_cpu::{BBox, Frame};

use crate::args::compare::CompareArgs;
use crate::exit::Failure;
use crate::film::Film;
use crate::overlay::{AMBER, Canvas, WHITE};
use crate::sheet;

/// One color per tracker, told apart on most grounds.
const COLORS: [Rgb<u8>; 8] = [
    AMBER,
    Rgb([64, 200, 255]),
    Rgb([255, 90, 220]),
    Rgb([110, 255, 110]),
    Rgb([255, 90, 60]),
    WHITE,
    Rgb([160, 130, 255]),
    Rgb([0, 220, 180]),
];
/// Pictures of a contact sheet at most.
const MAX_PICTURES: usize = 16;
/// Width of a picture of a contact sheet.
const SHEET_WIDTH: u32 = 400;

/// A tracker's boxes.
struct Tracker {
    name: String,
    color: Rgb<u8>,
    boxes: Vec<Rect>,
}

/// Runs the sub-command.
pub fn run(args: &CompareArgs) -> Result<(), Failure> {
    let mut trackers = Vec::new();
    for (path, color) in args.boxes.iter().zip(COLORS) {
        trackers.push(Tracker {
            name: path
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            color,
            boxes: text::read_boxes(path)?,
        });
    }
    let source = Source::open(&Input::new(&args.input))?;
    let is_sheet = args
        .out
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("png"));
    let first = if is_sheet {
        args.out.clone()
    } else {
        Film::first_file(&args.out)
    };
    let mut inputs: Vec<&Path> = source
        .places()
        .iter()
        .map(|place| place.as_path())
        .collect();
    inputs.extend(args.boxes.iter().map(|path| path.as_path()));
    check_outputs(&[("--out", &first)], &inputs)?;

    let frames = if is_sheet {
        draw_sheet(&args.out, source, &trackers)?
    } else {
        draw_film(&args.out, source, &trackers)?
    };
    for tracker in &trackers {
        let boxes = tracker.boxes.len();
        if boxes != frames {
            eprintln!(
                "note: {} has {boxes} boxes for {frames} frames",
                tracker.name
            );
        }
    }
    Ok(())
}

/// Draws every frame; returns how many there were.
fn draw_film(out: &Path, mut source: Source, trackers: &[Tracker]) -> Result<usize, Failure> {
    let mut film = Film::create(out)?;
    let mut index = 0;
    while let Some(image) = source.next() {
        let image = image.map_err(Failure::at_frame(index))?;
        film.add(index, &image.frame(), |canvas| {
            draw(canvas, index, trackers)
        })?;
        source.recycle(image);
        index += 1;
    }
    film.finish()?;
    Ok(index)
}

/// Draws frames that are evenly spread over the whole input; returns how many there were.
fn draw_sheet(out: &Path, mut source: Source, trackers: &[Tracker]) -> Result<usize, Failure> {
    let mut pictures: Vec<RgbImage> = Vec::new();
    let mut size = None;
    let mut step = 1;
    let mut index = 0;
    while let Some(image) = source.next() {
        let image = image.map_err(Failure::at_frame(index))?;
        if index % step == 0 {
            let frame = image.frame();
            let (width, height) = *size.get_or_insert_with(|| sheet_size(&frame));
            let mut canvas = Canvas::fitted(&frame, width, height);
            draw(&mut canvas, index, trackers);
            pictures.push(canvas.picture);
        }
        // The length of a video is not known: every second picture gives way when there are many.
        if pictures.len() > MAX_PICTURES {
            let mut is_kept = [false, true].into_iter().cycle();
            pictures.retain(|_| is_kept.next() == Some(false));
            step *= 2;
        }
        source.recycle(image);
        index += 1;
    }
    let legend: Vec<sheet::Entry<'_>> = trackers
        .iter()
        .map(|tracker| (tracker.name.as_str(), tracker.color, 4))
        .collect();
    let title = format!("{} trackers   {index} frames", trackers.len());
    sheet::write(out, &title, "", &legend, &pictures)?;
    Ok(index)
}

/// The size of a frame's picture in a contact sheet.
fn sheet_size(frame: &Frame<'_>) -> (u32, u32) {
    let (w, h) = (frame.width() as u32, frame.height() as u32);
    let width = w.min(SHEET_WIDTH);
    (width, (h * width / w).clamp(1, 2 * SHEET_WIDTH))
}

/// Draws the frame's box of each tracker, and the legend.
fn draw(canvas: &mut Canvas, index: usize, trackers: &[Tracker]) {
    let mut lines = Vec::new();
    for tracker in trackers {
        let rect = tracker.boxes.get(index).filter(|rect| rect.is_usable());
        if let Some(rect) = rect {
            let [x, y, w, h] = rect.to_f32();
            canvas.outlined(&BBox::new(x, y, w, h), tracker.color);
        }
        lines.push((tracker.name.clone(), tracker.color));
    }
    lines.push((format!("#{index}"), WHITE));
    canvas.captions(&lines);
}
