//! The best places of a score map, one per object.

use crate::bbox::BBox;
use crate::net::Outputs;
use crate::select::{Choice, Selector};

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

/// The chosen cell and then the best cells of other objects, by falling score; boxes in crop pixels, similarity 0.
pub(crate) fn find(outputs: &Outputs, selector: &Selector, choice: &Choice, found: &mut Vec<Candidate>) {
    let n = selector.side();
    found.clear();
    found.push(Candidate { bbox: choice.bbox.corner(), score: choice.score as f32, similarity: 0.0 });
    while found.len() < MAX_CANDIDATES {
        let mut best: Option<Candidate> = None;
        for (index, (&score, ltrb)) in outputs.score.iter().zip(outputs.ltrb.chunks_exact(4)).enumerate() {
            if !score.is_finite() || best.is_some_and(|b| b.score >= score) {
                continue;
            }
            let bbox = selector.decode(index / n, index % n, ltrb).corner();
            if bbox.is_finite() && found.iter().all(|f| f.bbox.iou(&bbox) < SAME_OBJECT) {
                best = Some(Candidate { bbox, score, similarity: 0.0 });
            }
        }
        let Some(best) = best else { break };
        found.push(best);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrackConfig;
    use weights_format::{Architecture, Widths};

    #[test]
    fn one_candidate_per_object() {
        let selector = Selector::new(&Architecture::new(Widths::FULL, None));
        let mut outputs = Outputs { score: vec![0.1; 289], ltrb: [12.0; 4].repeat(289) };
        for (index, score) in [(0, 0.7), (1, 0.65), (144, 0.9), (280, 0.5)] {
            outputs.score[index] = score; // 0 and 1 are neighbours: one object
        }
        let config = TrackConfig { window_influence: 0.0, ..TrackConfig::default() };
        let choice = selector.choose(&outputs, &[], [25.0; 2], &config).unwrap();
        let mut found = Vec::new();
        find(&outputs, &selector, &choice, &mut found);
        let scores: Vec<f32> = found.iter().map(|c| c.score).collect();
        assert_eq!(scores[..3], [0.9, 0.7, 0.5]);
        assert_eq!(found.len(), MAX_CANDIDATES);
        outputs.score = vec![f32::NAN; 289];
        find(&outputs, &selector, &choice, &mut found);
        assert_eq!(found.len(), 1);
    }
}
