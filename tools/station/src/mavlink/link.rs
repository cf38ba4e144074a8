//! One link: its peers, and messages to and from them.
//!
//! Threads of their own read from sockets and ports. The link's thread takes the messages they have
//! read, and writes.

use std::io::{Error, ErrorKind, Read, Result, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, ToSocketAddrs, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::{MavMessage, VideoStreamEncoding};
use ::mavlink::error::MessageReadError;
use ::mavlink::{
    MAVLinkMessageRaw, MAVLinkV2MessageRaw, MavHeader, MavlinkReader, SigningConfig, SigningData,
};

use super::address::Address;
use super::stream;
use crate::hub::lock;

/// Number of a peer on its link.
pub type Peer = u32;

/// How long a connection may take to be opened.
const CONNECT: Duration = Duration::from_secs(3);
/// How long a read waits before its thread checks whether the link is closed.
const READ: Duration = Duration::from_millis(200);
/// How long a peer may take to receive a message.
const WRITE: Duration = Duration::from_millis(500);
/// Messages that may wait to be handled; further ones are lost.
const MAX_WAITING: usize = 256;
/// Most peers that are remembered; the one that was silent for longest makes room.
const MAX_PEERS: usize = 16;
/// Largest datagram.
const MAX_DATAGRAM: usize = 65_536;

/// The addressees of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Audience {
    /// One peer.
    One(Peer),
    /// Every peer that has shown an allowed system id, or that the user has named.
    Trusted,
    /// Every peer.
    All,
}

/// A message that was read from a peer.
pub struct Received {
    /// The peer.
    pub peer: Peer,
    /// The message; its signature is right if the link has a key.
    pub message: MAVLinkMessageRaw,
}

/// How a peer is reached.
enum Route {
    Connected,
    Datagrams(SocketAddr),
    Stream(Box<dyn Write + Send>),
}

struct Known {
    peer: Peer,
    route: Route,
    is_trusted: bool,
    heard: Instant,
}

/// What the link's threads share.
struct Shared {
    peers: Mutex<Vec<Known>>,
    queue: SyncSender<Received>,
    is_closed: AtomicBool,
    allowed: Vec<u32>,
    signing: Option<SigningData>,
    next_peer: Mutex<Peer>,
}

/// An open link.
pub struct Link {
    shared: Arc<Shared>,
    received: Receiver<Received>,
    socket: Option<UdpSocket>,
    /// Whether the link ends with its only connection.
    is_single: bool,
    header: MavHeader,
    encoding: VideoStreamEncoding,
}

impl Link {
    /// Opens a link; this may take some seconds.
    ///
    /// # Errors
    /// If the address cannot be reached or listened on.
    pub fn open(
        address: &Address,
        header: MavHeader,
        allowed: &[u32],
        key: Option<[u8; 32]>,
    ) -> Result<Link> {
        let (queue, received) = sync_channel(MAX_WAITING);
        let signing =
            key.map(|key| SigningData::from_config(SigningConfig::new(key, 0, true, false)));
        let shared = Arc::new(Shared {
            peers: Mutex::default(),
            queue,
            is_closed: AtomicBool::new(false),
            allowed: allowed.to_vec(),
            signing,
            next_peer: Mutex::default(),
        });
        let mut socket = None;
        match address {
            Address::UdpOut(to) => {
                let to = resolve(to)?;
                let any = if to.is_ipv6() { "[::]:0" } else { "0.0.0.0:0" };
                let ours = UdpSocket::bind(any)?;
                ours.connect(to)?;
                shared.add(Route::Connected, true);
                socket = Some(shared.read_datagrams(ours)?);
            }
            Address::UdpIn(at) => {
                socket = Some(shared.read_datagrams(UdpSocket::bind(resolve(at)?)?)?);
            }
            Address::TcpOut(to) => {
                let stream = TcpStream::connect_timeout(&resolve(to)?, CONNECT)?;
                shared.serve_stream(stream, true)?;
            }
            Address::TcpIn(at) => shared.accept(TcpListener::bind(resolve(at)?)?)?,
            Address::Serial(device, baud) => {
                let port = serialport::new(device, *baud).timeout(READ).open()?;
                let writer = port.try_clone()?;
                let peer = shared.add(Route::Stream(Box::new(writer)), true);
                shared.read_stream(peer, port);
            }
        }
        let is_single = matches!(address, Address::TcpOut(_) | Address::Serial(..));
        Ok(Link {
            shared,
            received,
            socket,
            is_single,
            header,
            encoding: VideoStreamEncoding::DEFAULT,
        })
    }

