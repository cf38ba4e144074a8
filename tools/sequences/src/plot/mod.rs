//! Plots as SVG, each a complete file that can also be embedded in a page.
//!
//! | plot | item |
//! |---|---|
//! | curves of trackers, points, radars | [`lines`], [`points`], [`radar`] |
//! | losses and accuracy over steps, one panel below the other | [`panels`] |

mod chart;
pub mod panels;

pub use chart::{Axes, Series, lines, points, radar};

/// Colors that most people can tell apart (Okabe and Ito). Further lines repeat them, dashed.
const COLORS: [&str; 8] = [
    "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a5195", "#8c8c8c",
];

/// The color of line `i`.
pub fn color(i: usize) -> &'static str {
    COLORS[i % COLORS.len()]
}

/// `text` with the characters escaped that mean something in XML, and without control characters.
pub fn escape(text: &str) -> String {
    let mut escaped = String::new();
    for c in text.chars() {
        match c {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            c if c.is_control() => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}
