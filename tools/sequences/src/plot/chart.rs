//! Charts that compare trackers: curves, points, radars.

use super::{COLORS, color, escape};
use std::fmt::Write;

/// One tracker's line or polygon.
#[derive(Clone, Debug)]
pub struct Series {
    /// Its name in the legend.
    pub label: String,
    /// Points in data units.
    pub points: Vec<(f64, f64)>,
}

/// Title, labels and ranges of a plot.
#[derive(Clone, Copy, Debug)]
pub struct Axes<'a> {
    /// The title above the plot.
    pub title: &'a str,
    /// The label of the horizontal axis.
    pub x: &'a str,
    /// The label of the vertical axis.
    pub y: &'a str,
    /// The left end of the horizontal axis: 0, or above 0 for a logarithmic one.
    pub x_min: f64,
    /// The right end of the horizontal axis.
    pub x_max: f64,
    /// The upper end of the vertical axis, which starts at 0.
    pub y_max: f64,
}

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 400.0;
const LEFT: f64 = 58.0;
const TOP: f64 = 38.0;
const INNER_WIDTH: f64 = WIDTH - LEFT - 22.0;
const INNER_HEIGHT: f64 = HEIGHT - TOP - 52.0;

/// Curves, with a legend at the lower left or lower right.
pub fn lines(axes: &Axes<'_>, series: &[Series], legend_left: bool) -> String {
    let mut svg = frame(axes);
    for (i, line) in series.iter().enumerate() {
        let points = line.points.iter().map(|point| place(axes, *point));
        let points: Vec<String> = points.map(|(x, y)| format!("{x:.1},{y:.1}")).collect();
        let dash = if i < COLORS.len() {
            ""
        } else {
            " stroke-dasharray=\"6 4\""
        };
        let _ = writeln!(
            svg,
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\"{dash}/>",
            points.join(" "),
            color(i)
        );
    }
    let x = LEFT
        + if legend_left {
            14.0
        } else {
            INNER_WIDTH * 0.55
        };
    let bottom = TOP + INNER_HEIGHT - 17.0 * series.len() as f64 - 4.0;
    legend(&mut svg, series, x, bottom.max(TOP + 16.0));
    svg + "</svg>\n"
}

/// One labeled point per series.
pub fn points(axes: &Axes<'_>, series: &[Series]) -> String {
    let mut svg = frame(axes);
    for (i, point) in series.iter().enumerate() {
        for p in &point.points {
            let (x, y) = place(axes, *p);
            let is_right = along(axes, p.0) > 0.7; // the label goes to the left of the point
            let (anchor, offset) = if is_right { ("end", -9) } else { ("start", 9) };
            let _ = writeln!(
                svg,
                "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"6\" fill=\"{}\"/>\
                 <text x=\"{x:.1}\" y=\"{y:.1}\" dx=\"{offset}\" dy=\"-7\" \
                 text-anchor=\"{anchor}\">{}</text>",
                color(i),
                escape(&point.label)
            );
        }
    }
    svg + "</svg>\n"
}

/// A polygon per series, with a corner on each spoke. The `y` of point `i` is the value on spoke
/// `i`, in percent of the radius.
pub fn radar(title: &str, spokes: &[String], series: &[Series]) -> String {
    let cx = WIDTH / 2.0;
    let cy = HEIGHT / 2.0 + 8.0;
    let radius = 118.0;
    let at = |i: usize, percent: f64| {
        let angle = std::f64::consts::TAU * i as f64 / spokes.len() as f64;
        let r = radius * percent / 100.0;
        (cx + r * angle.sin(), cy - r * angle.cos())
    };
    let ring = |values: &dyn Fn(usize) -> f64| {
        let corner = |i| {
            let (x, y) = at(i, values(i));
            format!("{x:.1},{y:.1}")
        };
        (0..spokes.len()).map(corner).collect::<Vec<_>>().join(" ")
    };
    let mut svg = open(title);
    for percent in [25.0, 50.0, 75.0, 100.0] {
        let _ = writeln!(
            svg,
            "<polygon points=\"{}\" class=\"grid\" fill=\"none\"/>",
            ring(&|_| percent)
        );
    }
    for (i, spoke) in spokes.iter().enumerate() {
        let (x, y) = at(i, 110.0);
        let anchor = match x - cx {
            d if d > 10.0 => "start",
            d if d < -10.0 => "end",
            _ => "middle",
        };
        let _ = writeln!(
            svg,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{}</text>",
            escape(spoke)
        );
    }
    for (s, line) in series.iter().enumerate() {
        let value = |i: usize| line.points.get(i).map_or(0.0, |p| p.1);
        let _ = writeln!(
            svg,
            "<polygon points=\"{}\" fill=\"{1}\" fill-opacity=\"0.08\" \
             stroke=\"{1}\" stroke-width=\"2\"/>",
            ring(&value),
            color(s)
        );
    }
    legend(&mut svg, series, 10.0, TOP);
    svg + "</svg>\n"
}

/// The start of a picture: its size, style and title.
fn open(title: &str) -> String {
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" \
         font-family=\"system-ui, sans-serif\" font-size=\"12\" fill=\"currentColor\">\n\
         <style>.grid {{ stroke: currentColor; stroke-opacity: 0.18 }}</style>\n\
         <title>{0}</title>\n\
         <text x=\"{1}\" y=\"22\" text-anchor=\"middle\" font-size=\"15\">{0}</text>\n",
        escape(title),
        WIDTH / 2.0
    )
}

