//! Frames that lie ready: rendered, in memory or as pictures on disk.

use std::path::{Path, PathBuf};

use image::codecs::jpeg::JpegEncoder;
use scenes::{Flight, FlightConfig, FrameBuffer};
use track_cpu::{BBox, ChannelOrder, Frame, FrameError};

use crate::exit::Failure;

/// Distinct frames; they are played back and forth, so that the object never jumps.
pub const PREPARED: usize = 32;
/// Width of a frame in pixels.
pub const WIDTH: usize = 1280;
/// Height of a frame in pixels.
pub const HEIGHT: usize = 720;
/// Quality of the pictures on disk, of 100.
const QUALITY: u8 = 90;

/// Rendered frames.
pub struct Clip {
    buffers: Vec<FrameBuffer>,
    /// The object in the first one.
    pub target: BBox,
}

impl Clip {
    /// Renders them.
    pub fn render() -> Clip {
        let config = FlightConfig {
            width: WIDTH,
            height: HEIGHT,
            frames: PREPARED,
            ..FlightConfig::default()
        };
        let flight = Flight::new(config);
        let mut target = BBox::default();
        let mut render = |index| {
            let mut buffer = FrameBuffer::default();
            let truth = flight.render(index, &mut buffer).bbox;
            if index == 0 {
                target = BBox::new(truth.x, truth.y, truth.w, truth.h);
            }
            buffer
        };
        let buffers = (0..PREPARED).map(&mut render).collect();
        Clip { buffers, target }
    }

    /// The frames in order.
    pub fn frames(&self) -> Result<Vec<Frame<'_>>, FrameError> {
        self.buffers
            .iter()
            .map(|b| Frame::new(&b.data, b.width, b.height, ChannelOrder::Rgb))
            .collect()
    }

    /// What the frames take in memory, in MiB.
    pub fn mib() -> f64 {
        (PREPARED * WIDTH * HEIGHT * 3) as f64 / f64::from(1 << 20)
    }

    /// Writes the frames as JPEGs into a folder of their own, which goes away with what is
    /// returned.
    pub fn write(&self) -> Result<Pictures, Failure> {
        let folder = std::env::temp_dir().join(format!("track-cpu-bench-{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(|error| Failure::output(&folder, error))?;
        let mut pictures = Pictures {
            folder,
            paths: Vec::new(),
        };
        for (i, buffer) in self.buffers.iter().enumerate() {
            let path = pictures.folder.join(format!("{i:04}.jpg"));
            let failure = |error: &dyn std::fmt::Display| Failure::output(&path, error);
            let mut bytes = Vec::new();
            let (width, height) = (buffer.width as u32, buffer.height as u32);
            JpegEncoder::new_with_quality(&mut bytes, QUALITY)
                .encode(&buffer.data, width, height, image::ExtendedColorType::Rgb8)
                .map_err(|error| failure(&error))?;
            std::fs::write(&path, bytes).map_err(|error| failure(&error))?;
            pictures.paths.push(path);
        }
        Ok(pictures)
    }
}

/// The numbers `0 1 ... n-1 n-2 ... 0 1 ...` behind the first, without end.
pub fn there_and_back(n: usize) -> impl Iterator<Item = usize> {
    (1..n).chain((0..n.saturating_sub(1)).rev()).cycle()
}

/// Frames as JPEGs on disk.
pub struct Pictures {
    folder: PathBuf,
    paths: Vec<PathBuf>,
}

impl Pictures {
    /// The files in order.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.paths.iter().map(PathBuf::as_path)
    }
}

impl Drop for Pictures {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_object_never_jumps() {
        let order: Vec<usize> = there_and_back(4).take(9).collect();
        assert_eq!(order, [1, 2, 3, 2, 1, 0, 1, 2, 3]);
    }
}
