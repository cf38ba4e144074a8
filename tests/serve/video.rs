//! The video with boxes burnt in, of `serve` and `track`.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use ::mavlink::dialects::common::*;
use track_cpu::source::{Input, Source};

use crate::support::*;

fn has_ffmpeg() -> bool {
    let found = Command::new("ffmpeg").arg("-version").output().is_ok();
    if !found {
        println!("skipped: ffmpeg is not installed");
    }
    found
}

/// A number that stands before a word on standard error.
fn number_before(said: &str, word: &str) -> u64 {
    let before = said.split(word).next().unwrap();
    let number = before.trim_end().rsplit(' ').next().unwrap();
    number
        .parse()
        .unwrap_or_else(|_| panic!("{word} in {said}"))
}

#[test]
fn film_holds_the_frames_with_their_boxes_and_keeps_an_earlier_one() {
    if !has_ffmpeg() {
        return;
    }
    let folder = Folder::new("film");
    let path = folder.file("f.mkv");
    std::fs::write(&path, "earlier").unwrap();
    let place = folder.file("f-1.mkv");
    let init = ["--init", "140,70.2,40,29.8", "--video-out", &path];
    let args = ["--video-args", "-c:v mjpeg -pix_fmt yuvj420p -q:v 2"];
    let serving = Serving::start(&[&SLOW_FLIGHT[..], &init, &args].concat());
    std::thread::sleep(Duration::from_secs(4));

    assert_eq!(serving.end(), Some(0));
    let (count, amber) = count_boxes(&place, (320, 180));
    assert!(count > 5, "{count} frames");
    assert!(
        amber > 100 * count,
        "{amber} pixels of boxes in {count} frames"
    );
    assert_eq!(std::fs::read(&path).unwrap(), b"earlier");
}

/// Number of frames of a film, and of pixels of boxes in them.
fn count_boxes(film: &str, size: (usize, usize)) -> (usize, usize) {
    let mut count = 0;
    let mut amber = 0;
    for image in Source::open(&Input::new(film)).unwrap() {
        let image = image.unwrap();
        assert_eq!((image.width, image.height), size);
        count += 1;
        let is_amber = |p: &&[u8]| p[0] > 200 && (140..230).contains(&p[1]) && p[2] < 90;
        amber += image.data.chunks_exact(3).filter(is_amber).count();
    }
    (count, amber)
}

#[test]
fn film_of_track_holds_every_frame() {
    if !has_ffmpeg() {
        return;
    }
    let folder = Folder::new("film-of-track");
    let clip = folder.file("clip.y4m");
    let mut frames = b"YUV4MPEG2 W160 H120 F30:1 Cmono\n".to_vec();
    for _ in 0..40 {
        frames.extend_from_slice(b"FRAME\n");
        frames.extend_from_slice(&PipeCamera::frame());
    }
    std::fs::write(&clip, frames).unwrap();
    let film = folder.file("film.mkv");
    let args = ["track", "--input", &clip, "--init", "110,72,24,24"];
    let encoder = ["--video-args", "-c:v mjpeg -pix_fmt yuvj420p -q:v 2"];
    let video = ["--mode", "flight", "--fps", "20", "--video-out"];

    let tracked = run(&[&args[..], &video, &[&film], &encoder].concat());
    let wrong = run(&[&args[..], &video, &[&folder.file("x.none")]].concat());
    let clash = run(&[&args[..], &video, &[&clip]].concat());

    let said = String::from_utf8_lossy(&tracked.stderr);
    assert!(tracked.status.success(), "{said}");
    assert!(said.contains("video: 40 frames, 0 dropped"), "{said}");
    let (count, amber) = count_boxes(&film, (160, 120));
    assert_eq!(count, 40);
    assert!(amber > 50 * count, "{amber} pixels of boxes");
    let said = String::from_utf8_lossy(&wrong.stderr);
    assert_eq!(wrong.status.code(), Some(5), "{said}");
    assert!(said.contains("--video-out"), "{said}");
    assert_eq!(clash.status.code(), Some(2));
}

#[test]
fn encoder_that_never_reads_holds_nothing_up_and_ends_with_the_program() {
    let folder = Folder::new("encoder");
    let pids = folder.file("pids");
    let script = format!("echo $$ >> {pids}; exec sleep 600");
    let path = fake_ffmpeg(&folder, &script);
    let page = Page::new();
    let mut command = Command::new(PROGRAM);
    command.arg("serve").args(SLOW_FLIGHT).args(page.options());
    command.args(["--video-out", "rtp://127.0.0.1:5999"]);
    command
        .env("PATH", path)
        .stdin(Stdio::null())
        .stdout(Stdio::null());
    let serving = Serving::spawn(command);

    let frame = until(|| page.state()["frame"].as_u64().filter(|frame| *frame > 20));
    let began = Instant::now();
    serving.signal("-TERM");
    serving.wait_for("video: ");
    let said = serving.said();

    assert!(frame.is_some(), "tracking waits for the encoder");
    assert!(
        began.elapsed() < Duration::from_secs(20),
        "{:?}",
        began.elapsed()
    );
    assert!(number_before(&said, "dropped") > 5, "{said}");
    assert_eq!(serving.end_of_itself(), Some(0));
    let pids = std::fs::read_to_string(&pids).unwrap();
    let left: Vec<&str> = pids.lines().filter(|pid| is_alive(pid)).collect();
    assert!(left.is_empty(), "{left:?} are left of {pids}");
}

#[test]
fn ground_station_is_told_the_port_the_type_and_the_rate() {
    let (station, address) = GroundStation::listen();
    let args = ["--mavlink", &address, "--video-out", "rtp://127.0.0.1:5998"];
    let serving = Serving::start(&[&SLOW_FLIGHT[..], &args].concat());

    let request = MavCmd::MAV_CMD_REQUEST_MESSAGE;
    station.insist(request, [269.0, 0.0, 0.0, 0.0]);
    let stream = station.wait("stream information", |message| match message {
        MavMessage::VIDEO_STREAM_INFORMATION(stream) => Some(stream),
        _ => None,
    });

    assert_eq!(stream.uri.to_str(), Ok("5998"));
    assert_eq!(stream.mavtype, VideoStreamType::VIDEO_STREAM_TYPE_RTPUDP);
    assert_eq!(stream.framerate, 10.0);
    assert_eq!((stream.resolution_h, stream.resolution_v), (320, 180));
    assert_eq!(serving.end(), Some(0));
}
