//! Where live frames come from. Each source runs on its own thread and fills the [`Slot`]; cameras and streams that fail are
//! opened again.

use std::path::Path;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer};
use track_cpu::ChannelOrder;
use track_cpu::source::{Image, Input, LIVE_SCHEMES, RawFormat, Source};

use super::slot::{Shot, Slot};

/// Wait before a failed source is opened again: doubled from the first to the second value.
const RETRY: (Duration, Duration) = (Duration::from_millis(250), Duration::from_secs(4));

/// What to open.
#[derive(Clone, Debug)]
pub enum Feed {
    /// A V4L2 device with the size asked of it.
    Camera(std::path::PathBuf, Option<(usize, usize)>),
    /// A stream at its own pace, opened again when it ends: a URL.
    Stream(Input),
    /// Something that ends: files at a pace, pipes at their own.
    Once(Input, bool),
    /// A rendered flight.
    Rendered(FlightConfig),
}

impl Feed {
    /// Decides by the look of an input.
    ///
    /// # Errors
    /// If it is a flight that is not described well.
    pub fn new(
        input: &Path,
        raw: Option<RawFormat>,
        camera_size: Option<(usize, usize)>,
    ) -> Result<Feed, String> {
        let text = input.to_string_lossy();
        if let Some(flight) = text.strip_prefix("flight:") {
            return Ok(Feed::Rendered(parse_flight(flight)?));
        }
        if text.starts_with("/dev/video") {
            return Ok(Feed::Camera(input.to_path_buf(), camera_size));
        }
        let source = Input {
            raw,
            ..Input::new(input)
        };
        if LIVE_SCHEMES
            .iter()
            .chain(&["http://", "https://"])
            .any(|scheme| text.starts_with(scheme))
        {
            return Ok(Feed::Stream(source));
        }
        let piped =
            text == "-" || std::fs::metadata(input).is_ok_and(|m| !m.is_file() && !m.is_dir());
        Ok(Feed::Once(source, !piped))
    }

    /// Whether it can be read again from its beginning, frame by frame the same.
    pub fn repeats(&self) -> bool {
        matches!(self, Feed::Rendered(_) | Feed::Once(_, true))
    }

    /// Starts the thread.
    pub fn start(self, fps: f64, every: bool, slot: Arc<Slot>) -> JoinHandle<()> {
        std::thread::spawn(move || {
            let mut filler = Filler {
                slot: &slot,
                index: 0,
                every,
                pace: None,
            };
            let period = Duration::from_secs_f64(1.0 / fps);
            let ended = match &self {
                Feed::Camera(path, size) => filler.again(|f| super::camera::run(path, *size, f)),
                Feed::Stream(input) => filler.again(|f| once(input, f)),
                Feed::Once(input, paced) => {
                    filler.pace = paced.then(|| Pace::new(period));
                    once(input, &mut filler)
                }
                Feed::Rendered(config) => {
                    filler.pace = Some(Pace::new(period));
                    rendered(config, &mut filler)
                }
            };
            slot.end(ended.err());
        })
    }
}

/// Puts frames into the slot with their index and time.
pub struct Filler<'a> {
    slot: &'a Slot,
    index: u64,
    every: bool,
    pace: Option<Pace>,
}

impl Filler<'_> {
    /// A picture whose buffer can be used.
    pub fn spare(&self) -> Vec<u8> {
        self.slot
            .spare()
            .map(|image| image.data)
            .unwrap_or_default()
    }

    /// Hands a frame over; `false` if nobody wants frames any more.
    pub fn put(&mut self, image: Image) -> bool {
        if let Some(pace) = self.pace.as_mut().filter(|_| !self.every) {
            pace.wait();
        }
        let shot = Shot {
            image,
            index: self.index,
            taken: Instant::now(),
        };
        self.index += 1;
        self.slot.put(shot, self.every)
    }

    /// Opens a source again and again until nobody wants its frames.
    fn again(&mut self, run: impl Fn(&mut Self) -> Result<(), String>) -> Result<(), String> {
        let mut wait = RETRY.0;
        loop {
            let before = self.index;
            let reason = run(self).err().unwrap_or_else(|| "ended".into());
            if self.slot.is_closed() {
                return Ok(());
            }
            if self.index > before {
                wait = RETRY.0; // it worked for a while
            }
            eprintln!("source: {reason}; trying again in {} ms", wait.as_millis());
            let until = Instant::now() + wait;
            while Instant::now() < until && !self.slot.is_closed() {
                std::thread::sleep(Duration::from_millis(50));
            }
            wait = (2 * wait).min(RETRY.1);
        }
    }
}

