//! The video with boxes burned in, encoded into a file or stream by the ffmpeg that the user has
//! installed.
//!
//! A thread of its own draws and writes. A frame for which it is not ready is dropped and counted,
//! unless every frame is wanted. ffmpeg reads the frames from a pipe, so it ends with this program.

use std::ffi::OsString;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use image::{RgbImage, imageops};

use crate::error::Error;
use crate::hub::lock;
use crate::picture::Picture;
use crate::report::Report;
use crate::say::{self, say};

/// Frames that may wait to be drawn.
const MAX_WAITING: usize = 2;
/// Wait before an encoder that failed is started again: doubled from the first to the second value.
const RETRY: (Duration, Duration) = (Duration::from_secs(1), Duration::from_secs(16));
/// How often a thread without frames checks whether to end.
const TICK: Duration = Duration::from_millis(50);
/// How long an encoder may take to complete a file.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long the last messages may take to be written.
const FLUSH_TIMEOUT: Duration = Duration::from_millis(500);
/// Files of one name.
const MAX_FILES: usize = 10_000;
/// Most characters of an encoder's last error that are reported.
const MAX_ERROR: usize = 300;

/// Draws what is known of a frame into a copy of it.
pub type Draw = fn(&Picture, &Report) -> RgbImage;

/// Options of the video.
#[derive(Clone, Debug)]
pub struct FilmOptions {
    /// Where to.
    pub output: Output,
    /// Frames per second.
    pub rate: f64,
    /// Whether every frame is written, at the rate and not when it comes. Adding one may then
    /// block.
    pub every: bool,
    /// ffmpeg's options for encoder and output; empty for H.264 without delay.
    pub args: Vec<String>,
    /// The function that draws the boxes.
    pub draw: Draw,
    /// Makes the command that runs ffmpeg, without arguments.
    pub ffmpeg: fn() -> Command,
}

/// Where the video goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Output {
    /// A file. An existing one is kept, and the new one gets a number.
    File(PathBuf),
    /// A stream.
    Stream {
        /// Its address.
        url: String,
        /// ffmpeg's name of its format.
        format: &'static str,
    },
}

impl Output {
    /// A file, or a stream of a known scheme: `rtp`, `rtsp`, `udp`, `srt`, `tcp` or `rtmp`.
    ///
    /// # Errors
    /// If the scheme is another one, or an RTP address has no port.
    pub fn parse(text: &str) -> Result<Output, String> {
        let Some((scheme, rest)) = text.split_once("://") else {
            return Ok(Output::File(text.into()));
        };
        let format = match scheme {
            "rtp" => "rtp",
            "rtsp" => "rtsp",
            "udp" | "srt" | "tcp" => "mpegts",
            "rtmp" => "flv",
            _ => return Err("expected a file, rtp://, rtsp://, udp://, srt:// or rtmp://".into()),
        };
        if format == "rtp" && port(rest).is_none() {
            return Err("expected rtp://HOST:PORT".into());
        }
        Ok(Output::Stream {
            url: text.into(),
            format,
        })
    }

    /// Where ground stations find the video, in MAVLink's terms: the address of a server, or the
    /// port at which they must listen.
    pub fn announced(&self) -> Option<String> {
        let Output::Stream { url, format } = self else {
            return None;
        };
        let (scheme, rest) = url.split_once("://")?;
        match *format {
            "rtp" => port(rest).map(|port| port.to_string()),
            "rtsp" => Some(url.clone()),
            _ if scheme == "udp" => port(rest).map(|port| format!("mpegts://0.0.0.0:{port}")),
            _ => None,
        }
    }
}

/// The port of `HOST:PORT/...?...`.
fn port(rest: &str) -> Option<u16> {
    let host = rest.split(['/', '?']).next()?;
    host.rsplit_once(':')?
        .1
        .parse()
        .ok()
        .filter(|port| *port > 0)
}

