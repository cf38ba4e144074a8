//! The time that each stage of a frame takes.

use std::time::{Duration, Instant};

/// Time per stage of one frame, in the order of work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stages {
    /// The search crop.
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
    /// The online filter: its response and its update.
    pub filter: Duration,
    /// The choice of the box from the outputs.
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

/// A stopwatch that restarts at every reading.
pub(crate) struct Lap(Instant);

impl Lap {
    pub(crate) fn start() -> Lap {
        Lap(Instant::now())
    }

    /// The time since the last reading.
    pub(crate) fn lap(&mut self) -> Duration {
        let now = Instant::now();
        now - std::mem::replace(&mut self.0, now)
    }
}
