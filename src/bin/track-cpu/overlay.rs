//! Boxes and captions drawn into a copy of a frame.

use image::{Rgb, RgbImage, imageops};
use track_cpu::{BBox, Frame};

use crate::font;

/// Our boxes.
pub const AMBER: Rgb<u8> = Rgb([255, 196, 0]);
/// The true boxes.
pub const WHITE: Rgb<u8> = Rgb([255, 255, 255]);
/// Low scores.
const RED: Rgb<u8> = Rgb([255, 64, 48]);
const BLACK: Rgb<u8> = Rgb([0, 0, 0]);

/// A picture to draw on, and how frame pixels map to it.
pub struct Canvas {
    /// The picture.
    pub picture: RgbImage,
    scale: (f32, f32), // canvas pixels per frame pixel
    unit: i32,         // side of one pixel of a letter
}

impl Canvas {
    /// A copy of the frame in its own size.
    pub fn new(frame: &Frame<'_>) -> Canvas {
        Canvas::fitted(frame, frame.width() as u32, frame.height() as u32)
    }

    /// A copy of the frame in this size.
    pub fn fitted(frame: &Frame<'_>, width: u32, height: u32) -> Canvas {
        let (w, h) = (frame.width(), frame.height());
        let mut picture =
            RgbImage::from_raw(w as u32, h as u32, frame.to_rgb()).expect("three bytes per pixel");
        if picture.dimensions() != (width, height) {
            picture = imageops::thumbnail(&picture, width, height);
        }
        let scale = (width as f32 / w as f32, height as f32 / h as f32);
        Canvas {
            picture,
            scale,
            unit: (width as i32 / 500).max(1),
        }
    }

    /// A canvas of one color, drawn on in its own pixels.
    pub fn blank(width: u32, height: u32, color: Rgb<u8>) -> Canvas {
        Canvas {
            picture: RgbImage::from_pixel(width, height, color),
            scale: (1.0, 1.0),
            unit: 1,
        }
    }

    /// A thin white outline: where the object really is.
    pub fn truth(&mut self, bbox: &BBox) {
        let [x0, y0, x1, y1] = self.edges(bbox);
        self.outline([x0, y0, x1, y1], self.unit, WHITE, 0.9);
    }

    /// A bold outline with its score in figures and as a bar: where the tracker sees the object.
    pub fn found(&mut self, bbox: &BBox, score: Option<f32>) {
        self.target(bbox, "", score);
    }

    /// What [`found`](Self::found) draws, with a name before the score.
    pub fn target(&mut self, bbox: &BBox, name: &str, score: Option<f32>) {
        let (edges @ [x0, y0, x1, y1], t) = (self.edges(bbox), 2 * self.unit);
        self.outline(
            [x0 - t - 1, y0 - t - 1, x1 + t + 1, y1 + t + 1],
            t + 2,
            BLACK,
            0.45,
        );
        self.outline([x0 - t, y0 - t, x1 + t, y1 + t], t, AMBER, 1.0);
        let figures = score.map(|score| format!("{score:.2}"));
        let text = [name, figures.as_deref().unwrap_or_default()].join(" ");
        let text = text.trim();
        if text.is_empty() {
            return;
        }
        let (w, h) = (
            text_width(text, self.unit) + 4 * self.unit,
            (font::HEIGHT as i32 + 6) * self.unit,
        );
        let x = (edges[0] - t).clamp(0, (self.picture.width() as i32 - w).max(0));
        let above = y0 - t - h - self.unit;
        let y = if above >= 0 {
            above
        } else {
            y1 + t + self.unit
        };
        self.fill([x, y, x + w, y + h], BLACK, 0.6);
        self.text(x + 2 * self.unit, y + 2 * self.unit, text, self.unit, WHITE);
        let Some(score) = score else {
            return;
        };
        let color = mix(RED, AMBER, score);
        let bar = ((w - 4 * self.unit) as f32 * score.clamp(0.0, 1.0)).round() as i32;
        let bottom = y + h - self.unit;
        self.fill(
            [
                x + 2 * self.unit,
                bottom - 2 * self.unit,
                x + 2 * self.unit + bar,
                bottom,
            ],
            color,
            1.0,
        );
    }

    /// A bold outline in this color: where one of several trackers sees the object.
    pub fn outlined(&mut self, bbox: &BBox, color: Rgb<u8>) {
        let [x0, y0, x1, y1] = self.edges(bbox);
        let t = 2 * self.unit;
        let around = [x0 - t - 1, y0 - t - 1, x1 + t + 1, y1 + t + 1];
        self.outline(around, t + 2, BLACK, 0.45);
        self.outline([x0 - t, y0 - t, x1 + t, y1 + t], t, color, 1.0);
    }

    /// A line of text on a dark plate in the lower left corner.
    pub fn caption(&mut self, text: &str) {
        self.captions(&[(text.to_string(), WHITE)]);
    }

    /// Lines of text in their colors, one below the other, in the lower left corner.
    pub fn captions(&mut self, lines: &[(String, Rgb<u8>)]) {
        let margin = 3 * self.unit;
        let line_height = font::HEIGHT as i32 * self.unit + 2 * margin;
        let mut bottom = self.picture.height() as i32;
        for (text, color) in lines.iter().rev() {
            let top = bottom - line_height;
            self.fill(
                [0, top, text_width(text, self.unit) + 2 * margin, bottom],
                BLACK,
                0.6,
            );
            self.text(margin, top + margin, text, self.unit, *color);
            bottom = top;
        }
    }

