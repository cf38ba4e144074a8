//! Signs of life for systemd: `READY=1` once, `WATCHDOG=1` every second from the tracking thread itself, so that a tracker
//! that hangs is started again. Protocol: sd_notify(3).

#[cfg(unix)]
use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

const PERIOD: Duration = Duration::from_secs(1);

/// The socket to systemd, where there is one.
pub struct Watchdog {
    #[cfg(unix)]
    socket: Option<UnixDatagram>,
    next: Instant,
}

impl Watchdog {
    /// Connects to the socket that systemd names in `NOTIFY_SOCKET` and says that the program is ready.
    pub fn start() -> Watchdog {
        let watchdog = Watchdog {
            #[cfg(unix)]
            socket: std::env::var_os("NOTIFY_SOCKET").and_then(|path| connect(&path)),
            next: Instant::now(),
        };
        watchdog.say("READY=1");
        watchdog
    }

    /// Says that the program lives, if it is time for it.
    pub fn live(&mut self) {
        let now = Instant::now();
        if now >= self.next {
            self.next = now + PERIOD;
            self.say("WATCHDOG=1");
        }
    }

    /// Says that the program is about to end.
    pub fn stopping(&self) {
        self.say("STOPPING=1");
    }

    fn say(&self, text: &str) {
        #[cfg(unix)]
        if let Some(socket) = &self.socket {
            let _ = socket.send(text.as_bytes()); // without systemd nobody needs it
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

    #[test]
    fn speaks_to_the_socket() {
        let path = std::env::temp_dir().join(format!("track-cpu-notify-{}", std::process::id()));
        let systemd = UnixDatagram::bind(&path).unwrap();
        let mut watchdog = Watchdog {
            socket: connect(path.as_os_str()),
            next: Instant::now(),
        };
        watchdog.live();
        watchdog.live(); // too early
        watchdog.stopping();
        let mut heard = [0; 64];
        for expected in ["WATCHDOG=1", "STOPPING=1"] {
            let n = systemd.recv(&mut heard).unwrap();
            assert_eq!(&heard[..n], expected.as_bytes());
        }
        std::fs::remove_file(&path).unwrap();
        assert!(connect(std::ffi::OsStr::new("/no/such/socket")).is_none());
    }
}
