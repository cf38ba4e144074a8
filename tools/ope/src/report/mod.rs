//! One self-contained HTML page about a comparison: tables, plots, diagnosis, worst failures.

mod diagnosis;
mod failures;

pub use diagnosis::{Sheet, sheets};
pub use failures::{Failure, failures};

use crate::compare::Comparison;
use crate::diagnosis::Diagnosis;
use sequences::plot::{color, escape};
use std::fmt::Write;

/// The page.
pub fn page(
    title: &str,
    comparison: &Comparison,
    diagnosis: &Diagnosis,
    failures: &[Failure],
    sheets: &[Sheet],
) -> String {
    let title = escape(title);
    let sequences = comparison.scores.first().map_or(0, |score| score.sequences);
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <link rel=\"icon\" href=\"data:,\">\n<title>{title}</title>\n<style>{}</style>\n\
         </head>\n<body>\n<main>\n\
         <h1>{title}</h1>\n<p>{} trackers on {sequences} passes, counted by the rule <b>{}</b>. \
         Precision is the rate of frames whose center is at most 20 pixels off, \
         AUC the area under the success curve; \
         a perfect tracker has an AUC of 95.2.</p>\n",
        include_str!("page.css"),
        comparison.trackers.len(),
        comparison.convention.name()
    );
    html += &summary(comparison);
    html += "<section class=\"plots\">\n";
    let plots = [
        Some(comparison.precision_plot()),
        Some(comparison.success_plot()),
    ];
    for plot in plots
        .into_iter()
        .chain([comparison.speed_plot(), comparison.attribute_plot()])
        .flatten()
    {
        let _ = writeln!(html, "<figure>{plot}</figure>");
    }
    html += "</section>\n";
    html += &attributes(comparison);
    html += &diagnosis::section(diagnosis, sheets);
    html += &pictures(comparison, failures);
    html += &sequences_table(comparison);
    let _ = write!(
        html,
        "</main>\n<script>{}</script>\n</body>\n</html>\n",
        include_str!("page.js")
    );
    html
}

/// A sortable table: the first cell of a row is text, the others are numbers.
fn table(header: &[String], rows: &[Vec<String>]) -> String {
    let mut html = String::from("<div class=\"scroll\"><table class=\"sortable\">\n<thead><tr>");
    for cell in header {
        let _ = write!(
            html,
            "<th scope=\"col\"><button type=\"button\">{cell}</button></th>"
        );
    }
    html += "</tr></thead>\n<tbody>\n";
    for row in rows {
        let cells: String = row.iter().map(|cell| format!("<td>{cell}</td>")).collect();
        let _ = writeln!(html, "<tr>{cells}</tr>");
    }
    html + "</tbody>\n</table></div>\n"
}

/// A tracker's name with its color.
fn tracker(comparison: &Comparison, i: usize) -> String {
    format!(
        "<span style=\"color:{}\">&#9632;</span> {}",
        color(i),
        escape(&comparison.trackers[i].tracker)
    )
}

fn summary(comparison: &Comparison) -> String {
    let header = [
        "tracker",
        "precision@20",
        "AUC",
        "norm. precision",
        "success@0.5",
        "FPS (mean of rates)",
        "FPS (frames / time)",
    ];
    let row = |i: usize| {
        let score = &comparison.scores[i];
        let speed = comparison.trackers[i].speed;
        let mut row = vec![tracker(comparison, i)];
        row.extend(
            [
                score.precision,
                score.auc,
                score.norm_precision,
                score.success_rate,
            ]
            .map(|v| format!("{v:.2}")),
        );
        let rates = speed.map(|s| [s.mean_of_rates, s.frames_per_time].map(|v| format!("{v:.1}")));
        row.extend(rates.unwrap_or_else(|| ["–", "–"].map(str::to_owned)));
        row
    };
    let rows: Vec<_> = comparison.ranking().into_iter().map(row).collect();
    table(&header.map(str::to_owned), &rows)
}

