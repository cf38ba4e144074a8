//! One message: a line of text.

use crate::error::Error;
use std::fmt;
use std::io::{BufRead, Read};

/// What every message starts with, at the start of a line.
pub const PREFIX: &str = "@@TRAX:";

/// Longest line that is read, in bytes: a picture of 30 megapixels in memory.
pub const MAX_LINE: usize = 128 << 20;

/// Longest key of a property, in characters.
const MAX_KEY: usize = 64;

/// What a message is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A server says what it is.
    Hello,
    /// A client gives an object, or takes all of them away.
    Initialize,
    /// A client gives a picture.
    Frame,
    /// A server says where an object is.
    State,
    /// Either end ends the session.
    Quit,
}

impl Kind {
    const NAMES: [(Kind, &str); 5] = [
        (Kind::Hello, "hello"),
        (Kind::Initialize, "initialize"),
        (Kind::Frame, "frame"),
        (Kind::State, "state"),
        (Kind::Quit, "quit"),
    ];

    /// Its name in a message.
    pub fn name(self) -> &'static str {
        Kind::NAMES[self as usize].1
    }

    fn from_name(name: &str) -> Option<Kind> {
        Kind::NAMES
            .iter()
            .find(|(_, known)| *known == name)
            .map(|(kind, _)| *kind)
    }
}

/// A message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Message {
    /// What it is about.
    pub kind: Kind,
    /// Its arguments in order.
    pub arguments: Vec<String>,
    /// Its properties in order.
    pub properties: Vec<(String, String)>,
}

impl Message {
    /// A message without arguments.
    pub fn new(kind: Kind) -> Message {
        Message {
            kind,
            arguments: Vec::new(),
            properties: Vec::new(),
        }
    }

    /// The same with one more argument.
    pub fn argument(mut self, argument: impl Into<String>) -> Message {
        self.arguments.push(argument.into());
        self
    }

    /// The same with one more property; the key is of letters, digits, dots and underscores.
    pub fn property(mut self, key: &str, value: impl Into<String>) -> Message {
        self.properties.push((key.into(), value.into()));
        self
    }

    /// The value of a property.
    pub fn get(&self, key: &str) -> Option<&str> {
        self.properties
            .iter()
            .find(|(k, _)| k == key)
            .map(|(_, value)| value.as_str())
    }

    /// The message on a line; `None` if it lacks the prefix of messages.
    ///
    /// # Errors
    /// If a quote does not end or the message is unknown.
    pub fn parse(line: &str) -> Option<Result<Message, Error>> {
        let rest = line.strip_prefix(PREFIX)?;
        Some(words(rest.trim_end_matches(['\r', '\n'])).and_then(Message::of))
    }

    fn of(words: Vec<String>) -> Result<Message, Error> {
        let mut words = words.into_iter();
        let name = words.next().unwrap_or_default();
        let kind = Kind::from_name(&name).ok_or_else(|| {
            Error::part("message", "hello, initialize, frame, state or quit", &name)
        })?;
        let mut message = Message::new(kind);
        for word in words {
            match word.split_once('=').filter(|(key, _)| is_key(key)) {
                Some((key, value)) => message.properties.push((key.into(), value.into())),
                None => message.arguments.push(word),
            }
        }
        Ok(message)
    }
}

impl fmt::Display for Message {
    /// The line without its end, to be written at the start of one.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{PREFIX}{}", self.kind.name())?;
        for argument in &self.arguments {
            write!(f, " \"{}\"", escaped(argument))?;
        }
        for (key, value) in &self.properties {
            let plain = !value.is_empty()
                && !value.contains(|c: char| c.is_whitespace() || c == '"' || c == '\\');
            if plain {
                write!(f, " {key}={value}")?;
            } else {
                write!(f, " \"{key}={}\"", escaped(value))?;
            }
        }
        Ok(())
    }
}

/// The next message of a stream, other lines being passed over; `None` at its end. `line` is room
/// to work in.
///
/// # Errors
/// If the stream breaks, a line is longer than [`MAX_LINE`], or a message is not well formed.
pub fn read(stream: &mut impl BufRead, line: &mut Vec<u8>) -> Result<Option<Message>, Error> {
    read_within(MAX_LINE, stream, line)
}

fn read_within(
    limit: usize,
    stream: &mut impl BufRead,
    line: &mut Vec<u8>,
) -> Result<Option<Message>, Error> {
    loop {
        line.clear();
        stream
            .by_ref()
            .take(limit as u64 + 1)
            .read_until(b'\n', line)?;
        if line.is_empty() {
            return Ok(None);
        }
        if line.len() > limit {
            return Err(Error::TooLong { limit });
        }
        if !line.starts_with(PREFIX.as_bytes()) {
            continue;
        }
        let text = std::str::from_utf8(line)
            .map_err(|_| Error::part("message", "UTF-8", &String::from_utf8_lossy(line)))?;
        if let Some(message) = Message::parse(text) {
            return message.map(Some);
        }
    }
}

