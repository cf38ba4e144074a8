//! From score map and offsets to one box: penalty, window, best cell, vote, size smoothing.
//!
//! Source: docs/method.md, sections 2.4 to 2.6 and 5.7.

use super::crop::{CropSize, Placement};
use super::filter::Spot;
use crate::bbox::{CropBox, FrameBox};
use crate::config::TrackConfig;
use crate::net::Outputs;
use weights_format::Architecture;

/// Chooses a cell of the score map; holds the cells' centers and the cosine window.
#[derive(Clone, Debug)]
pub(crate) struct Selector {
    offset: f64,    // crop pixel of the first cell's center, along either axis
    hann: Vec<f64>, // [score_size], 0 at both ends
}

/// The chosen cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Choice {
    /// Row-major index of the cell.
    pub index: usize,
    /// Its box; moved to the online filter's peak where the filter disagrees with it.
    pub bbox: CropBox,
    /// The vote of the cells around it, moved likewise.
    pub vote: CropBox,
    /// Score times centerness.
    pub score: f64,
    /// The online filter's response at the cell; 0 without a filter.
    pub response: f64,
    /// Penalty on changes of size and aspect, in `(0, 1]`; 1 for no change.
    pub penalty: f64,
    /// Penalized score blended with the window: the maximized value.
    pub penalized_score: f64,
}

/// Least IoU with the chosen cell's box of a box that votes: some cells see another object.
const ALIKE: f32 = 0.5;
/// Least share of the response's maximum at which the online filter agrees with a box.
const AGREED: f64 = 0.5;
/// Least response at the filter's peak that may move a box.
const CLEAR: f32 = 0.3;
/// Greatest distance over which the filter's peak may move a box, in sides of the box.
const NEAR: f32 = 0.8;

/// The maximum of the online filter's response, in crop pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Peak {
    cx: f32,
    cy: f32,
    response: f32,
}

impl Selector {
    pub(crate) fn new(architecture: &Architecture) -> Selector {
        let n = architecture.score_size();
        let turn = 2.0 * std::f64::consts::PI;
        let hann = |i: usize| 0.5 - 0.5 * (turn * i as f64 / (n - 1).max(1) as f64).cos();
        Selector {
            offset: architecture.score_offset() as f64,
            hann: if n == 1 {
                vec![1.0]
            } else {
                (0..n).map(hann).collect()
            },
        }
    }

