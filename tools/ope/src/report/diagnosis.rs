//! The page's section on the boxes' shape and on losses.

use super::table;
use crate::compare::Comparison;
use crate::diagnosis::{Diagnosis, Loss, sheet};
use crate::error::Error;
use crate::picture::jpeg;
use sequences::Sequence;
use sequences::plot::escape;
use std::fmt::Write;

/// Quality of the pictures, of 100.
const QUALITY: u8 = 80;

/// A loss with its contact sheet.
#[derive(Clone, Debug)]
pub struct Sheet {
    /// The loss.
    pub loss: Loss,
    /// The sheet as JPEG in base 64.
    pub jpeg: String,
}

/// The contact sheets of the first tracker's `count` longest losses.
///
/// # Errors
/// If a picture cannot be read.
pub fn sheets(
    comparison: &Comparison,
    diagnosis: &Diagnosis,
    sequences: &[Sequence],
    count: usize,
) -> Result<Vec<Sheet>, Error> {
    let (Some(evaluation), Some(diagnosed)) =
        (comparison.trackers.first(), diagnosis.trackers.first())
    else {
        return Ok(Vec::new());
    };
    let mut losses: Vec<&Loss> = diagnosed.losses.iter().collect();
    losses.sort_by_key(|loss| std::cmp::Reverse(loss.lost_for));
    let mut sheets = Vec::new();
    for loss in losses.into_iter().take(count) {
        let sequence = sequences.iter().find(|s| s.annotation.name == loss.pass);
        let pass = evaluation.sequence(&loss.pass);
        let (Some(sequence), Some(pass)) = (sequence, pass) else {
            continue;
        };
        let picture = sheet::sheet(loss, pass, sequence)?;
        let bytes = jpeg(&picture, picture.dimensions(), QUALITY)
            .map_err(|error| crate::run::failure(&loss.pass, error))?;
        sheets.push(Sheet {
            loss: loss.clone(),
            jpeg: trax::base64::encode(&bytes),
        });
    }
    Ok(sheets)
}

/// Tables of shape and losses, then the sheets.
pub fn section(diagnosis: &Diagnosis, sheets: &[Sheet]) -> String {
    let mut html = format!(
        "<h2>Diagnosis</h2>\n\
         <p>Shape counts the {} of {} visible frames in which every tracker is on the target \
         (overlap of at least {}). A slope of 1 follows the target's changes since the first \
         frame, 0 keeps the first frame's shape.</p>\n",
        diagnosis.common_frames,
        diagnosis.visible_frames,
        crate::diagnosis::ON
    );
    let header = [
        "tracker",
        "on target [%]",
        "aspect: slope",
        "RMSE",
        "size: slope",
        "RMSE",
        "center error [sides]",
        "mean IoU",
    ];
    let mut header: Vec<String> = header.map(str::to_owned).to_vec();
    if let Some(first) = diagnosis.trackers.first() {
        let bins = first.shape.by_aspect.iter();
        header.extend(bins.map(|bin| format!("aspect changed by {} ({})", bin.from, bin.frames)));
    }
    header.push("losses".to_owned());
    let mut rows = Vec::new();
    for diagnosed in &diagnosis.trackers {
        let mut row = vec![
            escape(&diagnosed.tracker),
            format!("{:.1}", diagnosed.on_target),
        ];
        row.extend(diagnosed.shape.cells());
        row.push(diagnosed.losses.len().to_string());
        rows.push(row);
    }
    html += &table(&header, &rows);
    html += &losses(diagnosis);
    if !sheets.is_empty() {
        html += "<h3>The longest losses of the first tracker</h3>\n\
                 <p>The first frame, then the frames around the loss. \
                 White: the annotation. Orange: the tracker.</p>\n\
                 <section class=\"failures\">\n";
        for Sheet { loss, jpeg } in sheets {
            let name = escape(&loss.pass);
            let _ = writeln!(
                html,
                "<figure><img alt=\"{name}\" src=\"data:image/jpeg;base64,{jpeg}\">\
                 <figcaption><b>{name}</b>, frame {}: the box {}; lost for {} frames</figcaption>\
                 </figure>",
                loss.frame + 1,
                loss.cause.words(),
                loss.lost_for
            );
        }
        html += "</section>\n";
    }
    html
}

fn losses(diagnosis: &Diagnosis) -> String {
    let header = [
        "tracker",
        "pass",
        "frame",
        "lost for",
        "back",
        "area before",
        "the box",
    ];
    let mut rows = Vec::new();
    for diagnosed in &diagnosis.trackers {
        for loss in &diagnosed.losses {
            rows.push(vec![
                escape(&diagnosed.tracker),
                escape(&loss.pass),
                (loss.frame + 1).to_string(),
                loss.lost_for.to_string(),
                loss.back
                    .map_or("never".to_owned(), |frame| (frame + 1).to_string()),
                format!("{:.1}", loss.area_before),
                loss.cause.words().to_owned(),
            ]);
        }
    }
    if rows.is_empty() {
        return String::new();
    }
    table(&header.map(str::to_owned), &rows)
}
