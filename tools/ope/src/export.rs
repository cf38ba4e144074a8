//! Results in the layouts that other toolkits read.

use crate::error::Error;
use crate::results::{Results, lines, write_whole};
use sequences::Dataset;
use std::fs;
use std::path::{Path, PathBuf};

/// A toolkit's layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// `results/<benchmark>/<tracker>/<sequence>.txt`, `times/<sequence>_time.txt`; of GOT-10k
    /// `<sequence>/<sequence>_001.txt`, `<sequence>/<sequence>_time.txt`.
    Got10k,
    /// `<tracker>/<sequence>.txt`.
    Pysot,
    /// `tracking_results/<tracker>/default_000/<sequence>.txt`, separated by tabs,
    /// `<sequence>_time.txt`.
    Pytracking,
    /// `<sequence>.txt`: left, top, width, height.
    Visdrone,
}

/// Writes all results below `out` and returns the number of sequences.
///
/// # Errors
/// If a file cannot be used, if there are no results, or if an output would replace one of them.
pub fn export(
    results: &Results,
    layout: Layout,
    dataset: Dataset,
    tracker: &str,
    out: &Path,
) -> Result<usize, Error> {
    let names = results.names()?;
    if names.is_empty() {
        return Err(Error::content(
            results.folder(),
            "results <sequence>.txt",
            "none",
        ));
    }
    // All outputs are checked before the first is written.
    for name in &names {
        let (boxes_file, _) = files(layout, dataset, tracker, name);
        let output = out.join(boxes_file);
        program::check_outputs(&[("--out", &output)], &[results.folder()])?;
    }
    for name in &names {
        let boxes = results.boxes(name)?.unwrap_or_default();
        let separator = if layout == Layout::Pytracking {
            "\t"
        } else {
            ","
        };
        let (boxes_file, times_file) = files(layout, dataset, tracker, name);
        write(&out.join(boxes_file), &lines(&boxes, separator))?;
        if let (Some(file), Some(times)) = (times_file, results.times(name)?) {
            let text: String = times.iter().map(|t| format!("{t:.8}\n")).collect();
            write(&out.join(file), &text)?;
        }
    }
    Ok(names.len())
}

/// The files for a sequence's boxes and times.
fn files(
    layout: Layout,
    dataset: Dataset,
    tracker: &str,
    sequence: &str,
) -> (PathBuf, Option<PathBuf>) {
    let boxes = format!("{sequence}.txt");
    let times = format!("{sequence}_time.txt");
    match layout {
        Layout::Got10k => {
            let folder = Path::new("results").join(dataset.name()).join(tracker);
            match dataset {
                Dataset::Got10k => {
                    let folder = folder.join(sequence);
                    (
                        folder.join(format!("{sequence}_001.txt")),
                        Some(folder.join(times)),
                    )
                }
                _ => (folder.join(boxes), Some(folder.join("times").join(times))),
            }
        }
        Layout::Pysot => (Path::new(tracker).join(boxes), None),
        Layout::Pytracking => {
            let folder = Path::new("tracking_results")
                .join(tracker)
                .join("default_000");
            (folder.join(boxes), Some(folder.join(times)))
        }
        Layout::Visdrone => (boxes.into(), None),
    }
}

fn write(path: &Path, text: &str) -> Result<(), Error> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).map_err(Error::unwritable(folder))?;
    }
    write_whole(path, text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::Folder;

    #[test]
    fn results_are_exported_in_every_layout() {
        let folder = Folder::new("export");
        folder.write("found/a.txt", "1,2,3,4\n5.5,6,7,8\n");
        folder.write("found/times/a_time.txt", "0.5\n0.25\n");
        let results = Results::open(&folder.path().join("found")).unwrap();
        let out = folder.path().join("out");
        let read = |file: &str| fs::read_to_string(out.join(file)).unwrap();
        let comma = "1.000,2.000,3.000,4.000\n5.500,6.000,7.000,8.000\n";
        for (layout, dataset, boxes, times) in [
            (
                Layout::Got10k,
                Dataset::Dtb70,
                "results/DTB70/me/a.txt",
                Some("results/DTB70/me/times/a_time.txt"),
            ),
            (
                Layout::Got10k,
                Dataset::Got10k,
                "results/GOT-10k/me/a/a_001.txt",
                Some("results/GOT-10k/me/a/a_time.txt"),
            ),
            (Layout::Pysot, Dataset::Dtb70, "me/a.txt", None),
            (
                Layout::Pytracking,
                Dataset::Dtb70,
                "tracking_results/me/default_000/a.txt",
                Some("tracking_results/me/default_000/a_time.txt"),
            ),
            (Layout::Visdrone, Dataset::Visdrone, "a.txt", None),
        ] {
            assert_eq!(export(&results, layout, dataset, "me", &out).unwrap(), 1);
            let expected = if layout == Layout::Pytracking {
                comma.replace(',', "\t")
            } else {
                comma.into()
            };
            assert_eq!(read(boxes), expected, "{layout:?}");
            assert!(
                times.is_none_or(|times| read(times) == "0.50000000\n0.25000000\n"),
                "{layout:?}"
            );
        }
        let own = export(
            &results,
            Layout::Visdrone,
            Dataset::Visdrone,
            "me",
            results.folder(),
        );
        assert!(own.unwrap_err().to_string().contains("nothing was written"));
        let read = fs::read_to_string(folder.join("found/a.txt")).unwrap();
        assert!(read.starts_with("1,2,3,4\n"), "{read}");
        let empty = Results::create(&folder.path().join("none")).unwrap();
        assert!(export(&empty, Layout::Pysot, Dataset::Dtb70, "me", &out).is_err());
    }
}