    /// The selector of a crop that is `more` cells larger on every side, or smaller if negative.
    ///
    /// Shared cells keep their window; cells beyond it get 0.
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
        }
    }

    /// Cells along one side of the score map.
    pub(crate) fn side(&self) -> usize {
        self.hann.len()
    }

    /// Crop pixel of the first cell's center, along either axis.
    #[cfg(test)]
    pub(crate) fn offset(&self) -> f64 {
        self.offset
    }

    /// First row of a template's window of `cells` features whose middle is at the crop pixel
    /// `center`, in a map of `reach` rows; columns likewise.
    pub(crate) fn window_start(&self, center: f32, cells: usize, reach: usize) -> usize {
        let first = (reach + 1).saturating_sub(cells + self.side()) as f64 / 2.0;
        let start = (f64::from(center) - self.offset) / Architecture::TOTAL_STRIDE as f64 + first;
        start.round().clamp(0.0, reach.saturating_sub(cells) as f64) as usize
    }

    /// The cell with the highest windowed score, the first one on a tie.
    ///
    /// `previous` is the target's size in the last frame, which the penalty compares with.
    /// `response` is the online filter's: a square map with the score map in its middle, or empty.
    /// Cells with numbers that are not finite are skipped; `None` if no cell is left.
    pub(crate) fn choose(
        &self,
        outputs: &Outputs,
        response: &[f32],
        previous: CropSize,
        config: &TrackConfig,
    ) -> Option<Choice> {
        let n = self.hann.len();
        let share = if response.is_empty() {
            0.0
        } else {
            config.online_filter
        };
        let (side, border) = self.response_geometry(response);

        // Per cell: mix score and response, penalize changes of size and aspect, blend the window
        // in, and keep the first maximum.
        let mut best: Option<Choice> = None;
        let cells = outputs.score.iter().zip(outputs.ltrb.chunks_exact(4));
        for (index, (score, ltrb)) in cells.enumerate() {
            let row = index / n;
            let column = index % n;
            let bbox = self.decode(row, column, ltrb);
            let size = CropSize {
                w: bbox.w.into(),
                h: bbox.h.into(),
            };
            let penalty = penalty(size, previous, config.penalty_k);
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
                    vote: bbox,
                    score,
                    response,
                    penalty,
                    penalized_score,
                });
            }
        }
        best.map(|choice| Choice {
            bbox: self.drawn(choice.bbox, response),
            vote: self.drawn(self.vote(outputs, &choice, config.voting), response),
            ..choice
        })
    }

    /// The box that the cells within the chosen cell's box vote for: a `share` of the way from that
    /// box to the mean of all that overlap it.
    ///
    /// Every cell within the target sees it from another place, and their errors differ. The fourth
    /// root of the score is a cell's weight.
    ///
    /// Source: docs/method.md, section 5.7.
    fn vote(&self, outputs: &Outputs, choice: &Choice, share: f64) -> CropBox {
        if share == 0.0 {
            return choice.bbox;
        }
        let CropBox { cx, cy, w, h } = choice.bbox;
        let mut sums = [0.0; 4];
        let mut weights = 0.0;
        for row in self.cells_within(cy, h) {
            for column in self.cells_within(cx, w) {
                let at = row * self.side() + column;
                let bbox = self.decode(row, column, &outputs.ltrb[4 * at..][..4]);
                let score = f64::from(outputs.score[at]);
                // Written so that numbers that are not finite do not vote.
                if !(score > 0.0 && score.is_finite() && bbox.iou(&choice.bbox) >= ALIKE) {
                    continue;
                }
                let weight = score.sqrt().sqrt();
                weights += weight;
                for (sum, number) in sums.iter_mut().zip([bbox.cx, bbox.cy, bbox.w, bbox.h]) {
                    *sum += weight * f64::from(number);
                }
            }
        }
        if weights == 0.0 {
            return choice.bbox;
        }
        let toward = |own: f32, sum: f64| {
            let own = f64::from(own);
            (own + share * (sum / weights - own)) as f32
        };
        CropBox {
            cx: toward(cx, sums[0]),
            cy: toward(cy, sums[1]),
            w: toward(w, sums[2]),
            h: toward(h, sums[3]),
        }
    }

    /// Rows of cells whose centers lie within a box, from its center and side along that axis;
    /// columns likewise.
    fn cells_within(&self, center: f32, side: f32) -> std::ops::Range<usize> {
        let cell = |edge: f32| (f64::from(edge) - self.offset) / Architecture::TOTAL_STRIDE as f64;
        let first = cell(center - side / 2.0).ceil().max(0.0) as usize;
        let end = (cell(center + side / 2.0).floor() + 1.0).max(0.0) as usize;
        first..end.min(self.side())
    }

    /// Side of a square response, and the number of cells before the score map's first.
    fn response_geometry(&self, response: &[f32]) -> (usize, usize) {
        let side = response.len().isqrt();
        let border = side.saturating_sub(self.hann.len()) / 2;
        (side, border)
    }

    /// Where a box lies in the online filter's response.
    pub(crate) fn spot(&self, bbox: &CropBox, response: &[f32]) -> Spot {
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

    /// The online filter's response at the middle of a box; 0 without a filter.
    pub(crate) fn response_at(&self, bbox: &CropBox, response: &[f32]) -> f64 {
        let (side, _) = self.response_geometry(response);
        let Spot { row, column, .. } = self.spot(bbox, response);
        let nearest = |at: f32| (at.round().max(0.0) as usize).min(side.saturating_sub(1));
        response
            .get(nearest(row) * side + nearest(column))
            .map_or(0.0, |response| f64::from(*response))
    }

    /// Whether the online filter agrees with a box: its response there is at least [`AGREED`] of
    /// its maximum.
    ///
    /// A box that fails has slipped to a part of the target or to another object. Learning it would
    /// take the filter along.
    pub(crate) fn agrees(&self, bbox: &CropBox, response: &[f32]) -> bool {
        let most = response.iter().copied().fold(0.0, f32::max);
        self.response_at(bbox, response) >= AGREED * f64::from(most)
    }

    /// Moves a box that the online filter disagrees with to the filter's peak, if that is clear and
    /// near: the network takes a part of the target for the whole.
    fn drawn(&self, bbox: CropBox, response: &[f32]) -> CropBox {
        if self.agrees(&bbox, response) {
            return bbox;
        }
        let Some(peak) = self.peak(response) else {
            return bbox;
        };
        let near = (peak.cx - bbox.cx).hypot(peak.cy - bbox.cy) < NEAR * (bbox.w * bbox.h).sqrt();
        if peak.response >= CLEAR && near {
            CropBox {
                cx: peak.cx,
                cy: peak.cy,
                ..bbox
            }
        } else {
            bbox
        }
    }

    /// The response's maximum; between cells by the parabola through a cell and its neighbors.
    fn peak(&self, response: &[f32]) -> Option<Peak> {
        let (side, border) = self.response_geometry(response);
        let best = (0..response.len()).max_by(|a, b| response[*a].total_cmp(&response[*b]))?;
        let row = best / side;
        let column = best % side;
        let at =
            |row: usize, column: usize| response[row.min(side - 1) * side + column.min(side - 1)];
        // Vertex of the parabola through three neighbors, as a crop pixel.
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
        let across = [at(row, column.saturating_sub(1)), here, at(row, column + 1)];
        let down = [at(row.saturating_sub(1), column), here, at(row + 1, column)];
        Some(Peak {
            cx: middle(column, across),
            cy: middle(row, down),
            response: here,
        })
    }

    /// The box of one cell from its four offsets; its width counts both end pixels.
    pub(crate) fn decode(&self, row: usize, column: usize, ltrb: &[f32]) -> CropBox {
        let stride = Architecture::TOTAL_STRIDE as f64;
        let px = self.offset + stride * column as f64;
        let py = self.offset + stride * row as f64;
        let [l, t, r, b] = [0, 1, 2, 3].map(|i| f64::from(ltrb[i]));
        CropBox {
            cx: (px + (r - l) / 2.0) as f32,
            cy: (py + (b - t) / 2.0) as f32,
            w: (l + r + 1.0) as f32,
            h: (t + b + 1.0) as f32,
        }
    }
}

