//! The last pictures that viewers have seen, so that a box can be drawn in the one that was shown.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::picture::Picture;

/// Pictures kept: those of the last second, at the rate of the video.
const KEPT: usize = 15;
/// Most bytes of pixels kept.
const MAX_BYTES: usize = 48 << 20;
/// Pictures that viewers froze to draw in them.
const MAX_FROZEN: usize = 4;
/// How long a frozen picture is kept.
const FROZEN_FOR: Duration = Duration::from_secs(60);
/// How long recent pictures are kept without viewers.
const UNWATCHED: Duration = Duration::from_secs(5);
/// Time between two pictures kept.
const PERIOD: Duration = Duration::from_millis(60);

/// Pictures by the number of their frame.
#[derive(Debug, Default)]
pub struct Ring {
    recent: VecDeque<(u64, Picture)>,
    frozen: VecDeque<(u64, Picture, Instant)>,
    next: Option<Instant>, // earlier frames are not kept
}

impl Ring {
    /// Keeps a frame, unless the last one kept is too new; the oldest makes room.
    pub fn add(&mut self, frame: u64, picture: &Picture) {
        let now = Instant::now();
        if self.next.is_some_and(|next| now < next) {
            return;
        }
        self.next = Some(now + PERIOD);
        let fitting = (MAX_BYTES / picture.data.len().max(1)).clamp(1, KEPT);
        let mut spare = None;
        while self.recent.len() >= fitting {
            spare = self.recent.pop_front();
        }
        let kept = match spare {
            Some((_, mut kept)) => {
                kept.clone_from(picture);
                kept
            }
            None => picture.clone(),
        };
        self.recent.push_back((frame, kept));
    }

    /// The newest picture and the number of its frame.
    pub fn newest(&self) -> Option<(u64, Picture)> {
        self.recent.back().cloned()
    }

    /// The newest picture, kept for a minute from now on.
    pub fn freeze(&mut self) -> Option<(u64, Picture)> {
        let (frame, picture) = self.newest()?;
        let now = Instant::now();
        self.frozen
            .retain(|(kept, _, until)| *until > now && *kept != frame);
        while self.frozen.len() >= MAX_FROZEN {
            self.frozen.pop_front();
        }
        self.frozen
            .push_back((frame, picture.clone(), now + FROZEN_FOR));
        Some((frame, picture))
    }

    /// Frees memory without viewers: recent pictures soon, frozen ones when they expire.
    pub fn release(&mut self) {
        let now = Instant::now();
        if self.next.is_some_and(|next| now >= next + UNWATCHED) {
            self.recent = VecDeque::new();
            self.next = None;
        }
        self.frozen.retain(|(.., until)| *until > now);
    }

    /// The picture of a frame, if it is still kept.
    pub fn find(&self, frame: u64) -> Option<Picture> {
        let recent = self
            .recent
            .iter()
            .find(|(number, _)| *number == frame)
            .map(|(_, picture)| picture);
        let frozen = self
            .frozen
            .iter()
            .find(|(number, ..)| *number == frame)
            .map(|(_, picture, _)| picture);
        recent.or(frozen).cloned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Order;

    fn picture(brightness: u8) -> Picture {
        Picture {
            data: vec![brightness],
            width: 1,
            height: 1,
            order: Order::Gray,
        }
    }

    #[test]
    fn frozen_picture_outlives_the_recent_ones() {
        let mut ring = Ring::default();
        let add = |ring: &mut Ring, number: u64| {
            ring.next = None;
            ring.add(number, &picture(number as u8));
        };
        add(&mut ring, 1);
        let frozen = ring.freeze();
        for number in 2..40 {
            add(&mut ring, number);
        }

        assert_eq!(frozen, Some((1, picture(1))));
        assert_eq!(ring.find(1), Some(picture(1)));
        assert_eq!(ring.find(2), None);
        assert_eq!(ring.find(39), Some(picture(39)));
        assert_eq!(ring.newest(), Some((39, picture(39))));
    }

    #[test]
    fn frames_in_quick_succession_are_not_all_kept() {
        let mut ring = Ring::default();
        ring.add(1, &picture(1));
        ring.add(2, &picture(2));

        assert_eq!(ring.newest(), Some((1, picture(1))));
    }

    #[test]
    fn pictures_without_viewers_are_released_after_a_while() {
        let mut ring = Ring::default();
        ring.add(1, &picture(1));
        ring.freeze();

        ring.release();
        let soon = ring.newest();
        let long_ago = Instant::now().checked_sub(UNWATCHED + PERIOD);
        ring.next = long_ago;
        ring.release();

        assert_eq!(soon, Some((1, picture(1))));
        assert_eq!(ring.newest(), None);
        assert_eq!(ring.find(1), Some(picture(1)), "it was frozen");
        ring.frozen[0].2 = Instant::now();
        ring.release();
        assert_eq!(ring.find(1), None);
    }
}
