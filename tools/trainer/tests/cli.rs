//! The program: a run that is killed and goes on, an export, and ways in that lead nowhere.

use std::path::Path;
use std::process::{Command, Output};
use std::time::{Duration, Instant};
use testing::Folder;
use weights_format::{Storage, Weights};

/// A temporary folder with pictures of rectangles and `boxes.csv`.
fn pictures(name: &str) -> Folder {
    let folder = Folder::new(name);
    let mut text = String::from("path,x,y,w,h\n");
    for i in 0..4u32 {
        let picture = image::RgbImage::from_fn(120, 100, |x, y| {
            let inside = (30..60).contains(&x) && (40..65).contains(&y);
            image::Rgb([if inside { 220 } else { 60 }, (x * y * (i + 1)) as u8, 90])
        });
        picture.save(folder.join(&format!("{i}.png"))).unwrap();
        text += &format!("{i}.png,30,40,30,25\n");
    }
    text += "missing.png,1,1,9,9\n";
    folder.write("boxes.csv", text);
    folder
}

fn train(args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_train"));
    command.args(args);
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn succeed(output: &Output) {
    assert!(
        output.status.success(),
        "{}{}",
        text(&output.stdout),
        text(&output.stderr)
    );
}

const TINY: [&str; 14] = [
    "--ratio",
    "0.9",
    "--steps",
    "30",
    "--batch",
    "2",
    "--search-size",
    "191",
    "--early-size",
    "183",
    "--threads",
    "2",
    "--estimation-batches",
    "2",
];

/// Options of a tiny network and a run of that many steps.
fn tiny(steps: &str) -> Vec<&str> {
    let mut options = TINY.to_vec();
    options[3] = steps;
    options
}

#[test]
fn killed_run_resumes_to_the_same_weights() {
    let folder = pictures("resume");
    let (data, straight, killed) = (
        folder.at("boxes.csv"),
        folder.at("straight"),
        folder.at("killed"),
    );
    let fit = |out: &str, more: &[&str]| {
        let mut command = train(&["fit", "--data", &data, "--out", out]);
        command.args(TINY).args(more);
        command
    };
    let output = fit(&straight, &[]).output().unwrap();
    succeed(&output);
    assert!(
        text(&output.stderr).contains("missing.png is missing"),
        "{}",
        text(&output.stderr)
    );
    assert_eq!(
        text(&output.stdout).trim(),
        Path::new(&straight)
            .join("weights.safetensors")
            .to_str()
            .unwrap()
    );

    // A checkpoint after every step; killed as soon as there are a few.
    let mut child = fit(&killed, &["--checkpoint-minutes", "0"])
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let log = Path::new(&killed).join("log.jsonl");
    let checkpoint = Path::new(&killed).join("checkpoint.safetensors");
    let start = Instant::now();
    while !checkpoint.exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "no checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(
        log.exists() && !Path::new(&killed).join("weights.safetensors").exists(),
        "killed too late"
    );
    let checkpoint = checkpoint.display().to_string();
    succeed(
        &train(&["fit", "--resume", &checkpoint, "--out", &killed])
            .output()
            .unwrap(),
    );

    let read = |out: &str| Weights::read(&Path::new(out).join("weights.safetensors")).unwrap();
    let (a, b) = (read(&straight), read(&killed));
    assert!(a.tensors().eq(b.tensors()), "the same bits");
    assert_eq!(a.header.provenance.notes["steps"], "30");
    assert_eq!(a.header.input.mean, [114.0; 3]);

    let final_checkpoint = Path::new(&killed)
        .join("final.safetensors")
        .display()
        .to_string();
    let exported = folder.at("half.safetensors");
    succeed(
        &train(&[
            "export",
            &final_checkpoint,
            "--out",
            &exported,
            "--name",
            "tiny",
        ])
        .output()
        .unwrap(),
    );
    let half = Weights::read(Path::new(&exported)).unwrap();
    assert_eq!(
        (half.header.storage, &half.header.provenance.name[..]),
        (Storage::F16, "tiny")
    );
    for ((name, full), (_, half)) in a.tensors().zip(half.tensors()) {
        let worst = full
            .data
            .iter()
            .zip(&half.data)
            .map(|(f, h)| (f - h).abs() / f.abs().max(1e-3));
        assert!(worst.fold(0.0, f32::max) < 1e-3, "{name}");
    }
}

