//! A hundred thousand frames are scored in seconds, in little memory.

use ope::score::Missing;
use ope::{Evaluation, Results};
use sequences::{Convention, Notes, annotation};
use std::fmt::Write;
use std::fs;
use std::time::{Duration, Instant};
use testing::Folder;

/// Most memory this process has held so far, in bytes; known on Linux only.
fn peak_memory() -> Option<u64> {
    let text = fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find(|line| line.starts_with("VmHWM"))?;
    Some(line.split_ascii_whitespace().nth(1)?.parse::<u64>().ok()? * 1024)
}

/// Sequences of 1000 frames whose results are off by up to 40 pixels.
fn benchmark(sequences: usize) -> Folder {
    let folder = Folder::new("large");
    for s in 0..sequences {
        let mut truth = String::new();
        let mut found = String::new();
        for i in 0..1000 {
            writeln!(truth, "{},{},40,30", 100 + i % 300, 100 + s % 50).unwrap();
            writeln!(
                found,
                "{}.125,{}.250,41.000,29.500",
                100 + i % 300 + (i * s) % 40,
                100 + s % 50
            )
            .unwrap();
        }
        folder.write(&format!("truth/s{s:03}.txt"), truth);
        folder.write(&format!("found/s{s:03}.txt"), found);
        let times = "0.01000000\n".repeat(1000);
        folder.write(&format!("found/times/s{s:03}_time.txt"), times);
    }
    folder
}

/// Scores under all rules, and how long that took.
fn score(folder: &Folder) -> (f64, Duration) {
    let began = Instant::now();
    let mut notes = Notes::default();
    let truth = annotation::read_folder(&folder.join("truth"), &mut notes).unwrap();
    let results = Results::open(&folder.join("found")).unwrap();
    let evaluation = Evaluation::read(&truth, &results, Missing::Refuse, &mut notes).unwrap();
    let scores = evaluation.scores(&Convention::ALL, &mut notes).unwrap();
    assert_eq!(notes.count(), 0, "{notes}");
    (scores[0].auc, began.elapsed())
}

#[test]
fn hundred_thousand_frames_are_scored_in_seconds() {
    let small = benchmark(10);
    let large = benchmark(100);
    score(&small);
    let before = peak_memory();
    let (auc, took) = score(&large);
    assert!((1.0..95.0).contains(&auc), "{auc}");
    assert!(took < Duration::from_secs(10), "{took:?}"); // a quarter of a second on an idle core
    if let (Some(before), Some(after)) = (before, peak_memory()) {
        assert!(after - before < 32 << 20, "{} bytes more", after - before);
    } else {
        println!("skipped: this system does not tell the memory of a process");
    }
    println!("100000 frames in {took:?}");
}
