//! Flight logs: done again box for box, kept apart, and refused with a reason.

use crate::support::*;
use serde_json::Value;

#[test]
fn log_is_replayed_box_for_box() {
    let folder = Folder::new("replay");
    let log = folder.file("log.jsonl");
    let frames = folder.file("frames");
    let input = format!("{FLIGHT},frames=12");
    let served = run(&[
        "serve",
        "--input",
        &input,
        "--every-frame",
        "--init",
        "140,70,40,30",
        "--log",
        &log,
        "--log-frames",
        &frames,
    ]);
    let said = String::from_utf8_lossy(&served.stderr);
    assert!(served.status.success(), "{said}");
    let reports = lines(&served.stdout);
    assert_eq!(reports.len(), 12);
    for report in &reports {
        assert_eq!(report["box"].as_array().map(Vec::len), Some(4), "{report}");
        assert_eq!(report["dropped"], 0, "{report}");
        assert_eq!(report["source"], "live", "{report}");
    }
    assert!(said.contains("12 boxes reported"), "{said}");

    for extra in [
        &["replay", &log][..],
        &["replay", &log, "--frames", &frames],
    ] {
        let replayed = run(extra);
        let said = String::from_utf8_lossy(&replayed.stderr);
        assert!(replayed.status.success(), "{said}");
        let result = &lines(&replayed.stdout)[0];
        assert_eq!(result["frames"], 12);
        assert_eq!(result["differing"], 0);
    }

    // One number changed by the smallest step is found.
    let text = std::fs::read_to_string(&log).unwrap();
    let mut tampered: Vec<String> = text.lines().map(str::to_string).collect();
    let boxed = tampered.iter().rposition(|line| line.contains("\"box\""));
    let boxed = boxed.unwrap();
    let mut line: Value = serde_json::from_str(&tampered[boxed]).unwrap();
    let x = line["box"][0].as_f64().unwrap() as f32;
    line["box"][0] = f64::from(f32::from_bits(x.to_bits() + 1)).into();
    tampered[boxed] = line.to_string();
    std::fs::write(&log, tampered.join("\n") + "\n").unwrap();
    let replayed = run(&["replay", &log]);
    assert_eq!(replayed.status.code(), Some(7));
    assert_eq!(lines(&replayed.stdout)[0]["differing"], 1);
}

#[test]
fn live_frames_are_replayed_with_the_times_between_them() {
    let folder = Folder::new("times");
    let log = folder.file("log.jsonl");
    let input = format!("{FLIGHT},frames=12");
    for (extra, expected) in [
        (&["--fps", "8", "--every-frame"][..], Some(125_000)),
        (&["--fps", "8"], None),
    ] {
        let _ = std::fs::remove_file(&log);
        let mut args = vec!["serve", "--input", &input, "--init", "140,70,40,30"];
        args.extend(["--threshold", "coast=0.25", "--threshold", "confirm=2"]);
        args.extend([
            "--deadline-ms",
            "300",
            "--max-age-ms",
            "20000",
            "--log",
            &log,
        ]);
        args.extend(extra);
        let served = run(&args);
        assert!(
            served.status.success(),
            "{}",
            String::from_utf8_lossy(&served.stderr)
        );

        let replayed = run(&["replay", &log]);

        let result = &lines(&replayed.stdout)[0];
        assert_eq!(result["differing"], 0, "{extra:?}: {result}");
        let text = std::fs::read_to_string(&log).unwrap();
        let logged = text
            .lines()
            .map(|line| serde_json::from_str::<Value>(line).unwrap());
        let times: Vec<u64> = logged
            .filter_map(|line| line["elapsed_us"].as_u64())
            .collect();
        assert_eq!(times.len() as u64, result["frames"].as_u64().unwrap());
        assert!(
            text.contains(r#""thresholds":[["coast",0.25],["confirm",2.0]]"#),
            "{text}"
        );
        match expected {
            Some(expected) => assert!(times.iter().all(|time| *time == expected), "{times:?}"),
            None => {
                // A live frame comes when it comes, but eight a second are not thirty.
                let mean = times[1..].iter().sum::<u64>() / (times.len() as u64 - 1);
                assert!(mean > 60_000, "{times:?}");
            }
        }
    }
}

#[test]
fn second_flight_overwrites_nothing_of_the_first() {
    let folder = Folder::new("second");
    let log = folder.file("f.jsonl");
    let frames = folder.file("frames");
    for seed in [7, 8] {
        let input = format!("flight:seed={seed},difficulty=easy,size=320x180,frames=4");
        let served = run(&[
            "serve",
            "--input",
            &input,
            "--every-frame",
            "--init",
            "140,70,40,30",
            "--quiet",
            "--log",
            &log,
            "--log-frames",
            &frames,
        ]);
        assert!(served.status.success());
    }

    for (log, frames) in [("f.jsonl", "frames"), ("f-1.jsonl", "frames-1")] {
        let log = folder.file(log);
        let frames = folder.file(frames);
        let replayed = run(&["replay", &log, "--frames", &frames]);
        let said = String::from_utf8_lossy(&replayed.stderr);
        assert!(replayed.status.success(), "{log}: {said}");
        assert_eq!(lines(&replayed.stdout)[0]["frames"], 4);
    }
}

#[test]
fn bad_logs_and_options_are_refused_with_a_reason() {
    let folder = Folder::new("bad");
    let log = folder.file("bad.jsonl");
    let head = concat!(
        r#"{"log":"track-cpu","version":1,"input":"flight:seed=7,size=64x64,frames=2","#,
        r#""repeats":true,"model":null,"isa":"portable","precision":"f32","mode":"flight"}"#
    );
    for (text, part) in [
        (String::new(), "is empty"),
        ("{}\n".into(), "expected track-cpu"),
        (head.replace("1,", "99,") + "\n", "version 99"),
        (format!("{head}\nnonsense\n"), "no JSON"),
        (
            format!("{head}\n{{\"frame\":0}}\n"),
            "does not belong in a log",
        ),
        (format!("{head}\n{{\"frame\":9,\"asked\":[]}}\n"), "frame 9"),
        (
            format!("{head}\n{{\"continued\":\"../x\"}}\n"),
            "another folder",
        ),
        (
            format!("{head}\n{{\"continued\":\"bad.jsonl\"}}\n"),
            "too many files",
        ),
        (head.replace("flight\"}", "other\"}") + "\n", "mode"),
        (head.replace("true", "false") + "\n", "--frames"),
    ] {
        std::fs::write(&log, text).unwrap();

        let output = run(&["replay", &log]);

        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(3), "{part}: {said}");
        assert!(said.contains(part), "{part}: {said}");
    }
    for (args, code, part) in [
        (&["--input", "flight:color=red"][..], 3, "color"),
        (&["--gimbal"], 2, "--mavlink"),
        (
            &["--threshold", "coast=-1"],
            2,
            "expected 0 to 3600 seconds",
        ),
        (&["--threshold", "color=1"], 2, "expected one of present"),
        (&["--input", FLIGHT, "--http", "0.0.0.0:0"], 5, "--token"),
        (&["--input", FLIGHT, "--mavlink", "nonsense"], 5, "nonsense"),
        (
            &["--input", FLIGHT, "--log", "/no/such/folder/f.jsonl"],
            5,
            "/no/such/folder",
        ),
        (&["--input", "no-such-folder"], 3, "no-such-folder"),
    ] {
        let output = run(&[&["serve"], args].concat());

        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{args:?}: {said}");
        assert!(said.contains(part), "{args:?}: {said}");
    }
}
