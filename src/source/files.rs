//! Which files of a folder or pattern are frames, and in which order.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

use super::SourceError;

/// Extensions of pictures.
const IMAGES: [&str; 7] = ["jpg", "jpeg", "png", "webp", "bmp", "pgm", "ppm"];
/// The kinds from the likeliest frames to the likeliest masks, which decides between equally many.
const FRAMES_FIRST: [&str; 6] = ["jpg", "webp", "bmp", "ppm", "pgm", "png"];

/// The frames of a folder or pattern.
pub(super) struct Found {
    /// Their files, in natural order.
    pub(super) files: Vec<PathBuf>,
    /// What a user should know about the choice.
    pub(super) note: Option<String>,
}

/// Whether a file's name says that it is a picture.
pub(super) fn is_image(path: &Path) -> bool {
    has_extension(path, &IMAGES)
}

/// Whether a file's name ends in one of these extensions, in upper or lower case.
pub(super) fn has_extension(path: &Path, extensions: &[&str]) -> bool {
    path.extension()
        .is_some_and(|found| extensions.iter().any(|e| found.eq_ignore_ascii_case(e)))
}

/// Whether readers of folders pass over this file or folder: names that begin with a dot, such as
/// the `._1.jpg` of macOS, and whatever is in a `__MACOSX` folder.
pub fn is_passed_over(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default();
    name.as_encoded_bytes().starts_with(b".")
        || path.components().any(|part| part.as_os_str() == "__MACOSX")
}

/// Whether a location that does not exist is meant as a glob pattern.
pub(super) fn is_pattern(location: &str) -> bool {
    location.contains(['*', '?', '['])
}

/// A local file as ffmpeg wants it: without this, a name with a colon would be taken for a
/// protocol.
pub(super) fn file_url(path: &Path) -> OsString {
    let mut url = OsString::from("file:");
    url.push(path);
    url
}

/// The pictures directly inside a folder, in natural order.
pub(super) fn in_folder(folder: &Path) -> Result<Found, SourceError> {
    let io = |error| SourceError::Io {
        path: folder.to_path_buf(),
        error,
    };
    let mut files = Vec::new();
    let mut others = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        // The folder was named by the user: only names inside it are passed over.
        if is_passed_over(Path::new(path.file_name().unwrap_or_default())) {
            continue;
        }
        if is_image(&path) && !path.is_dir() {
            files.push(path);
        } else {
            others.push(path);
        }
    }
    if files.is_empty() {
        return Err(nothing(folder.display().to_string(), &hint(&others)));
    }
    Ok(ordered(&folder.display().to_string(), files))
}

/// The pictures that a glob pattern matches, in natural order.
pub(super) fn matching(pattern: &str) -> Result<Found, SourceError> {
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
        if is_image(&path) && !is_passed_over(&path) && !path.is_dir() {
            files.push(path);
        }
    }
    if files.is_empty() {
        return Err(nothing(pattern.into(), ""));
    }
    Ok(ordered(pattern, files))
}

fn nothing(input: String, hint: &str) -> SourceError {
    SourceError::Empty {
        input,
        reason: format!(
            "expected pictures ({}), found none{hint}",
            IMAGES.join(", ")
        ),
    }
}

/// What else there is in a folder without pictures.
fn hint(others: &[PathBuf]) -> String {
    let mut names: Vec<&PathBuf> = others.iter().collect();
    names.sort();
    let meant = names
        .iter()
        .find(|path| path.is_dir() && path.ends_with("img"))
        .or_else(|| names.iter().find(|path| path.is_dir()))
        .or_else(|| {
            let videos = ["mp4", "mov", "avi", "mkv", "webm", "y4m", "gif"];
            names.iter().find(|path| has_extension(path, &videos))
        });
    if let Some(path) = meant {
        return format!("; did you mean {}?", path.display());
    }
    match names.iter().find_map(|path| path.extension()) {
        Some(extension) => format!(", but files of .{}", extension.to_string_lossy()),
        None => String::new(),
    }
}

