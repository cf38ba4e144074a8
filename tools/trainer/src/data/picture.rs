//! Decoded pictures, and an album that caches them in memory within a bound.

use std::collections::{HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use track_cpu::source::{Input, Source};
use track_cpu::{ChannelOrder, Frame, Isa};

/// A picture in memory: RGB bytes, row-major without gaps, and the color of what lies outside.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `3 * width * height` bytes, RGB.
    pub data: Vec<u8>,
    /// Mean color, BGR, truncated (docs/method.md, section 2.2).
    pub border: [u8; 3],
}

impl Picture {
    /// A picture of these RGB bytes.
    ///
    /// Panics if a side is 0 or `data` has not `3 * width * height` bytes.
    pub fn new(width: usize, height: usize, data: Vec<u8>) -> Picture {
        assert!(
            width > 0 && height > 0 && data.len() == 3 * width * height,
            "picture {width}x{height}"
        );
        let border = Frame::new(&data, width, height, ChannelOrder::Rgb)
            .map_or([0; 3], |frame| frame.mean_bgr(Isa::detect()));
        Picture {
            width,
            height,
            data,
            border,
        }
    }

    /// Reads a picture file.
    ///
    /// # Errors
    /// If the file is not a readable picture; the text does not name the path.
    pub fn read(path: &Path) -> Result<Picture, String> {
        let mut source = Source::open(&Input::new(path)).map_err(|error| error.to_string())?;
        let image = source
            .next()
            .ok_or("no picture in it")?
            .map_err(|error| error.to_string())?;
        let data = match image.order {
            ChannelOrder::Rgb => image.data,
            _ => image.frame().to_rgb(),
        };
        Ok(Picture::new(image.width, image.height, data))
    }

    /// The picture as the tracker's cropper wants it.
    pub fn frame(&self) -> Frame<'_> {
        Frame::new(&self.data, self.width, self.height, ChannelOrder::Rgb)
            .expect("a picture has the bytes of its size")
    }
}

/// A picture file of an [`Album`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PictureId(pub(super) u32);

/// Picture files by number, decoded on first use and cached; the oldest are evicted first.
#[derive(Debug)]
pub struct Album {
    paths: Vec<PathBuf>,
    numbers: HashMap<PathBuf, PictureId>,
    kept: Mutex<Kept>,
    bound: usize, // bytes
}

#[derive(Debug, Default)]
struct Kept {
    pictures: HashMap<PictureId, Arc<Picture>>,
    order: VecDeque<PictureId>, // oldest first
    bytes: usize,
    unreadable: HashMap<PictureId, String>,
}

impl Album {
    /// An album that keeps at most `bound` bytes of pixels.
    pub fn new(bound: usize) -> Album {
        Album {
            paths: Vec::new(),
            numbers: HashMap::new(),
            kept: Mutex::default(),
            bound,
        }
    }

    /// The number of a file; the same for the same path.
    pub fn add(&mut self, path: PathBuf) -> PictureId {
        if let Some(id) = self.numbers.get(&path) {
            return *id;
        }
        let id = PictureId(u32::try_from(self.paths.len()).expect("fewer than 2^32 pictures"));
        self.numbers.insert(path.clone(), id);
        self.paths.push(path);
        id
    }

    /// How many files there are.
    pub fn len(&self) -> usize {
        self.paths.len()
    }

    /// Whether there is no file.
    pub fn is_empty(&self) -> bool {
        self.paths.is_empty()
    }

    /// The file of a number.
    pub fn path(&self, id: PictureId) -> &Path {
        &self.paths[id.0 as usize]
    }

    /// The picture, decoded or from the cache; `None` if the file is not a readable picture, which
    /// is reported once.
    pub fn get(&self, id: PictureId) -> Option<Arc<Picture>> {
        {
            let kept = self.lock();
            if let Some(picture) = kept.pictures.get(&id) {
                return Some(picture.clone());
            }
            if kept.unreadable.contains_key(&id) {
                return None;
            }
        }
        // Decoded without the lock; two threads may do the same work once.
        match Picture::read(self.path(id)) {
            Ok(picture) => Some(self.keep(id, Arc::new(picture))),
            Err(reason) => {
                if self.lock().unreadable.insert(id, reason.clone()).is_none() {
                    eprintln!("skipped: {reason}");
                }
                None
            }
        }
    }

    /// Number of files that could not be read so far.
    pub fn unreadable(&self) -> usize {
        self.lock().unreadable.len()
    }

    fn keep(&self, id: PictureId, picture: Arc<Picture>) -> Arc<Picture> {
        let mut kept = self.lock();
        if let Some(earlier) = kept.pictures.get(&id) {
            return earlier.clone();
        }
        kept.bytes += picture.data.len();
        kept.pictures.insert(id, picture.clone());
        kept.order.push_back(id);
        while kept.bytes > self.bound {
            let Some(oldest) = kept.order.pop_front() else {
                break;
            };
            if let Some(gone) = kept.pictures.remove(&oldest) {
                kept.bytes -= gone.data.len();
            }
        }
        picture
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Kept> {
        self.kept
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Folder;

    #[test]
    fn album_stays_within_its_bound_and_reports_bad_files() {
        let folder = Folder::new("album");
        let mut album = Album::new(2 * 3 * 16);
        let ids: Vec<_> = (0..5u8)
            .map(|i| {
                let path = folder.path().join(format!("{i}.png"));
                image::RgbImage::from_pixel(4, 4, image::Rgb([i, 2 * i, 3 * i]))
                    .save(&path)
                    .unwrap();
                album.add(path)
            })
            .collect();
        for (i, id) in ids.iter().enumerate() {
            let i = i as u8;
            let picture = album.get(*id).unwrap();
            assert_eq!(
                (picture.width, &picture.data[..3], picture.border),
                (4, &[i, 2 * i, 3 * i][..], [3 * i, 2 * i, i])
            );
            assert!(album.lock().bytes <= 96);
        }
        assert_eq!(album.lock().pictures.len(), 2);
        assert_eq!(album.get(ids[0]).unwrap().border, [0; 3]); // decoded again
        let missing = album.add(folder.path().join("missing.png"));
        std::fs::write(folder.path().join("text.png"), "no picture").unwrap();
        let text = album.add(folder.path().join("text.png"));
        assert!(
            album.get(missing).is_none() && album.get(text).is_none() && album.get(text).is_none()
        );
        assert_eq!(album.unreadable(), 2);
        assert_eq!(album.add(folder.path().join("0.png")), ids[0]);
    }
}
