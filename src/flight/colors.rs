//! The target's colors: where a frame shows them, and how well a finding matches them.
//!
//! A color is red's and blue's share of the light, which stay alike in sun and shade, and
//! brightness, in few levels. There are two histograms: of the target's colors and of the whole
//! view's. The target's own colors are those that are likelier in its box than around it, because
//! up to half of a box shows background. A place is as promising as the mean log ratio of the two
//! histograms in a box of the target's size (the Bayes classifier of Bertinetto et al., "Staple",
//! CVPR 2016, section 3.3): that decides in which order places are searched. A finding is compared
//! with the target by the Bhattacharyya coefficient of their histograms (Comaniciu, Ramesh, Meer,
//! "Kernel-based object tracking", PAMI 2003, section 3.2). The network hardly sees colors, which
//! tell most objects of one kind apart.

use crate::bbox::FrameBox;
use crate::frame::Frame;

/// Levels of red's share, of blue's share, and of brightness.
const LEVELS: [usize; 3] = [12, 12, 3];
const COLORS: usize = LEVELS[0] * LEVELS[1] * LEVELS[2];
/// Difference from a third of the light at which a channel has its first or last level.
const VIVID: f32 = 0.2;
/// Value that is added to every channel: what is almost black has no color.
const DARK: f32 = 7.0;
/// Samples per axis of the target.
const TARGET_SAMPLES: (usize, usize) = (16, 16);
/// Samples per axis of the view.
const VIEW_SAMPLES: (usize, usize) = (64, 36);
/// Cells of the heat map along the target's side.
const CELLS: f64 = 6.0;
/// Most cells of the heat map.
const MOST_CELLS: f64 = 65536.0;
/// Share of a new observation in the histograms, per second since the last one.
const LEARNING: f64 = 0.5;
/// Side of the region around the target that counts as its background, in sides of its box.
const AROUND: f32 = 2.0;
/// Samples per axis of that region.
const AROUND_SAMPLES: (usize, usize) = (24, 24);
/// Share that every color has at least.
const LEAST: f32 = 2e-3;
/// Share of the target's box that is sampled: its corners mostly show something else.
const INNER: f32 = 0.8;

/// The target's colors, and the view's.
#[derive(Clone, Debug, Default)]
pub(super) struct Colors {
    target: Vec<f32>, // [COLORS]: shares; empty before the first look
    view: Vec<f32>,   // [COLORS]: shares
    heat: Vec<f32>,   // [COLORS]: log ratio
    sums: Vec<f64>,   // integral image of the frame's heat, one row and column more than cells
    here: Vec<f32>,   // [COLORS]: shares in the box that is compared
    around: Vec<f32>, // [COLORS]: shares of the target's background
    usual: f64,       // running mean of the target's own coefficient
}

impl Colors {
    /// Learns from a frame in which the target is seen, with some `trust` in `[0, 1]`, `dt` seconds
    /// after the last one.
    pub(super) fn learn(&mut self, frame: &Frame<'_>, bbox: &FrameBox, trust: f32, dt: f64) {
        let first = self.target.is_empty();
        let rate = if first {
            1.0
        } else {
            (LEARNING * dt).min(0.5) as f32 * trust
        };
        self.usual = if first {
            1.0
        } else {
            self.usual + f64::from(rate) * (self.coefficient(frame, bbox) - self.usual)
        };
        for histogram in [&mut self.target, &mut self.view] {
            histogram.resize(COLORS, 0.0);
            histogram.iter_mut().for_each(|share| *share *= 1.0 - rate);
        }
        self.count_foreground(frame, bbox);
        for (share, here) in self.target.iter_mut().zip(&self.here) {
            *share += rate * here;
        }
        let all = (0.0, 0.0, frame.width() as f32, frame.height() as f32);
        count(frame, all, VIEW_SAMPLES, rate, &mut self.view);
    }

