//! `track-cpu trax` against transcripts of what clients say, without any client.
#![cfg(feature = "cli")]

mod program;

use std::io::{BufRead, BufReader, Write};
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::Stdio;

use program::{SIZE, flight, folder, program, run, stderr, stdout, write_pngs};

/// Frames of a flight as `img1.png`, ..., and `WHERE` for `file://WHERE/img1.png`; the first box as
/// a rectangle.
struct Clip {
    folder: PathBuf,
    frames: Vec<Vec<u8>>,
    init: String,
}

impl Clip {
    fn new(name: &str) -> Clip {
        let (frames, init) = flight(4);
        let folder = folder(name);
        write_pngs(&folder, &frames);
        Clip {
            folder,
            frames,
            init,
        }
    }

    /// The transcript's text with this clip's folder, box and pictures in place of `DIR`, `BOX`,
    /// `MEMORY2`, `DATA3`, and the server's name and forms in place of `SERVER`.
    fn fill(&self, transcript: &str) -> String {
        let (width, height) = SIZE;
        let memory = format!(
            "image:{width};{height};rgb;{}",
            trax::base64::encode(&self.frames[1])
        );
        let png = std::fs::read(self.folder.join("img3.png")).unwrap();
        let server = "trax.name=track-cpu trax.region=rectangle;polygon;mask \
                      trax.image=path;memory;data";
        transcript
            .replace("SERVER", server)
            .replace("DIR", &self.folder.display().to_string())
            .replace("BOX", &self.init)
            .replace("MEMORY2", &memory)
            .replace(
                "DATA3",
                &format!("data:image/png;{}", trax::base64::encode(&png)),
            )
    }

    /// Sends the lines after `<` and expects those after `>`, `#` standing for any number; returns
    /// the states.
    fn play(&self, protocol: &str, transcript: &str) -> Vec<[f64; 4]> {
        let mut server = program(["trax", "--protocol", protocol])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let (mut to, from) = (server.stdin.take().unwrap(), server.stdout.take().unwrap());
        let mut lines = BufReader::new(from).lines();
        let mut states = Vec::new();
        for line in self.fill(transcript).lines().map(str::trim) {
            if let Some(sent) = line.strip_prefix("< ") {
                writeln!(to, "{sent}").unwrap();
                to.flush().unwrap();
            } else if let Some(expected) = line.strip_prefix("> ") {
                let found = lines.next().expect("an answer").unwrap();
                assert!(
                    is_like(&found, expected),
                    "expected {expected}\nfound    {found}"
                );
                states.extend(state(&found));
            }
        }
        let rest: Vec<String> = lines.map(Result::unwrap).collect();
        assert!(rest.is_empty(), "nothing more was expected, found {rest:?}");
        drop(to);
        let end = server.wait_with_output().unwrap();
        assert!(
            end.status.success() && end.stderr.is_empty(),
            "{}",
            stderr(&end)
        );
        states
    }

    /// What `track` finds in the same frames.
    fn tracked(&self) -> Vec<[f64; 4]> {
        let output = run(
            [
                "track",
                "--input",
                self.folder.to_str().unwrap(),
                "--init",
                &self.init,
            ],
            b"",
        );
        stdout(&output).lines().map(numbers).collect()
    }
}

fn numbers(text: &str) -> [f64; 4] {
    let numbers: Vec<f64> = text.split(',').map(|n| n.parse().unwrap()).collect();
    numbers.try_into().unwrap()
}

/// The box of a `state`.
fn state(line: &str) -> Option<[f64; 4]> {
    line.strip_prefix("@@TRAX:state \"")
        .map(|rest| numbers(rest.split('"').next().unwrap()))
}