    /// Text whose upper left corner is at `(x, y)`; a letter's pixel has `unit` canvas pixels a
    /// side.
    pub fn text(&mut self, x: i32, y: i32, text: &str, unit: i32, color: Rgb<u8>) {
        for (i, letter) in text.chars().enumerate() {
            let left = x + i as i32 * (font::WIDTH as i32 + 1) * unit;
            for (row, bits) in font::glyph(letter).into_iter().enumerate() {
                for column in 0..font::WIDTH {
                    if bits >> (font::WIDTH - 1 - column) & 1 == 1 {
                        let (x, y) = (left + column as i32 * unit, y + row as i32 * unit);
                        self.fill([x, y, x + unit, y + unit], color, 1.0);
                    }
                }
            }
        }
    }

    /// Blends a color over `[x0, x1) x [y0, y1)`, as far as that lies on the canvas.
    pub fn fill(&mut self, [x0, y0, x1, y1]: [i32; 4], color: Rgb<u8>, alpha: f32) {
        let (width, height) = (self.picture.width() as i32, self.picture.height() as i32);
        for y in y0.clamp(0, height)..y1.clamp(0, height) {
            for x in x0.clamp(0, width)..x1.clamp(0, width) {
                let pixel = self.picture.get_pixel_mut(x as u32, y as u32);
                *pixel = mix(*pixel, color, alpha);
            }
        }
    }

    /// A frame of `thickness` inside the edges.
    fn outline(&mut self, [x0, y0, x1, y1]: [i32; 4], thickness: i32, color: Rgb<u8>, alpha: f32) {
        let t = thickness.min((x1 - x0) / 2).min((y1 - y0) / 2).max(1);
        self.fill([x0, y0, x1, y0 + t], color, alpha);
        self.fill([x0, y1 - t, x1, y1], color, alpha);
        self.fill([x0, y0 + t, x0 + t, y1 - t], color, alpha);
        self.fill([x1 - t, y0 + t, x1, y1 - t], color, alpha);
    }

    /// A box's edges in canvas pixels.
    fn edges(&self, bbox: &BBox) -> [i32; 4] {
        let (sx, sy) = self.scale;
        // Far outside is as good as outside, and keeps the sums above from overflowing.
        let at = |v: f32| v.round().clamp(-1e6, 1e6) as i32;
        [
            at(bbox.x * sx),
            at(bbox.y * sy),
            at((bbox.x + bbox.w) * sx),
            at((bbox.y + bbox.h) * sy),
        ]
    }
}

/// Width of a line of text in pixels.
pub fn text_width(text: &str, unit: i32) -> i32 {
    (text.chars().count() as i32 * (font::WIDTH as i32 + 1) - 1).max(0) * unit
}

/// `share` of `over`, the rest of `under`.
fn mix(under: Rgb<u8>, over: Rgb<u8>, share: f32) -> Rgb<u8> {
    let share = share.clamp(0.0, 1.0);
    let channel =
        |i: usize| f32::from(under.0[i]) + (f32::from(over.0[i]) - f32::from(under.0[i])) * share;
    Rgb([
        channel(0).round() as u8,
        channel(1).round() as u8,
        channel(2).round() as u8,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use track_cpu::ChannelOrder;

    #[test]
    fn copies_every_channel_order() {
        for (order, pixel) in [
            (ChannelOrder::Rgb, &[1, 2, 3][..]),
            (ChannelOrder::Bgr, &[3, 2, 1]),
            (ChannelOrder::Rgba, &[1, 2, 3, 9]),
            (ChannelOrder::Bgra, &[3, 2, 1, 9]),
        ] {
            let frame = Frame::new(pixel, 1, 1, order).unwrap();
            assert_eq!(
                Canvas::new(&frame).picture.get_pixel(0, 0).0,
                [1, 2, 3],
                "{order:?}"
            );
        }
        let gray = Frame::new(&[7], 1, 1, ChannelOrder::Gray).unwrap();
        assert_eq!(Canvas::new(&gray).picture.get_pixel(0, 0).0, [7, 7, 7]);
    }

    #[test]
    fn draws_where_it_should() {
        let mut canvas = Canvas::blank(40, 30, BLACK);
        canvas.truth(&BBox::new(10.0, 8.0, 20.0, 10.0));
        let lit = |canvas: &Canvas, x, y| canvas.picture.get_pixel(x, y).0[0] > 100;
        for (x, y, expected) in [
            (10, 8, true),
            (29, 17, true),
            (9, 8, false),
            (30, 17, false),
            (20, 12, false),
        ] {
            assert_eq!(lit(&canvas, x, y), expected, "({x}, {y})");
        }
    }

    #[test]
    fn boxes_anywhere_are_drawn_without_a_panic() {
        let mut canvas = Canvas::blank(20, 10, BLACK);
        for v in [
            -1e30,
            -50.0,
            -1.0,
            0.0,
            0.5,
            19.0,
            1e30,
            f32::NAN,
            f32::INFINITY,
        ] {
            for size in [0.0, 0.1, 1.0, 30.0, 1e30, f32::NAN] {
                canvas.found(&BBox::new(v, v, size, size), Some(v));
                canvas.truth(&BBox::new(v, -v, size, size));
            }
        }
        canvas.caption("a caption wider than the canvas \u{1F600}");
    }
}
