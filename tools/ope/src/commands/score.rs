//! `ope score`.

use crate::args::{Rule, ScoreArgs};
use ope::score::{Evaluation, Missing, Score};
use ope::table::Table;
use ope::{Error, Results};
use sequences::Notes;
use serde_json::{Value, json};

/// Scores one folder of results.
pub fn run(args: &ScoreArgs) -> Result<(), Error> {
    let results = Results::open(&args.results)?;
    let missing = if args.partial {
        Missing::Skip
    } else {
        Missing::Refuse
    };
    let mut notes = Notes::default();
    let annotations = super::truth(&args.truth)?;
    let evaluation = Evaluation::read(&annotations, &results, missing, &mut notes)?;
    let scores = evaluation.scores(args.convention.conventions(), &mut notes)?;
    eprint!("{notes}");
    let text = if args.json {
        json(args, &evaluation, &scores)
    } else {
        text(args, &evaluation, &scores)
    };
    super::print(&text)
}

fn json(args: &ScoreArgs, evaluation: &Evaluation, scores: &[Score]) -> String {
    let object = |score: &Score| {
        let mut object = json!(score);
        object["fps"] = json!(evaluation.speed);
        if args.per_sequence {
            object["per_sequence"] = score
                .per_sequence
                .iter()
                .map(|(name, curves)| {
                    let precision = 100.0 * curves.precision();
                    let auc = 100.0 * curves.auc();
                    json!({"sequence": name, "precision": precision, "auc": auc})
                })
                .collect();
        }
        object
    };
    let value: Value = match args.convention {
        Rule::All => scores
            .iter()
            .map(|score| (score.convention.to_owned(), object(score)))
            .collect(),
        _ => object(&scores[0]),
    };
    format!("{value:#}\n")
}

fn text(args: &ScoreArgs, evaluation: &Evaluation, scores: &[Score]) -> String {
    let mut table = Table::new([
        "rule",
        "precision@20",
        "AUC",
        "norm. precision",
        "success@0.5",
        "sequences",
    ]);
    for s in scores {
        let percent =
            [s.precision, s.auc, s.norm_precision, s.success_rate].map(|v| format!("{v:.2}"));
        let [precision, auc, norm, rate] = percent;
        table.row([
            s.convention.to_owned(),
            precision,
            auc,
            norm,
            rate,
            s.sequences.to_string(),
        ]);
    }
    let mut text = format!("{}\n{table}", evaluation.tracker);
    if let Some(speed) = &evaluation.speed {
        text += &format!(
            "FPS {:.1} (got10k: mean of 1/t per frame, then over {} sequences), \
             {:.1} (frames / total time)\n",
            speed.mean_of_rates, speed.sequences, speed.frames_per_time
        );
    }
    if args.per_sequence {
        let mut table = Table::new(["sequence", "rule", "precision@20", "AUC"]);
        for s in scores {
            for (name, curves) in &s.per_sequence {
                let [precision, auc] =
                    [curves.precision(), curves.auc()].map(|v| format!("{:.2}", 100.0 * v));
                table.row([name.clone(), s.convention.to_owned(), precision, auc]);
            }
        }
        text += &format!("\n{table}");
    }
    text
}
