//! Faults in flight: none ends the program, and nothing moves by what is no longer seen.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::net::UnixDatagram;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::*;
use serde_json::Value;

use crate::support::*;

const TRACK: MavCmd = MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE;
/// The stall time-out of these tests.
const STALL: Duration = Duration::from_millis(1500);

/// The rates of a message to the gimbal.
fn rates(message: &MavMessage) -> Option<(f32, f32)> {
    match message {
        MavMessage::GIMBAL_MANAGER_SET_PITCHYAW(r) => Some((r.pitch_rate, r.yaw_rate)),
        _ => None,
    }
}

#[test]
fn gimbal_rests_and_every_output_says_so_when_frames_stop() {
    let folder = Folder::new("stopped");
    let log = folder.file("f.jsonl");
    let socket = folder.file("notify");
    let systemd = UnixDatagram::bind(&socket).unwrap();
    systemd.set_nonblocking(true).unwrap();
    let (station, address) = GroundStation::listen();
    let page = Page::new();
    let mut command = Command::new(PROGRAM);
    command.arg("serve").args(PipeCamera::OPTIONS);
    command.args(["--model", "drmim-p75", "--max-age-ms", "1000"]);
    command.args(["--stall-ms", "1500", "--log", &log]);
    command.args(["--mavlink", &address, "--gimbal", "--hfov", "62"]);
    command.args(page.options()).env("NOTIFY_SOCKET", &socket);
    command.stdin(Stdio::piped()).stdout(Stdio::piped());
    let mut serving = Serving::spawn(command);
    let camera = PipeCamera::start(serving.child.stdin.take().unwrap());
    let mut out = BufReader::new(serving.child.stdout.take().unwrap());
    let printed = std::thread::spawn(move || {
        let mut text = Vec::new();
        let _ = out.read_to_end(&mut text);
        text
    });
    station.insist(TRACK, PipeCamera::TARGET);
    station.wait("rates that turn the gimbal", |message| {
        rates(&message).filter(|(pitch, yaw)| pitch.abs() + yaw.abs() > 0.01)
    });

    // Frames stop, and the pipe stays open: a camera that hangs.
    camera.turn(false);
    let stopped = Instant::now();
    let mut last_moving = stopped;
    let mut zeros = 0;
    let mut after_rest = 0;
    let mut flags = Vec::new();
    let mut states = Vec::new();
    let mut is_released = false;
    while stopped.elapsed() < 3 * STALL {
        let Some(message) = station.next() else {
            continue;
        };
        match rates(&message) {
            Some((0.0, 0.0)) => zeros += 1,
            Some(_) => last_moving = Instant::now(),
            None => {}
        }
        if stopped.elapsed() > 2 * STALL && rates(&message).is_some() {
            after_rest += 1;
        }
        match message {
            MavMessage::CAMERA_TRACKING_IMAGE_STATUS(status) => {
                flags.push(status.tracking_status.bits());
            }
            MavMessage::HEARTBEAT(heartbeat) => states.push(heartbeat.system_status),
            MavMessage::COMMAND_LONG(command) => is_released |= command.param1 == -3.0,
            _ => {}
        }
    }
    assert!(serving.is_running(), "{}", serving.said());
    let moved = last_moving - stopped;
    assert!(moved < STALL, "the gimbal moved for {moved:?}");
    assert!(zeros > 0, "zero rates were sent");
    assert_eq!(after_rest, 0, "then silence");
    assert!(is_released, "control is given back");
    assert!(flags.contains(&9), "coasting at most: {flags:?}");
    assert_eq!(flags.last(), Some(&2), "then an error: {flags:?}");
    assert_eq!(states.last(), Some(&MavState::MAV_STATE_CRITICAL));

    let state = page.state();
    assert_eq!(state["source"], "stalled", "{state}");
    assert_eq!(state["state"], "stale", "{state}");
    assert!(state["box"].is_null(), "{state}");
    assert!(state["age_ms"].as_f64() > Some(3000.0), "{state}");
    assert_eq!(
        page.post("/start", Page::TOKEN, r#"{"point": [0.5, 0.5]}"#),
        503
    );
    let events = page.request(&page.get_text("/events"), |answer| {
        contains(answer, b"\"source\":\"stalled\"")
    });
    assert!(contains(&events, b"\"source\":\"stalled\""));
    serving.wait_for("source: stalled");

    // Frames come again: nobody has to do anything.
    camera.turn(true);
    station.wait_for_status(1);
    assert_eq!(page.state()["source"], "live");
    station.wait("rates", |message| rates(&message));
    assert_eq!(serving.end(), Some(0));

    let printed = lines(&printed.join().unwrap());
    let stalled = printed.iter().find(|line| line["source"] == "stalled");
    assert!(stalled.is_some_and(|line| line["box"].is_null()));
    let logged = std::fs::read(&log).unwrap();
    let logged = lines(&logged);
    let words: Vec<&str> = logged
        .iter()
        .filter_map(|line| line["source"].as_str())
        .collect();
    assert_eq!(words, ["live", "stalled", "live"]);
    let told = notifications(&systemd);
    let ready = told.iter().position(|text| text == "READY=1").unwrap();
    let stalled = told.iter().position(|text| text == "STATUS=source stalled");
    assert!(stalled > Some(ready), "{told:?}");
    let after = &told[stalled.unwrap() + 1..];
    let next = after.iter().find(|text| *text != "STOPPING=1");
    assert_eq!(next.map(String::as_str), Some("STATUS=source live"));
}

fn notifications(systemd: &UnixDatagram) -> Vec<String> {
    let mut told = Vec::new();
    let mut buffer = [0; 256];
    while let Ok(count) = systemd.recv(&mut buffer) {
        told.push(String::from_utf8_lossy(&buffer[..count]).into_owned());
    }
    told
}

#[test]
fn ready_is_said_with_the_first_frame_and_not_before() {
    let folder = Folder::new("ready");
    let socket = folder.file("notify");
    let systemd = UnixDatagram::bind(&socket).unwrap();
    systemd.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut command = Command::new(PROGRAM);
    command.args(["serve", "--input", "/dev/video77", "--quiet"]);
    command.env("NOTIFY_SOCKET", &socket).stdin(Stdio::null());
    let serving = Serving::spawn(command);
    let mut told = Vec::new();
    let mut buffer = [0; 256];
    while told.len() < 6 {
        let Ok(count) = systemd.recv(&mut buffer) else {
            break;
        };
        told.push(String::from_utf8_lossy(&buffer[..count]).into_owned());
    }

    assert!(told.iter().any(|t| t.starts_with("STATUS=source waiting")));
    assert!(told.contains(&"WATCHDOG=1".into()), "{told:?}");
    assert!(told.iter().any(|t| t.starts_with("EXTEND_TIMEOUT_USEC=")));
    assert!(!told.contains(&"READY=1".into()), "{told:?}");
    assert_eq!(serving.end(), Some(0));
}

#[test]
fn full_disk_is_said_once_and_tracking_goes_on() {
    // A limit on the size of files fails writes as a full disk does, and needs no rights.
    for (blocks, is_written) in [(8, true), (0, false)] {
        let folder = Folder::new(&format!("full-{blocks}"));
        let log = folder.file("f.jsonl");
        let frames = folder.file("frames");
        let input = format!("{FLIGHT},frames=60");
        let limit = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\"");
        let output = Command::new("sh")
            .args(["-c", &limit, "sh", PROGRAM, "serve", "--input", &input])
            .args(["--init", "140,70,40,30", "--model", "drmim-p75"])
            .args(["--every-frame", "--log", &log, "--log-frames", &frames])
            .output()
            .unwrap();

        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{blocks}: {said}");
        assert_eq!(lines(&output.stdout).len(), 60, "{blocks}");
        let complaints = said.lines().filter(|line| line.contains("jsonl: "));
        assert_eq!(complaints.count(), 1, "{blocks}: {said}");
        let pictures = said.lines().filter(|line| line.contains(".png: "));
        assert!(pictures.count() <= 1, "{blocks}: {said}");
        assert_eq!(std::fs::metadata(&log).is_ok(), is_written, "{blocks}");
    }
}

