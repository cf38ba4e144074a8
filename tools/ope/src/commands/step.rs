//! `ope step`.

use crate::args::StepArgs;
use ope::Error;
use ope::step::{Steps, steps};
use ope::table::Table;
use sequences::{Notes, curves};
use serde_json::{Value, json};
use track_cpu::{Isa, Model};

/// Measures the tracker step by step.
pub fn run(args: &StepArgs) -> Result<(), Error> {
    let mut notes = Notes::default();
    let sequences = args.dataset.load(&args.root, &mut notes)?;
    eprint!("{notes}");
    let model = Model::from_weights(&Model::find(args.model.as_deref())?, Isa::detect())?;
    let mut all = Vec::new();
    for (i, sequence) in sequences.iter().enumerate() {
        let name = &sequence.annotation.name;
        eprintln!("{} of {}: {name}", i + 1, sequences.len());
        all.push((name, steps(&model, sequence)?));
    }
    let stepped: Vec<_> = all
        .iter()
        .map(|(_, steps)| *steps)
        .filter(|steps| steps.frames > 0)
        .collect();
    let share = |part: fn(&Steps) -> f64| curves::mean(stepped.iter().map(part));
    let mean = Steps {
        frames: stepped.iter().map(|s| s.frames).sum(),
        found: share(|s| s.found),
        iou: share(|s| s.iou),
    };
    if args.json {
        let per_sequence: Value = all
            .iter()
            .map(|(name, steps)| json!({"sequence": name, "steps": steps}))
            .collect();
        return super::print(&format!(
            "{:#}\n",
            json!({"mean": mean, "per_sequence": per_sequence})
        ));
    }
    let mut table = Table::new(["sequence", "frames", "found", "mean IoU"]);
    let mut row = |name: &str, s: &Steps| {
        let percent = [s.found, s.iou].map(|share| format!("{:.1}", 100.0 * share));
        let [found, iou] = percent;
        table.row([name.to_owned(), s.frames.to_string(), found, iou]);
    };
    for (name, steps) in &all {
        row(name, steps);
    }
    row("mean", &mean);
    super::print(&table.to_string())
}