/// Whether a line is as expected, where `#` stands for a number.
fn is_like(found: &str, expected: &str) -> bool {
    let mut rest = found;
    for (i, part) in expected.split('#').enumerate() {
        if i > 0 {
            let end = rest
                .find(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'))
                .unwrap_or(rest.len());
            if rest[..end].parse::<f64>().is_err() {
                return false;
            }
            rest = &rest[end..];
        }
        match rest.strip_prefix(part) {
            Some(after) => rest = after,
            None => return false,
        }
    }
    rest.is_empty()
}

fn assert_near(found: &[[f64; 4]], expected: &[[f64; 4]]) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!(
            a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-3),
            "{found:?}\n{expected:?}"
        );
    }
}

#[test]
fn version_4_session_of_the_reference_client_is_answered() {
    let clip = Clip::new("trax-4");
    let states = clip.play(
        "4",
        r##"
        > @@TRAX:hello trax.version=4 SERVER trax.channels=color trax.multiobject=1
        < @@TRAX:initialize "BOX" "object=car 1" 
        < @@TRAX:frame "file://DIR/img1.png" "tag=first" 
        > @@TRAX:state "#,#,#,#" confidence=1.000000
        < @@TRAX:frame "file://DIR/img2.png" 
        > @@TRAX:state "#,#,#,#" confidence=#
        < @@TRAX:frame "file://DIR/img3.png" 
        > @@TRAX:state "#,#,#,#" confidence=#
        < @@TRAX:initialize 
        < @@TRAX:initialize "BOX" 
        < @@TRAX:frame "file://DIR/img1.png" 
        > @@TRAX:state "#,#,#,#" confidence=1.000000
        < @@TRAX:frame "file://DIR/img2.png" 
        > @@TRAX:state "#,#,#,#" confidence=#
        < @@TRAX:quit 
        "##,
    );
    let tracked = clip.tracked();
    assert_near(&states[..3], &tracked[..3]);
    assert_near(&states[3..], &tracked[..2]); // as if it had never seen anything
}

#[test]
fn initialize_of_versions_1_and_3_takes_image_and_region() {
    let clip = Clip::new("trax-3");
    let talk = r##"
        < @@TRAX:initialize "file://DIR/img1.png" "BOX" "p=1" 
        > @@TRAX:state "#,#,#,#" confidence=1.000000
        < @@TRAX:frame "file://DIR/img2.png" "q=1" 
        > @@TRAX:state "#,#,#,#" confidence=#
        < what a client logs is passed over
        < @@TRAX:initialize "file://DIR/img1.png" "BOX" 
        > @@TRAX:state "#,#,#,#" confidence=1.000000
        < @@TRAX:frame "file://DIR/img2.png" 
        > @@TRAX:state "#,#,#,#" confidence=#
        < @@TRAX:quit 
    "##;
    let hello = "> @@TRAX:hello trax.version=VERSION trax.name=track-cpu \
                 trax.region=rectangle;polygon;mask trax.image=path;memory;data MORE\n";
    for (version, more) in [
        ("1", "trax.identifier=track-cpu"),
        ("3", "trax.channels=color"),
    ] {
        let hello = hello.replace("VERSION", version).replace("MORE", more);
        let states = clip.play(version, &(hello + talk));
        let tracked = clip.tracked();
        assert_near(&states, &[&tracked[..2], &tracked[..2]].concat());
    }
}

#[test]
fn several_objects_are_followed_until_they_are_forgotten() {
    let clip = Clip::new("trax-objects");
    let states = clip.play(
        "4",
        r##"
        > @@TRAX:hello trax.version=4 SERVER trax.channels=color trax.multiobject=1
        < @@TRAX:frame "file://DIR/img1.png" 
        < @@TRAX:initialize "BOX" 
        < @@TRAX:initialize "10,10,20,20" 
        < @@TRAX:frame "file://DIR/img1.png" 
        > @@TRAX:state "#,#,#,#" confidence=1.000000
        > @@TRAX:state "10.0000,10.0000,20.0000,20.0000" confidence=1.000000
        < @@TRAX:frame "file://DIR/img2.png" 
        > @@TRAX:state "#,#,#,#" confidence=#
        > @@TRAX:state "#,#,#,#" confidence=#
        < @@TRAX:initialize "30,30,20,20" 
        < @@TRAX:frame "file://DIR/img3.png" 
        > @@TRAX:state "#,#,#,#" confidence=#
        > @@TRAX:state "#,#,#,#" confidence=#
        > @@TRAX:state "30.0000,30.0000,20.0000,20.0000" confidence=1.000000
        < @@TRAX:initialize 
        < @@TRAX:initialize 
        < @@TRAX:quit 
        "##,
    );
    let tracked = clip.tracked();
    assert_near(&[states[0], states[2], states[4]], &tracked[..3]);
}

