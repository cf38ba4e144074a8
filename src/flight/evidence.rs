//! What speaks for and against a chosen box: numbers from the response, the identity-related
//! features, the motion and the colors.

use super::candidates::{self, Candidate, MAX_CANDIDATES, Peak};
use crate::bbox::{CropBox, FrameBox};
use crate::net::Map;
use crate::tracker::{Seen, Selector, Tracker};

/// Numbers in [`Evidence`].
pub const COUNT: usize = 15;

/// The names of the fields of [`Evidence`], in the order of [`Evidence::to_array`].
pub const NAMES: [&str; COUNT] = [
    "score",
    "second",
    "sharpness",
    "agreement",
    "identity",
    "likeness",
    "familiar",
    "margin",
    "shape",
    "score_drop",
    "identity_drop",
    "motion",
    "response",
    "contrast",
    "colors",
];

/// What speaks for and against a box; every number is finite and of moderate size.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Log-odds of the chosen cell's score.
    pub score: f64,
    /// Best score of another object over this one's, at most 1.
    pub second: f64,
    /// Logarithm of the average peak-to-correlation energy of the score map.
    pub sharpness: f64,
    /// Mean IoU of the neighboring cells' boxes with the chosen one.
    pub agreement: f64,
    /// Cosine of the identity-related features with the template's, both less the region's mean.
    pub identity: f64,
    /// Cosine of the identity-related features with the template's.
    pub likeness: f64,
    /// Cosine with the target's appearance when it was last seen well.
    pub familiar: f64,
    /// `identity` less the best of the other candidates'.
    pub margin: f64,
    /// Change of size and aspect that the network asks for.
    pub shape: f64,
    /// `score` less its usual value.
    pub score_drop: f64,
    /// `identity` less its usual value.
    pub identity_drop: f64,
    /// Logarithm of the distance from the predicted place, in target sides.
    pub motion: f64,
    /// Response of the online filter; 0 without one.
    pub response: f64,
    /// `response` less the best of the other candidates'.
    pub contrast: f64,
    /// How far the box has the target's colors, in `[0, 1]`.
    pub colors: f64,
}

impl Evidence {
    /// Every field, in the order of [`NAMES`].
    fn fields(&mut self) -> [&mut f64; COUNT] {
        let Evidence {
            score,
            second,
            sharpness,
            agreement,
            identity,
            likeness,
            familiar,
            margin,
            shape,
            score_drop,
            identity_drop,
            motion,
            response,
            contrast,
            colors,
        } = self;
        [
            score,
            second,
            sharpness,
            agreement,
            identity,
            likeness,
            familiar,
            margin,
            shape,
            score_drop,
            identity_drop,
            motion,
            response,
            contrast,
            colors,
        ]
    }

    /// All numbers, in the order of [`NAMES`].
    pub fn to_array(&self) -> [f64; COUNT] {
        let mut copy = *self;
        copy.fields().map(|value| *value)
    }

    /// Replaces every number that is not finite by 0.
    fn make_finite(&mut self) {
        for value in self.fields() {
            if !value.is_finite() {
                *value = 0.0;
            }
        }
    }
}

/// A box in frame pixels with its evidence.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Finding {
    pub bbox: FrameBox,
    pub score: f32,
    pub evidence: Evidence,
    /// Whether the picture shows nothing there.
    pub is_blank: bool,
}

/// Judges the network's last outputs, and remembers how the target usually looks.
#[derive(Clone, Debug, Default)]
pub(crate) struct Witness {
    mean: Vec<f32>,                 // [channels]: of the search region's features
    window: Vec<f32>,               // features at the chosen box, less the mean
    familiar: Vec<f32>,             // running mean of good windows; empty before the first
    usual: Option<(f64, f64)>,      // running means of `score` and `identity`
    peaks: Vec<Peak>,               // of the last search: the chosen one, then by falling score
    pub candidates: Vec<Candidate>, // the peaks in frame pixels
    pub findings: Vec<Finding>,     // the first of the candidates, with their evidence
}

/// Least score of a candidate that was not chosen but is worth judging.
const SLIGHT: f64 = 0.02;
/// Share of a new observation in the running means, per second since the last one.
const LEARNING: f64 = 1.5;
/// Largest share of one observation.
const MOST_LEARNING: f64 = 0.3;

