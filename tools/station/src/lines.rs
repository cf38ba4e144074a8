//! JSON lines on standard output and as datagrams.
//!
//! A thread of its own writes to standard output, so that a reader that does not read delays no
//! frame.

use std::io::{ErrorKind, Write};
use std::net::{ToSocketAddrs, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::error::Error;
use crate::report::View;
use crate::say::say;

/// Lines that may wait to be written; further ones are lost.
const MAX_WAITING: usize = 64;
/// How long the last lines may take to be written.
const PATIENCE: Duration = Duration::from_secs(1);

/// Where the lines go.
pub struct Lines {
    printer: Option<Printer>,
    prints_reports: bool,
    socket: Option<UdpSocket>,
}

struct Printer {
    queue: SyncSender<String>,
    thread: JoinHandle<()>,
    has_failed: Arc<AtomicBool>,
    every: bool,
    lost: u64,
}

impl Lines {
    /// Lines for standard output, if `print`, and for an address; none is lost if `every` counts.
    ///
    /// With `answers`, lines sent to [`Self::printer`] go to standard output as well.
    ///
    /// # Errors
    /// If the address is unusable.
    pub fn new(print: bool, answers: bool, udp: Option<&str>, every: bool) -> Result<Lines, Error> {
        let socket = udp
            .map(connect)
            .transpose()
            .map_err(|error| Error::output(format!("--udp {}", udp.unwrap_or_default()), error))?;
        Ok(Lines {
            printer: (print || answers).then(|| Printer::start(every)),
            prints_reports: print,
            socket,
        })
    }

    /// Writes the lines of the newest report, one per target.
    ///
    /// # Errors
    /// If the reader of standard output has gone.
    pub fn write(&mut self, view: &View) -> Result<(), Error> {
        if !self.prints_reports && self.socket.is_none() {
            return Ok(());
        }
        for line in view.to_lines() {
            let line = line.to_string();
            if let Some(socket) = &self.socket {
                let _ = socket.send(line.as_bytes()); // a missing listener is no failure
            }
            if let Some(printer) = self.printer.as_mut().filter(|_| self.prints_reports) {
                printer.print(line)?;
            }
        }
        Ok(())
    }

    /// The queue of further lines for standard output.
    pub fn printer(&self) -> Option<SyncSender<String>> {
        self.printer.as_ref().map(|printer| printer.queue.clone())
    }

    /// Stops writing to standard output.
    pub fn silence(&mut self) {
        self.printer = None;
        self.prints_reports = false;
    }

    /// Waits until every line is written, or the reader has been slow for too long.
    pub fn finish(self) {
        let Some(printer) = self.printer else {
            return;
        };
        drop(printer.queue);
        let until = Instant::now() + PATIENCE;
        while !printer.thread.is_finished() && (printer.every || Instant::now() < until) {
            std::thread::sleep(Duration::from_millis(5));
        }
        if printer.lost > 0 {
            say!(
                "standard output: {} lines lost, because its reader was slow",
                printer.lost
            );
        }
    }
}

impl Printer {
    fn start(every: bool) -> Printer {
        let (queue, lines) = sync_channel(MAX_WAITING);
        let has_failed = Arc::new(AtomicBool::new(false));
        let failure = Arc::clone(&has_failed);
        let thread = std::thread::spawn(move || {
            if print(&lines).is_err() {
                failure.store(true, Ordering::Relaxed);
            }
        });
        Printer {
            queue,
            thread,
            has_failed,
            every,
            lost: 0,
        }
    }

    fn print(&mut self, line: String) -> Result<(), Error> {
        if self.has_failed.load(Ordering::Relaxed) {
            return Err(Error::ClosedPipe);
        }
        if self.every {
            return self.queue.send(line).map_err(|_| Error::ClosedPipe);
        }
        match self.queue.try_send(line) {
            Ok(()) => Ok(()),
            Err(TrySendError::Full(_)) => {
                if self.lost == 0 {
                    say!("standard output: its reader is slow; lines are lost");
                }
                self.lost += 1;
                Ok(())
            }
            Err(TrySendError::Disconnected(_)) => Err(Error::ClosedPipe),
        }
    }
}

fn print(lines: &Receiver<String>) -> std::io::Result<()> {
    let mut out = std::io::stdout();
    for line in lines {
        match writeln!(out, "{line}").and_then(|()| out.flush()) {
            Ok(()) => {}
            Err(error) => {
                if error.kind() != ErrorKind::BrokenPipe {
                    say!("standard output: {error}");
                }
                return Err(error);
            }
        }
    }
    Ok(())
}

fn connect(address: &str) -> std::io::Result<UdpSocket> {
    let any = if address.starts_with('[') {
        "[::]:0"
    } else {
        "0.0.0.0:0"
    };
    let socket = UdpSocket::bind(any)?;
    if address.to_socket_addrs()?.any(|peer| peer.port() == 0) {
        return Err(std::io::Error::other("expected a port above 0, found 0"));
    }
    socket.connect(address)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn address_that_is_none_is_refused_by_name() {
        for (address, reason) in [("nonsense", ""), ("127.0.0.1:0", "a port above 0")] {
            let refused = Lines::new(false, false, Some(address), false).err();

            let message = refused.map(|error| error.to_string()).unwrap_or_default();
            let start = format!("--udp {address}: ");
            assert!(message.starts_with(&start), "{message}");
            assert!(message.contains(reason), "{message}");
        }
    }
}
