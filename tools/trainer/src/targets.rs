//! Targets of the head per cell of the score map (docs/method.md, section 3.3).

use crate::data::geometry::Corners;
use autodiff::Tensor;
use weights_format::Architecture;

/// The score map's cells in crop pixels: a square grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cells {
    /// Cells per row and column.
    pub side: usize,
    /// Coordinate of the first row and column.
    pub first: usize,
}

impl Cells {
    /// The cells of an architecture for search crops of a size.
    pub fn of(architecture: &Architecture, search_size: usize) -> Cells {
        let architecture = Architecture {
            search_size,
            ..*architecture
        };
        Cells {
            side: architecture.score_size(),
            first: architecture.score_offset(),
        }
    }

    /// Coordinate of row or column `i`.
    fn at(&self, i: usize) -> f32 {
        (self.first + i * Architecture::TOTAL_STRIDE) as f32
    }
}

/// Targets of a batch.
#[derive(Clone, Debug, PartialEq)]
pub struct Targets {
    /// `[batch, side, side, 1]`: 1 inside the target, 0 outside, -1 where nothing is asked.
    pub labels: Tensor,
    /// `[batch, side, side, 1]`: centerness inside the target, 0 elsewhere.
    pub quality: Tensor,
    /// `[batch, side, side, 4]`: the target's corners inside it, 0 elsewhere.
    pub boxes: Tensor,
}

impl Targets {
    /// Targets of `(corners, negative)` per item.
    ///
    /// A cell is inside if its distances to all four sides are above 0. Of a negative pair only
    /// cells inside the box count, as "no target"; centerness and corners stay as they are (as in
    /// video_analyst).
    pub fn new(items: &[(Corners, bool)], cells: Cells) -> Targets {
        let count = items.len() * cells.side * cells.side;
        let (mut labels, mut quality) = (Vec::with_capacity(count), Vec::with_capacity(count));
        let mut boxes = Vec::with_capacity(4 * count);
        for (corners, negative) in items {
            let [x0, y0, x1, y1] = *corners;
            for py in (0..cells.side).map(|i| cells.at(i)) {
                for px in (0..cells.side).map(|i| cells.at(i)) {
                    let (l, t, r, b) = (px - x0, py - y0, x1 - px, y1 - py);
                    let inside = l.min(t).min(r).min(b) > 0.0;
                    labels.push(match (inside, negative) {
                        (true, false) => 1.0,
                        (true, true) | (false, false) => 0.0,
                        (false, true) => -1.0,
                    });
                    let ratio = l.min(r) * t.min(b) / (l.max(r) * t.max(b) + 1e-5);
                    quality.push(if inside { ratio.abs().sqrt() } else { 0.0 });
                    boxes.extend(if inside { *corners } else { [0.0; 4] });
                }
            }
        }
        let shape = |channels| [items.len(), cells.side, cells.side, channels];
        Targets {
            labels: Tensor::new(&shape(1), labels),
            quality: Tensor::new(&shape(1), quality),
            boxes: Tensor::new(&shape(4), boxes),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weights_format::Widths;

    fn cells(search_size: usize) -> Cells {
        Cells::of(&Architecture::new(Widths::pruned(0.5), None), search_size)
    }

    #[test]
    fn grid_covers_the_score_map() {
        assert_eq!(
            cells(303),
            Cells {
                side: 17,
                first: 87
            }
        );
        assert_eq!(cells(239), Cells { side: 9, first: 87 });
        assert_eq!(
            cells(271),
            Cells {
                side: 13,
                first: 87
            }
        );
    }

    #[test]
    fn targets_equal_worked_values() {
        let targets = Targets::new(&[([100.0, 100.0, 200.0, 180.0], false)], cells(303));
        let labels = targets.labels.data();
        assert_eq!(labels.iter().filter(|l| **l == 1.0).count(), 130);
        let first = labels.iter().position(|l| *l == 1.0).unwrap();
        assert_eq!((first % 17, first / 17), (2, 2)); // (103, 103)
        let quality = targets.quality.data();
        assert!((quality[first] - 0.0347128).abs() < 1e-6);
        assert!((quality[7 * 17 + 8] - 0.9092422).abs() < 1e-6); // (151, 143)
        assert!((quality.iter().sum::<f32>() - 41.13872).abs() < 1e-3);
        assert_eq!(
            targets.boxes.data()[4 * first..][..4],
            [100.0, 100.0, 200.0, 180.0]
        );
        assert_eq!(targets.boxes.data()[..4], [0.0; 4]);
    }

    #[test]
    fn negative_pair_changes_labels_only() {
        let corners = [100.0, 100.0, 200.0, 180.0];
        let both = Targets::new(&[(corners, false), (corners, true)], cells(303));
        let (positive, negative) = both.labels.data().split_at(289);
        assert!(positive.iter().zip(negative).all(|(p, n)| *n == p - 1.0));
        let (positive, negative) = both.quality.data().split_at(289);
        assert_eq!(positive, negative);
    }

    #[test]
    fn box_beside_the_grid_has_no_positives() {
        let targets = Targets::new(&[([10.0, 10.0, 80.0, 80.0], false)], cells(303));
        assert!(targets.labels.data().iter().all(|l| *l == 0.0));
        assert!(targets.quality.data().iter().all(|q| *q == 0.0));
    }
}
