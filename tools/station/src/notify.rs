//! Signs of life for systemd, after sd_notify(3).
//!
//! `READY=1` is sent with the first frame. Until then the start-up time is extended, and `STATUS`
//! says what the program waits for. `WATCHDOG=1` is sent by the tracking thread every second,
//! unless the source is stalled: systemd then restarts the program.

#[cfg(unix)]
use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

use crate::health::Health;

/// Time between two signs of life.
const PERIOD: Duration = Duration::from_secs(1);
/// Asks for ten more seconds of start-up time, in microseconds.
const EXTEND: &str = "EXTEND_TIMEOUT_USEC=10000000";

/// The socket to systemd, if there is one.
pub struct Notifier {
    #[cfg(unix)]
    socket: Option<UnixDatagram>,
    next: Instant,
    is_ready: bool,
    status: String,
}

impl Notifier {
    /// Connects to the socket that systemd names in `NOTIFY_SOCKET`.
    pub fn connect() -> Notifier {
        Notifier {
            #[cfg(unix)]
            socket: std::env::var_os("NOTIFY_SOCKET").and_then(|path| connect(&path)),
            next: Instant::now(),
            is_ready: false,
            status: String::new(),
        }
    }

    /// Sends what is due: readiness, a changed status, and the sign of life.
    pub fn tell(&mut self, health: Health, reason: Option<&str>) {
        if health.delivers() && !self.is_ready {
            self.is_ready = true;
            self.say("READY=1");
        }
        let status = match reason {
            Some(reason) if !health.delivers() => {
                format!("STATUS=source {}: {reason}", health.name())
            }
            _ => format!("STATUS=source {}", health.name()),
        };
        if status != self.status {
            self.say(&status);
            self.status = status;
        }
        let now = Instant::now();
        if now < self.next {
            return;
        }
        self.next = now + PERIOD;
        if health != Health::Stalled {
            self.say("WATCHDOG=1");
            if !self.is_ready {
                self.say(EXTEND);
            }
        }
    }

    /// Says that the program is about to end.
    pub fn stopping(&self) {
        self.say("STOPPING=1");
    }

    /// Sends one message, or nothing without a socket.
    fn say(&self, text: &str) {
        #[cfg(unix)]
        if let Some(socket) = &self.socket {
            let _ = socket.send(text.as_bytes()); // a full queue must not stop the tracker
        }
        #[cfg(not(unix))]
        let _ = text;
    }
}

#[cfg(unix)]
fn connect(path: &std::ffi::OsStr) -> Option<UnixDatagram> {
    let socket = UnixDatagram::unbound().ok()?;
    socket.set_nonblocking(true).ok()?;
    socket.connect(path).ok()?;
    Some(socket)
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn heard(systemd: &UnixDatagram) -> Vec<String> {
        let mut heard = Vec::new();
        let mut buffer = [0; 256];
        while let Ok(count) = systemd.recv(&mut buffer) {
            heard.push(String::from_utf8_lossy(&buffer[..count]).into_owned());
        }
        heard
    }

    #[test]
    fn ready_comes_with_the_first_frame_and_a_stall_is_not_covered_up() {
        let path = std::env::temp_dir().join(format!("station-notify-{}", std::process::id()));
        let systemd = UnixDatagram::bind(&path).unwrap();
        systemd.set_nonblocking(true).unwrap();
        let mut notifier = Notifier {
            socket: connect(path.as_os_str()),
            next: Instant::now(),
            is_ready: false,
            status: String::new(),
        };

        notifier.tell(Health::Waiting, Some("no such device"));
        let waiting = heard(&systemd);
        notifier.tell(Health::Live, None);
        let live = heard(&systemd);
        notifier.next = Instant::now();
        notifier.tell(Health::Stalled, None);
        let stalled = heard(&systemd);
        notifier.stopping();
        let stopping = heard(&systemd);

        let status = "STATUS=source waiting: no such device";
        assert_eq!(waiting, [status, "WATCHDOG=1", EXTEND]);
        assert_eq!(live, ["READY=1", "STATUS=source live"]);
        assert_eq!(stalled, ["STATUS=source stalled"]);
        assert_eq!(stopping, ["STOPPING=1"]);
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn missing_socket_is_no_failure() {
        assert!(connect(std::ffi::OsStr::new("/no/such/socket")).is_none());
    }
}
