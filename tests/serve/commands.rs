//! Commands as JSON lines, from a detector that hands its target over.

use std::io::{BufRead, BufReader, Write};
use std::net::UdpSocket;
use std::os::unix::net::UnixStream;
use std::process::{Command, Stdio};
use std::time::Duration;

use serde_json::Value;

use crate::support::*;

/// The target of [`FLIGHT`] in pixels, as a detector says it.
const START: &str = r#"{"id": "a", "command": "start", "box": [140, 70.2, 40, 29.8]}"#;
const POINT: &str = r#"{"id": 2, "command": "start", "point": [0.5, 0.47]}"#;
const STOP: &str = r#"{"command": "stop"}"#;
const STATE: &str = r#"{"command": "state"}"#;

/// Hands a target over, as soon as frames come, and takes it back.
fn hand_over(mut ask: impl FnMut(&str) -> Value) {
    // Frames may not have come yet.
    let started = until(|| Some(ask(START)).filter(|answer| answer["done"] == true));
    assert_eq!(started.expect("it is started")["id"], "a");
    let followed = until(|| Some(ask(STATE)).filter(|state| !state["report"]["box"].is_null()));
    assert_eq!(
        followed.expect("it is followed")["report"]["state"],
        "tracking"
    );
    let by_point = ask(POINT);
    assert_eq!(
        (&by_point["id"], &by_point["done"]),
        (&2.into(), &true.into())
    );

    let whole = ask(r#"{"command": "start", "box": [0, 0, 320, 180]}"#);
    let whole = whole["error"].as_str().unwrap_or_default();
    assert!(whole.contains("whole frame"), "{whole}");
    let senseless = ask("{}")["error"].to_string();
    assert!(senseless.contains("state"), "{senseless}");

    assert_eq!(ask(STOP)["done"], true);
    let idle = until(|| Some(ask(STATE)).filter(|state| state["report"]["state"] == "idle"));
    assert!(idle.is_some(), "never stopped");
}

#[test]
fn detector_hands_a_target_over_by_datagrams() {
    let port = free_udp_port();
    let place = format!("udp:{port}");
    let serving = Serving::start(&[&SLOW_FLIGHT[..], &["--commands", &place]].concat());
    serving.wait_for("commands: ");
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(("127.0.0.1", port)).unwrap();
    socket
        .set_read_timeout(Some(Duration::from_secs(10)))
        .unwrap();

    hand_over(|line| {
        socket.send(line.as_bytes()).unwrap();
        let mut answer = [0; 4096];
        let count = socket.recv(&mut answer).unwrap();
        serde_json::from_slice(&answer[..count]).unwrap()
    });

    assert_eq!(serving.end(), Some(0));
}

#[test]
fn detector_hands_a_target_over_through_a_unix_socket() {
    let folder = Folder::new("commands");
    let path = folder.file("socket");
    let place = format!("unix:{path}");
    // An earlier run that was killed has left its socket.
    drop(std::os::unix::net::UnixListener::bind(&path).unwrap());
    let serving = Serving::start(&[&SLOW_FLIGHT[..], &["--commands", &place]].concat());
    serving.wait_for("commands: ");
    let mut stream = UnixStream::connect(&path).unwrap();
    let mut answers = BufReader::new(stream.try_clone().unwrap());
    let mut ask = |line: &str| -> Value {
        writeln!(stream, "{line}").unwrap();
        let mut answer = String::new();
        answers.read_line(&mut answer).unwrap();
        serde_json::from_str(&answer).unwrap()
    };

    let long = ask(&"a".repeat(5000))["error"].to_string();
    hand_over(ask);

    assert!(long.contains("at most 4096 bytes"), "{long}");
    let second = run(&["serve", "--input", FLIGHT, "--commands", &place]);
    let said = String::from_utf8_lossy(&second.stderr);
    assert!(said.contains("another program listens there"), "{said}");
    assert_eq!(serving.end(), Some(0));
    assert!(
        !std::path::Path::new(&path).exists(),
        "the socket is removed"
    );
}

#[test]
fn detector_hands_a_target_over_on_standard_input() {
    let mut command = Command::new(PROGRAM);
    command
        .arg("serve")
        .args(SLOW_FLIGHT)
        .args(["--commands", "-"]);
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut serving = Serving::spawn(command);
    let mut input = serving.child.stdin.take().unwrap();
    let mut answers = BufReader::new(serving.child.stdout.take().unwrap());

    hand_over(|line| {
        writeln!(input, "{line}").unwrap();
        let mut answer = String::new();
        answers.read_line(&mut answer).unwrap();
        serde_json::from_str(&answer).unwrap()
    });

    drop(input);
    std::thread::sleep(Duration::from_millis(300));
    assert!(serving.is_running(), "the end of its input does not end it");
    assert_eq!(serving.end(), Some(0));
}

#[test]
fn standard_input_cannot_hold_frames_and_commands() {
    let refused = run(&["serve", "--input", "-", "--commands", "-"]);

    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(said.contains("standard input holds the frames"), "{said}");
    assert!(!refused.status.success());
}
