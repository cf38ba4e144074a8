//! Annotation files: CSV with a header, or JSON objects with the same keys.
//!
//! `path` (or `file`), `x`, `y`, `w`, `h` are needed; `track`, `frame` and `source` (or `label`)
//! say what belongs together. Rows that cannot be used are skipped, each by name.

use super::skipped::Skipped;
use crate::error::Error;
use ::sequences::{Rect, text};
use serde_json::Value;
use std::collections::HashMap;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use track_cpu::BBox;

/// One usable row.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The picture file; it exists.
    pub path: PathBuf,
    /// The target's box in pixels of the picture.
    pub bbox: BBox,
    /// What the rows of one target have in common; `None` if each row is a target of its own.
    pub track: Option<String>,
    /// Number of the frame within its track.
    pub frame: u32,
    /// What the row is of: data set, label.
    pub group: String,
}

/// Most bytes of an annotation file that are read.
const MAX_BYTES: u64 = 1 << 30;

/// Reads the rows of an annotation file, in the order of the file.
///
/// # Errors
/// If the file cannot be read, or lacks a column that every row needs.
pub fn read(file: &Path, skipped: &mut Skipped) -> Result<Vec<Row>, Error> {
    let json = file
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    let raw = if json {
        read_json(file, skipped)?
    } else {
        read_csv(file, skipped)?
    };
    let root = root(file, &raw);
    let mut sizes = HashMap::new();
    let mut rows = Vec::with_capacity(raw.len());
    for (place, fields) in raw {
        match row(&root, &fields).and_then(|row| inside(row, &mut sizes)) {
            Ok(row) => rows.push(row),
            Err(reason) => skipped.add(format!("{}:{place}", file.display()), reason),
        }
    }
    Ok(rows)
}

/// Width and height of pictures by path; `None` for a picture that cannot be read.
type Sizes = HashMap<PathBuf, Option<(u32, u32)>>;

/// The row, if its box shares an area with its picture. A picture that cannot be read is reported
/// where it is used.
fn inside(row: Row, sizes: &mut Sizes) -> Result<Row, String> {
    let size = match sizes.get(&row.path) {
        Some(size) => *size,
        None => {
            let size = image::image_dimensions(&row.path).ok();
            sizes.insert(row.path.clone(), size);
            size
        }
    };
    let BBox { x, y, w, h } = row.bbox;
    match size {
        Some((width, height))
            if !Rect::from([x, y, w, h]).is_in_picture(width.into(), height.into()) =>
        {
            Err(format!(
                "box at {x},{y} lies outside its picture of {width} x {height} pixels"
            ))
        }
        _ => Ok(row),
    }
}

/// A row's text by column.
type Fields = HashMap<String, String>;

/// A row and the place it was found at: a line, or the number of an object.
type Placed = (u64, Fields);

fn read_csv(file: &Path, skipped: &mut Skipped) -> Result<Vec<Placed>, Error> {
    let text = read_text(file)?;
    let delimiter = delimiter(&text);
    let mut reader = csv::ReaderBuilder::new()
        .flexible(true)
        .trim(csv::Trim::All)
        .delimiter(delimiter)
        .from_reader(text.as_bytes());
    let header = reader
        .headers()
        .map_err(|error| Error::file(file, "a CSV header", error))?
        .clone();
    let has = |names: &[&str]| {
        names
            .iter()
            .any(|name| header.iter().any(|column| column == *name))
    };
    for names in [&["path", "file"][..], &["x"], &["y"], &["w"], &["h"]] {
        if !has(names) {
            let found = header.iter().collect::<Vec<_>>().join(",");
            return Err(Error::file(
                file,
                format!("a header with a column {:?}", names[0]),
                found,
            ));
        }
    }
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = match record {
            Ok(record) => record,
            Err(error) if error.is_io_error() => {
                return Err(Error::file(file, "a readable file", error));
            }
            Err(error) => {
                let line = error.position().map_or(0, csv::Position::line);
                skipped.add(format!("{}:{line}", file.display()), error.to_string());
                continue;
            }
        };
        let line = record.position().map_or(0, csv::Position::line);
        if record.len() != header.len() {
            let reason = format!("{} columns, expected {}", record.len(), header.len());
            skipped.add(format!("{}:{line}", file.display()), reason);
            continue;
        }
        let fields = header
            .iter()
            .zip(&record)
            .map(|(name, value)| (name.into(), value.into()));
        rows.push((line, fields.collect()));
    }
    Ok(rows)
}

