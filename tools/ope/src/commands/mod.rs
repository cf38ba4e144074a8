//! One file per sub-command, and how the program ends.

pub mod compare;
pub mod diagnose;
pub mod export;
pub mod render;
pub mod run;
pub mod score;
pub mod step;

use crate::args::{TrackersArgs, TruthArgs};
use ope::{Error, starts};
use program::{Exit, check_outputs};
use sequences::{Annotation, Notes, Sequence, annotation};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Prints the error on standard error and picks the exit code.
pub fn exit(error: &Error) -> ExitCode {
    let exit = match error {
        Error::Unwritable { error, .. } if error.kind() == ErrorKind::BrokenPipe => {
            return ExitCode::SUCCESS;
        }
        Error::Unwritable { .. } => Exit::Output,
        Error::Option { .. } | Error::Clash(_) => Exit::Usage,
        Error::Model(_) => Exit::Model,
        Error::BadFrames { .. } => Exit::Frames,
        _ => Exit::Input,
    };
    exit.fail(error)
}

/// Refuses a `--out` that would overwrite an input.
fn check_output(output: &Path, inputs: &[&Path]) -> Result<(), Error> {
    check_outputs(&[("--out", output)], inputs).map_err(|clash| Error::Option {
        option: "--out",
        expected: "a path that overwrites no input".into(),
        found: clash.to_string(),
    })
}

/// The folders of boxes that a comparison reads.
fn read_by(args: &TrackersArgs) -> Vec<&Path> {
    let truth = args.truth.annotations.iter();
    args.results
        .iter()
        .chain(truth)
        .map(PathBuf::as_path)
        .collect()
}

/// Writes to standard output.
fn print(text: &str) -> Result<(), Error> {
    std::io::stdout()
        .write_all(text.as_bytes())
        .map_err(Error::unwritable(Path::new("standard output")))
}

/// The annotations that the options name. Notes about those left out go to standard error.
fn truth(args: &TruthArgs) -> Result<Vec<Annotation>, Error> {
    let mut notes = Notes::default();
    let whole = match (&args.annotations, args.dataset, &args.root) {
        (Some(folder), ..) => annotation::read_folder(folder, &mut notes).map_err(Error::from),
        (None, Some(set), Some(root)) => set.annotations(root, &mut notes).map_err(Error::from),
        _ => Err(Error::Option {
            option: "--annotations",
            expected: "a folder, or --dataset with --root instead".into(),
            found: "neither".into(),
        }),
    }?;
    eprint!("{notes}");
    Ok(if args.four_starts {
        starts::annotations(whole)
    } else {
        whole
    })
}

/// The sequences that the options name, with their pictures; `None` if only annotations are given.
fn sequences(args: &TruthArgs) -> Result<Option<Vec<Sequence>>, Error> {
    let (Some(set), Some(root)) = (args.dataset, &args.root) else {
        return Ok(None);
    };
    // `truth` has already printed the notes.
    let whole = set.load(root, &mut Notes::default())?;
    Ok(Some(if args.four_starts {
        starts::sequences(whole)
    } else {
        whole
    }))
}

/// A tracker's name, if a folder can have it.
fn folder_name(name: &str) -> Result<&str, Error> {
    if name.is_empty() || name.contains(['/', '\\']) || name.starts_with('.') {
        let expected = "a name for a folder".to_owned();
        return Err(Error::Option {
            option: "--name",
            expected,
            found: format!("{name:?}"),
        });
    }
    Ok(name)
}
