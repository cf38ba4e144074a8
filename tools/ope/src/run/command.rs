//! Another program over one sequence, by its command line.

use super::{Outcome, failure};
use crate::error::Error;
use sequences::{Rect, Sequence, text};
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// A command line that tracks one sequence.
///
/// | placeholder | stands for |
/// |---|---|
/// | `{frames}` | a text file with the path of each frame, a line each |
/// | `{folder}` | the folder of the first frame |
/// | `{init}` | the first frame's box: `x,y,w,h` |
/// | `{out}` | the file to write the boxes to; without it, they are read from standard output |
/// | `{times}` | the file to write the seconds of each frame to, if the program can |
///
/// Words are separated by spaces; quotes keep a word together. No shell is involved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CommandLine {
    words: Vec<String>,
}

impl fmt::Display for CommandLine {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.words.join(" "))
    }
}

impl CommandLine {
    /// Splits a command line into words.
    ///
    /// # Errors
    /// If it is empty, or a quote does not end.
    pub fn parse(text: &str) -> Result<CommandLine, String> {
        let mut words = Vec::new();
        let mut word = None::<String>;
        let mut quote = None;
        for c in text.chars() {
            match quote {
                Some(q) if c == q => quote = None,
                None if c == '"' || c == '\'' => {
                    quote = Some(c);
                    word.get_or_insert_default();
                }
                None if c.is_whitespace() => words.extend(word.take()),
                _ => word.get_or_insert_default().push(c),
            }
        }
        words.extend(word);
        match (quote, words.is_empty()) {
            (Some(quote), _) => Err(format!("expected the quote {quote} to end, found {text:?}")),
            (None, true) => Err("expected a command line, found none".into()),
            (None, false) => Ok(CommandLine { words }),
        }
    }

    /// The program as the command line names it.
    pub fn program(&self) -> &str {
        &self.words[0]
    }

    /// The program's file name.
    pub fn name(&self) -> String {
        Path::new(self.program())
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    }

    /// The program with its arguments, placeholders filled in.
    pub(super) fn command(&self, values: &[(&str, String)]) -> Command {
        let fill = |word: &String| {
            values
                .iter()
                .fold(word.clone(), |word, (key, value)| word.replace(key, value))
        };
        let mut words = self.words.iter().map(fill);
        let mut command = Command::new(words.next().unwrap_or_default());
        command.args(words);
        command
    }

    /// Runs the program on a sequence. Its files lie in a temporary folder below `folder`.
    ///
    /// The limit for the whole run is `timeout` times the number of frames.
    pub(super) fn track(
        &self,
        timeout: Duration,
        sequence: &Sequence,
        first: Rect,
        folder: &Path,
    ) -> Result<Outcome, Error> {
        let name = &sequence.annotation.name;
        let work = Work::new(folder, name)?;
        let [frames, out, times] =
            ["frames.txt", "boxes.txt", "times.txt"].map(|file| work.0.join(file));
        let absolute = |path: &Path| fs::canonicalize(path).map_err(Error::unreadable(path));
        let paths = sequence
            .frames
            .iter()
            .map(|path| Ok(format!("{}\n", absolute(path)?.display())));
        let list = paths.collect::<Result<String, Error>>()?;
        fs::write(&frames, list).map_err(Error::unwritable(&frames))?;
        let pictures = absolute(sequence.frames[0].parent().unwrap_or(Path::new(".")))?;
        let values = [
            ("{frames}", frames.display().to_string()),
            ("{folder}", pictures.display().to_string()),
            (
                "{init}",
                format!("{},{},{},{}", first.x, first.y, first.w, first.h),
            ),
            ("{out}", out.display().to_string()),
            ("{times}", times.display().to_string()),
        ];
        let mut command = self.command(&values);
        command.stdin(Stdio::null());
        if self.words.iter().any(|word| word.contains("{out}")) {
            command.stdout(Stdio::null());
        } else {
            command.stdout(fs::File::create(&out).map_err(Error::unwritable(&out))?);
        }
        let failed = |reason: String| failure(name, format!("{}: {reason}", self.program()));
        let child = command.spawn().map_err(|error| failed(error.to_string()))?;
        let limit =
            timeout.saturating_mul(u32::try_from(sequence.frames.len()).unwrap_or(u32::MAX));
        let status = wait(child, limit).map_err(failed)?;
        if !status.success() {
            return Err(failed(status.to_string()));
        }
        let seconds = if times.is_file() {
            text::read_numbers(&times)?
        } else {
            Vec::new()
        };
        Ok(Outcome {
            boxes: text::read_boxes(&out)?,
            seconds,
            held: 0,
        })
    }
}

/// Waits for the program's end and kills it after `limit`.
fn wait(mut child: Child, limit: Duration) -> Result<ExitStatus, String> {
    let began = Instant::now();
    let mut pause = Duration::from_millis(1);
    loop {
        match child.try_wait().map_err(|error| error.to_string())? {
            Some(status) => return Ok(status),
            None if began.elapsed() < limit => thread::sleep(pause),
            None => {
                let _ = child.kill();
                let _ = child.wait();
                return Err(format!("no end within {} s", limit.as_secs_f64()));
            }
        }
        pause = (pause * 2).min(Duration::from_millis(50));
    }
}

/// A folder for the program's files, removed when dropped.
struct Work(PathBuf);

impl Work {
    fn new(folder: &Path, sequence: &str) -> Result<Work, Error> {
        let path = folder.join(format!(".{sequence}.{}", std::process::id()));
        fs::create_dir_all(&path).map_err(Error::unwritable(&path))?;
        let path = fs::canonicalize(&path).map_err(Error::unreadable(&path))?;
        Ok(Work(path))
    }
}

impl Drop for Work {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_line_is_split_at_blanks_outside_quotes() {
        let words = |text: &str| CommandLine::parse(text).map(|command| command.words);
        assert_eq!(
            words("  a b\t'c d' \"e 'f\"g '' ").unwrap(),
            ["a", "b", "c d", "e 'fg", ""]
        );
        assert!(words("a 'b").unwrap_err().contains("quote '"));
        assert!(words("  ").is_err());
        assert_eq!(
            CommandLine::parse("/opt/kcf.py {out}").unwrap().name(),
            "kcf"
        );
    }
}
