//! `calibrate`: collect, fit, measure, write.

use std::fmt::Write as _;
use std::path::Path;

use track_cpu::flight::{EVIDENCE_NAMES, PRESENCE_NOTE, Presence, Weighing};
use weights_format::{Storage, Weights};

use crate::clips;
use crate::collect::{Sample, Samples, collect};
use crate::fit::{Labeled, Look, logistic};
use crate::measure::{auroc, log_loss, reliability};
use crate::{CalibrateArgs, Failure, load, spare, write_text};

/// Shares of the frame before that are tried.
const MEMORIES: [f64; 5] = [0.0, 0.3, 0.5, 0.65, 0.8];

/// Evidence that must not speak against the target. It agrees with so much else that its weight
/// could come out below 0, and then a picture that shows nothing speaks for the target.
const RISING: [&str; 3] = ["response", "contrast", "colors"];

/// Most parts of the cross-validation.
const FOLDS: usize = 10;

/// Runs the sub-command.
pub fn run(args: &CalibrateArgs) -> Result<(), Failure> {
    // The file that --into names is read as well, and carries the coefficients from then on.
    spare(
        &[
            ("--into", args.into.as_ref()),
            ("--text", args.text.as_ref()),
            ("--dump", args.dump.as_ref()),
        ],
        &[
            args.footage.sequences.as_ref(),
            args.footage.stills.as_ref(),
        ],
    )?;
    spare(
        &[
            ("--text", args.text.as_ref()),
            ("--dump", args.dump.as_ref()),
        ],
        &[args.model.as_ref()],
    )?;
    let model = load(args.model.as_ref())?;
    let clips = clips::all(&args.flights, args.seed, &args.footage)?;
    let samples = collect(&model, &clips, args.jobs)?;
    if let Some(path) = &args.dump {
        dump(path, &samples)?;
    }
    let kept = args.again_only.then(|| Presence::of(model.header()));
    let kept = kept.transpose()?;
    let all: Vec<&Samples> = samples.iter().collect();
    let presence = fit(&all, kept.as_ref())?;
    print!("{}", presence.to_text());
    let fitted: Vec<_> = all.iter().map(|clip| (presence, *clip)).collect();
    report("fitted to", &fitted);
    let held_out = cross_validate(&all, kept.as_ref())?;
    let of = |footage: bool| {
        let part = held_out.iter().filter(|(_, c)| c.is_footage == footage);
        part.copied().collect::<Vec<_>>()
    };
    for (title, footage) in [("footage", true), ("rendered flights", false)] {
        let part = of(footage);
        if !part.is_empty() {
            report(&format!("{title}, fitted without it"), &part);
        }
    }
    for (index, name) in EVIDENCE_NAMES.iter().enumerate() {
        let alone = auroc(&labeled(&all, |s| s.evidence.to_array()[index]));
        println!("AUROC of {name} alone: {}", shown(alone));
    }
    if let Some(path) = &args.text {
        write_text(path, &presence.to_text())?;
    }
    match &args.into {
        Some(path) => write(path, &presence),
        None => Ok(()),
    }
}

/// Every clip with coefficients that were fitted without its group.
fn cross_validate<'a>(
    clips: &[&'a Samples],
    kept: Option<&Presence>,
) -> Result<Vec<(Presence, &'a Samples)>, Failure> {
    let mut groups: Vec<&str> = clips.iter().map(|clip| clip.group.as_str()).collect();
    groups.sort_unstable();
    groups.dedup();
    let folds = FOLDS.min(groups.len());
    let fold = |clip: &Samples| groups.iter().position(|g| *g == clip.group).unwrap_or(0) % folds;
    let mut held_out = Vec::new();
    for left_out in 0..folds {
        let (test, train): (Vec<&Samples>, Vec<&Samples>) =
            clips.iter().partition(|clip| fold(clip) == left_out);
        if !train.is_empty() {
            let presence = fit(&train, kept)?;
            held_out.extend(test.into_iter().map(|clip| (presence, clip)));
        }
    }
    Ok(held_out)
}

