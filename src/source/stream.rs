//! Frames that follow each other without files: y4m, PPM or headerless, from a pipe, a file or
//! ffmpeg.

use std::ffi::OsStr;
use std::io::{BufReader, ErrorKind, Read};
use std::process::Command;

use super::header::{Layout, parse_y4m, read_line, read_ppm};
use super::program::{Program, Stopper};
use super::{Image, Input, RawFormat, SourceError, Stretch, ffmpeg, gstreamer};
use kernels::pixels::LumaRange;

/// What stands in front of each frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Container {
    /// Nothing.
    Raw,
    /// A line that starts with `FRAME`.
    Y4m,
    /// `P6`, width, height, 255: frames may change their size.
    Ppm,
}

/// A stream of frames.
pub(super) struct Stream {
    reader: BufReader<Box<dyn Read + Send>>,
    container: Container,
    layout: Option<Layout>, // none until a PPM's first header is read
    signature_read: bool,   // the first PPM's `P6` was consumed to recognize it
    payload: Vec<u8>,       // one frame before its conversion
    stretch: Stretch,       // of 16-bit frames
    frame: usize,           // index of the frame that follows
    label: String,          // the input as given
    decoder: Option<Program>,
    program: &'static str, // the decoder's name
}

impl Stream {
    /// Reads frames of a known raw format, or else recognizes y4m and PPM by their first bytes.
    pub(super) fn from_reader(
        reader: Box<dyn Read + Send>,
        label: &str,
        raw: Option<RawFormat>,
    ) -> Result<Stream, SourceError> {
        let mut stream = Stream::new(reader, label);
        let described = match raw {
            Some(raw) => raw.frame_bytes().map(|_| {
                (
                    Container::Raw,
                    Some(Layout {
                        raw,
                        range: LumaRange::Limited,
                    }),
                )
            }),
            None => stream.recognize(),
        };
        (stream.container, stream.layout) = described.map_err(|reason| stream.wrong(reason))?;
        Ok(stream)
    }

    /// Has `ffmpeg` decode a file or URL.
    pub(super) fn from_ffmpeg(
        location: &OsStr,
        label: &str,
        input: &Input,
    ) -> Result<Stream, SourceError> {
        Self::from_program(OsStr::new("ffmpeg"), location, label, input)
    }

    fn from_program(
        program: &OsStr,
        location: &OsStr,
        label: &str,
        input: &Input,
    ) -> Result<Stream, SourceError> {
        let mut stream = Stream::new(Box::new(std::io::empty()), label);
        let command = ffmpeg::command(program, location, input);
        let command = command.map_err(|reason| stream.wrong(reason))?;
        stream.run("ffmpeg", command, location)?;
        Ok(stream)
    }

    /// Has GStreamer run a pipeline.
    pub(super) fn from_gstreamer(pipeline: &str, label: &str) -> Result<Stream, SourceError> {
        Self::from_launcher(OsStr::new(gstreamer::PROGRAM), pipeline, label)
    }

    fn from_launcher(program: &OsStr, pipeline: &str, label: &str) -> Result<Stream, SourceError> {
        let mut stream = Stream::new(Box::new(std::io::empty()), label);
        let command = gstreamer::command(program, pipeline);
        stream.run(gstreamer::PROGRAM, command, OsStr::new(""))?;
        // Its header is read with the first frame, so that a silent camera can be stopped.
        stream.container = Container::Y4m;
        Ok(stream)
    }

    /// Reads what a program writes.
    fn run(
        &mut self,
        name: &'static str,
        command: Command,
        location: &OsStr,
    ) -> Result<(), SourceError> {
        self.program = name;
        let started = Program::start(command, location);
        let (decoder, pipe) = started.map_err(|reason| self.failed(reason))?;
        self.reader = BufReader::with_capacity(1 << 16, Box::new(pipe));
        self.decoder = Some(decoder);
        Ok(())
    }

    fn failed(&self, reason: String) -> SourceError {
        SourceError::Program {
            input: self.label.clone(),
            program: self.program,
            reason,
        }
    }