#[test]
fn silent_stream_is_closed_and_opened_again() {
    let folder = Folder::new("silent");
    let starts = folder.file("starts");
    // Three frames, and then nothing: the cable is out, but the connection stays.
    let frame = "printf 'P6\\n64 64\\n255\\n'; head -c 12288 /dev/zero";
    let arguments = folder.file("arguments");
    let script = format!(
        "echo $$ >> {starts}; echo \"$@\" > {arguments}
         for i in 1 2 3; do {frame}; done; exec sleep 600"
    );
    let path = fake_ffmpeg(&folder, &script);
    let (station, address) = GroundStation::listen();
    let mut command = Command::new(PROGRAM);
    command.args(["serve", "--input", "tcp://127.0.0.1:9", "--quiet"]);
    command.args(["--stall-ms", "500", "--mavlink", &address]);
    command.env("PATH", path).stdin(Stdio::null());
    let mut serving = Serving::spawn(command);

    let count = || std::fs::read_to_string(&starts).unwrap_or_default();
    let began = Instant::now();
    let opened = until(|| (count().lines().count() >= 3).then(|| began.elapsed()));

    let opened = opened.expect("opened three times");
    assert!(opened < Duration::from_secs(20), "{opened:?}");
    serving.wait_for("source: no frame for 0.5 s; opening it again");
    station.wait("heartbeat that says so", |message| match message {
        MavMessage::HEARTBEAT(heartbeat) => {
            (heartbeat.system_status == MavState::MAV_STATE_CRITICAL).then_some(())
        }
        _ => None,
    });
    let arguments = std::fs::read_to_string(&arguments).unwrap();
    let is_quick = arguments.contains("-flags low_delay -thread_type slice -r 25 -i ");
    assert!(is_quick, "decoded without delay: {arguments}");
    assert!(serving.is_running());
    assert_eq!(serving.end(), Some(0));
    let left: Vec<String> = count()
        .lines()
        .filter(|pid| is_alive(pid))
        .map(str::to_string)
        .collect();
    assert!(left.is_empty(), "processes are left: {left:?}");
}

