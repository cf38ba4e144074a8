//! Contact sheets of losses: the pass's first frame and the frames around the loss.

use super::Loss;
use crate::error::Error;
use crate::picture::{decode, rgb};
use crate::run::failure;
use crate::score::Evaluated;
use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use sequences::{Rect, Sequence};

/// The frames shown after the pass's first one, relative to the first frame off the target.
const FRAMES: [i64; 7] = [-20, -8, -3, 0, 3, 8, 20];
/// Side of a picture on the sheet in pixels.
const TILE: u32 = 192;
/// Pixels between pictures.
const GAP: u32 = 4;
/// Pictures side by side.
const COLUMNS: u32 = 4;
/// Least side of the part of a frame that is shown, in sides of the target.
const AROUND: f64 = 5.0;
/// Side of the part that is shown, in sides of the smallest square around both boxes.
const MARGIN: f64 = 1.3;

const TRUTH: Rgb<u8> = Rgb([255, 255, 255]);
const FOUND: Rgb<u8> = Rgb([213, 94, 0]);
const BACKGROUND: Rgb<u8> = Rgb([40, 40, 40]);

/// The frames of a loss, each cut out around the truth (white) and the tracker's box (orange).
///
/// # Errors
/// If a picture cannot be read.
pub fn sheet(loss: &Loss, pass: &Evaluated, sequence: &Sequence) -> Result<RgbImage, Error> {
    let annotated = pass.annotation.boxes.len().min(sequence.frames.len());
    let frames = pass.boxes.len().min(annotated);
    let mut shown = vec![0];
    for offset in FRAMES {
        let frame = loss.frame as i64 + offset;
        if frame > 0 && (frame as usize) < frames {
            shown.push(frame as usize);
        }
    }
    let rows = (shown.len() as u32).div_ceil(COLUMNS);
    let extent = |count: u32| count * (TILE + GAP) + GAP;
    let mut sheet = RgbImage::from_pixel(extent(COLUMNS), extent(rows), BACKGROUND);
    for (i, frame) in (0u32..).zip(shown) {
        let truth = pass.annotation.boxes[frame];
        let tile = tile(loss, sequence, frame, truth, pass.boxes[frame])?;
        let x = extent(i % COLUMNS);
        let y = extent(i / COLUMNS);
        imageops::replace(&mut sheet, &tile, x.into(), y.into());
    }
    Ok(sheet)
}

/// One frame of the sheet, with the outlines of both boxes.
fn tile(
    loss: &Loss,
    sequence: &Sequence,
    frame: usize,
    truth: Rect,
    found: Rect,
) -> Result<RgbImage, Error> {
    let wrong = |reason: String| failure(&loss.pass, reason);
    let image = decode(&sequence.frames[frame]).map_err(wrong)?;
    let picture = rgb(&image).ok_or_else(|| wrong("an empty picture".into()))?;
    let part = part(&picture, truth, found);
    let side = part.w as u32;
    let cut = imageops::crop_imm(&picture, part.x as u32, part.y as u32, side, part.h as u32);
    let scale = f64::from(TILE) / part.w.max(part.h);
    let width = ((part.w * scale).round() as u32).max(1);
    let height = ((part.h * scale).round() as u32).max(1);
    let mut tile = imageops::resize(&cut.to_image(), width, height, FilterType::Triangle);
    for (rect, color) in [(truth, TRUTH), (found, FOUND)] {
        if rect.is_usable() {
            let [x, y] = [rect.x - part.x, rect.y - part.y].map(|v| v * scale);
            outline(
                &mut tile,
                Rect::new(x, y, rect.w * scale, rect.h * scale),
                color,
            );
        }
    }
    Ok(tile)
}

/// The part of a picture that is shown, in whole pixels: a square around both boxes, moved into the
/// picture.
fn part(picture: &RgbImage, truth: Rect, found: Rect) -> Rect {
    let width = f64::from(picture.width());
    let height = f64::from(picture.height());
    let boxes: Vec<Rect> = [truth, found].into_iter().filter(Rect::is_usable).collect();
    let corners: Vec<(f64, f64)> = boxes
        .iter()
        .flat_map(|b| [(b.x, b.y), (b.x + b.w, b.y + b.h)])
        .collect();
    if corners.is_empty() {
        return Rect::new(0.0, 0.0, width, height);
    }
    let around = Rect::around(&corners);
    let least = boxes[0].side() * AROUND;
    let side = (around.w.max(around.h) * MARGIN).max(least).ceil();
    let (w, h) = (side.min(width).max(1.0), side.min(height).max(1.0));
    let x = (around.x + around.w / 2.0 - w / 2.0).clamp(0.0, width - w);
    let y = (around.y + around.h / 2.0 - h / 2.0).clamp(0.0, height - h);
    Rect::new(x.floor(), y.floor(), w.floor(), h.floor())
}

/// Draws the outline of a box, two pixels wide; what lies outside the picture is not drawn.
fn outline(picture: &mut RgbImage, rect: Rect, color: Rgb<u8>) {
    let width = f64::from(picture.width());
    let height = f64::from(picture.height());
    let clip = |value: f64, end: f64| value.round().clamp(0.0, end) as u32;
    let mut fill = |left: f64, top: f64, right: f64, bottom: f64| {
        for y in clip(top, height)..clip(bottom, height) {
            for x in clip(left, width)..clip(right, width) {
                picture.put_pixel(x, y, color);
            }
        }
    };
    let right = rect.x + rect.w;
    let bottom = rect.y + rect.h;
    fill(rect.x - 1.0, rect.y - 1.0, right + 1.0, rect.y + 1.0);
    fill(rect.x - 1.0, bottom - 1.0, right + 1.0, bottom + 1.0);
    fill(rect.x - 1.0, rect.y - 1.0, rect.x + 1.0, bottom + 1.0);
    fill(right - 1.0, rect.y - 1.0, right + 1.0, bottom + 1.0);
}