impl Witness {
    /// Judges the choice of the tracker's last search and the other candidates; returns what speaks
    /// for the choice, `None` without one. The closures say of a box in frame pixels how far it is
    /// from where the target was expected, how far it has the target's colors, and whether it shows
    /// nothing.
    pub(crate) fn judge(
        &mut self,
        tracker: &Tracker,
        motion: impl Fn(&FrameBox) -> f64,
        mut colors: impl FnMut(&FrameBox) -> f64,
        is_blank: impl Fn(&FrameBox) -> bool,
    ) -> Option<Finding> {
        self.candidates.clear();
        self.findings.clear();
        let seen = tracker.seen()?;
        let choice = seen.choice?;
        let selector = tracker.selector();
        let outputs = tracker.network().outputs();
        let (template, search) = tracker.network().identity();
        search.channel_means(&mut self.mean);
        let sharpness = sharpness(&outputs.score);

        let response = tracker.response();
        candidates::find(outputs, selector, response, &choice, &mut self.peaks);
        let peaks = std::mem::take(&mut self.peaks);
        // The chosen one last, so that `window` holds its features.
        for peak in peaks.iter().rev() {
            let (identity, likeness) = self.similarity(template, search, selector, &peak.bbox);
            let bbox = seen.placement.to_frame(&peak.bbox);
            let (score, similarity) = (peak.score as f32, identity as f32);
            self.candidates.push(Candidate {
                bbox: bbox.corner(),
                score,
                similarity,
            });
            if peak.cell != choice.index && peak.score < SLIGHT {
                continue;
            }
            let familiar = if self.familiar.is_empty() {
                identity
            } else {
                cosine(&self.familiar, &self.window)
            };
            let score = log_odds(peak.score);
            let (usual_score, usual_identity) = self.usual.unwrap_or((score, identity));
            let evidence = Evidence {
                score,
                second: 0.0, // of the whole set, once all are known
                sharpness,
                agreement: agreement(outputs, selector, peak),
                identity,
                likeness,
                familiar,
                margin: 0.0, // of the whole set
                shape: shape(&peak.bbox, seen),
                score_drop: (score - usual_score).clamp(-6.0, 6.0),
                identity_drop: identity - usual_identity,
                motion: motion(&bbox).min(20.0).ln_1p(),
                response: peak.response.clamp(0.0, 1.0),
                contrast: 0.0, // of the whole set
                colors: colors(&bbox),
            };
            self.findings.push(Finding {
                bbox,
                score: peak.score as f32,
                evidence,
                is_blank: is_blank(&bbox),
            });
        }
        self.peaks = peaks;
        self.candidates.reverse();
        self.findings.reverse();
        self.compare();
        self.findings.first().copied()
    }

    /// Fills in what each finding's evidence says of the other candidates. Findings are the first
    /// of the candidates: those left out score least.
    fn compare(&mut self) {
        let (peaks, candidates) = (&self.peaks, &self.candidates);
        for (i, finding) in self.findings.iter_mut().enumerate() {
            let others = peaks
                .iter()
                .zip(candidates)
                .enumerate()
                .filter(|(other, _)| *other != i);
            let [mut score, mut identity, mut response] = [0.0f64; 3]; // the others' best
            for (_, (peak, candidate)) in others {
                score = score.max(peak.score);
                identity = identity.max(candidate.similarity.into());
                response = response.max(peak.response);
            }
            let evidence = &mut finding.evidence;
            evidence.second = (score / peaks[i].score.max(1e-6)).min(1.0);
            evidence.margin = evidence.identity - identity;
            evidence.contrast = evidence.response - response.min(1.0);
            evidence.make_finite();
        }
    }

    /// Takes the last judged box for the target as it looks now, as far as `presence` says so; `dt`
    /// seconds have gone by since the last frame.
    pub(crate) fn learn(&mut self, evidence: &Evidence, presence: f64, dt: f64) {
        let rate = ((LEARNING * dt).min(MOST_LEARNING) * presence) as f32;
        if self.familiar.len() != self.window.len() {
            self.familiar.clone_from(&self.window);
        }
        for (old, new) in self.familiar.iter_mut().zip(&self.window) {
            *old += rate * (new - *old);
        }
        let (score, identity) = (evidence.score, evidence.identity);
        let (usual_score, usual_identity) = self.usual.get_or_insert((score, identity));
        *usual_score += f64::from(rate) * (score - *usual_score);
        *usual_identity += f64::from(rate) * (identity - *usual_identity);
    }

    /// Cosine of the template with the features around a box given in crop pixels, without and with
    /// the common mean, at the best of the nine places around the box. Leaves the features of that
    /// place in `window`.
    fn similarity(
        &mut self,
        template: &Map,
        search: &Map,
        selector: &Selector,
        bbox: &CropBox,
    ) -> (f64, f64) {
        let (side, reach) = (template.size().h, search.size().h);
        if side == 0 || reach < side || template.channels() != search.channels() {
            return (0.0, 0.0);
        }
        let [row, column] =
            [bbox.cy, bbox.cx].map(|center| selector.window_start(center, side, reach));
        let mut best = (f64::MIN, 0.0, row, column);
        for y in row.saturating_sub(1)..=(row + 1).min(reach - side) {
            for x in column.saturating_sub(1)..=(column + 1).min(reach - side) {
                let (centered, plain) = compare(template, search, &self.mean, y, x);
                if centered > best.0 {
                    best = (centered, plain, y, x);
                }
            }
        }
        self.window.clear();
        let (channels, edge) = (search.channels(), inner(side));
        for y in best.2 + edge..best.2 + side - edge {
            for x in best.3 + edge..best.3 + side - edge {
                let pixel = &search.values()[(y * reach + x) * channels..][..channels];
                self.window
                    .extend(pixel.iter().zip(&self.mean).map(|(v, m)| v - m));
            }
        }
        (best.0, best.1)
    }
}

