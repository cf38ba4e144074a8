//! Another program over one sequence through the TraX protocol, of which this is the client.

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

/// Messages that a program may send ahead before it blocks.
const AHEAD: usize = 16;

/// Time for a program to end after `quit`.
const FAREWELL: Duration = Duration::from_secs(3);

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
            server.beginning(image, first)
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

/// A picture as a message names it.
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
        let takes = |key: &str, form: &str| {
            hello
                .get(key)
                .is_none_or(|forms| forms.split(';').any(|f| f == form))
        };
        if !takes("trax.image", "path") {
            return Err("hello: it takes no pictures by their path".into());
        }
        server.takes_rectangles = takes("trax.region", "rectangle");
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

    /// The messages that name the object and its picture.
    fn beginning(&self, image: String, first: Rect) -> Vec<Message> {
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
        // One that has gone may have said why.
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

    /// Sends `quit` and waits a moment. The drop kills a program that stays.
    fn quit(&mut self) {
        let _ = writeln!(self.to, "{}", Message::new(Kind::Quit)).and_then(|()| self.to.flush());
        let deadline = Instant::now() + FAREWELL;
        while Instant::now() < deadline && matches!(self.child.try_wait(), Ok(None)) {
            thread::sleep(Duration::from_millis(2));
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill(); // fails where it has ended
        let _ = self.child.wait();
    }
}
