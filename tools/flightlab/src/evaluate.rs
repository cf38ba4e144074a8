//! `evaluate`: flight mode as a whole on clips with absences, beside plain mode.

use track_cpu::flight::{Budget, Conduct, FlightOptions, FlightTracker, Presence};
use track_cpu::{BBox, Frame, Model, State};

use scenes::Difficulty;
use sequences::curves;

use crate::clips::{self, Clip, GONE, OFF, ON, Truth, each_clip, is_on};
use crate::measure::{auroc, reliability};
use crate::{EvaluateArgs, Failure, load, plots, presence, spare};

/// Frames after a return within which the target must be found again.
const RETURN_FRAMES: usize = 60;
/// Frames after a return within which the target should be found again, if it was gone for
/// [`LONG_ABSENCE`] frames: the stricter count, of targets that were tracked before or not.
const SOON_FRAMES: usize = 45;
/// Frames of such an absence.
const LONG_ABSENCE: usize = 8;
/// Frames on another object, surely, that count as having locked on it.
const WRONG_FRAMES: u32 = 15;
/// Shortest absence that counts, in frames.
const ABSENCE: usize = 5;
/// Share visible from which the target must be tracked.
const CLEAR: f32 = 0.5;
/// Share visible below which nothing of the target counts as there.
const ANYTHING: f32 = 0.1;
/// Frames without an overlap that end a crossing.
const APART: usize = 15;

/// What one frame came to.
#[derive(Clone, Copy, Debug)]
struct Moment {
    bbox: BBox,
    visible: f32,
    iou: f32,
    on: Option<bool>,
    presence: f64,
    state: State,
    believed: bool,
    other: bool,   // the box is on a look-alike
    outside: bool, // the target's center is not in the view
    crossed: bool, // a look-alike's box overlaps the target's
    missed: Option<Missed>,
}

/// What a look at the true place of a visible target that is not followed shows.
#[derive(Clone, Copy, Debug)]
struct Missed {
    away: f32,          // of the reported box, in sides of the target
    iou: f32,           // of the box found there
    log_odds: f64,      // of its appearance
    place: f64,         // log-odds of the true place
    within_reach: bool, // of a search
}

/// What one clip came to.
#[derive(Debug)]
struct Outcome {
    name: String,
    difficulty: Option<Difficulty>, // none of footage
    flight: Vec<Moment>,
    plain: Vec<Moment>, // none if it was left out
}

/// Runs the sub-command.
pub fn run(args: &EvaluateArgs) -> Result<(), Failure> {
    spare(
        &[("--plots", args.plots.as_ref())],
        &[
            args.footage.sequences.as_ref(),
            args.footage.stills.as_ref(),
            args.model.as_ref(),
            args.text.as_ref(),
        ],
    )?;
    let model = load(args.model.as_ref())?;
    let presence = presence(args.text.as_ref(), &model)?;
    let clips = clips::all(&args.flights, args.seed, &args.footage)?;
    let outcomes = each_clip(&clips, args.jobs, |clip| {
        follow(&model, &presence, args, clip)
    })?;
    for outcome in &outcomes {
        if args.trace {
            for (index, m) in outcome.flight.iter().enumerate() {
                let (visible, iou, state) = (m.visible, m.iou, m.state.name());
                let other = if m.other { " other" } else { "" };
                let missed = m.missed.map_or(String::new(), |missed| {
                    format!(
                        " away {:.1} look {:.2} {:.2} place {:.2} {}",
                        missed.away,
                        missed.iou,
                        missed.log_odds,
                        missed.place,
                        if missed.within_reach { "near" } else { "far" }
                    )
                });
                println!(
                    "{} {visible:.2} {iou:.2} {:.3} {state}{other}{missed}",
                    index + 1,
                    m.presence
                );
            }
        }
        let found = Count::sum(returns(&outcome.flight).into_iter());
        let flight = format!("{:.3}", mean_iou(&outcome.flight));
        let plain = if args.flight_only {
            "-".into()
        } else {
            format!("{:.3}", mean_iou(&outcome.plain))
        };
        let wrong = if locks_wrong(&outcome.flight) {
            "  wrong target"
        } else {
            ""
        };
        println!(
            "{}: IoU {flight}, plain {plain}; found again {found}{wrong}",
            outcome.name
        );
    }
    let of = |part: Part| outcomes.iter().filter(move |o| part.holds(o.difficulty));
    for part in [Part::Medium, Part::Hard, Part::Footage, Part::All] {
        let plain: Vec<_> = of(part).map(|o| &o.plain[..]).collect();
        let flight: Vec<_> = of(part).map(|o| &o.flight[..]).collect();
        if flight.is_empty() || part == Part::All && flight.len() < outcomes.len() {
            continue;
        }
        if !args.flight_only {
            summarize(&format!("{part:?}, plain"), &plain);
        }
        summarize(&format!("{part:?}, flight"), &flight);
    }
    let all: Vec<_> = outcomes.iter().map(|outcome| &outcome.flight[..]).collect();
    let folder = args.plots.as_deref();
    folder.map_or(Ok(()), |folder| {
        plots::write(folder, &on_off(&all), &visible_gone(&all))
    })
}

