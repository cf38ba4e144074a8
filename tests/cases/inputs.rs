//! Damaged and odd inputs.

use std::path::Path;

use super::scene::{self, FRAMES, INIT, LAST, SIZE, sequence};
use super::{Case, Expect};

/// All frames with their boxes, without a word of complaint.
const WHOLE: Expect = Expect {
    code: 0,
    lines: Some(FRAMES),
    last: Some(LAST),
    says: &[],
    prints: &[],
    unchanged: &[],
    absent: &[],
    present: &[],
};
/// All frames with their boxes, some of them held.
const HELD: Expect = Expect { code: 8, ..WHOLE };
/// Refused before the first line.
const REFUSED: Expect = Expect {
    code: 3,
    lines: Some(0),
    last: None,
    ..WHOLE
};

/// `track` over `seq` with more arguments.
fn track(name: &'static str, more: &str, make: impl Fn(&Path) + 'static) -> Case {
    Case::new(name, &format!("track -i seq --init {INIT} {more}"), make)
}

/// The frames, with `seq/NAME` replaced or added.
fn with_file(name: &'static str, bytes: Vec<u8>) -> impl Fn(&Path) {
    move |folder| {
        sequence(folder);
        std::fs::write(folder.join("seq").join(name), &bytes).unwrap();
    }
}

/// The frames as JPEGs, each changed.
fn each_jpeg(change: impl Fn(usize) -> Vec<u8>) -> impl Fn(&Path) {
    move |folder| {
        std::fs::create_dir_all(folder.join("seq")).unwrap();
        for i in 0..FRAMES {
            std::fs::write(folder.join(format!("seq/{}.jpg", i + 1)), change(i)).unwrap();
        }
    }
}

pub fn cases() -> Vec<Case> {
    let mut cases = frames_that_cannot_be_read();
    cases.extend(files_beside_frames());
    cases.extend(pictures());
    cases.extend(sixteen_bits());
    cases.extend(boxes_and_models());
    cases
}

fn frames_that_cannot_be_read() -> Vec<Case> {
    let png = || {
        let mut bytes = std::io::Cursor::new(Vec::new());
        scene::frame(4)
            .write_to(&mut bytes, image::ImageFormat::Png)
            .unwrap();
        bytes.into_inner()
    };
    vec![
        track("one empty frame", "", with_file("5.jpg", Vec::new())).expect(Expect {
            says: &[
                "warning: frame 4: ",
                "5.jpg",
                "its box is held",
                "1 frames could not be read",
            ],
            ..HELD
        }),
        track(
            "one empty frame in flight mode",
            "--mode flight --json",
            with_file("5.jpg", Vec::new()),
        )
        .expect(Expect {
            last: None,
            prints: &["\"held\":true"],
            ..HELD
        }),
        track(
            "one empty frame that is skipped",
            "--on-bad-frame skip",
            with_file("5.jpg", Vec::new()),
        )
        .expect(Expect {
            lines: Some(FRAMES - 1),
            says: &["it is skipped"],
            ..HELD
        }),
        track(
            "one empty frame that stops the run",
            "--on-bad-frame stop",
            with_file("5.jpg", Vec::new()),
        )
        .expect(Expect {
            code: 3,
            lines: Some(4),
            last: None,
            says: &["error: frame 4: ", "5.jpg"],
            ..WHOLE
        }),
        track("empty last frame", "", with_file("8.jpg", Vec::new())).expect(Expect {
            last: Some([44.0, 46.0, 24.0, 18.0]), // that of the frame before
            says: &["frame 7: "],
            ..HELD
        }),
        track("empty first frame", "", with_file("1.jpg", Vec::new())).expect(Expect {
            says: &["frame 0: ", "1.jpg"],
            ..REFUSED
        }),
        track("every frame but the first is empty", "", |folder| {
            sequence(folder);
            for i in 2..=FRAMES {
                std::fs::write(folder.join(format!("seq/{i}.jpg")), b"").unwrap();
            }
        })
        .expect(Expect {
            last: Some([20.0, 40.0, 24.0, 18.0]),
            says: &["7 frames could not be read"],
            ..HELD
        }),
        track("truncated png in the middle", "", move |folder| {
            sequence(folder);
            std::fs::remove_file(folder.join("seq/5.jpg")).unwrap();
            let png = png();
            std::fs::write(folder.join("seq/5.png"), &png[..png.len() / 2]).unwrap();
        })
        .expect(Expect {
            says: &["frame 4: ", "5.png"],
            ..HELD
        }),
        track("jpeg cut short in the middle", "", |folder| {
            sequence(folder);
            scene::cut(&folder.join("seq/5.jpg"), 0.7);
        })
        .expect(Expect {
            says: &["frame 4: ", "cut short"],
            ..HELD
        }),
        track("jpeg cut short, with an end marker", "", |folder| {
            sequence(folder);
            let path = folder.join("seq/5.jpg");
            scene::cut(&path, 0.5);
            let mut jpeg = std::fs::read(&path).unwrap();
            jpeg.extend([0xff, 0xd9]);
            std::fs::write(path, jpeg).unwrap();
        })
        .expect(Expect {
            says: &["frame 4: ", "cut short"],
            ..HELD
        }),
        track("overlay of a run with an empty frame", "--overlay drawn", {
            with_file("5.jpg", Vec::new())
        })
        .expect(Expect {
            present: &["drawn/000003.jpg", "drawn/000005.jpg"],
            absent: &["drawn/000004.jpg"],
            ..HELD
        }),
        Case {
            stdin: Some("cut.ppm"),
            ..Case::new(
                "stream that ends within a frame",
                &format!("track -i - --init {INIT}"),
                |folder| {
                    let ppms = scene::ppms();
                    std::fs::write(folder.join("cut.ppm"), &ppms[..ppms.len() - 9]).unwrap();
                },
            )
        }
        .expect(Expect {
            code: 3,
            lines: Some(FRAMES - 1),
            last: None,
            says: &["frame 7", "ends after"],
            ..WHOLE
        }),
    ]
}

