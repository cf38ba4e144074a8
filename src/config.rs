//! The tracker's hyper-parameters.

use weights_format::TrackerParams;

/// How the tracker turns the network's outputs into a box. The model file carries the values it was made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackConfig {
    /// Context around the target in the crops, as a share of (w + h): 0.5.
    pub context_amount: f64,
    /// Greatest step of the size toward the new one, in `[0, 1]`.
    pub size_lr: f64,
    /// Weight of the cosine window against the penalized score, in `[0, 1]`.
    pub window_influence: f64,
    /// How strongly changes of size and aspect are penalized.
    pub penalty_k: f64,
    /// Smallest side of a box, in pixels.
    pub min_size: f32,
    /// Share of the network's error in the first frame that is taken out of all later boxes, in `[0, 1]`; 0 is the paper's
    /// tracker.
    pub correction: f64,
    /// Share of the target's later looks in the template, in `[0, 1]`; 0 is the paper's tracker, which keeps the first
    /// frame's.
    pub template_update: f64,
    /// Share of the online filter's response in the score that chooses a cell, in `[0, 1]`; 0 is the paper's tracker, which learns
    /// no filter and looks no wider when it has lost its target.
    pub online_filter: f64,
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
        }
    }
}

impl Default for TrackConfig {
    /// The values for all UAV benchmarks (spec section 2.7, first row).
    fn default() -> Self {
        TrackConfig::from(&TrackerParams::default())
    }
}
