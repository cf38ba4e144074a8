//! Lines, tables and JSON for standard output; the progress bar on standard error.

use std::io::Write;

use indicatif::{ProgressBar, ProgressStyle};
use serde_json::Value;

use crate::exit::Failure;

/// Prints text and a newline to standard output.
pub fn print(text: &str) -> Result<(), Failure> {
    writeln!(std::io::stdout(), "{text}").map_err(|error| Failure::stdout(&error))
}

/// A number for JSON with that many decimals; JSON has no NaN, so that becomes null.
pub fn rounded(number: f64, decimals: i32) -> Value {
    let scale = 10f64.powi(decimals);
    Value::from((number * scale).round() / scale)
}

/// A whole number with thousands set apart by commas.
pub fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut out = String::with_capacity(digits.len() * 4 / 3);
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

/// A progress bar on standard error; hidden where that is no terminal. `None` frames: it counts
/// without an end.
pub fn progress(frames: Option<usize>) -> ProgressBar {
    let (bar, template) = match frames {
        Some(frames) => (
            ProgressBar::new(frames as u64),
            "{wide_bar:.yellow} {pos}/{len} {per_sec} {eta}",
        ),
        None => (
            ProgressBar::new_spinner(),
            "{spinner:.yellow} {pos} {per_sec}",
        ),
    };
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Rows under a header, the first column left-aligned, the others right-aligned, two spaces apart.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    let mut widths: Vec<usize> = header.iter().map(|cell| cell.chars().count()).collect();
    for row in rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = (*width).max(cell.chars().count());
        }
    }
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let mut text = String::new();
        for (i, (cell, &width)) in cells.zip(&widths).enumerate() {
            match i {
                0 => text.push_str(&format!("{cell:<width$}")),
                _ => text.push_str(&format!("  {cell:>width$}")),
            }
        }
        text.trim_end().to_string()
    };
    let mut lines = vec![line(&mut header.iter().copied())];
    lines.extend(
        rows.iter()
            .map(|row| line(&mut row.iter().map(String::as_str))),
    );
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers() {
        for (number, text) in [
            (0, "0"),
            (999, "999"),
            (1000, "1,000"),
            (7_489_986, "7,489,986"),
        ] {
            assert_eq!(grouped(number), text);
        }
        assert_eq!(rounded(0.12345, 3), 0.123);
        assert_eq!(rounded(f64::NAN, 3), Value::Null);
    }

    #[test]
    fn tables_align() {
        let rows = [
            vec!["conv1".into(), "7".into()],
            vec!["x".into(), "1000".into()],
        ];
        assert_eq!(
            table(&["layer", "n"], &rows),
            "layer     n\nconv1     7\nx      1000"
        );
    }
}
