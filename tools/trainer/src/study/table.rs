//! Results of a study as Markdown, JSON and a plot.

use super::Outcome;
use crate::validate::{Accuracy, Report};
use sequences::plot::panels::{self, Line, Panel};
use serde_json::json;

/// A quantity over runs that differ in the seed only.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Over {
    mean: f64,
    /// Standard deviation between runs; `None` for a single run.
    spread: Option<f64>,
}

/// A row: the outcomes of one group.
struct Row<'a> {
    group: &'a str,
    outcomes: Vec<&'a Outcome>,
}

/// A set of clips: its name and the mean accuracy on it.
type Set = (&'static str, fn(&Report) -> Option<Accuracy>);
const SETS: [Set; 3] = [
    ("clean", |r| r.clean),
    ("real", |r| r.real),
    ("flights", |r| r.flights),
];

/// A figure of accuracy by name.
type Figure = (&'static str, fn(&Accuracy) -> f64);
const FIGURES: [Figure; 2] = [("precision", |a| a.precision), ("AUC", |a| a.auc)];

impl Over {
    fn of(values: &[f64]) -> Option<Over> {
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let spread = (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt());
        (!values.is_empty()).then_some(Over { mean, spread })
    }
}

impl std::fmt::Display for Over {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{:.1}", self.mean)?;
        self.spread
            .map_or(Ok(()), |spread| write!(f, " ± {spread:.1}"))
    }
}

impl Row<'_> {
    fn over(&self, set: Set, figure: fn(&Accuracy) -> f64) -> Option<Over> {
        let values: Vec<f64> = self
            .outcomes
            .iter()
            .filter_map(|outcome| (set.1)(&outcome.report))
            .map(|a| figure(&a))
            .collect();
        Over::of(&values)
    }
}

/// Groups in the order in which they first occur.
fn rows(outcomes: &[Outcome]) -> Vec<Row<'_>> {
    let mut rows: Vec<Row> = Vec::new();
    for outcome in outcomes {
        match rows.iter_mut().find(|row| row.group == outcome.group) {
            Some(row) => row.outcomes.push(outcome),
            None => rows.push(Row {
                group: &outcome.group,
                outcomes: vec![outcome],
            }),
        }
    }
    rows
}

/// Sets of clips for which there are results.
fn sets(outcomes: &[Outcome]) -> Vec<Set> {
    SETS.into_iter()
        .filter(|(_, of)| outcomes.iter().any(|outcome| of(&outcome.report).is_some()))
        .collect()
}

/// A table for people: a row per group, means over its seeds with the standard deviation between
/// them.
pub fn markdown(title: &str, outcomes: &[Outcome]) -> String {
    let sets = sets(outcomes);
    let mut head = vec![
        title.to_owned(),
        "parameters".into(),
        "MMAC".into(),
        "runs".into(),
        "pairs each".into(),
    ];
    head.extend(
        sets.iter()
            .flat_map(|(set, _)| FIGURES.map(|(figure, _)| format!("{set} {figure}"))),
    );
    let mut lines = vec![head.clone(), vec!["---".into(); head.len()]];
    for row in rows(outcomes) {
        let first = row.outcomes[0];
        let mut cells = vec![
            row.group.to_owned(),
            first.parameters.to_string(),
            format!("{:.1}", first.macs as f64 / 1e6),
            row.outcomes.len().to_string(),
            (first.steps * first.options.batch as u64).to_string(),
        ];
        for set in &sets {
            let figures = FIGURES.map(|(_, figure)| row.over(*set, figure));
            cells.extend(figures.map(|over| over.map_or("-".into(), |over| over.to_string())));
        }
        lines.push(cells);
    }
    lines
        .iter()
        .map(|cells| format!("| {} |\n", cells.join(" | ")))
        .collect()
}

/// The same for programs: `rows` with means and spreads, `runs` with everything.
pub fn json(title: &str, outcomes: &[Outcome]) -> String {
    let sets = sets(outcomes);
    let of_row = |row: Row| {
        let accuracy = sets.iter().map(|set| {
            let figures = FIGURES.map(|(name, figure)| {
                let over = row.over(*set, figure);
                let value = over.map(|over| json!({ "mean": over.mean, "deviation": over.spread }));
                (name.to_lowercase(), json!(value))
            });
            (
                set.0.to_owned(),
                serde_json::Value::Object(figures.into_iter().collect()),
            )
        });
        json!({
            title: row.group,
            "parameters": row.outcomes[0].parameters,
            "macs_search": row.outcomes[0].macs,
            "seeds": row.outcomes.iter().map(|o| o.options.seed).collect::<Vec<_>>(),
            "accuracy": serde_json::Value::Object(accuracy.collect()),
        })
    };
    let rows: Vec<_> = rows(outcomes).into_iter().map(of_row).collect();
    let value = json!({ "study": title, "rows": rows, "runs": outcomes });
    format!("{value:#}\n")
}

/// Precision and AUC against the groups, a panel per set of clips.
pub fn svg(title: &str, outcomes: &[Outcome]) -> String {
    let rows = rows(outcomes);
    let ticks: Vec<_> = rows
        .iter()
        .enumerate()
        .map(|(i, row)| (i as f64, row.group.to_owned()))
        .collect();
    let panel = |set: Set| {
        let line = |(name, figure): Figure| {
            let overs = rows
                .iter()
                .enumerate()
                .filter_map(|(i, row)| Some((i as f64, row.over(set, figure)?)));
            let overs: Vec<_> = overs.collect();
            Line {
                name: name.into(),
                points: overs.iter().map(|(x, over)| (*x, over.mean)).collect(),
                spread: overs
                    .iter()
                    .map(|(_, over)| over.spread.unwrap_or(0.0))
                    .collect(),
            }
        };
        let lines: Vec<_> = FIGURES.into_iter().map(line).collect();
        let values = lines
            .iter()
            .flat_map(|line| line.points.iter().zip(&line.spread));
        let least = values
            .map(|((_, y), spread)| y - spread)
            .fold(100.0, f64::min);
        let low = (least / 10.0).floor().max(0.0) * 10.0;
        Panel {
            title: format!("{}, percent, against {title}", set.0),
            lines,
            ticks: ticks.clone(),
            low,
        }
    };
    panels::svg(&sets(outcomes).into_iter().map(panel).collect::<Vec<_>>())
}
