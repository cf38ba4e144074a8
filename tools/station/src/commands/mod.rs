//! Commands from other programs, such as a detector that names a target: JSON lines over UDP,
//! a Unix socket or standard input, answered by JSON lines.
//!
//! | line | answer |
//! |---|---|
//! | `{"command": "start", "box": [left, top, width, height]}` in pixels, `"rectangle": [left, top, right, bottom]` or `"point": [x, y]` in shares of the frame (0 to 1); `"frame"` may number the frame in which they were seen | `{"done": true}` once the target is followed |
//! | `{"command": "stop"}` | `{"done": true}` once nothing is followed |
//! | either with `"target"`, the number of a target | the start replaces that target; the stop leaves the others |
//! | `{"command": "state"}` | `{"done": true, "report": {...}}`, the newest report |
//!
//! An answer repeats the line's `"id"`, if it has one. Where several targets can be followed, a
//! start that names none takes the lowest free number, and its answer tells the `"target"`. A
//! command that is not carried out is answered by `{"done": false, "error": "..."}`.
//!
//! | file | what happens there |
//! |---|---|
//! | `mod.rs` | where commands come from |
//! | `requests.rs` | requests and their answers |
//! | `line.rs` | splitting a stream into lines of bounded length |

mod line;
mod requests;

use std::io::{ErrorKind, Read};
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

use crate::error::Error;
use crate::hub::Hub;
use crate::say::say;
use line::{Line, LineSplitter};
pub use requests::Request;
use requests::Requests;

/// Longest line in bytes.
const MAX_LINE: usize = 4096;
/// Lines of standard input that may wait.
const MAX_WAITING: usize = 32;
/// How long a read waits if every request is answered.
const IDLE: Duration = Duration::from_millis(100);
/// How long a read waits if an answer may become ready meanwhile.
const BUSY: Duration = Duration::from_millis(5);

/// Where commands come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// Datagrams to an address of this machine's own.
    Udp(String),
    /// Connections to a socket of this path, which belongs to the user who runs the program.
    Unix(PathBuf),
    /// Standard input, answered on standard output.
    Stdin,
}

impl FromStr for Place {
    type Err = String;

    /// Reads `udp:PORT`, `udp:HOST:PORT`, `unix:PATH` or `-`.
    fn from_str(text: &str) -> Result<Place, String> {
        let wrong = || "expected udp:PORT, udp:HOST:PORT, unix:PATH or -".to_string();
        match text.split_once(':') {
            None if text == "-" => Ok(Place::Stdin),
            Some(("udp", address)) => {
                let port = address.rsplit(':').next().unwrap_or_default();
                match port.parse::<u16>() {
                    Ok(port) if port.to_string() == address => {
                        Ok(Place::Udp(format!("127.0.0.1:{port}")))
                    }
                    Ok(_) => Ok(Place::Udp(address.into())),
                    Err(_) => Err(wrong()),
                }
            }
            Some(("unix", path)) if !path.is_empty() => Ok(Place::Unix(path.into())),
            _ => Err(wrong()),
        }
    }
}

impl std::fmt::Display for Place {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Place::Udp(address) => write!(f, "udp:{address}"),
            Place::Unix(path) => write!(f, "unix:{}", path.display()),
            Place::Stdin => f.write_str("-"),
        }
    }
}

/// Starts to listen at these places; answers to standard input go to `print`.
///
/// # Errors
/// If a place cannot be listened at, or is open to other machines.
pub fn start(
    places: &[Place],
    hub: &Arc<Hub>,
    print: Option<SyncSender<String>>,
) -> Result<Vec<JoinHandle<()>>, Error> {
    let mut threads = Vec::new();
    for place in places {
        let hub = Arc::clone(hub);
        let wrong = |reason: String| Error::output(format!("--commands {place}"), reason);
        threads.push(match place {
            Place::Udp(address) => {
                let socket = bind(address).map_err(wrong)?;
                std::thread::spawn(move || serve_datagrams(&hub, &socket))
            }
            #[cfg(unix)]
            Place::Unix(path) => unix::start(path, hub).map_err(wrong)?,
            #[cfg(not(unix))]
            Place::Unix(_) => return Err(wrong("needs a Unix system".into())),
            Place::Stdin => {
                let print = print.clone();
                std::thread::spawn(move || serve_input(&hub, print.as_ref()))
            }
        });
        say!("commands: {place}");
    }
    Ok(threads)
}

