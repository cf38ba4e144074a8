//! Frames through the public API: folders, patterns, selections, errors in order, decoding ahead.
#![cfg(feature = "source")]

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use image::{ExtendedColorType, save_buffer};
use track_cpu::ChannelOrder;
use track_cpu::source::{Image, Input, PixelFormat, Prefetch, RawFormat, Source, SourceError};

/// Whether a program is installed; says so if it is not.
fn has_program(name: &str, option: &str) -> bool {
    let found = Command::new(name).arg(option).output().is_ok();
    if !found {
        println!("skipped: {name} is not installed");
    }
    found
}

/// A fresh folder for one test.
fn folder(name: &str) -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR"))
        .join("source")
        .join(name);
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}

/// Writes a 4x3 picture of one color.
fn picture(path: &Path, rgb: [u8; 3]) {
    save_buffer(path, &rgb.repeat(12), 4, 3, ExtendedColorType::Rgb8).unwrap();
}

fn names(source: impl Iterator<Item = Result<Image, SourceError>>) -> Vec<String> {
    let name = |image: Image| {
        image
            .name
            .unwrap()
            .file_name()
            .unwrap()
            .to_string_lossy()
            .into_owned()
    };
    source
        .map(|image| image.map_or_else(|error| error.to_string(), name))
        .collect()
}

fn numbered(name: &str, count: u8) -> PathBuf {
    let folder = folder(name);
    for i in 1..=count {
        picture(&folder.join(format!("img{i}.png")), [i, 2 * i, 3 * i]);
    }
    std::fs::write(folder.join("notes.txt"), "no picture").unwrap();
    folder
}

#[test]
fn folder_is_read_in_natural_order() {
    let folder = numbered("natural", 12);
    let mut source = Source::open(&Input::new(&folder)).unwrap();
    assert_eq!(source.frames_left(), Some(12));
    for i in 1..=12u8 {
        let image = source.next().unwrap().unwrap();
        assert_eq!(
            (image.width, image.height, image.order),
            (4, 3, ChannelOrder::Rgb)
        );
        assert_eq!(image.frame().bgr(0, 2), [3 * i, 2 * i, i], "frame {i}");
        source.recycle(image);
    }
    assert!(source.next().is_none() && source.next().is_none());
}