fn files_beside_frames() -> Vec<Case> {
    let masks = |folder: &Path| {
        sequence(folder);
        scene::masks(&folder.join("seq"));
    };
    vec![
        track("resource forks of macOS", "", |folder| {
            sequence(folder);
            for i in 1..=FRAMES {
                std::fs::write(folder.join(format!("seq/._{i}.jpg")), b"\0\x05\x16\x07").unwrap();
            }
            std::fs::create_dir_all(folder.join("seq/__MACOSX")).unwrap();
            std::fs::write(folder.join("seq/.DS_Store"), b"\0").unwrap();
        })
        .expect(WHOLE),
        Case::new(
            "resource forks of macOS by a pattern",
            &format!("track -i */*.jpg --init {INIT}"),
            |folder| {
                sequence(folder);
                std::fs::create_dir_all(folder.join("__MACOSX")).unwrap();
                std::fs::write(folder.join("__MACOSX/1.jpg"), b"junk").unwrap();
                std::fs::write(folder.join("seq/._1.jpg"), b"junk").unwrap();
            },
        )
        .expect(WHOLE),
        track("masks beside pictures", "", masks).expect(Expect {
            says: &["only the .jpg files are taken"],
            ..WHOLE
        }),
        Case::new(
            "masks beside pictures by a pattern",
            &format!("track -i seq/* --init {INIT}"),
            masks,
        )
        .expect(Expect {
            says: &["only the .jpg files are taken"],
            ..WHOLE
        }),
        track("extensions in upper case", "", |folder| {
            std::fs::create_dir_all(folder.join("seq")).unwrap();
            for i in 0..FRAMES {
                let extension = if i % 2 == 0 { "JPG" } else { "Jpeg" };
                let path = folder.join(format!("seq/{}.{extension}", i + 1));
                std::fs::write(path, scene::jpeg(i)).unwrap();
            }
        })
        .expect(WHOLE),
        track(
            "names that occur with two spellings of an extension",
            "",
            |folder| {
                sequence(folder);
                std::fs::write(folder.join("seq/8.jpeg"), scene::jpeg(7)).unwrap();
            },
        )
        .expect(Expect {
            lines: Some(FRAMES + 1),
            says: &["8.jpeg and 8.jpg share a name"],
            ..WHOLE
        }),
        track("folder of tiffs", "", |folder| {
            std::fs::create_dir_all(folder.join("seq")).unwrap();
            std::fs::write(folder.join("seq/1.tiff"), b"II*\0").unwrap();
        })
        .expect(Expect {
            says: &["found none, but files of .tiff"],
            ..REFUSED
        }),
        track("folder of folders", "", |folder| {
            sequence(folder);
            std::fs::rename(folder.join("seq"), folder.join("visible")).unwrap();
            std::fs::create_dir_all(folder.join("seq")).unwrap();
            std::fs::rename(folder.join("visible"), folder.join("seq/visible")).unwrap();
        })
        .expect(Expect {
            says: &["did you mean seq/visible?"],
            ..REFUSED
        }),
        track("end behind the last frame", "--end 99", sequence).expect(Expect {
            says: &["note: --end 99: the input has 8 frames"],
            ..WHOLE
        }),
        track("sizes that change midway", "", |folder| {
            sequence(folder);
            for i in 4..FRAMES {
                let large = image::imageops::resize(
                    &scene::frame(i),
                    2 * SIZE.0,
                    2 * SIZE.1,
                    image::imageops::FilterType::Triangle,
                );
                let path = folder.join(format!("seq/{}.jpg", i + 1));
                std::fs::write(path, scene::jpeg_of(&large)).unwrap();
            }
        })
        .expect(Expect {
            last: None,
            says: &["note: frame 4: 320x240 pixels, 160x120 before"],
            ..WHOLE
        }),
    ]
}

