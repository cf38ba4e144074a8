//! The web ground station: one page, the video as MJPEG, reports as server-sent events, start and stop.
//!
//! | request | answer |
//! |---|---|
//! | `GET /` | the page |
//! | `GET /video` | multipart JPEG, at most 15 pictures a second, at most 640 pixels wide |
//! | `GET /events` | a report (JSON) per event, at most 30 a second |
//! | `GET /state` | the newest report |
//! | `POST /start` | `{"rectangle": [left, top, right, bottom]}` or `{"point": [x, y]}` in shares of the frame; token needed |
//! | `POST /stop` | token needed |
//!
//! The token travels in the header `X-Token`, which no other site's page can make a browser send.

mod request;
mod video;

use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::{Value, json};

use super::hub::{Command, Hub};
use crate::exit::Failure;
use request::{Refusal, Request};
use video::Video;

const PAGE: &str = include_str!("page.html");
/// Most connections at a time; more are closed at once.
const MAX_CONNECTIONS: usize = 64;
/// Most streams at a time, videos and events together.
const MAX_STREAMS: usize = 32;
/// How long a stream waits before it looks whether it is to end.
const PATIENCE: Duration = Duration::from_millis(500);
/// How long a client may take to receive something.
const MAX_WRITE: Duration = Duration::from_secs(5);
/// Most times that something is taken of a request that was refused.
const MAX_VAIN: usize = 32;
/// How often new connections are looked for.
const TICK: Duration = Duration::from_millis(10);

/// Options of the web ground station.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Web ground station")]
pub struct HttpArgs {
    /// Serve the web page here, such as 127.0.0.1:8080; other addresses than this machine's own need --token.
    #[arg(long, value_name = "ADDR")]
    pub http: Option<String>,
    /// What start and stop need to be sent with; made up and shown if absent.
    #[arg(long, value_name = "TEXT", requires = "http", value_parser = token)]
    pub token: Option<String>,
}

fn token(text: &str) -> Result<String, String> {
    let good = (8..=128).contains(&text.len())
        && text
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
    if good {
        Ok(text.into())
    } else {
        Err("expected 8 to 128 letters, digits, - or _".into())
    }
}

/// Starts the server's threads, if it is asked for.
///
/// # Errors
/// If the address cannot be listened on, or is open to others without a token.
pub fn start(args: &HttpArgs, hub: &Arc<Hub>) -> Result<Vec<JoinHandle<()>>, Failure> {
    let Some(address) = &args.http else {
        return Ok(Vec::new());
    };
    let wrong = |reason: String| Failure::Output {
        output: format!("--http {address}"),
        reason,
    };
    let found: Vec<SocketAddr> = address
        .to_socket_addrs()
        .map_err(|error| wrong(error.to_string()))?
        .collect();
    let local = found.iter().all(|a| a.ip().is_loopback());
    if !local && args.token.is_none() {
        return Err(wrong(
            "is open to other machines, expected --token with it".into(),
        ));
    }
    let token = args
        .token
        .clone()
        .map_or_else(random_token, Ok)
        .map_err(|error| wrong(error.to_string()))?;
    let listen = || {
        let listener = TcpListener::bind(&found[..])?;
        listener.set_nonblocking(true)?; // so that it sees when the program ends
        Ok((listener.local_addr()?, listener))
    };
    let (address, listener) = listen().map_err(|error: std::io::Error| wrong(error.to_string()))?;
    eprintln!("web page: http://{address}/#{token}");
    let video = Arc::new(Video::default());
    let encoder = {
        let (video, hub) = (Arc::clone(&video), Arc::clone(hub));
        std::thread::spawn(move || video.encode(&hub))
    };
    let site = Arc::new(Site {
        token,
        hub: Arc::clone(hub),
        video,
        places: Arc::new(()),
    });
    let listening = std::thread::spawn(move || {
        while !site.hub.is_stopping() {
            match listener.accept() {
                Ok((stream, _)) => site.welcome(stream),
                Err(_) => std::thread::sleep(TICK),
            }
        }
    });
    Ok(vec![encoder, listening])
}

