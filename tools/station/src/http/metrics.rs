//! The newest report as Prometheus reads it: its text format, version 0.0.4, is described at
//! <https://prometheus.io/docs/instrumenting/exposition_formats/>.

use std::fmt::Write;
use std::path::Path;

use crate::health::Health;
use crate::report::{State, TargetId, View};

/// Most temperature sensors that are read.
const MAX_SENSORS: usize = 32;

/// All metrics, as text.
pub fn text(view: &View) -> String {
    let mut text = String::new();
    let report = &view.report;
    let frames = if view.number == 0 {
        0
    } else {
        report.frame + 1
    };
    for (name, help, value) in [
        ("frames_total", "Frames that the source delivered.", frames),
        ("reports_total", "Reports that were published.", view.number),
        (
            "dropped_total",
            "Frames dropped for newer ones.",
            report.dropped,
        ),
        (
            "late_total",
            "Reports withheld because their frame was too old.",
            report.late,
        ),
        ("starts_total", "Targets that were started.", report.starts),
    ] {
        metric(
            &mut text,
            name,
            "counter",
            help,
            &[(String::new(), value as f64)],
        );
    }
    let mut gauges = vec![
        (
            "latency_seconds",
            "Time from a frame to its report.",
            report.latency_ms / 1e3,
        ),
        (
            "work_seconds",
            "Time that tracking the frame took.",
            report.work_ms / 1e3,
        ),
        (
            "frame_interval_seconds",
            "Time between the last two frames.",
            view.interval.as_secs_f64(),
        ),
    ];
    if let Some(age) = view.age {
        gauges.push((
            "age_seconds",
            "Time since the newest report's frame.",
            age.as_secs_f64(),
        ));
    }
    for (name, help, value) in gauges {
        metric(&mut text, name, "gauge", help, &[(String::new(), value)]);
    }
    targets(&mut text, view);
    let sources = chosen(
        "",
        "source",
        &Health::ALL.map(Health::name),
        view.health.name(),
    );
    metric(
        &mut text,
        "source",
        "gauge",
        "1 for the health of the source.",
        &sources,
    );
    let temperatures = temperatures(Path::new("/sys/class/thermal"));
    if !temperatures.is_empty() {
        let help = "Temperatures that the system reports.";
        metric(
            &mut text,
            "temperature_celsius",
            "gauge",
            help,
            &temperatures,
        );
    }
    text
}

/// The metrics of every target, labeled by its number if several can be followed.
fn targets(text: &mut String, view: &View) {
    let tells_ids = view.report.tells_ids();
    let label = |id: TargetId| {
        if tells_ids {
            format!("target=\"{id}\"")
        } else {
            String::new()
        }
    };
    let mut scores = Vec::new();
    let mut presences = Vec::new();
    for target in view.targets() {
        let labels = braced(&label(target.id));
        scores.push((labels.clone(), f64::from(target.track.score)));
        presences.extend(target.track.presence.map(|p| (labels, f64::from(p))));
    }
    // Every word that `View::state_of` can give.
    let mut names = vec!["idle"];
    names.extend(State::ALL.map(State::name));
    names.push("stale");
    let mut states = Vec::new();
    for id in 1..=view.report.room.max(1) {
        let target = view.report.targets.iter().find(|target| target.id == id);
        states.extend(chosen(&label(id), "state", &names, view.state_of(target)));
    }
    for (name, help, values) in [
        ("score", "Raw score of the target.", scores),
        (
            "presence",
            "Probability that the box is on the target.",
            presences,
        ),
        ("state", "1 for the state of the target.", states),
    ] {
        if !values.is_empty() {
            metric(text, name, "gauge", help, &values);
        }
    }
}

/// A line per name, with 1 for the one that applies and 0 for the others.
fn chosen(first: &str, label: &str, names: &[&str], name: &str) -> Vec<(String, f64)> {
    let comma = if first.is_empty() { "" } else { "," };
    let mut lines = Vec::new();
    for known in names {
        let value = if *known == name { 1.0 } else { 0.0 };
        lines.push((braced(&format!("{first}{comma}{label}=\"{known}\"")), value));
    }
    lines
}

/// Labels in braces, if there are any.
fn braced(labels: &str) -> String {
    if labels.is_empty() {
        String::new()
    } else {
        format!("{{{labels}}}")
    }
}

