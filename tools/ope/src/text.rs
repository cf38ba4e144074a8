//! Files of numbers as people write them: one row per frame.
//!
//! Commas, semicolons, tabs and spaces separate; lines end in LF or CRLF; a byte order mark, columns behind the fourth
//! (confidences) and blank lines at the end are passed over. `NaN` in any case is a number here.

use crate::bbox::BBox;
use crate::error::{Error, brief};
use std::fs;
use std::path::Path;

/// Largest file of boxes or times, in bytes: over a million frames.
pub const MAX_BYTES: u64 = 64 << 20;

/// The boxes of a file, one per line: `x,y,w,h`.
///
/// # Errors
/// If the file cannot be read, is larger than [`MAX_BYTES`], holds no row, or a line is not four numbers or more.
pub fn read_boxes(path: &Path) -> Result<Vec<BBox>, Error> {
    read_rows(path, "x,y,w,h", |line| {
        let mut numbers = fields(line).take(4).map(|field| field.parse().ok());
        let mut next = || numbers.next().flatten();
        Some(BBox::new(next()?, next()?, next()?, next()?))
    })
}

/// The numbers of a file, the first of every line: seconds per frame, flags.
///
/// # Errors
/// As of [`read_boxes`].
pub fn read_numbers(path: &Path) -> Result<Vec<f64>, Error> {
    read_rows(path, "a number", |line| fields(line).next()?.parse().ok())
}

/// All numbers of a file, whatever line they are on: attribute flags, absence flags in one row.
///
/// # Errors
/// As of [`read_boxes`].
pub fn read_all_numbers(path: &Path) -> Result<Vec<f64>, Error> {
    let rows = read_rows(path, "numbers", |line| {
        fields(line)
            .map(|field| field.parse().ok())
            .collect::<Option<Vec<f64>>>()
    })?;
    Ok(rows.concat())
}

/// Reads a text file of bounded size.
///
/// # Errors
/// If it cannot be read or is larger than [`MAX_BYTES`].
pub fn read(path: &Path) -> Result<String, Error> {
    let bytes = fs::metadata(path).map_err(Error::unreadable(path))?.len();
    if bytes > MAX_BYTES {
        return Err(Error::TooLarge {
            path: path.to_path_buf(),
            bytes,
            limit: MAX_BYTES,
        });
    }
    let bytes = fs::read(path).map_err(Error::unreadable(path))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

fn read_rows<T>(
    path: &Path,
    expected: &'static str,
    parse: impl Fn(&str) -> Option<T>,
) -> Result<Vec<T>, Error> {
    let text = read(path)?;
    let text = text.trim_start_matches('\u{feff}').trim_end();
    if text.is_empty() {
        return Err(Error::content(
            path,
            format!("{expected} per line"),
            "an empty file",
        ));
    }
    let row = |(i, line): (usize, &str)| {
        let failure = || Error::Line {
            path: path.to_path_buf(),
            line: i + 1,
            expected,
            found: brief(line.trim_end()),
        };
        parse(line).ok_or_else(failure)
    };
    text.lines().enumerate().map(row).collect()
}

fn fields(line: &str) -> impl Iterator<Item = &str> {
    line.split(|c: char| c == ',' || c == ';' || c.is_whitespace())
        .filter(|field| !field.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Folder;

    fn boxes(text: &[u8]) -> Result<Vec<BBox>, String> {
        let folder = Folder::new("text");
        let path = folder.write("boxes.txt", text);
        read_boxes(&path).map_err(|error| {
            error
                .to_string()
                .replace(&path.display().to_string(), "FILE")
        })
    }

    #[test]
    fn every_way_to_write_a_box() {
        let expected = Ok(vec![
            BBox::new(1.0, 2.5, 3.0, 4.0),
            BBox::new(-5.0, 6.0, 7.0, 8.0),
        ]);
        for text in [
            "1,2.5,3,4\n-5,6,7,8\n",
            "1,2.5,3,4\n-5,6,7,8",
            "\u{feff}1,2.5,3,4\r\n-5,6,7,8\r\n\r\n",
            "1\t2.5\t3\t4\n-5\t6\t7\t8\n",
            "  1 2.5   3.0 4\n-5 6 7 8\n\n\n",
            "1, 2.5, 3, 4, 0.93\n-5,\t6, 7, 8, 0.5\n",
            "1;2.5;3;4\n-5;6e0;7;8\n",
            "1.000,2.500,3.000,4.000,\n-5.000,6.000,7.000,8.000,\n",
        ] {
            assert_eq!(boxes(text.as_bytes()), expected, "{text:?}");
        }
        let absent = boxes(b"NaN,nan,NAN,-nan\n0,0,0,0\n").unwrap();
        assert!(absent[0].has_nan() && absent[1] == BBox::default());
    }

    #[test]
    fn what_is_no_box_is_named() {
        assert_eq!(
            boxes(b""),
            Err("FILE: expected x,y,w,h per line, found an empty file".into())
        );
        assert_eq!(boxes(b"\r\n \n"), boxes(b""));
        let expected = "FILE: line 2: expected x,y,w,h, found \"1,2,3\"";
        assert_eq!(boxes(b"1,2,3,4\n1,2,3\n"), Err(expected.into()));
        let expected = "FILE: line 2: expected x,y,w,h, found \"\"";
        assert_eq!(boxes(b"1,2,3,4\n\n1,2,3,4\n"), Err(expected.into()));
        assert!(boxes(b"x,y,w,h\n1,2,3,4\n").unwrap_err().contains("line 1"));
        assert!(
            boxes(b"\xff\xfe1\x00,\x002\x00")
                .unwrap_err()
                .contains("line 1")
        );
        assert!(boxes(b"1,,3,4").unwrap_err().contains("line 1"));
        let missing = read_boxes(Path::new("/nonexistent/a.txt"))
            .unwrap_err()
            .to_string();
        assert!(
            missing.starts_with("/nonexistent/a.txt: cannot be read"),
            "{missing}"
        );
    }
}
