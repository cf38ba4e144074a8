//! Which files of a folder or pattern are frames, and in which order.

use std::cmp::Ordering;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use super::SourceError;

const IMAGES: [&str; 5] = ["jpg", "jpeg", "png", "webp", "bmp"];

/// Whether a file's name says that it is a picture.
pub(super) fn is_image(path: &Path) -> bool {
    has_extension(path, &IMAGES)
}

/// Whether a file's name ends in one of these extensions, in whatever case.
pub(super) fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension()
        .is_some_and(|found| extensions.iter().any(|e| found.eq_ignore_ascii_case(e)))
}

/// Whether a location that does not exist is meant as a glob pattern.
pub(super) fn is_pattern(location: &str) -> bool {
    location.contains(['*', '?', '['])
}

/// A local file as ffmpeg wants it: without this a name with a colon would be taken for a protocol.
pub(super) fn file_url(path: &Path) -> OsString {
    let mut url = OsString::from("file:");
    url.push(path);
    url
}

/// The pictures directly inside a folder, in natural order.
pub(super) fn in_folder(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let io = |error| SourceError::Io {
        path: folder.to_path_buf(),
        error,
    };
    let mut files = Vec::new();
    let mut folders = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        match path.is_dir() {
            true => folders.push(path),
            false if is_image(&path) => files.push(path),
            false => {}
        }
    }
    if files.is_empty() {
        let hint = match folders.iter().find(|folder| folder.ends_with("img")) {
            Some(folder) => format!("; did you mean {}?", folder.display()),
            None => String::new(),
        };
        return Err(nothing(folder.display().to_string(), hint));
    }
    files.sort_by(|a, b| natural(a, b));
    Ok(files)
}

/// The pictures that a glob pattern matches, in natural order.
pub(super) fn matching(pattern: &str) -> Result<Vec<PathBuf>, SourceError> {
    let wrong = |error: glob::PatternError| SourceError::Format {
        input: pattern.into(),
        reason: format!(
            "expected a glob pattern, found at character {}: {}",
            error.pos, error.msg
        ),
    };
    let mut files = Vec::new();
    for path in glob::glob(pattern).map_err(wrong)? {
        let path = path.map_err(|e| SourceError::Io {
            path: e.path().into(),
            error: e.into(),
        })?;
        if is_image(&path) && !path.is_dir() {
            files.push(path);
        }
    }
    if files.is_empty() {
        return Err(nothing(pattern.into(), String::new()));
    }
    files.sort_by(|a, b| natural(a, b));
    Ok(files)
}

fn nothing(input: String, hint: String) -> SourceError {
    SourceError::Empty {
        input,
        reason: format!(
            "expected pictures ({}), found none{hint}",
            IMAGES.join(", ")
        ),
    }
}

/// Orders names as people count: digits as numbers, so that `img2` comes before `img10`.
fn natural(a: &Path, b: &Path) -> Ordering {
    let (a, b) = (a.to_string_lossy(), b.to_string_lossy());
    natural_bytes(a.as_bytes(), b.as_bytes()).then_with(|| a.cmp(&b))
}

fn natural_bytes(mut a: &[u8], mut b: &[u8]) -> Ordering {
    loop {
        let ((number_a, rest_a), (number_b, rest_b)) = (split_number(a), split_number(b));
        let order = match (number_a.is_empty(), number_b.is_empty()) {
            (false, false) => {
                let (x, y) = (strip_zeros(number_a), strip_zeros(number_b));
                (a, b) = (rest_a, rest_b);
                x.len().cmp(&y.len()).then_with(|| x.cmp(y))
            }
            _ => match (a.split_first(), b.split_first()) {
                (Some((x, rest_a)), Some((y, rest_b))) => {
                    (a, b) = (rest_a, rest_b);
                    x.cmp(y)
                }
                (x, y) => return x.is_some().cmp(&y.is_some()),
            },
        };
        if order.is_ne() {
            return order;
        }
    }
}

fn split_number(text: &[u8]) -> (&[u8], &[u8]) {
    text.split_at(text.iter().take_while(|c| c.is_ascii_digit()).count())
}

fn strip_zeros(digits: &[u8]) -> &[u8] {
    &digits[digits.iter().take_while(|&&c| c == b'0').count()..]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_as_people_do() {
        let ordered = [
            "",
            "1.jpg",
            "2.jpg",
            "10.jpg",
            "a",
            "a1b2",
            "a1b10",
            "a02",
            "a2",
            "a2b",
            "a10",
            "b",
            "b0",
            "b00",
            "b1",
            "b99999999999999999999999",
            "b100000000000000000000000",
            "img",
            "img2.png",
            "img2a",
            "img10.png",
        ];
        for pair in ordered.windows(2) {
            assert_eq!(
                natural(Path::new(pair[0]), Path::new(pair[1])),
                Ordering::Less,
                "{pair:?}"
            );
            assert_eq!(
                natural(Path::new(pair[1]), Path::new(pair[0])),
                Ordering::Greater,
                "{pair:?}"
            );
        }
    }

    #[test]
    fn knows_pictures_by_name() {
        for (name, expected) in [
            ("a.jpg", true),
            ("a.JPeG", true),
            ("b.Png", true),
            ("c.webp", true),
            ("d.txt", false),
            ("jpg", false),
        ] {
            assert_eq!(is_image(Path::new(name)), expected, "{name}");
        }
    }
}
