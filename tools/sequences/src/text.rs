//! Files of numbers as people write them: one row per frame.
//!
//! | what a file may hold | how it is read |
//! |---|---|
//! | commas, semicolons, tabs, spaces between numbers | any of them separates |
//! | lines that end in LF, CRLF, CR or CR CRLF | all end a line |
//! | a byte order mark, UTF-16 with one | decoded |
//! | `20,5;40,5;24,5;18,5`, or the same between tabs, spaces or quotes | decimal commas |
//! | `NaN` in any case, infinity | a frame without a box |
//! | four columns | left, top, width, height |
//! | a fifth column | a confidence, ignored |
//! | a first of five columns that counts rows from 0 or 1 | frame numbers, ignored |
//! | eight columns | a polygon's corners `x1,y1,...,x4,y4`: the box around them |
//! | a header with `x`, `y`, `w`, `h` (`left`, `top`, `width`, `height`) | names the columns |
//! | blank lines at either end, or after every row | ignored |
//!
//! Everything else is an error that names the file and the line: other counts of columns, empty
//! fields, a blank line between rows (is it a frame?), eight numbers that are no polygon.

use crate::error::{Error, brief};
use crate::rect::Rect;
use std::fs;
use std::path::Path;

/// Largest file of boxes or times, in bytes: over a million frames.
pub const MAX_BYTES: u64 = 64 << 20;

/// What a row of boxes should be.
const BOX: &str = "x,y,w,h";

/// The boxes of a file, one per frame.
///
/// # Errors
/// If the file cannot be read, is larger than [`MAX_BYTES`], holds no row, or a row is not a box.
pub fn read_boxes(path: &Path) -> Result<Vec<Rect>, Error> {
    parse_boxes(&read(path)?).map_err(|bad| bad.into_error(path))
}

/// The first number of every line: seconds per frame.
///
/// # Errors
/// If the file cannot be read, is too large, holds no row, or a line does not begin with a number.
pub fn read_numbers(path: &Path) -> Result<Vec<f64>, Error> {
    let text = read(path)?;
    let mut first = Vec::new();
    for line in rows(&text, "a number").map_err(|bad| bad.into_error(path))? {
        let row = numbers(line.text).unwrap_or_default();
        let number = row.first().copied();
        first.push(number.ok_or_else(|| line.bad("a number").into_error(path))?);
    }
    Ok(first)
}

/// All numbers of a file, whatever line they are on: attribute flags, absence flags in one row.
///
/// # Errors
/// If the file cannot be read, is too large, holds no row, or something in it is not a number.
pub fn read_all_numbers(path: &Path) -> Result<Vec<f64>, Error> {
    let text = read(path)?;
    let mut all = Vec::new();
    for line in rows(&text, "numbers").map_err(|bad| bad.into_error(path))? {
        // Commas only separate: `0,1` is two flags, not a number with a decimal comma.
        let fields = fields(line.text).unwrap_or_default();
        for field in fields {
            let number = field.parse().ok();
            all.push(number.ok_or_else(|| line.bad("numbers").into_error(path))?);
        }
    }
    Ok(all)
}

/// Reads a text file of bounded size: UTF-8, or UTF-16 with a byte order mark.
///
/// # Errors
/// If it cannot be read, is no regular file (a pipe may never end), or is larger than
/// [`MAX_BYTES`].
pub fn read(path: &Path) -> Result<String, Error> {
    let found = fs::metadata(path).map_err(Error::unreadable(path))?;
    if !found.is_file() {
        let found = if found.is_dir() {
            "a folder"
        } else {
            "a pipe or device"
        };
        return Err(Error::content(path, "a file", found));
    }
    let bytes = found.len();
    if bytes > MAX_BYTES {
        return Err(Error::TooLarge {
            path: path.to_path_buf(),
            bytes,
            limit: MAX_BYTES,
        });
    }
    let bytes = fs::read(path).map_err(Error::unreadable(path))?;
    Ok(decode(&bytes))
}

/// Bytes as text: UTF-16 by its byte order mark, otherwise UTF-8 with or without one.
///
/// Bytes that are neither become replacement characters, which no number contains.
pub fn decode(bytes: &[u8]) -> String {
    let utf16 = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let units: Vec<u16> = bytes.chunks_exact(2).map(|b| unit([b[0], b[1]])).collect();
        String::from_utf16_lossy(&units)
    };
    let text = match bytes {
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        _ => String::from_utf8_lossy(bytes).into_owned(),
    };
    text.trim_start_matches('\u{feff}').to_owned()
}

/// A row that cannot be used, or a file without rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BadRow {
    /// The line, 1-based; `None` if the file has no row at all.
    pub line: Option<usize>,
    /// What should be there.
    pub expected: String,
    /// What is there.
    pub found: String,
}

impl BadRow {
    fn new(line: usize, expected: impl ToString, found: &str) -> BadRow {
        BadRow {
            line: Some(line),
            expected: expected.to_string(),
            found: brief(found.trim()),
        }
    }