/// A socket that only this machine can reach, since a datagram carries no token.
fn bind(address: &str) -> Result<UdpSocket, String> {
    let found: Vec<SocketAddr> = address
        .to_socket_addrs()
        .map_err(|error| error.to_string())?
        .collect();
    if !found.iter().all(|address| address.ip().is_loopback()) {
        return Err("is open to other machines, expected an address such as 127.0.0.1".into());
    }
    UdpSocket::bind(&found[..]).map_err(|error| error.to_string())
}

/// How long the next read may wait.
fn patience<P>(requests: &Requests<P>) -> Duration {
    if requests.is_waiting() { BUSY } else { IDLE }
}

fn serve_datagrams(hub: &Hub, socket: &UdpSocket) {
    let mut requests = Requests::default();
    let mut datagram = [0; MAX_LINE + 1];
    while !hub.is_stopping() {
        let _ = socket.set_read_timeout(Some(patience(&requests)));
        match socket.recv_from(&mut datagram) {
            Ok((count, from)) if count > MAX_LINE => {
                let _ = socket.send_to(requests::too_long().as_bytes(), from);
            }
            Ok((count, from)) => requests.take(hub, &datagram[..count], from),
            Err(error) => {
                // Other than a time-out, this may report an earlier answer that nobody received.
                if !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) {
                    std::thread::sleep(BUSY);
                }
            }
        }
        for (to, answer) in requests.answers(hub) {
            let _ = socket.send_to(answer.as_bytes(), to); // the peer may have gone
        }
    }
}

fn serve_input(hub: &Hub, print: Option<&SyncSender<String>>) {
    let lines = read_input();
    let mut requests = Requests::default();
    while !hub.is_stopping() {
        match lines.recv_timeout(patience(&requests)) {
            Ok(Line::Whole(line)) => requests.take(hub, &line, ()),
            Ok(Line::TooLong) => print_answer(print, requests::too_long()),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) if requests.is_waiting() => {
                std::thread::sleep(BUSY)
            }
            // The program continues: a detector may end once the target is followed.
            Err(RecvTimeoutError::Disconnected) => return,
        }
        for ((), answer) in requests.answers(hub) {
            print_answer(print, answer);
        }
    }
}

fn print_answer(print: Option<&SyncSender<String>>, answer: String) {
    if let Some(print) = print {
        let _ = print.try_send(answer); // a reader that does not read must not delay this thread
    }
}

/// Reads standard input on a thread that ends with the process, since such a read never times out.
fn read_input() -> Receiver<Line> {
    let (queue, received) = sync_channel(MAX_WAITING);
    std::thread::spawn(move || {
        let mut input = std::io::stdin().lock();
        let mut lines = LineSplitter::default();
        let mut chunk = [0; 1024];
        loop {
            let count = match input.read(&mut chunk) {
                Ok(count) => count,
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(_) => 0,
            };
            let found = if count == 0 {
                lines.rest().into_iter().collect()
            } else {
                lines.add(&chunk[..count])
            };
            for line in found {
                if queue.send(line).is_err() {
                    return;
                }
            }
            if count == 0 {
                return;
            }
        }
    });
    received
}

#[cfg(unix)]
mod unix {
    //! Connections to a Unix socket, each on a thread of its own.

    use std::fs::Permissions;
    use std::io::{ErrorKind, Read, Write};
    use std::os::unix::fs::{FileTypeExt, PermissionsExt};
    use std::os::unix::net::{UnixListener, UnixStream};
    use std::path::Path;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::thread::JoinHandle;
    use std::time::Duration;

    use super::line::{Line, LineSplitter};
    use super::requests::{self, Requests};
    use super::{BUSY, patience};
    use crate::hub::Hub;

    /// Most connections at a time.
    const MAX_CONNECTIONS: usize = 16;
    /// How long a peer may take to receive an answer.
    const WRITE: Duration = Duration::from_millis(500);
    /// How often the listening thread looks whether it is to end.
    const TICK: Duration = Duration::from_millis(20);

