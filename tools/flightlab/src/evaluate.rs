//! `evaluate`: flight mode as a whole on rendered flights, beside the paper's mode.

use track_cpu::flight::{Budget, FlightOptions, FlightTracker, Presence};
use track_cpu::{BBox, Frame, Model, State};

use scenes::Truth;

use crate::flights::{GONE, OFF, ON, bbox, each_seed, is_on, play};
use crate::measure::{auroc, reliability};
use crate::{EvaluateArgs, Failure, load};

/// Frames after a return within which the target must be found again.
const RETURN_FRAMES: usize = 60;
/// Frames on another object, surely, that count as having locked on it.
const WRONG_FRAMES: u32 = 15;
/// Shortest absence that counts, in frames.
const ABSENCE: usize = 5;
/// Share visible from which the target must be tracked.
const CLEAR: f32 = 0.5;

/// What one frame came to.
#[derive(Clone, Copy, Debug)]
struct Moment {
    visible: f32,
    iou: f32,
    on: Option<bool>,
    presence: f64,
    state: State,
    believed: bool,
    other: bool, // the box is on a look-alike
}

/// What one flight came to.
#[derive(Debug)]
struct Outcome {
    seed: u64,
    flight: Vec<Moment>,
    paper: Vec<Moment>,
}

/// Runs the sub-command.
pub fn run(args: &EvaluateArgs) -> Result<(), Failure> {
    let model = load(args.model.as_ref())?;
    let presence = match &args.text {
        Some(path) => {
            let text = std::fs::read_to_string(path)
                .map_err(|error| Failure::File(path.clone(), error.to_string()))?;
            Presence::parse(&text)?
        }
        None => Presence::of(model.header())?,
    };
    let outcomes = each_seed(&args.flights, args.seed, |seed| flight(&model, &presence, args, seed))?;
    for outcome in &outcomes {
        if args.trace {
            for (index, m) in outcome.flight.iter().enumerate() {
                let (visible, iou, state) = (m.visible, m.iou, m.state.name());
                let other = if m.other { " other" } else { "" };
                println!("{} {visible:.2} {iou:.2} {:.3} {state}{other}", index + 1, m.presence);
            }
        }
        let (returns, found) = returns(&outcome.flight);
        let line = |moments: &[Moment]| format!("{:.3}", mean_iou(moments));
        let (flight, paper) = (line(&outcome.flight), line(&outcome.paper));
        let wrong = if locks_wrong(&outcome.flight) { "  wrong target" } else { "" };
        println!(
            "seed {}: IoU {flight}, paper {paper}; found again {found} of {returns}{wrong}",
            outcome.seed
        );
    }
    for (name, pick) in [("paper", 0), ("flight", 1)] {
        let moments: Vec<&[Moment]> =
            outcomes.iter().map(|o| if pick == 0 { &o.paper[..] } else { &o.flight[..] }).collect();
        summarise(name, &moments);
    }
    Ok(())
}

fn flight(model: &Model, presence: &Presence, args: &EvaluateArgs, seed: u64) -> Result<Outcome, Failure> {
    let options = FlightOptions::new(model);
    let follow = FlightOptions { recover: false, ..options };
    let mut trackers = [options, follow].map(|o| FlightTracker::with_presence(model.clone(), o, *presence));
    let mut moments = [Vec::new(), Vec::new()];
    play(&args.flights, seed, |index, frame, truth| {
        for (tracker, moments) in trackers.iter_mut().zip(&mut moments) {
            if index == 0 {
                tracker.init(frame, bbox(&truth.bbox))?;
            } else {
                moments.push(moment(tracker, frame, truth, args.searches)?);
            }
        }
        Ok(())
    })?;
    let [flight, paper] = moments;
    Ok(Outcome { seed, flight, paper })
}

fn moment(
    tracker: &mut FlightTracker,
    frame: &Frame<'_>,
    truth: &Truth,
    searches: u32,
) -> Result<Moment, Failure> {
    let track = tracker.update(frame, Budget::Searches(searches))?;
    let iou = track.bbox.iou(&bbox(&truth.bbox));
    let on_other = |b: &BBox| b.iou(&track.bbox) >= ON;
    Ok(Moment {
        visible: truth.visible,
        iou,
        on: is_on(&track.bbox, truth),
        presence: f64::from(track.presence),
        state: track.state,
        believed: track.state.is_seen() && track.presence >= 0.5,
        other: iou < OFF && truth.distractors.iter().map(bbox).any(|b| on_other(&b)),
    })
}

