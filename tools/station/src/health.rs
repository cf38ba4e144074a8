//! Health of the source: one word that every output repeats.

use std::time::{Duration, Instant};

/// What a source is doing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Health {
    /// It has not delivered a frame yet.
    #[default]
    Waiting,
    /// It delivers frames.
    Live,
    /// It is open, but has delivered no frame for longer than the stall time-out.
    Stalled,
    /// It has failed or was closed for its silence, and is opened again.
    Reconnecting,
    /// It has delivered its last frame.
    Ended,
}

impl Health {
    /// The word for JSON, log, page and systemd.
    pub fn name(self) -> &'static str {
        match self {
            Health::Waiting => "waiting",
            Health::Live => "live",
            Health::Stalled => "stalled",
            Health::Reconnecting => "reconnecting",
            Health::Ended => "ended",
        }
    }
}

/// How long the opening of a source may take, beyond the stall time-out.
pub const OPENING: Duration = Duration::from_secs(10);

/// What the feeding thread has told about the source.
#[derive(Clone, Debug)]
pub struct Pulse {
    told: Health,
    /// When the last frame came.
    pub last_frame: Option<Instant>,
    /// When the feeding thread last got anywhere: a frame, an attempt to open, a wait between two.
    progress: Instant,
    /// Why the source was opened again, the last time.
    pub reason: Option<String>,
    /// Whether the source was closed for its silence.
    silenced: bool,
}

impl Pulse {
    /// No frame yet.
    pub fn new(now: Instant) -> Pulse {
        Pulse {
            told: Health::Waiting,
            last_frame: None,
            progress: now,
            reason: None,
            silenced: false,
        }
    }

    /// A frame has come.
    pub fn frame(&mut self, now: Instant) {
        self.told = Health::Live;
        self.last_frame = Some(now);
        self.progress = now;
    }

    /// The feeding thread is at work: it opens the source, or waits before it does.
    pub fn progress(&mut self, now: Instant) {
        self.progress = now;
    }

    /// The source is closed for its silence, which explains whatever error follows.
    pub fn silenced(&mut self, stall: Duration) {
        self.failed(format!("no frame for {:.1} s", stall.as_secs_f64()));
        self.silenced = true;
    }

    /// The source has failed and is opened again; returns the reason that counts.
    pub fn failed(&mut self, reason: String) -> String {
        if std::mem::take(&mut self.silenced) {
            return self.reason.clone().unwrap_or(reason);
        }
        // A source that never delivered is still waited for.
        if self.last_frame.is_some() {
            self.told = Health::Reconnecting;
        }
        self.reason = Some(reason.clone());
        reason
    }

    /// No frame will follow.
    pub fn ended(&mut self) {
        self.told = Health::Ended;
    }

    /// Health at a moment.
    pub fn health(&self, now: Instant, stall: Duration) -> Health {
        let silent = now.saturating_duration_since(self.progress);
        match self.told {
            Health::Live if silent > stall => Health::Stalled,
            Health::Waiting | Health::Reconnecting if silent > stall + OPENING => Health::Stalled,
            told => told,
        }
    }

    /// Whether the source is to be closed for its silence: it stalls, or takes too long to open.
    pub fn is_overdue(&self, now: Instant, stall: Duration) -> bool {
        let silent = now.saturating_duration_since(self.progress);
        match self.told {
            Health::Live => silent > stall,
            Health::Waiting | Health::Reconnecting => silent > OPENING.max(stall),
            _ => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn health_follows_frames_failures_and_silence() {
        let start = Instant::now();
        let at = |seconds: u64| start + Duration::from_secs(seconds);
        let stall = Duration::from_secs(2);
        let mut pulse = Pulse::new(start);

        assert_eq!(pulse.health(at(5), stall), Health::Waiting);
        assert_eq!(pulse.health(at(13), stall), Health::Stalled);
        pulse.failed("no such device".into());
        pulse.progress(at(13));
        assert_eq!(pulse.health(at(13), stall), Health::Waiting);
        pulse.frame(at(14));
        assert_eq!(pulse.health(at(16), stall), Health::Live);
        assert!(!pulse.is_overdue(at(16), stall));
        assert_eq!(pulse.health(at(17), stall), Health::Stalled);
        assert!(pulse.is_overdue(at(17), stall));
        pulse.silenced(stall);
        assert_eq!(pulse.failed("killed".into()), "no frame for 2.0 s");
        assert_eq!(pulse.health(at(16), stall), Health::Reconnecting);
        assert_eq!(pulse.health(at(27), stall), Health::Stalled, "stuck");
        pulse.ended();
        assert_eq!(pulse.health(at(99), stall), Health::Ended);
    }
}