#[test]
fn region_and_picture_of_every_form_are_accepted() {
    let clip = Clip::new("trax-forms");
    let states = clip.play(
        "3",
        r##"
        > @@TRAX:hello trax.version=3 SERVER trax.channels=color
        < @@TRAX:initialize "file://DIR/img1.png" "BOX" 
        > @@TRAX:state "#,#,#,#" confidence=1.000000
        < @@TRAX:frame "MEMORY2" 
        > @@TRAX:state "#,#,#,#" confidence=#
        < @@TRAX:frame "DATA3" 
        > @@TRAX:state "#,#,#,#" confidence=#
        < @@TRAX:initialize "MEMORY2" "40,30,59,30,59,49,40,49" 
        > @@TRAX:state "39.5000,29.5000,20.0000,20.0000" confidence=1.000000
        < @@TRAX:initialize "DATA3" "mask:3,2,5,6,7,2,3,2" 
        > @@TRAX:state "5.0000,3.0000,2.0000,2.0000" confidence=1.000000
        < @@TRAX:frame "MEMORY2" 
        > @@TRAX:state "#,#,#,#" confidence=#
        < @@TRAX:quit 
        "##,
    );
    assert_near(&states[..3], &clip.tracked()[..3]);
}

/// Whatever cannot be used ends the session with a reason for the client and exit code 3, never
/// with a panic.
#[test]
fn malformed_message_ends_the_session_with_a_reason() {
    let clip = Clip::new("trax-bad");
    let file = |name: &str, bytes: &[u8]| std::fs::write(clip.folder.join(name), bytes).unwrap();
    file("cut.jpg", b"\xff\xd8\xff\xe0\x00\x10JFIF");
    file("huge.bmp", &huge_bitmap());
    let objects = "@@TRAX:initialize 1,1,9,9\n".repeat(65);
    for (protocol, said, part) in [
        ("4", "@@TRAX:jump", "found \\\"jump\\\""),
        ("4", "@@TRAX:", "expected hello, initialize"),
        ("4", "@@TRAX:frame \"file:///a", "quote"),
        ("4", "@@TRAX:state 1,2,3,4", "a server's"),
        ("4", "@@TRAX:frame", "expected one image, found 0 arguments"),
        ("4", "@@TRAX:initialize a b", "a region or nothing"),
        ("4", "@@TRAX:initialize 1,2,x,4", "region"),
        ("4", "@@TRAX:initialize mask:0,0,5,5,99", "region"),
        ("4", &objects, "at most 64 objects"),
        (
            "4",
            "@@TRAX:initialize BOX\n@@TRAX:frame file:///nonexistent/1.jpg",
            "/nonexistent/1.jpg",
        ),
        (
            "4",
            "@@TRAX:initialize BOX\n@@TRAX:frame file:///dev/zero",
            "expected a picture file",
        ),
        (
            "4",
            "@@TRAX:initialize BOX\n@@TRAX:frame file://DIR",
            "expected a picture file",
        ),
        (
            "4",
            "@@TRAX:initialize BOX\n@@TRAX:frame file://-",
            "absolute path",
        ),
        (
            "4",
            "@@TRAX:initialize BOX\n@@TRAX:frame http://host/a.jpg",
            "image",
        ),
        (
            "4",
            "@@TRAX:initialize BOX\n@@TRAX:frame file://DIR/cut.jpg",
            "cut.jpg",
        ),
        (
            "4",
            "@@TRAX:initialize BOX\n@@TRAX:frame file://DIR/huge.bmp",
            "huge.bmp",
        ),
        (
            "4",
            "@@TRAX:initialize BOX\n@@TRAX:frame image:9999;9999;rgb;AAAA",
            "image",
        ),
        (
            "4",
            "@@TRAX:initialize BOX\n@@TRAX:frame data:image/jpeg;AAAA",
            "found something else",
        ),
        (
            "4",
            "@@TRAX:initialize 1,2,-3,4\n@@TRAX:frame file://DIR/img1.png",
            "width and height above 0",
        ),
        (
            "4",
            "@@TRAX:initialize 1e9,2,3,4\n@@TRAX:frame file://DIR/img1.png",
            "outside",
        ),
        (
            "3",
            "@@TRAX:frame file://DIR/img1.png",
            "expected initialize before it",
        ),
        ("3", "@@TRAX:initialize 1,2,3,4", "an image and a region"),
        ("1", "@@TRAX:initialize", "an image and a region"),
    ] {
        let output = run(
            ["trax", "--protocol", protocol],
            format!("{}\n", clip.fill(said)).as_bytes(),
        );
        let (said_back, told) = (stdout(&output), stderr(&output));
        let last = said_back.lines().last().unwrap_or_default();
        assert_eq!(output.status.code(), Some(3), "{said}: {told}");
        assert!(
            last.starts_with("@@TRAX:quit \"trax.reason="),
            "{said}: {said_back}"
        );
        assert!(last.contains(part), "{said}: {last}");
        assert!(
            told.starts_with("error: TraX client: ") && told.lines().count() == 1,
            "{told}"
        );
    }
}

