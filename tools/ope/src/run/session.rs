//! Another program over one sequence: the client of the TraX protocol.

use super::{CommandLine, Outcome, failure};
use crate::error::Error;
use sequences::{Rect, Sequence};
use std::fs;
use std::io::{BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};
use trax::{Kind, Message, Rectangle, Region};

/// Messages that a program can send before its next one blocks.
const AHEAD: usize = 16;

/// Time for a program to end after `quit` before it is killed.
const QUIT_TIMEOUT: Duration = Duration::from_secs(3);

/// Starts the program and sends it the frames of a sequence.
///
/// A frame's seconds run from the message to its answer and include the program's reading of the
/// picture.
pub fn track(
    line: &CommandLine,
    timeout: Duration,
    sequence: &Sequence,
    first: Rect,
) -> Result<Outcome, Error> {
    let failure = |reason: String| {
        failure(
            &sequence.annotation.name,
            format!("{}: {reason}", line.program()),
        )
    };
    let mut server = Server::start(line, timeout).map_err(failure)?;
    let mut outcome = Outcome {
        boxes: Vec::new(),
        seconds: Vec::new(),
        held: 0,
    };
    for (i, path) in sequence.frames.iter().enumerate() {
        let image = url(path)?;
        let messages = if i == 0 {
            server.initialization(image, first)
        } else {
            vec![frame(image)]
        };
        let clock = Instant::now();
        let found = server
            .ask(&messages)
            .map_err(|reason| failure(format!("frame {}: {reason}", i + 1)))?;
        outcome.seconds.push(clock.elapsed().as_secs_f64());
        outcome.boxes.push(if i == 0 { first } else { found });
    }
    server.quit();
    Ok(outcome)
}

/// The URL of a picture in a message.
fn url(path: &Path) -> Result<String, Error> {
    let absolute = fs::canonicalize(path).map_err(Error::unreadable(path))?;
    Ok(format!("file://{}", absolute.display()))
}

fn frame(image: String) -> Message {
    Message::new(Kind::Frame).argument(image)
}

/// A running program, which is killed when dropped.
struct Server {
    child: Child,
    to: ChildStdin,
    from: Receiver<Result<Message, String>>,
    timeout: Duration,
    version: u32,
    takes_rectangles: bool,
}

impl Server {
    fn start(line: &CommandLine, timeout: Duration) -> Result<Server, String> {
        let mut command = line.command(&[]);
        command
            .env("TRAX", "1")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped());
        let mut server = Server::spawn(command, timeout)?;
        let hello = server.next(Kind::Hello)?;
        let version = hello.get("trax.version").unwrap_or("1");
        server.version = version
            .parse()
            .map_err(|_| format!("hello: unknown version {version:?}"))?;
        let includes = |forms: &str, form: &str| forms.split(';').any(|f| f == form);
        let images = hello.get("trax.image").unwrap_or("path");
        if !includes(images, "path") {
            return Err(format!(
                "hello: expected pictures by path, found {images:?}"
            ));
        }
        let regions = hello.get("trax.region").unwrap_or("rectangle");
        server.takes_rectangles = includes(regions, "rectangle");
        Ok(server)
    }

    /// Starts the program, and a thread that reads its messages so that waiting for one can time
    /// out.
    fn spawn(mut command: Command, timeout: Duration) -> Result<Server, String> {
        let mut child = command.spawn().map_err(|error| error.to_string())?;
        let (Some(to), Some(out)) = (child.stdin.take(), child.stdout.take()) else {
            return Err("no pipes to it".into());
        };
        let (sender, from) = sync_channel(AHEAD);
        thread::spawn(move || {
            let mut out = BufReader::new(out);
            let mut line = Vec::new();
            while let Some(read) = trax::read(&mut out, &mut line).transpose() {
                let broken = read.is_err();
                if sender
                    .send(read.map_err(|error| error.to_string()))
                    .is_err()
                    || broken
                {
                    return;
                }
            }
        });
        Ok(Server {
            child,
            to,
            from,
            timeout,
            version: 1,
            takes_rectangles: true,
        })
    }

    /// The messages that initialize the tracker: the first picture and the box in it.
    fn initialization(&self, image: String, first: Rect) -> Vec<Message> {
        let Rect { x, y, w, h } = first;
        let region = if self.takes_rectangles {
            Rectangle::new(x, y, w, h).to_string()
        } else {
            let (right, bottom) = (x + w, y + h);
            format!("{x:.4},{y:.4},{right:.4},{y:.4},{right:.4},{bottom:.4},{x:.4},{bottom:.4}")
        };
        let initialize = Message::new(Kind::Initialize);
        match self.version {
            4.. => vec![initialize.argument(region), frame(image)],
            _ => vec![initialize.argument(image).argument(region)],
        }
    }

    /// Sends messages and waits for the box.
    fn ask(&mut self, messages: &[Message]) -> Result<Rect, String> {
        let text: String = messages
            .iter()
            .map(|message| format!("{message}\n"))
            .collect();
        let sent = self
            .to
            .write_all(text.as_bytes())
            .and_then(|()| self.to.flush());
        // A program that has ended may have sent its reason before.
        let state = self.next(Kind::State).map_err(|reason| match &sent {
            Err(error) => format!("{reason} ({error})"),
            Ok(()) => reason,
        })?;
        let region = state.arguments.first().ok_or("state: no region in it")?;
        let Rectangle { x, y, w, h } = Region::parse(region)
            .map_err(|error| error.to_string())?
            .rectangle();
        Ok(Rect::new(x, y, w, h))
    }

    /// The next message; an error if it is of another kind.
    fn next(&mut self, kind: Kind) -> Result<Message, String> {
        let message = match self.from.recv_timeout(self.timeout) {
            Ok(message) => message?,
            Err(RecvTimeoutError::Timeout) => {
                return Err(format!(
                    "no {} within {} s",
                    kind.name(),
                    self.timeout.as_secs_f64()
                ));
            }
            Err(RecvTimeoutError::Disconnected) => {
                return Err(format!("it ended before a {}", kind.name()));
            }
        };
        match message.kind {
            found if found == kind => Ok(message),
            Kind::Quit => Err(format!(
                "it quit: {}",
                message.get("trax.reason").unwrap_or("no reason given")
            )),
            found => Err(format!("expected {}, found {}", kind.name(), found.name())),
        }
    }

    /// Sends `quit` and waits for the program to end. The drop kills one that does not.
    fn quit(&mut self) {
        let _ = writeln!(self.to, "{}", Message::new(Kind::Quit)).and_then(|()| self.to.flush());
        let deadline = Instant::now() + QUIT_TIMEOUT;
        while Instant::now() < deadline && matches!(self.child.try_wait(), Ok(None)) {
            thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill(); // fails if it has ended already
        let _ = self.child.wait();
    }
}
