//! Decoding ahead, on its own thread.

use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

use super::program::Stopper;
use super::{Image, Source, SourceError};

/// A [`Source`] that decodes on its own thread while the caller works on the frames before.
///
/// Yields what the source yields, errors included, in its order. Dropping it ends the thread at its
/// next frame.
pub struct Prefetch {
    images: Option<Receiver<Result<Image, SourceError>>>,
    spent: Sender<Image>,
    worker: Option<JoinHandle<()>>,
    stopper: Option<Stopper>,
    label: String,
}

impl Prefetch {
    /// Starts to decode up to `depth` frames ahead (at least one).
    pub fn new(source: Source, depth: usize) -> Prefetch {
        let (stopper, label) = (source.stopper(), source.label.clone());
        let (sender, images) = sync_channel(depth.max(1));
        let (spent, returned) = channel();
        let worker = std::thread::spawn(move || run(source, &sender, &returned));
        Prefetch {
            images: Some(images),
            spent,
            worker: Some(worker),
            stopper,
            label,
        }
    }

    /// Gives a picture's buffer back for one of the next pictures.
    pub fn recycle(&self, image: Image) {
        let _ = self.spent.send(image); // fails after the end, when no buffer is needed
    }
}

fn run(
    mut source: Source,
    images: &SyncSender<Result<Image, SourceError>>,
    returned: &Receiver<Image>,
) {
    while let Some(image) = source.next() {
        if images.send(image).is_err() {
            return;
        }
        for image in returned.try_iter() {
            source.recycle(image);
        }
    }
}

impl Iterator for Prefetch {
    type Item = Result<Image, SourceError>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Ok(image) = self.images.as_ref()?.recv() {
            return Some(image);
        }
        // The thread has ended. A decoder that panicked must not look like the end of the video.
        self.images = None;
        self.worker.take()?.join().err().map(|_| {
            let reason = "the decoder failed on this frame".into();
            Err(SourceError::Format {
                input: self.label.clone(),
                reason,
            })
        })
    }
}

impl Drop for Prefetch {
    fn drop(&mut self) {
        self.images = None; // the thread's next send fails
        if let Some(stopper) = &self.stopper {
            stopper.stop(); // its blocked read ends
        }
    }
}
