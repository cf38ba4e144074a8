//! Panels of lines, one below the other.

use super::{color, escape};
use std::fmt::Write;

const WIDTH: f64 = 900.0;
const HEIGHT: f64 = 300.0;
const MARGIN: f64 = 46.0;
/// Most points that are drawn of a line.
const POINTS: usize = 600;

/// A named line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Line {
    /// Its name.
    pub name: String,
    /// Its points, x ascending.
    pub points: Vec<(f64, f64)>,
    /// The uncertainty of each point, up and down; empty if unknown.
    pub spread: Vec<f64>,
}

/// A picture with axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    /// What is drawn.
    pub title: String,
    /// The lines.
    pub lines: Vec<Line>,
    /// Labels of the x axis at their places. Without any, the axis begins at 0; with them, each
    /// point is marked.
    pub ticks: Vec<(f64, String)>,
    /// The lower end of the y axis.
    pub low: f64,
}

/// Panels as one picture.
pub fn svg(panels: &[Panel]) -> String {
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n",
        panels.len() as f64 * HEIGHT
    );
    for (i, panel) in panels.iter().enumerate() {
        panel.draw(&mut svg, i as f64 * HEIGHT);
    }
    svg.push_str("</svg>\n");
    svg
}

impl Panel {
    /// Both ends of the x axis.
    fn reach(&self) -> (f64, f64) {
        match (self.ticks.first(), self.ticks.last()) {
            (Some((first, _)), Some((last, _))) => {
                let room = 0.5 * (last - first) / (self.ticks.len() as f64 - 1.0).max(1.0);
                let room = if room > 0.0 { room } else { 0.5 };
                (first - room, last + room)
            }
            _ => (0.0, self.points().map(|(x, _)| *x).fold(1.0, f64::max)),
        }
    }

    fn points(&self) -> impl Iterator<Item = &(f64, f64)> {
        self.lines.iter().flat_map(|line| &line.points)
    }

    /// The highest value of a point with its uncertainty.
    fn top(&self) -> f64 {
        let spread = |line: &Line, i: usize| line.spread.get(i).copied().unwrap_or(0.0);
        let tops = |line: &Line| {
            let tops = line
                .points
                .iter()
                .enumerate()
                .map(|(i, (_, y))| y + spread(line, i));
            tops.fold(self.low, f64::max)
        };
        self.lines.iter().map(tops).fold(self.low + 1e-6, f64::max)
    }