/// Puts files in natural order, without masks. Where names occur with two extensions, as those of
/// pictures and their masks do, only one kind is taken.
fn ordered(input: &str, mut files: Vec<PathBuf>) -> Found {
    files.sort_by(|a, b| natural(a, b));
    let (masks, frames): (Vec<_>, Vec<_>) = files.iter().cloned().partition(|path| is_mask(path));
    if !masks.is_empty() && masks.len() <= frames.len() {
        let count = masks.len();
        let note = format!("{input}: {count} files with mask in their name are left out");
        return Found {
            files: frames,
            note: Some(note),
        };
    }
    let mut kinds: BTreeMap<String, usize> = BTreeMap::new();
    let mut names: BTreeMap<PathBuf, BTreeSet<String>> = BTreeMap::new();
    for path in &files {
        *kinds.entry(kind(path)).or_default() += 1;
        let name = path.with_extension("");
        names.entry(name).or_default().insert(kind(path));
    }
    if kinds.len() < 2 {
        let note = doubled(&files).map(|(one, other)| {
            format!("{input}: {one} and {other} share a name; all such files are taken as frames")
        });
        return Found { files, note };
    }

    let list: Vec<String> = kinds
        .iter()
        .map(|(kind, n)| format!("{n} .{kind}"))
        .collect();
    let list = list.join(" and ");
    if names.values().all(|kinds| kinds.len() == 1) {
        let note = format!("{input}: {list} files are taken as frames of one sequence");
        return Found {
            files,
            note: Some(note),
        };
    }
    let rank = |kind: &str| FRAMES_FIRST.iter().position(|known| *known == kind);
    let Some((taken, _)) = kinds
        .iter()
        .max_by_key(|(kind, count)| (**count, std::cmp::Reverse(rank(kind))))
    else {
        return Found { files, note: None };
    };
    files.retain(|path| kind(path) == *taken);
    let note = format!("{input}: {list} files share names; only the .{taken} files are taken");
    Found {
        files,
        note: Some(note),
    }
}

/// Two files of one kind whose names differ in the extension alone, such as 1.jpg and 1.JPEG.
fn doubled(files: &[PathBuf]) -> Option<(String, String)> {
    let mut seen = BTreeMap::new();
    for path in files {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if let Some(earlier) = seen.insert(path.with_extension(""), name.clone()) {
            return Some((earlier.into_owned(), name.into_owned()));
        }
    }
    None
}

/// Whether a file's name says that it is a mask.
fn is_mask(path: &Path) -> bool {
    let stem = path.file_stem().unwrap_or_default();
    stem.to_string_lossy().to_ascii_lowercase().contains("mask")
}

/// The extension in lower case; `jpeg` is `jpg`.
fn kind(path: &Path) -> String {
    let extension = path.extension().unwrap_or(OsStr::new(""));
    let kind = extension.to_string_lossy().to_ascii_lowercase();
    if kind == "jpeg" { "jpg".into() } else { kind }
}

/// Orders names as people count: digits as numbers, so that `img2` comes before `img10`.
fn natural(a: &Path, b: &Path) -> Ordering {
    let a = a.to_string_lossy();
    let b = b.to_string_lossy();
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
    fn names_with_numbers_are_ordered_as_people_count() {
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
    fn pictures_are_known_by_their_extension_in_any_case() {
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

    #[test]
    fn hidden_and_macos_files_are_passed_over() {
        for (path, expected) in [
            ("seq/1.jpg", false),
            ("seq/._1.jpg", true),
            ("seq/.hidden.png", true),
            ("__MACOSX/seq/1.jpg", true),
            ("../seq/1.jpg", false),
            (".hidden/1.jpg", false), // a folder that the user names
        ] {
            assert_eq!(is_passed_over(Path::new(path)), expected, "{path}");
        }
    }

    #[test]
    fn names_with_two_extensions_leave_one_kind() {
        let cases: [(&[&str], &[&str], &str); 9] = [
            (&["1.jpg", "2.jpg"], &["1.jpg", "2.jpg"], ""),
            (&["1.jpg", "2.JPEG"], &["1.jpg", "2.JPEG"], ""),
            (
                &["1.JPG", "1.jpg"],
                &["1.JPG", "1.jpg"],
                "1.JPG and 1.jpg share a name",
            ),
            (
                &["1.jpg", "1.png", "2.jpg", "2.png"],
                &["1.jpg", "2.jpg"],
                "only the .jpg",
            ),
            (
                &["1.jpg", "1_mask.png", "2.jpg", "2_mask.png"],
                &["1.jpg", "2.jpg"],
                "2 files with mask in their name",
            ),
            (&["Mask1.jpg", "Mask2.jpg"], &["Mask1.jpg", "Mask2.jpg"], ""),
            (
                &["1.png", "1.bmp", "2.png", "2.bmp"],
                &["1.bmp", "2.bmp"],
                "only the .bmp",
            ),
            (
                &["1.png", "2.png", "2.jpg", "3.png"],
                &["1.png", "2.png", "3.png"],
                "only the .png",
            ),
            (
                &["1.jpg", "2.png"],
                &["1.jpg", "2.png"],
                "1 .jpg and 1 .png files are taken",
            ),
        ];
        for (files, expected, part) in cases {
            let found = ordered("seq", files.iter().map(PathBuf::from).collect());

            let expected: Vec<PathBuf> = expected.iter().map(PathBuf::from).collect();
            assert_eq!(found.files, expected, "{files:?}");
            let note = found.note.unwrap_or_default();
            assert!(
                note.contains(part) && note.is_empty() == part.is_empty(),
                "{note}"
            );
        }
    }
}
