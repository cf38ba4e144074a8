//! What autopilots and ground stations send: datagrams as they are, or messages that are packed and
//! given a checksum here.
//!
//! An input that starts with `m` is a list of messages: number (three bytes), system, component,
//! length, payload.
#![no_main]

mod live;

use std::net::UdpSocket;
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::MavMessage;
use ::mavlink::{Message, calculate_crc};
use libfuzzer_sys::fuzz_target;
use station::mavlink::{MavlinkOptions, start};

/// How long an answer may take.
const PATIENCE: Duration = Duration::from_millis(50);

static LINK: LazyLock<UdpSocket> = LazyLock::new(|| {
    let free = || UdpSocket::bind("127.0.0.1:0").and_then(|free| free.local_addr());
    let ours = UdpSocket::bind("127.0.0.1:0").expect("a free port");
    let theirs = free().expect("a free port");
    let options = MavlinkOptions {
        links: vec![format!("udpin:{theirs}")],
        video_uri: Some("rtsp://here/".into()),
        gimbal: true,
        landing_target: true,
        hfov: Some(70.0),
        ..MavlinkOptions::default()
    };
    assert!(start(&options, &live::hub()).is_ok(), "the link opens");
    ours.connect(theirs).expect("a local address");
    ours.set_read_timeout(Some(PATIENCE)).expect("a time-out");
    ours
});

fn packet(id: [u8; 3], system: u8, component: u8, payload: &[u8]) -> Vec<u8> {
    let mut packet = vec![0xfd, payload.len() as u8, 0, 0, 0, system, component];
    packet.extend(id);
    packet.extend(payload);
    let extra = MavMessage::extra_crc(u32::from_le_bytes([id[0], id[1], id[2], 0]));
    packet.extend(calculate_crc(&packet[1..], extra).to_le_bytes());
    packet
}

/// Asks for something that is answered at once, and waits for the answer: then everything sent
/// before it was read.
///
/// More than once, since the link's thread may still open its socket, or be flooded.
fn wait_until_read() {
    // COMMAND_LONG: 512 (request a message) of 260 (camera settings) from system 1, component 100.
    let mut payload = [0; 33];
    payload[..4].copy_from_slice(&260f32.to_le_bytes());
    payload[28..32].copy_from_slice(&[0, 2, 1, 100]);
    let ask = packet([76, 0, 0], 255, 190, &payload);
    let mut answer = [0; 512];
    for _ in 0..100 {
        let _ = LINK.send(&ask); // refused while nobody listens yet
        let asked = Instant::now();
        while asked.elapsed() < PATIENCE {
            match LINK.recv(&mut answer) {
                Ok(count) if count > 10 && answer[7..10] == [77, 0, 0] => return,
                _ => {}
            }
        }
    }
    panic!("no answer to a hundred questions");
}

fuzz_target!(|bytes: &[u8]| {
    match bytes.strip_prefix(b"m") {
        None => drop(LINK.send(&bytes[..bytes.len().min(2000)])),
        Some(mut rest) => {
            while let [a, b, c, system, component, length, tail @ ..] = rest {
                let (payload, after) = tail.split_at(tail.len().min(usize::from(*length)));
                let _ = LINK.send(&packet([*a, *b, *c], *system, *component, payload));
                rest = after;
            }
        }
    }
    wait_until_read();
});