#[test]
fn used_folder_is_refused_without_resume_or_overwrite() {
    let folder = pictures("used");
    let (data, out) = (folder.at("boxes.csv"), folder.at("run"));
    let fit = |seed: &str, more: &[&str]| {
        train(&["fit", "--data", &data, "--out", &out, "--seed", seed])
            .args(tiny("2"))
            .args(more)
            .output()
            .unwrap()
    };
    let end = || std::fs::read(Path::new(&out).join("final.safetensors")).unwrap();
    succeed(&fit("1", &[]));
    let first = end();

    let refused = fit("2", &[]);
    let after_refusal = end();
    let overwritten = fit("2", &["--overwrite"]);

    let message = text(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{message}");
    assert!(
        message.contains("--resume") && message.contains("--overwrite"),
        "{message}"
    );
    assert!(after_refusal == first, "the first run's result is touched");
    succeed(&overwritten);
    assert!(end() != first);
}

#[test]
fn killed_queue_continues_and_finishes_every_run() {
    let folder = pictures("queue");
    let (data, list, out) = (folder.at("boxes.csv"), folder.at("list"), folder.at("runs"));
    let lines = format!(
        "a --data {data} {} --checkpoint-minutes 0\nb --data {data} {} --init @a\n",
        tiny("30").join(" "),
        tiny("3").join(" ")
    );
    std::fs::write(&list, lines).unwrap();
    let queue = |more: &[&str]| {
        let mut command = train(&["queue", &list, "--out", &out]);
        command.args(more);
        command
    };
    let at = |name: &str| Path::new(&out).join(name);

    let mut child = queue(&[])
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let start = Instant::now();
    while !at("a/checkpoint.safetensors").exists() {
        assert!(start.elapsed() < Duration::from_secs(120), "no checkpoint");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!at("a/final.safetensors").exists(), "killed too late");
    let stopped = queue(&["--status"]).output().unwrap();
    succeed(&queue(&[]).output().unwrap());
    let status = queue(&["--status"]).output().unwrap();

    let states = |output: &Output| -> Vec<String> {
        let text = text(&output.stdout);
        let state = |line: &str| {
            line.split_whitespace()
                .nth(1)
                .unwrap_or_default()
                .to_owned()
        };
        text.lines().skip(1).map(state).collect()
    };
    assert_eq!(states(&stopped), ["begun", "waiting"]);
    assert_eq!(states(&status), ["finished", "finished"]);
    let read = |name: &str| Weights::read(&at(name)).unwrap();
    assert_eq!(
        read("a/weights.safetensors").header.provenance.notes["steps"],
        "30"
    );
    assert_eq!(
        read("b/weights.safetensors").header.provenance.notes["steps"],
        "3"
    );
}

#[test]
fn queue_with_a_wrong_line_is_refused_before_anything_runs() {
    let folder = pictures("wrong-queue");
    let (data, list, out) = (folder.at("boxes.csv"), folder.at("list"), folder.at("runs"));
    for (line, message) in [
        ("a --steps many", "--steps"),
        ("a --resume x", "--resume"),
        ("a --out x", "--out"),
        ("/a --steps 1", "a name"),
    ] {
        std::fs::write(&list, format!("good --data {data} --steps 1\n{line}\n")).unwrap();

        let output = train(&["queue", &list, "--out", &out]).output().unwrap();

        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(4), "{stderr}");
        assert!(stderr.contains(message), "{line:?} says {stderr:?}");
        assert!(!Path::new(&out).exists());
    }
}