/// The text of a file, whatever Unicode encoding its byte order mark names.
fn read_text(file: &Path) -> Result<String, Error> {
    let mut bytes = Vec::new();
    let handle = File::open(file).map_err(Error::io(file))?;
    let mut limited = handle.take(MAX_BYTES);
    limited.read_to_end(&mut bytes).map_err(Error::io(file))?;
    Ok(text::decode(&bytes))
}

/// The character between columns, told by the header: spreadsheets write semicolons or tabs where
/// the decimal separator is a comma.
fn delimiter(text: &str) -> u8 {
    let header = text.lines().next().unwrap_or_default();
    let is_in_header = |delimiter: &&u8| header.contains(char::from(**delimiter));
    *[b',', b';', b'\t']
        .iter()
        .find(is_in_header)
        .unwrap_or(&b',')
}

fn read_json(file: &Path, skipped: &mut Skipped) -> Result<Vec<Placed>, Error> {
    let text = read_text(file)?;
    let value: Value = serde_json::from_str(&text)
        .map_err(|error| Error::file(file, "a JSON array of objects", error))?;
    let Value::Array(objects) = value else {
        return Err(Error::file(
            file,
            "a JSON array of objects",
            "something else",
        ));
    };
    let mut rows = Vec::new();
    for (number, object) in objects.into_iter().enumerate() {
        let number = number as u64;
        let Value::Object(object) = object else {
            skipped.add(
                format!("{}:{number}", file.display()),
                "not an object".into(),
            );
            continue;
        };
        let text = |value: Value| match value {
            Value::String(text) => text,
            other => other.to_string(),
        };
        rows.push((
            number,
            object
                .into_iter()
                .map(|(name, value)| (name, text(value)))
                .collect(),
        ));
    }
    Ok(rows)
}

/// Where the paths of a file start: beside it, in its folder `images`, or one folder up; wherever
/// most of the first rows' files are.
fn root(file: &Path, rows: &[Placed]) -> PathBuf {
    let folder = file.parent().unwrap_or(Path::new("")).to_path_buf();
    let up = folder.join("..");
    let found = |root: &Path| {
        let files = rows.iter().take(100).filter_map(|(_, fields)| name(fields));
        files.filter(|name| root.join(name).is_file()).count()
    };
    let others = [folder.join("images"), up];
    let mut best = (found(&folder), folder);
    for other in others {
        let count = found(&other);
        if count > best.0 {
            best = (count, other);
        }
    }
    best.1
}

fn name(fields: &Fields) -> Option<&String> {
    fields.get("path").or_else(|| fields.get("file"))
}

