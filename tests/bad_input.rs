//! One table of hostile files and mistyped commands. Each ends in the right exit code with a
//! message that names the fault, or in the right result, and never in a panic.
#![cfg(feature = "cli")]

mod program;

use std::ffi::OsString;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use program::{SIZE, flight, folder, run_with, stderr, write_pngs};
use rayon::prelude::*;
use weights_format::{Architecture, Weights, Widths};

const USAGE: i32 = 2;
const INPUT: i32 = 3;
const MODEL: i32 = 4;
const OUTPUT: i32 = 5;
const TARGET: i32 = 6;

/// What must happen.
enum Expect {
    /// This exit code, and this in the message.
    Fails(i32, &'static str),
    /// As `Fails`, after this many lines were written.
    FailsAfter(usize, i32, &'static str),
    /// Success, with this many lines of finite numbers.
    Lines(usize),
}
use Expect::{Fails, FailsAfter, Lines};

struct Case {
    name: &'static str,
    args: Vec<String>,
    stdin: Vec<u8>,
    path: Option<OsString>,
    full: bool, // standard output is a full device
    expect: Expect,
}

/// A case: the arguments split at blanks, `@` standing for the folder of files.
fn case(name: &'static str, args: &str, expect: Expect) -> Case {
    let args = args
        .split_ascii_whitespace()
        .map(|arg| arg.replace('@', text(&place())))
        .collect();
    Case {
        name,
        args,
        stdin: Vec::new(),
        path: None,
        full: false,
        expect,
    }
}

/// A case that reads standard input.
fn piped(name: &'static str, args: &str, stdin: impl Into<Vec<u8>>, expect: Expect) -> Case {
    Case {
        stdin: stdin.into(),
        ..case(name, &format!("track --input - {args}"), expect)
    }
}

fn place() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("bad-input")
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

impl Case {
    /// Runs it; returns what is wrong with the outcome.
    fn verdict(&self) -> Result<(), String> {
        let mut command = program::program(&self.args);
        if let Some(path) = &self.path {
            command.env("PATH", path);
        }
        let output = if self.full {
            let full = File::options()
                .write(true)
                .open("/dev/full")
                .map_err(|e| e.to_string())?;
            command
                .stdin(Stdio::null())
                .stdout(full)
                .output()
                .map_err(|e| e.to_string())?
        } else {
            run_with(&mut command, &self.stdin)
        };
        let (code, message) = (output.status.code(), stderr(&output));
        if message.contains("panicked") || message.len() > 4000 {
            return Err(format!("panicked or said too much: {message}"));
        }
        let lines = String::from_utf8_lossy(&output.stdout)
            .lines()
            .map(str::to_string)
            .collect::<Vec<_>>();
        let finite = |line: &String| {
            let mut numbers = line.split(',').map(|n| n.parse::<f64>());
            line.split(',').count() == 4 && numbers.all(|n| n.is_ok_and(f64::is_finite))
        };
        let (expected, part, count) = match self.expect {
            Fails(code, part) => (code, part, None),
            FailsAfter(lines, code, part) => (code, part, Some(lines)),
            Lines(lines) => (0, "", Some(lines)),
        };
        if code != Some(expected) || !message.contains(part) {
            return Err(format!(
                "expected exit {expected} and {part:?}, found {code:?} and: {message}"
            ));
        }
        if count.is_some_and(|count| lines.len() != count || !lines.iter().all(finite)) {
            return Err(format!(
                "expected {count:?} lines of boxes, found {lines:?}"
            ));
        }
        Ok(())
    }
}

#[test]
fn hostile_inputs_and_commands_end_in_the_right_exit_code() {
    let _ = folder("bad-input");
    let init = make_pictures();
    let mut cases = boxes();
    cases.extend(options());
    cases.extend(pictures(&init));
    cases.extend(streams());
    cases.extend(weights());
    cases.extend(outputs(&init));
    #[cfg(unix)]
    cases.extend(ffmpeg());
    assert!(cases.len() >= 60, "{}", cases.len());
    let report: Vec<String> = cases
        .par_iter()
        .filter_map(|case| {
            case.verdict()
                .err()
                .map(|why| format!("{}: {why}", case.name))
        })
        .collect();
    assert!(
        report.is_empty(),
        "{} of {} cases:\n{}",
        report.len(),
        cases.len(),
        report.join("\n")
    );
}

/// `@/good`: two PNGs of a flight. Returns the true box of the first.
fn make_pictures() -> String {
    let (frames, init) = flight(2);
    let good = place().join("good");
    std::fs::create_dir_all(&good).unwrap();
    write_pngs(&good, &frames);
    init
}

fn boxes() -> Vec<Case> {
    let track = |name, bbox: &str, expect| {
        case(name, &format!("track --input @/good --init {bbox}"), expect)
    };
    vec![
        track(
            "box of NaN",
            "nan,1,2,3",
            Fails(USAGE, "four finite numbers"),
        ),
        track(
            "box of infinities",
            "0,0,inf,inf",
            Fails(USAGE, "four finite numbers"),
        ),
        track(
            "box of text",
            "a,b,c,d",
            Fails(USAGE, "four finite numbers"),
        ),
        track(
            "box of three numbers",
            "1,2,3",
            Fails(USAGE, "four finite numbers"),
        ),
        track(
            "box of five numbers",
            "1,2,3,4,5",
            Fails(USAGE, "four finite numbers"),
        ),
        track("empty box text", "", Fails(USAGE, "--init")),
        track(
            "box beyond f32",
            "1e39,0,5,5",
            Fails(USAGE, "four finite numbers"),
        ),
        track("box without width", "10,10,0,20", Fails(TARGET, "above 0")),
        track("box without height", "10,10,20,0", Fails(TARGET, "above 0")),
        track(
            "box of negative size",
            "10,10,-20,-20",
            Fails(TARGET, "above 0"),
        ),
        track(
            "box to the right of the frame",
            "160,10,20,20",
            Fails(TARGET, "outside the 160x96 frame"),
        ),
        track(
            "box above the frame",
            "10,-30,20,20",
            Fails(TARGET, "outside"),
        ),
        track("box far away", "-1e9,-1e9,5,5", Fails(TARGET, "outside")),
        track("box half outside", "-10,-10,40,40", Lines(2)),
        track("box of one pixel", "50,50,1,1", Lines(2)),
        track(
            "box of a thousandth of a pixel",
            "50,50,0.001,0.001",
            Lines(2),
        ),
        track("box larger than the frame", "-100,-100,5000,5000", Lines(2)),
        track("box of astronomic size", "0,0,1e38,1e38", Lines(2)),
        track("box as thin as a hair", "10,10,100,0.0001", Lines(2)),
    ]
}

fn options() -> Vec<Case> {
    let track = |name, more: &str, expect| {
        case(
            name,
            &format!("track --input @/good --init 50,50,20,20 {more}"),
            expect,
        )
    };
    vec![
        case("no sub-command", "", Fails(USAGE, "Usage")),
        case("unknown sub-command", "follow", Fails(USAGE, "follow")),
        case("no input", "track --init 1,2,3,4", Fails(USAGE, "--input")),
        case("no box", "track --input @/good", Fails(USAGE, "--init")),
        track("unknown option", "--fast", Fails(USAGE, "--fast")),
        track("no threads", "--threads 0", Fails(USAGE, "from 1 to 256")),
        track(
            "too many threads",
            "--threads 257",
            Fails(USAGE, "from 1 to 256"),
        ),
        track(
            "threads in words",
            "--threads two",
            Fails(USAGE, "from 1 to 256"),
        ),
        track(
            "unknown instruction set",
            "--isa mmx",
            Fails(USAGE, "portable"),
        ),
        track("raw without format", "--raw 64x48", Fails(USAGE, "--pix")),
        track("format without raw", "--pix gray", Fails(USAGE, "--raw")),
        track(
            "unknown pixel format",
            "--raw 64x48 --pix rgb23",
            Fails(USAGE, "yuv420p"),
        ),
        track(
            "size in one number",
            "--raw 64 --pix gray",
            Fails(USAGE, "WIDTHxHEIGHT"),
        ),
        track(
            "size of negative numbers",
            "--raw=-4x4 --pix gray",
            Fails(USAGE, "--raw"),
        ),
        track(
            "end before start",
            "--start 1 --end 1",
            Fails(INPUT, "1..1 are an empty range"),
        ),
        track(
            "start behind the last frame",
            "--start 2",
            Fails(INPUT, "2 frames in it"),
        ),
        track("negative start", "--start=-1", Fails(USAGE, "--start")),
        track(
            "end far behind the last frame",
            "--end 99999999999",
            Lines(2),
        ),
        track(
            "overlay of unknown kind",
            "--overlay film.avi",
            Fails(USAGE, "a folder, a .gif or a .mp4"),
        ),
        case(
            "one frame of demo",
            "demo --frames 1",
            Fails(USAGE, "from 2 to"),
        ),
        case(
            "frames beyond measure",
            "bench --frames 1000000",
            Fails(USAGE, "from 2 to"),
        ),
        case(
            "widths of zero",
            "info --widths 0,1,1,1,1,1",
            Fails(USAGE, "widths[0] is 0"),
        ),
        case(
            "widths too large",
            "info --widths 9,9,9,9,9,99999",
            Fails(USAGE, "99999"),
        ),
        case(
            "too few widths",
            "info --widths 1,2,3",
            Fails(USAGE, "6 numbers or 13"),
        ),
        case(
            "encoder without widths",
            "info drmim-p50 --encoder 3x3",
            Fails(USAGE, "--encoder"),
        ),
        case(
            "model and widths",
            "bench --model a --widths half",
            Fails(USAGE, "--widths"),
        ),
        case(
            "unknown precision",
            "bench --precision int4",
            Fails(USAGE, "f32"),
        ),
        Case {
            stdin: b"3x\n".to_vec(),
            ..case(
                "worker fed with text",
                "bench worker --widths P90",
                Fails(INPUT, "number of passes"),
            )
        },
    ]
}

fn pictures(init: &str) -> Vec<Case> {
    let at = |name: &str| place().join(name);
    let png = std::fs::read(at("good/img1.png")).unwrap();
    let image = image::open(at("good/img1.png")).unwrap();
    for name in ["a.jpg", "a.webp", "a.bmp"] {
        image.save(at(name)).unwrap();
    }
    let write = |name: &str, bytes: &[u8]| std::fs::write(at(name), bytes).unwrap();
    let half = |name: &str| {
        let bytes = std::fs::read(at(name)).unwrap();
        bytes[..bytes.len() / 2].to_vec()
    };
    write("half.png", &png[..png.len() / 2]);
    write("half.jpg", &half("a.jpg"));
    write("half.webp", &half("a.webp"));
    write("half.bmp", &half("a.bmp"));
    write("empty.png", b"");
    write("head.jpg", &[0xff, 0xd8, 0xff]);
    write("text.jpg", b"I am a picture, believe me.");
    write("jpeg.png", &std::fs::read(at("a.jpg")).unwrap());
    let mut flipped = png.clone();
    flipped[png.len() / 2] ^= 0x40;
    write("flipped.png", &flipped);
    write("huge.png", &png_of(100_000, 100_000));
    write("wide.png", &png_of(30_000, 30_000));
    write("flat.png", &png_of(0, 5));
    let mut bmp = std::fs::read(at("a.bmp")).unwrap();
    bmp[18..26].copy_from_slice(&[0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0x7f]);
    write("huge.bmp", &bmp);
    let save = |name: &str, (w, h): (u32, u32), kind: image::ExtendedColorType, value: u8| {
        let bytes = vec![value; (w * h * u32::from(kind.bits_per_pixel() / 8)) as usize];
        image::save_buffer(at(name), &bytes, w, h, kind).unwrap();
    };
    save("pixel.png", (1, 1), image::ExtendedColorType::Rgb8, 9);
    save("gray.png", (40, 30), image::ExtendedColorType::L8, 80);
    save("alpha.png", (40, 30), image::ExtendedColorType::Rgba8, 80);
    save("deep.png", (40, 30), image::ExtendedColorType::Rgba16, 80);
    std::fs::create_dir_all(at("black")).unwrap();
    for name in ["black/1.png", "black/2.png", "black/3.png"] {
        save(name, (160, 96), image::ExtendedColorType::Rgb8, 0);
    }
    std::fs::create_dir_all(at("mixed")).unwrap();
    for (i, size) in [(64, 48), (160, 96), (20, 200), (1, 1)]
        .into_iter()
        .enumerate()
    {
        save(
            &format!("mixed/{i}.png"),
            size,
            image::ExtendedColorType::Rgb8,
            90,
        );
    }
    std::fs::create_dir_all(at("broken")).unwrap();
    write("broken/1.png", &png);
    write("broken/2.png", &png);
    write("broken/3.png", &png[..100]);
    write("broken/4.png", &png);
    std::fs::create_dir_all(at("nothing/img.jpg")).unwrap();
    write("nothing/notes.txt", b"no picture here");
    std::fs::create_dir_all(at("otb/img")).unwrap();
    write("otb/img/1.png", &png);

    let track = |name, input: &str, expect| {
        case(
            name,
            &format!("track --input @/{input} --init 0,0,2,2"),
            expect,
        )
    };
    let mut cases = vec![
        track("half a png", "half.png", Fails(INPUT, "half.png")),
        track("half a jpg", "half.jpg", Fails(INPUT, "half.jpg")),
        track("half a webp", "half.webp", Fails(INPUT, "half.webp")),
        track("half a bmp", "half.bmp", Fails(INPUT, "half.bmp")),
        track(
            "picture of no bytes",
            "empty.png",
            Fails(INPUT, "expected a jpg, png, webp or bmp"),
        ),
        track("jpg of three bytes", "head.jpg", Fails(INPUT, "head.jpg")),
        track(
            "text called jpg",
            "text.jpg",
            Fails(INPUT, "expected a jpg, png, webp or bmp"),
        ),
        track("jpg called png", "jpeg.png", Lines(1)),
        track(
            "png with a flipped bit",
            "flipped.png",
            Fails(INPUT, "flipped.png"),
        ),
        track(
            "png that claims 100000x100000",
            "huge.png",
            Fails(INPUT, "huge.png"),
        ),
        track(
            "png that claims 2.7 gigabytes",
            "wide.png",
            Fails(INPUT, "wide.png"),
        ),
        track("png without width", "flat.png", Fails(INPUT, "flat.png")),
        track(
            "bmp that claims 2147483647 pixels a side",
            "huge.bmp",
            Fails(INPUT, "huge.bmp"),
        ),
        track("picture of one pixel", "pixel.png", Lines(1)),
        track("gray picture", "gray.png", Lines(1)),
        track("picture with alpha", "alpha.png", Lines(1)),
        track("picture of 16 bits", "deep.png", Lines(1)),
        track("black frames", "black", Lines(3)),
        track("frames that change their size", "mixed", Lines(4)),
        track("missing file", "missing.mp4", Fails(INPUT, "missing.mp4")),
        track(
            "missing folder",
            "no/such/folder",
            Fails(INPUT, "no/such/folder"),
        ),
        track(
            "folder without pictures",
            "nothing",
            Fails(INPUT, "found none"),
        ),
        track(
            "folder above the pictures",
            "otb",
            Fails(INPUT, "did you mean"),
        ),
        track(
            "pattern without a match",
            "good/*.jpg",
            Fails(INPUT, "found none"),
        ),
        track("malformed pattern", "good/[", Fails(INPUT, "glob pattern")),
        track(
            "folder inside a file",
            "a.jpg/img",
            Fails(INPUT, "a.jpg/img"),
        ),
    ];
    let broken = format!("track --input @/broken --init {init} --on-bad-frame stop");
    cases.push(case(
        "third frame broken",
        &broken,
        FailsAfter(2, INPUT, "frame 2: "),
    ));
    cases
}

/// A PNG of correct checksums whose header claims this size, without pixels.
fn png_of(width: u32, height: u32) -> Vec<u8> {
    let mut header = b"IHDR".to_vec();
    header.extend(width.to_be_bytes());
    header.extend(height.to_be_bytes());
    header.extend([8, 2, 0, 0, 0]);
    let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\x0d".to_vec();
    png.extend(&header);
    png.extend(crc32(&header).to_be_bytes());
    png.extend(b"\0\0\0\x05IDAT\x78\x9c\x03\0\0");
    png.extend(crc32(b"IDAT\x78\x9c\x03\0\0").to_be_bytes());
    png
}

fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0, |crc: u32, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
        })
    })
}

