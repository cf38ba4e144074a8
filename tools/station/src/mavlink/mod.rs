//! The links to autopilot and ground stations: this process as a MAVLink camera that tracks.
//!
//! | file | what happens there |
//! |---|---|
//! | `mod.rs` | options, and the thread of each link |
//! | `address.rs`, `link.rs` | where links lead; their peers, and messages to and from them |
//! | `camera.rs` | the camera protocol: answers and the tracking status |
//! | `clients.rs` | who wants the tracking status how often |
//! | `pointing.rs` | gimbal rates and the landing target |
//! | `stream.rs` | the encoding of the video, which the dialect's message lacks |
//! | `unknown.rs` | commands that the dialect has no name for |
//!
//! **Invariant:** only valid commands from allowed systems reach the tracker.

mod address;
mod camera;
mod clients;
mod link;
mod pointing;
mod stream;
mod unknown;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::MavMessage;
pub use ::mavlink::dialects::common::VideoStreamEncoding;
use ::mavlink::{MavHeader, Message};

use crate::error::{Error, read_secret};
use crate::hub::Hub;
use crate::say::say;
use address::Address;
use camera::{Camera, Outgoing};
use link::{Audience, Link, Received};
use pointing::Pointing;
use unknown::Unknown;

/// Options of the MAVLink camera.
#[derive(Clone, Debug)]
pub struct MavlinkOptions {
    /// Links, such as `udpout:HOST:PORT`; the first one leads to the vehicle, and gets gimbal rates
    /// and landing targets.
    pub links: Vec<String>,
    /// System id, which is the vehicle's.
    pub system: u8,
    /// Component id.
    pub component: u8,
    /// System ids that may control the camera, in addition to its own.
    pub allow: Vec<u8>,
    /// File with the signing key.
    pub key: Option<PathBuf>,
    /// Where ground stations get the video.
    pub video_uri: Option<String>,
    /// Frames per second of the video; `None` for those of the source.
    pub video_rate: Option<f32>,
    /// How the video is encoded.
    pub video_encoding: VideoStreamEncoding,
    /// Whether gimbal rates keep the target in the middle.
    pub gimbal: bool,
    /// Whether LANDING_TARGET is sent with the angles to the target.
    pub landing_target: bool,
    /// Horizontal field of view of the camera in degrees.
    pub hfov: Option<f64>,
}

impl Default for MavlinkOptions {
    fn default() -> MavlinkOptions {
        MavlinkOptions {
            links: Vec::new(),
            system: 1,
            component: 100,
            allow: vec![255],
            key: None,
            video_uri: None,
            video_rate: None,
            video_encoding: VideoStreamEncoding::VIDEO_STREAM_ENCODING_UNKNOWN,
            gimbal: false,
            landing_target: false,
            hfov: None,
        }
    }
}

impl MavlinkOptions {
    /// The system ids that may control the camera, its own included.
    fn allowed_systems(&self) -> Vec<u32> {
        let mut systems: Vec<u32> = self.allow.iter().copied().map(u32::from).collect();
        systems.push(self.system.into());
        systems
    }

    fn header(&self) -> MavHeader {
        MavHeader {
            system_id: self.system.into(),
            component_id: self.component,
            sequence: 0,
        }
    }
}

/// Wait before a link that failed is opened again.
const RETRY: Duration = Duration::from_secs(1);
/// How often a link's thread checks what is due.
const TICK: Duration = Duration::from_millis(10);
/// Time between two heartbeats.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Most messages that are handled before what is due is sent.
const MAX_AT_ONCE: usize = 64;

/// Starts the thread of each link; a link is opened by its own thread.
///
/// # Errors
/// If the key cannot be read or an address is malformed.
pub fn start(options: &MavlinkOptions, hub: &Arc<Hub>) -> Result<Vec<JoinHandle<()>>, Error> {
    if options.links.is_empty() {
        return Ok(Vec::new());
    }
    let key = options.key.as_deref().map(read_key).transpose()?;
    let mut addresses = Vec::new();
    for link in &options.links {
        let address = Address::parse(link);
        addresses.push(address.map_err(|reason| Error::output("--mavlink", reason))?);
    }
    let mut threads = Vec::new();
    for (index, address) in addresses.into_iter().enumerate() {
        let mut options = options.clone();
        // Two controllers would fight over the gimbal.
        options.gimbal &= index == 0;
        options.landing_target &= index == 0;
        let hub = Arc::clone(hub);
        threads.push(std::thread::spawn(move || {
            keep_open(&address, &options, &hub, key);
        }));
    }
    Ok(threads)
}