fn random_token() -> std::io::Result<String> {
    let mut bytes = [0; 12];
    std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

struct Site {
    token: String,
    hub: Arc<Hub>,
    video: Arc<Video>,
    places: Arc<()>, // every connection holds one
}

impl Site {
    /// Gives a connection a thread of its own; a client that has gone is no fault of ours.
    fn welcome(self: &Arc<Site>, mut stream: TcpStream) {
        let (site, place) = (Arc::clone(self), Arc::clone(&self.places));
        if Arc::strong_count(&place) - 2 >= MAX_CONNECTIONS {
            return; // `places` itself and `place` are two
        }
        // Where the system refuses a thread, the client is refused.
        let _ = std::thread::Builder::new().spawn(move || {
            let _place = place; // given back even if the thread panics
            let _ = site.answer(&mut stream);
        });
    }

    /// One answer per connection.
    fn answer(&self, stream: &mut TcpStream) -> std::io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(MAX_WRITE))?;
        match Request::read(stream) {
            Ok(request) if request.method == "GET" && request.path == "/video" => {
                self.stream(stream, true)
            }
            Ok(request) if request.method == "GET" && request.path == "/events" => {
                self.stream(stream, false)
            }
            Ok(request) => {
                let (status, kind, body) = self.respond(&request);
                send(stream, status, kind, &body)
            }
            Err(Refusal::Status(status)) => {
                send(stream, status, "text/plain", "not so\n")?;
                // What was sent in vain is taken, so that the answer is not lost with the connection.
                stream.shutdown(Shutdown::Write)?;
                let mut vain = [0; 1024];
                (0..MAX_VAIN)
                    .take_while(|_| stream.read(&mut vain).is_ok_and(|count| count > 0))
                    .for_each(drop);
                Ok(())
            }
            Err(Refusal::Gone) => Ok(()),
        }
    }

    fn respond(&self, request: &Request) -> (u16, &'static str, String) {
        let json = "application/json";
        let wrong = |text: &str| json!({ "error": text }).to_string();
        match (request.method.as_str(), request.path.as_str()) {
            ("GET", "/") => (200, "text/html; charset=utf-8", PAGE.to_string()),
            ("GET", "/state") => (200, json, self.hub.report().1.to_json().to_string()),
            ("POST", "/start" | "/stop") if !self.is_authorized(request) => {
                (403, json, wrong("the token is missing or wrong"))
            }
            ("POST", path @ ("/start" | "/stop")) => {
                let command = if path == "/stop" {
                    Some(Command::Stop)
                } else {
                    read_start(&request.body)
                };
                match command.map(|command| self.hub.command(command)) {
                    Some(true) => (202, json, json!({ "accepted": true }).to_string()),
                    _ => (
                        400,
                        json,
                        wrong("expected a rectangle or point within the frame"),
                    ),
                }
            }
            ("GET" | "POST", _) => (404, "text/plain", "not here\n".into()),
            _ => (405, "text/plain", "not so\n".into()),
        }
    }

    fn is_authorized(&self, request: &Request) -> bool {
        request
            .token
            .as_ref()
            .is_some_and(|token| same(token, self.token.as_bytes()))
    }

    fn stream(&self, stream: &mut TcpStream, is_video: bool) -> std::io::Result<()> {
        if self.hub.streams() >= MAX_STREAMS {
            return send(stream, 503, "text/plain", "too many watch\n");
        }
        let _watching = self.hub.watch(is_video);
        if is_video {
            self.video.stream(&self.hub, stream)
        } else {
            events(&self.hub, stream)
        }
    }
}

fn send(stream: &mut TcpStream, status: u16, kind: &str, body: &str) -> std::io::Result<()> {
    let reason = match status {
        200 => "OK",
        202 => "Accepted",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        411 => "Length Required",
        413 => "Content Too Large",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        _ => "Bad Request",
    };
    let length = body.len();
    let head = format!(
        "HTTP/1.1 {status} {reason}\r\nContent-Type: {kind}\r\nContent-Length: {length}\r\nCache-Control: no-store\r\n\
         X-Content-Type-Options: nosniff\r\n\
         Content-Security-Policy: default-src 'self' 'unsafe-inline'; frame-ancestors 'none'\r\n\
         Connection: close\r\n\r\n"
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(body.as_bytes())?;
    stream.flush()
}

/// Reports as server-sent events until the client goes or the program ends.
fn events(hub: &Hub, out: &mut dyn Write) -> std::io::Result<()> {
    write!(
        out,
        "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n"
    )?;
    let mut seen = 0;
    while !hub.is_stopping() {
        let (number, report) = hub.report_after(seen, PATIENCE);
        match number == seen {
            true => write!(out, ": waiting\n\n")?, // fails once the client has gone
            false => write!(out, "data: {}\n\n", report.to_json())?,
        }
        out.flush()?;
        seen = number;
        std::thread::sleep(Duration::from_millis(33));
    }
    Ok(())
}

/// A command from the body of `/start`.
fn read_start(body: &[u8]) -> Option<Command> {
    let value: Value = serde_json::from_slice(body).ok()?;
    let numbers = |field: &str| -> Option<Vec<f32>> {
        value
            .get(field)?
            .as_array()?
            .iter()
            .map(|v| v.as_f64().map(|v| v as f32))
            .collect()
    };
    match (numbers("rectangle").as_deref(), numbers("point").as_deref()) {
        (Some(&[x1, y1, x2, y2]), None) => Some(Command::Rectangle([x1, y1, x2, y2])),
        (None, Some(&[x, y])) => Some(Command::Point { x, y, radius: None }),
        _ => None,
    }
}

/// Compares in a time that does not tell how much was right.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len()
        && a.iter()
            .zip(b)
            .fold(0, |difference, (a, b)| difference | (a ^ b))
            == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_are_read_with_care() {
        let read = |text: &str| read_start(text.as_bytes());
        let rectangle = Command::Rectangle([0.0, 0.25, 0.5, 1.0]);
        assert_eq!(read("{\"rectangle\": [0, 0.25, 0.5, 1]}"), Some(rectangle));
        let point = Command::Point {
            x: 0.5,
            y: 0.25,
            radius: None,
        };
        assert_eq!(read("{\"point\": [0.5, 0.25]}"), Some(point));
        for bad in [
            "",
            "{}",
            "[1,2,3,4]",
            "{\"rectangle\": [0, 1]}",
            "{\"point\": [\"a\", 1]}",
        ] {
            assert_eq!(read(bad), None, "{bad}");
        }
    }

    #[test]
    fn tokens() {
        assert!(
            same(b"abc", b"abc")
                && !same(b"abc", b"abd")
                && !same(b"abc", b"abcd")
                && !same(b"", b"a")
        );
        assert!(
            token("short").is_err()
                && token("with space").is_err()
                && token("long-enough_1").is_ok()
        );
        assert_ne!(random_token().unwrap(), random_token().unwrap());
    }
}