/// The start of a plot with axes: title, grid, numbers and labels.
fn frame(axes: &Axes<'_>) -> String {
    let mut svg = open(axes.title);
    let right = LEFT + INNER_WIDTH;
    let bottom = TOP + INNER_HEIGHT;
    for value in ticks(axes.x_min, axes.x_max) {
        let x = LEFT + INNER_WIDTH * along(axes, value);
        let _ = writeln!(
            svg,
            "<path d=\"M{x:.1} {TOP}V{bottom}\" class=\"grid\"/>\
             <text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\">{}</text>",
            bottom + 17.0,
            tick(value)
        );
    }
    for value in ticks(0.0, axes.y_max) {
        let y = bottom - INNER_HEIGHT * value / axes.y_max;
        let _ = writeln!(
            svg,
            "<path d=\"M{LEFT} {y:.1}H{right}\" class=\"grid\"/>\
             <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{}</text>",
            LEFT - 7.0,
            y + 4.0,
            tick(value)
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{}</text>\
         <text transform=\"translate(15 {}) rotate(-90)\" text-anchor=\"middle\">{}</text>",
        LEFT + INNER_WIDTH / 2.0,
        HEIGHT - 12.0,
        escape(axes.x),
        TOP + INNER_HEIGHT / 2.0,
        escape(axes.y)
    );
    svg
}

/// The numbers on an axis: five steps, or 1, 2, 5, 10 ... on a logarithmic one.
fn ticks(min: f64, max: f64) -> Vec<f64> {
    if min <= 0.0 {
        return (0..=5).map(|i| max * f64::from(i) / 5.0).collect();
    }
    let decades = (max / min).log10();
    let steps: &[f64] = if decades > 3.0 {
        &[1.0]
    } else {
        &[1.0, 2.0, 5.0]
    };
    let powers = min.log10().floor() as i32..=max.log10().ceil() as i32;
    let all = powers.flat_map(|power| steps.iter().map(move |step| step * 10f64.powi(power)));
    all.filter(|value| (min * 0.999..=max * 1.001).contains(value))
        .collect()
}

/// The place of a value on the horizontal axis, from 0 to 1.
fn along(axes: &Axes<'_>, x: f64) -> f64 {
    let part = if axes.x_min > 0.0 {
        (x / axes.x_min).ln() / (axes.x_max / axes.x_min).ln()
    } else {
        x / axes.x_max
    };
    part.clamp(0.0, 1.0)
}

/// A number on an axis, with at most two decimals.
fn tick(value: f64) -> String {
    let text = format!("{value:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A point's place in the picture. Points beyond an axis lie at its end.
fn place(axes: &Axes<'_>, (x, y): (f64, f64)) -> (f64, f64) {
    let x = LEFT + INNER_WIDTH * along(axes, x);
    let y = TOP + INNER_HEIGHT * (1.0 - (y / axes.y_max).clamp(0.0, 1.0));
    (x, y)
}

fn legend(svg: &mut String, series: &[Series], x: f64, y: f64) {
    let longest = series
        .iter()
        .map(|line| line.label.chars().count())
        .max()
        .unwrap_or(0);
    let width = 34.0 + 6.5 * longest as f64;
    let height = 17.0 * series.len() as f64 + 6.0;
    let _ = writeln!(
        svg,
        "<rect x=\"{}\" y=\"{}\" width=\"{width}\" height=\"{height}\" rx=\"4\" \
         fill=\"Canvas\" fill-opacity=\"0.8\"/>",
        x - 6.0,
        y - 15.0
    );
    for (i, line) in series.iter().enumerate() {
        let y = y + 17.0 * i as f64;
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{}\" width=\"18\" height=\"4\" fill=\"{}\"/>\
             <text x=\"{}\" y=\"{y}\">{}</text>",
            y - 6.0,
            color(i),
            x + 24.0,
            escape(&line.label)
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_beyond_the_axes_are_drawn_at_their_ends_and_names_are_escaped() {
        let axes = Axes {
            title: "t",
            x: "x",
            y: "y",
            x_min: 0.0,
            x_max: 50.0,
            y_max: 1.0,
        };
        let series = [Series {
            label: "<a&b>".into(),
            points: vec![(0.0, 0.0), (50.0, 1.0), (99.0, 9.0)],
        }];
        let svg = lines(&axes, &series, false);
        assert!(
            svg.contains("points=\"58.0,348.0 538.0,38.0 538.0,38.0\""),
            "{svg}"
        );
        assert!(svg.contains("&lt;a&amp;b&gt;") && svg.ends_with("</svg>\n"));
        assert!(points(&axes, &series).matches("<circle").count() == 3);
        assert!(
            radar("r", &["one".into(), "two".into(), "three".into()], &series)
                .contains(">three</text>")
        );
    }

    #[test]
    fn logarithmic_axis_has_ticks_at_1_2_and_5() {
        let axes = Axes {
            title: "t",
            x: "x",
            y: "y",
            x_min: 1.0,
            x_max: 100.0,
            y_max: 1.0,
        };
        assert_eq!(
            [1.0, 10.0, 100.0, 0.0, 999.0].map(|x| along(&axes, x)),
            [0.0, 0.5, 1.0, 0.0, 1.0]
        );
        assert_eq!(ticks(1.0, 100.0), [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0]);
        assert_eq!(ticks(1.0, 1e5).len(), 6);
        assert_eq!(ticks(0.0, 50.0), [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]);
    }
}