/// Some of the clips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Medium,
    Hard,
    Footage,
    All,
}

impl Part {
    fn holds(self, difficulty: Option<Difficulty>) -> bool {
        match self {
            Part::Medium => difficulty == Some(Difficulty::Medium),
            Part::Hard => difficulty == Some(Difficulty::Hard),
            Part::Footage => difficulty.is_none(),
            Part::All => true,
        }
    }
}

/// Both modes on one clip.
fn follow(
    model: &Model,
    presence: &Presence,
    args: &EvaluateArgs,
    clip: &Clip,
) -> Result<Outcome, Failure> {
    let options = FlightOptions::new(model);
    let plain = FlightOptions {
        conduct: Conduct::Tell,
        ..options
    };
    let mut trackers =
        [options, plain].map(|o| FlightTracker::with_presence(model.clone(), o, *presence));
    let mut moments = [Vec::new(), Vec::new()];
    let modes = if args.flight_only { 1 } else { trackers.len() };
    clip.play(|index, frame, truth| {
        for (tracker, moments) in trackers.iter_mut().zip(&mut moments).take(modes) {
            if index == 0 {
                tracker.init(frame, truth.bbox)?;
            } else {
                let mut moment = moment(tracker, frame, truth, args.searches)?;
                if args.trace && moment.visible > CLEAR && moment.on == Some(false) {
                    moment.missed = look_at(tracker, frame, truth, &moment)?;
                }
                moments.push(moment);
            }
        }
        Ok(())
    })?;
    let [flight, plain] = moments;
    Ok(Outcome {
        name: clip.name(),
        difficulty: clip.difficulty(),
        flight,
        plain,
    })
}

fn moment(
    tracker: &mut FlightTracker,
    frame: &Frame<'_>,
    truth: &Truth,
    searches: u32,
) -> Result<Moment, Failure> {
    let track = tracker.update(frame, Budget::Searches(searches))?;
    let iou = track.bbox.iou(&truth.bbox);
    let on_other = |b: &BBox| b.iou(&track.bbox) >= ON;
    let target = truth.bbox;
    let center = target.center();
    let within = (0.0..frame.width() as f32).contains(&center.cx)
        && (0.0..frame.height() as f32).contains(&center.cy);
    Ok(Moment {
        bbox: track.bbox,
        visible: truth.visible,
        iou,
        on: is_on(&track.bbox, truth),
        presence: f64::from(track.presence),
        state: track.state,
        believed: track.is_believed(),
        other: iou < OFF && truth.others.iter().any(on_other),
        outside: !within,
        crossed: within && truth.others.iter().any(|b| b.iou(&target) > 0.0),
        missed: None,
    })
}

/// Looks at the target's true place as a search would.
fn look_at(
    tracker: &mut FlightTracker,
    frame: &Frame<'_>,
    truth: &Truth,
    moment: &Moment,
) -> Result<Option<Missed>, Failure> {
    let center = truth.bbox.center();
    let reported = moment.bbox.center();
    let distance = (reported.cx - center.cx).hypot(reported.cy - center.cy);
    let Some((place, within_reach)) = tracker.place_odds(truth.bbox) else {
        return Ok(None);
    };
    let found = tracker.examine_twice(frame, (center.cx, center.cy))?;
    Ok(found.map(|(bbox, evidence)| Missed {
        away: distance / truth.bbox.area().sqrt().max(1.0),
        iou: bbox.iou(&truth.bbox),
        log_odds: tracker.presence().again.log_odds(&evidence),
        place,
        within_reach,
    }))
}

fn mean_iou(moments: &[Moment]) -> f64 {
    let seen = moments.iter().filter(|m| m.visible > CLEAR);
    curves::mean(seen.map(|m| f64::from(m.iou)))
}

/// How often something happened, and how often it ended well or badly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Count {
    times: usize,
    hits: usize,
}

impl Count {
    fn add(&mut self, hit: bool) {
        self.times += 1;
        self.hits += usize::from(hit);
    }

    fn sum(counts: impl Iterator<Item = Count>) -> Count {
        counts.fold(Count::default(), |a, b| Count {
            times: a.times + b.times,
            hits: a.hits + b.hits,
        })
    }
}

impl std::fmt::Display for Count {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {}", self.hits, self.times)
    }
}