fn streams() -> Vec<Case> {
    let init = "--init 0,0,4,4";
    let raw = |size: &str, pix: &str| format!("{init} --raw {size} --pix {pix}");
    let y4m = |header: &str, frames: usize, bytes: usize| {
        let frame = [b"FRAME\n".to_vec(), vec![90; bytes]].concat();
        [
            format!("YUV4MPEG2 {header}\n").into_bytes(),
            frame.repeat(frames),
        ]
        .concat()
    };
    vec![
        piped(
            "nothing on standard input",
            init,
            b"",
            Fails(INPUT, "no frame"),
        ),
        piped(
            "a png on standard input",
            init,
            b"\x89PNG\r\n\x1a\n",
            Fails(INPUT, "expected y4m"),
        ),
        piped(
            "no raw frame",
            &raw("8x8", "gray"),
            b"",
            Fails(INPUT, "no frame"),
        ),
        piped(
            "raw frame cut short",
            &raw("8x8", "bgr24"),
            [7; 300],
            FailsAfter(1, INPUT, "ends after 108 of 192 bytes"),
        ),
        piped("raw frames", &raw("8x8", "yuyv422"), [7; 256], Lines(2)),
        piped(
            "raw frames of one pixel",
            &raw("1x1", "nv12"),
            [7; 9],
            Lines(3),
        ),
        piped(
            "raw frames without width",
            &raw("0x8", "gray"),
            [7; 64],
            Fails(INPUT, "0x8"),
        ),
        piped(
            "raw frames too wide",
            &raw("99999x8", "gray"),
            [7; 64],
            Fails(INPUT, "99999x8"),
        ),
        piped(
            "raw frames too large",
            &raw("32768x32768", "gray"),
            [7; 64],
            Fails(INPUT, "at most"),
        ),
        piped("y4m", init, y4m("W8 H8", 2, 96), Lines(2)),
        piped("y4m of one pixel", init, y4m("W1 H1 C444", 2, 3), Lines(2)),
        piped(
            "y4m of odd size",
            init,
            y4m("W7 H5 C420mpeg2", 2, 59),
            Lines(2),
        ),
        piped(
            "y4m cut short",
            init,
            &y4m("W8 H8", 2, 96)[..200],
            FailsAfter(1, INPUT, "of 96 bytes"),
        ),
        piped(
            "y4m without a frame",
            init,
            y4m("W8 H8", 0, 0),
            Fails(INPUT, "no frame"),
        ),
        piped(
            "y4m without size",
            init,
            y4m("F30:1", 1, 96),
            Fails(INPUT, "lacks W or H"),
        ),
        piped(
            "y4m of insane size",
            init,
            y4m("W999999999999 H8", 1, 96),
            Fails(INPUT, "999999999999x8"),
        ),
        piped(
            "y4m of absurd size",
            init,
            y4m("W99999999999999999999999 H8", 1, 9),
            Fails(INPUT, "99999"),
        ),
        piped(
            "y4m of negative size",
            init,
            y4m("W-8 H8", 1, 96),
            Fails(INPUT, "-8"),
        ),
        piped(
            "y4m of 10 bits",
            init,
            y4m("W8 H8 C420p10", 1, 192),
            Fails(INPUT, "420p10"),
        ),
        piped(
            "y4m with junk between frames",
            init,
            y4m("W8 H8 Cmono", 2, 65),
            FailsAfter(1, INPUT, "expected FRAME"),
        ),
        piped(
            "y4m whose header never ends",
            init,
            [b"YUV4MPEG2 ".to_vec(), vec![b'W'; 9999]].concat(),
            Fails(INPUT, "more than"),
        ),
        piped(
            "ppm of insane size",
            init,
            b"P6 99999 99999 255\n",
            Fails(INPUT, "99999x99999"),
        ),
        piped(
            "ppm of 16 bits",
            init,
            b"P6 2 2 65535\n",
            Fails(INPUT, "65535"),
        ),
        piped(
            "ppm cut short",
            init,
            b"P6 8 8 255\nabc",
            Fails(INPUT, "3 of 192"),
        ),
    ]
}