/// Precision and AUC of each tracker, as columns.
fn columns(comparison: &Comparison, first: &[&str]) -> Vec<String> {
    let mut header: Vec<String> = first.iter().map(|name| (*name).to_owned()).collect();
    for i in 0..comparison.trackers.len() {
        let name = tracker(comparison, i);
        header.extend([format!("{name} P"), format!("{name} AUC")]);
    }
    header
}

fn attributes(comparison: &Comparison) -> String {
    let rows = comparison.per_attribute();
    if rows.is_empty() {
        return String::new();
    }
    let row = |(name, count, summaries): &(String, usize, Vec<crate::compare::Summary>)| {
        let mut row = vec![escape(name), count.to_string()];
        row.extend(
            summaries
                .iter()
                .flat_map(|p| [p.precision, p.auc])
                .map(|v| format!("{v:.1}")),
        );
        row
    };
    let rows: Vec<_> = rows.iter().map(row).collect();
    format!(
        "<h2>Attributes</h2>\n{}",
        table(&columns(comparison, &["attribute", "sequences"]), &rows)
    )
}

fn sequences_table(comparison: &Comparison) -> String {
    let several = comparison.trackers.len() > 1;
    let mut header = columns(comparison, &["sequence"]);
    header.extend(several.then(|| "AUC ahead of the best other".to_owned()));
    let row = |(name, summaries): &(String, Vec<crate::compare::Summary>)| {
        let mut row = vec![escape(name)];
        row.extend(
            summaries
                .iter()
                .flat_map(|p| [p.precision, p.auc])
                .map(|v| format!("{v:.1}")),
        );
        let others = summaries
            .iter()
            .skip(1)
            .map(|p| p.auc)
            .fold(f64::NEG_INFINITY, f64::max);
        row.extend(several.then(|| format!("{:+.1}", summaries[0].auc - others)));
        row
    };
    let rows: Vec<_> = comparison.per_sequence().iter().map(row).collect();
    let hint = "Click a heading to sort.";
    let ahead = if several {
        format!(
            " The last column says how far {} is ahead.",
            escape(&comparison.trackers[0].tracker)
        )
    } else {
        String::new()
    };
    format!(
        "<h2>Sequences</h2>\n<p>{hint}{ahead}</p>\n{}",
        table(&header, &rows)
    )
}

fn pictures(comparison: &Comparison, failures: &[Failure]) -> String {
    if failures.is_empty() {
        return String::new();
    }
    let mut html = format!(
        "<h2>Worst failures of {}</h2>\n\
         <p>White dashes: the annotation. Colors: the trackers, as in the plots.</p>\n\
         <section class=\"failures\">\n",
        escape(&comparison.trackers[0].tracker)
    );
    for failure in failures {
        let (w, h) = (failure.width, failure.height);
        let mut marks = String::new();
        let mut mark = |b: &sequences::Rect, style: &str| {
            if b.is_usable() {
                let _ = write!(
                    marks,
                    "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"none\" \
                     vector-effect=\"non-scaling-stroke\" {style}/>",
                    b.x, b.y, b.w, b.h
                );
            }
        };
        mark(&failure.annotated, "stroke=\"#000\" stroke-width=\"3\"");
        mark(
            &failure.annotated,
            "stroke=\"#fff\" stroke-width=\"2\" stroke-dasharray=\"6 3\"",
        );
        for (i, found) in failure.found.iter().enumerate() {
            mark(
                found,
                &format!("stroke=\"{}\" stroke-width=\"2\"", color(i)),
            );
        }
        let name = escape(&failure.sequence);
        let _ = writeln!(
            html,
            "<figure><svg viewBox=\"0 0 {w} {h}\" role=\"img\" aria-label=\"{name}\">\
             <image href=\"data:image/jpeg;base64,{}\" width=\"{w}\" height=\"{h}\"/>{marks}</svg>\
             <figcaption><b>{name}</b>, frame {}: lost for {} of {} frames, AUC {:.1}</figcaption>\
             </figure>",
            failure.jpeg,
            failure.frame + 1,
            failure.lost,
            failure.frames,
            failure.auc
        );
    }
    html + "</section>\n"
}

#[cfg(test)]
mod tests;
