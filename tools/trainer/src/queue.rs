//! Training runs one after another, from a list in a text file.
//!
//! Each line names a run and gives the options of `train fit`; `#` begins a comment and `\` at the
//! end of a line continues it. The runs of a list lie beside each other in one folder. `@NAME` in
//! an option stands for the end of an earlier run of the list.

use crate::error::Error;
use crate::fit::{Budget, Fit};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// A run of the list.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Name of the run and of its folder.
    pub name: String,
    /// Folder of its results.
    pub folder: PathBuf,
    /// Options of `train fit` but for `--out`.
    pub options: Vec<String>,
}

/// How far a run has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// Nothing was saved yet.
    Waiting,
    /// A checkpoint was saved.
    Begun,
    /// The run is over.
    Finished,
}

impl Entry {
    /// How far the run has come, by the files in its folder.
    pub fn state(&self) -> State {
        if self.folder.join("final.safetensors").exists() {
            State::Finished
        } else if self.checkpoint().exists() {
            State::Begun
        } else {
            State::Waiting
        }
    }

    /// Checkpoint from which the run continues.
    pub fn checkpoint(&self) -> PathBuf {
        self.folder.join("checkpoint.safetensors")
    }
}

/// Reads a list of runs whose results lie in `folder`.
///
/// # Errors
/// If the file cannot be read, or a line has no name that can name a folder, or the name of an
/// earlier line, or `@` before a name that no earlier line has.
pub fn read(file: &Path, folder: &Path) -> Result<Vec<Entry>, Error> {
    let text = fs::read_to_string(file).map_err(Error::io(file))?;
    let mut entries = Vec::new();
    let mut names = BTreeSet::new();
    for line in text.replace("\\\n", " ").lines() {
        let mut words = line
            .split('#')
            .next()
            .unwrap_or_default()
            .split_whitespace();
        let Some(name) = words.next() else { continue };
        let valid = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
        if !name.chars().all(valid) || name.starts_with(['-', '.']) {
            let expected = "a name of letters, digits, -, _ and . at the beginning of each line";
            return Err(Error::file(file, expected, name));
        }
        let mut options = Vec::new();
        for word in words {
            options.push(match word.strip_prefix('@') {
                None => word.to_owned(),
                Some(earlier) if names.contains(earlier) => {
                    let end = folder.join(earlier).join("final.safetensors");
                    end.display().to_string()
                }
                Some(_) => {
                    return Err(Error::file(
                        file,
                        "the name of an earlier run after @",
                        word,
                    ));
                }
            });
        }
        if !names.insert(name.to_owned()) {
            return Err(Error::file(file, "a different name for each run", name));
        }
        entries.push(Entry {
            name: name.to_owned(),
            folder: folder.join(name),
            options,
        });
    }
    Ok(entries)
}

/// A table of what each run has done: pairs, hours, hours left, losses and the best validation.
///
/// Runs whose checkpoint cannot be read are named with the reason.
pub fn table(entries: &[Entry]) -> String {
    let mut text = format!(
        "{:16} {:9} {:>10} {:>7} {:>8} {:>7}  losses and validation\n",
        "run", "state", "pairs", "hours", "pairs/s", "left h"
    );
    for entry in entries {
        let state = match entry.state() {
            State::Waiting => "waiting",
            State::Begun => "begun",
            State::Finished => "finished",
        };
        let _ = write!(text, "{:16} {state:9} ", entry.name); // writing to a string cannot fail
        if entry.state() != State::Waiting {
            match standing(entry) {
                Ok(standing) => text += &standing,
                Err(error) => text += &error.to_string(),
            }
        }
        text = text.trim_end().to_owned();
        text.push('\n');
    }
    text
}

