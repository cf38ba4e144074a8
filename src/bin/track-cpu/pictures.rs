//! What `track` shows of its frames: an overlay, and a video as `serve` makes it.

use std::path::Path;

use track_cpu::source::{Image, Prefetch};

use crate::args::track::TrackArgs;
use crate::exit::Failure;
use crate::film::Film;
use crate::follow::Found;
use crate::painter::Painter;
#[cfg(feature = "serve")]
use crate::serve::video::Video;

/// Where tracked frames are drawn.
pub struct Pictures {
    painter: Option<Painter>,
    #[cfg(feature = "serve")]
    video: Option<Video>,
}

impl Pictures {
    /// Opens what the command line asks for.
    ///
    /// # Errors
    /// If a file or folder cannot be created.
    pub fn create(args: &TrackArgs) -> Result<Pictures, Failure> {
        Ok(Pictures {
            painter: args.overlay.as_deref().map(Painter::create).transpose()?,
            #[cfg(feature = "serve")]
            video: Video::start(&args.video, args.fps)?,
        })
    }

    /// The options that name files, and the first file of each.
    pub fn files(args: &TrackArgs) -> Vec<(&'static str, Box<Path>)> {
        let mut files = Vec::new();
        let film = args.overlay.as_deref().map(Film::first_file);
        files.extend(film.map(|path| ("--overlay", path.into())));
        #[cfg(feature = "serve")]
        files.extend(args.video.file().map(|path| ("--video-out", path.into())));
        files
    }

    /// Has a frame drawn, or gives its buffer back; `false` if the overlay has failed.
    pub fn add(&mut self, index: usize, image: Image, found: Found, frames: &Prefetch) -> bool {
        #[cfg(feature = "serve")]
        if let Some(video) = &mut self.video {
            video.add(index, &image, &found);
        }
        let Some(painter) = &self.painter else {
            frames.recycle(image);
            return true;
        };
        let is_painting = painter.add(index, image, found);
        for image in painter.drawn() {
            frames.recycle(image);
        }
        is_painting
    }

    /// Completes everything.
    ///
    /// # Errors
    /// If frames are missing.
    pub fn finish(self) -> Result<(), Failure> {
        let painted = self.painter.map_or(Ok(()), Painter::finish);
        #[cfg(feature = "serve")]
        let painted = painted.and(self.video.map_or(Ok(()), Video::finish));
        painted
    }
}
