//! Progress of a run: a bar on a terminal or a line per minute, a JSONL log, and curves.

use super::checkpoint::write_atomically;
use super::curves;
use crate::error::Error;
use crate::network::LossValues;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::Value;
use std::fs::{self, File, OpenOptions};
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Writes a run's progress.
#[derive(Debug)]
pub struct Reporter {
    log: Vec<Value>,
    files: Option<Files>, // none for a silent reporter
    bar: Option<ProgressBar>,
    last_line: Instant,
}

#[derive(Debug)]
struct Files {
    log: File,
    log_path: PathBuf,
    curves: PathBuf,
}

/// Progress of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// Steps done.
    pub step: u64,
    /// Pairs seen.
    pub pairs: u64,
    /// Share of the run that is done.
    pub progress: f64,
    /// Seconds of training.
    pub seconds: f64,
    /// Pairs per second lately.
    pub speed: f64,
    /// The losses lately.
    pub losses: LossValues,
    /// Side of the search crops.
    pub size: usize,
}

impl Reporter {
    /// Fine steps of the bar.
    const FINE: f64 = 10_000.0;

    /// A reporter that writes and prints nothing.
    pub fn silent() -> Reporter {
        Reporter {
            log: Vec::new(),
            files: None,
            bar: None,
            last_line: Instant::now(),
        }
    }

    /// Continues the log in `folder` after `step`, or starts one.
    ///
    /// # Errors
    /// If the log cannot be read or written.
    pub fn open(folder: &Path, step: u64) -> Result<Reporter, Error> {
        let path = folder.join("log.jsonl");
        let text = if step > 0 && path.is_file() {
            fs::read_to_string(&path).map_err(Error::io(&path))?
        } else {
            String::new()
        };
        // An interrupted run may have logged steps after its last checkpoint.
        let of_run = |entry: &Value| {
            entry
                .get("step")
                .and_then(Value::as_u64)
                .is_some_and(|s| s <= step)
        };
        let log: Vec<Value> = text
            .lines()
            .filter_map(|line| serde_json::from_str(line).ok())
            .filter(of_run)
            .collect();
        let kept: String = log.iter().map(|entry| format!("{entry}\n")).collect();
        write_atomically(&path, kept.as_bytes())?;
        let file = OpenOptions::new()
            .append(true)
            .open(&path)
            .map_err(Error::io(&path))?;
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = ProgressStyle::with_template("{wide_bar} {percent:>3}% {msg}")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(Reporter::FINE as u64).with_style(style)
        });
        let last_line = Instant::now()
            .checked_sub(Duration::from_secs(50))
            .unwrap_or_else(Instant::now);
        let files = Files {
            log: file,
            log_path: path,
            curves: folder.join("curves.svg"),
        };
        Ok(Reporter {
            log,
            files: Some(files),
            bar,
            last_line,
        })
    }

    /// Adds an entry to the log.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn log(&mut self, entry: Value) -> Result<(), Error> {
        let Some(files) = &mut self.files else {
            return Ok(());
        };
        let line = format!("{entry}\n");
        files
            .log
            .write_all(line.as_bytes())
            .map_err(Error::io(&files.log_path))?;
        self.log.push(entry);
        Ok(())
    }

    /// Prints a line that stays on the terminal.
    pub fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| eprintln!("{text}")),
            None if self.files.is_some() => eprintln!("{text}"),
            None => {}
        }
    }

    /// Shows the progress: at once on a terminal, otherwise once a minute.
    pub fn show(&mut self, standing: &Standing) {
        let text = standing.to_string();
        match &self.bar {
            Some(bar) => {
                bar.set_message(text);
                bar.set_position((standing.progress * Reporter::FINE) as u64);
            }
            None if self.files.is_some() && self.last_line.elapsed() >= Duration::from_secs(60) => {
                self.last_line = Instant::now();
                eprintln!("{:3.0}% {text}", standing.progress * 100.0);
            }
            None => {}
        }
    }

    /// Draws the curves of the log so far.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn draw(&self) -> Result<(), Error> {
        match &self.files {
            Some(files) => write_atomically(&files.curves, curves::svg(&self.log).as_bytes()),
            None => Ok(()),
        }
    }
}

impl Drop for Reporter {
    fn drop(&mut self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Standing {
            step,
            pairs,
            progress,
            seconds,
            speed,
            losses,
            size,
        } = self;
        let left = if *progress > 0.0 {
            seconds / progress - seconds
        } else {
            0.0
        };
        write!(
            f,
            "step {step} pairs {pairs} {speed:.1} pairs/s size {size} left {}",
            clock(left)
        )?;
        for (name, value) in losses
            .named()
            .into_iter()
            .filter(|(_, value)| *value != 0.0)
        {
            write!(f, " {name} {value:.3}")?;
        }
        Ok(())
    }
}

/// Seconds as `h:mm:ss`.
fn clock(seconds: f64) -> String {
    let s = seconds as u64;
    format!("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60)
}
