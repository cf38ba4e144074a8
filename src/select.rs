//! From score map and offsets to one box: penalty, window, best cell, size smoothing (spec sections 2.4 to 2.6).

use crate::bbox::CenterBox;
use crate::config::TrackConfig;
use crate::net::Outputs;
use crate::online::Spot;
use weights_format::Architecture;

/// What does not change from frame to frame: the cells' centers and the cosine window.
#[derive(Clone, Debug)]
pub(crate) struct Selector {
    offset: f64,      // crop pixel of the first cell's center
    hann: Vec<f64>,   // [score_size], 0 at both ends
    crop_middle: f64, // crop pixel of the search crop's middle
}

/// The chosen cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Choice {
    /// Row-major index of the cell.
    pub index: usize,
    /// Its box in crop pixels; where the online filter does not agree, in the place that the filter says.
    pub bbox: CenterBox,
    /// Score times centerness.
    pub score: f64,
    /// What the online filter says there; 0 without one.
    pub response: f64,
    /// How little size and aspect changed, in `(0, 1]`.
    pub penalty: f64,
    /// Penalized score blended with the window: what was maximized.
    pub penalized_score: f64,
}

/// The online filter agrees with a box about whose middle it says this share of what it says anywhere.
const AGREED: f64 = 0.5;
/// If not, the box moves to where it says most if that is at least so much,
const CLEAR: f32 = 0.3;
/// and not as far away as this, in sides of the box.
const NEAR: f32 = 0.8;

/// Where the online filter says most, in crop pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Peak {
    cx: f32,
    cy: f32,
    response: f32,
}

impl Selector {
    pub(crate) fn new(architecture: &Architecture) -> Selector {
        let n = architecture.score_size();
        let hann = |i: usize| {
            0.5 - 0.5 * (2.0 * std::f64::consts::PI * i as f64 / (n - 1).max(1) as f64).cos()
        };
        Selector {
            offset: architecture.score_offset() as f64,
            hann: if n == 1 {
                vec![1.0]
            } else {
                (0..n).map(hann).collect()
            },
            crop_middle: (architecture.search_size / 2) as f64,
        }
    }

    /// For the crop that is `more` cells larger on every side, or smaller: the same cells with the same window, which is 0 beyond
    /// its ends.
    pub(crate) fn resized(&self, more: isize) -> Selector {
        let at = |i: isize| {
            usize::try_from(i)
                .ok()
                .and_then(|i| self.hann.get(i))
                .copied()
                .unwrap_or(0.0)
        };
        let end = self.hann.len() as isize + more;
        Selector {
            offset: self.offset,
            hann: (-more..end).map(at).collect(),
            crop_middle: self.crop_middle + (more * Architecture::TOTAL_STRIDE as isize) as f64,
        }
    }

    /// Cells along one side of the score map.
    pub(crate) fn side(&self) -> usize {
        self.hann.len()
    }

    /// Where cell 0 has its center and where the crop its middle, both in crop pixels along either axis.
    pub(crate) fn geometry(&self) -> (f64, f64) {
        (self.offset, self.crop_middle)
    }

    /// The row at which a template's window of `cells` features starts that has its middle at the crop pixel `center`, in a map
    /// of `reach` rows; columns likewise.
    pub(crate) fn window_start(&self, center: f32, cells: usize, reach: usize) -> usize {
        let first = (reach + 1).saturating_sub(cells + self.side()) as f64 / 2.0;
        let start = (f64::from(center) - self.offset) / Architecture::TOTAL_STRIDE as f64 + first;
        start.round().clamp(0.0, reach.saturating_sub(cells) as f64) as usize
    }

    /// A box of frame pixels in the pixels of the crop around it.
    pub(crate) fn in_crop(&self, bbox: &CenterBox, scale: f64) -> CenterBox {
        let side = |length: f32| (f64::from(length) * scale) as f32;
        let middle = self.crop_middle as f32;
        CenterBox {
            cx: middle,
            cy: middle,
            w: side(bbox.w),
            h: side(bbox.h),
        }
    }

