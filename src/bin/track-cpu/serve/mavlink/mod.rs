//! The link to autopilot and ground station: this process as a MAVLink camera that tracks.
//!
//! | file | what happens there |
//! |---|---|
//! | `mod.rs` | options, the connection and its two threads |
//! | `camera.rs` | the camera protocol: what is answered, what is told |
//! | `pointing.rs` | gimbal rates and the landing target |
//! | `unknown.rs` | commands that the dialect has no name for |
//!
//! Nothing that arrives here reaches the tracker but sound commands from allowed system ids.

mod camera;
mod pointing;
mod unknown;

use std::io::ErrorKind;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::MavMessage;
use ::mavlink::error::MessageReadError;
use ::mavlink::{MavConnection, MavHeader, Message, SigningConfig, SigningData};

use super::hub::Hub;
use crate::exit::Failure;
use camera::Camera;
use pointing::Pointing;
use unknown::Unknown;

/// Options of the MAVLink camera.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "MAVLink")]
pub struct MavlinkArgs {
    /// Connect as a MAVLink camera: udpout:HOST:PORT, udpin:HOST:PORT, tcpout:HOST:PORT, serial:/dev/ttyX:BAUD.
    #[arg(long, value_name = "ADDR")]
    pub mavlink: Option<String>,
    /// System id: the vehicle's.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..))]
    pub mav_system: u8,
    /// Component id: cameras have 100 to 105.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u8).range(7..))]
    pub mav_component: u8,
    /// System ids whose commands are taken, besides our own.
    #[arg(long, value_name = "N,N", value_delimiter = ',', default_value = "255")]
    pub mav_allow: Vec<u8>,
    /// File with the signing key, 32 bytes or 64 hexadecimal digits; unsigned messages are then refused.
    #[arg(long, value_name = "FILE", requires = "mavlink")]
    pub mav_key: Option<PathBuf>,
    /// Where ground stations get the video, told to them as it is (rtsp://...).
    #[arg(long, value_name = "URI", value_parser = uri)]
    pub video_uri: Option<String>,
    /// Keep the target in the middle with gimbal rates.
    #[arg(long, requires_all = ["mavlink", "hfov"])]
    pub gimbal: bool,
    /// Send LANDING_TARGET with the angles to the target.
    #[arg(long, requires_all = ["mavlink", "hfov"])]
    pub landing_target: bool,
    /// Horizontal field of view of the camera, in degrees.
    #[arg(long, value_name = "DEG", value_parser = field_of_view)]
    pub hfov: Option<f64>,
}

fn uri(text: &str) -> Result<String, String> {
    if text.len() <= 159 {
        Ok(text.into())
    } else {
        Err("expected at most 159 bytes".into())
    }
}

fn field_of_view(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|d| (1.0..=170.0).contains(d))
        .ok_or("expected degrees from 1 to 170".into())
}

type Connection = Box<dyn MavConnection<MavMessage> + Send + Sync>;

/// Wait before a link that failed is opened again.
const RETRY: Duration = Duration::from_secs(1);
/// How often the sending thread looks what is due.
const TICK: Duration = Duration::from_millis(10);

/// Starts the link's thread, if one is asked for.
///
/// # Errors
/// If the key cannot be read or the address is none.
pub fn start(args: &MavlinkArgs, hub: &Arc<Hub>) -> Result<Vec<JoinHandle<()>>, Failure> {
    let Some(address) = args.mavlink.clone() else {
        return Ok(Vec::new());
    };
    let key = args.mav_key.as_ref().map(read_key).transpose()?;
    let wrong = |error: std::io::Error| Failure::Output {
        output: format!("--mavlink {address}"),
        reason: error.to_string(),
    };
    // A wrong address is told at once; a link that breaks later is opened again.
    let first = match connect(&address, key) {
        Ok(connection) => Some(connection),
        Err(error)
            if matches!(
                error.kind(),
                ErrorKind::InvalidInput | ErrorKind::AddrNotAvailable
            ) =>
        {
            return Err(wrong(error));
        }
        Err(error) => {
            eprintln!("mavlink: {address}: {error}; trying again");
            None
        }
    };
    let (args, hub) = (args.clone(), Arc::clone(hub));
    let thread = std::thread::spawn(move || {
        let camera = Arc::new(Mutex::new(Camera::new(&args, Arc::clone(&hub))));
        let mut connection = first;
        while !hub.is_stopping() {
            match connection.take() {
                Some(connection) => serve(&args, &hub, &camera, connection.into(), key),
                None => std::thread::sleep(RETRY),
            }
            if !hub.is_stopping() {
                connection = connect(&address, key).ok();
            }
        }
    });
    Ok(vec![thread])
}

