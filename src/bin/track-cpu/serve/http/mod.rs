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

mod video;

use std::io::{Read, Write};
use std::net::{SocketAddr, ToSocketAddrs};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::{Value, json};
use tiny_http::{Header, Method, Request, Response, Server};

use super::hub::{Command, Hub};
use crate::exit::Failure;
use video::Video;

const PAGE: &str = include_str!("page.html");
/// Most bytes of a request's body.
const MAX_BODY: u64 = 4096;
/// Most streams at a time, videos and events together.
const MAX_STREAMS: usize = 32;
/// How long a stream waits before it looks whether it is to end.
const PATIENCE: Duration = Duration::from_millis(500);

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
        && text.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
    if good { Ok(text.into()) } else { Err("expected 8 to 128 letters, digits, - or _".into()) }
}

/// Starts the server's threads, if it is asked for.
///
/// # Errors
/// If the address cannot be listened on, or is open to others without a token.
pub fn start(args: &HttpArgs, hub: &Arc<Hub>) -> Result<Vec<JoinHandle<()>>, Failure> {
    let Some(address) = &args.http else { return Ok(Vec::new()) };
    let wrong = |reason: String| Failure::Output { output: format!("--http {address}"), reason };
    let found: Vec<SocketAddr> =
        address.to_socket_addrs().map_err(|error| wrong(error.to_string()))?.collect();
    let local = found.iter().all(|a| a.ip().is_loopback());
    if !local && args.token.is_none() {
        return Err(wrong("is open to other machines, expected --token with it".into()));
    }
    let token = args.token.clone().map_or_else(random_token, Ok).map_err(|error| wrong(error.to_string()))?;
    let server = Server::http(&found[..]).map_err(|error| wrong(error.to_string()))?;
    eprintln!("web page: http://{}/#{token}", server.server_addr());
    let video = Arc::new(Video::default());
    let encoder = {
        let (video, hub) = (Arc::clone(&video), Arc::clone(hub));
        std::thread::spawn(move || video.encode(&hub))
    };
    let site = Site { token, hub: Arc::clone(hub), video };
    let listener = std::thread::spawn(move || {
        while !site.hub.is_stopping() {
            if let Ok(Some(request)) = server.recv_timeout(PATIENCE) {
                site.answer(request);
            }
        }
    });
    Ok(vec![encoder, listener])
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
}

impl Site {
    /// Answers at once, or hands a stream to a thread of its own; a client that has gone is no fault of ours.
    fn answer(&self, mut request: Request) {
        let path = request.url().split('?').next().unwrap_or_default().to_string();
        let (status, kind, body) = match (request.method(), path.as_str()) {
            (Method::Get, "/") => (200, "text/html; charset=utf-8", PAGE.to_string()),
            (Method::Get, "/state") => (200, "application/json", self.hub.report().1.to_json().to_string()),
            (Method::Get, "/video" | "/events") => return self.stream(request, path == "/video"),
            (Method::Post, "/start" | "/stop") if !self.is_authorised(&request) => {
                (403, "application/json", json!({ "error": "the token is missing or wrong" }).to_string())
            }
            (Method::Post, "/start" | "/stop") => {
                let command =
                    if path == "/stop" { Some(Command::Stop) } else { read_start(request.as_reader()) };
                match command.map(|command| self.hub.command(command)) {
                    Some(true) => (202, "application/json", json!({ "accepted": true }).to_string()),
                    _ => (
                        400,
                        "application/json",
                        json!({ "error": "expected a rectangle or point within the frame" }).to_string(),
                    ),
                }
            }
            (Method::Get | Method::Post, _) => (404, "text/plain", "not here\n".into()),
            _ => (405, "text/plain", "not so\n".into()),
        };
        let mut response = Response::from_string(body).with_status_code(status);
        for (name, value) in [
            ("Content-Type", kind),
            ("Cache-Control", "no-store"),
            ("X-Content-Type-Options", "nosniff"),
            ("Content-Security-Policy", "default-src 'self' 'unsafe-inline'; frame-ancestors 'none'"),
        ] {
            if let Ok(header) = Header::from_bytes(name, value) {
                response.add_header(header);
            }
        }
        let _ = request.respond(response);
    }

    fn is_authorised(&self, request: &Request) -> bool {
        let header = request.headers().iter().find(|header| header.field.equiv("X-Token"));
        header.is_some_and(|header| same(header.value.as_str().as_bytes(), self.token.as_bytes()))
    }

    fn stream(&self, request: Request, is_video: bool) {
        if self.hub.streams() >= MAX_STREAMS {
            let _ = request.respond(Response::from_string("too many watch\n").with_status_code(503));
            return;
        }
        let (hub, video) = (Arc::clone(&self.hub), Arc::clone(&self.video));
        let watching = hub.watch(is_video);
        std::thread::spawn(move || {
            let _watching = watching;
            let mut out = request.into_writer();
            let _ = if is_video { video.stream(&hub, &mut out) } else { events(&hub, &mut out) };
        });
    }
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
fn read_start(body: &mut dyn Read) -> Option<Command> {
    let mut text = String::new();
    body.take(MAX_BODY).read_to_string(&mut text).ok()?;
    let value: Value = serde_json::from_str(&text).ok()?;
    let numbers = |field: &str| -> Option<Vec<f32>> {
        value.get(field)?.as_array()?.iter().map(|v| v.as_f64().map(|v| v as f32)).collect()
    };
    match (numbers("rectangle").as_deref(), numbers("point").as_deref()) {
        (Some(&[x1, y1, x2, y2]), None) => Some(Command::Rectangle([x1, y1, x2, y2])),
        (None, Some(&[x, y])) => Some(Command::Point { x, y, radius: None }),
        _ => None,
    }
}

/// Compares in a time that does not tell how much was right.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |difference, (a, b)| difference | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starts_are_read_with_care() {
        let read = |text: &str| read_start(&mut text.as_bytes());
        let rectangle = Command::Rectangle([0.0, 0.25, 0.5, 1.0]);
        assert_eq!(read("{\"rectangle\": [0, 0.25, 0.5, 1]}"), Some(rectangle));
        let point = Command::Point { x: 0.5, y: 0.25, radius: None };
        assert_eq!(read("{\"point\": [0.5, 0.25]}"), Some(point));
        let long = format!("{{\"point\": [0.5, 0.5], \"x\": \"{}\"}}", "y".repeat(5000));
        for bad in
            ["", "{}", "[1,2,3,4]", "{\"rectangle\": [0, 1]}", "{\"point\": [\"a\", 1]}", long.as_str()]
        {
            assert_eq!(read(bad), None, "{bad:.40}");
        }
    }

    #[test]
    fn tokens() {
        assert!(same(b"abc", b"abc") && !same(b"abc", b"abd") && !same(b"abc", b"abcd") && !same(b"", b"a"));
        assert!(token("short").is_err() && token("with space").is_err() && token("long-enough_1").is_ok());
        assert_ne!(random_token().unwrap(), random_token().unwrap());
    }
}
