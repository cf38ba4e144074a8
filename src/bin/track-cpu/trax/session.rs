//! One session: what each message does.

use std::io::{BufRead, Write};

use track_cpu::source::{Decoder, Image, SourceError};
use track_cpu::{BBox, Frame, Model, Tracker, TrackerOptions};
use trax::{Kind, Message, Rectangle, Region};

use super::picture;
use crate::exit::Failure;

/// Most objects that are followed at a time: each takes some tens of megabytes.
const MAX_OBJECTS: usize = 64;

/// From `hello` to `quit`.
pub struct Session<W> {
    model: Model,
    options: TrackerOptions,
    version: u32,
    out: W,
    decoder: Decoder,
    objects: Vec<Object>,
    spare: Vec<Tracker>, // of objects that are no longer followed
}

/// One object and its tracker.
struct Object {
    tracker: Tracker,
    given: Option<Rectangle>, // until the frame that it refers to
}

/// What a message leads to.
enum Next {
    Message,
    End,
}

impl<W: Write> Session<W> {
    /// A session that has not begun.
    pub fn new(model: Model, options: TrackerOptions, version: u32, out: W) -> Session<W> {
        Session {
            model,
            options,
            version,
            out,
            decoder: Decoder::default(),
            objects: Vec::new(),
            spare: Vec::new(),
        }
    }

    /// Says hello and answers messages until the client quits or goes.
    ///
    /// A message that cannot be used ends the session: the client is told why.
    pub fn serve(mut self, messages: &mut impl BufRead) -> Result<(), Failure> {
        let hello = self.hello();
        self.send(&[hello])?;
        let mut line = Vec::new();
        loop {
            let read = trax::read(messages, &mut line).map_err(|error| error.to_string());
            let next = match read {
                Ok(None) => return Ok(()),
                Ok(Some(message)) => self.answer(&message),
                Err(reason) => Err(reason),
            };
            match next {
                Ok((states, Next::Message)) => self.send(&states)?,
                Ok((_, Next::End)) => return Ok(()),
                Err(reason) => {
                    // One line: a client may read our standard error too, and messages start lines.
                    let reason = reason.replace(char::is_control, " ").trim_end().to_string();
                    self.send(&[Message::new(Kind::Quit).property("trax.reason", &reason)])?;
                    return Err(SourceError::Format {
                        input: "TraX client".into(),
                        reason,
                    }
                    .into());
                }
            }
        }
    }

    fn hello(&self) -> Message {
        let hello = Message::new(Kind::Hello)
            .property("trax.version", self.version.to_string())
            .property("trax.name", "track-cpu")
            .property("trax.region", "rectangle;polygon;mask")
            .property("trax.image", "path;memory;data");
        match self.version {
            1 => hello.property("trax.identifier", "track-cpu"),
            3 => hello.property("trax.channels", "color"),
            _ => hello
                .property("trax.channels", "color")
                .property("trax.multiobject", "1"),
        }
    }

    fn answer(&mut self, message: &Message) -> Result<(Vec<Message>, Next), String> {
        let states = match (message.kind, &message.arguments[..]) {
            (Kind::Quit, _) => return Ok((Vec::new(), Next::End)),
            (Kind::Initialize, []) if self.version >= 4 => {
                self.forget();
                Vec::new()
            }
            (Kind::Initialize, [region]) if self.version >= 4 => {
                self.add(region)?;
                Vec::new()
            }
            (Kind::Initialize, [image, region]) if self.version < 4 => {
                self.forget();
                self.add(region)?;
                self.follow(image)?
            }
            (Kind::Frame, _) if self.version < 4 && self.objects.is_empty() => {
                return Err("frame: expected initialize before it, found none".into());
            }
            (Kind::Frame, [image]) => self.follow(image)?,
            (Kind::Hello | Kind::State, _) => {
                return Err(format!(
                    "{}: expected a client's message, found a server's",
                    message.kind.name()
                ));
            }
            (kind, arguments) => {
                let expected = match (kind, self.version) {
                    (Kind::Frame, _) => "one image",
                    (_, 4..) => "a region or nothing",
                    _ => "an image and a region",
                };
                return Err(format!(
                    "{}: expected {expected}, found {} arguments",
                    kind.name(),
                    arguments.len()
                ));
            }
        };
        Ok((states, Next::Message))
    }

    fn forget(&mut self) {
        self.decoder = Decoder::default(); // another video may follow
        self.spare
            .extend(self.objects.drain(..).map(|object| object.tracker));
    }

    fn add(&mut self, region: &str) -> Result<(), String> {
        if self.objects.len() >= MAX_OBJECTS {
            return Err(format!(
                "initialize: expected at most {MAX_OBJECTS} objects, found more"
            ));
        }
        let given = Region::parse(region)
            .map_err(|error| error.to_string())?
            .rectangle();
        let make = || Tracker::with_options(self.model.clone(), self.options);
        let tracker = self.spare.pop().unwrap_or_else(make);
        self.objects.push(Object {
            tracker,
            given: Some(given),
        });
        Ok(())
    }

    /// Where each object is in the next picture.
    fn follow(&mut self, image: &str) -> Result<Vec<Message>, String> {
        let image: Image = picture::decode(&mut self.decoder, image)?;
        let frame = Frame::new(&image.data, image.width, image.height, image.order)
            .map_err(|error| format!("image: {error}"))?;
        self.objects
            .iter_mut()
            .map(|object| object.state(&frame))
            .collect()
    }

    /// Writes messages whole and at once: a client reads them as they come.
    fn send(&mut self, messages: &[Message]) -> Result<(), Failure> {
        let text: String = messages
            .iter()
            .map(|message| format!("{message}\n"))
            .collect();
        let sent = self
            .out
            .write_all(text.as_bytes())
            .and_then(|()| self.out.flush());
        sent.map_err(|error| Failure::stdout(&error))
    }
}

impl Object {
    fn state(&mut self, frame: &Frame<'_>) -> Result<Message, String> {
        let (found, score) = match self.given.take() {
            Some(given) => {
                let Rectangle { x, y, w, h } = given;
                let bbox = BBox::new(x as f32, y as f32, w as f32, h as f32);
                self.tracker
                    .init(frame, bbox)
                    .map_err(|error| format!("region: {error}"))?;
                (given, 1.0)
            }
            None => {
                let track = self
                    .tracker
                    .update(frame)
                    .map_err(|error| error.to_string())?;
                let BBox { x, y, w, h } = track.bbox;
                (
                    Rectangle::new(x.into(), y.into(), w.into(), h.into()),
                    track.score,
                )
            }
        };
        let state = Message::new(Kind::State).argument(found.to_string());
        Ok(state.property("confidence", format!("{score:.6}")))
    }
}
