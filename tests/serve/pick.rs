//! `track` without a box: drawn on a web page if a terminal is there, refused otherwise.

use std::process::{Command, Stdio};

use crate::support::*;

/// A folder of five pictures of a [`PipeCamera`].
fn pictures(name: &str) -> Folder {
    let folder = Folder::new(name);
    for index in 0..5 {
        let header = b"P5 160 120 255\n".to_vec();
        let picture = [header, PipeCamera::frame()].concat();
        std::fs::write(folder.path().join(format!("{index}.pgm")), picture).unwrap();
    }
    folder
}

#[test]
fn box_that_is_drawn_on_the_page_is_tracked() {
    if Command::new("script").arg("--version").output().is_err() {
        println!("skipped: script, which makes a terminal, is not installed");
        return;
    }
    let folder = pictures("pick");
    let outputs = Folder::new("picked");
    let out = outputs.file("boxes.txt");
    let input = folder.path().display();
    let line = format!("{PROGRAM} track --input {input} --out {out}");
    let mut command = Command::new("script");
    // Standard error is the terminal's, which `script` copies to its standard output.
    command.args(["-qec", &format!("{line} 2>&1"), "/dev/null"]);
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    command.stdin(Stdio::null()).stdout(Stdio::null());
    let log = outputs.file("said");
    command.stdout(std::fs::File::create(&log).unwrap());
    let tracking = Serving::spawn(command);

    let said = || std::fs::read_to_string(&log).unwrap();
    let url = until(|| {
        let said = said();
        let after = said.split("web page: ").nth(1)?;
        let line = after.split_once('\n')?.0;
        Some(line.trim().to_string())
    });
    let (page, token) = Page::at(&url.expect("an address"));
    let whole = r#"{"rectangle": [0, 0, 1, 1]}"#;
    assert!(page.get("/").contains("<canvas"));
    let frame = page.get("/frame");
    assert_eq!(status(frame.as_bytes()), 200, "{frame}");
    assert_eq!(page.post("/start", "wrong-token", whole), 403);
    assert_eq!(page.post("/start", &token, whole), 409);
    let start = r#"{"box": [110, 72, 24, 24], "frame": 0}"#;
    assert_eq!(page.post("/start", &token, start), 202);

    assert_eq!(tracking.end_of_itself(), Some(0));
    let boxes = std::fs::read_to_string(&out).unwrap();
    assert_eq!(boxes.lines().count(), 5, "{boxes}");
    assert_eq!(boxes.lines().next(), Some("110.000,72.000,24.000,24.000"));
    assert!(said().contains("--init 110,72,24,24"), "{}", said());
}

#[test]
fn box_is_demanded_where_no_terminal_is() {
    let folder = pictures("demanded");
    let input = folder.path().to_str().unwrap();

    let refused = run(&["track", "--input", input]);

    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(said.contains("--init <X,Y,W,H>"), "{said}");
    assert_eq!(refused.status.code(), Some(2));
}