/// The columns of a run that has a checkpoint.
fn standing(entry: &Entry) -> Result<String, Error> {
    let fit = Fit::resume(&entry.checkpoint())?;
    let position = fit.position();
    let batch = position.options.batch as f64;
    let log = fs::read_to_string(entry.folder.join("log.jsonl")).unwrap_or_default();
    let log: Vec<Value> = log
        .lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect();
    let last = |key: &str| log.iter().rev().find_map(|line| line.get(key));
    // The log is ahead of the checkpoint while the run is under way.
    let number = |key: &str| last(key).and_then(Value::as_f64);
    let saved = position.step as f64 * batch;
    let pairs = number("pairs").unwrap_or(saved).max(saved);
    let seconds = number("seconds").unwrap_or(0.0).max(position.seconds);
    let speed = pairs / seconds.max(1e-9);
    let left = match position.options.budget {
        _ if entry.state() == State::Finished => 0.0,
        Budget::Minutes(minutes) => (60.0 * minutes - seconds).max(0.0),
        Budget::Steps(steps) => (steps as f64 * batch - pairs).max(0.0) / speed.max(1e-9),
    };
    let mut text = format!(
        "{pairs:10.0} {:7.2} {speed:8.1} {:7.2} ",
        seconds / 3600.0,
        left / 3600.0
    );
    if let Some(losses) = last("losses").and_then(Value::as_object) {
        for (name, value) in losses {
            if let Some(value) = value.as_f64().filter(|value| *value != 0.0) {
                let _ = write!(text, " {name} {value:.3}");
            }
        }
    }
    if let Some((score, step)) = position.best {
        let _ = write!(text, " best {score:.3} at step {step}");
    }
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::DataOptions;
    use crate::fit::{FitOptions, standard};
    use crate::testing::Folder;

    fn list(folder: &Folder, text: &str) -> Result<Vec<Entry>, Error> {
        let file = folder.path().join("list");
        fs::write(&file, text).unwrap();
        read(&file, Path::new("out"))
    }

    #[test]
    fn list_with_comments_and_references_is_read() {
        let folder = Folder::new("queue");
        let text = "# two runs\n\na --pairs 100 \\\n  --seed 1 # short\nb --init @a --seed 2\n";

        let entries = list(&folder, text).unwrap();

        let expected = [
            ("a", vec!["--pairs", "100", "--seed", "1"]),
            (
                "b",
                vec!["--init", "out/a/final.safetensors", "--seed", "2"],
            ),
        ];
        assert_eq!(entries.len(), expected.len());
        for (entry, (name, options)) in entries.iter().zip(expected) {
            assert_eq!(entry.name, name);
            assert_eq!(entry.options, options);
            assert_eq!(entry.folder, Path::new("out").join(name));
            assert_eq!(entry.state(), State::Waiting);
        }
    }

    #[test]
    fn wrong_lines_are_refused() {
        let folder = Folder::new("queue");
        for (text, message) in [
            ("--pairs 100", "a name of letters"),
            ("a/b --pairs 1", "a name of letters"),
            (".. --pairs 1", "a name of letters"),
            ("a\na", "a different name"),
            ("a --init @b\nb", "the name of an earlier run"),
        ] {
            let error = list(&folder, text).unwrap_err().to_string();
            assert!(error.contains(message), "{text:?} says {error:?}");
        }
    }

    #[test]
    fn table_tells_pairs_and_time_left() {
        let folder = Folder::new("queue");
        let entries: Vec<_> = ["begun", "waiting", "broken"]
            .map(|name| Entry {
                name: name.into(),
                folder: folder.path().join(name),
                options: Vec::new(),
            })
            .into();
        for entry in [&entries[0], &entries[2]] {
            fs::create_dir_all(&entry.folder).unwrap();
            fs::write(entry.checkpoint(), "nonsense").unwrap();
        }
        let options = FitOptions {
            architecture: standard(0.9),
            budget: Budget::Steps(100),
            batch: 4,
            ..FitOptions::cpu()
        };
        let fit = Fit::start(options, Vec::new(), DataOptions::default()).unwrap();
        fit.save(&entries[0].checkpoint()).unwrap();
        let log = r#"{"step":25,"pairs":100,"seconds":7200.0,"losses":{"iou":0.5,"local":0.0}}"#;
        fs::write(entries[0].folder.join("log.jsonl"), log).unwrap();

        let text = table(&entries);

        let lines: Vec<Vec<&str>> = text
            .lines()
            .map(|l| l.split_whitespace().collect())
            .collect();
        assert_eq!(
            lines[1],
            [
                "begun", "begun", "100", "2.00", "0.0", "6.00", "iou", "0.500"
            ]
        );
        assert_eq!(lines[2], ["waiting", "waiting"]);
        assert!(text.contains("a training checkpoint"), "{text}");
    }
}
