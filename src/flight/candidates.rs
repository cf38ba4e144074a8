//! The best places of a score map, one per object.

use crate::bbox::{BBox, CropBox};
use crate::net::Outputs;
use crate::tracker::{Choice, Selector};

/// Most candidates kept of one search.
pub const MAX_CANDIDATES: usize = 5;
/// Boxes that overlap by this IoU or more show the same object.
const SAME_OBJECT: f32 = 0.2;

/// One place where the target may be.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Candidate {
    /// Its box in frame pixels.
    pub bbox: BBox,
    /// Classification score times centerness, in `[0, 1]`.
    pub score: f32,
    /// Cosine of its identity-related features with the template's, in `[-1, 1]`.
    pub similarity: f32,
}

/// The best cell of one object in the score map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Peak {
    /// Row-major index of the cell.
    pub cell: usize,
    /// Its box in crop pixels.
    pub bbox: CropBox,
    /// Score times centerness.
    pub score: f64,
    /// What the online filter says there; 0 without one.
    pub response: f64,
}

/// The chosen cell and then the best cells of other objects, by falling score.
pub(crate) fn find(
    outputs: &Outputs,
    selector: &Selector,
    response: &[f32],
    choice: &Choice,
    found: &mut Vec<Peak>,
) {
    let n = selector.side();
    found.clear();
    found.push(Peak {
        cell: choice.index,
        bbox: choice.bbox,
        score: choice.score,
        response: choice.response,
    });
    while found.len() < MAX_CANDIDATES {
        let mut best: Option<Peak> = None;
        for (cell, (&score, ltrb)) in outputs
            .score
            .iter()
            .zip(outputs.ltrb.chunks_exact(4))
            .enumerate()
        {
            let score = f64::from(score);
            if !score.is_finite() || best.is_some_and(|b| b.score >= score) {
                continue;
            }
            let bbox = selector.decode(cell / n, cell % n, ltrb);
            if bbox.is_finite() && found.iter().all(|f| f.bbox.iou(&bbox) < SAME_OBJECT) {
                best = Some(Peak {
                    cell,
                    bbox,
                    score,
                    response: 0.0,
                });
            }
        }
        let Some(best) = best else { break };
        found.push(Peak {
            response: selector.response_at(&best.bbox, response),
            ..best
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrackConfig;
    use crate::tracker::CropSize;
    use weights_format::{Architecture, Widths};

    #[test]
    fn neighboring_cells_give_one_candidate_per_object() {
        let selector = Selector::new(&Architecture::new(Widths::FULL, None));
        let mut outputs = Outputs {
            score: vec![0.1; 289],
            ltrb: [12.0; 4].repeat(289),
        };
        for (index, score) in [(0, 0.7), (1, 0.65), (144, 0.9), (280, 0.5)] {
            outputs.score[index] = score; // 0 and 1 are neighbors: one object
        }
        let config = TrackConfig {
            window_influence: 0.0,
            ..TrackConfig::default()
        };
        let previous = CropSize { w: 25.0, h: 25.0 };
        let choice = selector.choose(&outputs, &[], previous, &config).unwrap();
        let mut found = Vec::new();
        find(&outputs, &selector, &[], &choice, &mut found);
        let scores: Vec<f64> = found.iter().map(|c| c.score).collect();
        assert!(
            scores
                .iter()
                .zip([0.9, 0.7, 0.5])
                .all(|(score, expected)| (score - expected).abs() < 1e-6)
        );
        assert_eq!(found.len(), MAX_CANDIDATES);
        outputs.score = vec![f32::NAN; 289];
        find(&outputs, &selector, &[], &choice, &mut found);
        assert_eq!(found.len(), 1);
    }
}