    /// Counts the target's own colors into `here`: those of its box, each by how much likelier it
    /// is in the box than around it. Up to half of a box shows background.
    fn count_foreground(&mut self, frame: &Frame<'_>, bbox: &FrameBox) {
        for histogram in [&mut self.here, &mut self.around] {
            histogram.clear();
            histogram.resize(COLORS, 0.0);
        }
        count(frame, inner(bbox), TARGET_SAMPLES, 1.0, &mut self.here);
        let region = (
            bbox.cx - 0.5 * AROUND * bbox.w,
            bbox.cy - 0.5 * AROUND * bbox.h,
            AROUND * bbox.w,
            AROUND * bbox.h,
        );
        count(frame, region, AROUND_SAMPLES, 1.0, &mut self.around);
        // The region contains the box, which is a quarter of it.
        let share = 1.0 / (AROUND * AROUND);
        let mut sum = 0.0;
        for (here, around) in self.here.iter_mut().zip(&self.around) {
            let background = ((around - share * *here) / (1.0 - share)).max(0.0);
            *here *= *here / (*here + background).max(1e-6);
            sum += *here;
        }
        for here in &mut self.here {
            *here /= f32::max(sum, 1e-6);
        }
    }

    /// How well a box matches the target's colors, in `[0, 1]`: 1 is the target's own match from
    /// frame to frame; 0 before anything was learned.
    pub(super) fn likeness(&mut self, frame: &Frame<'_>, bbox: &FrameBox) -> f64 {
        (self.coefficient(frame, bbox) / self.usual.max(0.1)).min(1.0)
    }

    /// Bhattacharyya coefficient of a box's colors with the target's.
    fn coefficient(&mut self, frame: &Frame<'_>, bbox: &FrameBox) -> f64 {
        self.here.clear();
        self.here.resize(COLORS, 0.0);
        count(frame, inner(bbox), TARGET_SAMPLES, 1.0, &mut self.here);
        let both = self.target.iter().zip(&self.here);
        both.map(|(target, here)| f64::from((target * here).sqrt()))
            .sum()
    }

    /// The center of the `allowed` place of a box's size that has the target's colors most; `None`
    /// before anything was learned or if no place is allowed.
    pub(super) fn hottest(
        &mut self,
        frame: &Frame<'_>,
        size: &FrameBox,
        allowed: impl Fn(f32, f32) -> bool,
    ) -> Option<(f32, f32)> {
        if self.target.is_empty() {
            return None;
        }
        let (width, height) = (frame.width(), frame.height());
        let least = (width as f64 * height as f64 / MOST_CELLS).sqrt();
        let step = (f64::from(size.w * size.h).sqrt() / CELLS)
            .max(least)
            .ceil()
            .max(1.0) as usize;
        let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
        self.sum_heat(frame, step, columns, rows);
        let half = |side: f32| (side as usize / step).max(1).div_ceil(2);
        let (half_w, half_h) = (half(size.w), half(size.h));
        let mut best: Option<(f64, f32, f32)> = None;
        for row in 0..rows {
            let (top, low) = (row.saturating_sub(half_h), (row + half_h).min(rows));
            for column in 0..columns {
                let (left, right) = (
                    column.saturating_sub(half_w),
                    (column + half_w).min(columns),
                );
                let at = |row: usize, column: usize| self.sums[row * (columns + 1) + column];
                let sum = at(low, right) - at(top, right) - at(low, left) + at(top, left);
                let heat = sum / ((low - top) * (right - left)) as f64;
                let (x, y) = ((column * step) as f32, (row * step) as f32);
                if best.is_none_or(|(hottest, ..)| heat > hottest) && allowed(x, y) {
                    best = Some((heat, x, y));
                }
            }
        }
        best.map(|(_, x, y)| (x, y))
    }

