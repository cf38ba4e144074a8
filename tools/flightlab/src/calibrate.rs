//! `calibrate`: collect, fit, measure, write.

use std::fmt::Write as _;
use std::path::Path;

use track_cpu::flight::{EVIDENCE_NAMES, PRESENCE_NOTE, Presence, Weighing};
use weights_format::{Storage, Weights};

use crate::clips;
use crate::collect::{Sample, Samples, collect};
use crate::fit::{Inputs, logistic};
use crate::measure::{auroc, log_loss, reliability};
use crate::{CalibrateArgs, Failure, load};

/// Shares of the frame before that are tried.
const MEMORIES: [f64; 5] = [0.0, 0.3, 0.5, 0.65, 0.8];

/// Evidence that must not speak against the target: what the online filter and the colors say. It agrees with so much else that its weight
/// could come out below 0, and then a picture that shows nothing speaks for the target.
const RISING: [&str; 3] = ["response", "contrast", "colors"];

/// Evidence that counts only where a lost target is looked for: while one is followed the light may change, which it does not in rendered flights.
const ONLY_AGAIN: [&str; 1] = ["colors"];

/// Runs the sub-command.
pub fn run(args: &CalibrateArgs) -> Result<(), Failure> {
    let model = load(args.model.as_ref())?;
    let mut clips = clips::flights(&args.flights, args.seed);
    clips.extend(clips::footage(&args.footage)?);
    let train = collect(&model, &clips, args.jobs)?;
    if let Some(path) = &args.dump {
        dump(path, &train)?;
    }
    let presence = if args.again_only {
        rounded(Presence {
            again: fit_again(&train)?,
            ..Presence::of(model.header())?
        })
    } else {
        fit(&train)?
    };
    print!("{}", presence.to_text());
    report("fitted to", &presence, &train);
    let test = collect(
        &model,
        &clips::flights(&args.flights, args.test_seed),
        args.jobs,
    )?;
    report("measured on other flights", &presence, &test);
    for (index, name) in EVIDENCE_NAMES.iter().enumerate() {
        let alone = auroc(&labeled(&test, |s| s.evidence.to_array()[index]));
        println!("AUROC of {name} alone: {}", shown(alone));
    }
    if let Some(path) = &args.text {
        std::fs::write(path, presence.to_text())
            .map_err(|error| Failure::File(path.clone(), error.to_string()))?;
    }
    args.into
        .as_deref()
        .map_or(Ok(()), |path| write(path, &presence))
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
    std::fs::write(path, text).map_err(|error| Failure::File(path.into(), error.to_string()))
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

fn inputs<'a>(samples: impl Iterator<Item = &'a Sample>) -> Vec<(Inputs, bool)> {
    samples
        .filter_map(|s| Some((s.evidence.to_array(), s.on?)))
        .collect()
}

/// Fits the single look first, then memory, gain and shift of consecutive ones.
fn fit(flights: &[Samples]) -> Result<Presence, Failure> {
    let runs = || flights.iter().flat_map(|f| f.runs.iter().flatten());
    let looks = || flights.iter().flat_map(|f| &f.looks);
    let mut all = inputs(runs().chain(looks()));
    for index in places(&ONLY_AGAIN) {
        all.iter_mut().for_each(|(values, _)| values[index] = 0.0);
    }
    let (look, again) = (weighing(&all)?, fit_again(flights)?);
    let plain = Presence {
        look,
        again,
        memory: 0.0,
        gain: 1.0,
        shift: 0.0,
    };
    let tried = MEMORIES
        .iter()
        .map(|&memory| smooth(plain, memory, flights));
    let best = tried.min_by(|a, b| a.0.total_cmp(&b.0));
    Ok(rounded(best.map_or(plain, |(_, presence)| presence)))
}

/// Fits a look for a target that was lost.
fn fit_again(flights: &[Samples]) -> Result<Weighing, Failure> {
    weighing(&inputs(flights.iter().flat_map(|f| &f.again)))
}

/// What each piece of evidence is worth, by looks of both kinds.
fn weighing(looks: &[(Inputs, bool)]) -> Result<Weighing, Failure> {
    let off = looks.iter().filter(|(_, on)| !on).count();
    eprintln!("{} looks, {off} of them off the target", looks.len());
    if off < 50 || looks.len() - off < 50 {
        let needed = "at least 50 looks on and 50 off the target are needed: take more flights";
        return Err(Failure::Nothing(needed.into()));
    }
    let (bias, weights) = logistic(looks, &places(&RISING));
    Ok(Weighing { bias, weights })
}

/// Where some evidence is among all.
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

/// The model with gain and shift for its memory, and its mean loss.
fn smooth(mut presence: Presence, memory: f64, flights: &[Samples]) -> (f64, Presence) {
    presence.memory = memory;
    let labeled = |(odds, sample): (f64, &Sample)| Some(([odds], sample.on?));
    let odds: Vec<([f64; 1], bool)> = smoothed(&presence, flights)
        .into_iter()
        .filter_map(labeled)
        .collect();
    let (shift, [gain]) = logistic(&odds, &[]);
    (presence.gain, presence.shift) = (gain.max(0.05), shift);
    (log_loss(&probabilities(&presence, flights)), presence)
}

/// Smoothed log-odds of every frame of every run, as the tracker smooths them.
fn smoothed<'a>(presence: &Presence, flights: &'a [Samples]) -> Vec<(f64, &'a Sample)> {
    let mut out = Vec::new();
    for run in flights.iter().flat_map(|f| &f.runs) {
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

fn probabilities(presence: &Presence, flights: &[Samples]) -> Vec<(f64, bool)> {
    let probability = |odds: f64| 1.0 / (1.0 + (-(presence.gain * odds + presence.shift)).exp());
    smoothed(presence, flights)
        .into_iter()
        .filter_map(|(odds, s)| Some((probability(odds), s.on?)))
        .collect()
}

fn labeled(flights: &[Samples], value: impl Fn(&Sample) -> f64) -> Vec<(f64, bool)> {
    let samples = flights.iter().flat_map(|f| f.runs.iter().flatten());
    samples.filter_map(|s| Some((value(s), s.on?))).collect()
}

fn shown(auroc: Option<f64>) -> String {
    auroc.map_or("no absences".into(), |a| format!("{a:.4}"))
}

fn report(title: &str, presence: &Presence, flights: &[Samples]) {
    let frames = probabilities(presence, flights);
    let gone: Vec<(f64, bool)> = smoothed(presence, flights)
        .into_iter()
        .filter_map(|(odds, s)| {
            if s.gone {
                Some((odds, false))
            } else {
                s.on?.then_some((odds, true))
            }
        })
        .collect();
    let alone = |of: fn(&Samples) -> &Vec<Sample>, weighing: &Weighing| -> Vec<(f64, bool)> {
        flights
            .iter()
            .flat_map(of)
            .filter_map(|s| Some((weighing.alone(&s.evidence), s.on?)))
            .collect()
    };
    let looks = alone(|f| &f.looks, &presence.look);
    println!(
        "\n{title}: {} flights, {} frames, {} single looks",
        flights.len(),
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
    let again = alone(|f| &f.again, &presence.again);
    let alike = alone(|f| &f.again, &presence.look);
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
        assert_eq!(places(&ONLY_AGAIN).len(), ONLY_AGAIN.len());
    }
}