/// Writes all looks as a table with tabs: group, run, kind, truth, gone, evidence.
fn dump(path: &Path, clips: &[Samples]) -> Result<(), Failure> {
    let mut text = format!(
        "group\trun\tkind\ton\tgone\t{}\n",
        EVIDENCE_NAMES.join("\t")
    );
    for (clip, samples) in clips.iter().enumerate() {
        let runs = samples.runs.iter().enumerate();
        let runs = runs.map(|(i, run)| (format!("{clip}.{i}"), "run", run));
        let single = [("look", &samples.looks), ("again", &samples.again)];
        let single = single.map(|(kind, looks)| (clip.to_string(), kind, looks));
        for (run, kind, looks) in runs.chain(single) {
            for look in looks {
                let on = look.on.map_or("-", |on| if on { "1" } else { "0" });
                let gone = u8::from(look.gone);
                let values = look.evidence.to_array().map(|v| format!("{v:.5}"));
                let _ = writeln!(
                    text,
                    "{}\t{run}\t{kind}\t{on}\t{gone}\t{}",
                    samples.group,
                    values.join("\t")
                );
            }
        }
    }
    write_text(path, &text)
}

/// Adds the coefficients to a weights file.
fn write(path: &Path, presence: &Presence) -> Result<(), Failure> {
    let mut weights = Weights::read(path)?;
    weights
        .header
        .provenance
        .notes
        .insert(PRESENCE_NOTE.into(), presence.to_text());
    debug_assert!(matches!(
        weights.header.storage,
        Storage::F32 | Storage::F16
    ));
    weights.write(path)?;
    Ok(())
}

/// Looks with their truth; footage and rendered flights count the same in all.
fn looks<'a, F, I>(clips: &[&'a Samples], of: F) -> Vec<Look>
where
    F: Fn(&'a Samples) -> I,
    I: Iterator<Item = &'a Sample>,
{
    let mut looks = Vec::new();
    let mut footage = Vec::new(); // whether each look is
    for clip in clips {
        for sample in of(clip) {
            let Some(on) = sample.on else { continue };
            footage.push(clip.is_footage);
            looks.push(Look {
                inputs: sample.evidence.to_array(),
                on,
                weight: 1.0,
            });
        }
    }
    let real = footage.iter().filter(|is_footage| **is_footage).count();
    for (look, is_footage) in looks.iter_mut().zip(&footage) {
        let count = if *is_footage {
            real
        } else {
            footage.len() - real
        };
        look.weight = 1.0 / count.max(1) as f64;
    }
    looks
}

/// Fits the single look first, then memory, gain and shift of consecutive ones; only looks for a
/// lost target if the other coefficients are `kept`.
fn fit(clips: &[&Samples], kept: Option<&Presence>) -> Result<Presence, Failure> {
    let again = weighing(&looks(clips, |clip| clip.again.iter()))?;
    if let Some(kept) = kept {
        return Ok(rounded(Presence { again, ..*kept }));
    }
    let all = looks(clips, |clip| clip.runs.iter().flatten().chain(&clip.looks));
    let plain = Presence {
        look: weighing(&all)?,
        again,
        memory: 0.0,
        gain: 1.0,
        shift: 0.0,
    };
    let tried = MEMORIES.iter().map(|&memory| smooth(plain, memory, clips));
    let best = tried.min_by(|a, b| a.0.total_cmp(&b.0));
    Ok(rounded(best.map_or(plain, |(_, presence)| presence)))
}

/// Weights of each piece of evidence, by looks of both kinds.
fn weighing(looks: &[Look]) -> Result<Weighing, Failure> {
    let off = looks.iter().filter(|look| !look.on).count();
    if off < 50 || looks.len() - off < 50 {
        let needed = "at least 50 looks on and 50 off the target are needed: take more clips";
        return Err(Failure::Nothing(needed.into()));
    }
    let (bias, weights) = logistic(looks, &places(&RISING));
    Ok(Weighing { bias, weights })
}

/// The places of some evidence among all.
fn places(names: &[&str]) -> Vec<usize> {
    (0..EVIDENCE_NAMES.len())
        .filter(|&i| names.contains(&EVIDENCE_NAMES[i]))
        .collect()
}

/// Six significant digits are more than the fit is worth.
fn rounded(mut presence: Presence) -> Presence {
    let Presence {
        look,
        again,
        gain,
        shift,
        ..
    } = &mut presence;
    let both = [look, again]
        .into_iter()
        .flat_map(|w| std::iter::once(&mut w.bias).chain(&mut w.weights));
    for number in [gain, shift].into_iter().chain(both) {
        *number = format!("{number:.5e}").parse().unwrap_or(*number);
    }
    presence
}

/// The model with gain and shift for its memory, and its mean loss. Frames on and off the target
/// count the same in all: how often a target is gone depends on the flight, not on the evidence.
fn smooth(mut presence: Presence, memory: f64, clips: &[&Samples]) -> (f64, Presence) {
    presence.memory = memory;
    let mut odds = Vec::new();
    for (log_odds, sample) in clips.iter().flat_map(|clip| smoothed(&presence, clip)) {
        if let Some(on) = sample.on {
            odds.push(Labeled {
                inputs: [log_odds],
                on,
                weight: 1.0,
            });
        }
    }
    let on = odds.iter().filter(|odds| odds.on).count();
    let off = odds.len() - on;
    for odds in &mut odds {
        let count = if odds.on { on } else { off };
        odds.weight = 1.0 / count.max(1) as f64;
    }
    let (shift, [gain]) = logistic(&odds, &[]);
    presence.gain = gain.max(0.05);
    presence.shift = shift;
    let judged: Vec<_> = clips.iter().map(|clip| (presence, *clip)).collect();
    (log_loss(&probabilities(&judged)), presence)
}

/// Smoothed log-odds of every frame of every run, as the tracker smooths them.
fn smoothed<'a>(presence: &Presence, clip: &'a Samples) -> Vec<(f64, &'a Sample)> {
    let mut out = Vec::new();
    for run in &clip.runs {
        let mut before = None;
        for sample in run {
            let now = presence.look.log_odds(&sample.evidence).clamp(-12.0, 12.0);
            let odds = before.map_or(now, |b| presence.memory * b + (1.0 - presence.memory) * now);
            before = Some(odds);
            out.push((odds, sample));
        }
    }
    out
}

