//! Curves of a run's log as one SVG picture.

use serde_json::Value;
use std::fmt::Write;

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 300.0;
const MARGIN: f64 = 46.0;
const COLORS: [&str; 7] = ["#111111", "#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#8c564b", "#e377c2"];

/// A named line over steps.
struct Line {
    name: String,
    points: Vec<(f64, f64)>,
}

/// Losses above, accuracy in validation below, over the step. `log` are the lines of the log.
pub fn svg(log: &[Value]) -> String {
    let losses = ["total", "cls", "centerness", "iou", "global", "local", "identity"];
    let losses: Vec<_> = losses.iter().map(|name| line(log, name, &["losses", name])).collect();
    let accuracy = ["clean", "real", "flights"].iter().flat_map(|set| {
        ["precision", "auc"].map(|what| line(log, &format!("{set} {what}"), &["validation", set, what]))
    });
    let accuracy: Vec<_> = accuracy.collect();
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        2.0 * HEIGHT
    );
    plot(&mut svg, 0.0, "losses (weighted)", &losses);
    plot(&mut svg, HEIGHT, "validation, percent", &accuracy);
    svg.push_str("</svg>\n");
    svg
}

fn line(log: &[Value], name: &str, path: &[&str]) -> Line {
    let at = |entry: &Value| {
        let value = path.iter().try_fold(entry, |value, key| value.get(key))?.as_f64()?;
        Some((entry.get("step")?.as_f64()?, value))
    };
    Line { name: name.into(), points: log.iter().filter_map(at).filter(|(_, y)| y.is_finite()).collect() }
}

fn plot(svg: &mut String, top: f64, title: &str, lines: &[Line]) {
    let points = || lines.iter().flat_map(|line| &line.points);
    let last = points().map(|(x, _)| *x).fold(1.0, f64::max);
    let high = points().map(|(_, y)| *y).fold(0.0, f64::max).max(1e-6);
    let place = |(x, y): (f64, f64)| {
        let across = MARGIN + x / last * (WIDTH - 4.5 * MARGIN);
        let down = top + HEIGHT - MARGIN - (y / high).max(0.0) * (HEIGHT - 1.6 * MARGIN);
        (across, down)
    };
    // Writing to a string cannot fail.
    let _ = writeln!(svg, "<text x=\"{MARGIN}\" y=\"{}\">{title}</text>", top + 16.0);
    for share in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let ((x0, y), (x1, _)) = (place((0.0, share * high)), place((last, share * high)));
        let _ = writeln!(svg, "<path d=\"M{x0:.1} {y:.1}H{x1:.1}\" stroke=\"#ddd\"/>");
        let label = share * high;
        let _ = writeln!(svg, "<text x=\"4\" y=\"{y:.1}\" fill=\"#666\">{label:.2}</text>");
        let (x, y) = place((share * last, 0.0));
        let _ = writeln!(
            svg,
            "<text x=\"{x:.1}\" y=\"{:.1}\" fill=\"#666\">{:.0}</text>",
            y + 16.0,
            share * last
        );
    }
    for (i, line) in lines.iter().enumerate().filter(|(_, line)| !line.points.is_empty()) {
        let color = COLORS[i % COLORS.len()];
        let thinned = line.points.len().div_ceil(600);
        let path: Vec<_> = line
            .points
            .iter()
            .step_by(thinned)
            .map(|point| {
                let (x, y) = place(*point);
                format!("{x:.1},{y:.1}")
            })
            .collect();
        let path = path.join(" ");
        let _ = writeln!(svg, "<polyline points=\"{path}\" fill=\"none\" stroke=\"{color}\"/>");
        let (x, y) = (WIDTH - 3.3 * MARGIN, top + 30.0 + 16.0 * i as f64);
        let newest = line.points.last().map_or(0.0, |(_, y)| *y);
        let name = &line.name;
        let _ = writeln!(svg, "<text x=\"{x}\" y=\"{y}\" fill=\"{color}\">{name} {newest:.3}</text>");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn draws_what_the_log_says() {
        let log = [
            json!({"step": 10, "losses": {"total": 4.0, "cls": 1.0}}),
            json!({"step": 20, "losses": {"total": 2.0, "cls": null}}),
            json!({"step": 20, "validation": {"clean": {"precision": 80.0, "auc": 50.0}, "real": null}}),
        ];
        let svg = svg(&log);
        assert_eq!(svg.matches("<polyline").count(), 4); // total, cls, clean precision and AUC
        assert!(svg.contains("total 2.000") && svg.contains("clean auc 50.000"));
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        assert!(super::svg(&[]).contains("validation"));
    }
}
