//! `sequences`: plain and flight mode on real sequences, frame by frame on the same pictures.

use std::fmt::Write as _;
use std::path::Path;

use ope::starts;
use sequences::{Annotation, Convention, Curves, Rect, Sequence};
use track_cpu::flight::{Budget, FlightOptions, FlightTracker, Presence};
use track_cpu::{BBox, Model, State, Tracker};

use crate::clips::{self, OFF, ON, each, tracked};
use crate::measure::{auroc, reliability};
use crate::{Failure, SequencesArgs, load, losses, presence, spare, write_text};

/// What one frame came to.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// The box.
    pub bbox: BBox,
    /// Presence; the score in plain mode.
    pub presence: f64,
    /// The state; always tracking in plain mode.
    pub state: State,
    /// Whether the box is worth acting on.
    pub believed: bool,
    /// The raw score.
    pub score: f32,
}

/// What one pass over a sequence came to.
#[derive(Debug)]
pub struct Pass {
    /// The truth.
    pub annotation: Annotation,
    plain: Vec<Moment>,
    /// Flight mode, frame by frame.
    pub flight: Vec<Moment>,
}

/// Runs the sub-command.
pub fn run(args: &SequencesArgs) -> Result<(), Failure> {
    spare(
        &[
            ("--traces", args.traces.as_ref()),
            ("--losses", args.losses.as_ref()),
        ],
        &[Some(&args.folder), args.model.as_ref(), args.text.as_ref()],
    )?;
    let model = load(args.model.as_ref())?;
    let presence = presence(args.text.as_ref(), &model)?;
    let mut sequences = clips::load(&args.folder, &args.only)?;
    if args.four_starts {
        sequences = starts::sequences(sequences);
    }
    let passes = each(args.jobs, sequences.len(), |index| {
        follow(&model, &presence, &sequences[index], args)
    })?;
    if let Some(folder) = &args.traces {
        for pass in &passes {
            write_trace(folder, pass)?;
        }
    }
    report(&passes);
    if let Some(folder) = &args.losses {
        let count = losses::write(folder, &passes, &sequences)?;
        eprintln!("{count} losses in {}", folder.join("index.html").display());
    }
    Ok(())
}

/// Both modes on one sequence.
fn follow(
    model: &Model,
    presence: &Presence,
    sequence: &Sequence,
    args: &SequencesArgs,
) -> Result<Pass, Failure> {
    let annotation = sequence.annotation.clone();
    let name = || annotation.name.clone();
    let mut plain = Tracker::new(model.clone());
    let options = FlightOptions::new(model);
    let mut flight = FlightTracker::with_presence(model.clone(), options, *presence);
    let mut moments = [Vec::new(), Vec::new()];
    for (index, path) in sequence.frames.iter().enumerate() {
        let image = clips::read(path)?;
        let frame = image.frame();
        let found = if index == 0 {
            let first = annotation.boxes.first().map(tracked);
            let bbox = first.ok_or_else(|| Failure::Nothing(format!("{}: no box", name())))?;
            plain.init(&frame, bbox)?;
            flight.init(&frame, bbox)?;
            let given = Moment {
                bbox,
                presence: 1.0,
                state: State::Tracking,
                believed: true,
                score: 1.0,
            };
            [given; 2]
        } else {
            let flown = flight.update(&frame, Budget::Searches(args.searches))?;
            let track = plain.update(&frame)?;
            [
                Moment {
                    bbox: track.bbox,
                    presence: f64::from(track.score),
                    state: State::Tracking,
                    believed: true,
                    score: track.score,
                },
                Moment {
                    bbox: flown.bbox,
                    presence: f64::from(flown.presence),
                    state: flown.state,
                    believed: flown.is_believed(),
                    score: flown.score,
                },
            ]
        };
        for (moments, found) in moments.iter_mut().zip(found) {
            moments.push(found);
        }
    }
    let [plain, flight] = moments;
    Ok(Pass {
        annotation,
        plain,
        flight,
    })
}

impl Pass {
    fn curves(&self, moments: &[Moment]) -> Option<Curves> {
        let rect = |m: &Moment| Rect::from([m.bbox.x, m.bbox.y, m.bbox.w, m.bbox.h]);
        let boxes: Vec<Rect> = moments.iter().map(rect).collect();
        Convention::Got10k.curves(&self.annotation, &boxes)
    }

