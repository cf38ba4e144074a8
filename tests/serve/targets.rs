//! Several targets at a time.

use serde_json::Value;

use crate::support::*;

/// The target of [`FLIGHT`], and a place on the ground.
const BOXES: [&str; 2] = ["140,70,40,30", "60,90,36,36"];

/// The lines of a flight of which every frame is tracked.
fn fly(extra: &[&str]) -> Vec<Value> {
    let input = format!("{FLIGHT},frames=20");
    let served = run(&[&["serve", "--input", &input, "--every-frame"], extra].concat());
    let said = String::from_utf8_lossy(&served.stderr);
    assert!(served.status.success(), "{said}");
    lines(&served.stdout)
}

#[test]
fn two_targets_are_followed_as_each_alone_and_replayed() {
    let folder = Folder::new("targets");
    let log = folder.file("f.jsonl");
    let [first, second] = BOXES;

    let both = fly(&[
        "--targets",
        "3",
        "--init",
        first,
        "--init",
        second,
        "--log",
        &log,
    ]);
    let alone = BOXES.map(|target| fly(&["--init", target]));

    assert_eq!(both.len(), 2 * 20);
    for (frame, lines) in both.chunks_exact(2).enumerate() {
        for (index, line) in lines.iter().enumerate() {
            let single = &alone[index][frame];
            assert_eq!(line["target"], index + 1, "{line}");
            for field in ["frame", "box", "presence", "state"] {
                assert_eq!(line[field], single[field], "{field} of {line}");
            }
            assert_eq!(single.get("target"), None, "a single target has no number");
        }
    }
    let replayed = run(&["replay", &log]);
    let said = String::from_utf8_lossy(&replayed.stderr);
    assert!(replayed.status.success(), "{said}");
    assert_eq!(lines(&replayed.stdout)[0]["frames"], 20);

    // A box of the second target that differs by the smallest step is found.
    let text = std::fs::read_to_string(&log).unwrap();
    let mut logged = lines(text.as_bytes());
    let x = &mut logged.last_mut().unwrap()["targets"][1]["box"][0];
    *x = f64::from((x.as_f64().unwrap() as f32).next_up()).into();
    let tampered: Vec<String> = logged.iter().map(|line| line.to_string() + "\n").collect();
    std::fs::write(&log, tampered.concat()).unwrap();
    let replayed = run(&["replay", &log]);
    assert_eq!(lines(&replayed.stdout)[0]["differing"], 1);
}

#[test]
fn stop_of_one_target_leaves_the_others() {
    let page = Page::new();
    let args = [&SLOW_FLIGHT[..], &page.options(), &["--targets", "2"]].concat();
    let serving = Serving::start(&args);
    serving.wait_for("web page: ");
    let ids = |state: &Value| -> Vec<u64> {
        let targets = state["targets"].as_array().into_iter().flatten();
        targets.map(|t| t["target"].as_u64().unwrap()).collect()
    };
    let wait_for = |expected: &[u64]| {
        let found = until(|| Some(page.state()).filter(|state| ids(state) == expected));
        found.unwrap_or_else(|| panic!("never {expected:?}: {}", page.state()))
    };
    let start = |target: &str| {
        let body = format!(r#"{{"box": [{target}]}}"#);
        page.post("/start", Page::TOKEN, &body)
    };

    until(|| page.state()["frame"].as_u64().filter(|frame| *frame > 0)).expect("frames come");
    assert_eq!(start(BOXES[0]), 202);
    assert_eq!(start(BOXES[1]), 202);
    let two = wait_for(&[1, 2]);
    assert_eq!(two["room"], 2);
    assert_eq!(two["target"], 1, "the state tells of the first");
    assert_eq!(start(BOXES[0]), 409);
    serving.wait_for("all 2 targets are in use");
    let metrics = page.get("/metrics");
    let labeled = "track_cpu_state{target=\"2\",state=\"idle\"} 0";
    assert!(metrics.contains(labeled), "{metrics}");

    assert_eq!(page.post("/stop", Page::TOKEN, r#"{"target": 1}"#), 202);
    let left = wait_for(&[2]);
    assert_eq!(left["target"], 2, "{left}");
    assert_eq!(page.post("/stop", Page::TOKEN, r#"{"target": 9}"#), 409);
    assert_eq!(start(BOXES[0]), 202, "the lowest free one");
    wait_for(&[1, 2]);
    assert_eq!(page.post("/stop", Page::TOKEN, ""), 202);
    wait_for(&[]);
    assert_eq!(serving.end(), Some(0));
}

#[test]
fn more_boxes_than_targets_are_refused() {
    let refused = run(&[
        "serve", "--input", FLIGHT, "--init", BOXES[0], "--init", BOXES[1],
    ]);

    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(
        said.contains("2 boxes, expected no more than --targets"),
        "{said}"
    );
    assert_eq!(refused.status.code(), Some(6));
}