/// Serves a link and opens it again when it breaks, until the program ends.
fn keep_open(address: &Address, options: &MavlinkOptions, hub: &Arc<Hub>, key: Option<[u8; 32]>) {
    let mut is_told = false; // a link that stays down is reported once
    while !hub.is_stopping() {
        match Link::open(address, options.header(), &options.allowed_systems(), key) {
            Ok(mut link) => {
                is_told = false;
                link.set_encoding(options.video_encoding);
                if let Err(error) = serve(link, options, hub) {
                    say!("mavlink: {address}: {error}; opening it again");
                }
            }
            Err(error) if !is_told => {
                is_told = true;
                say!("mavlink: {address}: {error}; trying again");
            }
            Err(_) => {}
        }
        let until = Instant::now() + RETRY;
        while Instant::now() < until && !hub.is_stopping() {
            std::thread::sleep(5 * TICK);
        }
    }
}

/// Answers and sends until the link breaks or the program ends.
fn serve(mut link: Link, options: &MavlinkOptions, hub: &Arc<Hub>) -> std::io::Result<()> {
    let mut camera = Camera::new(options, Arc::clone(hub));
    let mut pointing = Pointing::new(options);
    let mut heartbeat = Instant::now();
    let mut seen = 0;
    while !hub.is_stopping() {
        if link.is_broken() {
            return Err(std::io::ErrorKind::ConnectionReset.into());
        }
        let view = hub.view_after(seen, TICK);
        let is_new = view.number != seen;
        seen = view.number;
        for _ in 0..MAX_AT_ONCE {
            let Some(received) = link.receive() else {
                break;
            };
            hear(&received, &mut link, &mut camera, &mut pointing)?;
        }
        let now = Instant::now();
        let mut due: Vec<Outgoing> = Vec::new();
        if now >= heartbeat {
            heartbeat = now + HEARTBEAT;
            due.push((Audience::All, camera::heartbeat(view.health)));
        }
        due.extend(camera.due(now, &view, &link.peers()));
        for message in pointing.due(now, &view, is_new) {
            due.push((Audience::Trusted, message));
        }
        for (audience, message) in &due {
            link.send(*audience, message)?;
        }
    }
    for message in &pointing.release() {
        link.send(Audience::Trusted, message)?;
    }
    Ok(())
}

/// Handles one message.
fn hear(
    received: &Received,
    link: &mut Link,
    camera: &mut Camera,
    pointing: &mut Pointing,
) -> std::io::Result<()> {
    let raw = &received.message;
    let parsed = MavMessage::parse(raw.version(), raw.message_id(), raw.payload());
    let Ok(message) = parsed else {
        if let Some(unknown) = Unknown::of(raw).filter(|unknown| camera.refuses(unknown)) {
            let refusal = unknown.refusal(link.header(), link.signing());
            link.send_raw(Audience::One(received.peer), &refusal)?;
        }
        return Ok(());
    };
    pointing.hear(raw.system_id(), &message);
    for (audience, answer) in &camera.answer(received.peer, raw.system_id(), &message) {
        link.send(*audience, answer)?;
    }
    Ok(())
}

/// Reads a key: 32 bytes, or 64 hexadecimal digits.
fn read_key(path: &Path) -> Result<[u8; 32], Error> {
    let bytes = read_secret(path)?;
    parse_key(&bytes).ok_or_else(|| {
        let reason = format!(
            "holds {} bytes, expected a key of 32 bytes or 64 hexadecimal digits",
            bytes.len()
        );
        Error::file(path, reason)
    })
}

fn parse_key(bytes: &[u8]) -> Option<[u8; 32]> {
    if let Ok(key) = bytes.try_into() {
        return Some(key);
    }
    let text = std::str::from_utf8(bytes).ok()?.trim();
    if text.len() != 64 || !text.is_ascii() {
        return None;
    }
    let mut key = [0; 32];
    for (i, byte) in key.iter_mut().enumerate() {
        *byte = u8::from_str_radix(&text[2 * i..2 * i + 2], 16).ok()?;
    }
    Some(key)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn key_is_32_bytes_or_64_digits() {
        assert_eq!(parse_key(&[7; 32]), Some([7; 32]));
        assert_eq!(parse_key("0a".repeat(32).as_bytes()), Some([10; 32]));
        assert_eq!(
            parse_key(format!("{}\n", "ff".repeat(32)).as_bytes()),
            Some([255; 32])
        );
        for bad in [&b""[..], b"short", "zz".repeat(32).as_bytes(), &[0; 33]] {
            assert_eq!(parse_key(bad), None);
        }
    }

    #[test]
    fn wrong_address_is_refused_before_anything_starts() {
        let hub = Arc::new(Hub::new(Default::default()));
        let options = MavlinkOptions {
            links: vec!["udpout:127.0.0.1:14550".into(), "nonsense".into()],
            ..MavlinkOptions::default()
        };

        let refused = start(&options, &hub).unwrap_err().to_string();

        assert!(refused.starts_with("--mavlink: \"nonsense\""), "{refused}");
    }
}