/// One frame to draw.
struct Job {
    picture: Picture,
    report: Report,
}

/// What the threads share.
#[derive(Default)]
struct Shared {
    encoder: Mutex<Option<Encoder>>,
    written: AtomicU64,
    is_ending: AtomicBool,
    failure: Mutex<Option<String>>, // the last one since a frame was written
}

/// A running ffmpeg, and the thread that reads its standard error and returns the end of it.
struct Encoder {
    child: Child,
    errors: JoinHandle<Vec<u8>>,
}

/// A video that is being written.
pub struct Film {
    jobs: SyncSender<Job>,
    thread: JoinHandle<()>,
    shared: Arc<Shared>,
    file: Option<PathBuf>,
    every: bool,
    dropped: u64,
}

impl Film {
    /// Starts the thread. It passes each picture to `recycle` once it is drawn.
    ///
    /// # Errors
    /// If the file cannot be created.
    pub fn start(
        options: FilmOptions,
        recycle: impl Fn(Picture) + Send + 'static,
    ) -> Result<Film, Error> {
        let mut file = None;
        let target = match &options.output {
            Output::File(path) => {
                let path = free_path(path).map_err(|error| {
                    Error::output(format!("--video-out {}", path.display()), error)
                })?;
                say!("video: {}", path.display());
                let mut target = OsString::from("file:");
                target.push(&path);
                file = Some(path);
                target
            }
            Output::Stream { url, .. } => url.into(),
        };
        let (jobs, waiting) = sync_channel(MAX_WAITING);
        let shared = Arc::<Shared>::default();
        let every = options.every;
        let writer = Writer {
            options,
            target,
            shared: Arc::clone(&shared),
            recycle: Box::new(recycle),
            size: None,
            retry: Instant::now(),
            wait: RETRY.0,
            is_hopeless: false,
        };
        let thread = std::thread::spawn(move || writer.run(&waiting));
        Ok(Film {
            jobs,
            thread,
            shared,
            file,
            every,
            dropped: 0,
        })
    }

    /// Queues a frame to be drawn and written. Returns the picture if there is no room for it.
    pub fn add(&mut self, picture: Picture, report: Report) -> Option<Picture> {
        let job = Job { picture, report };
        if self.every {
            return self.jobs.send(job).err().map(|unsent| unsent.0.picture);
        }
        match self.jobs.try_send(job) {
            Ok(()) => None,
            Err(TrySendError::Full(job) | TrySendError::Disconnected(job)) => {
                self.dropped += 1;
                Some(job.picture)
            }
        }
    }

    /// Completes the video and ends its encoder. Unless every frame is wanted, an encoder that
    /// takes too long is killed.
    ///
    /// # Errors
    /// If the last frames are not in the video, or none are.
    pub fn finish(self) -> Result<(), String> {
        self.shared.is_ending.store(!self.every, Ordering::Relaxed);
        drop(self.jobs);
        let until = Instant::now() + PATIENCE;
        while !self.thread.is_finished() && (self.every || Instant::now() < until) {
            std::thread::sleep(Duration::from_millis(10));
        }
        if let Some(encoder) = lock(&self.shared.encoder).as_mut() {
            let _ = encoder.child.kill(); // an error means that it has ended
            let _ = encoder.child.wait();
        }
        let written = self.shared.written.load(Ordering::Relaxed);
        if let Some(file) = self.file.filter(|_| written == 0) {
            let _ = std::fs::remove_file(file); // it only kept the name
        }
        say!("video: {written} frames, {} dropped", self.dropped);
        say::flush(FLUSH_TIMEOUT); // the program may end now
        lock(&self.shared.failure).take().map_or(Ok(()), Err)
    }
}

/// The thread that draws the frames and writes them to the encoder.
struct Writer {
    options: FilmOptions,
    target: OsString,
    shared: Arc<Shared>,
    recycle: Box<dyn Fn(Picture) + Send>,
    size: Option<(usize, usize)>, // that of the first frame, which all others get
    retry: Instant,
    wait: Duration,
    is_hopeless: bool, // a failed file: starting it again would overwrite it
}