fn weights() -> Vec<Case> {
    let good = Weights::random(Architecture::new(Widths::pruned(0.9), None), 3)
        .to_bytes()
        .unwrap();
    let header = 8 + u64::from_le_bytes(good[..8].try_into().unwrap()) as usize;
    // Same-length edits of the header keep everything else in place.
    let edited = |from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let text = String::from_utf8(good[8..header].to_vec()).unwrap();
        assert!(text.contains(from), "{from} in {text}");
        [
            &good[..8],
            text.replacen(from, to, 1).as_bytes(),
            &good[header..],
        ]
        .concat()
    };
    let with = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = good.clone();
        change(&mut bytes);
        bytes
    };
    let table: Vec<(&'static str, Vec<u8>, &'static str)> = vec![
        ("weights of no bytes", Vec::new(), "expected"),
        ("weights of seven bytes", good[..7].to_vec(), "expected"),
        (
            "half the weights",
            good[..good.len() / 2].to_vec(),
            "expected",
        ),
        (
            "weights that lack one byte",
            good[..good.len() - 1].to_vec(),
            "expected",
        ),
        (
            "weights and junk",
            [&good[..], b"junk"].concat(),
            "expected",
        ),
        (
            "text for weights",
            b"These are no weights, are they?".to_vec(),
            "expected",
        ),
        (
            "header longer than the file",
            with(&|b| b[..8].copy_from_slice(&[0xff; 8])),
            "expected",
        ),
        (
            "header of no bytes",
            with(&|b| b[..8].copy_from_slice(&[0; 8])),
            "expected",
        ),
        ("header that is no JSON", with(&|b| b[8] = b'['), "expected"),
        (
            "no metadata",
            edited("__metadata__", "__metadatA__"),
            "expected",
        ),
        (
            "metadata of another program",
            edited("track-cpu", "other-cpu"),
            "track-cpu",
        ),
        (
            "a version to come",
            edited("format_version\\\":1", "format_version\\\":2"),
            "format_version",
        ),
        (
            "metadata field missing",
            edited("size_lr", "size_lx"),
            "size_l",
        ),
        (
            "wrong widths",
            edited("\\\"backbone\\\":[9,", "\\\"backbone\\\":[8,"),
            "backbone.conv1",
        ),
        (
            "width of zero",
            edited("\\\"backbone\\\":[9,", "\\\"backbone\\\":[0,"),
            "widths[0]",
        ),
        (
            "unknown storage",
            edited("\\\"f32\\\"", "\\\"f99\\\""),
            "storage",
        ),
        (
            "tensor of another name",
            edited("\"head.score.bias\"", "\"head.score.bins\""),
            "head.score.bi",
        ),
        (
            "tensor of another type",
            edited("\"F32\"", "\"I32\""),
            "F32",
        ),
        (
            "weights of NaN",
            with(&|b| b.iter_mut().rev().take(4).for_each(|byte| *byte = 0xff)),
            "finite",
        ),
        (
            "weights of infinity",
            {
                let end = good.len();
                with(&|b| b[end - 4..].copy_from_slice(&f32::INFINITY.to_le_bytes()))
            },
            "finite",
        ),
    ];
    let mut cases = Vec::new();
    for (i, (name, bytes, part)) in table.into_iter().enumerate() {
        let file = format!("{i}.safetensors");
        std::fs::write(place().join(&file), bytes).unwrap();
        let command = if i % 2 == 0 {
            "track --input @/good --init 9,9,9,9 --model"
        } else {
            "info"
        };
        cases.push(case(
            name,
            &format!("{command} @/{file}"),
            Fails(MODEL, part),
        ));
    }
    cases.push(case(
        "missing weights",
        "info @/none.safetensors",
        Fails(MODEL, "none.safetensors"),
    ));
    cases.push(case(
        "folder for weights",
        "info @/good",
        Fails(MODEL, "good"),
    ));
    cases
}

