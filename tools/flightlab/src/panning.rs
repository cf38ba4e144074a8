//! A virtual camera over real footage: absences with exact truth.
//!
//! The camera shows a window of every picture that follows the target with some wobble. Now and
//! then the window moves away until the target has left it, and comes back; or a piece of another
//! picture passes in front of the target. How much of the target is visible is known exactly.

use std::f32::consts::TAU;

use track_cpu::source::Image;
use track_cpu::{BBox, ChannelOrder};

use crate::chance::Chance;

/// Share of the picture's width that the window has, at least and at most.
const WINDOW: (f32, f32) = (0.45, 0.62);
/// Width of the window in sides of the target, at least.
const ROOM: f32 = 2.2;
/// Least width of a picture, in pixels.
const LEAST_WIDTH: usize = 500;
/// Least number of frames.
const LEAST_FRAMES: usize = 90;
/// Frames before the first event, so that the target is known.
const QUIET: usize = 25;
/// Frames in which the target goes, and in which it comes back.
const RAMP: usize = 12;
/// Frames that the target is gone for.
const HOLD: (f32, f32) = (8.0, 41.0);
/// Frames between two events.
const PAUSE: (f32, f32) = (25.0, 51.0);
/// Frames at the end without a new event.
const TAIL: usize = 30;
/// Standard deviation of a step of the wobble, as a share of the window's width.
const WOBBLE: f32 = 0.012;
/// Share of the wobble that is left after a frame.
const KEPT: f32 = 0.95;
/// Side of an occluder in sides of the target, and its least side in pixels.
const OCCLUDER: (f32, f32) = (1.7, 24.0);
/// Way of an occluder before and after it covers the target, in sides of the target.
const APPROACH: f32 = 1.9;
/// Share visible below which a target counts as gone altogether.
const TRACE: f32 = 0.1;

/// What happens to the target for a while.
#[derive(Clone, Copy, Debug)]
struct Event {
    start: usize,
    hold: usize,
    angle: f32,
    way: Way,
}

/// How the target goes.
#[derive(Clone, Copy, Debug)]
enum Way {
    /// The window moves off; it comes back from a direction turned by so much.
    Exit { turn: f32, side: (f32, f32) },
    /// An occluder passes: index of its picture.
    Occlusion(usize),
}

/// A plan for one sequence.
#[derive(Clone, Debug)]
pub struct Panning {
    width: usize,
    height: usize,
    events: Vec<Event>,
    wobble: Vec<(f32, f32)>,
}

/// One picture of the virtual camera.
#[derive(Clone, Debug, Default)]
pub struct View {
    /// RGB pixels.
    pub data: Vec<u8>,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

impl Panning {
    /// A plan for pictures of `size` with these annotations; `None` if the target is too large for
    /// a window, the picture too small, or the sequence too short. `occluders` are available.
    pub fn plan(
        size: (usize, usize),
        boxes: &[Option<BBox>],
        occluders: usize,
        seed: u64,
    ) -> Option<Panning> {
        let aspect = size.0 as f32 / size.1.max(1) as f32;
        let largest = boxes
            .iter()
            .flatten()
            .fold(0.0f32, |most, b| most.max(b.w).max(b.h * 16.0 / 9.0));
        let full = size.0 as f32;
        let width = (ROOM * largest)
            .max(WINDOW.0 * full)
            .min(WINDOW.1 * full)
            .floor();
        if size.0 < LEAST_WIDTH || boxes.len() < LEAST_FRAMES || 1.3 * largest > width {
            return None;
        }
        let mut chance = Chance::new(seed);
        let mut events = Vec::new();
        let mut at = QUIET;
        while at + TAIL < boxes.len() {
            let hold = chance.between(HOLD.0, HOLD.1) as usize;
            let angle = chance.between(0.0, TAU);
            let turn = chance.between(0.3, 1.3) * if chance.unit() < 0.5 { 1.0 } else { -1.0 };
            let side = boxes[at].map_or((30.0, 30.0), |b| (b.w, b.h));
            let way = if chance.unit() < 0.5 || occluders == 0 {
                Way::Exit { turn, side }
            } else {
                Way::Occlusion(chance.below(occluders))
            };
            events.push(Event {
                start: at,
                hold,
                angle,
                way,
            });
            at += hold + 2 * RAMP + chance.between(PAUSE.0, PAUSE.1) as usize;
        }
        let mut wobble = Vec::with_capacity(boxes.len());
        let (mut x, mut y) = (0.0, 0.0);
        for _ in boxes {
            x = KEPT * x + chance.normal() * WOBBLE * width;
            y = KEPT * y + chance.normal() * WOBBLE * width;
            wobble.push((x, y));
        }
        Some(Panning {
            width: width as usize,
            height: (width / aspect) as usize,
            events,
            wobble,
        })
    }