impl Writer {
    fn run(mut self, jobs: &Receiver<Job>) {
        let mut pipe = None;
        loop {
            let job = match jobs.recv_timeout(TICK) {
                Ok(job) => job,
                Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => break,
            };
            let is_wanted = !self.is_hopeless && !self.shared.is_ending.load(Ordering::Relaxed);
            if pipe.is_none() && is_wanted && Instant::now() >= self.retry {
                pipe = self.start(job.picture.size());
            }
            if let Some(open) = &mut pipe {
                let image = self.image(&job);
                // A blocked write ends when the encoder is killed.
                if let Err(error) = open.write_all(image.as_raw()) {
                    pipe = None;
                    self.give_up(&error.to_string());
                } else {
                    self.shared.written.fetch_add(1, Ordering::Relaxed);
                    *lock(&self.shared.failure) = None;
                    self.wait = RETRY.0;
                }
            }
            (self.recycle)(job.picture);
        }
        // The end of its input makes the encoder complete the video.
        drop(pipe);
        self.wait_for_encoder();
    }

    /// The frame as drawn, in the size of the first one.
    fn image(&self, job: &Job) -> RgbImage {
        let image = (self.options.draw)(&job.picture, &job.report);
        match self.size {
            Some((w, h)) if image.dimensions() != (w as u32, h as u32) => {
                imageops::thumbnail(&image, w as u32, h as u32)
            }
            _ => image,
        }
    }

    /// Starts an encoder for frames of the first frame's size.
    fn start(&mut self, size: (usize, usize)) -> Option<impl Write + use<>> {
        let size = *self.size.get_or_insert(size);
        let mut child = match self.command(size).spawn() {
            Ok(child) => child,
            Err(error) => {
                let reason = match error.kind() {
                    ErrorKind::NotFound => "ffmpeg is needed, but was not found".into(),
                    _ => format!("ffmpeg could not be started: {error}"),
                };
                self.fail(&reason);
                return None;
            }
        };
        let pipe = child.stdin.take();
        let errors = child.stderr.take();
        let errors = std::thread::spawn(move || errors.map(read_last).unwrap_or_default());
        *lock(&self.shared.encoder) = Some(Encoder { child, errors });
        pipe
    }

    /// ffmpeg, reading frames of this size from its standard input.
    fn command(&self, size: (usize, usize)) -> Command {
        let mut command = (self.options.ffmpeg)();
        command.args(["-hide_banner", "-loglevel", "error", "-y"]);
        self.add_input(&mut command, size);
        self.add_encoder(&mut command);
        self.add_output(&mut command);
        // The standard output would only get ffmpeg's descriptions of RTP streams.
        command
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        command
    }

    fn add_input(&self, command: &mut Command, (width, height): (usize, usize)) {
        if !self.options.every {
            // Live frames are stamped when they come; ffmpeg then makes the rate constant.
            command.args(["-use_wallclock_as_timestamps", "1"]);
        } else if matches!(self.options.output, Output::Stream { .. }) {
            command.arg("-re"); // reads no faster than the rate, as a viewer wants it
        }
        command.args(["-f", "rawvideo", "-pix_fmt", "rgb24"]);
        command.args(["-s", &format!("{width}x{height}")]);
        command.args(["-framerate", &self.options.rate.to_string()]);
        command.args(["-i", "pipe:0"]);
    }

    fn add_encoder(&self, command: &mut Command) {
        // Most encoders want even sides.
        command.args(["-an", "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"]);
        command.args(["-r", &self.options.rate.to_string()]);
        if self.options.args.is_empty() {
            command.args(["-c:v", "libx264", "-preset", "ultrafast"]);
            command.args(["-tune", "zerolatency", "-pix_fmt", "yuv420p"]);
            let key_frames = self.options.rate.ceil().to_string(); // one a second
            command.args(["-g", &key_frames]);
        }
        command.args(&self.options.args);
    }

