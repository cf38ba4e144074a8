//! Runs a tracker over a benchmark, several sequences at a time, and resumes an interrupted run.
//!
//! A sequence's file of boxes appears under its name only when it is whole, and its times before
//! it. A sequence with a whole file is not run again. The boxes do not depend on the number of
//! sequences that run at a time, on shards or on interruptions.

mod builtin;
mod command;
mod merge;
mod session;

pub use command::CommandLine;
pub use merge::merge;

use crate::error::Error;
use crate::results::Results;
use sequences::error::brief;
use sequences::{Rect, Sequence};
use std::num::NonZeroUsize;
use std::path::Path;
use std::str::FromStr;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;
use std::time::Duration;
use track_cpu::Model;
use track_cpu::source::OnBadFrame;

/// The tracker that is run.
#[derive(Clone, Debug)]
pub enum Runner {
    /// This repository's tracker, one thread per sequence, and how it treats unreadable frames.
    Builtin(Model, OnBadFrame),
    /// Another program.
    Program(Program),
}

/// Another program and how to use it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Program {
    /// How it is started.
    pub line: CommandLine,
    /// How frames are passed to it.
    pub protocol: Protocol,
    /// Longest time for one frame.
    pub timeout: Duration,
}

/// How frames are passed to a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Protocol {
    /// All at once, by its command line.
    Files,
    /// One at a time, by the TraX protocol. The program is restarted for each sequence.
    Trax,
}

impl Program {
    /// Default of the longest time for one frame.
    pub const TIMEOUT: Duration = Duration::from_secs(60);

    /// A program from `COMMAND` or `trax:COMMAND`.
    ///
    /// # Errors
    /// As of [`CommandLine::parse`].
    pub fn parse(text: &str) -> Result<Program, String> {
        let (protocol, line) = match text.strip_prefix("trax:") {
            Some(line) => (Protocol::Trax, line),
            None => (Protocol::Files, text),
        };
        Ok(Program {
            line: CommandLine::parse(line)?,
            protocol,
            timeout: Program::TIMEOUT,
        })
    }

    fn track(&self, sequence: &Sequence, first: Rect, folder: &Path) -> Result<Outcome, Error> {
        match self.protocol {
            Protocol::Files => self.line.track(self.timeout, sequence, first, folder),
            Protocol::Trax => session::track(&self.line, self.timeout, sequence, first),
        }
    }
}

/// What a tracker found in one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// One box per frame, the first being the one given.
    pub boxes: Vec<Rect>,
    /// Seconds per frame, reading pictures excluded; empty if not known.
    pub seconds: Vec<f64>,
    /// Frames that could not be read. Their boxes are that of the frame before.
    pub held: usize,
}

/// One of several equal parts of a benchmark, counted from 1: `2/4`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    index: usize,
    count: usize,
}

impl Shard {
    /// All of the benchmark.
    pub const ALL: Shard = Shard { index: 1, count: 1 };

    /// Whether the sequence at `place` in the order of names is in it.
    pub fn holds(self, place: usize) -> bool {
        place % self.count == self.index - 1
    }

    /// How many of `sequences` sequences are in it.
    pub fn len(self, sequences: usize) -> usize {
        (0..sequences).filter(|place| self.holds(*place)).count()
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Shard, String> {
        let parse = || {
            let (index, count) = text.split_once('/')?;
            Some(Shard {
                index: index.parse().ok()?,
                count: count.parse().ok()?,
            })
        };
        let valid = |shard: &Shard| (1..=shard.count).contains(&shard.index);
        parse()
            .filter(valid)
            .ok_or_else(|| format!("expected i/n with i from 1 to n, found {text:?}"))
    }
}

/// Runs over the sequences of a shard that have no results in `folder` yet, and returns their
/// number.
///
/// `jobs` sequences run at a time; `progress` gets a line about each.
///
/// # Errors
/// If the folder cannot be written. If a sequence fails: the others still run, and `progress` gets
/// each failure. If a box was held over an unreadable frame: all sequences are complete.
pub fn run(
    sequences: &[Sequence],
    shard: Shard,
    runner: &Runner,
    folder: &Path,
    jobs: NonZeroUsize,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<usize, Error> {
    let results = Results::create(folder)?;
    let mine = sequences
        .iter()
        .enumerate()
        .filter(|(place, _)| shard.holds(*place))
        .map(|(_, s)| s);
    let todo: Vec<&Sequence> = mine
        .filter(|s| !results.is_whole(&s.annotation.name, s.frames.len()))
        .collect();
    let next = AtomicUsize::new(0);
    let failed = AtomicUsize::new(0);
    let held = AtomicUsize::new(0);
    let work = || {
        while let Some(sequence) = todo.get(next.fetch_add(1, Ordering::Relaxed)) {
            let name = &sequence.annotation.name;
            let done = runner.track(sequence, folder).and_then(|outcome| {
                results.write(name, &outcome.boxes, &outcome.seconds)?;
                Ok(outcome)
            });
            match done {
                Ok(outcome) => {
                    held.fetch_add(outcome.held, Ordering::Relaxed);
                    progress(&describe(name, &outcome));
                }
                Err(error) => {
                    failed.fetch_add(1, Ordering::Relaxed);
                    progress(&format!("{name}: failed: {error}"));
                }
            }
        }
    };
    thread::scope(|scope| {
        for _ in 0..jobs.get().min(todo.len()) {
            scope.spawn(work);
        }
    });
    match (failed.into_inner(), held.into_inner()) {
        (0, 0) => Ok(todo.len()),
        (0, held) => Err(Error::BadFrames { held }),
        (failed, _) => Err(Error::Failed {
            failed,
            of: todo.len(),
        }),
    }
}

/// The line about a sequence that has been run.
fn describe(name: &str, outcome: &Outcome) -> String {
    let seconds: f64 = outcome.seconds.iter().sum();
    let frames = outcome.boxes.len();
    let mut text = format!("{name}: {frames} frames");
    if seconds > 0.0 {
        text += &format!(", {:.1} FPS", frames as f64 / seconds);
    }
    if outcome.held > 0 {
        text += &format!(", {} of them could not be read and were held", outcome.held);
    }
    text
}

impl Runner {
    /// Tracks one sequence from its first annotated box on.
    fn track(&self, sequence: &Sequence, folder: &Path) -> Result<Outcome, Error> {
        let name = &sequence.annotation.name;
        let first = sequence
            .annotation
            .boxes
            .first()
            .filter(|first| first.is_usable());
        let Some(first) = first else {
            return Err(failure(name, "its first annotated box has no area"));
        };
        let outcome = match self {
            Runner::Builtin(model, policy) => builtin::track(model, *policy, sequence, *first)?,
            Runner::Program(program) => program.track(sequence, *first, folder)?,
        };
        let frames = sequence.frames.len();
        let boxes = outcome.boxes.len();
        if frames != boxes {
            return Err(failure(
                name,
                format!("{boxes} boxes, expected {frames}, one per frame"),
            ));
        }
        Ok(outcome)
    }
}

/// A sequence could not be tracked.
pub(crate) fn failure(sequence: &str, reason: impl ToString) -> Error {
    Error::Sequence {
        sequence: sequence.to_owned(),
        reason: brief(reason),
    }
}

#[cfg(test)]
mod tests;