    /// The next message that was read, if there is one.
    pub fn receive(&self) -> Option<Received> {
        self.received.try_recv().ok()
    }

    /// Sets the encoding of the video that this link announces.
    pub fn set_encoding(&mut self, encoding: VideoStreamEncoding) {
        self.encoding = encoding;
    }

    /// Whether the link's only connection has ended.
    pub fn is_broken(&self) -> bool {
        self.is_single && lock(&self.shared.peers).is_empty()
    }

    /// The peers that are remembered, and whether each one gets telemetry.
    pub fn peers(&self) -> Vec<(Peer, bool)> {
        let peers = lock(&self.shared.peers);
        peers
            .iter()
            .map(|known| (known.peer, known.is_trusted))
            .collect()
    }

    /// Sends a message.
    ///
    /// # Errors
    /// If the link itself fails; a peer that does not receive it is no failure.
    pub fn send(&mut self, audience: Audience, message: &MavMessage) -> Result<()> {
        if let MavMessage::VIDEO_STREAM_INFORMATION(data) = message {
            let raw = stream::serialized(data, self.encoding, self.header, self.signing());
            return self.send_raw(audience, &raw);
        }
        let mut raw = MAVLinkV2MessageRaw::new();
        match &self.shared.signing {
            Some(signing) => {
                raw.serialize_message_for_signing(self.header, message);
                signing.sign_message(&mut raw);
            }
            None => raw.serialize_message(self.header, message),
        }
        self.send_raw(audience, &raw)
    }

    /// Sends a message that is serialized already, by [`header`](Self::header) and with
    /// [`signing`](Self::signing).
    ///
    /// # Errors
    /// As [`send`](Self::send).
    pub fn send_raw(&mut self, audience: Audience, raw: &MAVLinkV2MessageRaw) -> Result<()> {
        self.header.sequence = self.header.sequence.wrapping_add(1);
        let bytes = raw.raw_bytes();
        let mut failed = None;
        lock(&self.shared.peers).retain_mut(|known| {
            let is_meant = match audience {
                Audience::One(peer) => known.peer == peer,
                Audience::Trusted => known.is_trusted,
                Audience::All => true,
            };
            if !is_meant {
                return true;
            }
            let sent = match (&mut known.route, &self.socket) {
                (Route::Stream(stream), _) => return stream.write_all(bytes).is_ok(),
                (Route::Connected, Some(socket)) => socket.send(bytes),
                (Route::Datagrams(to), Some(socket)) => socket.send_to(bytes, *to),
                (_, None) => return false,
            };
            if let Err(error) = sent
                && !is_passing(&error)
            {
                failed = Some(error);
            }
            true
        });
        match failed {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// The header of the next message.
    pub fn header(&self) -> MavHeader {
        self.header
    }

    /// What signs messages, if the link has a key.
    pub fn signing(&self) -> Option<&SigningData> {
        self.shared.signing.as_ref()
    }
}

impl Drop for Link {
    fn drop(&mut self) {
        self.shared.is_closed.store(true, Ordering::Relaxed);
    }
}

impl Shared {
    /// Remembers a new peer.
    fn add(&self, route: Route, is_trusted: bool) -> Peer {
        let mut next = lock(&self.next_peer);
        *next += 1;
        lock(&self.peers).push(Known {
            peer: *next,
            route,
            is_trusted,
            heard: Instant::now(),
        });
        *next
    }

    /// The peer at an address, which is remembered from now on. If there are too many, the one that
    /// was silent longest is forgotten, a trusted one only if all are.
    fn peer_at(&self, from: SocketAddr, is_trusted: bool) -> Peer {
        {
            let mut peers = lock(&self.peers);
            for known in peers.iter_mut() {
                let is_it = match &known.route {
                    Route::Datagrams(address) => *address == from,
                    _ => true, // the only one
                };
                if is_it {
                    known.heard = Instant::now();
                    known.is_trusted |= is_trusted;
                    return known.peer;
                }
            }
            if peers.len() >= MAX_PEERS {
                let oldest = peers
                    .iter()
                    .enumerate()
                    .min_by_key(|(_, known)| (known.is_trusted, known.heard));
                if let Some((index, _)) = oldest {
                    peers.remove(index);
                }
            }
        }
        self.add(Route::Datagrams(from), is_trusted)
    }

    /// Marks a stream's peer as trusted once it has shown an allowed system id.
    fn heard_from(&self, peer: Peer, system: u32) {
        let is_trusted = self.allowed.contains(&system);
        for known in lock(&self.peers).iter_mut() {
            if known.peer == peer {
                known.heard = Instant::now();
                known.is_trusted |= is_trusted;
            }
        }
    }

    fn forget(&self, peer: Peer) {
        lock(&self.peers).retain(|known| known.peer != peer);
    }

    fn is_open(&self) -> bool {
        !self.is_closed.load(Ordering::Relaxed)
    }

    /// Reads datagrams on a thread; returns the socket to write with.
    fn read_datagrams(self: &Arc<Shared>, socket: UdpSocket) -> Result<UdpSocket> {
        socket.set_read_timeout(Some(READ))?;
        socket.set_write_timeout(Some(WRITE))?;
        let writer = socket.try_clone()?;
        let shared = Arc::clone(self);
        std::thread::spawn(move || {
            let mut datagram = vec![0; MAX_DATAGRAM];
            while shared.is_open() {
                match socket.recv_from(&mut datagram) {
                    Ok((count, from)) => shared.take_datagram(&datagram[..count], from),
                    Err(error) if is_waiting(&error) => {}
                    // An earlier datagram was not received, or the network is down for a while.
                    Err(_) => std::thread::sleep(READ),
                }
            }
        });
        Ok(writer)
    }

    /// Takes the messages of one datagram; an incomplete one at its end is lost.
    fn take_datagram(&self, datagram: &[u8], from: SocketAddr) {
        let mut reader = MavlinkReader::new(datagram);
        while let Ok(message) = self.read_message(&mut reader) {
            let is_trusted = self.allowed.contains(&message.system_id());
            let peer = self.peer_at(from, is_trusted);
            let _ = self.queue.try_send(Received { peer, message });
        }
    }

    /// Serves a connection: remembers its peer and reads on a thread.
    fn serve_stream(self: &Arc<Shared>, stream: TcpStream, is_trusted: bool) -> Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(READ))?;
        stream.set_write_timeout(Some(WRITE))?;
        let writer = stream.try_clone()?;
        let peer = self.add(Route::Stream(Box::new(writer)), is_trusted);
        self.read_stream(peer, stream);
        Ok(())
    }