    fn add_output(&self, command: &mut Command) {
        match &self.options.output {
            Output::File(path) => {
                // A file that ends in a crash or with the battery can still be played.
                let is_mp4 = path
                    .extension()
                    .is_some_and(|e| e.eq_ignore_ascii_case("mp4"));
                if is_mp4 {
                    command.args(["-movflags", "+frag_keyframe+empty_moov"]);
                }
            }
            Output::Stream { format, .. } => {
                command.args(["-f", format]);
                if *format == "rtsp" {
                    command.args(["-rtsp_transport", "tcp"]);
                }
            }
        }
        command.arg(&self.target);
    }

    /// Ends an encoder that has closed its input, and reports its last error, or else `error`.
    fn give_up(&mut self, error: &str) {
        let ended = lock(&self.shared.encoder).take();
        let last = ended.map(last_error).unwrap_or_default();
        let reason = if last.is_empty() { error } else { &last };
        self.fail(&format!("ffmpeg has ended: {reason}"));
    }

    /// Reports a failure and sets the time of the next attempt, if there may be one.
    fn fail(&mut self, reason: &str) {
        if self.shared.is_ending.load(Ordering::Relaxed) {
            return;
        }
        self.is_hopeless = matches!(self.options.output, Output::File(_));
        self.retry = Instant::now() + self.wait;
        let consequence = if self.is_hopeless {
            "tracking continues without it".into()
        } else {
            format!("trying again in {} s", self.wait.as_secs())
        };
        self.wait = (2 * self.wait).min(RETRY.1);
        say!("video: {reason}; {consequence}");
        *lock(&self.shared.failure) = Some(reason.into());
    }