    fn into_error(self, path: &Path) -> Error {
        match self.line {
            Some(line) => Error::Line {
                path: path.to_path_buf(),
                line,
                expected: self.expected,
                found: self.found,
            },
            None => Error::content(path, self.expected, self.found),
        }
    }
}

/// The boxes of a text, one per row, as [`read_boxes`] reads them.
///
/// # Errors
/// If there is no row, or one is not a box.
pub fn parse_boxes(text: &str) -> Result<Vec<Rect>, BadRow> {
    let mut lines = rows(text, BOX)?;
    let header = Header::read(lines[0].text);
    if header.is_some() {
        lines.remove(0);
    }
    let mut table = Vec::with_capacity(lines.len());
    for line in &lines {
        let row = numbers(line.text).ok_or_else(|| line.bad(BOX))?;
        table.push(row);
    }
    if let Some(header) = header {
        return header.boxes(&lines, &table);
    }
    let has_frame_numbers = counts_frames(&table);
    let mut boxes = Vec::with_capacity(lines.len());
    for (line, row) in lines.iter().zip(&table) {
        let rect = match row[..] {
            [x, y, w, h] => Rect::new(x, y, w, h),
            [_, x, y, w, h] if has_frame_numbers => Rect::new(x, y, w, h),
            [x, y, w, h, _] => Rect::new(x, y, w, h),
            [x1, y1, x2, y2, x3, y3, x4, y4] => {
                let corners = [(x1, y1), (x2, y2), (x3, y3), (x4, y4)];
                polygon(&corners).ok_or_else(|| line.bad("the four corners of a polygon"))?
            }
            _ if row.len() < 4 => return Err(line.bad(BOX)),
            _ => {
                let count = row.len();
                let expected =
                    format!("x,y,w,h or the 8 numbers of a polygon, not {count} columns");
                return Err(line.bad(expected));
            }
        };
        boxes.push(rect);
    }
    Ok(boxes)
}

/// Whether the first of five columns holds frame numbers: it counts from 0 or 1, and the last
/// column is no confidence because it exceeds 1.
fn counts_frames(table: &[Vec<f64>]) -> bool {
    let start = table[0].first().copied().unwrap_or(f64::NAN);
    let counts = |(i, row): (usize, &Vec<f64>)| row.len() == 5 && row[0] == start + i as f64;
    (start == 0.0 || start == 1.0)
        && table.len() > 1
        && table.iter().enumerate().all(counts)
        && table.iter().any(|row| row[4] > 1.0)
}

/// The box around four corners; `None` if three successive ones lie on a line, as they do if the
/// numbers are a box and flags after it. Corners that are all the same mark a frame without a
/// target.
fn polygon(corners: &[(f64, f64); 4]) -> Option<Rect> {
    let is_point = corners.iter().all(|corner| *corner == corners[0]);
    let rect = Rect::around(corners);
    if rect.has_nan() || is_point {
        return Some(rect);
    }
    let is_corner = |i: usize| {
        let a = corners[i];
        let b = corners[(i + 1) % 4];
        let c = corners[(i + 2) % 4];
        (b.0 - a.0) * (c.1 - b.1) != (b.1 - a.1) * (c.0 - b.0)
    };
    (0..4).all(is_corner).then_some(rect)
}

/// A first line that names the columns.
struct Header {
    columns: usize,
    frame: Option<usize>,
    at: [usize; 4],
}

impl Header {
    /// Reads a header; `None` if the line is not one, or does not name all of a box.
    fn read(line: &str) -> Option<Header> {
        let is_separator = |c: char| c == ',' || c == ';' || c.is_whitespace();
        let names: Vec<String> = line
            .split(is_separator)
            .map(|name| name.trim_matches(['"', '#']).to_ascii_lowercase())
            .filter(|name| !name.is_empty())
            .collect();
        let find = |wanted: &[&str]| names.iter().position(|n| wanted.contains(&n.as_str()));
        Some(Header {
            columns: names.len(),
            frame: find(&["frame", "frame_id", "frameid", "index"]),
            at: [
                find(&["x", "left"])?,
                find(&["y", "top"])?,
                find(&["w", "width"])?,
                find(&["h", "height"])?,
            ],
        })
    }

    fn boxes(&self, lines: &[Line<'_>], table: &[Vec<f64>]) -> Result<Vec<Rect>, BadRow> {
        if table.is_empty() {
            return Err(no_row(BOX));
        }
        let mut boxes = Vec::with_capacity(table.len());
        for (i, (line, row)) in lines.iter().zip(table).enumerate() {
            if row.len() != self.columns {
                let expected = format!("{} columns, as the header has", self.columns);
                return Err(line.bad(expected));
            }
            // A gap in the frame numbers would shift every box after it.
            if let Some(frame) = self.frame {
                let expected = table[0][frame] + i as f64;
                if row[frame] != expected {
                    return Err(line.bad(format!("frame {expected}")));
                }
            }
            let [x, y, w, h] = self.at.map(|column| row[column]);
            boxes.push(Rect::new(x, y, w, h));
        }
        Ok(boxes)
    }
}

/// A line of a file with its 1-based number.
struct Line<'a> {
    number: usize,
    text: &'a str,
}

