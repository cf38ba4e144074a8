//! Line plots in panels, one below the other.

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

/// A plot with axes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Panel {
    /// The title above it.
    pub title: String,
    /// The lines.
    pub lines: Vec<Line>,
    /// Places on the x axis and their labels. With them, every point of a line is marked. Without
    /// any, the axis starts at 0 and has round numbers.
    pub ticks: Vec<(f64, String)>,
    /// The lower end of the y axis.
    pub low: f64,
}

/// Panels as one SVG picture, one below the other.
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
    fn x_range(&self) -> (f64, f64) {
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

    fn draw(&self, svg: &mut String, top: f64) {
        let (first, last) = self.x_range();
        let high = self.top();
        let levels = levels(self.low, high);
        let high = levels.last().map_or(high, |(level, _)| level.max(high));
        let area = Area {
            top,
            x: (first, last),
            y: (self.low, high),
        };
        let _ = writeln!(
            svg,
            "<text x=\"{MARGIN}\" y=\"{}\">{}</text>",
            top + 16.0,
            escape(&self.title)
        );
        area.draw_levels(svg, &levels);
        if self.ticks.is_empty() {
            let mut ticks = self::levels(first, last);
            ticks.retain(|(at, _)| *at <= last);
            area.draw_ticks(svg, &ticks);
        } else {
            area.draw_ticks(svg, &self.ticks);
        }
        let lines = self.lines.iter().enumerate();
        for (i, line) in lines.filter(|(_, line)| !line.points.is_empty()) {
            area.draw_line(svg, line, color(i), !self.ticks.is_empty());
            area.draw_name(svg, line, i);
        }
    }
}

/// Where a panel draws: its place in the picture, and the ranges of its axes.
struct Area {
    top: f64,
    x: (f64, f64),
    y: (f64, f64),
}

// Writing to a string cannot fail, so the results are dropped.
impl Area {
    /// A point's place in the picture.
    fn place(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let across = (x - self.x.0) / (self.x.1 - self.x.0);
        let up = ((y - self.y.0) / (self.y.1 - self.y.0)).max(0.0);
        (
            MARGIN + across * (WIDTH - 4.5 * MARGIN),
            self.top + HEIGHT - MARGIN - up * (HEIGHT - 1.6 * MARGIN),
        )
    }

    /// Horizontal lines with the numbers of the y axis.
    fn draw_levels(&self, svg: &mut String, levels: &[(f64, String)]) {
        for (level, label) in levels {
            let (left, y) = self.place((self.x.0, *level));
            let (right, _) = self.place((self.x.1, *level));
            let _ = writeln!(
                svg,
                "<path d=\"M{left:.1} {y:.1}H{right:.1}\" stroke=\"#ddd\"/>"
            );
            let _ = writeln!(
                svg,
                "<text x=\"4\" y=\"{y:.1}\" fill=\"#666\">{label}</text>"
            );
        }
    }

    /// The labels of the x axis.
    fn draw_ticks(&self, svg: &mut String, ticks: &[(f64, String)]) {
        for (at, label) in ticks {
            let (x, y) = self.place((*at, self.y.0));
            let label = escape(label);
            let _ = writeln!(
                svg,
                "<text x=\"{x:.1}\" y=\"{:.1}\" fill=\"#666\">{label}</text>",
                y + 16.0
            );
        }
    }

    /// A line through at most [`POINTS`] of its points, with their marks if wanted and the spread
    /// of all points.
    fn draw_line(&self, svg: &mut String, line: &Line, color: &str, with_marks: bool) {
        let thinned = line.points.len().div_ceil(POINTS);
        let points = line.points.iter().step_by(thinned);
        let drawn: Vec<_> = points.map(|point| self.place(*point)).collect();
        let path = drawn.iter().map(|(x, y)| format!("{x:.1},{y:.1}"));
        let path = path.collect::<Vec<_>>().join(" ");
        let _ = writeln!(
            svg,
            "<polyline points=\"{path}\" fill=\"none\" stroke=\"{color}\"/>"
        );
        if with_marks {
            for (x, y) in &drawn {
                let _ = writeln!(
                    svg,
                    "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"3\" fill=\"{color}\"/>"
                );
            }
        }
        for ((x, y), spread) in line.points.iter().zip(&line.spread) {
            let (across, low) = self.place((*x, y - spread));
            let (_, high) = self.place((*x, y + spread));
            let _ = writeln!(
                svg,
                "<path d=\"M{across:.1} {low:.1}V{high:.1}\" stroke=\"{color}\"/>"
            );
        }
    }

    /// The name and last value of line `i`, at the right.
    fn draw_name(&self, svg: &mut String, line: &Line, i: usize) {
        let x = WIDTH - 3.3 * MARGIN;
        let y = self.top + 30.0 + 16.0 * i as f64;
        let newest = line.points.last().map_or(0.0, |(_, y)| *y);
        let (name, color) = (escape(&line.name), color(i));
        let _ = writeln!(
            svg,
            "<text x=\"{x}\" y=\"{y}\" fill=\"{color}\">{name} {newest:.3}</text>"
        );
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