fn outputs(init: &str) -> Vec<Case> {
    let track = |name, more: &str, expect| {
        case(
            name,
            &format!("track --input @/good --init {init} {more}"),
            expect,
        )
    };
    let mut cases = vec![
        track(
            "boxes into a folder",
            "--out @/black",
            Fails(OUTPUT, "black"),
        ),
        track(
            "boxes below a file",
            "--out @/a.jpg/boxes.txt",
            Fails(OUTPUT, "boxes.txt"),
        ),
        track(
            "pictures below a file",
            "--overlay @/a.jpg/drawn",
            Fails(OUTPUT, "drawn"),
        ),
        track(
            "film into a missing folder",
            "--overlay @/no/film.gif",
            Fails(OUTPUT, "film.gif"),
        ),
        case(
            "demo below a file",
            "demo --frames 2 --out @/a.jpg/demo",
            Fails(OUTPUT, "demo"),
        ),
    ];
    if Path::new("/dev/full").exists() {
        cases.push(track(
            "boxes onto a full disk",
            "--out /dev/full",
            Fails(OUTPUT, "/dev/full"),
        ));
        let full = |name, args| Case {
            full: true,
            ..case(name, args, Fails(OUTPUT, "standard output"))
        };
        cases.push(full("info onto a full disk", "info drmim-p75"));
        cases.push(Case {
            full: true,
            ..track("standard output full", "", Fails(OUTPUT, "standard output"))
        });
    }
    cases
}

