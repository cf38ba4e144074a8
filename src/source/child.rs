//! A child process that dies with this one.
//!
//! A decoder whose stream is silent does not notice that its reader was killed. On Linux the kernel
//! is asked to kill it when the thread ends that has started it; `setpriv` of util-linux asks
//! without `unsafe` here. Elsewhere, or without `setpriv`, the child ends with its next frame.

use std::ffi::OsStr;
use std::io::{Error, Result};
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::channel;
use std::thread::JoinHandle;

/// A started child, its output, and what the thread that reads its errors returns.
pub(super) type Started<T> = (Child, ChildStdout, JoinHandle<Option<T>>);

/// The command line of a program, such that it dies with this process where that is possible.
pub fn bound_command(program: &OsStr) -> Command {
    static HAS_SETPRIV: OnceLock<bool> = OnceLock::new();
    let has_setpriv = || {
        cfg!(target_os = "linux")
            && Command::new("setpriv")
                .args(["--pdeathsig", "KILL", "true"])
                .stdin(Stdio::null())
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .status()
                .is_ok_and(|status| status.success())
    };
    // A missing program must be reported as missing, not as a failure of `setpriv`.
    if !is_installed(program) || !*HAS_SETPRIV.get_or_init(has_setpriv) {
        return Command::new(program);
    }
    let mut command = Command::new("setpriv");
    command.args(["--pdeathsig", "KILL", "--"]).arg(program);
    command
}

/// Starts a command and reads its errors with `read`.
///
/// The thread that starts the child also reads its errors, so it lives as long as the child: when
/// it ends, the kernel would kill the child.
///
/// # Errors
/// If the child cannot be started.
pub(super) fn start<T: Send + 'static>(
    mut command: Command,
    read: impl FnOnce(ChildStderr) -> T + Send + 'static,
) -> Result<Started<T>> {
    command.stdin(Stdio::null());
    command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let (sender, started) = channel();
    let thread = std::thread::spawn(move || {
        let spawned = command.spawn().and_then(|mut child| {
            let pipes = child.stdout.take().zip(child.stderr.take());
            let (out, errors) = pipes.ok_or_else(|| Error::other("started without pipes"))?;
            Ok((child, out, errors))
        });
        match spawned {
            Ok((child, out, errors)) => {
                let _ = sender.send(Ok((child, out)));
                Some(read(errors))
            }
            Err(error) => {
                let _ = sender.send(Err(error));
                None
            }
        }
    });
    let ended = || Error::other("the thread that starts it has ended");
    let (child, out) = started.recv().map_err(|_| ended())??;
    Ok((child, out, thread))
}

/// Whether a program is found as the system would find it.
fn is_installed(program: &OsStr) -> bool {
    if Path::new(program).components().count() > 1 {
        return Path::new(program).is_file();
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path).any(|folder| folder.join(program).is_file())
}
