//! Running programs, a camera on a pipe, a ground station, requests to the web page.

use std::collections::BTreeSet;
use std::io::{BufRead, Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Output, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::*;
use ::mavlink::{MavConnection, MavHeader};
use serde_json::Value;

pub const PROGRAM: &str = env!("CARGO_BIN_EXE_track-cpu");
/// A small flight whose target stands near the middle of the first frame.
pub const FLIGHT: &str = "flight:seed=7,difficulty=easy,size=320x180";
/// Options of a slow [`FLIGHT`], so that a busy machine keeps up.
pub const SLOW_FLIGHT: [&str; 9] = [
    "--input",
    FLIGHT,
    "--fps",
    "10",
    "--quiet",
    "--max-age-ms",
    "5000",
    "--stall-ms",
    "8000",
];
/// The target of [`FLIGHT`] in shares of the frame.
pub const RECTANGLE: [f32; 4] = [0.4375, 0.39, 0.5625, 0.5556];
/// How long anything may take on a busy machine.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// A running `serve`, killed when the test ends.
pub struct Serving {
    pub child: Child,
    stderr: Arc<Mutex<String>>,
}

impl Serving {
    /// Starts `serve` with these options; what it writes to standard output is thrown away.
    pub fn start(args: &[&str]) -> Serving {
        let mut command = Command::new(PROGRAM);
        command.arg("serve").args(args).stdin(Stdio::null());
        command.stdout(Stdio::null());
        Serving::spawn(command)
    }

    /// Starts a command and listens to its standard error.
    pub fn spawn(mut command: Command) -> Serving {
        let mut child = command.stderr(Stdio::piped()).spawn().unwrap();
        let mut from = child.stderr.take().unwrap();
        let stderr = Arc::new(Mutex::new(String::new()));
        let into = Arc::clone(&stderr);
        std::thread::spawn(move || {
            let mut chunk = [0; 1024];
            while let Ok(count @ 1..) = from.read(&mut chunk) {
                let text = String::from_utf8_lossy(&chunk[..count]);
                into.lock().unwrap().push_str(&text);
            }
        });
        Serving { child, stderr }
    }

    /// What it has said on standard error.
    pub fn said(&self) -> String {
        self.stderr.lock().unwrap().clone()
    }

    /// Waits until it has said something.
    pub fn wait_for(&self, words: &str) {
        let found = until(|| self.said().contains(words).then_some(()));
        assert!(found.is_some(), "never said {words:?}: {}", self.said());
    }

    pub fn is_running(&mut self) -> bool {
        self.child.try_wait().unwrap().is_none()
    }

    pub fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        let sent = Command::new("kill").args([name, &pid]).status().unwrap();
        assert!(sent.success());
    }

    /// Sends SIGTERM and waits for the end.
    pub fn end(self) -> Option<i32> {
        self.signal("-TERM");
        self.end_of_itself()
    }

    /// Waits for the end.
    pub fn end_of_itself(mut self) -> Option<i32> {
        let status = until(|| self.child.try_wait().unwrap());
        status.expect("serve ends").code()
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Asks again and again until there is an answer, for as long as anything may take.
pub fn until<T>(mut ask: impl FnMut() -> Option<T>) -> Option<T> {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(answer) = ask() {
            return Some(answer);
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    None
}

pub fn run(args: &[&str]) -> Output {
    Command::new(PROGRAM).args(args).output().unwrap()
}

pub fn lines(text: &[u8]) -> Vec<Value> {
    text.lines()
        .map(|line| serde_json::from_str(&line.unwrap()).unwrap())
        .collect()
}

/// A folder that is removed with its contents.
pub struct Folder(PathBuf);

impl Folder {
    pub fn new(name: &str) -> Folder {
        let name = format!("track-cpu-serve-{}-{name}", std::process::id());
        let path = std::env::temp_dir().join(name);
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    pub fn path(&self) -> &Path {
        &self.0
    }

    pub fn file(&self, name: &str) -> String {
        self.0.join(name).to_str().unwrap().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A camera on a pipe: a checkered target, off the middle of a patchwork, ten frames a second.
pub struct PipeCamera {
    is_on: Arc<AtomicBool>,
    repeats: Arc<AtomicBool>,
}

impl PipeCamera {
    pub const OPTIONS: [&str; 6] = ["--input", "-", "--raw", "160x120", "--pix", "gray"];
    /// The target in shares of the frame: left, top, right, bottom.
    pub const TARGET: [f32; 4] = [0.6875, 0.6, 0.8375, 0.8];

    /// Writes frames into a program's standard input until the program ends.
    pub fn start(mut pipe: ChildStdin) -> PipeCamera {
        let is_on = Arc::new(AtomicBool::new(true));
        let switch = Arc::clone(&is_on);
        let repeats = Arc::new(AtomicBool::new(false));
        let is_frozen = Arc::clone(&repeats);
        let mut frame = PipeCamera::frame();
        std::thread::spawn(move || {
            loop {
                if !is_frozen.load(Ordering::Relaxed) {
                    frame[0] = frame[0].wrapping_add(1); // the noise of a sensor
                }
                if switch.load(Ordering::Relaxed) && pipe.write_all(&frame).is_err() {
                    return;
                }
                std::thread::sleep(Duration::from_millis(100));
            }
        });
        PipeCamera { is_on, repeats }
    }

    pub fn turn(&self, on: bool) {
        self.is_on.store(on, Ordering::Relaxed);
    }

    /// Repeats the last frame for ever, as a hung encoder does.
    pub fn repeat(&self, on: bool) {
        self.repeats.store(on, Ordering::Relaxed);
    }

    /// Its picture: 160 x 120 pixels in gray.
    pub fn frame() -> Vec<u8> {
        let mut frame = Vec::new();
        for y in 0..120usize {
            for x in 0..160usize {
                let is_target = (110..134).contains(&x) && (72..96).contains(&y);
                let ground = (x * 7 + y * 13) % 97 + 60;
                let checker = if (x / 4 + y / 4) % 2 == 0 { 255 } else { 20 };
                frame.push(if is_target { checker } else { ground as u8 });
            }
        }
        frame
    }
}

/// A program that reads a camera on a pipe.
pub fn serve_pipe(args: &[&str]) -> (Serving, PipeCamera) {
    let mut command = Command::new(PROGRAM);
    command.arg("serve").args(PipeCamera::OPTIONS).args(args);
    command.stdin(Stdio::piped()).stdout(Stdio::null());
    let mut serving = Serving::spawn(command);
    let camera = PipeCamera::start(serving.child.stdin.take().unwrap());
    (serving, camera)
}

/// A ground station that listens where `serve` sends to, or calls it.
pub struct GroundStation {
    link: Box<dyn MavConnection<MavMessage> + Send + Sync>,
}

impl GroundStation {
    /// Listens on a free port; the address is for `--mavlink`.
    pub fn listen() -> (GroundStation, String) {
        // Between finding a free port and listening on it somebody else may take it.
        let listen = || {
            let port = free_udp_port();
            let link = ::mavlink::connect::<MavMessage>(&format!("udpin:127.0.0.1:{port}")).ok()?;
            let station = GroundStation {
                link: Box::new(link),
            };
            Some((station, format!("udpout:127.0.0.1:{port}")))
        };
        (0..20)
            .find_map(|_| listen())
            .expect("one of twenty free ports stays free")
    }

    /// Calls a program that listens, as this system, until the program answers.
    pub fn call(port: u16, system: u8) -> GroundStation {
        let link = ::mavlink::connect::<MavMessage>(&format!("udpout:127.0.0.1:{port}")).unwrap();
        let station = GroundStation {
            link: Box::new(link),
        };
        station.say_hello(system);
        station
    }

    /// Sends a heartbeat.
    pub fn say_hello(&self, system: u8) {
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        let _ = self.link.send(&header(system), &message);
    }

    /// The next message, if one comes within a second.
    pub fn next(&self) -> Option<MavMessage> {
        let end = Instant::now() + Duration::from_secs(1);
        while Instant::now() < end {
            if let Ok((from, message)) = self.link.try_recv() {
                assert_eq!((from.system_id, from.component_id), (1, 100));
                return Some(message);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        None
    }

    /// Waits for a message.
    pub fn wait<T>(&self, what: &str, mut pick: impl FnMut(MavMessage) -> Option<T>) -> T {
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            if let Some(found) = self.next().and_then(&mut pick) {
                return found;
            }
        }
        panic!("no {what}");
    }

    pub fn send(&self, system: u8, message: &MavMessage) {
        self.link.send(&header(system), message).unwrap();
    }

    pub fn command(&self, system: u8, command: MavCmd, p: [f32; 4]) {
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
        self.send(system, &MavMessage::COMMAND_LONG(data));
    }

    /// The result of a command once it is final.
    pub fn result(&self, command: MavCmd) -> MavResult {
        self.wait("acknowledgement", |message| match message {
            MavMessage::COMMAND_ACK(ack) if ack.command == command => {
                Some(ack.result).filter(|r| *r != MavResult::MAV_RESULT_IN_PROGRESS)
            }
            _ => None,
        })
    }

    /// Sends a command until it is acknowledged as accepted.
    pub fn insist(&self, command: MavCmd, p: [f32; 4]) {
        let end = Instant::now() + PATIENCE;
        let mut results = Vec::new();
        while Instant::now() < end {
            self.command(255, command, p); // lost while the program does not listen yet
            let again = Instant::now() + Duration::from_secs(2);
            while Instant::now() < again {
                if let Some(MavMessage::COMMAND_ACK(ack)) = self.next()
                    && ack.command == command
                {
                    results.push(ack.result);
                    break;
                }
            }
            if results.last() == Some(&MavResult::MAV_RESULT_ACCEPTED) {
                return;
            }
        }
        panic!("{command:?} is never accepted: {results:?}");
    }

    pub fn status(&self) -> CAMERA_TRACKING_IMAGE_STATUS_DATA {
        self.wait("tracking status", |message| match message {
            MavMessage::CAMERA_TRACKING_IMAGE_STATUS(status) => Some(status),
            _ => None,
        })
    }

    /// Waits until the tracking status has these flags.
    pub fn wait_for_status(&self, flags: u8) {
        let end = Instant::now() + PATIENCE;
        let mut found = 255;
        while Instant::now() < end {
            found = self.status().tracking_status.bits();
            if found == flags {
                return;
            }
        }
        panic!("status {found}, expected {flags}");
    }
}

fn header(system: u8) -> MavHeader {
    MavHeader {
        system_id: system.into(),
        component_id: 190,
        sequence: 0,
    }
}

pub fn free_udp_port() -> u16 {
    unused(|| {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.local_addr().unwrap().port()
    })
}

pub fn free_tcp_port() -> u16 {
    unused(|| {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        listener.local_addr().unwrap().port()
    })
}

/// A port that no other test was given: the system soon offers a free one again.
fn unused(mut ask: impl FnMut() -> u16) -> u16 {
    static GIVEN: Mutex<BTreeSet<u16>> = Mutex::new(BTreeSet::new());
    loop {
        let port = ask();
        if GIVEN.lock().unwrap().insert(port) {
            return port;
        }
    }
}

/// The web page of a running program.
pub struct Page {
    pub address: String,
}

impl Page {
    pub const TOKEN: &str = "test-token-1";

    /// A page on a free port; its options are for `serve`.
    pub fn new() -> Page {
        Page {
            address: format!("127.0.0.1:{}", free_tcp_port()),
        }
    }

    /// The page at an address with a token, such as a program says.
    pub fn at(url: &str) -> (Page, String) {
        let (address, token) = url.split_once("/#").expect("a token");
        let address = address.replace("http://", "");
        (Page { address }, token.into())
    }

    pub fn options(&self) -> [&str; 4] {
        ["--http", &self.address, "--token", Page::TOKEN]
    }

    /// Sends a request and reads the answer as far as `enough` says.
    pub fn request(&self, text: &str, enough: impl Fn(&[u8]) -> bool) -> Vec<u8> {
        let Ok(mut stream) = TcpStream::connect(&self.address) else {
            return Vec::new();
        };
        stream
            .set_read_timeout(Some(Duration::from_secs(1)))
            .unwrap();
        if stream.write_all(text.as_bytes()).is_err() {
            return Vec::new();
        }
        let mut answer = Vec::new();
        let mut chunk = [0; 4096];
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end && !enough(&answer) {
            match stream.read(&mut chunk) {
                Ok(0) => break,
                Ok(count) => answer.extend_from_slice(&chunk[..count]),
                Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => break,
                Err(_) => {}
            }
        }
        answer
    }

    pub fn get(&self, path: &str) -> String {
        let answer = self.request(&self.get_text(path), |_| false);
        String::from_utf8_lossy(&answer).into_owned()
    }

    pub fn get_text(&self, path: &str) -> String {
        format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", self.address)
    }

    /// Posts, and returns the status.
    pub fn post(&self, path: &str, token: &str, body: &str) -> u16 {
        let head = format!(
            "POST {path} HTTP/1.1\r\nHost: {}\r\nX-Token: {token}\r\n",
            self.address
        );
        let text = format!("{head}Content-Length: {}\r\n\r\n{body}", body.len());
        status(&self.request(&text, |_| false))
    }

    /// The newest report.
    pub fn state(&self) -> Value {
        let answer = self.get("/state");
        let body = answer.split("\r\n\r\n").nth(1).unwrap_or_default();
        serde_json::from_str(body).unwrap_or_default()
    }
}

/// The status of an answer; 0 if there was none.
pub fn status(answer: &[u8]) -> u16 {
    let text = String::from_utf8_lossy(answer);
    let status = text.split(' ').nth(1).unwrap_or_default();
    status.parse().unwrap_or(0)
}

pub fn contains(bytes: &[u8], part: &[u8]) -> bool {
    bytes.windows(part.len()).any(|window| window == part)
}

/// A shell script that stands in for `ffmpeg`, in a folder for the PATH.
pub fn fake_ffmpeg(folder: &Folder, script: &str) -> String {
    use std::os::unix::fs::PermissionsExt;
    let bin = folder.path().join("bin");
    std::fs::create_dir_all(&bin).unwrap();
    let program = bin.join("ffmpeg");
    std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).unwrap();
    std::fs::set_permissions(&program, PermissionsExt::from_mode(0o755)).unwrap();
    let path = std::env::var("PATH").unwrap_or_default();
    format!("{}:{path}", bin.display())
}

/// Whether a process runs.
pub fn is_alive(pid: &str) -> bool {
    let Ok(status) = std::fs::read_to_string(format!("/proc/{pid}/status")) else {
        return false;
    };
    !status.contains("State:\tZ")
}