/// Scripts that stand for ffmpeg, and no ffmpeg at all.
#[cfg(unix)]
fn ffmpeg() -> Vec<Case> {
    std::fs::write(place().join("clip.mp4"), b"not really a video").unwrap();
    let frame = "printf 'P6 2 1 255\\nabcdef'";
    let with = |path: OsString, case: Case| Case {
        path: Some(path),
        ..case
    };
    let script = |name: &'static str, folder: &str, script: &str, expect| {
        let path = program::fake_ffmpeg(folder, script);
        with(
            path,
            case(name, "track --input @/clip.mp4 --init 0,0,2,1", expect),
        )
    };
    let none = folder("bad-ffmpeg-none");
    let missing = |name, args, expect| with(none.clone().into(), case(name, args, expect));
    let film = "track --input @/good --init 9,9,9,9 --overlay @/film.mp4";
    vec![
        missing(
            "video without ffmpeg",
            "track --input @/clip.mp4 --init 0,0,2,1",
            Fails(INPUT, "install it"),
        ),
        missing(
            "stream without ffmpeg",
            "track --input rtsp://h/s --init 0,0,2,1",
            Fails(INPUT, "install it"),
        ),
        missing("film without ffmpeg", film, Fails(OUTPUT, "install it")),
        script(
            "ffmpeg without a frame",
            "bad-ffmpeg-1",
            "exit 0",
            Fails(INPUT, "no frame"),
        ),
        script(
            "ffmpeg that fails at once",
            "bad-ffmpeg-2",
            "echo no such codec >&2; exit 1",
            Fails(INPUT, "no such codec"),
        ),
        script(
            "ffmpeg that fails later",
            "bad-ffmpeg-3",
            &format!("{frame}; {frame}; echo corrupt >&2; exit 1"),
            FailsAfter(2, INPUT, "corrupt"),
        ),
        script(
            "ffmpeg that stops within a frame",
            "bad-ffmpeg-4",
            &format!("{frame}; printf 'P6 2 1 255\\nab'"),
            FailsAfter(1, INPUT, "2 of 6 bytes"),
        ),
        script(
            "ffmpeg that prints junk",
            "bad-ffmpeg-5",
            "while :; do echo junk; done",
            Fails(INPUT, "expected P6"),
        ),
        script(
            "ffmpeg that works",
            "bad-ffmpeg-6",
            &format!("{frame}; {frame}; {frame}"),
            Lines(3),
        ),
        with(
            program::fake_ffmpeg("bad-ffmpeg-7", "echo no space >&2; exit 1"),
            case(
                "film that ffmpeg cannot write",
                film,
                Fails(OUTPUT, "film.mp4"),
            ),
        ),
    ]
}

/// The table above is about 160x96 frames.
const _: () = assert!(SIZE.0 == 160 && SIZE.1 == 96);
