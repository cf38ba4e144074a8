//! The overlay of `track`, drawn and encoded on a thread of its own while the next frames are
//! tracked.

use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

use track_cpu::source::Image;

use crate::exit::Failure;
use crate::film::Film;
use crate::follow::Found;

/// Frames that wait to be drawn: memory for a short burst; a film that stays slower than the
/// tracker holds it up.
const WAITING: usize = 4;

/// One frame to draw.
struct Job {
    index: usize,
    image: Image,
    found: Found,
}

/// Draws tracked frames into a [`Film`].
pub struct Painter {
    jobs: SyncSender<Job>,
    drawn: Receiver<Image>,
    thread: JoinHandle<Result<(), Failure>>,
}

impl Painter {
    /// Opens a film as [`Film::create`] does.
    pub fn create(path: &Path) -> Result<Painter, Failure> {
        let mut film = Film::create(path)?;
        let (jobs, waiting) = sync_channel::<Job>(WAITING);
        let (back, drawn) = channel();
        let thread = std::thread::spawn(move || {
            let done = waiting.iter().try_for_each(|job| {
                let image = draw(&mut film, job)?;
                let _ = back.send(image); // fails when the video has ended: then nobody needs it
                Ok(())
            });
            // Whatever happened, the film of what there was is completed.
            done.and(film.finish())
        });
        Ok(Painter {
            jobs,
            drawn,
            thread,
        })
    }

    /// Has a frame drawn; `false` if the film has failed, for which [`finish`](Self::finish) has
    /// the reason.
    pub fn add(&self, index: usize, image: Image, found: Found) -> bool {
        self.jobs
            .send(Job {
                index,
                image,
                found,
            })
            .is_ok()
    }

    /// Pictures that are not needed any more.
    pub fn drawn(&self) -> impl Iterator<Item = Image> {
        self.drawn.try_iter()
    }

    /// Waits for the last frame and completes the film.
    pub fn finish(self) -> Result<(), Failure> {
        drop(self.jobs);
        self.thread
            .join()
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

fn draw(film: &mut Film, job: Job) -> Result<Image, Failure> {
    let Job {
        index,
        image,
        found,
    } = job;
    film.add(index, &image.frame(), |canvas| {
        canvas.found(
            &found.bbox,
            found.sureness.map(|(presence, _)| presence).or(found.score),
        );
        let state = found
            .sureness
            .map_or(String::new(), |(_, state)| format!(" {}", state.name()));
        canvas.caption(&format!("#{index}{state}"));
    })?;
    Ok(image)
}