    /// Indices of the occluders that the plan needs.
    pub fn occluders(&self) -> impl Iterator<Item = usize> {
        self.events.iter().filter_map(|event| match event.way {
            Way::Occlusion(index) => Some(index),
            Way::Exit { .. } => None,
        })
    }

    /// Shows a picture with the target in `target`, if it is there, or else near `last`. Returns
    /// the target's box in the view and the share of it that is visible.
    pub fn show<'a>(
        &self,
        index: usize,
        image: &Image,
        target: Option<BBox>,
        last: BBox,
        occluder: impl Fn(usize) -> Option<&'a Image>,
        view: &mut View,
    ) -> (BBox, f32) {
        let bbox = target.unwrap_or(last);
        let center = (bbox.x + bbox.w / 2.0, bbox.y + bbox.h / 2.0);
        let mut canvas = rgb(image);
        let mut offset = self.wobble.get(index).copied().unwrap_or_default();
        let mut visible = if target.is_some() { 1.0f32 } else { 0.0 };
        for event in &self.events {
            let Some(since) = index.checked_sub(event.start) else {
                continue;
            };
            if since > event.hold + 2 * RAMP {
                continue;
            }
            match event.way {
                Way::Exit { turn, side } => {
                    let (far, share) = self.away(event, since, turn, side);
                    offset.0 = offset.0 * (1.0 - share) + far.0 * share;
                    offset.1 = offset.1 * (1.0 - share) + far.1 * share;
                }
                Way::Occlusion(which) => {
                    let Some(picture) = occluder(which).filter(|_| target.is_some()) else {
                        continue;
                    };
                    let cover = event.cover(since, &bbox, center);
                    paste(picture, &mut canvas, image.width, image.height, &cover);
                    visible = visible.min(1.0 - covered(&bbox, &cover));
                }
            }
        }
        let most = (image.width - self.width, image.height - self.height);
        let start = |center: f32, offset: f32, side: usize, most: usize| {
            (center + offset - side as f32 / 2.0)
                .clamp(0.0, most as f32)
                .round()
        };
        let x = start(center.0, offset.0, self.width, most.0);
        let y = start(center.1, offset.1, self.height, most.1);
        view.width = self.width;
        view.height = self.height;
        view.data.clear();
        for row in 0..self.height {
            let from = 3 * ((y as usize + row) * image.width + x as usize);
            view.data
                .extend_from_slice(&canvas[from..from + 3 * self.width]);
        }
        let shown = BBox::new(bbox.x - x, bbox.y - y, bbox.w, bbox.h);
        let window = BBox::new(0.0, 0.0, self.width as f32, self.height as f32);
        visible *= covered(&shown, &window);
        (shown, if visible < TRACE { 0.0 } else { visible })
    }

    /// How far the window is from the target during an exit, and how much of that way it has gone.
    fn away(&self, event: &Event, since: usize, turn: f32, side: (f32, f32)) -> ((f32, f32), f32) {
        let (since, hold) = (since as f32, event.hold as f32);
        let ramp = RAMP as f32;
        let gone = if since < ramp + hold / 2.0 {
            smooth(since / ramp)
        } else {
            smooth((hold + 2.0 * ramp - since) / ramp)
        };
        let angle = event.angle + turn * smooth((since - ramp) / hold.max(1.0));
        let reach_x = 0.5 * self.width as f32 + 0.8 * side.0 + 6.0;
        let reach_y = 0.5 * self.height as f32 + 0.8 * side.1 + 6.0;
        let (x, y) = (angle.cos() * reach_x, angle.sin() * reach_y);
        // The nearer way out of the window must be gone on one axis at least.
        let scale = (x.abs() / reach_x).max(y.abs() / reach_y).max(1e-6);
        ((x / scale, y / scale), gone)
    }
}

impl Event {
    /// Where the occluder is.
    fn cover(&self, since: usize, target: &BBox, center: (f32, f32)) -> BBox {
        let w = (OCCLUDER.0 * target.w).max(OCCLUDER.1);
        let h = (OCCLUDER.0 * target.h).max(OCCLUDER.1);
        let from_middle = since as f32 - RAMP as f32 - self.hold as f32 / 2.0;
        let outside = (from_middle.abs() - self.hold as f32 / 2.0).max(0.0);
        let reach = (outside / RAMP as f32 * APPROACH).copysign(from_middle);
        let x = center.0 + reach * self.angle.cos() * target.w;
        let y = center.1 + reach * self.angle.sin() * target.h;
        BBox::new(x - w / 2.0, y - h / 2.0, w, h)
    }
}

