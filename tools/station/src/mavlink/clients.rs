//! How often each client wants the tracking status.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::MavResult;

use super::link::Peer;

/// How often the status is sent unless a client asks otherwise.
pub const INTERVAL: Duration = Duration::from_millis(100);
/// Bounds of the interval.
const SHORTEST: Duration = Duration::from_millis(20);
const LONGEST: Duration = Duration::from_secs(60);
/// Most clients whose wishes are remembered.
const MAX_CLIENTS: usize = 64;

/// The intervals that clients want; a client is a system reached through a peer.
#[derive(Debug, Default)]
pub struct Clients {
    wishes: BTreeMap<(Peer, u32), Option<Duration>>, // `None` for no status
    next: BTreeMap<Peer, Instant>,
}

impl Clients {
    /// Takes a client's wish, in microseconds; 0 asks for the default and -1 for none.
    pub fn set_interval(&mut self, peer: Peer, system: u32, microseconds: f32) -> MavResult {
        let wish = match microseconds {
            wish if wish.is_nan() => return MavResult::MAV_RESULT_DENIED,
            wish if wish < 0.0 => None,
            0.0 => Some(INTERVAL),
            wish => Some(Duration::from_micros(wish.min(1e9) as u64).clamp(SHORTEST, LONGEST)),
        };
        if !self.remember(peer, system, wish) {
            return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        self.next.remove(&peer);
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// Sends the status to a client from now on, because it has started a target.
    pub fn wants_status(&mut self, peer: Peer, system: u32) {
        let wish = self.wishes.get(&(peer, system)).copied().flatten();
        self.remember(peer, system, Some(wish.unwrap_or(INTERVAL)));
    }

    /// Forgets the clients of peers that have gone.
    pub fn forget(&mut self, has_gone: impl Fn(Peer) -> bool) {
        self.wishes.retain(|(peer, _), _| !has_gone(*peer));
        self.next.retain(|peer, _| !has_gone(*peer));
    }

    fn remember(&mut self, peer: Peer, system: u32, wish: Option<Duration>) -> bool {
        let is_known = self.wishes.contains_key(&(peer, system));
        if !is_known && self.wishes.len() >= MAX_CLIENTS {
            return false;
        }
        self.wishes.insert((peer, system), wish);
        true
    }

    /// Time between two messages for a peer.
    ///
    /// Clients of the same peer receive the same messages, so the shortest interval counts.
    fn interval(&self, peer: Peer) -> Option<Duration> {
        let wishes = self.wishes.range((peer, 0)..=(peer, u32::MAX));
        let mut fastest = None;
        let mut has_wish = false;
        for (_, wish) in wishes {
            has_wish = true;
            fastest = match (fastest, *wish) {
                (Some(a), Some(b)) => Some(std::cmp::min(a, b)),
                (a, b) => a.or(b),
            };
        }
        if has_wish { fastest } else { Some(INTERVAL) }
    }

    /// Whether the status is to be sent to a peer now.
    pub fn is_status_due(&mut self, peer: Peer, now: Instant) -> bool {
        let Some(interval) = self.interval(peer) else {
            return false;
        };
        let due = self.next.get(&peer).copied().unwrap_or(now);
        if now < due {
            return false;
        }
        let next = due + interval;
        self.next
            .insert(peer, if next > now { next } else { now + interval });
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sent(clients: &mut Clients, peer: Peer, start: Instant) -> usize {
        (0..1000)
            .filter(|ms| clients.is_status_due(peer, start + Duration::from_millis(*ms)))
            .count()
    }

    #[test]
    fn interval_is_kept_for_each_peer() {
        let mut clients = Clients::default();
        let start = Instant::now();

        clients.set_interval(1, 255, 500_000.0);

        assert!((2..=3).contains(&sent(&mut clients, 1, start)));
        assert!((10..=11).contains(&sent(&mut clients, 2, start)));
    }

    #[test]
    fn client_that_wants_none_does_not_silence_another_one() {
        let mut clients = Clients::default();
        let start = Instant::now();
        clients.set_interval(1, 255, 200_000.0);

        clients.set_interval(1, 254, -1.0);
        assert!((5..=6).contains(&sent(&mut clients, 1, start)));

        clients.set_interval(1, 255, -1.0);
        assert_eq!(sent(&mut clients, 1, start + Duration::from_secs(2)), 0);

        clients.wants_status(1, 254);
        assert!(sent(&mut clients, 1, start + Duration::from_secs(4)) >= 10);
    }

    #[test]
    fn nonsense_is_denied() {
        let denied = Clients::default().set_interval(1, 255, f32::NAN);

        assert_eq!(denied, MavResult::MAV_RESULT_DENIED);
    }
}
