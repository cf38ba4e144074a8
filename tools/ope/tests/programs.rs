//! The programs `ope run`, `merge`, `compare`, `report` and `export`, one after the other on a
//! small benchmark.

use std::fs;
use std::process::Command;
use testing::Folder;

const ECHO: &str = "sh -c 'for f in $(cat {frames}); do echo {init}; echo 0.01 >> {times}; done'";

/// Three sequences of three frames each, whose pictures are never opened.
fn benchmark(name: &str) -> Folder {
    let folder = Folder::new(name);
    for sequence in ["a", "b", "c"] {
        let boxes = "10\t10\t20\t20\n".repeat(3);
        folder.write(&format!("data/{sequence}/groundtruth_rect.txt"), boxes);
        for i in 1..=3 {
            folder.write(&format!("data/{sequence}/img/{i:04}.jpg"), "");
        }
    }
    folder
}

/// Runs `ope` and returns its exit code, standard output and standard error.
fn ope(folder: &Folder, args: &[&str]) -> (Option<i32>, String, String) {
    let out = Command::new(env!("CARGO_BIN_EXE_ope"))
        .current_dir(folder.path())
        .args(args)
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (out.status.code(), text(out.stdout), text(out.stderr))
}

#[test]
fn results_go_from_run_to_page() {
    let folder = benchmark("programs");
    let data = ["--dataset", "folder", "--root", "data"];
    let with = |before: &[&'static str], after: &[&'static str]| {
        let args: Vec<&str> = before.iter().chain(&data).chain(after).copied().collect();
        ope(&folder, &args)
    };
    let (code, _, told) = with(
        &["run"],
        &["--out", "whole", "--name", "still", "--tracker", ECHO],
    );
    assert_eq!(code, Some(0), "{told}");
    let (_, _, told) = with(
        &["run"],
        &["--out", "whole", "--name", "still", "--tracker", ECHO],
    );
    assert!(told.starts_with("0 sequences run"), "{told}");
    for shard in ["1/2", "2/2"] {
        let out = if shard == "1/2" { "one" } else { "two" };
        let (code, _, told) = with(
            &["run"],
            &[
                "--out",
                out,
                "--name",
                "still",
                "--tracker",
                ECHO,
                "--shard",
                shard,
            ],
        );
        assert_eq!(code, Some(0), "{told}");
    }
    let merge = [
        "merge",
        "one/folder/still",
        "two/folder/still",
        "--out",
        "merged/still too",
    ];
    assert_eq!(ope(&folder, &merge).0, Some(0));
    for sequence in ["a", "b", "c"] {
        let read = |at: &str| fs::read(folder.join(at).join(format!("{sequence}.txt"))).unwrap();
        assert_eq!(read("whole/folder/still"), read("merged/still too"));
    }
    let both = ["whole/folder/still", "merged/still too"];
    let (code, table, told) = with(&["compare", "--out", "plots"], &both);
    assert_eq!(code, Some(0), "{told}");
    assert!(table.contains("still too        100.00  95.24"), "{table}");
    assert!(
        folder.join("plots/speed.svg").is_file() && !folder.join("plots/attributes.svg").exists()
    );
    let (code, _, told) = with(&["report", "--out", "page.html"], &both);
    assert_eq!(code, Some(0), "{told}");
    assert!(
        fs::read_to_string(folder.join("page.html"))
            .unwrap()
            .contains("still too")
    );
    let export = [
        "export",
        "--results",
        "whole/folder/still",
        "--to",
        "pysot",
        "--dataset",
        "otb100",
    ];
    assert_eq!(
        ope(&folder, &[&export[..], &["--out", "exported"]].concat()).0,
        Some(0)
    );
    assert!(folder.join("exported/still/a.txt").is_file());
}

/// Killed after the first sequence and started again: nothing is done twice, and the files are
/// those of one run.
#[test]
fn killed_run_resumes_without_doing_a_sequence_twice() {
    let folder = benchmark("killed");
    // The tracker notes the first frame of each of its runs.
    let note = "head -n 1 {frames} >> runs; sleep 0.3; ";
    let tracker = format!("sh -c '{note}{}'", &ECHO["sh -c '".len()..ECHO.len() - 1]);
    let run = |out: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ope"));
        command.current_dir(folder.path()).args([
            "run",
            "--dataset",
            "folder",
            "--root",
            "data",
            "--jobs",
            "1",
        ]);
        command.args(["--name", "still", "--tracker", &tracker, "--out", out]);
        command
    };
    let runs_of = |sequence: &str| {
        let runs = fs::read_to_string(folder.join("runs")).unwrap_or_default();
        runs.lines()
            .filter(|frame| frame.contains(&format!("data/{sequence}/img")))
            .count()
    };
    let first = folder.join("out/folder/still/a.txt");
    let mut child = run("out").spawn().unwrap();
    while !first.exists() {
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let written = fs::metadata(&first).unwrap().modified().unwrap();
    assert!(!folder.join("out/folder/still/c.txt").exists());
    assert!(run("out").status().unwrap().success());
    assert_eq!(fs::metadata(&first).unwrap().modified().unwrap(), written);
    // What was begun and killed is done again; what was done is not.
    assert!(runs_of("a") == 1 && runs_of("b") >= 1 && runs_of("c") == 1);
    assert!(run("whole").status().unwrap().success());
    for file in [
        "a.txt",
        "b.txt",
        "c.txt",
        "times/a_time.txt",
        "times/c_time.txt",
    ] {
        let read = |at: &str| fs::read(folder.join(at).join("folder/still").join(file)).unwrap();
        assert_eq!(read("out"), read("whole"), "{file}");
    }
}