    fn new(reader: Box<dyn Read + Send>, label: &str) -> Stream {
        Stream {
            reader: BufReader::with_capacity(1 << 16, reader),
            container: Container::Ppm,
            layout: None,
            signature_read: false,
            payload: Vec::new(),
            stretch: Stretch::default(),
            frame: 0,
            label: label.to_string(),
            decoder: None,
            program: "",
        }
    }

    /// What ends a blocked read from another thread.
    pub(super) fn stopper(&self) -> Option<Stopper> {
        self.decoder.as_ref().map(Program::stopper)
    }

    /// The next frame, in `buffer`; `None` at the end.
    pub(super) fn next(&mut self, buffer: Vec<u8>) -> Result<Option<Image>, SourceError> {
        let image = self.read(Some(buffer))?;
        Ok(image.flatten())
    }

    /// Passes over one frame without converting it; `false` at the end.
    pub(super) fn skip(&mut self) -> Result<bool, SourceError> {
        Ok(self.read(None)?.is_some())
    }

    /// Reads one frame, and makes an image of it where there is a buffer for it.
    fn read(&mut self, buffer: Option<Vec<u8>>) -> Result<Option<Option<Image>>, SourceError> {
        let image = self.read_header().and_then(|layout| match layout {
            Some(layout) => self.read_payload(layout, buffer),
            None => Ok(None),
        });
        let failure = match (&image, self.decoder.take()) {
            (Ok(Some(_)), decoder) => {
                self.decoder = decoder;
                None
            }
            (Ok(None), decoder) => decoder.and_then(|decoder| decoder.finish().err()),
            (Err(reason), decoder) => decoder.map(|decoder| decoder.abort(reason)),
        };
        if let Some(reason) = failure {
            return Err(self.failed(reason));
        }
        self.frame += 1;
        image.map_err(|reason| self.wrong(reason))
    }

    fn wrong(&self, reason: String) -> SourceError {
        SourceError::Format {
            input: self.label.clone(),
            reason,
        }
    }

    /// Container and layout from the first bytes.
    fn recognize(&mut self) -> Result<(Container, Option<Layout>), String> {
        let mut start = [0; 2];
        let found = read_full(&mut self.reader, &mut start)?;
        match &start[..found] {
            b"P6" => {
                self.signature_read = true;
                Ok((Container::Ppm, None))
            }
            b"YU" => {
                let line = read_line(&mut self.reader)?.unwrap_or_default();
                let parameters = line
                    .strip_prefix("V4MPEG2")
                    .ok_or("expected a y4m header: YUV4MPEG2 ...")?;
                let layout = parse_y4m(parameters)?;
                layout.raw.frame_bytes()?;
                Ok((Container::Y4m, Some(layout)))
            }
            [] => Err("no frame in it".into()),
            other => Err(format!(
                "starts with the bytes {other:02x?}, expected y4m (YUV4MPEG2), PPM (P6), or the \
                 size and pixel format of headerless frames (--raw WxH --pix FORMAT)"
            )),
        }
    }

    /// What stands in front of the next frame; `None` at the end.
    fn read_header(&mut self) -> Result<Option<Layout>, String> {
        match self.container {
            Container::Raw => {}
            Container::Y4m if self.layout.is_none() => {
                (self.container, self.layout) = self.recognize()?;
                return self.read_header();
            }
            Container::Y4m => match read_line(&mut self.reader).map_err(|e| self.in_frame(&e))? {
                None => return Ok(None),
                Some(line) if line.starts_with("FRAME") => {}
                Some(line) => {
                    let start: String = line.chars().take(16).collect();
                    return Err(self.in_frame(&format!("starts with {start:?}, expected FRAME")));
                }
            },
            Container::Ppm => {
                let mut signature = *b"P6";
                if !std::mem::take(&mut self.signature_read) {
                    match read_full(&mut self.reader, &mut signature)? {
                        0 => return Ok(None),
                        2 if &signature == b"P6" => {}
                        found => {
                            let found = &signature[..found];
                            return Err(
                                self.in_frame(&format!("starts with {found:02x?}, expected P6"))
                            );
                        }
                    }
                }
                self.layout = Some(read_ppm(&mut self.reader).map_err(|e| self.in_frame(&e))?);
            }
        }
        Ok(self.layout)
    }