    /// Listens at a path; a socket that an earlier run has left there is replaced.
    pub fn start(path: &Path, hub: Arc<Hub>) -> Result<JoinHandle<()>, String> {
        let listener = listen(path)?;
        let path = path.to_path_buf();
        Ok(std::thread::spawn(move || {
            let count = Arc::new(AtomicUsize::new(0));
            while !hub.is_stopping() {
                match listener.accept() {
                    Ok((stream, _)) if count.load(Ordering::Relaxed) < MAX_CONNECTIONS => {
                        welcome(stream, Arc::clone(&hub), Arc::clone(&count));
                    }
                    Ok(_) => {} // one too many is closed
                    Err(_) => std::thread::sleep(TICK),
                }
            }
            let _ = std::fs::remove_file(path);
        }))
    }

    fn listen(path: &Path) -> Result<UnixListener, String> {
        if let Ok(found) = std::fs::symlink_metadata(path) {
            if !found.file_type().is_socket() {
                return Err("is a file, expected a free path".into());
            }
            if UnixStream::connect(path).is_ok() {
                return Err("another program listens there".into());
            }
            std::fs::remove_file(path).map_err(|error| error.to_string())?;
        }
        let bind = || {
            let listener = UnixListener::bind(path)?;
            std::fs::set_permissions(path, Permissions::from_mode(0o600))?;
            listener.set_nonblocking(true)?; // so that the thread sees when the program ends
            Ok(listener)
        };
        bind().map_err(|error: std::io::Error| error.to_string())
    }

    fn welcome(mut stream: UnixStream, hub: Arc<Hub>, count: Arc<AtomicUsize>) {
        count.fetch_add(1, Ordering::Relaxed);
        let served = Arc::clone(&count);
        let spawned = std::thread::Builder::new().spawn(move || {
            let _ = serve(&mut stream, &hub); // the peer may have gone
            served.fetch_sub(1, Ordering::Relaxed);
        });
        if spawned.is_err() {
            count.fetch_sub(1, Ordering::Relaxed);
        }
    }

    fn serve(stream: &mut UnixStream, hub: &Hub) -> std::io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_write_timeout(Some(WRITE))?;
        let mut requests = Requests::default();
        let mut lines = LineSplitter::default();
        let mut chunk = [0; 1024];
        let mut is_open = true;
        while !hub.is_stopping() && (is_open || requests.is_waiting()) {
            if is_open {
                stream.set_read_timeout(Some(patience(&requests)))?;
                let found = match stream.read(&mut chunk) {
                    Ok(0) => {
                        is_open = false; // its answers may still be read
                        lines.rest().into_iter().collect()
                    }
                    Ok(count) => lines.add(&chunk[..count]),
                    Err(error) => match error.kind() {
                        ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {
                            Vec::new()
                        }
                        _ => return Err(error),
                    },
                };
                for line in found {
                    match line {
                        Line::Whole(line) => requests.take(hub, &line, ()),
                        Line::TooLong => writeln!(stream, "{}", requests::too_long())?,
                    }
                }
            } else {
                std::thread::sleep(BUSY);
            }
            for ((), answer) in requests.answers(hub) {
                writeln!(stream, "{answer}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn place_in_every_form_is_read() {
        for (text, expected) in [
            ("udp:9000", Place::Udp("127.0.0.1:9000".into())),
            ("udp:localhost:9000", Place::Udp("localhost:9000".into())),
            ("udp:[::1]:9000", Place::Udp("[::1]:9000".into())),
            ("unix:/run/a:b", Place::Unix("/run/a:b".into())),
            ("-", Place::Stdin),
        ] {
            assert_eq!(text.parse(), Ok(expected), "{text}");
        }
        for text in [
            "", "udp", "udp:", "udp:host", "udp:1:x", "unix:", "tcp:1", "9000",
        ] {
            assert!(text.parse::<Place>().is_err(), "{text}");
        }
    }

    #[test]
    fn address_open_to_other_machines_is_refused() {
        let hub = Arc::new(Hub::new(Default::default()));
        let places = ["udp:0.0.0.0:9000".parse().unwrap()];

        let refused = start(&places, &hub, None).unwrap_err().to_string();

        let expected = "--commands udp:0.0.0.0:9000: is open to other machines";
        assert!(refused.starts_with(expected), "{refused}");
    }
}