/// One metric with a line per set of labels.
fn metric(text: &mut String, name: &str, kind: &str, help: &str, values: &[(String, f64)]) {
    // Writing into a string cannot fail.
    let _ = writeln!(text, "# HELP track_cpu_{name} {help}");
    let _ = writeln!(text, "# TYPE track_cpu_{name} {kind}");
    for (labels, value) in values {
        let _ = writeln!(text, "track_cpu_{name}{labels} {value}");
    }
}

/// Degrees of the thermal zones of Linux, labeled by number and type.
fn temperatures(folder: &Path) -> Vec<(String, f64)> {
    let mut found = Vec::new();
    for zone in 0..MAX_SENSORS {
        let zone_folder = folder.join(format!("thermal_zone{zone}"));
        let read = |name| std::fs::read_to_string(zone_folder.join(name)).ok();
        let degrees = read("temp").and_then(|text| text.trim().parse::<f64>().ok());
        let Some(thousandths) = degrees else {
            continue;
        };
        let kind: String = read("type")
            .unwrap_or_default()
            .chars()
            .filter(|c| c.is_ascii_alphanumeric() || "-_".contains(*c))
            .collect();
        found.push((
            format!("{{zone=\"{zone}\",type=\"{kind}\"}}"),
            thousandths / 1e3,
        ));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hub::{Hub, Limits};
    use crate::picture::{FrameBox, Picture};
    use crate::report::{Followed, Report, Tracked};
    use std::time::Instant;

    fn followed(id: TargetId) -> Followed {
        Followed {
            id,
            start: 1,
            track: Tracked::certain(FrameBox::new(1.0, 2.0, 3.0, 4.0)),
        }
    }

    #[test]
    fn several_targets_have_labels() {
        let hub = Hub::new(Limits::default());
        let report = Report {
            taken: Some(Instant::now()),
            room: 3,
            targets: vec![followed(1), followed(3)],
            ..Report::default()
        };

        hub.publish(report, &Picture::dot());
        let text = text(&hub.view());

        for line in [
            "track_cpu_presence{target=\"1\"} 1",
            "track_cpu_score{target=\"3\"} 1",
            "track_cpu_state{target=\"2\",state=\"idle\"} 1",
            "track_cpu_state{target=\"3\",state=\"tracking\"} 1",
            "track_cpu_state{target=\"3\",state=\"idle\"} 0",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} in\n{text}");
        }
        assert!(!text.contains("presence{target=\"2\"}"), "{text}");
        assert_eq!(text.matches("# TYPE track_cpu_state ").count(), 1);
    }

    #[test]
    fn report_becomes_metrics() {
        let hub = Hub::new(Limits::default());
        hub.tell(|pulse| pulse.frame(Instant::now()));
        let report = Report {
            frame: 41,
            dropped: 3,
            latency_ms: 12.5,
            taken: Some(Instant::now()),
            targets: vec![followed(1)],
            ..Report::default()
        };
        let picture = Picture::dot();

        hub.publish(report, &picture);
        let text = text(&hub.view());

        for line in [
            "# TYPE track_cpu_frames_total counter",
            "track_cpu_frames_total 42",
            "track_cpu_reports_total 1",
            "track_cpu_dropped_total 3",
            "track_cpu_latency_seconds 0.0125",
            "track_cpu_presence 1",
            "track_cpu_state{state=\"tracking\"} 1",
            "track_cpu_state{state=\"lost\"} 0",
            "track_cpu_source{source=\"live\"} 1",
        ] {
            assert!(text.lines().any(|found| found == line), "{line} in\n{text}");
        }
        assert_eq!(text.matches("# TYPE track_cpu_state ").count(), 1);
    }

    #[test]
    fn before_the_first_frame_nothing_is_counted() {
        let text = text(&Hub::new(Limits::default()).view());

        assert!(text.contains("track_cpu_frames_total 0\n"), "{text}");
        assert!(
            text.contains("track_cpu_source{source=\"waiting\"} 1\n"),
            "{text}"
        );
        assert!(!text.contains("age_seconds"), "{text}");
    }

    #[test]
    fn temperatures_are_read_from_the_thermal_zones() {
        let folder = std::env::temp_dir().join(format!("track-cpu-zones-{}", std::process::id()));
        let zone = folder.join("thermal_zone3");
        std::fs::create_dir_all(&zone).unwrap();
        std::fs::write(zone.join("temp"), "48250\n").unwrap();
        std::fs::write(zone.join("type"), "cpu\"-thermal\n").unwrap();

        let found = temperatures(&folder);

        std::fs::remove_dir_all(&folder).unwrap();
        assert_eq!(
            found,
            [("{zone=\"3\",type=\"cpu-thermal\"}".to_string(), 48.25)]
        );
    }
}
