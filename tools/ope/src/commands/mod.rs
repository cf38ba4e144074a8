//! One file per sub-command, and how the program ends.

pub mod compare;
pub mod export;
pub mod render;
pub mod run;
pub mod score;
pub mod step;

use crate::args::TruthArgs;
use ope::{Annotation, Error, Notes, annotations, starts};
use std::io::{ErrorKind, Write};
use std::path::Path;
use std::process::ExitCode;

/// Says on standard error what happened and picks the exit code.
pub fn exit(error: &Error) -> ExitCode {
    match error {
        Error::Unwritable { error, .. } if error.kind() == ErrorKind::BrokenPipe => {
            return ExitCode::SUCCESS;
        }
        _ => eprintln!("error: {error}"),
    }
    match error {
        Error::Unwritable { .. } => ExitCode::from(5),
        _ => ExitCode::from(3),
    }
}

/// Writes to standard output.
fn print(text: &str) -> Result<(), Error> {
    std::io::stdout()
        .write_all(text.as_bytes())
        .map_err(Error::unwritable(Path::new("standard output")))
}

/// The annotations meant, by name.
fn truth(args: &TruthArgs, notes: &mut Notes) -> Result<Vec<Annotation>, Error> {
    let whole = match (&args.annotations, args.dataset, &args.root) {
        (Some(folder), ..) => annotations::read_folder(folder),
        (None, Some(set), Some(root)) => set.annotations(root, notes),
        _ => Err(Error::Option {
            option: "--annotations",
            expected: "it, or --dataset with --root".into(),
            found: "neither".into(),
        }),
    }?;
    Ok(if args.four_starts {
        starts::annotations(whole)
    } else {
        whole
    })
}

/// A tracker's name that is to be a folder's.
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
