//! Limits on connections, so that nobody can lock the operator out.
//!
//! A connection holds a place until its request has arrived. If no place is free, a new connection
//! takes that of the one that has waited longest: an honest request arrives at once, while a slow
//! one that was sent to hold a place loses it to the next. Connections that have just come keep
//! their places as long as possible. Requests with the token are always answered.

use std::collections::BTreeMap;
use std::net::{IpAddr, Shutdown, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::hub::lock;

/// Most connections whose request has not arrived.
const MAX_WAITING: usize = 128;
/// Most of them from one address.
const MAX_WAITING_EACH: usize = 48;
/// Most of them from one address if the oldest has waited for longer than [`GRACE`].
const MAX_SLOW_EACH: usize = 12;
/// How long a request may take to arrive without being slow.
const GRACE: Duration = Duration::from_millis(300);
/// Most requests without the token that are answered at a time.
const MAX_ANSWERING: usize = 32;
/// Most streams without the token, videos and events together.
const MAX_STREAMS: usize = 32;
/// Most of them to one address.
const MAX_STREAMS_EACH: usize = 16;
/// Further streams for those who have the token.
const RESERVED_STREAMS: usize = 8;

/// Counts a server's connections and admits new ones within the limits.
#[derive(Debug, Default)]
pub struct Admission(Arc<Mutex<Taken>>);

#[derive(Debug, Default)]
struct Taken {
    next: u64,
    waiting: BTreeMap<u64, Waiting>, // oldest first
    answering: usize,
    streams: BTreeMap<IpAddr, usize>,
}

/// A connection whose request has not arrived.
#[derive(Debug)]
struct Waiting {
    from: IpAddr,
    stream: TcpStream,
    since: Instant,
}

/// The place of a connection whose request has not arrived.
#[derive(Debug)]
pub struct Ticket {
    number: u64,
    taken: Arc<Mutex<Taken>>,
}

/// The place of a request that is answered.
#[derive(Debug)]
pub struct Answering(Arc<Mutex<Taken>>);

/// The place of a stream.
#[derive(Debug)]
pub struct Watching {
    from: IpAddr,
    taken: Arc<Mutex<Taken>>,
}

impl Admission {
    /// Takes a place for a new connection; `None` if the connection has gone.
    pub fn enter(&self, stream: &TcpStream, from: IpAddr) -> Option<Ticket> {
        let handle = stream.try_clone().ok()?;
        let mut taken = lock(&self.0);
        if let Some(loser) = taken.loser(from)
            && let Some(waiting) = taken.waiting.remove(&loser)
        {
            let _ = waiting.stream.shutdown(Shutdown::Both); // its thread ends with it
        }
        let number = taken.next;
        taken.next += 1;
        let waiting = Waiting {
            from,
            stream: handle,
            since: Instant::now(),
        };
        taken.waiting.insert(number, waiting);
        Some(Ticket {
            number,
            taken: Arc::clone(&self.0),
        })
    }

    /// Takes a place for a stream; `None` if there is none left.
    pub fn watch(&self, from: IpAddr, is_trusted: bool) -> Option<Watching> {
        let mut taken = lock(&self.0);
        let total: usize = taken.streams.values().sum();
        let of_address = taken.streams.get(&from).copied().unwrap_or(0);
        let is_free = if is_trusted {
            total < MAX_STREAMS + RESERVED_STREAMS
        } else {
            total < MAX_STREAMS && of_address < MAX_STREAMS_EACH
        };
        if !is_free {
            return None;
        }
        *taken.streams.entry(from).or_default() += 1;
        Some(Watching {
            from,
            taken: Arc::clone(&self.0),
        })
    }
}

impl Taken {
    /// The connection that must lose its place to a new one from an address, if any.
    fn loser(&self, from: IpAddr) -> Option<u64> {
        let mut of_address = self
            .waiting
            .iter()
            .filter(|(_, waiting)| waiting.from == from);
        let oldest = of_address.next();
        let count = of_address.count() + 1;
        if let Some((number, waiting)) = oldest
            && (count >= MAX_WAITING_EACH
                || count >= MAX_SLOW_EACH && waiting.since.elapsed() > GRACE)
        {
            return Some(*number);
        }
        let is_full = self.waiting.len() >= MAX_WAITING;
        self.waiting.keys().next().copied().filter(|_| is_full)
    }
}

impl Ticket {
    /// Gives the place up, since the request has arrived; `None` if too many are being answered.
    pub fn answer(self, is_trusted: bool) -> Option<Answering> {
        let mut taken = lock(&self.taken);
        if taken.answering >= MAX_ANSWERING && !is_trusted {
            return None;
        }
        taken.answering += 1;
        Some(Answering(Arc::clone(&self.taken)))
    }
}

impl Drop for Ticket {
    fn drop(&mut self) {
        lock(&self.taken).waiting.remove(&self.number);
    }
}

impl Drop for Answering {
    fn drop(&mut self) {
        lock(&self.0).answering -= 1;
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        let mut taken = lock(&self.taken);
        if let Some(count) = taken.streams.get_mut(&self.from) {
            *count -= 1;
            if *count == 0 {
                taken.streams.remove(&self.from);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::{Ipv4Addr, TcpListener};

    fn connection() -> TcpStream {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        drop(client);
        listener.accept().unwrap().0
    }

    fn address(last: u8) -> IpAddr {
        Ipv4Addr::new(10, 0, 0, last).into()
    }

    #[test]
    fn oldest_waiting_connection_of_an_address_makes_room() {
        let admission = Admission::default();
        let stream = connection();
        let other = admission.enter(&stream, address(9)).unwrap();
        let held: Vec<Ticket> = (0..3 * MAX_WAITING_EACH)
            .map(|_| admission.enter(&stream, address(1)).unwrap())
            .collect();

        let taken = lock(&admission.0);

        assert_eq!(taken.waiting.len(), MAX_WAITING_EACH + 1);
        assert!(taken.waiting.contains_key(&other.number));
        assert!(taken.waiting.contains_key(&held.last().unwrap().number));
        assert!(!taken.waiting.contains_key(&held[0].number));
    }

    #[test]
    fn places_are_free_again_after_a_drop() {
        let admission = Admission::default();
        let stream = connection();

        let answering = admission.enter(&stream, address(1)).unwrap().answer(false);
        let watching = admission.watch(address(1), false);
        assert!(answering.is_some() && watching.is_some());
        drop((answering, watching));

        let taken = lock(&admission.0);
        assert!(taken.waiting.is_empty() && taken.streams.is_empty());
        assert_eq!(taken.answering, 0);
    }

    #[test]
    fn stream_with_the_token_gets_a_reserved_place() {
        let admission = Admission::default();
        let one: Vec<_> = (0..64)
            .filter_map(|_| admission.watch(address(1), false))
            .collect();
        let two: Vec<_> = (0..64)
            .filter_map(|_| admission.watch(address(2), false))
            .collect();

        assert_eq!((one.len(), two.len()), (MAX_STREAMS_EACH, MAX_STREAMS_EACH));
        assert!(admission.watch(address(3), false).is_none());
        assert!(admission.watch(address(1), true).is_some());
    }
}
