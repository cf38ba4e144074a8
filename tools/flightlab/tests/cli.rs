//! The program: a flight that is measured, and ways in that lead nowhere.

use std::process::{Command, Output};
use testing::Folder;

fn flightlab(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_flightlab"))
        .args(args)
        .output()
        .unwrap()
}

/// Exit code and the errors of a run that must fail.
fn refused(args: &[&str]) -> (Option<i32>, String) {
    let output = flightlab(args);
    assert_eq!(output.stdout, b"", "{args:?} printed something");
    (
        output.status.code(),
        String::from_utf8(output.stderr).unwrap(),
    )
}

#[test]
fn a_short_flight_in_plain_view_is_followed_in_both_modes() {
    let output = flightlab(&[
        "evaluate",
        "--flights",
        "1",
        "--frames",
        "40",
        "--width",
        "160",
        "--model",
        "drmim-p75",
    ]);

    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stdout).unwrap();
    for mode in ["plain", "flight"] {
        let title = format!("Medium, {mode}: mean IoU ");
        let line = text.lines().find_map(|line| line.strip_prefix(&title));
        let iou = line.and_then(|rest| rest.split(' ').next()).unwrap();
        assert!(iou.parse::<f64>().unwrap() > 0.6, "{text}");
    }
}

#[test]
fn what_cannot_be_used_is_named_with_its_exit_code() {
    let folder = Folder::new("flightlab");
    let (text, there) = (folder.at("presence.txt"), folder.at("."));
    folder.write("presence.txt", "no coefficients");
    for (args, code, named) in [
        (&["evaluate", "--model", "nothere"][..], 4, "nothere"),
        (&["evaluate", "--flights", "0"], 3, "no clips"),
        (
            &["evaluate", "--flights", "1", "--text", &text],
            4,
            "presence",
        ),
        (&["sequences", "/nowhere"], 3, "/nowhere"),
        (&["sequences", &there], 3, &there),
        (&["calibrate", "--flights", "0"], 3, "no clips"),
    ] {
        let (found, errors) = refused(args);

        assert_eq!(found, Some(code), "{args:?}: {errors}");
        assert!(errors.contains(named), "{args:?}: {errors}");
    }
}

#[test]
fn coefficients_do_not_overwrite_what_they_are_fitted_to() {
    let folder = Folder::new("flightlab-clash");
    let model = folder.at("model.safetensors");
    folder.write("model.safetensors", "weights");

    let (code, errors) = refused(&["calibrate", "--model", &model, "--dump", &model]);

    assert_eq!(code, Some(2), "{errors}");
    assert_eq!(std::fs::read(&model).unwrap(), b"weights");
}