/// Cells at the template's edge that are left out: they show its surroundings.
fn inner(side: usize) -> usize {
    usize::from(side >= 4)
}

/// Cosine of the template's inner features with the search region's at an offset: less the mean,
/// and plain.
fn compare(template: &Map, search: &Map, mean: &[f32], y: usize, x: usize) -> (f64, f64) {
    let (side, reach, channels) = (template.size().h, search.size().w, template.channels());
    let edge = inner(side);
    let [mut tt, mut ss, mut ts] = [0f32; 3];
    let [mut plain_tt, mut plain_ss, mut plain_ts] = [0f32; 3];
    for row in edge..side - edge {
        for column in edge..side - edge {
            let t = &template.values()[(row * side + column) * channels..][..channels];
            let s = &search.values()[((y + row) * reach + x + column) * channels..][..channels];
            for ((t, s), m) in t.iter().zip(s).zip(mean) {
                plain_tt += t * t;
                plain_ss += s * s;
                plain_ts += t * s;
                let (t, s) = (t - m, s - m);
                tt += t * t;
                ss += s * s;
                ts += t * s;
            }
        }
    }
    let cosine = |ts: f32, tt: f32, ss: f32| f64::from(ts / (tt * ss).sqrt().max(1e-12));
    (cosine(ts, tt, ss), cosine(plain_ts, plain_tt, plain_ss))
}

fn cosine(a: &[f32], b: &[f32]) -> f64 {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    f64::from(dot(a, b) / (dot(a, a) * dot(b, b)).sqrt().max(1e-12))
}

pub(crate) fn log_odds(p: f64) -> f64 {
    let p = p.clamp(1e-4, 1.0 - 1e-4);
    (p / (1.0 - p)).ln()
}

/// `ln((max - min)^2 / mean((s - min)^2))`: average peak-to-correlation energy (Wang, Liu, Huang,
/// CVPR 2017).
fn sharpness(scores: &[f32]) -> f64 {
    let finite = || scores.iter().copied().filter(|s| s.is_finite());
    let (least, most) = (
        finite().fold(f32::MAX, f32::min),
        finite().fold(f32::MIN, f32::max),
    );
    let energy: f32 =
        finite().map(|s| (s - least) * (s - least)).sum::<f32>() / scores.len().max(1) as f32;
    let range = f64::from(most - least);
    (range * range / f64::from(energy).max(1e-12)).max(1.0).ln()
}

/// Mean IoU of the boxes of the eight cells around a peak with its own.
fn agreement(outputs: &crate::net::Outputs, selector: &Selector, peak: &Peak) -> f64 {
    let n = selector.side();
    let (row, column) = (peak.cell / n, peak.cell % n);
    let (mut sum, mut count) = (0.0, 0.0);
    for y in row.saturating_sub(1)..=(row + 1).min(n - 1) {
        for x in column.saturating_sub(1)..=(column + 1).min(n - 1) {
            if (y, x) != (row, column) {
                let bbox = selector.decode(y, x, &outputs.ltrb[4 * (y * n + x)..][..4]);
                sum += f64::from(bbox.iou(&peak.bbox));
                count += 1.0;
            }
        }
    }
    if count > 0.0 { sum / count } else { 0.0 }
}

/// `ln` of the change of size times the change of aspect, 0 for none.
fn shape(bbox: &CropBox, seen: &Seen) -> f64 {
    let ratio = |new: f32, old: f64| f64::from(new) / old.max(1e-6);
    let old = seen.placement.size_in_crop(&seen.around);
    let (w, h) = (ratio(bbox.w, old.w), ratio(bbox.h, old.h));
    let (size, aspect) = (
        (w * h).max(1e-6).sqrt().ln().abs(),
        (w / h.max(1e-6)).max(1e-6).ln().abs(),
    );
    (size + aspect).min(4.0)
}

const _: () = assert!(MAX_CANDIDATES >= 2);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lone_peak_is_sharper_than_a_plateau() {
        let mut lone = vec![0.01f32; 289];
        lone[144] = 0.9;
        let plateau: Vec<f32> = (0..289)
            .map(|i| if i % 2 == 0 { 0.9 } else { 0.01 })
            .collect();
        assert!(sharpness(&lone) > sharpness(&plateau) + 2.0);
        assert_eq!(sharpness(&[0.5; 9]), 0.0);
        assert!(sharpness(&[f32::NAN, 0.1, 0.9]).is_finite());
    }

    #[test]
    fn parallel_vectors_have_cosine_one_and_orthogonal_ones_zero() {
        assert!((cosine(&[1.0, 2.0], &[2.0, 4.0]) - 1.0).abs() < 1e-6);
        assert_eq!(cosine(&[1.0, 0.0], &[0.0, 3.0]), 0.0);
        assert_eq!(cosine(&[0.0; 3], &[1.0; 3]), 0.0);
    }

    #[test]
    fn certain_probabilities_have_finite_log_odds() {
        assert_eq!(log_odds(0.5), 0.0);
        assert!(log_odds(0.0).is_finite() && (log_odds(1.0) + log_odds(0.0)).abs() < 1e-9);
    }
}