fn connect(address: &str, key: Option<[u8; 32]>) -> std::io::Result<Connection> {
    let mut connection = ::mavlink::connect::<MavMessage>(address)?;
    if let Some(key) = key {
        connection.setup_signing(Some(SigningConfig::new(key, 0, true, false)));
    }
    Ok(Box::new(connection))
}

/// Sends and answers until the link breaks or the program ends.
fn serve(
    args: &MavlinkArgs,
    hub: &Arc<Hub>,
    camera: &Arc<Mutex<Camera>>,
    connection: Arc<Connection>,
    key: Option<[u8; 32]>,
) {
    let header = MavHeader {
        system_id: args.mav_system.into(),
        component_id: args.mav_component,
        sequence: 0,
    };
    let broken = Arc::new(AtomicBool::new(false));
    {
        // Not joined: it may wait for a byte for ever, and ends with the process.
        let (camera, connection, broken) = (
            Arc::clone(camera),
            Arc::clone(&connection),
            Arc::clone(&broken),
        );
        let hub = Arc::clone(hub);
        // A stream of signatures of its own, beside the connection's.
        let signing =
            key.map(|key| SigningData::from_config(SigningConfig::new(key, 1, true, false)));
        std::thread::spawn(move || {
            while !hub.is_stopping() && !broken.load(Ordering::Relaxed) {
                let raw = match connection.recv_raw() {
                    Ok(received) => received,
                    Err(MessageReadError::Io(error)) => {
                        match error.kind() {
                            // A datagram that nobody took, or one too short.
                            ErrorKind::ConnectionRefused
                            | ErrorKind::WouldBlock
                            | ErrorKind::TimedOut => {
                                std::thread::sleep(TICK);
                            }
                            _ => broken.store(true, Ordering::Relaxed),
                        }
                        continue;
                    }
                    Err(_) => continue, // no message that we know
                };
                let mut camera = camera.lock().unwrap_or_else(PoisonError::into_inner);
                let Ok(message) = MavMessage::parse(raw.version(), raw.message_id(), raw.payload())
                else {
                    let unknown = Unknown::of(&raw)
                        .filter(|unknown| camera.refuses(raw.system_id(), unknown));
                    if let Some(unknown) = unknown {
                        let _ = connection.send_raw(&unknown.refusal(header, signing.as_ref()));
                    }
                    continue;
                };
                for answer in &camera.answer(raw.system_id(), &message) {
                    let _ = connection.send(&header, answer);
                }
            }
        });
    }
    let mut pointing = Pointing::new(args);
    let mut heartbeat = Instant::now();
    let mut seen = 0;
    while !hub.is_stopping() && !broken.load(Ordering::Relaxed) {
        let (number, report) = hub.report_after(seen, TICK);
        let fresh = number != seen;
        seen = number;
        let now = Instant::now();
        let mut due = Vec::new();
        if now >= heartbeat {
            due.push(camera::heartbeat());
            heartbeat = now + Duration::from_secs(1);
        }
        due.extend(
            camera
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .due(now, &report),
        );
        due.extend(pointing.due(now, &report, fresh));
        for message in &due {
            if let Err(::mavlink::error::MessageWriteError::Io(error)) =
                connection.send(&header, message)
                && !matches!(
                    error.kind(),
                    ErrorKind::ConnectionRefused | ErrorKind::WouldBlock
                )
                && !error.to_string().contains("unreachable")
            {
                eprintln!("mavlink: {error}; opening the link again");
                broken.store(true, Ordering::Relaxed);
                break;
            }
        }
    }
    if let Some(message) = pointing.farewell() {
        let _ = connection.send(&header, &message);
    }
}

/// 32 bytes, or 64 hexadecimal digits.
fn read_key(path: &PathBuf) -> Result<[u8; 32], Failure> {
    let log = || path.display().to_string();
    let bytes = std::fs::read(path).map_err(|error| Failure::Log {
        log: log(),
        reason: error.to_string(),
    })?;
    parse_key(&bytes).ok_or_else(|| {
        let reason = format!(
            "holds {} bytes, expected a key of 32 bytes or 64 hexadecimal digits",
            bytes.len()
        );
        Failure::Log { log: log(), reason }
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
    let digits: Option<Vec<u8>> = (0..32)
        .map(|i| u8::from_str_radix(&text[2 * i..2 * i + 2], 16).ok())
        .collect();
    digits?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys() {
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
}