    fn read_payload(
        &mut self,
        layout: Layout,
        buffer: Option<Vec<u8>>,
    ) -> Result<Option<Option<Image>>, String> {
        let expected = layout.raw.frame_bytes()?;
        // Frames that need no conversion are read right into their buffer.
        let ready = layout.raw.ready(layout.range);
        let is_wanted = buffer.is_some();
        let mut data = buffer.unwrap_or_default();
        let payload = if is_wanted && ready.is_some() {
            &mut data
        } else {
            &mut self.payload
        };
        payload.resize(expected, 0);
        let found = read_full(&mut self.reader, payload)?;
        if found == 0 && self.container == Container::Raw {
            return Ok(None);
        }
        if found < expected {
            return Err(self.in_frame(&format!("ends after {found} of {expected} bytes")));
        }
        if !is_wanted {
            return Ok(Some(None));
        }
        let order = match ready {
            Some(order) => order,
            None => {
                let range = layout.range;
                layout
                    .raw
                    .convert(range, &self.payload, &mut self.stretch, &mut data)
            }
        };
        Ok(Some(Some(Image {
            data,
            width: layout.raw.width,
            height: layout.raw.height,
            order,
            name: None,
        })))
    }

    fn in_frame(&self, what: &str) -> String {
        format!("frame {} {what}", self.frame)
    }
}