#[test]
fn selection_of_a_folder_or_pattern_gives_those_frames() {
    let folder = numbered("selected", 12);
    let select = |location: PathBuf, start, end| {
        names(
            Source::open(&Input {
                start,
                end,
                ..Input::new(location)
            })
            .unwrap(),
        )
    };
    assert_eq!(
        select(folder.clone(), 9, None),
        ["img10.png", "img11.png", "img12.png"]
    );
    assert_eq!(select(folder.clone(), 1, Some(3)), ["img2.png", "img3.png"]);
    assert_eq!(
        select(folder.join("img1?.png"), 0, Some(99)),
        ["img10.png", "img11.png", "img12.png"]
    );
    assert_eq!(select(folder.join("*"), 0, Some(1)), ["img1.png"]);
    assert_eq!(select(folder.join("img7.png"), 0, None), ["img7.png"]);
    for (start, end, part) in [
        (12, None, "12 frames"),
        (3, Some(3), "3..3"),
        (5, Some(2), "5..2"),
    ] {
        let message = Source::open(&Input {
            start,
            end,
            ..Input::new(&folder)
        })
        .err()
        .unwrap()
        .to_string();
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn selection_of_a_stream_gives_those_frames() {
    let path = folder("stream").join("five.gray");
    std::fs::write(&path, (0..20).collect::<Vec<u8>>()).unwrap();
    let raw = Some(RawFormat::new(2, 2, PixelFormat::Gray));
    let first = |start, end| -> Vec<u8> {
        let source = Source::open(&Input {
            raw,
            start,
            end,
            ..Input::new(&path)
        })
        .unwrap();
        assert_eq!(source.frames_left(), None);
        source.map(|image| image.unwrap().data[0]).collect()
    };
    assert_eq!(first(0, None), [0, 4, 8, 12, 16]);
    assert_eq!(first(2, Some(4)), [8, 12]);
    let mut short = Source::open(&Input {
        raw,
        start: 7,
        ..Input::new(&path)
    })
    .unwrap();
    assert!(
        short
            .next()
            .unwrap()
            .unwrap_err()
            .to_string()
            .contains("5 frames in it")
    );
    assert!(short.next().is_none());
}

#[test]
fn pictures_of_every_format_and_case_are_read() {
    let folder = folder("formats");
    for name in ["a.bmp", "b.BMP", "c.png", "d.WebP", "e.jpg", "f.JPEG"] {
        let path = folder.join(name);
        let plain = path.with_extension(path.extension().unwrap().to_ascii_lowercase());
        picture(&plain, [250, 20, 20]);
        std::fs::rename(&plain, &path).unwrap();
    }
    let images: Vec<Image> = Source::open(&Input::new(&folder))
        .unwrap()
        .collect::<Result<_, _>>()
        .unwrap();
    assert_eq!(images.len(), 6);
    for image in images {
        let pixel = image.frame().bgr(1, 1);
        assert!(
            pixel[2] > 235 && pixel[1] < 40,
            "{:?}: {pixel:?}",
            image.name
        );
    }
}

#[test]
fn gray_stays_gray_and_the_rest_becomes_rgb() {
    let folder = folder("channels");
    let samples = |n: usize| -> Vec<u8> { (0..12 * n).map(|i| 10 * (i % n) as u8 + 100).collect() };
    // 16-bit samples are stretched: one level alone is middle gray, red is the lowest of three.
    for (name, kind, n, order, first) in [
        ("l8.png", ExtendedColorType::L8, 1, ChannelOrder::Gray, 100),
        (
            "la8.png",
            ExtendedColorType::La8,
            2,
            ChannelOrder::Gray,
            100,
        ),
        (
            "l16.png",
            ExtendedColorType::L16,
            2,
            ChannelOrder::Gray,
            128,
        ),
        (
            "rgb8.png",
            ExtendedColorType::Rgb8,
            3,
            ChannelOrder::Rgb,
            100,
        ),
        (
            "rgba8.png",
            ExtendedColorType::Rgba8,
            4,
            ChannelOrder::Rgb,
            100,
        ),
        (
            "rgb16.png",
            ExtendedColorType::Rgb16,
            6,
            ChannelOrder::Rgb,
            26,
        ),
        (
            "gray.jpg",
            ExtendedColorType::L8,
            1,
            ChannelOrder::Gray,
            100,
        ),
    ] {
        let path = folder.join(name);
        save_buffer(&path, &samples(n), 4, 3, kind).unwrap();

        let image = Source::open(&Input::new(&path))
            .unwrap()
            .next()
            .unwrap()
            .unwrap();

        let bytes = 12 * order.bytes_per_pixel();
        assert_eq!((image.order, image.data.len()), (order, bytes), "{name}");
        let found = image.data[0];
        assert!(found.abs_diff(first) <= 3, "{name}: {found}");
    }
}

#[test]
fn bad_file_is_an_error_in_its_place() {
    let folder = numbered("broken", 5);
    std::fs::write(folder.join("img3.png"), b"no picture").unwrap();
    let plain = names(Source::open(&Input::new(&folder)).unwrap());
    let ahead = names(Prefetch::new(
        Source::open(&Input::new(&folder)).unwrap(),
        2,
    ));
    assert_eq!(plain, ahead);
    assert_eq!(
        (plain[1].as_str(), plain[3].as_str(), plain.len()),
        ("img2.png", "img4.png", 5)
    );
    assert!(
        plain[2].contains("img3.png") && plain[2].contains("expected a jpg"),
        "{}",
        plain[2]
    );
}

#[test]
fn prefetch_yields_what_its_source_yields() {
    let folder = numbered("ahead", 12);
    let plain: Vec<Image> = Source::open(&Input::new(&folder))
        .unwrap()
        .map(Result::unwrap)
        .collect();
    let mut prefetch = Prefetch::new(Source::open(&Input::new(&folder)).unwrap(), 3);
    for expected in &plain {
        let image = prefetch.next().unwrap().unwrap();
        assert_eq!(&image, expected);
        prefetch.recycle(image);
    }
    assert!(prefetch.next().is_none() && prefetch.next().is_none());
}

/// An endless source ends with its consumer: the pipe's writer notices within a few frames.
#[cfg(unix)]
#[test]
fn dropped_prefetch_stops_reading() {
    use std::io::Write;
    let pipe = folder("dropped").join("pipe");
    assert!(
        std::process::Command::new("mkfifo")
            .arg(&pipe)
            .status()
            .unwrap()
            .success()
    );
    let writer = std::thread::spawn({
        let pipe = pipe.clone();
        move || {
            let mut pipe = std::fs::OpenOptions::new().write(true).open(pipe).unwrap();
            (0..1_000_000u32).find(|_| pipe.write_all(&[7; 64 * 64]).is_err())
        }
    });
    let raw = Some(RawFormat::new(64, 64, PixelFormat::Gray));
    let mut prefetch = Prefetch::new(
        Source::open(&Input {
            raw,
            ..Input::new(&pipe)
        })
        .unwrap(),
        2,
    );
    assert_eq!(prefetch.next().unwrap().unwrap().data[0], 7);
    drop(prefetch);
    let written = writer.join().unwrap().expect("the reader closed the pipe");
    assert!(written < 100, "{written} frames were still read");
}

/// The size and middle pixel of an input's first frame.
fn first_frame(input: &Input) -> ((usize, usize), [u8; 3]) {
    let image = Source::open(input).unwrap().next().unwrap().unwrap();
    let [blue, green, red] = image.frame().bgr(image.width / 2, image.height / 2);
    ((image.width, image.height), [red, green, blue])
}

fn is_red([red, green, blue]: [u8; 3]) -> bool {
    red > 200 && green < 60 && blue < 60
}

#[test]
fn rtp_stream_on_a_port_is_decoded() {
    if !has_program("ffmpeg", "-version") {
        return;
    }
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = socket.local_addr().unwrap().port() & !1; // RTP has an even one
    drop(socket);
    let sender = Command::new("ffmpeg")
        .args([
            "-v",
            "error",
            "-re",
            "-f",
            "lavfi",
            "-i",
            "color=red:size=160x120:rate=10",
        ])
        .args([
            "-c:v", "mjpeg", "-pix_fmt", "yuvj420p", "-huffman", "default", "-f", "rtp",
        ])
        .arg(format!("rtp://127.0.0.1:{port}"))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn();
    let mut sender = sender.unwrap();

    let (size, middle) = first_frame(&Input::new(format!("rtp:{port}/jpeg")));

    sender.kill().unwrap();
    sender.wait().unwrap();
    assert_eq!(size, (160, 120));
    assert!(is_red(middle), "{middle:?}");
}

#[test]
fn gstreamer_pipeline_delivers_its_frames() {
    if !has_program("gst-launch-1.0", "--version") {
        return;
    }
    let pipeline = "gst:videotestsrc pattern=red ! video/x-raw,width=160,height=120,framerate=10/1";

    let (size, middle) = first_frame(&Input::new(pipeline));
    let wrong = Source::open(&Input::new("gst:nosuchelement"))
        .unwrap()
        .next();

    assert_eq!(size, (160, 120));
    assert!(is_red(middle), "{middle:?}");
    let message = wrong.unwrap().unwrap_err().to_string();
    assert!(message.contains("gst-launch-1.0"), "{message}");
    assert!(message.contains("nosuchelement"), "{message}");
}

#[test]
fn gstreamer_buffer_with_padded_rows_is_read_without_its_padding() {
    if !has_program("gst-launch-1.0", "--version") {
        return;
    }
    // Rows of 176 pixels of which 160 are the picture, as decoders and hardware deliver them.
    let padded = "gst:videotestsrc pattern=red num-buffers=3 \
                  ! video/x-raw,format=I420,width=176,height=120,framerate=10/1 \
                  ! rawvideoparse format=i420 width=160 height=120 framerate=10/1 \
                  plane-strides=<176,88,88> plane-offsets=<0,21120,26400>";

    let images: Result<Vec<_>, _> = Source::open(&Input::new(padded)).unwrap().collect();

    let images = images.unwrap();
    assert!(!images.is_empty());
    for image in images {
        assert_eq!((image.width, image.height), (160, 120));
        let rgb = image.frame().to_rgb();
        assert!(rgb.as_chunks().0.iter().all(|pixel| is_red(*pixel)));
    }
}

#[test]
fn own_arguments_reach_ffmpeg() {
    if !has_program("ffmpeg", "-version") {
        return;
    }
    let path = folder("arguments").join("clip");
    std::fs::write(&path, [[200u8; 64 * 48], [90; 64 * 48]].concat()).unwrap();
    let args = "-f rawvideo -pixel_format gray -video_size 64x48";
    let input = Input {
        ffmpeg_args: args.split(' ').map(str::to_string).collect(),
        ..Input::new(format!("file://{}", path.display()))
    };

    let frames: Vec<_> = Source::open(&input).unwrap().map(Result::unwrap).collect();

    let sizes: Vec<_> = frames
        .iter()
        .map(|image| (image.width, image.height))
        .collect();
    assert_eq!(sizes, [(64, 48); 2]);
}