/// Returns of a target that was tracked before it went, and how many of them were found again in
/// time: from outside the view, and from behind something.
fn returns(moments: &[Moment]) -> [Count; 2] {
    let mut counts = [Count::default(); 2];
    let mut at = 0;
    while at < moments.len() {
        let gone = moments[at..]
            .iter()
            .take_while(|m| m.visible <= CLEAR)
            .count();
        let (absence, back) = moments[at..].split_at(gone);
        let truly = absence.iter().filter(|m| m.visible <= GONE).count();
        let tracked = moments[at.saturating_sub(10)..at]
            .iter()
            .any(|m| m.on == Some(true));
        if truly >= ABSENCE && tracked && back.len() >= RETURN_FRAMES {
            let again = back[..RETURN_FRAMES]
                .iter()
                .any(|m| m.on == Some(true) && m.believed);
            let from = usize::from(!absence.iter().any(|m| m.outside));
            counts[from].add(again);
        }
        at += gone.max(1);
    }
    counts
}

/// Every return after a long absence, and how many of them were found again soon, or before the
/// next absence.
fn all_returns(moments: &[Moment]) -> Count {
    let mut count = Count::default();
    let mut gone = 0;
    for (at, moment) in moments.iter().enumerate() {
        if moment.visible < ANYTHING {
            gone += 1;
        } else if moment.visible >= CLEAR {
            if gone >= LONG_ABSENCE {
                let back = moments[at..].iter().take(SOON_FRAMES);
                let mut there = back.take_while(|m| m.visible >= ANYTHING);
                let is_found = |m: &Moment| m.visible >= CLEAR && m.iou >= ON && m.believed;
                count.add(there.any(is_found));
            }
            gone = 0;
        }
    }
    count
}

/// Look-alikes that came across a target that was tracked, and how many of them were followed in
/// its place within two seconds.
fn crossings(moments: &[Moment]) -> Count {
    let mut count = Count::default();
    let mut at = 0;
    while let Some(begin) = moments[at..].iter().position(|m| m.crossed).map(|i| at + i) {
        let mut end = begin; // last frame of the crossing
        while let Some(next) = moments[end + 1..]
            .iter()
            .take(APART)
            .position(|m| m.crossed)
        {
            end += 1 + next;
        }
        let before = &moments[begin.saturating_sub(5)..=begin];
        if before.iter().any(|m| m.on == Some(true) && m.believed) {
            let until = (end + RETURN_FRAMES).min(moments.len());
            count.add(locks_wrong(&moments[begin..until]));
        }
        at = end + 1;
    }
    count
}

fn locks_wrong(moments: &[Moment]) -> bool {
    let mut row = 0;
    moments.iter().any(|m| {
        row = if m.other && m.believed { row + 1 } else { 0 };
        row >= WRONG_FRAMES
    })
}

/// Presence of every frame that is clearly on the target or off it.
fn on_off(flights: &[&[Moment]]) -> Vec<(f64, bool)> {
    flights
        .iter()
        .flat_map(|f| f.iter())
        .filter_map(|m| Some((m.presence, m.on?)))
        .collect()
}

/// Presence of every frame in which the target is gone, or in view and tracked.
fn visible_gone(flights: &[&[Moment]]) -> Vec<(f64, bool)> {
    let moments = flights.iter().flat_map(|f| f.iter());
    let told = moments.filter(|m| m.visible <= GONE || (m.visible > CLEAR && m.on == Some(true)));
    told.map(|m| (m.presence, m.visible > CLEAR)).collect()
}