impl Line<'_> {
    fn bad(&self, expected: impl ToString) -> BadRow {
        BadRow::new(self.number, expected, self.text)
    }
}

fn no_row(expected: &str) -> BadRow {
    BadRow {
        line: None,
        expected: format!("{expected} per line"),
        found: "an empty file".into(),
    }
}

/// The rows of a text; at least one.
fn rows<'a>(text: &'a str, expected: &str) -> Result<Vec<Line<'a>>, BadRow> {
    let lines: Vec<Line<'_>> = split_lines(text)
        .into_iter()
        .enumerate()
        .map(|(i, text)| Line {
            number: i + 1,
            text,
        })
        .collect();
    let is_blank = |line: &Line<'_>| line.text.trim().is_empty();
    let Some(first) = lines.iter().position(|line| !is_blank(line)) else {
        return Err(no_row(expected));
    };
    let last = lines
        .iter()
        .rposition(|line| !is_blank(line))
        .unwrap_or(first);
    let rows = lines.into_iter().take(last + 1).skip(first);
    let (blank, full): (Vec<_>, Vec<_>) = rows.partition(is_blank);
    // Files that went through the wrong text mode have a blank line after every row.
    let is_double_spaced = blank.len() > 1
        && blank.len() + 1 == full.len()
        && full
            .windows(2)
            .all(|two| two[1].number == two[0].number + 2);
    match blank.first() {
        Some(line) if !is_double_spaced => Err(line.bad(format!(
            "{expected} (NaN in a frame without a target), not a blank line"
        ))),
        _ => Ok(full),
    }
}

/// Lines that end in LF, CRLF, CR or CR CRLF.
fn split_lines(text: &str) -> Vec<&str> {
    let mut lines = Vec::new();
    let mut rest = text;
    while let Some(end) = rest.find(['\n', '\r']) {
        lines.push(&rest[..end]);
        let after = &rest[end..];
        let ending = ["\r\r\n", "\r\n"]
            .into_iter()
            .find(|e| after.starts_with(e));
        rest = &after[ending.map_or(1, str::len)..];
    }
    lines.push(rest);
    lines
}

/// The numbers of a row; `None` if a field is empty or not a number. Infinity counts as NaN.
fn numbers(line: &str) -> Option<Vec<f64>> {
    let parse = |field: &str| {
        let value: f64 = field.parse().ok()?;
        Some(if value.is_finite() { value } else { f64::NAN })
    };
    match decimal_comma_fields(line) {
        Some(fields) => fields.iter().map(|f| parse(&f.replace(',', "."))).collect(),
        None => fields(line)?.into_iter().map(parse).collect(),
    }
}

/// The fields of a row whose commas are decimal; `None` if commas separate in it.
///
/// Semicolons, quotes or blanks then separate the fields, no decimal point appears, and every comma
/// stands between two digits.
fn decimal_comma_fields(line: &str) -> Option<Vec<&str>> {
    if !line.contains(',') || line.contains('.') {
        return None;
    }
    let line = line.trim_end_matches([';', ',', ' ', '\t']);
    let fields: Vec<&str> = if line.contains(';') {
        line.split(';')
            .map(|f| f.trim().trim_matches('"'))
            .collect()
    } else if line.contains('"') {
        let quoted = line.split('"').skip(1).step_by(2);
        quoted.map(str::trim).collect()
    } else {
        line.split_whitespace().collect()
    };
    let is_decimal = |field: &&str| {
        let digit = |c: Option<char>| c.is_some_and(|c| c.is_ascii_digit());
        match field.split_once(',') {
            Some((whole, part)) => {
                digit(whole.chars().next_back())
                    && digit(part.chars().next())
                    && !part.contains(',')
            }
            None => true,
        }
    };
    let is_row = fields.len() > 1 || !line.contains([';', '"']);
    let counts = [1, 4, 5, 8].contains(&fields.len());
    let has_comma = fields.iter().any(|field| field.contains(','));
    (is_row && counts && has_comma && fields.iter().all(is_decimal)).then_some(fields)
}

/// The fields of a row between commas, semicolons and blanks; `None` if one is empty.
fn fields(line: &str) -> Option<Vec<&str>> {
    let line = line.trim_end_matches(|c: char| c == ',' || c == ';' || c.is_whitespace());
    let mut fields = Vec::new();
    for part in line.split([',', ';']) {
        let before = fields.len();
        fields.extend(part.split_whitespace().map(|field| field.trim_matches('"')));
        if fields.len() == before {
            return None;
        }
    }
    Some(fields)
}

#[cfg(test)]
mod tests;