/// Fills `buffer` as far as the stream goes and says how far that was.
fn read_full(reader: &mut impl Read, buffer: &mut [u8]) -> Result<usize, String> {
    let mut filled = 0;
    while filled < buffer.len() {
        match reader.read(&mut buffer[filled..]) {
            Ok(0) => break,
            Ok(n) => filled += n,
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(error) => return Err(error.to_string()),
        }
    }
    Ok(filled)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::ChannelOrder;
    use crate::source::PixelFormat;

    fn open(bytes: Vec<u8>, raw: Option<RawFormat>) -> Result<Stream, SourceError> {
        Stream::from_reader(Box::new(std::io::Cursor::new(bytes)), "-", raw)
    }

    #[test]
    fn raw_frame_cut_short_is_an_error_after_the_whole_ones() {
        let raw = RawFormat::new(2, 2, PixelFormat::Bgr24);
        let mut stream = open((0..30).collect(), Some(raw)).unwrap();
        assert!(stream.skip().unwrap());
        let image = stream.next(vec![7; 99]).unwrap().unwrap();
        assert_eq!(
            (image.data, image.order),
            ((12..24).collect(), ChannelOrder::Bgr)
        );
        let message = stream.next(Vec::new()).unwrap_err().to_string();
        assert!(
            message.contains("frame 2 ends after 6 of 12 bytes"),
            "{message}"
        );
        let mut whole = open(vec![0; 24], Some(raw)).unwrap();
        assert!(whole.next(Vec::new()).unwrap().is_some() && whole.skip().unwrap());
        assert!(whole.next(Vec::new()).unwrap().is_none());
    }

    #[test]
    fn y4m_frames_are_read_with_and_without_parameters() {
        let bytes = b"YUV4MPEG2 W2 H2 F25:1 Cmono\nFRAME\nabcdFRAME Ip\nefgh".to_vec();
        let mut stream = open(bytes, None).unwrap();
        assert_eq!(stream.next(Vec::new()).unwrap().unwrap().data, b"abcd");
        let second = stream.next(Vec::new()).unwrap().unwrap();
        assert_eq!(
            (second.data.as_slice(), second.order),
            (&b"efgh"[..], ChannelOrder::Gray)
        );
        assert!(stream.next(Vec::new()).unwrap().is_none());
    }

    #[test]
    fn ppm_frames_may_change_their_size() {
        let bytes = b"P6\n1 1\n255\nabcP6 2 1 255\nabcdef".to_vec();
        let mut stream = open(bytes, None).unwrap();
        let sizes: Vec<_> = std::iter::from_fn(|| stream.next(Vec::new()).unwrap())
            .map(|image| (image.width, image.height, image.data.len()))
            .collect();
        assert_eq!(sizes, [(1, 1, 3), (2, 1, 6)]);
    }

    #[test]
    fn stream_of_unknown_form_is_refused_with_its_first_bytes() {
        let cases: [(&[u8], &str); 9] = [
            (b"", "no frame"),
            (b"\x89PNG", "89, 50"),
            (b"YU", "YUV4MPEG2"),
            (b"YUV4MPEG2 W2", "ends after"),
            (b"YUV4MPEG2 W2 H0\n", "2x0"),
            (b"YUV4MPEG2 W2 H2 Cmono\nJUNK\nabcd", "JUNK"),
            (b"YUV4MPEG2 W2 H2 Cmono\nFRAME\nabc", "3 of 4"),
            (b"P6 99999 1 255\n", "99999x1"),
            (b"P6 1 1 255\nabcP5", "50, 35"),
        ];
        for (bytes, part) in cases {
            let message = match open(bytes.to_vec(), None) {
                Err(error) => error.to_string(),
                Ok(mut stream) => loop {
                    match stream.next(Vec::new()) {
                        Ok(image) => assert!(image.is_some(), "{part}: ended without an error"),
                        Err(error) => break error.to_string(),
                    }
                },
            };
            assert!(message.contains(part), "{part}: {message}");
        }
    }

    /// A shell script in the place of ffmpeg. One test only, so that no other process holds the
    /// file while it starts.
    #[cfg(unix)]
    #[test]
    fn ffmpeg_that_fails_is_an_error_with_its_last_words() {
        use std::os::unix::fs::PermissionsExt;
        let program = std::env::temp_dir().join(format!("track-cpu-ffmpeg-{}", std::process::id()));
        let input = Input::new("clip.mp4");
        let frame = "printf 'P6\\n1 1\\n255\\nabc'; ";
        for (script, frames, part) in [
            (format!("{frame}{frame}"), 2, None),
            ("exit 0".into(), 0, None),
            (
                format!("{frame}echo partial file >&2"),
                1,
                Some("ffmpeg reported damage, and frames may be missing:\npartial file"),
            ),
            (
                format!("{frame}echo one >&2; echo two >&2; exit 3"),
                1,
                Some("ffmpeg failed (exit status: 3):\none\ntwo"),
            ),
            ("exit 4".into(), 0, Some("ffmpeg failed (exit status: 4)")),
            (
                format!("{frame}echo why >&2; printf 'P6 1 1 255\\na'; exit 1"),
                1,
                Some("frame 1 ends after 1 of 3 bytes:\nwhy"),
            ),
            (
                format!("{frame}while :; do echo junk; done"),
                1,
                Some("expected P6"),
            ),
            (
                format!("{frame}seq 1 100000 >&2; exit 1"),
                1,
                Some("\n99999\n100000"),
            ),
        ] {
            std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
            std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
            let mut stream = Stream::from_program(
                program.as_os_str(),
                OsStr::new("clip.mp4"),
                "clip.mp4",
                &input,
            )
            .unwrap();
            for _ in 0..frames {
                assert_eq!(
                    stream.next(Vec::new()).unwrap().unwrap().data,
                    b"abc",
                    "{script}"
                );
            }
            match (stream.next(Vec::new()), part) {
                (Ok(None), None) => {}
                (Err(error), Some(part)) => {
                    let message = error.to_string();
                    assert!(
                        message.starts_with("clip.mp4: ffmpeg") && message.contains(part),
                        "{script}: {message}"
                    );
                    assert!(message.len() < 1200, "{script}: {} bytes", message.len());
                }
                (found, _) => panic!("{script}: {found:?}"),
            }
        }
        std::fs::remove_file(&program).unwrap();
        let missing =
            Stream::from_program(program.as_os_str(), OsStr::new("a"), "a", &input).map(|_| ());
        assert!(
            missing
                .unwrap_err()
                .to_string()
                .contains("not found: install it")
        );
    }
}