fn pictures() -> Vec<Case> {
    let turned = |tag| each_jpeg(move |i| scene::tagged_jpeg(i, tag));
    vec![
        track("jpegs without an end marker", "", {
            each_jpeg(|i| {
                let mut jpeg = scene::jpeg(i);
                jpeg.truncate(jpeg.len() - 2);
                jpeg
            })
        })
        .expect(WHOLE),
        track("orientation 1", "", turned(1)).expect(WHOLE),
        track("orientation 3", "", turned(3)).expect(WHOLE),
        track("orientation 6", "", turned(6)).expect(WHOLE),
        track("orientation 8", "", turned(8)).expect(WHOLE),
        track("orientation that is nonsense", "", turned(99)).expect(WHOLE),
        track("gif called jpg", "", {
            with_file("5.jpg", b"GIF89a\x01\0\x01\0\0\0\0;".to_vec())
        })
        .expect(Expect {
            says: &["frame 4: ", "expected a jpg, png, webp or bmp"],
            ..HELD
        }),
        Case::new(
            "animated webp",
            "track -i a.webp --init 20,40,24,18",
            |folder| {
                let mut bytes = b"RIFF\x1a\0\0\0WEBPVP8X\x0a\0\0\0\x02\0\0\0".to_vec();
                bytes.extend([159, 0, 0, 119, 0, 0]);
                std::fs::write(folder.join("a.webp"), bytes).unwrap();
            },
        )
        .expect(Expect {
            says: &["a.webp", "an animation"],
            ..REFUSED
        }),
    ]
}

fn sixteen_bits() -> Vec<Case> {
    let raw = |folder: &Path| {
        let bytes: Vec<u8> = (0..FRAMES)
            .flat_map(scene::thermal)
            .flat_map(u16::to_le_bytes)
            .collect();
        std::fs::write(folder.join("raw"), bytes).unwrap();
    };
    vec![
        track("thermal pngs", "", scene::thermal_pngs).expect(WHOLE),
        track("thermal pgms", "", |folder| {
            std::fs::create_dir_all(folder.join("seq")).unwrap();
            for i in 0..FRAMES {
                let mut pgm = format!("P5\n{} {}\n65535\n", SIZE.0, SIZE.1).into_bytes();
                pgm.extend(scene::thermal(i).into_iter().flat_map(u16::to_be_bytes));
                std::fs::write(folder.join(format!("seq/{}.pgm", i + 1)), pgm).unwrap();
            }
        })
        .expect(WHOLE),
        Case {
            stdin: Some("raw"),
            ..Case::new(
                "thermal frames without headers",
                &format!("track -i - --raw 160x120 --pix gray16le --init {INIT}"),
                raw,
            )
        }
        .expect(WHOLE),
        track("8-bit pgms", "", |folder| {
            std::fs::create_dir_all(folder.join("seq")).unwrap();
            for i in 0..FRAMES {
                let mut pgm = format!("P5\n{} {}\n255\n", SIZE.0, SIZE.1).into_bytes();
                pgm.extend(scene::frame(i).pixels().map(|pixel| pixel.0[0]));
                std::fs::write(folder.join(format!("seq/{}.pgm", i + 1)), pgm).unwrap();
            }
        })
        .expect(WHOLE),
    ]
}