    /// Fills the integral image of a frame's heat, sampled at the centers of cells of `step x step`
    /// pixels.
    fn sum_heat(&mut self, frame: &Frame<'_>, step: usize, columns: usize, rows: usize) {
        let ratio = |(target, view): (&f32, &f32)| ((target + LEAST) / (view + LEAST)).ln();
        self.heat.clear();
        self.heat
            .extend(self.target.iter().zip(&self.view).map(ratio));
        self.sums.clear();
        self.sums.resize((columns + 1) * (rows + 1), 0.0);
        for row in 0..rows {
            let mut line = 0.0;
            for column in 0..columns {
                let color = nearest(color_at(
                    frame,
                    column * step + step / 2,
                    row * step + step / 2,
                ));
                line += f64::from(self.heat[color]);
                self.sums[(row + 1) * (columns + 1) + column + 1] =
                    self.sums[row * (columns + 1) + column + 1] + line;
            }
        }
    }
}

/// The part of a box that is sampled: left, top, width, height.
fn inner(bbox: &FrameBox) -> (f32, f32, f32, f32) {
    let (w, h) = (INNER * bbox.w, INNER * bbox.h);
    (bbox.cx - 0.5 * w, bbox.cy - 0.5 * h, w, h)
}

/// Adds the colors of a region (left, top, width, height) to a histogram, `rate` in all. Each color
/// is shared out to the levels around it, so that a little more or less light changes little.
fn count(
    frame: &Frame<'_>,
    (left, top, width, height): (f32, f32, f32, f32),
    (columns, rows): (usize, usize),
    rate: f32,
    histogram: &mut [f32],
) {
    let share = rate / (columns * rows) as f32;
    for row in 0..rows {
        let y = top + height * (row as f32 + 0.5) / rows as f32;
        for column in 0..columns {
            let x = left + width * (column as f32 + 0.5) / columns as f32;
            let color = color_at(frame, x.max(0.0) as usize, y.max(0.0) as usize);
            for corner in 0..8 {
                let (mut index, mut part) = (0, share);
                for (axis, (level, levels)) in color.into_iter().zip(LEVELS).enumerate() {
                    let up = corner >> axis & 1;
                    part *= if up == 1 {
                        level.fract()
                    } else {
                        1.0 - level.fract()
                    };
                    index = index * levels + (level as usize + up).min(levels - 1);
                }
                histogram[index] += part;
            }
        }
    }
}

/// Index of the levels nearest to a color.
fn nearest(color: [f32; 3]) -> usize {
    color
        .into_iter()
        .zip(LEVELS)
        .fold(0, |index, (level, levels)| {
            index * levels + (level + 0.5) as usize
        })
}

