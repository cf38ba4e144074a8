//! `sequences`: both modes on real sequences, and presence where the annotation says that the target is absent.

use std::path::{Path, PathBuf};

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
    let folders = find(&args.folder)?;
    let (mut totals, mut labeled, mut lost) = ([0.0; 2], Vec::new(), (0, 0));
    for folder in &folders {
        let truth = annotation(folder)?;
        let mut aucs = [0.0; 2];
        for (recover, auc) in [false, true].into_iter().zip(&mut aucs) {
            let tracks = track(&model, &presence, folder, &truth, recover, args.searches)?;
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
            folder.display(),
            aucs[0],
            aucs[1]
        );
        totals
            .iter_mut()
            .zip(aucs)
            .for_each(|(total, auc)| *total += auc / folders.len() as f64);
    }
    println!(
        "\n{} sequences: AUC paper {:.4}, flight {:.4}",
        folders.len(),
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

/// Success (AUC) over 21 thresholds; frames without an annotation are left out.
fn success(tracks: &[(BBox, f64, bool)], truth: &[Option<BBox>]) -> f64 {
    let ious: Vec<f32> = tracks
        .iter()
        .zip(truth)
        .filter_map(|((bbox, ..), truth)| truth.map(|t| bbox.iou(&t)))
        .collect();
    let above = |t: usize| ious.iter().filter(|&&iou| iou > t as f32 / 20.0).count() as f64;
    (0..21).map(above).sum::<f64>() / 21.0 / ious.len().max(1) as f64
}

type Tracks = Vec<(BBox, f64, bool)>;

fn track(
    model: &Model,
    presence: &Presence,
    folder: &Path,
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
    let wrong =
        |error: &dyn std::fmt::Display| Failure::File(folder.to_path_buf(), error.to_string());
    let source = Source::open(&Input::new(folder.join("img"))).map_err(|error| wrong(&error))?;
    let mut tracks = Vec::new();
    for image in source.take(truth.len()) {
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

/// Lines of x, y, w, h; NaN and empty boxes are absences.
fn annotation(folder: &Path) -> Result<Vec<Option<BBox>>, Failure> {
    let path = folder.join("groundtruth_rect.txt");
    let text =
        std::fs::read_to_string(&path).map_err(|e| Failure::File(path.clone(), e.to_string()))?;
    let line = |line: &str| {
        let numbers: Vec<f32> = line
            .split([',', '\t', ' '])
            .filter_map(|n| n.trim().parse().ok())
            .collect();
        match numbers[..] {
            [x, y, w, h, ..] if w > 0.0 && h > 0.0 => {
                Some(BBox::new(x, y, w, h)).filter(BBox::is_finite)
            }
            _ => None,
        }
    };
    Ok(text
        .lines()
        .filter(|l| !l.trim().is_empty())
        .map(line)
        .collect())
}

/// Folders with an annotation, one or two levels below.
fn find(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let below = |folder: &Path| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        let mut folders: Vec<_> = entries.map(|e| e.path()).filter(|p| p.is_dir()).collect();
        folders.sort();
        folders
    };
    let one = below(folder);
    let two = one.iter().flat_map(|f| below(f)).collect::<Vec<_>>();
    let with = |f: &PathBuf| f.join("groundtruth_rect.txt").is_file();
    let found: Vec<_> = one.into_iter().chain(two).filter(with).collect();
    if found.is_empty() {
        return Err(Failure::Nothing(format!(
            "{}: no sequence with groundtruth_rect.txt",
            folder.display()
        )));
    }
    Ok(found)
}