#[test]
fn link_that_goes_down_comes_back() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcpout:{}", listener.local_addr().unwrap());
    let page = Page::new();
    let args = ["--input", FLIGHT, "--fps", "10", "--quiet"];
    let mut serving =
        Serving::start(&[&args[..], &["--mavlink", &address], &page.options()].concat());
    for _ in 0..2 {
        let (mut stream, _) = listener.accept().unwrap();
        let mut message = [0; 1];
        stream.read_exact(&mut message).unwrap();
        assert_eq!(message, [0xfd]);
        drop(stream);
    }
    serving.wait_for("opening it again");
    let before = page.state()["frame"].as_u64();
    let later = until(|| Some(page.state()["frame"].as_u64()).filter(|frame| *frame > before));
    assert!(later.is_some(), "frames go on");
    assert!(serving.is_running());
}

#[test]
fn readers_that_never_read_hold_up_nothing() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcpout:{}", listener.local_addr().unwrap());
    let page = Page::new();
    let mut command = Command::new(PROGRAM);
    command.args(["serve", "--input", FLIGHT, "--fps", "200"]);
    command.args(["--max-age-ms", "5000", "--mavlink", &address]);
    command.args(page.options()).stdin(Stdio::null());
    command.stdout(Stdio::piped()); // never read: the pipe fills up
    let mut serving = Serving::spawn(command);
    serving.wait_for("web page: ");
    let mut asleep = Vec::new();
    for path in ["/video", "/events", "/video", "/events"] {
        let mut stream = TcpStream::connect(&page.address).unwrap();
        stream.write_all(page.get_text(path).as_bytes()).unwrap();
        asleep.push(stream);
    }

    // Long enough to fill the pipe with lines, and then for as many frames again.
    let frames = |count| {
        until(|| {
            page.state()["frame"]
                .as_u64()
                .filter(|frame| *frame > count)
        })
    };
    let full = until(|| serving.said().contains("its reader is slow").then_some(()));
    assert!(full.is_some(), "{}", serving.said());
    let now = page.state()["frame"].as_u64().unwrap_or(0);
    assert!(frames(now + 50).is_some(), "frames go on");

    assert_eq!(page.post("/stop", Page::TOKEN, ""), 202);
    assert!(serving.is_running());
    assert_eq!(serving.end(), Some(0));
}