    /// IoU with the annotation; `None` where there is none.
    fn iou(&self, index: usize, bbox: &BBox) -> Option<f32> {
        let truth = self.annotation.boxes.get(index)?;
        truth.is_usable().then(|| bbox.iou(&tracked(truth)))
    }

    /// Times that the target was given up in plain view: the frame before, the box was on it.
    fn given_up(&self) -> Vec<usize> {
        (1..self.flight.len())
            .filter(|&i| {
                let leaves = self.flight[i - 1].state.is_seen() && !self.flight[i].state.is_seen();
                let was_on = self
                    .iou(i - 1, &self.flight[i - 1].bbox)
                    .is_some_and(|iou| iou >= ON);
                leaves && was_on && self.iou(i, &self.flight[i].bbox).is_some()
            })
            .collect()
    }
}

fn report(passes: &[Pass]) {
    println!(
        "sequence                    plain AUC  prec.  flight AUC  prec.  not believed  given up"
    );
    let mut totals = [Vec::new(), Vec::new()];
    let (mut labeled, mut on, mut unbelieved, mut given_up) = (Vec::new(), 0, 0, 0);
    for pass in passes {
        let (Some(plain), Some(flight)) = (pass.curves(&pass.plain), pass.curves(&pass.flight))
        else {
            continue;
        };
        let mut here = (0, 0);
        for (i, moment) in pass.flight.iter().enumerate().skip(1) {
            match pass.iou(i, &moment.bbox) {
                Some(iou) if iou >= ON => {
                    here = (here.0 + 1, here.1 + usize::from(!moment.believed));
                    labeled.push((moment.presence, true));
                }
                Some(iou) if iou >= OFF => {}
                _ => labeled.push((moment.presence, false)),
            }
        }
        let given = pass.given_up();
        println!(
            "{:<28} {:>8.1} {:>6.1} {:>11.1} {:>6.1} {:>12.1}%  {given:?}",
            pass.annotation.name,
            100.0 * plain.auc(),
            100.0 * plain.precision(),
            100.0 * flight.auc(),
            100.0 * flight.precision(),
            100.0 * here.1 as f64 / f64::from(here.0.max(1)),
        );
        on += here.0;
        unbelieved += here.1;
        given_up += given.len();
        totals[0].push(plain);
        totals[1].push(flight);
    }
    let [plain, flight] = totals.map(|curves| {
        Curves::mean(&curves).map_or((0.0, 0.0), |c| (100.0 * c.auc(), 100.0 * c.precision()))
    });
    println!(
        "{:<28} {:>8.2} {:>6.2} {:>11.2} {:>6.2} {:>12.1}%  {given_up}",
        format!("mean of {}", passes.len()),
        plain.0,
        plain.1,
        flight.0,
        flight.1,
        100.0 * unbelieved as f64 / f64::from(u32::max(on, 1)),
    );
    let area = auroc(&labeled).map_or("none".into(), |a| format!("{a:.4}"));
    println!("\nAUROC of presence, on against off the target: {area}");
    println!("{}", reliability(&labeled));
}

/// A line per frame: IoU of both modes, presence, state, scores.
fn write_trace(folder: &Path, pass: &Pass) -> Result<(), Failure> {
    let path = folder.join(format!("{}.txt", pass.annotation.name.replace('/', "_")));
    let mut text = String::new();
    for (i, (plain, flight)) in pass.plain.iter().zip(&pass.flight).enumerate() {
        let shown = |bbox: &BBox| {
            pass.iou(i, bbox)
                .map_or("-".into(), |iou| format!("{iou:.2}"))
        };
        let _ = writeln!(
            text,
            "{i} plain {} {:.2} flight {} {:.6} presence {:.4} {}{} box {:.3} {:.3} {:.3} {:.3}",
            shown(&plain.bbox),
            plain.score,
            shown(&flight.bbox),
            flight.score,
            flight.presence,
            flight.state.name(),
            if flight.believed { "" } else { " unbelieved" },
            flight.bbox.x,
            flight.bbox.y,
            flight.bbox.w,
            flight.bbox.h,
        );
    }
    std::fs::create_dir_all(folder)
        .map_err(|error| Failure::Unwritable(folder.into(), error.to_string()))?;
    write_text(&path, &text)
}