    /// The cell with the highest windowed score for a target that was `w` x `h` crop pixels, the first one on a tie.
    ///
    /// `response` is the online filter's, a square map with the score map in its middle, or empty. Cells whose numbers are not finite are passed over; `None` if that leaves no cell.
    pub(crate) fn choose(
        &self,
        outputs: &Outputs,
        response: &[f32],
        [w, h]: [f64; 2],
        config: &TrackConfig,
    ) -> Option<Choice> {
        let n = self.hann.len();
        let share = if response.is_empty() {
            0.0
        } else {
            config.online_filter
        };
        let (side, border) = self.response_geometry(response);
        let mut best: Option<Choice> = None;
        for (index, (score, ltrb)) in outputs
            .score
            .iter()
            .zip(outputs.ltrb.chunks_exact(4))
            .enumerate()
        {
            let (row, column) = (index / n, index % n);
            let bbox = self.decode(row, column, ltrb);
            let penalty = penalty(bbox.w.into(), bbox.h.into(), w, h, config.penalty_k);
            let score = f64::from(*score);
            let window = self.hann[row] * self.hann[column];
            let at = (row + border) * side + column + border;
            let response = response
                .get(at)
                .map_or(0.0, |response| f64::from(*response));
            let mixed = (1.0 - share) * score + share * response.clamp(0.0, 1.0);
            let penalized_score = penalty * mixed * (1.0 - config.window_influence)
                + config.window_influence * window;
            let finite = penalized_score.is_finite() && bbox.w.is_finite() && bbox.h.is_finite();
            if finite && best.is_none_or(|b| penalized_score > b.penalized_score) {
                best = Some(Choice {
                    index,
                    bbox,
                    score,
                    response,
                    penalty,
                    penalized_score,
                });
            }
        }
        best.map(|choice| Choice {
            bbox: self.drawn(choice.bbox, response),
            ..choice
        })
    }

    /// Side of a square response that has the score map in its middle, and its cells before the score map's first.
    fn response_geometry(&self, response: &[f32]) -> (usize, usize) {
        let side = response.len().isqrt();
        (side, side.saturating_sub(self.hann.len()) / 2)
    }

    /// Where a box of crop pixels lies in the online filter's response.
    pub(crate) fn spot(&self, bbox: &CenterBox, response: &[f32]) -> Spot {
        let (_, border) = self.response_geometry(response);
        let stride = Architecture::TOTAL_STRIDE as f64;
        let cell =
            |center: f32| ((f64::from(center) - self.offset) / stride + border as f64) as f32;
        let side = (f64::from(bbox.w) * f64::from(bbox.h)).sqrt() / stride;
        Spot {
            row: cell(bbox.cy),
            column: cell(bbox.cx),
            side: side as f32,
        }
    }

    /// What the online filter says about a box of crop pixels; 0 without one.
    pub(crate) fn response_at(&self, bbox: &CenterBox, response: &[f32]) -> f64 {
        let (side, _) = self.response_geometry(response);
        let Spot { row, column, .. } = self.spot(bbox, response);
        let [row, column] =
            [row, column].map(|at| (at.round().max(0.0) as usize).min(side.saturating_sub(1)));
        response
            .get(row * side + column)
            .map_or(0.0, |response| f64::from(*response))
    }

    /// Whether the online filter says about a box of crop pixels a good part ([`AGREED`]) of what it says anywhere. If not, the box has slipped
    /// to a part of the target, or to another object, and would take a filter that learns it along.
    pub(crate) fn agrees(&self, bbox: &CenterBox, response: &[f32]) -> bool {
        let most = response.iter().copied().fold(0.0, f32::max);
        self.response_at(bbox, response) >= AGREED * f64::from(most)
    }

    /// A box with which the online filter does not agree has its middle moved to the filter's peak if that is clear and near: the network
    /// takes a part of the target for the whole.
    fn drawn(&self, bbox: CenterBox, response: &[f32]) -> CenterBox {
        if self.agrees(&bbox, response) {
            return bbox;
        }
        let Some(peak) = self.peak(response) else {
            return bbox;
        };
        let near = (peak.cx - bbox.cx).hypot(peak.cy - bbox.cy) < NEAR * (bbox.w * bbox.h).sqrt();
        if peak.response >= CLEAR && near {
            CenterBox {
                cx: peak.cx,
                cy: peak.cy,
                ..bbox
            }
        } else {
            bbox
        }
    }

