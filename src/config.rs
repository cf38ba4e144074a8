//! The tracker's hyper-parameters.

use weights_format::TrackerParams;

/// Hyper-parameters of the tracker; each model file carries its own values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackConfig {
    /// Context around the target in the crops, as a share of (w + h).
    pub context_amount: f64,
    /// Greatest step of the size toward the new size, in `[0, 1]`.
    pub size_lr: f64,
    /// Weight of the cosine window against the penalized score, in `[0, 1]`.
    pub window_influence: f64,
    /// Strength of the penalty on changes of size and aspect.
    pub penalty_k: f64,
    /// Smallest side of a box, in pixels; a target that starts smaller than twice this side gets a
    /// lower bound.
    pub min_size: f32,
    /// Share of the network's error in the first frame that corrects every later box, in `[0, 1]`.
    ///
    /// 0 in the published tracker.
    pub correction: f64,
    /// Share of later frames in the template, in `[0, 1]`.
    ///
    /// 0 in the published tracker, which keeps the first frame's template.
    pub template_update: f64,
    /// Share of the online filter's response in the score that chooses a cell, in `[0, 1]`.
    ///
    /// 0 in the published tracker, which learns no filter and searches no wider region for a lost
    /// target.
    pub online_filter: f64,
    /// Share of the change of the target's aspect since the first frame that the search region
    /// takes back, in `[0, 1]`.
    ///
    /// 0 in the published tracker, whose search region is a square.
    pub unstretch: f64,
    /// Share of the vote of the cells around the chosen one in the reported box, in `[0, 1]`.
    ///
    /// 0 in the published tracker, which reports the chosen cell's box.
    pub voting: f64,
}

impl TrackConfig {
    /// The same without what the published tracker lacks: correction, template update, online
    /// filter, stretched search regions, voting.
    pub fn as_published(self) -> TrackConfig {
        TrackConfig {
            correction: 0.0,
            template_update: 0.0,
            online_filter: 0.0,
            unstretch: 0.0,
            voting: 0.0,
            ..self
        }
    }
}

impl From<&TrackerParams> for TrackConfig {
    fn from(p: &TrackerParams) -> Self {
        TrackConfig {
            context_amount: f64::from(p.context_amount),
            size_lr: p.size_lr,
            window_influence: p.window_influence,
            penalty_k: p.penalty_k,
            min_size: p.min_size,
            correction: p.correction,
            template_update: p.template_update,
            online_filter: p.online_filter,
            unstretch: p.unstretch,
            voting: p.voting,
        }
    }
}

impl Default for TrackConfig {
    /// The published values for UAV benchmarks.
    ///
    /// Source: docs/method.md, section 2.7.
    fn default() -> Self {
        TrackConfig::from(&TrackerParams::default())
    }
}
