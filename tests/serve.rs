//! `serve` and `replay` as programs: the log done again, MAVLink as a ground station speaks it, the web page, signals.

#![cfg(all(feature = "serve", unix))]

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

use mavlink::dialects::common::*;
use mavlink::{MavConnection, MavHeader};
use serde_json::Value;

const PROGRAM: &str = env!("CARGO_BIN_EXE_track-cpu");
/// A small flight whose target stands near the middle of the first frame.
const FLIGHT: &str = "flight:seed=7,difficulty=easy,size=320x180";
const PATIENCE: Duration = Duration::from_secs(60);

/// A running `serve`; killed when the test ends.
struct Serving(Child);

impl Serving {
    fn start(args: &[&str]) -> Serving {
        let mut command = Command::new(PROGRAM);
        command
            .arg("serve")
            .args(args)
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        Serving(command.spawn().unwrap())
    }

    /// Sends SIGTERM and waits for the end.
    fn end(mut self) -> Option<i32> {
        let kill = Command::new("kill")
            .args(["-TERM", &self.0.id().to_string()])
            .status()
            .unwrap();
        assert!(kill.success());
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            if let Some(status) = self.0.try_wait().unwrap() {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        panic!("serve does not end on SIGTERM");
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn run(args: &[&str]) -> Output {
    Command::new(PROGRAM).args(args).output().unwrap()
}

fn temporary(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("track-cpu-serve-{}-{name}", std::process::id()))
}

fn lines(text: &[u8]) -> Vec<Value> {
    text.lines()
        .map(|line| serde_json::from_str(&line.unwrap()).unwrap())
        .collect()
}

#[test]
fn a_log_is_done_again_box_for_box() {
    let (log, frames) = (temporary("log.jsonl"), temporary("frames"));
    let (log_text, frames_text) = (log.to_str().unwrap(), frames.to_str().unwrap());
    let input = format!("{FLIGHT},frames=12");
    let args = [
        "serve",
        "--input",
        &input,
        "--every-frame",
        "--init",
        "140,70,40,30",
        "--log",
        log_text,
        "--log-frames",
        frames_text,
    ];
    let served = run(&args);
    assert!(
        served.status.success(),
        "{}",
        String::from_utf8_lossy(&served.stderr)
    );
    let reports = lines(&served.stdout);
    assert_eq!(reports.len(), 12);
    assert!(
        reports
            .iter()
            .all(|r| r["box"].as_array().is_some_and(|b| b.len() == 4) && r["dropped"] == 0)
    );
    let said = String::from_utf8_lossy(&served.stderr);
    assert!(
        said.contains("12 boxes reported")
            && said.contains("; 0 dropped for newer ones, 0 too old"),
        "{said}"
    );

    for extra in [
        &["replay", log_text][..],
        &["replay", log_text, "--frames", frames_text],
    ] {
        let replayed = run(extra);
        assert!(
            replayed.status.success(),
            "{}",
            String::from_utf8_lossy(&replayed.stderr)
        );
        let result = &lines(&replayed.stdout)[0];
        assert_eq!(
            (result["frames"].as_u64(), result["differing"].as_u64()),
            (Some(12), Some(0))
        );
    }

    // One number changed by the smallest step is found.
    let text = std::fs::read_to_string(&log).unwrap();
    let mut tampered: Vec<String> = text.lines().map(str::to_string).collect();
    let mut line: Value = serde_json::from_str(&tampered[7]).unwrap();
    let x = line["box"][0].as_f64().unwrap() as f32;
    line["box"][0] = f64::from(f32::from_bits(x.to_bits() + 1)).into();
    tampered[7] = line.to_string();
    std::fs::write(&log, tampered.join("\n") + "\n").unwrap();
    let replayed = run(&["replay", log_text]);
    assert_eq!(replayed.status.code(), Some(7));
    assert_eq!(lines(&replayed.stdout)[0]["differing"], 1);
    std::fs::remove_file(&log).unwrap();
    std::fs::remove_dir_all(&frames).unwrap();
}

#[test]
fn bad_logs_and_options_say_why() {
    let log = temporary("bad.jsonl");
    let head = r#"{"log":"track-cpu","version":1,"input":"flight:seed=7,size=64x64,frames=2","repeats":true,"model":null,"isa":"portable","precision":"f32","mode":"flight"}"#;
    for (text, part) in [
        (String::new(), "is empty"),
        ("{}\n".into(), "expected track-cpu"),
        (format!("{head}\nnonsense\n"), "no JSON"),
        (format!("{head}\n{{\"frame\":0}}\n"), "none of a log"),
        (format!("{head}\n{{\"frame\":9,\"asked\":[]}}\n"), "frame 9"),
        (head.replace("flight\"}", "other\"}") + "\n", "mode"),
        (head.replace("true", "false") + "\n", "--frames"),
    ] {
        std::fs::write(&log, text).unwrap();
        let output = run(&["replay", log.to_str().unwrap()]);
        let message = String::from_utf8_lossy(&output.stderr).to_string();
        assert_eq!(output.status.code(), Some(3), "{part}: {message}");
        assert!(message.contains(part), "{part}: {message}");
    }
    std::fs::remove_file(&log).unwrap();
    for (args, code, part) in [
        (&["serve", "--input", "flight:color=red"][..], 3, "color"),
        (&["serve", "--gimbal"], 2, "--mavlink"),
        (
            &["serve", "--input", FLIGHT, "--http", "0.0.0.0:0"],
            5,
            "--token",
        ),
        (
            &["serve", "--input", FLIGHT, "--mavlink", "nonsense"],
            5,
            "nonsense",
        ),
        (&["serve", "--input", "no-such-folder"], 3, "no-such-folder"),
    ] {
        let output = run(args);
        let message = String::from_utf8_lossy(&output.stderr).to_string();
        assert_eq!(output.status.code(), Some(code), "{args:?}: {message}");
        assert!(message.contains(part), "{args:?}: {message}");
    }
}

/// A ground station: listens where `serve` sends to.
struct Station {
    link: Box<dyn MavConnection<MavMessage> + Send + Sync>,
}

impl Station {
    fn listen() -> (Station, String) {
        // Between finding a free port and listening on it somebody else may take it.
        let listen = || {
            let port = UdpSocket::bind("127.0.0.1:0")
                .ok()?
                .local_addr()
                .ok()?
                .port();
            let link = mavlink::connect::<MavMessage>(&format!("udpin:127.0.0.1:{port}")).ok()?;
            Some((
                Station {
                    link: Box::new(link),
                },
                format!("udpout:127.0.0.1:{port}"),
            ))
        };
        (0..20)
            .find_map(|_| listen())
            .expect("one of twenty free ports stays free")
    }

    fn wait<T>(&self, what: &str, mut pick: impl FnMut(MavMessage) -> Option<T>) -> T {
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            if let Ok((from, message)) = self.link.recv() {
                assert_eq!((from.system_id, from.component_id), (1, 100));
                if let Some(found) = pick(message) {
                    return found;
                }
            }
        }
        panic!("no {what}");
    }

    fn command(&self, system_id: u8, command: MavCmd, p: [f32; 4]) {
        let header = MavHeader {
            system_id: system_id.into(),
            component_id: 190,
            sequence: 0,
        };
        let [param1, param2, param3, param4] = p;
        let data = COMMAND_LONG_DATA {
            command,
            param1,
            param2,
            param3,
            param4,
            target_system: 1,
            target_component: 100,
            ..Default::default()
        };
        self.link
            .send(&header, &MavMessage::COMMAND_LONG(data))
            .unwrap();
    }

    fn acknowledged(&self, command: MavCmd) -> MavResult {
        self.wait("acknowledgement", |message| match message {
            MavMessage::COMMAND_ACK(ack) if ack.command == command => Some(ack.result),
            _ => None,
        })
    }

    fn status(&self) -> CAMERA_TRACKING_IMAGE_STATUS_DATA {
        self.wait("tracking status", |message| match message {
            MavMessage::CAMERA_TRACKING_IMAGE_STATUS(status) => Some(status),
            _ => None,
        })
    }
}

#[test]
fn a_ground_station_finds_the_camera_starts_and_stops_it() {
    let (station, address) = Station::listen();
    let serving = Serving::start(&[
        "--input",
        FLIGHT,
        "--fps",
        "10",
        "--quiet",
        "--max-age-ms",
        "5000",
        "--mavlink",
        &address,
    ]);
    station.wait("heartbeat of a camera", |message| match message {
        MavMessage::HEARTBEAT(heartbeat) => {
            (heartbeat.mavtype == MavType::MAV_TYPE_CAMERA).then_some(())
        }
        _ => None,
    });
    station.command(255, MavCmd::MAV_CMD_REQUEST_MESSAGE, [259.0, 0.0, 0.0, 0.0]);
    let flags = station.wait("camera information", |message| match message {
        MavMessage::CAMERA_INFORMATION(information) => Some(information.flags.bits()),
        _ => None,
    });
    assert_eq!(flags & (512 | 1024), 512 | 1024);
    assert_eq!(station.status().tracking_status.bits(), 0);

    // A stranger's command does nothing and is not answered; the next one is.
    let rectangle = [0.4375, 0.39, 0.5625, 0.5556];
    station.command(77, MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE, rectangle);
    station.command(255, MavCmd::MAV_CMD_DO_SET_HOME, [0.0; 4]);
    assert_eq!(
        station.acknowledged(MavCmd::MAV_CMD_DO_SET_HOME),
        MavResult::MAV_RESULT_UNSUPPORTED
    );
    assert_eq!(station.status().tracking_status.bits(), 0);

    station.command(255, MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE, rectangle);
    assert_eq!(
        station.acknowledged(MavCmd::MAV_CMD_CAMERA_TRACK_RECTANGLE),
        MavResult::MAV_RESULT_ACCEPTED
    );
    let until = Instant::now() + PATIENCE;
    let status = loop {
        let status = station.status();
        if status.tracking_status.bits() != 0 || Instant::now() > until {
            break status;
        }
    };
    assert_ne!(status.tracking_status.bits(), 0);
    assert!(
        status.rec_top_x < status.rec_bottom_x && (0.0..=1.0).contains(&status.rec_bottom_y),
        "{status:?}"
    );
    station.command(255, MavCmd::MAV_CMD_CAMERA_STOP_TRACKING, [0.0; 4]);
    assert_eq!(
        station.acknowledged(MavCmd::MAV_CMD_CAMERA_STOP_TRACKING),
        MavResult::MAV_RESULT_ACCEPTED
    );
    let until = Instant::now() + PATIENCE;
    while station.status().tracking_status.bits() != 0 {
        assert!(Instant::now() < until, "still tracking");
    }
    assert_eq!(serving.end(), Some(0));
}

/// Sends one request and reads the answer as far as `enough` says.
fn request(address: &str, text: &str, enough: impl Fn(&[u8]) -> bool) -> Vec<u8> {
    let mut stream = TcpStream::connect(address).unwrap();
    stream
        .set_read_timeout(Some(Duration::from_secs(1)))
        .unwrap();
    stream.write_all(text.as_bytes()).unwrap();
    let (mut answer, mut chunk) = (Vec::new(), [0; 4096]);
    let until = Instant::now() + PATIENCE;
    while Instant::now() < until && !enough(&answer) {
        match stream.read(&mut chunk) {
            Ok(0) => break,
            Ok(n) => answer.extend_from_slice(&chunk[..n]),
            Err(_) => {}
        }
    }
    answer
}

fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

#[test]
fn the_web_page_shows_starts_and_stops() {
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let address = format!("127.0.0.1:{port}");
    let token = "test-token-1";
    let mut serving = Serving::start(&[
        "--input",
        FLIGHT,
        "--fps",
        "10",
        "--quiet",
        "--max-age-ms",
        "5000",
        "--http",
        &address,
        "--token",
        token,
    ]);
    let mut said = BufReader::new(serving.0.stderr.take().unwrap());
    let mut line = String::new();
    while !line.contains("web page: ") {
        line.clear();
        assert!(said.read_line(&mut line).unwrap() > 0, "no address said");
    }
    let get = |path: &str, enough: &dyn Fn(&[u8]) -> bool| {
        request(
            &address,
            &format!("GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"),
            enough,
        )
    };
    let post = |path: &str, token: &str, body: &str| {
        let head =
            format!("POST {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\nX-Token: {token}\r\n");
        let text = format!("{head}Content-Length: {}\r\n\r\n{body}", body.len());
        let answer = request(&address, &text, |_| false);
        String::from_utf8_lossy(&answer)
            .split(' ')
            .nth(1)
            .unwrap_or_default()
            .to_string()
    };
    assert!(contains(
        &get("/", &|a| contains(a, b"</html>")),
        b"<canvas"
    ));
    assert!(
        contains(
            &get("/video", &|a| contains(a, b"\xff\xd8\xff")),
            b"\xff\xd8\xff"
        ),
        "a JPEG"
    );
    assert!(contains(
        &get("/events", &|a| contains(a, b"\"frame\"")),
        b"data: {"
    ));
    assert!(contains(&get("/other", &|_| false), b"404"));
    let start = "{\"rectangle\": [0.43, 0.39, 0.56, 0.56]}";
    assert_eq!(post("/start", "wrong-token", start), "403");
    assert_eq!(
        post("/start", token, "{\"rectangle\": [0, 0, 9, 9]}"),
        "400"
    );
    assert_eq!(post("/start", token, start), "202");
    let state = |wanted: &[u8]| {
        let until = Instant::now() + PATIENCE;
        while Instant::now() < until {
            if contains(&get("/state", &|_| false), wanted) {
                return true;
            }
        }
        false
    };
    assert!(state(b"\"box\""), "never started");
    assert_eq!(post("/stop", token, ""), "202");
    assert!(state(b"\"idle\""), "never stopped");
    assert_eq!(serving.end(), Some(0));
}