/// Frames at even times.
struct Pace {
    period: Duration,
    next: Instant,
}

impl Pace {
    fn new(period: Duration) -> Pace {
        Pace {
            period,
            next: Instant::now(),
        }
    }

    fn wait(&mut self) {
        let now = Instant::now();
        std::thread::sleep(self.next.saturating_duration_since(now));
        // Whoever comes late does not hurry to catch up.
        self.next = self.next.max(now) + self.period;
    }
}

fn once(input: &Input, filler: &mut Filler<'_>) -> Result<(), String> {
    let mut source = Source::open(input).map_err(|error| error.to_string())?;
    while let Some(image) = source.next() {
        if let Some(spare) = filler.slot.spare() {
            source.recycle(spare);
        }
        if !filler.put(image.map_err(|error| error.to_string())?) {
            break;
        }
    }
    Ok(())
}

fn rendered(config: &FlightConfig, filler: &mut Filler<'_>) -> Result<(), String> {
    let flight = Flight::new(config.clone());
    let mut buffer = FrameBuffer::default();
    if let Some(pace) = &mut filler.pace {
        pace.next = Instant::now();
    }
    for index in 0..flight.len() {
        buffer.data = filler.spare();
        flight.render(index, &mut buffer);
        let FrameBuffer { width, height, .. } = buffer;
        let data = std::mem::take(&mut buffer.data);
        if !filler.put(Image {
            data,
            width,
            height,
            order: ChannelOrder::Rgb,
            name: None,
        }) {
            break;
        }
    }
    Ok(())
}

/// Reads `seed=3,difficulty=hard,size=640x360,frames=300`, each part optional.
pub fn parse_flight(text: &str) -> Result<FlightConfig, String> {
    let mut config = FlightConfig {
        frames: 18_000,
        ..FlightConfig::default()
    };
    for part in text.split(',').filter(|part| !part.is_empty()) {
        let (key, value) = part.split_once('=').unwrap_or((part, ""));
        let wrong = |expected: &str| format!("flight: {key} is {value:?}, expected {expected}");
        let number = |most: usize| {
            let number = value
                .parse::<usize>()
                .ok()
                .filter(|n| (1..=most).contains(n));
            number.ok_or_else(|| wrong(&format!("a whole number from 1 to {most}")))
        };
        match key {
            "seed" => config.seed = value.parse().map_err(|_| wrong("a whole number"))?,
            "frames" => config.frames = number(10_000_000)?,
            "difficulty" => {
                config.difficulty = match value {
                    "easy" => Difficulty::Easy,
                    "medium" => Difficulty::Medium,
                    "hard" => Difficulty::Hard,
                    _ => return Err(wrong("easy, medium or hard")),
                };
            }
            "size" => {
                let sides = value
                    .split_once('x')
                    .and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
                let fits =
                    |&(w, h): &(usize, usize)| (64..=8192).contains(&w) && (64..=8192).contains(&h);
                (config.width, config.height) = sides
                    .filter(fits)
                    .ok_or_else(|| wrong("WIDTHxHEIGHT, sides from 64 to 8192"))?;
            }
            _ => {
                return Err(format!(
                    "flight: {key:?}, expected seed, difficulty, size or frames"
                ));
            }
        }
    }
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flights_are_described_in_words() {
        let config = parse_flight("seed=3,difficulty=hard,size=320x180,frames=40").unwrap();
        assert_eq!(
            (config.seed, config.width, config.height, config.frames),
            (3, 320, 180, 40)
        );
        assert_eq!(config.difficulty, Difficulty::Hard);
        assert!(parse_flight("").is_ok());
        for bad in [
            "seed=x",
            "size=1x1",
            "size=9",
            "frames=0",
            "color=red",
            "difficulty=mad",
        ] {
            assert!(parse_flight(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn inputs_are_told_apart() {
        let feed = |text: &str| Feed::new(Path::new(text), None, None).unwrap();
        assert!(matches!(feed("/dev/video2"), Feed::Camera(..)));
        assert!(matches!(feed("rtsp://a/b"), Feed::Stream(_)));
        assert!(matches!(feed("-"), Feed::Once(_, false)));
        assert!(matches!(feed("clip.mp4"), Feed::Once(_, true)));
        assert!(feed("flight:seed=1").repeats() && !feed("/dev/video0").repeats());
    }
}