    /// Where the online filter says most, between cells by the parabola through a cell and its neighbors.
    fn peak(&self, response: &[f32]) -> Option<Peak> {
        let (side, border) = self.response_geometry(response);
        let best = (0..response.len()).max_by(|a, b| response[*a].total_cmp(&response[*b]))?;
        let (row, column) = (best / side, best % side);
        let at =
            |row: usize, column: usize| response[row.min(side - 1) * side + column.min(side - 1)];
        let middle = |cell: usize, [before, here, after]: [f32; 3]| {
            let bend = before - 2.0 * here + after;
            let shift = if bend < 0.0 {
                (0.5 * (before - after) / bend).clamp(-0.5, 0.5)
            } else {
                0.0
            };
            let cell = cell as f64 - border as f64 + f64::from(shift);
            (self.offset + Architecture::TOTAL_STRIDE as f64 * cell) as f32
        };
        let here = response[best];
        Some(Peak {
            cx: middle(
                column,
                [at(row, column.saturating_sub(1)), here, at(row, column + 1)],
            ),
            cy: middle(
                row,
                [at(row.saturating_sub(1), column), here, at(row + 1, column)],
            ),
            response: here,
        })
    }

    /// The box of one cell in crop pixels from its four offsets; its width counts both end pixels.
    pub(crate) fn decode(&self, row: usize, column: usize, ltrb: &[f32]) -> CenterBox {
        let stride = Architecture::TOTAL_STRIDE as f64;
        let (px, py) = (
            self.offset + stride * column as f64,
            self.offset + stride * row as f64,
        );
        let [l, t, r, b] = [0, 1, 2, 3].map(|i| f64::from(ltrb[i]));
        CenterBox {
            cx: (px + (r - l) / 2.0) as f32,
            cy: (py + (b - t) / 2.0) as f32,
            w: (l + r + 1.0) as f32,
            h: (t + b + 1.0) as f32,
        }
    }

    /// The target's new box in frame pixels: the choice's position, and its size as far as it can be trusted.
    pub(crate) fn smooth(
        &self,
        choice: &Choice,
        target: &CenterBox,
        scale: f64,
        config: &TrackConfig,
    ) -> CenterBox {
        let size_lr = choice.penalty * choice.score * config.size_lr;
        let position = |previous: f32, new: f32| {
            (f64::from(previous) + (f64::from(new) - self.crop_middle) / scale) as f32
        };
        let size = |previous: f32, new: f32| {
            (f64::from(previous) * (1.0 - size_lr) + f64::from(new) / scale * size_lr) as f32
        };
        CenterBox {
            cx: position(target.cx, choice.bbox.cx),
            cy: position(target.cy, choice.bbox.cy),
            w: size(target.w, choice.bbox.w),
            h: size(target.h, choice.bbox.h),
        }
    }
}

