//! `ope compare` and `ope report`.

use crate::args::{CompareArgs, ReportArgs, TrackersArgs};
use ope::compare::{Comparison, Summary};
use ope::score::Missing;
use ope::table::Table;
use ope::{Error, Results, diagnosis, report, results, starts};
use sequences::Notes;
use std::fs;

/// Reads the annotations and results to compare.
pub fn read(args: &TrackersArgs) -> Result<Comparison, Error> {
    let mut notes = Notes::default();
    let annotations = super::truth(&args.truth)?;
    let opened: Result<Vec<Results>, Error> = args
        .results
        .iter()
        .map(|folder| Results::open(folder))
        .collect();
    let attributes = match (args.truth.dataset, &args.truth.root) {
        (Some(set), Some(root)) if args.truth.four_starts => {
            starts::attributes(set.attributes(root)?)
        }
        (Some(set), Some(root)) => set.attributes(root)?,
        _ => Default::default(),
    };
    let missing = if args.partial {
        Missing::Skip
    } else {
        Missing::Refuse
    };
    let rule = args.convention.convention();
    let mut comparison = Comparison::read(
        &annotations,
        &opened?,
        rule,
        missing,
        attributes,
        &mut notes,
    )?;
    if !args.names.is_empty() {
        let given = args.names.len();
        let wanted = comparison.trackers.len();
        if given != wanted {
            let expected = format!("{wanted} names, one per folder of results");
            return Err(Error::Option {
                option: "--names",
                expected,
                found: given.to_string(),
            });
        }
        for (tracker, name) in comparison.trackers.iter_mut().zip(&args.names) {
            tracker.tracker.clone_from(name);
        }
    }
    eprint!("{notes}");
    Ok(comparison)
}

/// Prints tables and writes plots.
pub fn compare(args: &CompareArgs) -> Result<(), Error> {
    if let Some(folder) = &args.out {
        super::check_output(
            &folder.join("precision.svg"),
            &super::read_by(&args.trackers),
        )?;
    }
    let comparison = read(&args.trackers)?;
    let plots = [
        ("precision.svg", Some(comparison.precision_plot())),
        ("success.svg", Some(comparison.success_plot())),
        ("speed.svg", comparison.speed_plot()),
        ("attributes.svg", comparison.attribute_plot()),
    ];
    if let Some(folder) = &args.out {
        fs::create_dir_all(folder).map_err(Error::unwritable(folder))?;
        for (file, plot) in plots {
            plot.map(|plot| results::write_whole(&folder.join(file), &plot))
                .transpose()?;
        }
    }
    super::print(&tables(&comparison))
}

/// Writes the page.
pub fn report(args: &ReportArgs) -> Result<(), Error> {
    super::check_output(&args.out, &super::read_by(&args.trackers))?;
    let comparison = read(&args.trackers)?;
    let diagnosis = diagnosis::diagnose(&comparison);
    let mut failures = Vec::new();
    let mut sheets = Vec::new();
    if args.failures > 0
        && let Some(sequences) = super::sequences(&args.trackers.truth)?
    {
        failures = report::failures(&comparison, &sequences, args.failures)?;
        sheets = report::sheets(&comparison, &diagnosis, &sequences, args.failures)?;
    }
    let file = &args.out;
    let page = report::page(&args.title, &comparison, &diagnosis, &failures, &sheets);
    results::write_whole(file, &page)?;
    eprintln!("{}", file.display());
    Ok(())
}

fn tables(comparison: &Comparison) -> String {
    let names: Vec<&str> = comparison
        .trackers
        .iter()
        .map(|t| t.tracker.as_str())
        .collect();
    let mut table = Table::new([
        "tracker",
        "precision@20",
        "AUC",
        "norm. precision",
        "FPS (mean of rates)",
        "FPS (frames / time)",
    ]);
    for i in comparison.ranking() {
        let score = &comparison.scores[i];
        let speed = comparison.trackers[i].speed;
        let mut row = vec![names[i].to_owned()];
        row.extend([score.precision, score.auc, score.norm_precision].map(|v| format!("{v:.2}")));
        let rates = speed.map(|s| [s.mean_of_rates, s.frames_per_time].map(|v| format!("{v:.1}")));
        row.extend(rates.unwrap_or_else(|| ["-", "-"].map(str::to_owned)));
        table.row(row);
    }
    let mut text = format!("rule {}\n{table}", comparison.convention.name());
    let cells = |summaries: &[Summary]| -> Vec<String> {
        let deltas = summaries
            .iter()
            .skip(1)
            .map(|p| format!("{:+.1}", p.auc - summaries[0].auc));
        summaries
            .iter()
            .take(1)
            .map(|p| format!("{:.1}", p.auc))
            .chain(deltas)
            .collect()
    };
    let header = |first: &str| {
        let mut table = Table::new([first]);
        table.extend_header(names.iter().map(|name| (*name).to_owned()));
        table
    };
    let attributes = comparison.per_attribute();
    if !attributes.is_empty() {
        let mut table = header("AUC per attribute, then differences to the first");
        for (name, count, summaries) in &attributes {
            let mut row = vec![format!("{name} ({count})")];
            row.extend(cells(summaries));
            table.row(row);
        }
        text += &format!("\n{table}");
    }
    let mut table = header("AUC per sequence, then differences to the first");
    for (name, summaries) in comparison.per_sequence() {
        let mut row = vec![name];
        row.extend(cells(&summaries));
        table.row(row);
    }
    text + &format!("\n{table}")
}