fn mean_iou(moments: &[Moment]) -> f64 {
    let seen: Vec<f64> = moments.iter().filter(|m| m.visible > CLEAR).map(|m| f64::from(m.iou)).collect();
    seen.iter().sum::<f64>() / seen.len().max(1) as f64
}

/// Returns of a target that was tracked before it went, and how many of them were found again in time.
fn returns(moments: &[Moment]) -> (usize, usize) {
    let (mut returns, mut found, mut at) = (0, 0, 0);
    while at < moments.len() {
        let gone = moments[at..].iter().take_while(|m| m.visible <= CLEAR).count();
        let truly = moments[at..at + gone].iter().filter(|m| m.visible <= GONE).count();
        let tracked = moments[at.saturating_sub(10)..at].iter().any(|m| m.on == Some(true));
        let back = &moments[at + gone..];
        if truly >= ABSENCE && tracked && back.len() >= RETURN_FRAMES {
            returns += 1;
            let again = back[..RETURN_FRAMES].iter().any(|m| m.on == Some(true) && m.believed);
            found += usize::from(again);
        }
        at += gone.max(1);
    }
    (returns, found)
}

fn locks_wrong(moments: &[Moment]) -> bool {
    let mut row = 0;
    moments.iter().any(|m| {
        row = if m.other && m.believed { row + 1 } else { 0 };
        row >= WRONG_FRAMES
    })
}

fn summarise(name: &str, flights: &[&[Moment]]) {
    let all = || flights.iter().flat_map(|f| f.iter());
    let labelled: Vec<_> = all().filter_map(|m| Some((m.presence, m.on?))).collect();
    let gone: Vec<_> = all()
        .filter(|m| m.visible <= GONE || (m.visible > CLEAR && m.on == Some(true)))
        .map(|m| (m.presence, m.visible > CLEAR))
        .collect();
    let share = |of: &dyn Fn(&&Moment) -> bool, hit: &dyn Fn(&&Moment) -> bool| {
        let of: Vec<&Moment> = all().filter(of).collect();
        of.iter().filter(|m| hit(m)).count() as f64 / of.len().max(1) as f64
    };
    let tracked = |m: &&Moment| m.visible > CLEAR && m.on == Some(true);
    let false_lost = share(&tracked, &|m| !m.believed);
    let missed = share(&|m| m.visible <= GONE, &|m| m.believed);
    let (returns, found) = flights.iter().map(|f| returns(f)).fold((0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
    let wrong = flights.iter().filter(|f| locks_wrong(f)).count();
    let iou = flights.iter().map(|f| mean_iou(f)).sum::<f64>() / flights.len().max(1) as f64;
    let shown = |a: Option<f64>| a.map_or("none".into(), |a| format!("{a:.4}"));
    println!("\n{name}: mean IoU {iou:.3} over {} flights", flights.len());
    println!("AUROC on/off target {}, visible/gone {}", shown(auroc(&labelled)), shown(auroc(&gone)));
    println!("frames on the target but not believed {:.2} %", 100.0 * false_lost);
    println!("frames without the target but believed {:.2} %", 100.0 * missed);
    println!("returns found again within {RETURN_FRAMES} frames: {found} of {returns}");
    println!("flights locked on another object for {WRONG_FRAMES} frames: {wrong} of {}", flights.len());
    println!("{}", reliability(&labelled));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moment(visible: f32, iou: f32, believed: bool) -> Moment {
        let on = Some(visible > 0.25 && iou > ON);
        Moment {
            visible,
            iou,
            on,
            presence: f64::from(u8::from(believed)),
            state: State::Tracking,
            believed,
            other: iou < OFF,
        }
    }

    #[test]
    fn counts_returns() {
        let (there, away) = ([moment(1.0, 0.8, true); 20], [moment(0.0, 0.0, false); 10]);
        let back = [[moment(1.0, 0.0, false); 30], [moment(1.0, 0.7, true); 30]].concat();
        let good = [&there[..], &away, &back].concat();
        assert_eq!(returns(&good), (1, 1));
        let never = [&there[..], &away, &[moment(1.0, 0.0, false); 60]].concat();
        assert_eq!(returns(&never), (1, 0));
        let short = [&there[..], &away[..3], &back].concat();
        assert_eq!(returns(&short), (0, 0));
    }

    #[test]
    fn a_long_lock_on_another_object_is_wrong() {
        let other = moment(1.0, 0.0, true);
        assert!(!locks_wrong(&[other; 14]));
        assert!(locks_wrong(&[other; 15]));
        assert!(!locks_wrong(&[moment(1.0, 0.0, false); 40]));
    }
}
