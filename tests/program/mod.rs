//! Runs the compiled program; small pictures and folders to run it on.
#![allow(dead_code)] // every test file uses its part

use std::ffi::OsStr;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use scenes::{Flight, FlightConfig, FrameBuffer};

/// Width and height of the frames of [`flight`].
pub const SIZE: (usize, usize) = (160, 96);

/// The program with these arguments, run to its end on `stdin`.
pub fn run(args: impl IntoIterator<Item = impl AsRef<OsStr>>, stdin: &[u8]) -> Output {
    run_with(&mut program(args), stdin)
}

/// The program, not yet started.
pub fn program(args: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_track-cpu"));
    command.args(args);
    command
}

/// Starts a command, feeds it and waits for its end.
pub fn run_with(command: &mut Command, stdin: &[u8]) -> Output {
    let mut child = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("the program starts");
    let mut pipe = child.stdin.take().expect("a pipe");
    std::thread::scope(|scope| {
        scope.spawn(move || drop(pipe.write_all(stdin))); // it need not read everything
        child.wait_with_output().expect("the program ends")
    })
}

/// Standard output as text.
pub fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Standard error as text.
pub fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A fresh folder.
pub fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// The first frames of a rendered flight in RGB, and the object's box in the first as `--init`
/// takes it.
pub fn flight(frames: usize) -> (Vec<Vec<u8>>, String) {
    let config = FlightConfig {
        width: SIZE.0,
        height: SIZE.1,
        frames: 60,
        ..FlightConfig::default()
    };
    let flight = Flight::new(config);
    let mut buffer = FrameBuffer::default();
    let mut init = String::new();
    let mut render = |index| {
        let b = flight.render(index, &mut buffer).bbox;
        if index == 0 {
            init = format!("{:.3},{:.3},{:.3},{:.3}", b.x, b.y, b.w, b.h);
        }
        buffer.data.clone()
    };
    let pictures = (0..frames).map(&mut render).collect();
    (pictures, init)
}

/// Writes frames as `img1.png`, `img2.png`, ...
pub fn write_pngs(folder: &Path, frames: &[Vec<u8>]) {
    for (i, frame) in frames.iter().enumerate() {
        let path = folder.join(format!("img{}.png", i + 1));
        let (w, h) = (SIZE.0 as u32, SIZE.1 as u32);
        image::save_buffer(path, frame, w, h, image::ExtendedColorType::Rgb8).unwrap();
    }
}

/// An executable shell script called `ffmpeg` in a folder of its own; returns a `PATH` that finds
/// it first.
#[cfg(unix)]
pub fn fake_ffmpeg(name: &str, script: &str) -> std::ffi::OsString {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder(name);
    let path = folder.join("ffmpeg");
    std::fs::write(&path, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
    let rest = std::env::var_os("PATH").unwrap_or_default();
    std::env::join_paths(std::iter::once(folder).chain(std::env::split_paths(&rest))).unwrap()
}