    fn read_stream(self: &Arc<Shared>, peer: Peer, stream: impl Read + Send + 'static) {
        let shared = Arc::clone(self);
        std::thread::spawn(move || {
            let mut reader = MavlinkReader::new(stream);
            while shared.is_open() {
                match shared.read_message(&mut reader) {
                    Ok(message) => {
                        shared.heard_from(peer, message.system_id());
                        let _ = shared.queue.try_send(Received { peer, message });
                    }
                    Err(MessageReadError::Io(error)) if !is_waiting(&error) => break,
                    Err(_) => {}
                }
            }
            shared.forget(peer);
        });
    }

    /// Accepts connections on a thread.
    fn accept(self: &Arc<Shared>, listener: TcpListener) -> Result<()> {
        listener.set_nonblocking(true)?;
        let shared = Arc::clone(self);
        std::thread::spawn(move || {
            while shared.is_open() {
                match listener.accept() {
                    Ok((stream, _)) if lock(&shared.peers).len() < MAX_PEERS => {
                        let _ = shared.serve_stream(stream, false); // it may have gone already
                    }
                    Ok(_) => {}
                    Err(_) => std::thread::sleep(READ / 4),
                }
            }
        });
        Ok(())
    }

    fn read_message<R: Read>(
        &self,
        reader: &mut MavlinkReader<R>,
    ) -> std::result::Result<MAVLinkMessageRaw, MessageReadError> {
        match &self.signing {
            Some(signing) => reader.read_any_raw_message_signed::<MavMessage>(Some(signing)),
            None => reader.read_any_raw_message::<MavMessage>(),
        }
    }
}

/// Looks an address up.
fn resolve(address: &str) -> Result<SocketAddr> {
    address
        .to_socket_addrs()?
        .next()
        .ok_or_else(|| Error::new(ErrorKind::NotFound, "the host has no address"))
}

/// Whether a read has only waited for too long.
fn is_waiting(error: &Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
    )
}

/// Whether a datagram was lost for a temporary reason: nobody listens, or the network is down.
fn is_passing(error: &Error) -> bool {
    is_waiting(error)
        || matches!(
            error.kind(),
            ErrorKind::ConnectionRefused
                | ErrorKind::NetworkUnreachable
                | ErrorKind::HostUnreachable
                | ErrorKind::NetworkDown
        )
}

#[cfg(test)]
mod tests {
    use super::*;
    use ::mavlink::dialects::common::HEARTBEAT_DATA;
    use ::mavlink::{Message, calculate_crc};

    const PATIENCE: Duration = Duration::from_secs(5);