    // Writing to a string cannot fail, so the results are dropped.
    fn draw(&self, svg: &mut String, top: f64) {
        let (first, last) = self.reach();
        let high = self.top();
        let levels = levels(self.low, high);
        let high = levels.last().map_or(high, |(level, _)| level.max(high));
        let place = |(x, y): (f64, f64)| {
            let across = MARGIN + (x - first) / (last - first) * (WIDTH - 4.5 * MARGIN);
            let share = ((y - self.low) / (high - self.low)).max(0.0);
            (
                across,
                top + HEIGHT - MARGIN - share * (HEIGHT - 1.6 * MARGIN),
            )
        };
        let _ = writeln!(
            svg,
            "<text x=\"{MARGIN}\" y=\"{}\">{}</text>",
            top + 16.0,
            escape(&self.title)
        );
        let mut ticks = self.ticks.clone();
        for (level, label) in levels {
            let ((x0, y), (x1, _)) = (place((first, level)), place((last, level)));
            let _ = writeln!(svg, "<path d=\"M{x0:.1} {y:.1}H{x1:.1}\" stroke=\"#ddd\"/>");
            let _ = writeln!(
                svg,
                "<text x=\"4\" y=\"{y:.1}\" fill=\"#666\">{label}</text>"
            );
        }
        if ticks.is_empty() {
            ticks = self::levels(first, last)
                .into_iter()
                .filter(|(at, _)| *at <= last)
                .collect();
        }
        for (at, label) in ticks {
            let (x, y) = place((at, self.low));
            let label = escape(&label);
            let _ = writeln!(
                svg,
                "<text x=\"{x:.1}\" y=\"{:.1}\" fill=\"#666\">{label}</text>",
                y + 16.0
            );
        }
        for (i, line) in self
            .lines
            .iter()
            .enumerate()
            .filter(|(_, line)| !line.points.is_empty())
        {
            let color = color(i);
            let thinned = line.points.len().div_ceil(POINTS);
            let drawn: Vec<_> = line
                .points
                .iter()
                .step_by(thinned)
                .map(|point| place(*point))
                .collect();
            let path: Vec<_> = drawn
                .iter()
                .map(|(x, y)| format!("{x:.1},{y:.1}"))
                .collect();
            let path = path.join(" ");
            let _ = writeln!(
                svg,
                "<polyline points=\"{path}\" fill=\"none\" stroke=\"{color}\"/>"
            );
            if !self.ticks.is_empty() {
                for (x, y) in &drawn {
                    let _ = writeln!(
                        svg,
                        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{color}\"/>"
                    );
                }
            }
            for ((x, y), spread) in line.points.iter().zip(&line.spread) {
                let ((x, low), (_, high)) = (place((*x, y - spread)), place((*x, y + spread)));
                let _ = writeln!(
                    svg,
                    "<path d=\"M{x:.1} {low:.1}V{high:.1}\" stroke=\"{color}\"/>"
                );
            }
            let x = WIDTH - 3.3 * MARGIN;
            let y = top + 30.0 + 16.0 * i as f64;
            let newest = line.points.last().map_or(0.0, |(_, y)| *y);
            let name = escape(&line.name);
            let _ = writeln!(
                svg,
                "<text x=\"{x}\" y=\"{y}\" fill=\"{color}\">{name} {newest:.3}</text>"
            );
        }
    }
}

/// Round numbers with their labels, at most six, from `low` to the first that is not below `high`.
fn levels(low: f64, high: f64) -> Vec<(f64, String)> {
    const MOST: f64 = 5.0;
    let power = 10f64.powf(((high - low) / MOST).log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .map(|factor| factor * power)
        .into_iter()
        .find(|s| (high - low) / s <= MOST);
    let step = step.unwrap_or(high - low);
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    let count = ((high - low) / step - 1e-9).ceil().clamp(1.0, MOST + 1.0) as usize;
    (0..=count)
        .map(|i| low + i as f64 * step)
        .map(|level| (level, format!("{level:.decimals$}")))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panel_with_ticks_marks_points_and_makes_room_for_spread() {
        let line = Line {
            name: "a<b".into(),
            points: vec![(1.0, 50.0), (2.0, 60.0)],
            spread: vec![1.0, 2.0],
        };
        let ticks = vec![(1.0, "one".into()), (2.0, "two".into())];
        let panel = Panel {
            title: "t".into(),
            lines: vec![line, Line::default()],
            ticks,
            low: 40.0,
        };
        let svg = svg(&[panel, Panel::default()]);
        assert_eq!(
            (
                svg.matches("<polyline").count(),
                svg.matches("<circle").count()
            ),
            (1, 2)
        );
        assert!(svg.contains("a&lt;b 60.000") && svg.contains(">two<") && svg.contains(">40<"));
        assert!(svg.contains(">65<"), "the spread has room");
        let labels = |low, high| {
            levels(low, high)
                .into_iter()
                .map(|(_, label)| label)
                .collect::<Vec<_>>()
        };
        assert_eq!(labels(50.0, 89.7), ["50", "60", "70", "80", "90"]);
        assert_eq!(labels(0.0, 1.31), ["0.0", "0.5", "1.0", "1.5"]);
        assert_eq!(labels(0.0, 0.07), ["0.00", "0.02", "0.04", "0.06", "0.08"]);
        assert_eq!(
            labels(0.0, 78_000.0),
            ["0", "20000", "40000", "60000", "80000"]
        );
        assert!(
            svg.contains("height=\"600\"") && !svg.contains("NaN"),
            "{svg}"
        );
    }
}
