//! Rendered flights as a benchmark on disk.
//!
//! `<DIR>/list.txt` names the sequences. Each has its pictures in `color/%08d.jpg`, its boxes in
//! `groundtruth.txt`, and the files of the VOT toolkit beside them: `sequence` describes the
//! format, `anchor.value` marks the starts of multi-start runs (1: forward, -1: backward), and
//! `occlusion.tag` marks frames in which the target is partly hidden.

use crate::error::Error;
use crate::picture::jpeg;
use crate::results::{lines, write_whole};
use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer};
use sequences::Rect;
use std::path::Path;
use std::{fs, io};

/// Least visible share of a target that is annotated. Other frames have NaN as their box, as in
/// UAV123.
const SEEN: f32 = 0.1;
/// Visible share of the target below which it counts as partly hidden.
const HIDDEN: f32 = 0.7;
/// Frames from one start of the multi-start protocol to the next.
const ANCHORS: usize = 25;
/// Quality of the pictures, of 100.
const QUALITY: u8 = 90;

/// The flights of a benchmark.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Flights {
    /// Seed of the first flight; the others have the next seeds.
    pub seed: u64,
    /// Number of flights.
    pub count: usize,
    /// Frames in each flight.
    pub frames: usize,
    /// Width and height in pixels.
    pub size: (usize, usize),
    /// Difficulty of the flights.
    pub difficulty: Difficulty,
}

impl Flights {
    /// Writes the flights below `out` and calls `progress` with a line about each.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, out: &Path, progress: impl Fn(&str)) -> Result<(), Error> {
        let mut names = String::new();
        for seed in (self.seed..).take(self.count) {
            let name = format!("flight{seed}");
            self.write_one(seed, &out.join(&name))?;
            progress(&format!("{name}: {} frames", self.frames));
            names += &format!("{name}\n");
        }
        write_whole(&out.join("list.txt"), &names)
    }

    fn write_one(&self, seed: u64, folder: &Path) -> Result<(), Error> {
        let pictures = folder.join("color");
        fs::create_dir_all(&pictures).map_err(Error::unwritable(&pictures))?;
        let ((width, height), frames) = (self.size, self.frames);
        let config = FlightConfig {
            width,
            height,
            frames,
            seed,
            difficulty: self.difficulty,
            ..Default::default()
        };
        let flight = Flight::new(config);
        let mut frame = FrameBuffer::default();
        let mut boxes = Vec::new();
        let mut anchors = String::new();
        let mut hidden = String::new();
        for i in 0..frames {
            let truth = flight.render(i, &mut frame);
            let path = pictures.join(format!("{:08}.jpg", i + 1));
            let size = (frame.width as u32, frame.height as u32);
            jpeg(&frame.data, size, QUALITY)
                .map_err(io::Error::other)
                .and_then(|bytes| fs::write(&path, bytes))
                .map_err(Error::unwritable(&path))?;
            let (seen, b) = (truth.visible >= SEEN || i == 0, truth.bbox);
            let [x, y, w, h] =
                [b.x, b.y, b.w, b.h].map(|v| if seen { f64::from(v) } else { f64::NAN });
            boxes.push(Rect::new(x, y, w, h));
            anchors += match i % ANCHORS {
                0 if seen && 2 * i < frames => "1\n",
                0 if seen => "-1\n",
                _ => "0\n",
            };
            hidden += if truth.visible < HIDDEN { "1\n" } else { "0\n" };
        }
        let about =
            "channels.color=color/%08d.jpg\nchannel.default=color\nfps=30\nformat=default\n";
        for (file, text) in [
            ("groundtruth.txt", &*lines(&boxes, ",")),
            ("anchor.value", &anchors),
            ("occlusion.tag", &hidden),
            ("sequence", about),
        ] {
            write_whole(&folder.join(file), text)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sequences::{Dataset, Notes};
    use testing::Folder;

    #[test]
    fn rendered_flights_load_as_a_benchmark() {
        let folder = Folder::new("render");
        let flights = Flights {
            seed: 3,
            count: 2,
            frames: 4,
            size: (96, 64),
            difficulty: Difficulty::Easy,
        };
        flights.write(folder.path(), |_| {}).unwrap();
        let mut notes = Notes::default();
        let sequences = Dataset::Folder.load(folder.path(), &mut notes).unwrap();
        assert_eq!((sequences.len(), notes.count()), (2, 0), "{notes}");
        let first = &sequences[0];
        assert_eq!(
            (&first.annotation.name[..], first.frames.len()),
            ("flight3", 4)
        );
        assert!(first.frames[0].ends_with("color/00000001.jpg"));
        assert!(first.annotation.boxes.iter().all(Rect::is_usable));
        let read = |file: &str| fs::read_to_string(folder.path().join(file)).unwrap();
        assert_eq!(read("list.txt"), "flight3\nflight4\n");
        assert_eq!(read("flight4/anchor.value"), "1\n0\n0\n0\n");
    }
}