impl Choice {
    /// The target's new box: the position of the box `found`, and a size between `previous` and
    /// `found`.
    ///
    /// The step toward the found size is `penalty * score * size_lr`.
    pub(crate) fn smooth(
        &self,
        found: &CropBox,
        previous: &FrameBox,
        placement: &Placement,
        config: &TrackConfig,
    ) -> FrameBox {
        let size_lr = self.penalty * self.score * config.size_lr;
        let size = |previous: f32, new: f32| {
            (f64::from(previous) * (1.0 - size_lr) + f64::from(new) * size_lr) as f32
        };
        let found = placement.to_frame(found);
        FrameBox {
            w: size(previous.w, found.w),
            h: size(previous.h, found.h),
            ..found
        }
    }
}

/// `exp(-(size change * aspect change - 1) * k)` of a box's size against the previous size.
///
/// Source: docs/method.md, section 2.5.
fn penalty(size: CropSize, previous: CropSize, k: f64) -> f64 {
    let change = |ratio: f64| ratio.max(1.0 / ratio);
    let padded = |CropSize { w, h }: CropSize| {
        let context = (w + h) / 2.0;
        ((w + context) * (h + context)).sqrt()
    };
    let size_change = change(padded(size) / padded(previous));
    let aspect_change = change((previous.w / previous.h) / (size.w / size.h));
    (-(aspect_change * size_change - 1.0) * k).exp()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracker::crop;
    use weights_format::Widths;

    fn selector() -> Selector {
        Selector::new(&Architecture::new(Widths::FULL, None))
    }

    /// Outputs of score 0 and offsets `ltrb` in every cell.
    fn outputs(ltrb: [f32; 4]) -> Outputs {
        Outputs {
            score: vec![0.0; 289],
            ltrb: ltrb.repeat(289),
        }
    }

    fn size(w: f64, h: f64) -> CropSize {
        CropSize { w, h }
    }

    #[test]
    fn window_start_of_a_centered_target_is_the_template_crops() {
        // The template crop in the middle of a search crop begins 88 pixels, 11 features, from its
        // edge.
        let start = |center| selector().window_start(center, 6, 28);

        let middle = [151.0, 154.9, 155.1, 147.1, 146.9].map(start);
        let outside = [-50.0, 400.0].map(start);

        assert_eq!(middle, [11, 11, 12, 11, 10]);
        assert_eq!(outside, [0, 22]);
    }

    #[test]
    fn choice_of_the_worked_example_has_its_penalty_score_and_size() {
        // docs/method.md, sections 2.5 and 2.6: target 40 x 80, box 50 x 80 in the crop, score 0.6
        let scale = crop::scale(40.0, 80.0, 0.5, 127);
        let previous = size(40.0 * scale, 80.0 * scale);
        let config = TrackConfig::default();
        let selector = selector();
        let mut outputs = outputs([24.5, 39.5, 24.5, 39.5]);
        outputs.score[8 * 17 + 8] = 0.6;
        let target = FrameBox {
            cx: 119.5,
            cy: 89.5,
            w: 40.0,
            h: 80.0,
        };
        let placement = Placement::new(&target, scale, 1.0, 303);

        let penalty = penalty(size(50.0, 80.0), previous, config.penalty_k);
        let choice = selector
            .choose(&outputs, &[], previous, &config)
            .expect("a cell is usable");
        let new = choice.smooth(&choice.bbox, &target, &placement, &config);

        assert!((penalty - 0.9854368).abs() < 1e-7, "{penalty}");
        assert_eq!(choice.index, 8 * 17 + 8);
        let penalized = choice.penalized_score;
        assert!((penalized - 0.6858981).abs() < 1e-7, "{choice:?}");
        assert!((new.w - 42.0434).abs() < 1e-4, "{new:?}");
        assert!((new.h - 78.3032).abs() < 1e-4, "{new:?}");
        assert_eq!((new.cx, new.cy), (119.5, 89.5));
    }

    #[test]
    fn corner_cells_decode_at_their_own_centers() {
        let selector = selector();

        let first = selector.decode(0, 0, &[10.0, 20.0, 30.0, 40.0]);
        let last = selector.decode(16, 16, &[0.0; 4]);

        let expected = CropBox {
            cx: 97.0,
            cy: 97.0,
            w: 41.0,
            h: 61.0,
        };
        assert_eq!(first, expected);
        assert_eq!((last.cx, last.cy, last.w), (215.0, 215.0, 1.0));
    }

    #[test]
    fn window_is_one_in_the_middle_and_zero_at_both_ends() {
        let hann = selector().hann;

        assert_eq!((hann[0], hann[8]), (0.0, 1.0));
        assert!(hann[16].abs() < 1e-15);
    }

    #[test]
    fn tie_between_cells_goes_to_the_first() {
        let mut outputs = outputs([10.0; 4]);
        outputs.score[5] = 1.0;
        outputs.score[3] = 1.0;
        let config = TrackConfig {
            window_influence: 0.0,
            ..TrackConfig::default()
        };

        let choice = selector().choose(&outputs, &[], size(21.0, 21.0), &config);

        assert_eq!(choice.map(|choice| choice.index), Some(3));
    }

    /// A response with a peak beside column 8 of row 8 of the score map.
    fn response() -> Vec<f32> {
        let mut response = vec![0.0; 23 * 23]; // three cells more than the score map on every side
        response[11 * 23 + 10..][..3].copy_from_slice(&[0.4, 0.8, 0.6]);
        response
    }

    /// A box of 31 pixels in row 8; cells are 8 pixels apart.
    fn at(column: usize) -> CropBox {
        selector().decode(8, column, &[15.0; 4])
    }

    #[test]
    fn filter_agrees_with_boxes_near_its_peak_only() {
        let selector = selector();
        let response = response();

        let agrees = |column| selector.agrees(&at(column), &response);

        assert!(agrees(7) && agrees(8) && agrees(9));
        assert!(!agrees(6) && !agrees(10));
        assert!(selector.agrees(&at(8), &[]), "no filter cannot disagree");
    }

    #[test]
    fn box_beside_a_clear_peak_is_moved_to_it() {
        let selector = selector();
        let response = response();
        let faint: Vec<f32> = response.iter().map(|r| 0.3 * r).collect();

        let drawn = selector.drawn(at(10), &response);

        // The parabola through 0.4, 0.8, 0.6 has its maximum a sixth of a cell beyond column 8.
        let expected = at(8).cx + 8.0 / 6.0;
        assert!((drawn.cx - expected).abs() < 1e-3, "{drawn:?}");
        assert_eq!(drawn.cy, at(8).cy);
        assert_eq!(selector.drawn(at(9), &response), at(9), "filter agrees");
        assert_eq!(selector.drawn(at(13), &response), at(13), "too far");
        assert_eq!(selector.drawn(at(10), &faint), at(10), "too faint");
        assert_eq!(selector.drawn(at(8), &[]), at(8), "no filter");
    }

    #[test]
    fn cells_within_the_box_that_see_the_same_object_vote() {
        let selector = selector();
        let mut outputs = outputs([20.0; 4]);
        let best = 8 * 17 + 8;
        outputs.score[best] = 0.5;
        let near = best + 1; // half a side to the right, and twice as wide as high
        outputs.score[near] = 0.5;
        outputs.ltrb[4 * near..][..4].copy_from_slice(&[28.0, 20.0, 52.0, 20.0]);
        let outside = best + 3; // of the best cell's box, though its own box is the same
        outputs.score[outside] = 0.4;
        outputs.ltrb[4 * outside..][..4].copy_from_slice(&[44.0, 20.0, -4.0, 20.0]);
        let other = best + 2; // its box lies beside the best cell's
        outputs.score[other] = 0.4;
        let broken = best + 17;
        outputs.score[broken] = 0.4;
        outputs.ltrb[4 * broken..][..4].copy_from_slice(&[f32::NAN; 4]);
        let own = selector.decode(8, 8, &[20.0; 4]);
        let config = |voting| TrackConfig {
            voting,
            ..TrackConfig::default()
        };
        let vote = |voting| {
            let choice = selector.choose(&outputs, &[], size(41.0, 41.0), &config(voting));
            let choice = choice.expect("cells are usable");
            assert_eq!((choice.index, choice.bbox), (best, own));
            choice.vote
        };

        let none = vote(0.0);
        let half = vote(0.5);
        let all = vote(1.0);

        assert_eq!(none, own);
        // 41 and 81 wide, the second's center 12 + 8 pixels to the right.
        assert_eq!(
            (all.w, all.h, all.cx, all.cy),
            (61.0, 41.0, own.cx + 10.0, own.cy)
        );
        assert_eq!((half.w, half.cx), (51.0, own.cx + 5.0));
    }

    #[test]
    fn cells_that_are_not_finite_are_skipped() {
        let selector = selector();
        let config = TrackConfig::default();
        let previous = size(21.0, 21.0);
        let mut some = outputs([10.0; 4]);
        some.ltrb[4 * 144] = f32::NAN; // the middle cell, which the window prefers
        some.score[143] = f32::INFINITY;
        let none = outputs([f32::INFINITY; 4]);

        let choice = selector
            .choose(&some, &[], previous, &config)
            .expect("other cells are finite");

        assert!(choice.index != 144 && choice.index != 143);
        assert!(choice.penalized_score.is_finite());
        assert_eq!(selector.choose(&none, &[], previous, &config), None);
    }
}
