//! Time per stage of the last frame.

use std::time::{Duration, Instant};

/// What a frame's time went to, in the order of work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stages {
    /// Cutting the search crop.
    pub crop: Duration,
    /// conv1 to conv5.
    pub backbone: Duration,
    /// The identity-related encoder E2.
    pub dr: Duration,
    /// The neck's two convolutions.
    pub neck: Duration,
    /// Cross-correlation with the template features.
    pub xcorr: Duration,
    /// The two towers and their outputs.
    pub head: Duration,
    /// Response of the online filter, and what it learns.
    pub filter: Duration,
    /// From the outputs to the box.
    pub select: Duration,
}

impl Stages {
    /// Name and duration of each stage.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, Duration)> {
        [
            ("crop", self.crop),
            ("backbone", self.backbone),
            ("dr", self.dr),
            ("neck", self.neck),
            ("xcorr", self.xcorr),
            ("head", self.head),
            ("filter", self.filter),
            ("select", self.select),
        ]
        .into_iter()
    }

    /// All stages together.
    pub fn total(&self) -> Duration {
        self.iter().map(|(_, time)| time).sum()
    }
}

/// Hands out the time since it was last asked.
pub(crate) struct Lap(Instant);

impl Lap {
    pub(crate) fn start() -> Lap {
        Lap(Instant::now())
    }

    pub(crate) fn lap(&mut self) -> Duration {
        let now = Instant::now();
        now - std::mem::replace(&mut self.0, now)
    }
}