fn boxes_and_models() -> Vec<Case> {
    let normalized = Expect {
        code: 6,
        says: &["expected pixels, found shares of the frame"],
        ..REFUSED
    };
    let model = |name, model: &str| {
        let args = format!("track -i seq --init {INIT} --model {model}");
        Case::new(name, &args, |folder| {
            sequence(folder);
            std::fs::write(folder.join("zip.pth"), b"PK\x03\x04\x00\x00\x08\x08").unwrap();
            std::fs::write(folder.join("old.pt"), b"\x80\x02\x8a\x0al\xfc\x9cF").unwrap();
        })
    };
    vec![
        Case::new(
            "box in shares of the frame",
            "track -i seq --init 0.125,0.33,0.15,0.15",
            sequence,
        )
        .expect(normalized),
        Case::new(
            "box of the whole frame in shares",
            "track -i seq --init 0,0,1,1 --mode flight",
            sequence,
        )
        .expect(normalized),
        #[cfg(feature = "serve")]
        Case::new(
            "box in shares of the frame for serve",
            "serve -i seq --init 0.125,0.33,0.15,0.15 --every-frame",
            sequence,
        )
        .expect(normalized),
        #[cfg(feature = "serve")]
        Case::new(
            "box outside for serve",
            "serve -i seq --init 900,900,24,18 --every-frame",
            sequence,
        )
        .expect(Expect {
            code: 6,
            says: &["--init: box 900,900,24,18 lies outside the 160x120 frame"],
            ..REFUSED
        }),
        Case::new(
            "box of one pixel that is not in the corner",
            "track -i seq --init 20,40,1,1",
            sequence,
        )
        .expect(Expect {
            last: None,
            ..WHOLE
        }),
        Case::new(
            "box most of which lies outside",
            "track -i seq --init 20,40,24,1e9",
            sequence,
        )
        .expect(Expect {
            last: None,
            says: &["note: --init: most of box 20,40,24,1000000000 lies outside"],
            ..WHOLE
        }),
        Case::new(
            "polygon for a box",
            "track -i seq --init 20,40,44,40,44,58,20,58",
            sequence,
        )
        .expect(Expect {
            code: 2,
            says: &["found 8 numbers"],
            ..REFUSED
        }),
        Case::new(
            "box with decimal commas",
            "track -i seq --init 20,5;40,5;24,5;18,5",
            sequence,
        )
        .expect(Expect {
            code: 2,
            says: &["four finite numbers"],
            ..REFUSED
        }),
        model("checkpoint for a model", "zip.pth").expect(Expect {
            code: 4,
            says: &["a PyTorch checkpoint", "convert zip.pth"],
            ..REFUSED
        }),
        model("old checkpoint for a model", "old.pt").expect(Expect {
            code: 4,
            says: &["a PyTorch checkpoint", "convert old.pt"],
            ..REFUSED
        }),
        model("misspelt built-in model", "drmim-p99").expect(Expect {
            code: 4,
            says: &["drmim-p99", "drmim-p50", "drmim-p75"],
            ..REFUSED
        }),
    ]
}

/// Cases that need ffmpeg.
pub fn videos() -> Vec<Case> {
    let damaged = Expect {
        code: 3,
        last: None,
        says: &["ffmpeg reported damage"],
        ..WHOLE
    };
    let faststart = ["-pix_fmt", "yuv420p", "-g", "4", "-movflags", "+faststart"];
    let track = |name, file: &str, make: Box<dyn Fn(&Path)>| {
        Case::new(name, &format!("track -i {file} --init {INIT}"), make)
    };
    vec![
        track("whole mp4", "clip.mp4", {
            Box::new(move |folder| scene::video(folder, "clip.mp4", &faststart))
        })
        .expect(Expect {
            lines: Some(32),
            last: Some([20.0, 40.0, 24.0, 18.0]),
            ..WHOLE
        }),
        track("animated gif", "clip.gif", {
            Box::new(|folder| scene::video(folder, "clip.gif", &[]))
        })
        .expect(Expect {
            lines: Some(32),
            last: Some([20.0, 40.0, 24.0, 18.0]),
            ..WHOLE
        }),
        track("video whose size changes midway", "clip.mjpeg", {
            Box::new(|folder| {
                scene::video(folder, "clip.mjpeg", &[]);
                scene::video(folder, "large.mjpeg", &["-vf", "scale=320:240"]);
                let mut clip = std::fs::read(folder.join("clip.mjpeg")).unwrap();
                clip.extend(std::fs::read(folder.join("large.mjpeg")).unwrap());
                std::fs::write(folder.join("clip.mjpeg"), clip).unwrap();
            })
        })
        .expect(Expect {
            lines: Some(64),
            last: Some([20.0, 40.0, 24.0, 18.0]),
            ..WHOLE
        }),
        track("gif that is cut off", "clip.gif", {
            Box::new(|folder| {
                scene::video(folder, "clip.gif", &[]);
                scene::cut(&folder.join("clip.gif"), 0.5);
            })
        })
        .expect(Expect {
            lines: None,
            says: &["the GIF has no end: it is cut short"],
            ..damaged
        }),
        track("transport stream that is cut off", "clip.ts", {
            Box::new(|folder| {
                scene::video(folder, "clip.ts", &["-g", "1"]);
                let path = folder.join("clip.ts");
                let bytes = std::fs::read(&path).unwrap();
                std::fs::write(path, &bytes[..188 * (bytes.len() / 376) + 100]).unwrap();
            })
        })
        .expect(Expect {
            lines: None,
            says: &["ffmpeg reported"],
            ..damaged
        }),
        track("mkv that is cut off", "clip.mkv", {
            Box::new(|folder| {
                scene::video(folder, "clip.mkv", &["-c:v", "mjpeg"]);
                scene::cut(&folder.join("clip.mkv"), 0.5);
            })
        })
        .expect(Expect {
            lines: None, // as many as the decoder makes of it
            says: &["ffmpeg reported damage", "ended prematurely"],
            prints: &["20.000,40.000,24.000,18.000"],
            ..damaged
        }),
    ]
}