fn row(root: &Path, fields: &Fields) -> Result<Row, String> {
    let number = |key: &str| {
        let text = fields.get(key).ok_or(format!("no {key:?}"))?;
        // Only a field of a file with other delimiters can hold a comma: a decimal one.
        let value: f32 = text
            .replace(',', ".")
            .parse()
            .map_err(|_| format!("{key} is {text:?}, expected a number"))?;
        if value.is_finite() {
            Ok(value)
        } else {
            Err(format!("{key} is {value}, expected a finite number"))
        }
    };
    let bbox = BBox::new(number("x")?, number("y")?, number("w")?, number("h")?);
    if bbox.w <= 0.0 || bbox.h <= 0.0 {
        return Err(format!(
            "box of {} x {} pixels, expected both above 0",
            bbox.w, bbox.h
        ));
    }
    let path = root.join(name(fields).ok_or("no \"path\"")?);
    if !path.is_file() {
        return Err(format!("picture {} is missing", path.display()));
    }
    let frame = match fields.get("frame") {
        Some(text) => text
            .parse()
            .map_err(|_| format!("frame is {text:?}, expected a number"))?,
        None => 0,
    };
    let group = fields
        .get("source")
        .or_else(|| fields.get("label"))
        .cloned()
        .unwrap_or_default();
    Ok(Row {
        path,
        bbox,
        track: fields.get("track").cloned(),
        frame,
        group,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Folder;

    fn folder() -> Folder {
        let folder = Folder::new("rows");
        folder.write("images/a.png", "");
        folder.write("images/b.png", "");
        let picture = image::RgbImage::new(160, 120);
        picture.save(folder.join("images/c.png")).unwrap();
        folder
    }

    const BAD: &str = "path,x,y,w,h,track,frame,source\n\
        a.png,1,2,30.5,4,t,7,s\n\
        missing.png,1,2,3,4,t,8,s\n\
        a.png,NaN,2,3,4,t,9,s\n\
        a.png,1,2,0,4,t,10,s\n\
        a.png,1,2,3\n\
        a.png,1,2,x,4,t,11,s\n\
        a.png,1,2,3,4,t,-1,s\n\
        c.png,900,900,24,18,t,12,s\n\
        c.png,-24,10,24,18,t,13,s\n\
        b.png,0,0,1,1,u,0,s\n";

    #[test]
    fn unusable_row_is_skipped_by_line() {
        let folder = folder();
        let file = folder.write("index.csv", BAD);
        let mut skipped = Skipped::default();

        let rows = read(&file, &mut skipped).unwrap();

        assert_eq!(rows.len(), 2);
        assert_eq!(rows[0].bbox, BBox::new(1.0, 2.0, 30.5, 4.0));
        assert_eq!(rows[0].track.as_deref(), Some("t"));
        assert_eq!((rows[0].frame, &rows[0].group[..]), (7, "s"));
        let text = skipped.to_string();
        let reasons = [
            (3, "missing.png is missing"),
            (4, "x is NaN"),
            (5, "box of 0 x 4"),
            (6, "4 columns, expected 8"),
            (7, "w is \"x\""),
            (8, "frame is \"-1\""),
            (
                9,
                "box at 900,900 lies outside its picture of 160 x 120 pixels",
            ),
            (10, "box at -24,10 lies outside"),
        ];
        for (line, reason) in reasons {
            let place = format!("index.csv:{line}: ");
            let is_said = |said: &str| said.contains(&place) && said.contains(reason);
            assert!(text.lines().any(is_said), "{place}{reason} not in {text}");
        }
        assert_eq!(skipped.count(), reasons.len());
    }

    #[test]
    fn csv_in_every_spelling_is_read_alike() {
        let utf16 = |text: &str| {
            let units = text.encode_utf16().flat_map(u16::to_le_bytes);
            [0xff, 0xfe].into_iter().chain(units).collect::<Vec<u8>>()
        };
        let cases: [(&str, Vec<u8>); 6] = [
            ("commas", b"path,x,y,w,h\na.png,1,2,30.5,4\n".to_vec()),
            (
                "mark",
                b"\xef\xbb\xbfpath,x,y,w,h\r\na.png,1,2,30.5,4\r\n".to_vec(),
            ),
            ("CR", b"path,x,y,w,h\ra.png,1,2,30.5,4\r".to_vec()),
            ("semicolons", b"path;x;y;w;h\na.png;1;2;30,5;4\n".to_vec()),
            ("tabs", b"path\tx\ty\tw\th\na.png\t1\t2\t30,5\t4\n".to_vec()),
            ("UTF-16", utf16("path,x,y,w,h\na.png,1,2,30.5,4\n")),
        ];
        for (what, bytes) in cases {
            let folder = folder();
            let file = folder.write("index.csv", bytes);
            let mut skipped = Skipped::default();

            let rows = read(&file, &mut skipped).unwrap();

            assert_eq!((rows.len(), skipped.count()), (1, 0), "{what}: {skipped}");
            assert_eq!(rows[0].bbox, BBox::new(1.0, 2.0, 30.5, 4.0), "{what}");
        }
    }

    #[test]
    fn json_objects_are_read_like_rows() {
        let folder = folder();
        let text = r#"[{"file": "a.png", "x": 1, "y": 2, "w": 30.5, "h": 4, "label": "l"},
            {"file": "b.png", "x": null}, 5]"#;
        let file = folder.write("index.json", text);
        let mut skipped = Skipped::default();

        let rows = read(&file, &mut skipped).unwrap();

        assert_eq!((rows.len(), skipped.count()), (1, 2));
        assert_eq!((rows[0].bbox.w, &rows[0].group[..]), (30.5, "l"));
        assert_eq!(rows[0].track, None);
    }

    #[test]
    fn file_without_a_needed_column_is_refused() {
        let cases = [
            ("a.csv", "path,x,y,w\n", "column \"h\""),
            ("a.json", "{}", "array of objects"),
        ];
        for (name, text, expected) in cases {
            let folder = folder();
            let file = folder.write(name, text);

            let error = read(&file, &mut Skipped::default()).unwrap_err();

            assert!(error.to_string().contains(expected), "{error}");
        }
        assert!(read(Path::new("none.csv"), &mut Skipped::default()).is_err());
    }
}
