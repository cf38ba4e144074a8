//! Reading an untrusted request within limits of head, body and time.

use std::io::{ErrorKind, Read};
use std::time::{Duration, Instant};

/// Most bytes before the body.
const MAX_HEAD: usize = 8192;
/// Most header lines.
const MAX_HEADERS: usize = 64;
/// Most bytes of a body.
pub const MAX_BODY: usize = 4096;
/// How long a request may take to arrive.
const MAX_TIME: Duration = Duration::from_secs(3);

/// The parts of a request that the server uses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Request {
    /// `GET`, `POST`, or another one.
    pub method: String,
    /// The path without the query.
    pub path: String,
    /// The value of `token` in the query.
    pub query_token: Option<String>,
    /// The header `X-Token`.
    pub token: Option<Vec<u8>>,
    /// The header `Host`.
    pub host: Option<Vec<u8>>,
    /// The whole body.
    pub body: Vec<u8>,
}

/// Why a request was not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// The client has gone.
    Gone,
    /// A status to answer with.
    Status(u16),
}

impl Request {
    /// Reads one request.
    ///
    /// # Errors
    /// Status 400 if it is malformed, 408 if it takes too long, 411 if the length of its body is
    /// unknown, 413 if that is above [`MAX_BODY`], 431 if there is too much before the body.
    pub fn read(stream: &mut impl Read) -> Result<Request, Refusal> {
        let began = Instant::now();
        let mut bytes = Vec::with_capacity(1024);
        let (mut request, length) = loop {
            if let Some((request, head, length)) = parse_head(&bytes)? {
                bytes.drain(..head);
                break (request, length);
            }
            if bytes.len() >= MAX_HEAD {
                return Err(Refusal::Status(431));
            }
            receive(stream, &mut bytes, began)?;
        };
        while bytes.len() < length {
            receive(stream, &mut bytes, began)?;
        }
        bytes.truncate(length);
        request.body = bytes;
        Ok(request)
    }
}

/// Appends what has arrived.
fn receive(stream: &mut impl Read, bytes: &mut Vec<u8>, began: Instant) -> Result<(), Refusal> {
    let mut part = [0; 1024];
    loop {
        if began.elapsed() > MAX_TIME {
            return Err(Refusal::Status(408));
        }
        match stream.read(&mut part) {
            Ok(0) => return Err(Refusal::Gone),
            Ok(count) => {
                bytes.extend_from_slice(&part[..count]);
                return Ok(());
            }
            Err(error) => match error.kind() {
                ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {}
                _ => return Err(Refusal::Gone),
            },
        }
    }
}

/// The request without its body, the bytes up to the body, and the body's length.
///
/// `None` if the head is not whole yet.
fn parse_head(bytes: &[u8]) -> Result<Option<(Request, usize, usize)>, Refusal> {
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    let head = match parsed.parse(bytes) {
        Ok(httparse::Status::Complete(head)) => head,
        Ok(httparse::Status::Partial) => return Ok(None),
        Err(httparse::Error::TooManyHeaders) => return Err(Refusal::Status(431)),
        Err(_) => return Err(Refusal::Status(400)),
    };
    let mut length = 0;
    let mut token = None;
    let mut host = None;
    for header in &*parsed.headers {
        if header.name.eq_ignore_ascii_case("transfer-encoding") {
            return Err(Refusal::Status(411));
        } else if header.name.eq_ignore_ascii_case("content-length") {
            let digits = std::str::from_utf8(header.value)
                .ok()
                .filter(|text| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit()));
            let digits = digits.ok_or(Refusal::Status(400))?;
            length = digits
                .parse()
                .ok()
                .filter(|n| *n <= MAX_BODY)
                .ok_or(Refusal::Status(413))?;
        } else if header.name.eq_ignore_ascii_case("x-token") {
            token = Some(header.value.to_vec());
        } else if header.name.eq_ignore_ascii_case("host") {
            host = Some(header.value.to_vec());
        }
    }
    let whole = parsed.path.unwrap_or_default();
    let (path, query) = whole.split_once('?').unwrap_or((whole, ""));
    let query_token = query
        .split('&')
        .find_map(|pair| pair.strip_prefix("token="));
    let method = parsed.method.unwrap_or_default().to_string();
    Ok(Some((
        Request {
            method,
            path: path.into(),
            query_token: query_token.map(str::to_string),
            token,
            host,
            body: Vec::new(),
        },
        head,
        length,
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Request, Refusal> {
        Request::read(&mut text.as_bytes())
    }

    /// A connection on which one byte arrives at a time.
    struct Slow<'a>(&'a [u8]);

    impl Read for Slow<'_> {
        fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
            let count = self.0.len().min(1);
            out[..count].copy_from_slice(&self.0[..count]);
            self.0 = &self.0[count..];
            Ok(count)
        }
    }

    #[test]
    fn request_is_read_whole_or_byte_by_byte() {
        let text = "POST /start?x=1&token=def HTTP/1.1\r\nHost: a\r\nx-token: abc\r\n\
                    Content-Length: 3\r\n\r\n{ }more";
        let expected = Request {
            method: "POST".into(),
            path: "/start".into(),
            query_token: Some("def".into()),
            token: Some(b"abc".to_vec()),
            host: Some(b"a".to_vec()),
            body: b"{ }".to_vec(),
        };
        assert_eq!(read(text), Ok(expected.clone()));
        assert_eq!(Request::read(&mut Slow(text.as_bytes())), Ok(expected));
    }

    #[test]
    fn malformed_or_large_request_is_refused() {
        let post = |header: &str| format!("POST / HTTP/1.1\r\n{header}\r\n\r\n");
        for (text, status) in [
            ("nonsense\r\n\r\n".to_string(), 400),
            (post("Content-Length: -1"), 400),
            (post("Content-Length: "), 400),
            (post("Content-Length: 4097"), 413),
            (post("Content-Length: 18446744073709551616"), 413),
            (post("Transfer-Encoding: chunked"), 411),
            (post(&"A: b\r\n".repeat(65)), 431),
            (post(&format!("A: {}", "b".repeat(9000))), 431),
        ] {
            assert_eq!(read(&text), Err(Refusal::Status(status)), "{text:.60}");
        }
        assert_eq!(read("GET / HTTP/1.1\r\n"), Err(Refusal::Gone));
        assert_eq!(
            read("POST / HTTP/1.1\r\nContent-Length: 3\r\n\r\n{}"),
            Err(Refusal::Gone)
        );
    }
}
