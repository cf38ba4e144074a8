//! The targets that are followed: each has a number, from 1 on, and an engine of its own.
//!
//! The targets of a frame are followed one after another, by rising number, each on all threads of
//! its engine, so timing changes no report.

use std::time::{Duration, Instant};

use crate::engine::Engine;
use crate::picture::{FrameBox, Picture};
use crate::report::{Followed, TargetId, Tracked};

/// The targets of a station.
pub struct Targets<'a> {
    seats: Vec<Seat<'a>>, // of targets 1, 2 ...
    starts: u64,
}

/// Room for one target.
struct Seat<'a> {
    engine: Box<dyn Engine + 'a>,
    start: Option<u64>,     // number of the start that chose its target
    fresh: Option<Tracked>, // where a start has put its target in the frame at hand
}

impl<'a> Targets<'a> {
    /// Room for as many targets as there are engines, none of which has one.
    pub fn new(engines: Vec<Box<dyn Engine + 'a>>) -> Targets<'a> {
        let seats = engines.into_iter().map(|engine| Seat {
            engine,
            start: None,
            fresh: None,
        });
        Targets {
            seats: seats.collect(),
            starts: 0,
        }
    }

    /// How many targets can be followed at a time.
    pub fn room(&self) -> usize {
        self.seats.len()
    }

    /// Starts carried out so far.
    pub fn starts(&self) -> u64 {
        self.starts
    }

    /// Follows what is inside a box as target `id`, in place of an earlier one of that number;
    /// without a number as the lowest that is free, or as the only one. Returns its number.
    ///
    /// A target that was seen in an earlier picture than the newest (`is_newest` is false) is
    /// followed from there on.
    ///
    /// # Errors
    /// If there is no such number, all are in use, or the box is unusable; nothing changes then.
    pub fn start(
        &mut self,
        id: Option<TargetId>,
        picture: &Picture,
        bbox: FrameBox,
        is_newest: bool,
    ) -> Result<TargetId, String> {
        let index = self.choose(id)?;
        let seat = &mut self.seats[index];
        let track = seat.engine.start(picture, bbox)?;
        self.starts += 1;
        seat.start = Some(self.starts);
        seat.fresh = is_newest.then_some(track);
        Ok(index + 1)
    }

    /// Forgets target `id`, or all of them.
    ///
    /// # Errors
    /// If there is no such number.
    pub fn stop(&mut self, id: Option<TargetId>) -> Result<(), String> {
        let range = match id {
            Some(id) => {
                let index = self.index(id)?;
                index..index + 1
            }
            None => 0..self.room(),
        };
        for seat in &mut self.seats[range] {
            seat.engine.stop();
            seat.start = None;
            seat.fresh = None;
        }
        Ok(())
    }

    /// Finds every target in the next picture, taken `elapsed` after the one before.
    ///
    /// Targets share the `budget` for the search of lost ones: what one leaves, later ones have.
    pub fn follow(
        &mut self,
        picture: &Picture,
        elapsed: Duration,
        budget: Duration,
    ) -> Vec<Followed> {
        let began = Instant::now();
        let is_waiting = |seat: &&Seat<'_>| seat.start.is_some() && seat.fresh.is_none();
        let mut waiting = self.seats.iter().filter(is_waiting).count();
        let mut found = Vec::new();
        for (index, seat) in self.seats.iter_mut().enumerate() {
            let Some(start) = seat.start else {
                continue;
            };
            let track = seat.fresh.take().or_else(|| {
                let left = budget.saturating_sub(began.elapsed());
                let share = left.div_f64(waiting as f64);
                waiting -= 1;
                seat.engine.follow(picture, elapsed, share)
            });
            let id = index + 1;
            found.extend(track.map(|track| Followed { id, start, track }));
        }
        found
    }

    fn choose(&self, id: Option<TargetId>) -> Result<usize, String> {
        match id {
            Some(id) => self.index(id),
            None if self.room() == 1 => Ok(0),
            None => {
                let free = self.seats.iter().position(|seat| seat.start.is_none());
                free.ok_or_else(|| format!("all {} targets are in use", self.room()))
            }
        }
    }

    fn index(&self, id: TargetId) -> Result<usize, String> {
        let room = self.room();
        if (1..=room).contains(&id) {
            Ok(id - 1)
        } else {
            Err(format!("target {id}, expected one from 1 to {room}"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BUDGET: Duration = Duration::from_millis(90);
    const BOX: FrameBox = FrameBox {
        x: 1.0,
        y: 2.0,
        w: 8.0,
        h: 8.0,
    };

    /// Moves its target right by a pixel per frame; refuses boxes left of the frame.
    #[derive(Default)]
    struct Sliding {
        target: Option<Tracked>,
        budgets: Vec<Duration>,
    }

    impl Engine for &mut Sliding {
        fn start(&mut self, _: &Picture, target: FrameBox) -> Result<Tracked, String> {
            if target.x < 0.0 {
                return Err("left of the frame".into());
            }
            let track = Tracked::certain(target);
            self.target = Some(track.clone());
            Ok(track)
        }

        fn stop(&mut self) {
            self.target = None;
        }

        fn follow(&mut self, _: &Picture, _: Duration, budget: Duration) -> Option<Tracked> {
            self.budgets.push(budget);
            let track = self.target.as_mut()?;
            track.bbox.x += 1.0;
            Some(track.clone())
        }
    }

    fn targets(engines: &mut [Sliding]) -> Targets<'_> {
        let boxed = engines
            .iter_mut()
            .map(|e| Box::new(e) as Box<dyn Engine + '_>);
        Targets::new(boxed.collect())
    }

    /// Number and left edge of every target in the next frame.
    fn next(targets: &mut Targets<'_>) -> Vec<(TargetId, f32)> {
        let found = targets.follow(&Picture::dot(), Duration::ZERO, BUDGET);
        found.iter().map(|f| (f.id, f.track.bbox.x)).collect()
    }

    fn start(targets: &mut Targets<'_>, id: Option<TargetId>, x: f32) -> Result<TargetId, String> {
        targets.start(id, &Picture::dot(), FrameBox { x, ..BOX }, true)
    }

    #[test]
    fn start_without_a_number_takes_the_lowest_that_is_free() {
        let mut engines: [Sliding; 3] = Default::default();
        let mut targets = targets(&mut engines);

        assert_eq!(start(&mut targets, Some(2), 20.0), Ok(2));
        assert_eq!(start(&mut targets, None, 10.0), Ok(1));
        assert_eq!(start(&mut targets, None, 30.0), Ok(3));
        let full = start(&mut targets, None, 40.0);
        assert_eq!(full, Err("all 3 targets are in use".into()));
        assert_eq!(next(&mut targets), [(1, 10.0), (2, 20.0), (3, 30.0)]);
        assert_eq!(next(&mut targets), [(1, 11.0), (2, 21.0), (3, 31.0)]);

        assert_eq!(targets.stop(Some(2)), Ok(()));
        assert_eq!(next(&mut targets), [(1, 12.0), (3, 32.0)]);
        assert_eq!(start(&mut targets, None, 50.0), Ok(2));
        assert_eq!(start(&mut targets, Some(3), 60.0), Ok(3), "it is replaced");
        assert_eq!(next(&mut targets), [(1, 13.0), (2, 50.0), (3, 60.0)]);
        assert_eq!(targets.starts(), 5);

        assert_eq!(targets.stop(None), Ok(()));
        assert_eq!(next(&mut targets), []);
    }

    #[test]
    fn only_target_is_replaced() {
        let mut engines: [Sliding; 1] = Default::default();
        let mut targets = targets(&mut engines);

        assert_eq!(start(&mut targets, None, 10.0), Ok(1));
        assert_eq!(start(&mut targets, None, 20.0), Ok(1));

        assert_eq!(next(&mut targets), [(1, 20.0)]);
    }

    #[test]
    fn refused_start_leaves_every_target_alone() {
        let mut engines: [Sliding; 2] = Default::default();
        let mut targets = targets(&mut engines);
        start(&mut targets, None, 10.0).unwrap();

        for (id, x, reason) in [
            (None, -5.0, "left of the frame"),
            (Some(1), -5.0, "left of the frame"),
            (Some(0), 5.0, "target 0, expected one from 1 to 2"),
            (Some(3), 5.0, "target 3, expected one from 1 to 2"),
        ] {
            assert_eq!(start(&mut targets, id, x), Err(reason.into()), "{id:?}");
        }
        assert!(targets.stop(Some(3)).is_err());

        assert_eq!(next(&mut targets), [(1, 10.0)]);
        assert_eq!(start(&mut targets, None, 20.0), Ok(2), "it is still free");
    }

    #[test]
    fn target_of_an_earlier_picture_is_followed_to_the_newest() {
        let mut engines: [Sliding; 2] = Default::default();
        let mut targets = targets(&mut engines);

        targets.start(None, &Picture::dot(), BOX, false).unwrap();
        start(&mut targets, None, 20.0).unwrap();

        assert_eq!(next(&mut targets), [(1, BOX.x + 1.0), (2, 20.0)]);
    }

    #[test]
    fn budget_is_shared_by_the_targets_that_are_followed() {
        let mut engines: [Sliding; 4] = Default::default();
        let mut targets = targets(&mut engines);
        for x in [10.0, 20.0, 30.0] {
            start(&mut targets, None, x).unwrap();
        }
        next(&mut targets);
        start(&mut targets, Some(2), 40.0).unwrap();

        next(&mut targets);

        drop(targets);
        let [first, second, third, fourth] = engines.map(|engine| engine.budgets);
        assert!(first[0] <= BUDGET / 2, "{first:?}");
        assert!(second.is_empty(), "a fresh one needs none");
        assert!(third[0] > BUDGET / 2, "what the first left: {third:?}");
        assert!(fourth.is_empty());
    }
}