/// `exp(-(size change * aspect change - 1) * k)` of a `w` x `h` box against the previous `tw` x `th`.
fn penalty(w: f64, h: f64, tw: f64, th: f64, k: f64) -> f64 {
    let change = |ratio: f64| ratio.max(1.0 / ratio);
    let size = |w: f64, h: f64| {
        let context = (w + h) / 2.0;
        ((w + context) * (h + context)).sqrt()
    };
    let size_change = change(size(w, h) / size(tw, th));
    let aspect_change = change((tw / th) / (w / h));
    (-(aspect_change * size_change - 1.0) * k).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use weights_format::Widths;

    fn selector() -> Selector {
        Selector::new(&Architecture::new(Widths::FULL, None))
    }

    /// Outputs of score 0 everywhere, offsets `ltrb` everywhere.
    fn outputs(ltrb: [f32; 4]) -> Outputs {
        Outputs {
            score: vec![0.0; 289],
            ltrb: ltrb.repeat(289),
        }
    }

    #[test]
    fn a_window_starts_where_a_template_crop_would() {
        // The template crop in the middle of a search crop begins 88 pixels, 11 features, from its edge.
        let start = |center| selector().window_start(center, 6, 28);
        assert_eq!(
            [151.0, 154.9, 155.1, 147.1, 146.9].map(start),
            [11, 11, 12, 11, 10]
        );
        assert_eq!([-50.0, 400.0].map(start), [0, 22]);
    }

    #[test]
    fn worked_values_of_the_spec() {
        // spec sections 2.5 and 2.6: target 40 x 80, box 50 x 80 in the crop, score 0.6
        let scale = crate::crop::scale(40.0, 80.0, 0.5, 127);
        let (config, selector) = (TrackConfig::default(), selector());
        let penalty = penalty(50.0, 80.0, 40.0 * scale, 80.0 * scale, config.penalty_k);
        assert!((penalty - 0.9854368).abs() < 1e-7, "{penalty}");
        let mut outputs = outputs([24.5, 39.5, 24.5, 39.5]);
        outputs.score[8 * 17 + 8] = 0.6;
        let choice = selector
            .choose(&outputs, &[], [40.0 * scale, 80.0 * scale], &config)
            .unwrap();
        assert_eq!(choice.index, 8 * 17 + 8);
        assert!(
            (choice.penalized_score - 0.6858981).abs() < 1e-7,
            "{choice:?}"
        );
        let target = CenterBox {
            cx: 119.5,
            cy: 89.5,
            w: 40.0,
            h: 80.0,
        };
        let new = selector.smooth(&choice, &target, scale, &config);
        assert!(
            (new.w - 42.0434).abs() < 1e-4 && (new.h - 78.3032).abs() < 1e-4,
            "{new:?}"
        );
        assert_eq!((new.cx, new.cy), (119.5, 89.5));
    }

    #[test]
    fn cells_decode_where_they_lie() {
        let s = selector();
        let first = s.decode(0, 0, &[10.0, 20.0, 30.0, 40.0]);
        assert_eq!(
            first,
            CenterBox {
                cx: 97.0,
                cy: 97.0,
                w: 41.0,
                h: 61.0
            }
        );
        let last = s.decode(16, 16, &[0.0; 4]);
        assert_eq!((last.cx, last.cy, last.w), (215.0, 215.0, 1.0));
    }

    #[test]
    fn window_ends_are_zero_and_ties_go_to_the_first() {
        let s = selector();
        assert_eq!((s.hann[0], s.hann[8]), (0.0, 1.0));
        assert!(s.hann[16].abs() < 1e-15);
        let mut o = outputs([10.0; 4]);
        o.score[5] = 1.0;
        o.score[3] = 1.0;
        let config = TrackConfig {
            window_influence: 0.0,
            ..TrackConfig::default()
        };
        assert_eq!(s.choose(&o, &[], [21.0, 21.0], &config).unwrap().index, 3);
    }

    #[test]
    fn a_box_beside_the_filters_peak_is_drawn_there_and_not_learned() {
        let s = selector();
        let mut response = vec![0.0; 23 * 23]; // three cells more than the score map on every side
        (
            response[11 * 23 + 10],
            response[11 * 23 + 11],
            response[11 * 23 + 12],
        ) = (0.4, 0.8, 0.6);
        let at = |column| s.decode(8, column, &[15.0; 4]); // 31 pixels, cells of 8
        let agrees = |column| s.agrees(&at(column), &response);
        assert!(agrees(7) && agrees(8) && agrees(9) && !agrees(10) && !agrees(6));
        let drawn = |column| s.drawn(at(column), &response);
        assert_eq!(drawn(9), at(9), "the filter agrees");
        let peak = CenterBox {
            cx: at(8).cx + 8.0 / 6.0,
            ..at(8)
        }; // of a parabola through 0.4, 0.8, 0.6
        assert!(
            (drawn(10).cx - peak.cx).abs() < 1e-3 && drawn(10).cy == peak.cy,
            "{:?}",
            drawn(10)
        );
        assert_eq!(drawn(13), at(13), "too far away");
        let faint: Vec<f32> = response.iter().map(|r| 0.3 * r).collect();
        assert_eq!(s.drawn(at(10), &faint), at(10));
        // Without a filter there is nothing to disagree.
        assert!(s.agrees(&at(8), &[]));
        assert_eq!(s.drawn(at(8), &[]), at(8));
    }

    #[test]
    fn cells_that_are_not_finite_are_passed_over() {
        let (s, config) = (selector(), TrackConfig::default());
        let mut o = outputs([10.0; 4]);
        o.ltrb[4 * 144] = f32::NAN; // the middle cell, which the window prefers
        o.score[143] = f32::INFINITY;
        let choice = s.choose(&o, &[], [21.0, 21.0], &config).unwrap();
        assert!(choice.index != 144 && choice.index != 143 && choice.penalized_score.is_finite());
        assert_eq!(
            s.choose(&outputs([f32::INFINITY; 4]), &[], [21.0, 21.0], &config),
            None
        );
    }
}