#[test]
fn senseless_options_are_refused() {
    let folder = pictures("refused");
    let (data, out) = (folder.at("boxes.csv"), folder.at("out"));
    std::fs::write(
        folder.at("empty.csv"),
        "path,x,y,w,h\nmissing.png,1,1,9,9\n",
    )
    .unwrap();
    std::fs::write(folder.at("columns.csv"), "path,x,y,w\n").unwrap();
    std::fs::create_dir(folder.at("nothing")).unwrap();
    let (empty, columns, nothing) = (
        folder.at("empty.csv"),
        folder.at("columns.csv"),
        folder.at("nothing"),
    );
    let zero = format!("{data}:0");
    for (args, code, message) in [
        (&["fit", "--out", &out][..], 2, "at least one source"),
        (
            &["fit", "--out", &out, "--data", &zero],
            2,
            "a share above 0",
        ),
        (
            &["fit", "--out", &out, "--data", &data, "--batch", "1"],
            2,
            "--batch",
        ),
        (
            &["fit", "--out", &out, "--data", &data, "--ratio", "1"],
            2,
            "--ratio",
        ),
        (
            &["fit", "--out", &out, "--data", &data, "--augment", "wild"],
            2,
            "none, light, strong or shape",
        ),
        (
            &["fit", "--out", &out, "--data", &data, "--minutes", "NaN"],
            2,
            "--minutes",
        ),
        (&["fit", "--out", &out, "--data", "none.csv"], 3, "none.csv"),
        (
            &["fit", "--out", &out, "--data", &empty],
            4,
            "found none (1 skipped)",
        ),
        (
            &["fit", "--out", &out, "--data", &columns],
            4,
            "column \"h\"",
        ),
        (&["fit", "--out", &out, "--data", &nothing], 4, "found none"),
        (
            &[
                "fit",
                "--out",
                &out,
                "--data",
                &data,
                "--validate",
                &nothing,
            ],
            4,
            "sequence",
        ),
        (
            &["fit", "--out", &out, "--resume", &data],
            4,
            "a training checkpoint",
        ),
        (
            &["export", &data, "--out", &out],
            4,
            "a training checkpoint",
        ),
        (&["export", "none", "--out", &out], 3, "none"),
    ] {
        let output = train(args).output().unwrap();
        let stderr = text(&output.stderr);
        assert!(
            stderr.contains(message),
            "{args:?} says {stderr:?}, expected {message:?}"
        );
        assert_eq!(output.status.code(), Some(code), "{args:?}: {stderr}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn numbers_out_of_range_are_refused_by_the_options_name() {
    let folder = pictures("ranges");
    let (data, out) = (folder.at("boxes.csv"), folder.at("out"));
    for (command, option, value, expected) in [
        ("fit", "--search-size", "130", "--search-size: expected"),
        ("fit", "--early-size", "-1", "'-1' for '--early-size"),
        (
            "fit",
            "--warmup-share",
            "-0.5",
            "--warmup-share: expected 0 to 1, found -0.5",
        ),
        (
            "fit",
            "--floor-rate",
            "-1",
            "--floor-rate: expected 0 to 10, found -1",
        ),
        ("fit", "--max-gap", "-7", "'-7' for '--max-gap"),
        ("fit", "--max-gap", "0", "'0' for '--max-gap"),
        ("show", "--search-size", "9", "'9' for '--search-size"),
    ] {
        let args = [command, "--data", &data, "--out", &out, option, value];

        let output = train(&args).output().unwrap();

        let stderr = text(&output.stderr);
        assert!(
            stderr.contains(expected),
            "{option} {value} says {stderr:?}"
        );
        assert_eq!(output.status.code(), Some(2), "{option} {value}: {stderr}");
    }
}

#[test]
fn bad_data_are_reported_and_counted() {
    let folder = pictures("bad");
    let (out, bad, sequences) = (
        folder.at("out"),
        folder.at("bad.csv"),
        folder.at("sequences"),
    );
    let mut rows = String::from(
        "path,x,y,w,h\nmissing.png,1,1,9,9\n0.png,NaN,1,9,9\n0.png,1,1,0,9\n0.png,1,1\n",
    );
    for i in 0..4 {
        // Half a picture.
        let bytes = std::fs::read(folder.at(&format!("{i}.png"))).unwrap();
        std::fs::write(
            folder.at(&format!("half{i}.png")),
            &bytes[..bytes.len() / 2],
        )
        .unwrap();
        rows += &format!("{i}.png,30,40,30,25\nhalf{i}.png,30,40,30,25\n");
    }
    std::fs::write(&bad, &rows).unwrap();
    for (name, boxes) in [
        ("good", "30,40,30,25\nNaN,NaN,NaN,NaN\n"),
        ("short", "30,40,30,25\n30,40,30\n"),
    ] {
        let sequence = Path::new(&sequences).join(name);
        std::fs::create_dir_all(sequence.join("img")).unwrap();
        for i in 0..2 {
            std::fs::copy(
                folder.at(&format!("{i}.png")),
                sequence.join(format!("img/{i}.png")),
            )
            .unwrap();
        }
        std::fs::write(sequence.join("groundtruth_rect.txt"), boxes).unwrap();
    }
    let fit = |more: &[&str]| {
        train(&["fit", "--out", &out])
            .args(more)
            .args(TINY)
            .output()
            .unwrap()
    };
    let output = fit(&["--data", &bad, "--data", &sequences]);
    succeed(&output);
    let stderr = text(&output.stderr);
    for expected in [
        "bad.csv:2: picture",
        "missing.png is missing",
        "bad.csv:3: x is NaN",
        "bad.csv:4: box of 0 x 9 pixels",
        "bad.csv:5: 3 columns, expected 5",
        "skipped 4 in all",
        "line 2: expected x,y,w,h, found \"30,40,30\"",
        "skipped 1 in all",
        "half0.png",
        "4 pictures could not be read and were left out",
    ] {
        assert!(stderr.contains(expected), "{expected:?} is not in {stderr}");
    }

    // Nothing but half pictures, and half a checkpoint.
    let only: String = rows
        .lines()
        .filter(|line| !line.contains(".png") || line.starts_with("half"))
        .map(|line| format!("{line}\n"))
        .collect();
    std::fs::write(&bad, only).unwrap();
    let output = fit(&["--data", &bad, "--overwrite"]);
    assert!(
        text(&output.stderr).contains("readable picture, found none (4 skipped)"),
        "{}",
        text(&output.stderr)
    );
    assert_eq!(output.status.code(), Some(4));
    let checkpoint = Path::new(&out).join("final.safetensors");
    let bytes = std::fs::read(&checkpoint).unwrap();
    std::fs::write(&checkpoint, &bytes[..bytes.len() / 2]).unwrap();
    let checkpoint = checkpoint.display().to_string();
    let (data, fresh) = (folder.at("boxes.csv"), folder.at("fresh"));
    for args in [
        &["fit", "--out", &out, "--resume", &checkpoint][..],
        &[
            "fit",
            "--out",
            &fresh,
            "--data",
            &data,
            "--init",
            &checkpoint,
        ],
        &["prune", &checkpoint, "--out", &out],
        &["export", &checkpoint, "--out", &out],
    ] {
        let output = train(args).output().unwrap();
        assert_eq!(
            output.status.code(),
            Some(4),
            "{args:?}: {}",
            text(&output.stderr)
        );
        assert!(
            text(&output.stderr).contains("final.safetensors: expected a training checkpoint"),
            "{args:?}: {}",
            text(&output.stderr)
        );
    }
}

#[test]
fn pruned_networks_are_trained_and_compared() {
    let folder = pictures("prune");
    let (data, run, pruned) = (
        folder.at("boxes.csv"),
        folder.at("run"),
        folder.at("pruned.safetensors"),
    );
    succeed(
        &train(&["fit", "--data", &data, "--out", &run, "--steps", "2"])
            .args(&TINY[..2])
            .args(&TINY[4..])
            .output()
            .unwrap(),
    );
    let last = Path::new(&run)
        .join("final.safetensors")
        .display()
        .to_string();
    let weights = Path::new(&run)
        .join("weights.safetensors")
        .display()
        .to_string();

    // Of a checkpoint with its own data, and of a weights file with data that are named.
    let prune = |args: &[&str]| {
        let output = train(&["prune", "--out", &pruned, "--ratio", "0.95", "--pairs", "2"])
            .args(args)
            .output()
            .unwrap();
        succeed(&output);
        text(&output.stdout)
    };
    let table = prune(&[&last, "--layer-ratio", "head.cls2=0.92"]);
    let cells = |layer: &str| -> Vec<String> {
        let line = table
            .lines()
            .find(|line| line.starts_with(layer))
            .unwrap_or_else(|| panic!("{layer}: {table}"));
        line.split_whitespace().map(String::from).collect()
    };
    assert_eq!(cells("backbone.conv1")[..3], ["backbone.conv1", "4", "9"]);
    assert_eq!(cells("head.cls2")[..3], ["head.cls2", "20", "25"]);
    assert_eq!(cells("dr.e1.0")[..3], ["dr.e1.0", "12", "25"]);
    assert!(
        cells("backbone.conv1")[3].parse::<f64>().unwrap()
            >= cells("backbone.conv1")[4].parse().unwrap()
    );
    prune(&[&weights, "--data", &data]);
    let position = trainer::fit::Fit::resume(Path::new(&pruned))
        .unwrap()
        .position()
        .clone();
    assert_eq!(
        (position.step, &position.data[..]),
        (0, &[data.clone()][..]),
        "a run that has not begun"
    );

    let next = folder.at("next");
    let fit = train(&[
        "fit", "--data", &data, "--out", &next, "--init", &pruned, "--steps", "2",
    ])
    .args(&TINY[4..])
    .output()
    .unwrap();
    succeed(&fit);
    assert!(
        !text(&fit.stderr).contains("initialized"),
        "{}",
        text(&fit.stderr)
    );
    let found = Weights::read(&Path::new(&next).join("weights.safetensors")).unwrap();
    assert_eq!(
        found.header.architecture.widths.backbone,
        [4, 12, 19, 19, 12]
    );
    let before = &found.header.provenance.notes["before"];
    assert!(
        before.contains("weights drmim") && before.contains("pruned by rank over 2 pairs"),
        "{before}"
    );

    let study = folder.at("sweep");
    let sweep = || {
        let output = train(&[
            "sweep", "--data", &data, "--out", &study, "--init", &last, "--ratios", "0.9,0.95",
        ])
        .args([
            "--rank-pairs",
            "2",
            "--validate-flights",
            "1",
            "--validate-frames",
            "3",
            "--pairs",
            "4",
        ])
        .args(&TINY[4..])
        .output()
        .unwrap();
        succeed(&output);
        text(&output.stdout)
    };
    let first = sweep();
    assert!(
        first.starts_with("| ratio | parameters |") && first.lines().count() == 4,
        "{first}"
    );
    assert_eq!(sweep(), first, "the second time, all is there");

    for (args, code, message) in [
        (
            &["prune", &last, "--out", &pruned, "--ratio", "0.5"][..],
            2,
            "1 to 9 filters in backbone.conv1, found 48",
        ),
        (
            &[
                "prune",
                &last,
                "--out",
                &pruned,
                "--layer-ratio",
                "conv1=0.5",
            ],
            2,
            "backbone.conv1, ",
        ),
        (
            &["prune", &last, "--out", &pruned, "--ratio", "1"],
            2,
            "--ratio",
        ),
        (
            &["prune", &weights, "--out", &pruned, "--ratio", "0.9"],
            2,
            "at least one source",
        ),
        (
            &["prune", &data, "--out", &pruned],
            4,
            "convert --to trainer",
        ),
        (
            &["ablate", "--data", &data, "--out", &study, "--minutes", "1"],
            2,
            "--pairs",
        ),
        (
            &["ablate", "--data", &data, "--out", &study, "--pairs", "4"],
            2,
            "--validate",
        ),
        (
            &[
                "sweep", "--data", &data, "--out", &study, "--init", &last, "--ratios", "a",
            ],
            2,
            "--ratios",
        ),
    ] {
        let output = train(args).output().unwrap();
        let stderr = text(&output.stderr);
        assert!(
            stderr.contains(message),
            "{args:?} says {stderr:?}, expected {message:?}"
        );
        assert_eq!(output.status.code(), Some(code), "{args:?}: {stderr}");
    }
}

#[test]
fn show_writes_sheets_of_pairs() {
    let folder = pictures("show");
    let (data, out) = (folder.at("boxes.csv"), folder.at("sheets"));
    let output = train(&[
        "show",
        "--data",
        &data,
        "--out",
        &out,
        "--search-size",
        "191",
    ])
    .output()
    .unwrap();
    succeed(&output);
    let sheet = image::open(text(&output.stdout).trim()).unwrap().to_rgb8();
    assert!(sheet.pixels().any(|p| p.0 == [40, 255, 40]), "a box");
}
