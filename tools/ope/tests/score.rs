//! The program `ope score`: what it prints, how it ends.

use std::process::{Command, Output};
use testing::Folder;

fn score(folder: &Folder, options: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_ope"));
    command.current_dir(folder.path()).args([
        "score",
        "--annotations",
        "truth",
        "--results",
        "found",
    ]);
    command.args(options).output().unwrap()
}

#[test]
fn json_holds_one_rule_or_all() {
    let folder = Folder::new("json");
    folder.write(
        "truth/a.txt",
        "10,10,20,20\r\nNaN,NaN,NaN,NaN\r\n10,10,20,20\r\n",
    );
    folder.write("found/a.txt", "10,10,20,20,1\n1,1,1,1,1\n10,10,20,20,1\n");
    let out = score(&folder, &["--convention", "got10k", "--json"]);
    let value: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(value["precision"], 100.0);
    assert_eq!(value["sequences"], 1);
    assert!((value["auc"].as_f64().unwrap() - 2000.0 / 21.0).abs() < 1e-9);
    let out = score(&folder, &["--json"]);
    let value: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(value["pysot"]["precision"], 100.0);
    assert!((value["otb"]["auc"].as_f64().unwrap() - 4000.0 / 63.0).abs() < 1e-9);
    assert!(value["drop"]["norm_precision"].is_number() && value["got10k"]["fps"].is_null());
}

#[test]
fn table_goes_to_standard_output_and_notes_to_standard_error() {
    let folder = Folder::new("table");
    folder.write("truth/a.txt", "10,10,20,20\n10,10,20,20\n");
    folder.write("found/a.txt", "10,10,20,20\n");
    let out = score(&folder, &["--per-sequence"]);
    let stdout = String::from_utf8(out.stdout).unwrap();
    let stderr = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success());
    let otb: Vec<_> = stdout
        .lines()
        .filter(|line| line.starts_with("otb"))
        .collect();
    assert!(
        otb[0]
            .split_whitespace()
            .eq(["otb", "50.00", "47.62", "50.00", "50.00", "1"]),
        "{stdout}"
    );
    assert_eq!(
        stderr,
        "note: found: a: 1 of 2 frames have no result: misses\n"
    );
}

#[test]
fn bad_input_ends_with_code_3_and_a_message() {
    let folder = Folder::new("bad");
    std::fs::create_dir(folder.join("found")).unwrap();
    folder.write("truth/a.txt", "10,10,20,20\n");
    let ends = |code: i32, part: &str| {
        let out = score(&folder, &["--json"]);
        let stderr = String::from_utf8(out.stderr).unwrap();
        assert_eq!(
            (out.status.code(), out.stdout.is_empty()),
            (Some(code), true),
            "{stderr}"
        );
        assert!(
            stderr.starts_with("error: ") && stderr.contains(part),
            "{stderr}"
        );
    };
    ends(3, "none for 1 of them: a");
    folder.write("found/a.txt", "10 10 20 twenty\n");
    ends(3, "line 1: expected x,y,w,h, found \"10 10 20 twenty\"");
    std::fs::remove_dir_all(folder.join("truth")).unwrap();
    ends(3, "truth: cannot be read");
    assert_eq!(
        score(&folder, &["--convention", "best"]).status.code(),
        Some(2)
    );
}