/// The color of the pixel there, or of the nearest one, in levels, `0.0..=levels - 1`.
fn color_at(frame: &Frame<'_>, x: usize, y: usize) -> [f32; 3] {
    let pixel = frame.bgr(x.min(frame.width() - 1), y.min(frame.height() - 1));
    let [blue, green, red] = pixel.map(|channel| f32::from(channel) + DARK);
    let light = blue + green + red;
    let vivid = |channel: f32| (channel / light - 1.0 / 3.0) / VIVID * 0.5 + 0.5;
    let shares = [vivid(red), vivid(blue), light / (3.0 * (255.0 + DARK))];
    std::array::from_fn(|i| (shares[i] * LEVELS[i] as f32 - 0.5).clamp(0.0, LEVELS[i] as f32 - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::ChannelOrder;

    /// Gray ground with a red box of 16 x 10 pixels and one that is half red.
    fn picture(red: (usize, usize), half: (usize, usize)) -> Vec<u8> {
        let mut data = [90u8, 95, 85].repeat(160 * 90);
        for (at, every) in [(red, 1), (half, 2)] {
            for y in at.1..at.1 + 10 {
                for x in (at.0..at.0 + 16).step_by(every) {
                    data[3 * (160 * y + x)..][..3].copy_from_slice(&[200, 30, 20]);
                }
            }
        }
        data
    }

    #[test]
    fn hottest_place_has_the_targets_colors() {
        let size = FrameBox {
            cx: 38.0,
            cy: 25.0,
            w: 16.0,
            h: 10.0,
        };
        let mut colors = Colors::default();
        let data = picture((30, 20), (100, 20));
        let frame = Frame::new(&data, 160, 90, ChannelOrder::Rgb).unwrap();
        assert_eq!(colors.hottest(&frame, &size, |_, _| true), None);
        colors.learn(&frame, &size, 1.0, 0.0);
        let data = picture((120, 60), (20, 40));
        let frame = Frame::new(&data, 160, 90, ChannelOrder::Rgb).unwrap();
        let near =
            |(x, y): (f32, f32), at: (f32, f32)| (x - at.0).abs() <= 3.0 && (y - at.1).abs() <= 3.0;
        let (x, y) = colors.hottest(&frame, &size, |_, _| true).unwrap();
        assert!(near((x, y), (128.0, 65.0)), "{x} {y}");
        let (x, y) = colors.hottest(&frame, &size, |x, _| x < 100.0).unwrap();
        assert!(near((x, y), (28.0, 45.0)), "{x} {y}");
        assert_eq!(colors.hottest(&frame, &size, |_, _| false), None);
        let at = |cx: f32, cy: f32| FrameBox { cx, cy, ..size };
        let [all, half, none] = [at(128.0, 65.0), at(28.0, 45.0), at(80.0, 20.0)]
            .map(|place| colors.likeness(&frame, &place));
        assert!(
            all > 0.99 && (0.6..0.8).contains(&half) && none == 0.0,
            "{all} {half} {none}"
        );
    }

    #[test]
    fn shaded_target_keeps_its_colors() {
        let size = FrameBox {
            cx: 38.0,
            cy: 25.0,
            w: 16.0,
            h: 10.0,
        };
        let sunny = picture((30, 20), (100, 20));
        let shady: Vec<u8> = sunny
            .iter()
            .map(|channel| (f32::from(*channel) * 0.6) as u8)
            .collect();
        let mut colors = Colors::default();
        colors.learn(
            &Frame::new(&sunny, 160, 90, ChannelOrder::Rgb).unwrap(),
            &size,
            1.0,
            0.0,
        );
        let shady = Frame::new(&shady, 160, 90, ChannelOrder::Rgb).unwrap();
        let [target, ground] = [
            size,
            FrameBox {
                cx: 80.0,
                cy: 60.0,
                ..size
            },
        ]
        .map(|place| colors.likeness(&shady, &place));
        assert!(target > 0.6 && ground < 0.1, "{target} {ground}");
    }

    #[test]
    fn gray_picture_is_told_apart_by_brightness() {
        let size = FrameBox {
            cx: 38.0,
            cy: 25.0,
            w: 16.0,
            h: 10.0,
        };
        let mut colors = Colors::default();
        let halves: Vec<u8> = (0..160 * 90)
            .map(|i| if i % 160 < 80 { 40 } else { 220 })
            .collect();
        let frame = Frame::new(&halves, 160, 90, ChannelOrder::Gray).unwrap();
        colors.learn(&frame, &size, 1.0, 0.0);
        assert!(colors.likeness(&frame, &FrameBox { cx: 120.0, ..size }) < 0.3);
    }

    #[test]
    fn tiny_and_narrow_frames_have_colors() {
        let size = FrameBox {
            cx: 0.0,
            cy: 0.0,
            w: 500.0,
            h: 0.5,
        };
        for (width, height) in [(1, 1), (3, 700), (700, 2)] {
            let data = vec![7u8; width * height];
            let frame = Frame::new(&data, width, height, ChannelOrder::Gray).unwrap();
            let mut colors = Colors::default();
            colors.learn(&frame, &size, 1.0, 0.0);
            assert!(colors.hottest(&frame, &size, |_, _| true).is_some());
            assert!(colors.likeness(&frame, &size) > 0.99);
        }
    }
}
