//! `ope diagnose`.

use crate::args::DiagnoseArgs;
use ope::Error;
use ope::compare::Comparison;
use ope::diagnosis::{Diagnosis, diagnose, sheet};
use ope::table::Table;
use sequences::Sequence;
use std::fs;
use std::path::Path;

/// Prints the diagnosis and writes contact sheets of losses.
pub fn run(args: &DiagnoseArgs) -> Result<(), Error> {
    let truth = &args.trackers.truth;
    if let Some(out) = &args.out {
        super::check_output(out, &super::read_by(&args.trackers))?;
    }
    let comparison = super::compare::read(&args.trackers)?;
    let diagnosis = diagnose(&comparison);
    if let Some(out) = &args.out {
        let Some(sequences) = super::sequences(truth)? else {
            return Err(Error::Option {
                option: "--out",
                expected: "--dataset and --root, whose pictures it shows".into(),
                found: "--annotations".into(),
            });
        };
        let written = write_sheets(&comparison, &diagnosis, &sequences, out)?;
        eprintln!("{written} contact sheets in {}", out.display());
    }
    if args.json {
        let value = serde_json::json!(diagnosis);
        return super::print(&format!("{value:#}\n"));
    }
    super::print(&text(&diagnosis))
}

/// Writes a sheet per loss: `<tracker>/<pass>-<frame>.png`. Returns how many.
fn write_sheets(
    comparison: &Comparison,
    diagnosis: &Diagnosis,
    sequences: &[Sequence],
    out: &Path,
) -> Result<usize, Error> {
    let mut written = 0;
    for (evaluation, diagnosed) in comparison.trackers.iter().zip(&diagnosis.trackers) {
        let folder = out.join(super::folder_name(&diagnosed.tracker)?);
        fs::create_dir_all(&folder).map_err(Error::unwritable(&folder))?;
        for loss in &diagnosed.losses {
            let sequence = sequences.iter().find(|s| s.annotation.name == loss.pass);
            let pass = evaluation.sequence(&loss.pass);
            let (Some(sequence), Some(pass)) = (sequence, pass) else {
                continue;
            };
            let file = folder.join(format!("{}-{}.png", loss.pass, loss.frame + 1));
            let picture = sheet::sheet(loss, pass, sequence)?;
            picture.save(&file).map_err(|error| Error::Unwritable {
                path: file.clone(),
                error: std::io::Error::other(error),
            })?;
            written += 1;
        }
    }
    Ok(written)
}

fn text(diagnosis: &Diagnosis) -> String {
    let mut text = format!(
        "rule {}; shape over the {} of {} visible frames in which every tracker is on the target\n",
        diagnosis.rule, diagnosis.common_frames, diagnosis.visible_frames
    );
    let mut table = Table::new([
        "tracker",
        "precision@20",
        "AUC",
        "on target %",
        "aspect slope",
        "RMSE",
        "size slope",
        "RMSE",
        "center, sides",
        "IoU",
    ]);
    let bins = diagnosis.trackers.first();
    let bins = bins.map_or(&[][..], |diagnosed| &diagnosed.shape.by_aspect);
    table.extend_header(
        bins.iter()
            .map(|bin| format!("from {} ({})", bin.from, bin.frames)),
    );
    table.extend_header(["losses".to_owned()]);
    for diagnosed in &diagnosis.trackers {
        let mut row = vec![diagnosed.tracker.clone()];
        let percent = [diagnosed.precision, diagnosed.auc, diagnosed.on_target];
        row.extend(percent.map(|value| format!("{value:.1}")));
        row.extend(diagnosed.shape.cells());
        row.push(diagnosed.losses.len().to_string());
        table.row(row);
    }
    text += &format!("{table}\n");
    let mut table = Table::new([
        "losses of",
        "pass",
        "frame",
        "lost for",
        "back",
        "area before",
        "sides off",
        "box",
    ]);
    for diagnosed in &diagnosis.trackers {
        for loss in &diagnosed.losses {
            let back = loss
                .back
                .map_or("never".to_owned(), |frame| (frame + 1).to_string());
            table.row([
                diagnosed.tracker.clone(),
                loss.pass.clone(),
                (loss.frame + 1).to_string(),
                loss.lost_for.to_string(),
                back,
                format!("{:.1}", loss.area_before),
                format!("{:.1}", loss.distance),
                loss.cause.words().to_owned(),
            ]);
        }
    }
    text + &table.to_string()
}