/// Share of a box that another one covers.
fn covered(bbox: &BBox, by: &BBox) -> f32 {
    let w = (bbox.x + bbox.w).min(by.x + by.w) - bbox.x.max(by.x);
    let h = (bbox.y + bbox.h).min(by.y + by.h) - bbox.y.max(by.y);
    w.max(0.0) * h.max(0.0) / (bbox.w * bbox.h).max(1e-6)
}

/// The picture's pixels as RGB.
pub fn rgb(image: &Image) -> Vec<u8> {
    if image.order == ChannelOrder::Rgb {
        return image.data.clone();
    }
    image.frame().to_rgb()
}

/// Draws a picture into a box of a canvas, averaging over the pixels that fall into one.
fn paste(picture: &Image, canvas: &mut [u8], width: usize, height: usize, at: &BBox) {
    let frame = picture.frame();
    let (x0, y0) = (at.x.max(0.0) as usize, at.y.max(0.0) as usize);
    let x1 = ((at.x + at.w).max(0.0) as usize).min(width);
    let y1 = ((at.y + at.h).max(0.0) as usize).min(height);
    let span = |near: f32, side: f32, pixels: usize| {
        let from = (near / side * pixels as f32).max(0.0) as usize;
        let to = ((near + 1.0) / side * pixels as f32).max(0.0) as usize;
        let from = from.min(pixels - 1);
        (from, to.clamp(from + 1, pixels))
    };
    for y in y0..y1 {
        let (top, low) = span(y as f32 - at.y, at.h, picture.height);
        for x in x0..x1 {
            let (left, right) = span(x as f32 - at.x, at.w, picture.width);
            let mut sum = [0u32; 3];
            for row in top..low {
                for column in left..right {
                    let [blue, green, red] = frame.bgr(column, row).map(u32::from);
                    sum[0] += red;
                    sum[1] += green;
                    sum[2] += blue;
                }
            }
            let count = ((low - top) * (right - left)) as u32;
            for (channel, sum) in canvas[3 * (y * width + x)..][..3].iter_mut().zip(sum) {
                *channel = (sum / count) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize, value: u8) -> Image {
        Image {
            data: vec![value; 3 * width * height],
            width,
            height,
            order: ChannelOrder::Rgb,
            name: None,
        }
    }

    #[test]
    fn planned_target_leaves_and_returns() {
        let bbox = BBox::new(500.0, 300.0, 40.0, 30.0);
        let boxes = vec![Some(bbox); 400];
        let image = picture(1000, 600, 90);
        let patch = picture(50, 50, 200);
        let plan = Panning::plan((1000, 600), &boxes, 3, 5).unwrap();
        let mut view = View::default();

        let seen: Vec<(BBox, f32)> = (0..boxes.len())
            .map(|i| plan.show(i, &image, Some(bbox), bbox, |_| Some(&patch), &mut view))
            .collect();

        assert_eq!(view.data.len(), 3 * view.width * view.height);
        assert!(seen[..QUIET].iter().all(|(_, visible)| *visible > 0.99));
        let gone = seen.iter().filter(|(_, visible)| *visible == 0.0).count();
        assert!((20..300).contains(&gone), "{gone}");
        assert!(seen.iter().all(|(b, _)| b.w == 40.0 && b.h == 30.0));
    }

    #[test]
    fn occluder_covers_its_box_only() {
        let mut canvas = vec![0u8; 3 * 20 * 10];

        paste(
            &picture(7, 5, 100),
            &mut canvas,
            20,
            10,
            &BBox::new(-3.0, 2.0, 8.0, 4.0),
        );

        for y in 0..10 {
            for x in 0..20 {
                let expected = if x < 5 && (2..6).contains(&y) { 100 } else { 0 };
                assert_eq!(canvas[3 * (y * 20 + x)], expected, "{x} {y}");
            }
        }
    }

    #[test]
    fn unsuitable_footage_has_no_plan() {
        let small = vec![Some(BBox::new(0.0, 0.0, 20.0, 20.0)); 200];
        let large = vec![Some(BBox::new(0.0, 0.0, 500.0, 300.0)); 200];

        assert!(Panning::plan((400, 300), &small, 0, 1).is_none());
        assert!(Panning::plan((900, 600), &small[..50], 0, 1).is_none());
        assert!(Panning::plan((900, 600), &large, 0, 1).is_none());
    }
}
