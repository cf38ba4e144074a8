//! `demo`: a rendered flight, tracked from its first true box and shown beside the truth.

use std::path::Path;
use std::time::Instant;

use image::RgbImage;
use program::check_outputs;
use scenes::{Flight, FlightConfig, FrameBuffer, Truth};
use sequences::{Annotation, Convention, Curves, Judgment, Rect};
use serde_json::json;
use track_cpu::{BBox, ChannelOrder, Frame, Tracker};

use crate::args::demo::DemoArgs;
use crate::exit::Failure;
use crate::film::Film;
use crate::overlay::{AMBER, Canvas, WHITE};
use crate::report::{print, progress, rounded};
use crate::sheet;
use crate::statistics::Times;

/// Pictures on the contact sheet.
const PICTURES: usize = 12;
/// A frame counts if more of the object than this is visible.
const LEAST_VISIBLE: f32 = 0.3;

/// Runs the sub-command.
pub fn run(args: &DemoArgs) -> Result<(), Failure> {
    let model = args.engine.model(args.model.name())?;
    let options = args.engine.options(&model);
    let mut tracker = Tracker::with_options(model, options);
    let gif = args.out.join("demo.gif");
    let sheet = args.out.join("sheet.png");
    let inputs: Vec<&Path> = args.model.name().into_iter().collect();
    check_outputs(&[("--out", &gif), ("--out", &sheet)], &inputs)?;
    std::fs::create_dir_all(&args.out).map_err(|error| Failure::output(&args.out, error))?;
    let mut film = Film::create(&gif)?;

    let config = FlightConfig {
        frames: args.frames,
        seed: args.seed,
        difficulty: args.difficulty,
        ..FlightConfig::default()
    };
    let (width, height) = (config.width, config.height);
    let flight = Flight::new(config);
    let mut buffer = FrameBuffer::default();
    let mut pictures = Vec::new();
    let mut times = Vec::new();
    let mut true_boxes = Vec::new();
    let mut found_boxes = Vec::new();
    let bar = progress(Some(args.frames));
    for index in 0..args.frames {
        let truth = flight.render(index, &mut buffer);
        let frame = Frame::new(&buffer.data, buffer.width, buffer.height, ChannelOrder::Rgb)?;
        let true_box = bbox(&truth);
        let started = Instant::now();
        let (found, score) = if index == 0 {
            tracker.init(&frame, true_box)?;
            (true_box, None)
        } else {
            let track = tracker.update(&frame)?;
            times.push(started.elapsed());
            (track.bbox, Some(track.score))
        };
        true_boxes.push(if truth.visible > LEAST_VISIBLE {
            rect(&true_box)
        } else {
            Rect::NONE
        });
        found_boxes.push(rect(&found));
        let draw = |canvas: &mut Canvas| {
            if truth.visible > 0.0 {
                canvas.truth(&true_box);
            }
            canvas.found(&found, score);
            canvas.caption(&caption(index, &truth));
        };
        film.add(index, &frame, draw)?;
        if is_pictured(index, args.frames) {
            pictures.push(picture(&frame, draw));
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    film.finish()?;

    let (iou, precision) = accuracy(true_boxes, &found_boxes);
    let fps = Times::new(&times).fps();
    let frames = args.frames;
    let seed = args.seed;
    let summary =
        format!("mean IoU {iou:.3}   precision@20px {precision:.3}   {fps:.0} FPS on the CPU");
    let difficulty = args.difficulty;
    let title = format!(
        "track-cpu demo   {difficulty} flight {seed}   {frames} frames of {width}x{height}"
    );
    let meanings = [("truth", WHITE, 2), ("track-cpu", AMBER, 4)];
    sheet::write(&sheet, &title, &summary, &meanings, &pictures)?;
    print(&format!("{title}\n{summary}"))?;
    if args.json {
        let result = json!({
            "mean_iou": rounded(iou, 4),
            "precision_20": rounded(precision, 4),
            "fps": rounded(fps, 2),
            "frames": frames,
        });
        print(&result.to_string())?;
    }
    eprintln!(
        "film: {}\ncontact sheet: {}",
        gif.display(),
        sheet.display()
    );
    Ok(())
}

/// A true box as the tracker takes it: the same edges.
fn bbox(truth: &Truth) -> BBox {
    BBox::new(truth.bbox.x, truth.bbox.y, truth.bbox.w, truth.bbox.h)
}

fn rect(bbox: &BBox) -> Rect {
    Rect::from([bbox.x, bbox.y, bbox.w, bbox.h])
}

/// Mean IoU and precision at 20 pixels over the frames behind the first in which the object is
/// visible, by the rule of the got10k toolkit; 0 without such frames.
fn accuracy(true_boxes: Vec<Rect>, found_boxes: &[Rect]) -> (f64, f64) {
    let annotation = Annotation::new("demo", true_boxes);
    let judged = Convention::Got10k.judge(&annotation, found_boxes);
    let judged: Vec<Judgment> = judged.into_iter().skip(1).flatten().collect();
    let count = judged.len();
    let overlap: f64 = judged.iter().map(|judgment| judgment.overlap).sum();
    let curves = Curves::of(judged, count);
    let precision = curves.map_or(0.0, |curves| curves.precision());
    (overlap / count.max(1) as f64, precision)
}

fn caption(index: usize, truth: &Truth) -> String {
    match truth.visible {
        v if v <= 0.0 => format!("#{index} out of sight"),
        v if v <= LEAST_VISIBLE => format!("#{index} hidden"),
        _ => format!("#{index}"),
    }
}

/// Whether a frame is one of the [`PICTURES`], evenly spread from the first to the last.
fn is_pictured(index: usize, frames: usize) -> bool {
    let count = PICTURES.min(frames);
    (0..count).any(|i| i * (frames - 1) / (count - 1).max(1) == index)
}

fn picture(frame: &Frame<'_>, draw: impl FnOnce(&mut Canvas)) -> RgbImage {
    let mut canvas = Canvas::fitted(frame, frame.width() as u32 / 2, frame.height() as u32 / 2);
    draw(&mut canvas);
    canvas.picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_spread() {
        for frames in [2, 3, 11, 12, 13, 300] {
            let pictured: Vec<usize> = (0..frames).filter(|&i| is_pictured(i, frames)).collect();
            assert_eq!(pictured.len(), PICTURES.min(frames), "{frames}");
            assert_eq!((pictured[0], *pictured.last().unwrap()), (0, frames - 1));
        }
    }
}