/// The probability of every frame, and what came true.
fn probabilities(clips: &[(Presence, &Samples)]) -> Vec<(f64, bool)> {
    let mut out = Vec::new();
    for (presence, clip) in clips {
        for (odds, sample) in smoothed(presence, clip) {
            if let Some(on) = sample.on {
                let odds = presence.gain * odds + presence.shift;
                out.push((1.0 / (1.0 + (-odds).exp()), on));
            }
        }
    }
    out
}

fn labeled(clips: &[&Samples], value: impl Fn(&Sample) -> f64) -> Vec<(f64, bool)> {
    let samples = clips.iter().flat_map(|clip| clip.runs.iter().flatten());
    samples.filter_map(|s| Some((value(s), s.on?))).collect()
}

fn shown(auroc: Option<f64>) -> String {
    auroc.map_or("no absences".into(), |a| format!("{a:.4}"))
}

fn report(title: &str, clips: &[(Presence, &Samples)]) {
    let frames = probabilities(clips);
    let mut gone = Vec::new();
    let mut looks = Vec::new();
    let mut again = Vec::new();
    let mut alike = Vec::new();
    for (presence, clip) in clips {
        for (odds, sample) in smoothed(presence, clip) {
            if sample.gone || sample.on == Some(true) {
                gone.push((odds, !sample.gone));
            }
        }
        let alone = |samples: &[Sample], weighing: &Weighing| -> Vec<(f64, bool)> {
            let judged = |s: &Sample| Some((weighing.alone(&s.evidence), s.on?));
            samples.iter().filter_map(judged).collect()
        };
        looks.extend(alone(&clip.looks, &presence.look));
        again.extend(alone(&clip.again, &presence.again));
        alike.extend(alone(&clip.again, &presence.look));
    }
    println!(
        "\n{title}: {} clips, {} frames, {} single looks",
        clips.len(),
        frames.len(),
        looks.len()
    );
    println!("AUROC on/off target {}", shown(auroc(&frames)));
    println!(
        "AUROC target visible and tracked/gone {}",
        shown(auroc(&gone))
    );
    println!("AUROC single looks {}", shown(auroc(&looks)));
    println!("{}", reliability(&frames));
    println!(
        "looks for a target that was not seen for up to three seconds: {}",
        again.len()
    );
    println!(
        "AUROC {}; weighed as if it had been seen just before {}",
        shown(auroc(&again)),
        shown(auroc(&alike))
    );
    println!("{}", reliability(&again));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn named_evidence_exists() {
        assert_eq!(places(&RISING).len(), RISING.len());
    }
}