/// Splits at white space outside of quotes; a backslash takes the next character as it is, `\n`
/// being a new line.
fn words(text: &str) -> Result<Vec<String>, Error> {
    let (mut words, mut word, mut quoted) = (Vec::new(), None::<String>, false);
    let mut characters = text.chars();
    while let Some(c) = characters.next() {
        match c {
            '\\' => {
                let c = characters
                    .next()
                    .ok_or_else(|| Error::part("message", "a character after \\", text))?;
                word.get_or_insert_default()
                    .push(if c == 'n' { '\n' } else { c });
            }
            '"' => {
                quoted = !quoted;
                word.get_or_insert_default();
            }
            c if c.is_whitespace() && !quoted => words.extend(word.take()),
            c => word.get_or_insert_default().push(c),
        }
    }
    if quoted {
        return Err(Error::part("message", "its quote to end", text));
    }
    words.extend(word);
    Ok(words)
}

fn is_key(text: &str) -> bool {
    let known = |c: char| c.is_ascii_alphanumeric() || c == '.' || c == '_';
    (1..=MAX_KEY).contains(&text.len()) && text.chars().all(known)
}

fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<Message, String> {
        Message::parse(line)
            .expect("a message")
            .map_err(|error| error.to_string())
    }

    #[test]
    fn lines_of_the_reference_client() {
        let message =
            parse("@@TRAX:initialize \"1.0000,2.0000,3.5000,4.0000\" \"k=v w\" \r\n").unwrap();
        assert_eq!(message.kind, Kind::Initialize);
        assert_eq!(message.arguments, ["1.0000,2.0000,3.5000,4.0000"]);
        assert_eq!(message.get("k"), Some("v w"));
        let message = parse("@@TRAX:frame \"file:///tmp/a b=c/1.jpg\" \n").unwrap();
        assert_eq!(
            (&message.arguments[..], message.properties.len()),
            (&["file:///tmp/a b=c/1.jpg".into()][..], 0)
        );
        assert_eq!(
            parse("@@TRAX:initialize \n").unwrap(),
            Message::new(Kind::Initialize)
        );
        assert_eq!(
            parse("@@TRAX:state 1,2,3,4 confidence=0.5")
                .unwrap()
                .get("confidence"),
            Some("0.5")
        );
        assert!(Message::parse("loading @@TRAX:quit").is_none());
    }

    #[test]
    fn any_white_space_in_a_value_is_quoted() {
        for space in [' ', '\t', '\u{b}', '\u{a0}'] {
            let message = Message::new(Kind::Frame).property("m", format!("a{space}b"));
            assert_eq!(parse(&message.to_string()).unwrap(), message);
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let message = Message::new(Kind::Quit)
            .argument("a \"b\" \\ c\nd")
            .argument("")
            .property("trax.reason", "no \"way\"")
            .property("empty", "")
            .property("confidence", "0.5");
        let line = message.to_string();
        assert!(
            !line.contains('\n') && line.ends_with(" confidence=0.5"),
            "{line}"
        );
        assert_eq!(parse(&line).unwrap(), message);
    }

    #[test]
    fn malformed_lines_are_named() {
        for (line, part) in [
            (
                "@@TRAX:",
                "expected hello, initialize, frame, state or quit, found \"\"",
            ),
            ("@@TRAX:jump \"x\"", "found \"jump\""),
            ("@@TRAX:frame \"file:///a", "its quote to end"),
            ("@@TRAX:frame \\", "a character after \\"),
        ] {
            let error = parse(line).unwrap_err();
            assert!(error.contains(part), "{line}: {error}");
        }
        let long = parse(&format!("@@TRAX:{}", "x".repeat(1000))).unwrap_err();
        assert!(long.len() < 250, "{long}");
    }

    #[test]
    fn streams() {
        let mut stream = &b"warming up\n\n@@TRAX:frame a\nmore talk\n@@TRAX:quit"[..];
        let mut line = Vec::new();
        let mut next = || {
            read(&mut stream, &mut line)
                .unwrap()
                .map(|message| message.kind)
        };
        assert_eq!(
            [next(), next(), next()],
            [Some(Kind::Frame), Some(Kind::Quit), None]
        );
        let mut endless = std::io::BufReader::new(std::io::repeat(b'x'));
        let error = read_within(1000, &mut endless, &mut line).unwrap_err();
        assert!(matches!(error, Error::TooLong { limit: 1000 }) && line.len() == 1001);
        let error = read(&mut &b"@@TRAX:frame \xff\n"[..], &mut Vec::new())
            .unwrap_err()
            .to_string();
        assert!(error.contains("UTF-8"), "{error}");
    }
}