    fn open(address: &Address) -> Link {
        let header = MavHeader {
            system_id: 1,
            component_id: 100,
            sequence: 0,
        };
        Link::open(address, header, &[1, 255], None).unwrap()
    }

    fn heartbeat(system: u8) -> Vec<u8> {
        let header = MavHeader {
            system_id: system.into(),
            component_id: 190,
            sequence: 0,
        };
        let mut raw = MAVLinkV2MessageRaw::new();
        raw.serialize_message(header, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
        raw.raw_bytes().to_vec()
    }

    fn wait_for(link: &Link, count: usize) -> Vec<Peer> {
        let until = Instant::now() + PATIENCE;
        let mut peers = Vec::new();
        while peers.len() < count && Instant::now() < until {
            match link.receive() {
                Some(received) => peers.push(received.peer),
                None => std::thread::sleep(Duration::from_millis(5)),
            }
        }
        peers
    }

    fn trusted(link: &Link) -> usize {
        let peers = link.peers();
        peers.iter().filter(|(_, is_trusted)| *is_trusted).count()
    }

    fn hears(socket: &UdpSocket) -> bool {
        socket
            .set_read_timeout(Some(Duration::from_millis(300)))
            .unwrap();
        socket.recv(&mut [0; 512]).is_ok()
    }

    #[test]
    fn every_allowed_peer_is_served_and_strangers_hear_no_telemetry() {
        let free = UdpSocket::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        let mut link = open(&Address::UdpIn(free.to_string()));
        let sockets = [255, 255, 77].map(|system| {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket.send_to(&heartbeat(system), free).unwrap();
            socket
        });
        assert_eq!(wait_for(&link, 3).len(), 3);

        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        link.send(Audience::Trusted, &message).unwrap();

        let heard = sockets.each_ref().map(hears);
        assert_eq!(heard, [true, true, false]);
        link.send(Audience::All, &message).unwrap();
        assert!(hears(&sockets[2]));
    }

    #[test]
    fn many_strangers_do_not_push_out_the_ground_station() {
        let free = UdpSocket::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        let link = open(&Address::UdpIn(free.to_string()));
        let station = UdpSocket::bind("127.0.0.1:0").unwrap();
        station.send_to(&heartbeat(255), free).unwrap();
        assert_eq!(wait_for(&link, 1).len(), 1);
        for _ in 0..2 * MAX_PEERS {
            let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
            stranger.send_to(&heartbeat(77), free).unwrap();
        }
        wait_for(&link, 2 * MAX_PEERS);

        assert_eq!(trusted(&link), 1);
        assert_eq!(lock(&link.shared.peers).len(), MAX_PEERS);
    }

    #[test]
    fn half_a_message_does_not_swallow_the_next_datagram() {
        let free = UdpSocket::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        let link = open(&Address::UdpIn(free.to_string()));
        let station = UdpSocket::bind("127.0.0.1:0").unwrap();
        let whole = heartbeat(255);

        station.send_to(&whole[..whole.len() / 2], free).unwrap();
        station.send_to(&whole, free).unwrap();

        assert_eq!(wait_for(&link, 1).len(), 1);
    }

    #[test]
    fn connections_come_and_go() {
        let free = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        let inward = open(&Address::TcpIn(free.to_string()));
        let mut outward = open(&Address::TcpOut(free.to_string()));

        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        outward.send(Audience::Trusted, &message).unwrap();
        assert_eq!(wait_for(&inward, 1).len(), 1);
        assert_eq!(trusted(&inward), 1, "system 1 is allowed");
        drop(inward);

        let until = Instant::now() + PATIENCE;
        while !outward.is_broken() && Instant::now() < until {
            std::thread::sleep(Duration::from_millis(20));
        }
        assert!(outward.is_broken());
    }

    #[test]
    fn message_outside_the_dialect_is_passed_over_whole() {
        // ATTITUDE, number 30: zeros, except for a byte that would begin another message.
        let mut attitude = vec![0xfd, 28, 0, 0, 0, 1, 1, 30, 0, 0];
        attitude.extend([0; 28]);
        attitude[20] = 0xfd;
        let crc = calculate_crc(&attitude[1..], MavMessage::extra_crc(30));
        attitude.extend(crc.to_le_bytes());
        let telemetry = [attitude, heartbeat(1)].concat();
        let mut reader = MavlinkReader::new(telemetry.as_slice());

        let numbers = [(); 2].map(|()| {
            let message = reader.read_any_raw_message::<MavMessage>();
            message.unwrap().message_id()
        });

        assert_eq!(MavMessage::extra_crc(30), 39);
        assert_eq!(numbers, [30, 0]);
    }
}
