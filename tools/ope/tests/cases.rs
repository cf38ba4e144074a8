//! Data as users provide them, each with the figures or the message that `ope` gives.

use serde_json::Value;
use std::process::Command;
use testing::Folder;

/// A tracker that gives the first frame's box for every frame.
const STILL: &str = "sh -c 'for f in $(cat {frames}); do echo {init}; done'";

/// Eight frames of a target that moves by (4, 1) per frame, with a row made of each box.
fn rows(row: fn(f64, f64) -> String) -> String {
    (0..8)
        .map(|i| row(20.0 + 4.0 * f64::from(i), 40.0 + f64::from(i)) + "\n")
        .collect()
}

fn boxes() -> String {
    rows(|x, y| format!("{x},{y},24,18"))
}

fn polygons() -> String {
    rows(|x, y| {
        let (right, low) = (x + 24.0, y + 18.0);
        format!("{x:.2},{y:.2},{right:.2},{y:.2},{right:.2},{low:.2},{x:.2},{low:.2}")
    })
}

/// A folder `data` with one sequence.
fn sequence(folder: &Folder, name: &str, pictures: &str, annotation: &str, boxes: &str) {
    for i in 1..=8 {
        folder.write(&format!("data/{name}/{pictures}/{i:04}.jpg"), "");
    }
    folder.write(&format!("data/{name}/{annotation}"), boxes);
}

/// Exit code, standard output and standard error of `ope` within a folder.
fn ope(folder: &Folder, args: &[&str]) -> (Option<i32>, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_ope"))
        .current_dir(folder.path())
        .args(args)
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (out.status.code(), text(out.stdout), text(out.stderr))
}

const DATA: [&str; 4] = ["--dataset", "folder", "--root", "data"];

fn run(folder: &Folder) -> (Option<i32>, String) {
    let run = ["run", "--out", "out", "--name", "still", "--tracker", STILL];
    let (code, _, said) = ope(folder, &[&run[..], &DATA[..]].concat());
    (code, said)
}

#[test]
fn results_in_every_form_score_as_their_boxes_do() {
    let perfect = (100.0, 2000.0 / 21.0);
    let first_only = (12.5, 2000.0 / 21.0 / 8.0);
    let first_row = || "20,40,24,18\n".to_owned();
    let cases: [(&str, String, String, (f64, f64)); 7] = [
        ("polygons in the truth", polygons(), boxes(), perfect),
        ("polygons in the results", boxes(), polygons(), perfect),
        ("polygons in both", polygons(), polygons(), perfect),
        (
            "confidences",
            boxes(),
            boxes().replace(",18\n", ",18,0.9\n"),
            perfect,
        ),
        (
            "CR line ends",
            boxes().replace('\n', "\r"),
            boxes(),
            perfect,
        ),
        ("one result of eight", boxes(), first_row(), first_only),
        (
            "more results than frames",
            boxes(),
            boxes() + "1,1,9,9\n",
            perfect,
        ),
    ];
    for (what, truth, results, (precision, auc)) in cases {
        let folder = Folder::new("case");
        folder.write("truth/a.txt", truth);
        folder.write("found/a.txt", results);
        let score = ["score", "--annotations", "truth", "--results", "found"];
        let score = [&score[..], &["--convention", "got10k", "--json"]].concat();

        let (code, out, said) = ope(&folder, &score);

        assert_eq!(code, Some(0), "{what}: {said}");
        let value: Value = serde_json::from_str(&out).unwrap();
        let found = ["precision", "auc"].map(|name| value[name].as_f64().unwrap());
        assert!((found[0] - precision).abs() < 1e-9, "{what}: {found:?}");
        assert!((found[1] - auc).abs() < 1e-9, "{what}: {found:?}");
    }
}

#[test]
fn tracker_that_crashed_ranks_below_the_perfect_one() {
    let folder = Folder::new("case");
    sequence(&folder, "a", "img", "groundtruth.txt", &boxes());
    folder.write("died/a.txt", "20,40,24,18\n");
    folder.write("perfect/a.txt", boxes());

    let (code, table, said) = ope(
        &folder,
        &[&["compare"], &DATA[..], &["died", "perfect"]].concat(),
    );

    assert_eq!(code, Some(0), "{said}");
    let row = table.lines().find(|line| line.starts_with("died")).unwrap();
    let cells: Vec<&str> = row.split_whitespace().collect();
    assert_eq!(cells[1..3], ["12.50", "11.90"], "{table}");
    assert!(
        said.contains("died: a: 7 of 8 frames have no result: misses"),
        "{said}"
    );
}

#[test]
fn first_box_with_decimal_commas_is_given_to_the_tracker() {
    let folder = Folder::new("case");
    let boxes = rows(|x, y| format!("{x},5;{y},5;24,5;18,5"));
    sequence(&folder, "a", "img", "groundtruth.txt", &boxes);

    let (code, said) = run(&folder);

    assert_eq!(code, Some(0), "{said}");
    let written = std::fs::read_to_string(folder.join("out/folder/still/a.txt")).unwrap();
    assert_eq!(written.lines().next(), Some("20.500,40.500,24.500,18.500"));
}

#[test]
fn sequence_that_cannot_be_used_is_named_and_the_others_run() {
    let stray = boxes() + "# end\n";
    let cases: [(&str, &str, &str, String, &str); 4] = [
        (
            "no pictures",
            "visible",
            "groundtruth.txt",
            boxes(),
            "no pictures in a/img",
        ),
        ("stray line", "img", "groundtruth.txt", stray, "line 9"),
        (
            "an empty annotation",
            "img",
            "groundtruth.txt",
            String::new(),
            "an empty file",
        ),
        (
            "shares of the picture",
            "img",
            "groundtruth.txt",
            "0.1,0.2,0.3,0.4\n".repeat(8),
            "expected boxes in pixels",
        ),
    ];
    for (what, pictures, annotation, rows, reason) in cases {
        let folder = Folder::new("case");
        sequence(&folder, "a", pictures, annotation, &rows);
        sequence(&folder, "b", "img", "groundtruth.txt", &boxes());

        let (code, said) = run(&folder);

        assert_eq!(code, Some(0), "{what}: {said}");
        assert!(
            said.contains("a: left out: ") && said.contains(reason),
            "{what}: {said}"
        );
        assert!(folder.join("out/folder/still/b.txt").is_file(), "{what}");
        assert!(!folder.join("out/folder/still/a.txt").exists(), "{what}");
    }
}

#[test]
fn root_whose_only_sequence_cannot_be_used_is_refused_with_the_reason() {
    let folder = Folder::new("case");
    sequence(&folder, "a", "visible", "groundtruth.txt", &boxes());

    let (code, said) = run(&folder);

    assert_eq!(code, Some(3));
    assert!(
        said.contains("a: left out: no pictures in a/img, a/imgs, a/color or a"),
        "{said}"
    );
    assert!(said.contains("there are some in a/visible"), "{said}");
}

#[test]
fn annotation_is_found_in_any_case_of_its_name() {
    let folder = Folder::new("case");
    sequence(&folder, "a", "img", "GroundTruth.txt", &boxes());

    assert_eq!(run(&folder).0, Some(0));
}
