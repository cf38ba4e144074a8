//! Health of the source, which every output gives as one word.

use std::time::{Duration, Instant};

/// Health of a source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Health {
    /// It has not delivered a frame yet.
    #[default]
    Waiting,
    /// It delivers frames.
    Live,
    /// It has delivered the same frame again and again for longer than the stall time-out.
    Frozen,
    /// It is open, but has delivered no frame for longer than the stall time-out.
    Stalled,
    /// It has failed or was closed because it was silent, and is opened again.
    Reconnecting,
    /// It has delivered its last frame.
    Ended,
}

impl Health {
    /// Every health.
    pub const ALL: [Health; 6] = [
        Health::Waiting,
        Health::Live,
        Health::Frozen,
        Health::Stalled,
        Health::Reconnecting,
        Health::Ended,
    ];

    /// The word for JSON, log, page and systemd.
    pub fn name(self) -> &'static str {
        match self {
            Health::Waiting => "waiting",
            Health::Live => "live",
            Health::Frozen => "frozen",
            Health::Stalled => "stalled",
            Health::Reconnecting => "reconnecting",
            Health::Ended => "ended",
        }
    }

    /// Whether frames come.
    pub fn delivers(self) -> bool {
        matches!(self, Health::Live | Health::Frozen)
    }
}

/// Least number of equal frames in a row that count as frozen, however slow the source is.
const MIN_EQUAL: u32 = 5;

/// How long the opening of a source may take, beyond the stall time-out.
pub const OPENING: Duration = Duration::from_secs(10);

/// What the feeding thread last reported about the source.
#[derive(Clone, Debug)]
pub struct Pulse {
    told: Health,
    /// When the last frame came.
    pub last_frame: Option<Instant>,
    /// When the feeding thread last made progress: a frame, an attempt to open, a wait between two.
    progress: Instant,
    /// Why the source was opened again, the last time.
    pub reason: Option<String>,
    /// Whether the source was closed because it was silent.
    silenced: bool,
    same: Same,
}

/// The newest frames, as long as they are equal.
#[derive(Clone, Copy, Debug)]
struct Same {
    fingerprint: u64,
    count: u32,
    since: Instant,
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
            same: Same {
                fingerprint: 0,
                count: 0,
                since: now,
            },
        }
    }

    /// A frame has come.
    pub fn frame(&mut self, now: Instant) {
        self.told = Health::Live;
        self.last_frame = Some(now);
        self.progress = now;
    }

    /// The frame that has come has this `fingerprint`.
    pub fn picture(&mut self, fingerprint: u64, now: Instant) {
        if self.same.count > 0 && self.same.fingerprint == fingerprint {
            self.same.count = self.same.count.saturating_add(1);
            return;
        }
        self.same = Same {
            fingerprint,
            count: 1,
            since: now,
        };
    }

    /// The feeding thread is at work: it opens the source, or waits before it does.
    pub fn progress(&mut self, now: Instant) {
        self.progress = now;
    }

    /// The source is closed because it is silent, which explains any error that follows.
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
            Health::Live if self.is_frozen(now, stall) => Health::Frozen,
            Health::Waiting | Health::Reconnecting if silent > stall + OPENING => Health::Stalled,
            told => told,
        }
    }

    fn is_frozen(&self, now: Instant, stall: Duration) -> bool {
        let unchanged = now.saturating_duration_since(self.same.since);
        self.same.count >= MIN_EQUAL && unchanged > stall
    }

    /// Whether to close the source because it is silent: it stalls, or takes too long to open.
    pub fn is_overdue(&self, now: Instant, stall: Duration) -> bool {
        let silent = now.saturating_duration_since(self.progress);
        match self.told {
            Health::Live => silent > stall,
            Health::Waiting | Health::Reconnecting => silent > OPENING.max(stall),
            _ => false,
        }
    }
}

/// A number that equal pictures share, and others hardly ever do.
pub fn fingerprint(pixels: &[u8]) -> u64 {
    const MULTIPLIER: u64 = 0x9e37_79b9_7f4a_7c15;
    // Four chains of products, so that they overlap: a frame takes a fraction of a millisecond.
    let mut chains = [pixels.len() as u64; 4];
    let (blocks, rest) = pixels.as_chunks::<32>();
    for block in blocks {
        for (chain, word) in chains.iter_mut().zip(block.as_chunks::<8>().0) {
            *chain = (*chain ^ u64::from_le_bytes(*word))
                .wrapping_mul(MULTIPLIER)
                .rotate_left(29);
        }
    }
    let mut sum = 0;
    for word in chains
        .into_iter()
        .chain(rest.iter().copied().map(u64::from))
    {
        sum = (sum ^ word).wrapping_mul(MULTIPLIER).rotate_left(29);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn same_picture_for_longer_than_the_stall_time_out_is_frozen() {
        let start = Instant::now();
        let stall = Duration::from_secs(2);
        let mut pulse = Pulse::new(start);
        let mut health = |second: u32, pixels: &[u8]| {
            let now = start + second * Duration::from_secs(1);
            pulse.frame(now);
            pulse.picture(fingerprint(pixels), now);
            pulse.health(now, stall)
        };
        let (one, other) = ([7; 100], [8; 100]);

        for second in 0..4 {
            assert_eq!(health(second, &one), Health::Live, "{second}: too few");
        }
        assert_eq!(health(4, &one), Health::Frozen);
        assert_eq!(health(5, &other), Health::Live);
    }

    #[test]
    fn pictures_that_differ_in_one_bit_have_other_fingerprints() {
        for length in [1, 8, 31, 32, 100] {
            let picture = vec![90; length];
            for place in 0..length {
                let mut other = picture.clone();
                other[place] ^= 4;

                assert_ne!(
                    fingerprint(&picture),
                    fingerprint(&other),
                    "{place} of {length}"
                );
            }
        }
    }

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
