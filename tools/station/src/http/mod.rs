//! The web page: video, reports, start and stop.
//!
//! | request | answer |
//! |---|---|
//! | `GET /` | the page |
//! | `GET /video` | multipart JPEG, at most 15 pictures a second and 640 pixels wide; `X-Frame` numbers them |
//! | `GET /frame` | the newest frame in full size as JPEG; `X-Frame` numbers it, and it is kept for a minute |
//! | `GET /events` | a report (JSON) per event, at most 30 a second and at least 2 |
//! | `GET /state` | the newest report |
//! | `GET /metrics` | the newest report in numbers, as Prometheus reads it |
//! | `POST /start` | `{"rectangle": [left, top, right, bottom]}` or `{"point": [x, y]}` in shares of the frame, or `{"box": [left, top, width, height]}` in pixels; `"frame"` may number the frame in which they were drawn, and `"target"` the target, which is the lowest that is free otherwise; needs the token |
//! | `POST /stop` | stops all targets, or with `{"target": number}` this one; needs the token |
//!
//! The token travels in the header `X-Token`, which no other site's page can make a browser send.
//! Streams and pictures may carry it as `?token=`. Requests for an unknown `Host` are refused, so
//! that no other site can pose as this one.
//!
//! | file | what happens there |
//! |---|---|
//! | `mod.rs` | options, requests and answers |
//! | `request.rs` | reading an untrusted request within limits |
//! | `host.rs` | which names this server has |
//! | `admission.rs` | limits on connections |
//! | `video.rs` | the video, encoded once for all viewers |
//! | `metrics.rs` | numbers for Prometheus |
//! | `page.html` | the page |

mod admission;
mod host;
mod metrics;
mod request;
mod video;

