//! Curves of a run's log as one SVG picture.

use sequences::plot::panels::{Line, Panel, svg as draw};
use serde_json::Value;

/// Losses above, accuracy in validation below, over the step. `log` are the lines of the log.
pub fn svg(log: &[Value]) -> String {
    let losses = [
        "total",
        "cls",
        "centerness",
        "iou",
        "global",
        "local",
        "identity",
    ];
    let losses: Vec<_> = losses
        .iter()
        .map(|name| line(log, name, &["losses", name]))
        .collect();
    let accuracy = ["clean", "real", "flights"].iter().flat_map(|set| {
        ["precision", "auc"]
            .map(|what| line(log, &format!("{set} {what}"), &["validation", set, what]))
    });
    let accuracy: Vec<_> = accuracy.collect();
    let panel = |title: &str, lines| Panel {
        title: title.into(),
        lines,
        ..Panel::default()
    };
    draw(&[
        panel("losses (weighted)", losses),
        panel("validation, percent", accuracy),
    ])
}

fn line(log: &[Value], name: &str, path: &[&str]) -> Line {
    let at = |entry: &Value| {
        let value = path
            .iter()
            .try_fold(entry, |value, key| value.get(key))?
            .as_f64()?;
        Some((entry.get("step")?.as_f64()?, value))
    };
    let points = log
        .iter()
        .filter_map(at)
        .filter(|(_, y)| y.is_finite())
        .collect();
    Line {
        name: name.into(),
        points,
        spread: Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn log_with_losses_and_validation_is_drawn() {
        let log = [
            json!({"step": 10, "losses": {"total": 4.0, "cls": 1.0}}),
            json!({"step": 20, "losses": {"total": 2.0, "cls": null}}),
            json!({
                "step": 20,
                "validation": {"clean": {"precision": 80.0, "auc": 50.0}, "real": null},
            }),
        ];
        let svg = svg(&log);
        assert_eq!(svg.matches("<polyline").count(), 4); // total, cls, clean precision and AUC
        assert!(svg.contains("total 2.000") && svg.contains("clean auc 50.000"));
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        assert!(super::svg(&[]).contains("validation"));
    }
}