/// A bitmap's header that promises 30000 x 30000 pixels.
fn huge_bitmap() -> Vec<u8> {
    let mut bytes = b"BM".to_vec();
    bytes.extend(
        [54u32, 0, 54, 40, 30000, 30000]
            .iter()
            .flat_map(|n| n.to_le_bytes()),
    );
    bytes.extend([1u16, 24].iter().flat_map(|n| n.to_le_bytes()));
    bytes.extend([0u8; 24]);
    bytes
}

#[test]
fn client_that_disconnects_is_not_an_error() {
    for said in [
        "",
        "talk\n",
        "@@TRAX:quit\n",
        "@@TRAX:initialize \"1,2,3,4\"\n",
    ] {
        let output = run(["trax"], said.as_bytes());
        assert!(
            output.status.success() && output.stderr.is_empty(),
            "{said}: {}",
            stderr(&output)
        );
        assert_eq!(stdout(&output).lines().count(), 1);
    }
    assert_eq!(run(["trax", "--protocol", "2"], b"").status.code(), Some(2));
    let unusable = run(["trax", "--model", "/nonexistent.safetensors"], b"");
    assert!(
        unusable.status.code() == Some(4) && unusable.stdout.is_empty(),
        "{}",
        stderr(&unusable)
    );
}

#[test]
fn session_over_a_socket_works_as_over_pipes() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port().to_string();
    let mut server = program(["trax"]).env("TRAX_SOCKET", &port).spawn().unwrap();
    let (mut stream, _) = listener.accept().unwrap();
    let mut hello = String::new();
    BufReader::new(stream.try_clone().unwrap())
        .read_line(&mut hello)
        .unwrap();
    assert!(hello.starts_with("@@TRAX:hello trax.version=4"), "{hello}");
    stream.write_all(b"@@TRAX:quit\n").unwrap();
    assert!(server.wait().unwrap().success());
    let refused = program(["trax"])
        .env("TRAX_SOCKET", "no port")
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(3));
    assert!(
        stderr(&refused).contains("expected a port number"),
        "{}",
        stderr(&refused)
    );
}

#[test]
fn numbers_are_told_from_text() {
    assert!(is_like("a 1.5,-2 b", "a #,# b") && is_like("x", "x"));
    assert!(
        !is_like("a x,2 b", "a #,# b") && !is_like("a 1 b c", "a # b") && !is_like("a  b", "a # b")
    );
}