#[test]
fn closed_standard_output_ends_nothing_while_others_listen() {
    let page = Page::new();
    let mut command = Command::new(PROGRAM);
    command.args(["serve", "--input", FLIGHT, "--fps", "30"]);
    command.args(["--max-age-ms", "5000"]).args(page.options());
    command.stdin(Stdio::null()).stdout(Stdio::piped());
    let mut serving = Serving::spawn(command);
    let mut out = BufReader::new(serving.child.stdout.take().unwrap());
    let mut line = String::new();
    out.read_line(&mut line).unwrap();
    drop(out);

    serving.wait_for("its reader has gone; tracking goes on");
    assert_eq!(page.post("/stop", Page::TOKEN, ""), 202);
    assert!(serving.is_running());
}

#[test]
fn killed_program_starts_again_and_leaves_whole_logs() {
    let folder = Folder::new("killed");
    let log = folder.file("f.jsonl");
    let frames = folder.file("frames");
    let args = [
        "--log",
        &log,
        "--log-frames",
        &frames,
        "--max-age-ms",
        "5000",
    ];
    for name in ["f.jsonl", "f-1.jsonl"] {
        let init = ["--init", "110,72,24,24", "--model", "drmim-p75", "--quiet"];
        let (serving, _camera) = serve_pipe(&[&args[..], &init].concat());
        let path = folder.file(name);
        let written = until(|| {
            let text = std::fs::read_to_string(&path).ok()?;
            (text.lines().count() > 12).then_some(())
        });
        assert!(written.is_some(), "{}", serving.said());
        serving.signal("-KILL");
        drop(serving);
    }

    for (log, frames) in [("f.jsonl", "frames"), ("f-1.jsonl", "frames-1")] {
        let log = folder.file(log);
        let text = std::fs::read_to_string(&log).unwrap();
        let entries = text
            .lines()
            .filter_map(|l| serde_json::from_str::<Value>(l).ok());
        let saved = entries.filter(|line| line["saved"] == true).count();
        assert!(saved > 3, "{log}: {saved} frames");
        // The last frames may still have been on their way to the disk.
        let whole: Vec<&str> = text.lines().take(8).collect();
        std::fs::write(&log, whole.join("\n") + "\n").unwrap();
        let replayed = run(&["replay", &log, "--frames", &folder.file(frames)]);
        let said = String::from_utf8_lossy(&replayed.stderr);
        assert!(replayed.status.success(), "{log}: {said}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn ffmpeg_dies_with_a_killed_program() {
    if Command::new("setpriv").arg("--version").output().is_err() {
        eprintln!("skipped: no setpriv on this machine");
        return;
    }
    let folder = Folder::new("orphan");
    let pid = folder.file("pid");
    let path = fake_ffmpeg(&folder, &format!("echo $$ > {pid}; exec sleep 600"));
    let mut command = Command::new(PROGRAM);
    command.args(["serve", "--input", "tcp://127.0.0.1:9", "--quiet"]);
    command.env("PATH", path).stdin(Stdio::null());
    let serving = Serving::spawn(command);
    let ffmpeg = until(|| {
        let pid = std::fs::read_to_string(&pid).ok()?;
        Some(pid.trim().to_string()).filter(|pid| !pid.is_empty())
    });
    let ffmpeg = ffmpeg.expect("ffmpeg is started");
    assert!(is_alive(&ffmpeg));

    serving.signal("-KILL");
    drop(serving);

    let gone = until(|| (!is_alive(&ffmpeg)).then_some(()));
    assert!(gone.is_some(), "ffmpeg is left as an orphan");
}

/// A library that moves the wall clock of a program by as many seconds as a file says.
const CLOCK: &str = r#"
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
int clock_gettime(clockid_t id, struct timespec *now) {
    long result = syscall(SYS_clock_gettime, id, now), seconds = 0;
    if (result == 0 && id == CLOCK_REALTIME) {
        FILE *file = fopen(getenv("CLOCK_JUMP"), "r");
        if (file != NULL) {
            if (fscanf(file, "%ld", &seconds) == 1) now->tv_sec += seconds;
            fclose(file);
        }
    }
    return (int)result;
}
"#;

#[cfg(target_os = "linux")]
#[test]
fn clock_that_jumps_changes_nothing() {
    let folder = Folder::new("clock");
    let source = folder.file("clock.c");
    let library = folder.file("clock.so");
    std::fs::write(&source, CLOCK).unwrap();
    let compiled = Command::new("cc")
        .args(["-shared", "-fPIC", "-o", &library, &source])
        .output();
    if !compiled.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: no C compiler on this machine");
        return;
    }
    let jump = folder.file("jump");
    let log = folder.file("f.jsonl");
    let (station, address) = GroundStation::listen();
    let page = Page::new();
    let mut command = Command::new(PROGRAM);
    command.arg("serve").args(SLOW_FLIGHT).args(page.options());
    command.args(["--mavlink", &address, "--log", &log]);
    command.env("LD_PRELOAD", &library).env("CLOCK_JUMP", &jump);
    command.stdin(Stdio::null()).stdout(Stdio::null());
    let serving = Serving::spawn(command);
    station.insist(TRACK, RECTANGLE);
    station.wait_for_status(1);

    // Ten years ahead, as when a receiver first knows the time; then back before the start.
    for seconds in ["315360000", "-86400"] {
        std::fs::write(&jump, seconds).unwrap();
        let before = page.state()["frame"].as_u64();
        let later = until(|| {
            let state = page.state();
            (state["frame"].as_u64() > before.map(|frame| frame + 20)).then_some(state)
        });

        let state = later.expect("frames go on");
        assert_eq!(state["source"], "live", "{seconds}: {state}");
        assert!(state["age_ms"].as_f64() < Some(5000.0), "{state}");
        assert_ne!(station.status().tracking_status.bits(), 0, "{seconds}");
        assert_eq!(page.post("/stop", Page::TOKEN, ""), 202);
        station.insist(TRACK, RECTANGLE);
    }

    assert_eq!(serving.end(), Some(0));
    let logged = lines(&std::fs::read(&log).unwrap());
    let times: Vec<f64> = logged
        .iter()
        .filter_map(|line| line["time_ms"].as_f64())
        .collect();
    assert!(times.len() > 40);
    assert!(times.windows(2).all(|pair| pair[0] <= pair[1]), "{times:?}");
    assert!(times.last() < Some(&600_000.0), "{times:?}");
}

#[test]
fn camera_that_repeats_one_frame_is_called_frozen_and_tracking_goes_on() {
    let (station, address) = GroundStation::listen();
    let page = Page::new();
    let options = [
        "--mavlink",
        &address,
        "--stall-ms",
        "1500",
        "--max-age-ms",
        "1000",
    ];
    let (serving, camera) = serve_pipe(&[&options[..], &page.options()].concat());
    station.insist(TRACK, PipeCamera::TARGET);

    camera.repeat(true);
    let frozen = until(|| Some(page.state()).filter(|state| state["source"] == "frozen"));
    let tracked = until(|| Some(page.state()).filter(|state| !state["box"].is_null()));
    station.insist(TRACK, PipeCamera::TARGET);
    camera.repeat(false);
    let live = until(|| Some(page.state()).filter(|state| state["source"] == "live"));

    assert!(frozen.is_some(), "never frozen");
    assert_eq!(tracked.expect("tracking goes on")["source"], "frozen");
    assert!(live.is_some(), "never live again");
    let said = serving.said();
    assert!(said.contains("frozen, the same frame for 1.5 s"), "{said}");
    assert_eq!(serving.end(), Some(0));
}
