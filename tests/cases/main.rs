//! Situations that users met, one row each: inputs that are damaged or odd, and outputs that would
//! harm them. Every row asserts the right value: the exit code, the number of lines, the last box,
//! the words, and the files that must stay as they are.
//!
//! A report becomes one more row: `inputs.rs` for what is read, `outputs.rs` for what is written.
#![cfg(feature = "cli")]

#[path = "../program/mod.rs"]
mod program;

mod inputs;
mod outputs;
mod scene;

use std::path::{Path, PathBuf};

use program::{run_with, stderr};

/// One situation.
struct Case {
    name: &'static str,
    args: String, // split at blanks; the case's folder is the working folder
    make: Box<dyn Fn(&Path)>,
    stdin: Option<&'static str>, // a file of the folder
    expect: Expect,
}

/// What is right.
#[derive(Clone, Copy, Default)]
struct Expect {
    code: i32,
    lines: Option<usize>,
    last: Option<[f64; 4]>,             // near the box of the last line
    says: &'static [&'static str],      // on standard error
    prints: &'static [&'static str],    // on standard output
    unchanged: &'static [&'static str], // files that keep their bytes
    absent: &'static [&'static str],    // files that must not appear
    present: &'static [&'static str],   // files that must appear
}

/// How far each number of a box may be off, in pixels.
const NEAR_PX: f64 = 6.0;

impl Case {
    fn new(name: &'static str, args: &str, make: impl Fn(&Path) + 'static) -> Case {
        Case {
            name,
            args: args.into(),
            make: Box::new(make),
            stdin: None,
            expect: Expect::default(),
        }
    }

    /// What is right for this case.
    fn expect(self, expect: Expect) -> Case {
        Case { expect, ..self }
    }

    /// Runs the program; returns what is wrong with the outcome.
    fn verdict(&self, group: &str) -> Result<(), String> {
        let folder = program::folder(&format!("cases-{group}-{}", self.name.replace(' ', "-")));
        (self.make)(&folder);
        let before: Vec<_> = self
            .expect
            .unchanged
            .iter()
            .map(|f| read(&folder, f))
            .collect();

        let mut command = program::program(self.args.split_ascii_whitespace());
        command.current_dir(&folder);
        let output = match self.stdin {
            Some(file) => {
                let file = std::fs::File::open(folder.join(file)).map_err(|e| e.to_string())?;
                command.stdin(file).output().map_err(|e| e.to_string())?
            }
            None => run_with(&mut command, b""),
        };

        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let words = stderr(&output);
        let expect = &self.expect;
        if output.status.code() != Some(expect.code) {
            let found = output.status.code();
            return Err(format!("exit {found:?}, expected {}: {words}", expect.code));
        }
        let count = text.lines().count();
        if let Some(lines) = expect.lines.filter(|lines| *lines != count) {
            return Err(format!("{count} lines, expected {lines}: {words}"));
        }
        for part in expect.says {
            if !words.contains(part) {
                return Err(format!("expected {part:?} in: {words}"));
            }
        }
        for part in expect.prints {
            if !text.contains(part) {
                return Err(format!("expected {part:?} in: {text}"));
            }
        }
        if let Some(expected) = expect.last {
            let line = text.lines().last().unwrap_or_default();
            let found = scene::numbers(line);
            let is_near = |(a, b): (&f64, f64)| (a - b).abs() <= NEAR_PX;
            if found.len() != 4 || !found.iter().zip(expected).all(is_near) {
                return Err(format!("last box {line}, expected near {expected:?}"));
            }
        }
        for (file, before) in expect.unchanged.iter().zip(before) {
            if read(&folder, file) != before {
                return Err(format!("{file} has changed"));
            }
        }
        for file in expect.absent {
            if folder.join(file).exists() {
                return Err(format!("{file} was written"));
            }
        }
        for file in expect.present {
            if !folder.join(file).exists() {
                return Err(format!("{file} is missing"));
            }
        }
        let left = parts(&folder);
        if !left.is_empty() {
            return Err(format!("left behind: {left:?}"));
        }
        Ok(())
    }
}

/// A file's bytes; the names of a folder's files.
fn read(folder: &Path, name: &str) -> Vec<u8> {
    let path = folder.join(name);
    if path.is_dir() {
        let mut names: Vec<_> = std::fs::read_dir(path)
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        names.sort();
        return format!("{names:?}").into_bytes();
    }
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Half-written files anywhere below a folder.
fn parts(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(parts(&path));
        } else if path.to_string_lossy().contains(".part") {
            found.push(path);
        }
    }
    found
}

fn check(group: &str, cases: &[Case]) {
    let mut wrong = Vec::new();
    for case in cases {
        if let Err(why) = case.verdict(group) {
            wrong.push(format!("{}: {why}", case.name));
        }
    }
    let (count, all) = (wrong.len(), cases.len());
    assert!(
        wrong.is_empty(),
        "{count} of {all} cases:\n{}",
        wrong.join("\n")
    );
}

#[test]
fn odd_inputs_give_the_right_boxes_or_are_refused_by_name() {
    check("inputs", &inputs::cases());
}

#[test]
fn odd_videos_give_the_right_boxes_or_are_refused_by_name() {
    if !scene::has_ffmpeg() {
        println!("skipped: ffmpeg is not installed");
        return;
    }
    check("videos", &inputs::videos());
}

#[test]
fn outputs_never_destroy_an_input() {
    check("outputs", &outputs::cases());
}