    /// Waits until the encoder ends, and reports a failure.
    fn wait_for_encoder(&mut self) {
        // The lock is free between two looks, so that `Film::finish` can kill the encoder.
        loop {
            let mut encoder = lock(&self.shared.encoder);
            match encoder.as_mut().map(|encoder| encoder.child.try_wait()) {
                Some(Ok(None)) => drop(encoder),
                Some(Ok(Some(status))) if !status.success() => {
                    drop(encoder);
                    return self.give_up(&status.to_string());
                }
                _ => return,
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
}

/// Reads to the end, so that the encoder never blocks on it, and returns the last bytes.
fn read_last(mut errors: ChildStderr) -> Vec<u8> {
    let mut kept = Vec::new();
    let mut chunk = [0; 1024];
    while let Ok(count @ 1..) = errors.read(&mut chunk) {
        kept.extend_from_slice(&chunk[..count]);
        let excess = kept.len().saturating_sub(2 * MAX_ERROR);
        kept.drain(..excess);
    }
    kept
}

/// The last line that an encoder wrote to its standard error. Ends the encoder.
fn last_error(mut encoder: Encoder) -> String {
    let _ = encoder.child.kill(); // it may hang after closing its input
    let _ = encoder.child.wait();
    let errors = encoder.errors.join().unwrap_or_default();
    let text = String::from_utf8_lossy(&errors);
    let last = text.lines().rev().find(|line| !line.trim().is_empty());
    let last = last.unwrap_or_default().trim();
    last.chars()
        .map(|c| if c.is_control() { ' ' } else { c })
        .take(MAX_ERROR)
        .collect()
}

/// The path, or one with a number before its extension if there is a file already.
fn free_path(path: &Path) -> std::io::Result<PathBuf> {
    for number in 0..MAX_FILES {
        let candidate = crate::log::numbered(path, number);
        match std::fs::File::create_new(&candidate) {
            Ok(_) => return Ok(candidate),
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(error) => return Err(error),
        }
    }
    let reason = format!("{MAX_FILES} videos of this name are there, expected fewer");
    Err(std::io::Error::other(reason))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Order;

    fn plain(picture: &Picture, _: &Report) -> RgbImage {
        picture.to_rgb()
    }

    #[test]
    fn output_is_a_file_or_a_stream_of_a_known_scheme() {
        let stream = |url: &str, format| {
            Ok(Output::Stream {
                url: url.into(),
                format,
            })
        };
        for (text, expected) in [
            ("flight.mp4", Ok(Output::File("flight.mp4".into()))),
            ("rtp://10.0.0.2:5600", stream("rtp://10.0.0.2:5600", "rtp")),
            ("rtsp://a:8554/live", stream("rtsp://a:8554/live", "rtsp")),
            (
                "udp://10.0.0.2:5600",
                stream("udp://10.0.0.2:5600", "mpegts"),
            ),
        ] {
            assert_eq!(Output::parse(text), expected, "{text}");
        }
        for wrong in ["rtp://10.0.0.2", "rtp://10.0.0.2:0", "gopher://a"] {
            assert!(Output::parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn stream_is_announced_as_ground_stations_reach_it() {
        for (text, expected) in [
            ("rtp://10.0.0.2:5600?ttl=1", Some("5600")),
            (
                "rtsp://10.0.0.9:8554/live",
                Some("rtsp://10.0.0.9:8554/live"),
            ),
            ("udp://10.0.0.2:5600", Some("mpegts://0.0.0.0:5600")),
            ("srt://10.0.0.2:9000", None),
            ("flight.mp4", None),
        ] {
            let announced = Output::parse(text).unwrap().announced();

            assert_eq!(announced.as_deref(), expected, "{text}");
        }
    }

    #[test]
    fn frames_are_dropped_and_counted_where_the_encoder_does_not_keep_up() {
        fn slow(picture: &Picture, _: &Report) -> RgbImage {
            std::thread::sleep(Duration::from_millis(300));
            picture.to_rgb()
        }
        let options = FilmOptions {
            output: Output::parse("rtp://127.0.0.1:9").unwrap(),
            rate: 30.0,
            every: false,
            args: Vec::new(),
            draw: slow,
            ffmpeg: || Command::new("ffmpeg"),
        };
        let picture = Picture {
            data: vec![90; 64 * 48],
            width: 64,
            height: 48,
            order: Order::Gray,
        };
        let mut film = Film::start(options, |_| {}).unwrap();

        let began = Instant::now();
        let returned: Vec<bool> = (0..20)
            .map(|_| film.add(picture.clone(), Report::default()).is_some())
            .collect();
        let took = began.elapsed();

        assert!(
            took < Duration::from_millis(200),
            "tracking waits: {took:?}"
        );
        let dropped = returned.iter().filter(|is_returned| **is_returned).count();
        assert!(dropped >= 15, "{dropped}");
        assert_eq!(film.dropped, dropped as u64);
        let _ = film.finish(); // nobody listens there
    }

    #[test]
    fn earlier_video_is_kept_and_one_without_a_frame_leaves_no_file() {
        let folder = std::env::temp_dir().join(format!("track-cpu-film-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("f.mkv");
        std::fs::write(&path, "earlier").unwrap();
        let options = FilmOptions {
            output: Output::File(path.clone()),
            rate: 30.0,
            every: false,
            args: Vec::new(),
            draw: plain,
            ffmpeg: || Command::new("ffmpeg"),
        };

        let film = Film::start(options, |_| {}).unwrap();
        let is_taken = folder.join("f-1.mkv").exists();
        let finished = film.finish();

        assert_eq!(finished, Ok(()));
        assert_eq!(std::fs::read(&path).unwrap(), b"earlier");
        assert!(is_taken, "the file exists from the start");
        assert!(!folder.join("f-1.mkv").exists());
        std::fs::remove_dir_all(folder).unwrap();
    }
}