use std::io::{Read, Write};
use std::net::{IpAddr, Shutdown, SocketAddr, TcpListener, TcpStream, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::{Value, json};

use crate::command::{Command, LIFETIME, Outcome};
use crate::error::{Error, read_secret};
use crate::hub::Hub;
use crate::say::say;
use admission::Admission;
use host::Hosts;
use request::{Refusal, Request};
use video::Video;

const PAGE: &str = include_str!("page.html");
/// How long a stream waits before it checks whether to end, or repeats the last report.
const PATIENCE: Duration = Duration::from_millis(500);
/// Time between two reads of a request that has not arrived.
const READ: Duration = Duration::from_millis(250);
/// How long a client may take to receive something.
const MAX_WRITE: Duration = Duration::from_secs(5);
/// Most reads of the rest of a refused request.
const MAX_DISCARDED_READS: usize = 4;
/// Shortest time between two events.
const EVENTS: Duration = Duration::from_millis(33);
/// How often the listening thread checks whether to end.
const TICK: Duration = Duration::from_millis(5);

/// Options of the web page.
#[derive(Clone, Debug, Default)]
pub struct HttpOptions {
    /// Where it listens; `None` for no web page.
    pub address: Option<String>,
    /// The token that starts and stops need. Without a token or a file, a random one is shown.
    pub token: Option<String>,
    /// File that holds the token.
    pub token_file: Option<PathBuf>,
    /// Whether watching needs the token as well.
    pub private: bool,
    /// Host names of this server, besides its addresses, `localhost` and the machine's name.
    pub names: Vec<String>,
}

/// Checks a token.
///
/// # Errors
/// If it is short, long, or holds other characters than letters, digits, `-` and `_`.
pub fn check_token(token: &str) -> Result<(), String> {
    let is_good = (8..=128).contains(&token.len())
        && token
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
    if is_good {
        Ok(())
    } else {
        Err("expected 8 to 128 letters, digits, - or _".into())
    }
}

/// A web page that is served.
#[derive(Debug)]
pub struct Page {
    /// Its address, with the token.
    pub url: String,
    /// The server's threads, which end with the hub.
    pub threads: Vec<JoinHandle<()>>,
}

/// Starts the server, if it is asked for.
///
/// # Errors
/// If the address cannot be listened on, is open to others without a token, or the token is
/// unusable.
pub fn start(options: &HttpOptions, hub: &Arc<Hub>) -> Result<Option<Page>, Error> {
    let Some(address) = &options.address else {
        return Ok(None);
    };
    let wrong = |reason: String| Error::output(format!("--http {address}"), reason);
    let found: Vec<SocketAddr> = address
        .to_socket_addrs()
        .map_err(|error| wrong(error.to_string()))?
        .collect();
    let given = given_token(options)?;
    let is_local = found.iter().all(|address| address.ip().is_loopback());
    if !is_local && given.is_none() {
        return Err(wrong(
            "is open to other machines, expected --token-file or --token with it".into(),
        ));
    }
    let listener = TcpListener::bind(&found[..]).map_err(|error| wrong(error.to_string()))?;
    let listen = || {
        listener.set_nonblocking(true)?; // so that the thread sees when the program ends
        listener.local_addr()
    };
    let bound = listen().map_err(|error: std::io::Error| wrong(error.to_string()))?;
    let token = match given {
        Some(token) => {
            say!("web page: http://{bound}/#TOKEN (with the token that was given)");
            token
        }
        None => {
            let token = random_token().map_err(|error| wrong(error.to_string()))?;
            say!("web page: http://{bound}/#{token}");
            token
        }
    };
    let url = format!("http://{bound}/#{token}");
    let video = Arc::new(Video::default());
    let encoder = {
        let video = Arc::clone(&video);
        let hub = Arc::clone(hub);
        std::thread::spawn(move || video.encode(&hub))
    };
    let site = Arc::new(Site {
        token,
        is_private: options.private,
        hosts: Hosts::new(address, &options.names),
        hub: Arc::clone(hub),
        video,
        admission: Admission::default(),
    });
    let listening = std::thread::spawn(move || {
        while !site.hub.is_stopping() {
            match listener.accept() {
                Ok((stream, from)) => site.welcome(stream, from.ip()),
                Err(_) => std::thread::sleep(TICK),
            }
        }
    });
    let threads = vec![encoder, listening];
    Ok(Some(Page { url, threads }))
}

/// The token that the user has given, in a file or as an option.
fn given_token(options: &HttpOptions) -> Result<Option<String>, Error> {
    let Some(path) = &options.token_file else {
        if let Some(token) = &options.token {
            check_token(token).map_err(|reason| Error::output("--token", reason))?;
        }
        return Ok(options.token.clone());
    };
    let bytes = read_secret(path)?;
    let text = String::from_utf8_lossy(&bytes);
    let token = text.trim();
    check_token(token).map_err(|reason| Error::file(path, reason))?;
    Ok(Some(token.into()))
}

fn random_token() -> std::io::Result<String> {
    let mut bytes = [0; 12];
    std::fs::File::open("/dev/urandom")?.read_exact(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

struct Site {
    token: String,
    is_private: bool,
    hosts: Hosts,
    hub: Arc<Hub>,
    video: Arc<Video>,
    admission: Admission,
}

/// The answer to a request.
struct Answer {
    status: u16,
    kind: &'static str,
    frame: Option<u64>,
    body: Vec<u8>,
}

impl Answer {
    fn text(status: u16, text: &str) -> Answer {
        Answer {
            status,
            kind: "text/plain",
            frame: None,
            body: text.into(),
        }
    }

    fn json(status: u16, value: &Value) -> Answer {
        Answer {
            status,
            kind: "application/json",
            frame: None,
            body: value.to_string().into(),
        }
    }

    fn error(status: u16, text: &str) -> Answer {
        Answer::json(status, &json!({ "error": text }))
    }
}

impl Site {
    /// Gives a connection a thread of its own.
    fn welcome(self: &Arc<Site>, mut stream: TcpStream, from: IpAddr) {
        let site = Arc::clone(self);
        let Some(ticket) = self.admission.enter(&stream, from) else {
            return;
        };
        // If the system refuses a thread, the connection is closed.
        let _ = std::thread::Builder::new().spawn(move || {
            let _ = site.answer(&mut stream, ticket, from); // the client may have gone
        });
    }

    /// Answers one request. The ticket is given up as soon as the request is read.
    fn answer(
        &self,
        stream: &mut TcpStream,
        ticket: admission::Ticket,
        from: IpAddr,
    ) -> std::io::Result<()> {
        stream.set_nonblocking(false)?;
        stream.set_read_timeout(Some(READ))?;
        stream.set_write_timeout(Some(MAX_WRITE))?;
        stream.set_nodelay(true)?;
        let request = match Request::read(stream) {
            Ok(request) => request,
            Err(Refusal::Gone) => return Ok(()),
            Err(Refusal::Status(status)) => {
                send(stream, &Answer::text(status, "bad request\n"), true)?;
                return discard_input(stream);
            }
        };
        let is_trusted = self.is_authorized(&request);
        let Some(answering) = ticket.answer(is_trusted) else {
            return send(stream, &Answer::text(503, "too many requests\n"), true);
        };
        if !self.hosts.know(request.host.as_deref()) {
            let unknown = "unknown host name: name it with --http-name\n";
            return send(stream, &Answer::text(421, unknown), true);
        }
        let is_watching = request.method != "POST" && request.path != "/";
        if self.is_private && is_watching && !is_trusted {
            let missing = Answer::error(403, "the token is missing or wrong");
            return send(stream, &missing, true);
        }
        let is_stream = ["/video", "/events"].contains(&request.path.as_str());
        if request.method == "GET" && is_stream {
            let Some(_watching) = self.admission.watch(from, is_trusted) else {
                return send(stream, &Answer::text(503, "too many viewers\n"), true);
            };
            drop(answering); // streams are counted by themselves
            return if request.path == "/video" {
                let _viewer = self.hub.watch();
                self.video.stream(&self.hub, stream)
            } else {
                events(&self.hub, stream)
            };
        }
        let has_body = request.method != "HEAD";
        send(stream, &self.respond(&request), has_body)
    }

    fn respond(&self, request: &Request) -> Answer {
        match (request.method.as_str(), request.path.as_str()) {
            ("GET" | "HEAD", "/") => Answer {
                status: 200,
                kind: "text/html; charset=utf-8",
                frame: None,
                body: PAGE.into(),
            },
            ("GET" | "HEAD", "/state") => Answer::json(200, &self.hub.view().to_json()),
            ("GET" | "HEAD", "/metrics") => Answer {
                status: 200,
                kind: "text/plain; version=0.0.4; charset=utf-8",
                frame: None,
                body: metrics::text(&self.hub.view()).into(),
            },
            ("GET", "/frame") => match video::freeze(&self.hub) {
                Some((frame, body)) => Answer {
                    status: 200,
                    kind: "image/jpeg",
                    frame: Some(frame),
                    body,
                },
                None => Answer::error(503, "no frame yet"),
            },
            ("POST", "/start" | "/stop") if !self.has_header(request) => {
                Answer::error(403, "the token is missing or wrong")
            }
            ("POST", "/stop") => match read_stop(&request.body) {
                Some(command) => self.command(command),
                None => Answer::error(400, "expected nothing, or the number of a target"),
            },
            ("POST", "/start") => match read_start(&request.body) {
                Some(command) => self.command(command),
                None => Answer::error(400, "expected a rectangle, a point or a box"),
            },
            ("GET" | "HEAD" | "POST", _) => Answer::text(404, "not found\n"),
            _ => Answer::text(405, "method not allowed\n"),
        }
    }

    /// Passes a command to the tracking thread and waits for its outcome.
    fn command(&self, command: Command) -> Answer {
        if let Err(reason) = command.check() {
            return Answer::error(400, &reason);
        }
        let outcome = self.hub.command(command).wait(LIFETIME + PATIENCE);
        match outcome {
            Outcome::Started(target) if self.hub.view().report.tells_ids() => {
                Answer::json(202, &json!({ "accepted": true, "target": target }))
            }
            Outcome::Done | Outcome::Started(_) => Answer::json(202, &json!({ "accepted": true })),
            Outcome::Refused(_) => Answer::error(409, &outcome.words()),
            _ => Answer::error(503, &outcome.words()),
        }
    }

    /// Whether a request carries the token in the header that no other site can set.
    fn has_header(&self, request: &Request) -> bool {
        let token = request.token.as_deref();
        token.is_some_and(|token| same(token, self.token.as_bytes()))
    }

    /// Whether a request carries the token at all.
    fn is_authorized(&self, request: &Request) -> bool {
        let query = request.query_token.as_deref();
        self.has_header(request)
            || query.is_some_and(|token| same(token.as_bytes(), self.token.as_bytes()))
    }
}

/// The start that a body asks for.
pub fn read_start(body: &[u8]) -> Option<Command> {
    Command::start(&serde_json::from_slice(body).ok()?)
}

/// The stop that a body asks for: of all targets, if it is empty.
pub fn read_stop(body: &[u8]) -> Option<Command> {
    if body.is_empty() {
        return Some(Command::Stop { id: None });
    }
    Command::stop(&serde_json::from_slice(body).ok()?)
}

/// Reads and discards the rest of a refused request. Closing a connection with unread input would
/// reset it, and the client could lose the answer.
fn discard_input(stream: &mut TcpStream) -> std::io::Result<()> {
    stream.shutdown(Shutdown::Write)?;
    let mut discarded = [0; 4096];
    for _ in 0..MAX_DISCARDED_READS {
        if !stream.read(&mut discarded).is_ok_and(|count| count > 0) {
            break;
        }
    }
    Ok(())
}

/// Headers of every answer: no other site may show it, and no cache may keep it.
const PROTECTION: &str = "Cache-Control: no-store\r\n\
     X-Content-Type-Options: nosniff\r\n\
     Cross-Origin-Resource-Policy: same-origin\r\n\
     Referrer-Policy: no-referrer\r\n\
     Content-Security-Policy: default-src 'self' 'unsafe-inline'; img-src 'self' blob: data:; \
     frame-ancestors 'none'\r\n\
     Connection: close\r\n";

fn send(stream: &mut TcpStream, answer: &Answer, has_body: bool) -> std::io::Result<()> {
    let status = answer.status;
    let reason = match status {
        200 => "OK",
        202 => "Accepted",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        409 => "Conflict",
        411 => "Length Required",
        413 => "Content Too Large",
        421 => "Misdirected Request",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        _ => "Bad Request",
    };
    let frame = answer
        .frame
        .map_or(String::new(), |frame| format!("X-Frame: {frame}\r\n"));
    let mut bytes = format!(
        "HTTP/1.1 {status} {reason}\r\nContent-Type: {}\r\nContent-Length: {}\r\n\
         {frame}{PROTECTION}\r\n",
        answer.kind,
        answer.body.len()
    )
    .into_bytes();
    if has_body {
        bytes.extend_from_slice(&answer.body);
    }
    stream.write_all(&bytes)?;
    stream.flush()
}

/// Reports as server-sent events until the client goes or the program ends.
fn events(hub: &Hub, out: &mut dyn Write) -> std::io::Result<()> {
    write!(
        out,
        "HTTP/1.1 200 OK\r\nContent-Type: text/event-stream\r\n{PROTECTION}\r\n"
    )?;
    let mut seen = u64::MAX; // so that the first event comes at once
    while !hub.is_stopping() {
        // Without a new report the old one is repeated, with its age: silence must be seen.
        let view = hub.view_after(seen, PATIENCE);
        seen = view.number;
        // One write, since the stream sends each part of a formatted text by itself.
        out.write_all(format!("data: {}\n\n", view.to_json()).as_bytes())?;
        out.flush()?;
        std::thread::sleep(EVENTS);
    }
    Ok(())
}

/// Whether `a` equals `b`, in a time that does not reveal how many bytes are equal.
fn same(a: &[u8], b: &[u8]) -> bool {
    let mut difference = u8::from(a.len() != b.len());
    for (a, b) in a.iter().zip(b) {
        difference |= a ^ b;
    }
    difference == 0
}

#[cfg(test)]
mod tests;