fn summarize(name: &str, flights: &[&[Moment]]) {
    let all = || flights.iter().flat_map(|f| f.iter());
    let (labeled, gone) = (on_off(flights), visible_gone(flights));
    let share = |of: &dyn Fn(&&Moment) -> bool, hit: &dyn Fn(&&Moment) -> bool| {
        let of: Vec<&Moment> = all().filter(of).collect();
        of.iter().filter(|m| hit(m)).count() as f64 / of.len().max(1) as f64
    };
    let tracked = |m: &&Moment| m.visible > CLEAR && m.on == Some(true);
    let false_lost = share(&tracked, &|m| !m.believed);
    let missed = share(&|m| m.visible <= GONE, &|m| m.believed);
    let returns = [0, 1].map(|from| Count::sum(flights.iter().map(|f| returns(f)[from])));
    let crossings = Count::sum(flights.iter().map(|f| crossings(f)));
    let wrong = flights.iter().filter(|f| locks_wrong(f)).count();
    let iou = curves::mean(flights.iter().map(|f| mean_iou(f)));
    let shown = |a: Option<f64>| a.map_or("none".into(), |a| format!("{a:.4}"));
    println!("\n{name}: mean IoU {iou:.3} over {} flights", flights.len());
    println!(
        "AUROC on/off target {}, visible/gone {}",
        shown(auroc(&labeled)),
        shown(auroc(&gone))
    );
    let visible = |m: &&Moment| m.visible >= CLEAR;
    println!(
        "visible frames on the target {:.2} %, off it but believed {:.2} %",
        100.0 * share(&visible, &|m| m.iou >= ON),
        100.0 * share(&visible, &|m| m.iou < ON && m.believed)
    );
    println!(
        "frames on the target but not believed {:.2} %",
        100.0 * false_lost
    );
    println!(
        "frames without the target but believed {:.2} %",
        100.0 * missed
    );
    println!(
        "found again within {RETURN_FRAMES} frames: into the view {}, from behind something {}",
        returns[0], returns[1]
    );
    println!(
        "found again within {SOON_FRAMES} frames, of all returns after {LONG_ABSENCE} frames: {}",
        Count::sum(flights.iter().map(|f| all_returns(f)))
    );
    println!("look-alikes that crossed the target and were followed in its place: {crossings}");
    println!(
        "flights locked on another object for {WRONG_FRAMES} frames: {wrong} of {}",
        flights.len()
    );
    println!("{}", reliability(&labeled));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(visible: f32, iou: f32, believed: bool) -> Moment {
        let on = Some(visible > 0.25 && iou > ON);
        Moment {
            bbox: BBox::default(),
            visible,
            iou,
            on,
            presence: f64::from(u8::from(believed)),
            state: State::Tracking,
            believed,
            other: iou < OFF,
            outside: false,
            crossed: false,
            missed: None,
        }
    }

    #[test]
    fn returns_are_counted_by_kind() {
        let (there, away) = ([moment(1.0, 0.8, true); 20], [moment(0.0, 0.0, false); 10]);
        let back = [[moment(1.0, 0.0, false); 30], [moment(1.0, 0.7, true); 30]].concat();
        let good = [&there[..], &away, &back].concat();
        let count = |times, hits| Count { times, hits };
        assert_eq!(returns(&good), [count(0, 0), count(1, 1)]);
        let never = [&there[..], &away, &[moment(1.0, 0.0, false); 60]].concat();
        assert_eq!(returns(&never), [count(0, 0), count(1, 0)]);
        let short = [&there[..], &away[..3], &back].concat();
        assert_eq!(returns(&short), [Count::default(); 2]);
        let outside = away.map(|m| Moment { outside: true, ..m });
        assert_eq!(
            returns(&[&there[..], &outside, &back].concat()),
            [count(1, 1), count(0, 0)]
        );
    }

    #[test]
    fn every_long_absence_has_a_return_that_is_found_soon_or_not() {
        let there = [moment(1.0, 0.8, true); 20];
        let away = [moment(0.0, 0.0, false); 10];
        let off = [moment(1.0, 0.0, false); 50];
        let count = |times, hits| Count { times, hits };
        let table = [
            ([&there[..], &away, &there].concat(), count(1, 1)),
            (
                [&there[..], &away, &off[..44], &there].concat(),
                count(1, 1),
            ),
            (
                [&there[..], &away, &off[..45], &there].concat(),
                count(1, 0),
            ),
            (
                [&there[..], &away, &off[..9], &away, &there].concat(),
                count(2, 1),
            ),
            ([&there[..], &away[..7], &there].concat(), count(0, 0)),
        ];

        for (moments, expected) in table {
            assert_eq!(all_returns(&moments), expected);
        }
    }

    #[test]
    fn crossings_are_counted_once() {
        let there = [moment(1.0, 0.8, true); 10];
        let met = [Moment {
            crossed: true,
            ..there[0]
        }; 5];
        let wrong = [moment(1.0, 0.0, true); 20];
        let kept = [&there[..], &met, &there, &met, &there, &there, &met].concat();
        assert_eq!(crossings(&kept), Count { times: 2, hits: 0 });
        assert_eq!(
            crossings(&[&there[..], &met, &wrong].concat()),
            Count { times: 1, hits: 1 }
        );
        let late = [&there[..], &met, &[there; 6].concat(), &wrong].concat();
        assert_eq!(crossings(&late), Count { times: 1, hits: 0 });
        assert_eq!(
            crossings(
                &[
                    &[moment(1.0, 0.0, false); 9][..],
                    &met.map(|m| Moment {
                        on: Some(false),
                        ..m
                    })
                ]
                .concat()
            ),
            Count::default()
        );
    }

    #[test]
    fn long_lock_on_another_object_is_wrong() {
        let other = moment(1.0, 0.0, true);
        assert!(!locks_wrong(&[other; 14]));
        assert!(locks_wrong(&[other; 15]));
        assert!(!locks_wrong(&[moment(1.0, 0.0, false); 40]));
    }
}