#[test]
fn flights_are_rendered_tracked_and_scored() {
    let folder = benchmark("rendered");
    let render = [
        "render", "--out", "flights", "--count", "2", "--frames", "5", "--size", "128x96",
    ];
    assert_eq!(ope(&folder, &render).0, Some(0));
    let data = ["--dataset", "folder", "--root", "flights"];
    let (code, _, told) = ope(&folder, &[&["run"], &data[..], &["--out", "out"]].concat());
    assert_eq!(code, Some(0), "{told}");
    let score = [
        "score",
        "--results",
        "out/folder/track-cpu",
        "--json",
        "--convention",
        "otb",
    ];
    let (code, text, told) = ope(&folder, &[&score[..], &data[..]].concat());
    assert_eq!(code, Some(0), "{told}");
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(value["sequences"], 2);
    assert!(
        value["auc"].as_f64().unwrap() > 20.0
            && value["fps"]["frames_per_time"].as_f64().unwrap() > 0.0
    );
    let (code, _, told) = ope(
        &folder,
        &[&["run", "--four-starts"], &data[..], &["--out", "out"]].concat(),
    );
    assert!(
        code == Some(0) && told.contains("6 sequences run"),
        "the first passes are there: {told}"
    );
    let (_, text, told) = ope(
        &folder,
        &[&score[..], &data[..], &["--four-starts"]].concat(),
    );
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(value["sequences"], 8, "{told}");
    assert_eq!(
        ope(&folder, &["render", "--out", "x", "--size", "9999999x9"]).0,
        Some(2)
    );
}

#[test]
fn shards_that_run_at_once_into_one_folder_equal_one_run() {
    let folder = benchmark("shards");
    let run = |out: &str, shard: &str| {
        let options = [
            "--root",
            "data",
            "--dataset",
            "folder",
            "--name",
            "still",
            "--tracker",
        ];
        Command::new(env!("CARGO_BIN_EXE_ope"))
            .current_dir(folder.path())
            .arg("run")
            .args(options)
            .args([ECHO, "--out", out, "--shard", shard])
            .spawn()
            .unwrap()
    };
    let mut whole = run("whole", "1/1");
    let mut shards = ["1/2", "2/2"].map(|shard| run("shards", shard));
    for child in shards.iter_mut().chain([&mut whole]) {
        assert!(child.wait().unwrap().success());
    }

    let files = |out: &str| {
        let results = folder.path().join(out).join("folder/still");
        let mut files = Vec::new();
        for at in [results.clone(), results.join("times")] {
            for entry in fs::read_dir(at).unwrap().map(Result::unwrap) {
                if entry.path().is_file() {
                    let content = fs::read_to_string(entry.path()).unwrap();
                    files.push((entry.file_name(), content));
                }
            }
        }
        files.sort();
        files
    };
    assert_eq!(files("shards"), files("whole"));
    assert_eq!(files("whole").len(), 7, "boxes, times, what made them");
}

#[test]
fn results_of_another_tracker_are_neither_kept_nor_overwritten() {
    let folder = benchmark("origin");
    let run = [
        "run",
        "--root",
        "data",
        "--dataset",
        "folder",
        "--out",
        "out",
    ];
    let echo = "sh -c 'for f in $(cat {frames}); do echo {init}; done'";
    let first = [&run[..], &["--name", "one", "--tracker", echo]].concat();
    let other = [&run[..], &["--name", "one", "--tracker", "false"]].concat();
    assert_eq!(ope(&folder, &first).0, Some(0));

    let (same, _, kept) = ope(&folder, &first);
    let (code, _, told) = ope(&folder, &other);

    assert_eq!(same, Some(0));
    assert!(kept.contains("3 sequences had results already"), "{kept}");
    assert_eq!(code, Some(3), "{told}");
    assert!(told.contains("results of the command false"), "{told}");
    assert!(told.contains("found the command sh -c"), "{told}");
}

#[test]
fn bad_options_and_inputs_are_refused_with_a_message() {
    let folder = benchmark("bad-programs");
    let run = ["run", "--root", "data", "--out", "out"];
    for (more, code, part) in [
        (&["--shard", "3/2"][..], 2, "i from 1 to n"),
        (&["--tracker", "'x"], 2, "quote"),
        (&["--tracker", "trax:"], 2, "found none"),
        (&["--tracker", "x", "--timeout", "0"], 2, "seconds above 0"),
        (
            &["--dataset", "uav321"],
            2,
            "expected one of uav123, uav123_10fps",
        ),
        (
            &["--name", "../x"],
            2,
            "--name: expected a name for a folder",
        ),
        (
            &["--model", "data/a/groundtruth_rect.txt"],
            4,
            "groundtruth_rect.txt",
        ),
        (&["--tracker", "false"], 3, "3 of 3 sequences failed"),
        (&["--jobs", "1"], 3, "a/img/0001.jpg"),
    ] {
        let set: &[&str] = if more.contains(&"--dataset") {
            &[]
        } else {
            &["--dataset", "folder"]
        };
        let (found, _, told) = ope(&folder, &[&run[..], set, more].concat());
        assert_eq!(found, Some(code), "{told}");
        assert!(told.contains(part), "{told}");
    }
    let (code, _, told) = ope(&folder, &["score", "--results", "data"]);
    assert_eq!(code, Some(2), "{told}");
    let (code, _, told) = ope(
        &folder,
        &["score", "--annotations", "data", "--results", "data"],
    );
    assert!(
        code == Some(3) && told.contains("expected results of 3 sequences"),
        "{told}"
    );
}
