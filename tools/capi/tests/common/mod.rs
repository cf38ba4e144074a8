//! A short sequence, what the Rust library finds in it, and programs that are to find the same.

#![allow(dead_code)] // each test takes what it needs

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Tracker};

pub const WIDTH: usize = 96;
pub const HEIGHT: usize = 64;
pub const INIT: [f32; 4] = [24.0, 24.0, 16.0, 16.0];

/// A bright square on a pattern, moving to the right by two pixels a frame.
pub fn frames() -> Vec<Vec<u8>> {
    let frame = |shift: usize| {
        let pixel = |i: usize| {
            let (x, y) = (i % WIDTH, i / WIDTH);
            let inside = (24 + shift..40 + shift).contains(&x) && (24..40).contains(&y);
            if inside {
                [240, 200, 60]
            } else {
                [(x * 7 % 60) as u8, (y * 13 % 60) as u8, 40]
            }
        };
        (0..WIDTH * HEIGHT).flat_map(pixel).collect()
    };
    (0..4).map(|i| frame(2 * i)).collect()
}

/// What the Rust library finds in them.
pub fn expected() -> Vec<[f32; 5]> {
    let mut tracker = Tracker::new(Model::builtin(Isa::detect()));
    let mut rows = Vec::new();
    for pixels in frames() {
        let frame = Frame::new(&pixels, WIDTH, HEIGHT, ChannelOrder::Rgb).unwrap();
        let [x, y, w, h] = INIT;
        if rows.is_empty() {
            tracker.init(&frame, BBox::new(x, y, w, h)).unwrap();
            rows.push([x, y, w, h, 1.0]);
        } else {
            let track = tracker.update(&frame).unwrap();
            rows.push([
                track.bbox.x,
                track.bbox.y,
                track.bbox.w,
                track.bbox.h,
                track.score,
            ]);
        }
    }
    rows
}

/// The folder of the shared library: where this test lies, or the one above.
pub fn library() -> Option<PathBuf> {
    let name = format!(
        "{}track_cpu_c{}",
        std::env::consts::DLL_PREFIX,
        std::env::consts::DLL_SUFFIX
    );
    let at = std::env::current_exe().unwrap();
    let found = at
        .ancestors()
        .skip(1)
        .take(2)
        .map(|folder| folder.join(&name))
        .find(|path| path.is_file());
    if found.is_none() {
        println!("skipped: no {name} near {}", at.display());
    }
    found
}

pub fn has(program: &str) -> bool {
    let found = Command::new(program)
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok();
    if !found {
        println!("skipped: no {program}");
    }
    found
}

/// Feeds the frames to a program and holds what it prints against what the Rust library finds.
pub fn follows(command: &mut Command) {
    let [x, y, w, h] = INIT;
    let arguments = [WIDTH as f32, HEIGHT as f32, x, y, w, h].map(|number| number.to_string());
    let mut child = command
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child
        .stdin
        .take()
        .unwrap()
        .write_all(&frames().concat())
        .unwrap();
    let output = child.wait_with_output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{text}");
    let rows: Vec<Vec<f32>> = text
        .lines()
        .map(|line| {
            line.split(',')
                .map(|number| number.parse().unwrap())
                .collect()
        })
        .collect();
    assert_eq!(rows.len(), 4, "{text}");
    for (found, expected) in rows.iter().zip(expected()) {
        assert!(
            found.len() == 5
                && found
                    .iter()
                    .zip(expected)
                    .all(|(a, b)| (a - b).abs() < 1e-3),
            "{text}"
        );
    }
}

pub fn source(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}
