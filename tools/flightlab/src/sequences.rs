//! `sequences`: both modes on real sequences, and presence where the annotation says that the target is absent.

use std::path::Path;

use ::sequences::{Annotation, Convention, Notes, Rect, Sequence};
use track_cpu::flight::{Budget, Conduct, FlightOptions, FlightTracker, Presence};
use track_cpu::source::{Input, Source};
use track_cpu::{BBox, Model};

use crate::flights::{OFF, ON};
use crate::measure::auroc;
use crate::{Failure, SequencesArgs, load, presence};

/// Runs the sub-command.
pub fn run(args: &SequencesArgs) -> Result<(), Failure> {
    let model = load(args.model.as_ref())?;
    let presence = presence(args.text.as_ref(), &model)?;
    let found = find(&args.folder)?;
    let (mut totals, mut labeled, mut lost) = ([0.0; 2], Vec::new(), (0, 0));
    for sequence in &found {
        let truth = truth(sequence);
        let mut aucs = [0.0; 2];
        for (recover, auc) in [false, true].into_iter().zip(&mut aucs) {
            let tracks = track(&model, &presence, sequence, &truth, recover, args.searches)?;
            *auc = success(&tracks, &truth);
            for ((bbox, presence, seen), truth) in tracks.iter().zip(&truth).skip(1) {
                let iou = truth.map(|truth| bbox.iou(&truth));
                if recover && iou.is_some_and(|iou| iou >= ON) {
                    lost = (lost.0 + usize::from(!seen), lost.1 + 1);
                }
                match iou {
                    None => labeled.push((recover, *presence, false)),
                    Some(iou) if iou < OFF => labeled.push((recover, *presence, false)),
                    Some(iou) if iou >= ON => labeled.push((recover, *presence, true)),
                    Some(_) => {}
                }
            }
        }
        let absent = truth.iter().filter(|t| t.is_none()).count();
        println!(
            "{}: AUC paper {:.3}, flight {:.3}; {absent} frames absent",
            sequence.annotation.name, aucs[0], aucs[1]
        );
        totals
            .iter_mut()
            .zip(aucs)
            .for_each(|(total, auc)| *total += auc / found.len() as f64);
    }
    println!(
        "\n{} sequences: AUC paper {:.4}, flight {:.4}",
        found.len(),
        totals[0],
        totals[1]
    );
    for (name, recover) in [("paper", false), ("flight", true)] {
        let samples: Vec<_> = labeled
            .iter()
            .filter(|l| l.0 == recover)
            .map(|l| (l.1, l.2))
            .collect();
        let off = samples.iter().filter(|s| !s.1).count();
        let area = auroc(&samples).map_or("none".into(), |a| format!("{a:.4}"));
        println!(
            "{name}: AUROC on/off target {area} ({} frames, {off} of them off)",
            samples.len()
        );
    }
    let share = 100.0 * lost.0 as f64 / lost.1.max(1) as f64;
    println!("flight: frames on the target but not believed {share:.2} %");
    Ok(())
}

/// Success (AUC) by the rule of the got10k toolkit; frames without an annotation do not count.
fn success(tracks: &[(BBox, f64, bool)], truth: &[Option<BBox>]) -> f64 {
    let rect = |b: &BBox| Rect::from([b.x, b.y, b.w, b.h]);
    let found: Vec<Rect> = tracks.iter().map(|(bbox, ..)| rect(bbox)).collect();
    let truth = truth
        .iter()
        .map(|bbox| bbox.as_ref().map_or(Rect::NONE, rect));
    let annotation = Annotation::new("", truth.collect());
    let curves = Convention::Got10k.curves(&annotation, &found);
    curves.map_or(0.0, |curves| curves.auc())
}

type Tracks = Vec<(BBox, f64, bool)>;

fn track(
    model: &Model,
    presence: &Presence,
    sequence: &Sequence,
    truth: &[Option<BBox>],
    recover: bool,
    searches: u32,
) -> Result<Tracks, Failure> {
    let conduct = if recover {
        Conduct::Recover
    } else {
        Conduct::Tell
    };
    let options = FlightOptions {
        conduct,
        ..FlightOptions::new(model)
    };
    let mut tracker = FlightTracker::with_presence(model.clone(), options, *presence);
    let mut tracks = Vec::new();
    for path in sequence.frames.iter().take(truth.len()) {
        let wrong = |error: &dyn std::fmt::Display| Failure::File(path.clone(), error.to_string());
        let mut source = Source::open(&Input::new(path)).map_err(|error| wrong(&error))?;
        let image = source.next().ok_or_else(|| wrong(&"no picture"))?;
        let image = image.map_err(|error| wrong(&error))?;
        let frame = image.frame();
        tracks.push(match (tracks.is_empty(), truth[0]) {
            (true, Some(bbox)) => {
                tracker.init(&frame, bbox)?;
                (bbox, 1.0, true)
            }
            _ => {
                let track = tracker.update(&frame, Budget::Searches(searches))?;
                let believed = track.is_believed();
                (track.bbox, f64::from(track.presence), believed)
            }
        });
    }
    Ok(tracks)
}

/// The true boxes of a sequence; `None` in frames without a usable one.
fn truth(sequence: &Sequence) -> Vec<Option<BBox>> {
    let bbox = |rect: &Rect| {
        let [x, y, w, h] = rect.to_f32();
        rect.is_usable().then(|| BBox::new(x, y, w, h))
    };
    sequence.annotation.boxes.iter().map(bbox).collect()
}

/// The sequences below a folder.
fn find(folder: &Path) -> Result<Vec<Sequence>, Failure> {
    let mut notes = Notes::default();
    let found = ::sequences::find(folder, &mut notes);
    let found = found.map_err(|error| Failure::Nothing(error.to_string()))?;
    eprint!("{notes}");
    if found.is_empty() {
        let folder = folder.display();
        return Err(Failure::Nothing(format!("{folder}: no annotated sequence")));
    }
    Ok(found)
}
