use super::*;
use crate::picture::Order;

/// A folder that is removed with its contents.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("station-{name}-{}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Folder(path)
    }

    fn options(&self) -> LogOptions {
        LogOptions {
            path: self.0.join("f.jsonl"),
            frames: None,
            max_file: 1 << 20,
            max_total: 1 << 30,
        }
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(&self.0).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn head() -> Value {
    json!({ "log": "track-cpu", "version": VERSION })
}

fn picture() -> Picture {
    Picture {
        data: vec![9; 4],
        width: 2,
        height: 2,
        order: Order::Gray,
    }
}

fn report(frame: u64) -> Report {
    Report {
        frame,
        ..Report::default()
    }
}

#[test]
fn box_reads_back_to_the_same_bits() {
    for number in [0.1f32, -1.0 / 3.0, 1e-30, 123456.79, f32::MIN_POSITIVE] {
        let bbox = FrameBox::new(number, -number, number * 1.000_000_1, 7.0);

        let text = box_to_json(&bbox).to_string();
        let back = read_box(&serde_json::from_str(&text).unwrap()).unwrap();

        assert_eq!(bbox.x.to_bits(), back.x.to_bits(), "{text}");
        assert_eq!(bbox, back);
    }
    assert_eq!(read_box(&json!([1, 2, 3])), None);
    assert_eq!(read_box(&json!([1, 2, 3, "4"])), None);
}

#[test]
fn commands_read_back() {
    let bbox = FrameBox::new(1.5, 2.0, 3.0, 4.0);
    for asked in [
        Asked::Start {
            bbox,
            at: None,
            id: 1,
        },
        Asked::Start {
            bbox,
            at: Some(7),
            id: 2,
        },
        Asked::Stop { id: None },
        Asked::Stop { id: Some(2) },
    ] {
        assert_eq!(Asked::from_json(&asked.to_json(true)), Some(asked));
    }
    let only = Asked::Stop { id: Some(1) };
    assert_eq!(only.to_json(false), json!("stop"));
    for wrong in [json!(7), json!({ "stop": 0 }), json!({ "stop": "all" })] {
        assert_eq!(Asked::from_json(&wrong), None, "{wrong}");
    }
}

#[test]
fn found_targets_read_back() {
    let folder = Folder::new("targets");
    for (name, room, ids) in [
        ("one", 1, &[1][..]),
        ("three", 3, &[1, 3]),
        ("none", 3, &[]),
    ] {
        let path = folder.0.join(format!("{name}.jsonl"));
        let followed = |id: &TargetId| Followed {
            id: *id,
            start: 1,
            track: Tracked {
                searches: 5,
                ..Tracked::certain(FrameBox::new(*id as f32, 0.1, 3.0, 4.0))
            },
        };
        let report = Report {
            room,
            targets: ids.iter().map(followed).collect(),
            ..report(8)
        };
        let options = LogOptions {
            path: path.clone(),
            ..folder.options()
        };
        let mut log = Log::create(options, head()).unwrap();
        log.add(&[], &report, &picture());
        log.finish();

        let read = Reader::open(&path).unwrap().next().unwrap().unwrap();

        let expected = report.targets.iter().map(|target| Found {
            id: target.id,
            bbox: target.track.bbox,
            searches: 5,
        });
        assert_eq!(read.found, expected.collect::<Vec<_>>(), "{name}");
    }
}

#[test]
fn earlier_logs_and_frames_are_kept() {
    let folder = Folder::new("kept");
    let options = LogOptions {
        frames: Some(folder.0.join("frames")),
        ..folder.options()
    };
    for _ in 0..2 {
        let mut log = Log::create(options.clone(), head()).unwrap();
        log.add(&[], &report(0), &picture());
        log.finish();
    }

    assert_eq!(
        folder.names(),
        ["f-1.jsonl", "f.jsonl", "frames", "frames-1"]
    );
    for frames in ["frames", "frames-1"] {
        let saved = folder.0.join(frames).join(frame_name(0));
        assert!(saved.is_file(), "{}", saved.display());
    }
}

#[test]
fn log_continues_in_new_files_and_the_oldest_is_removed() {
    let folder = Folder::new("rotated");
    let options = LogOptions {
        max_file: 400,
        max_total: 1200,
        ..folder.options()
    };
    std::fs::write(folder.0.join("f-notes.jsonl"), "mine").unwrap();
    let mut log = Log::create(options.clone(), head()).unwrap();
    for frame in 0..40 {
        log.add(&[], &report(frame), &picture());
    }
    log.finish();

    let names = folder.names();
    assert!(!names.contains(&"f.jsonl".into()), "{names:?}");
    assert!(names.contains(&"f-notes.jsonl".into()), "{names:?}");
    let total: u64 = siblings(&options.path).iter().map(|file| file.bytes).sum();
    assert!(total <= 1200 + 400, "{total} bytes");
    let first = siblings(&options.path)
        .into_iter()
        .min_by_key(|file| file.number);
    let mut reader = Reader::open(&first.unwrap().path).unwrap();
    let mut frames = Vec::new();
    while let Some(entry) = reader.next().unwrap() {
        frames.push(entry.frame);
    }
    let expected: Vec<u64> = (frames[0]..40).collect();
    assert_eq!(frames, expected, "the reader follows the files");
}

#[test]
fn wrong_path_is_an_error_at_the_start() {
    let options = LogOptions {
        path: "/no/such/folder/f.jsonl".into(),
        frames: None,
        max_file: 1,
        max_total: 1,
    };

    assert!(Log::create(options, head()).is_err());
}

#[cfg(target_os = "linux")]
#[test]
fn full_disk_is_no_error() {
    let options = LogOptions {
        path: "/dev/full".into(),
        frames: None,
        max_file: 1 << 20,
        max_total: 1 << 20,
    };
    let folder = Folder::new("full");
    let mut log = Log::create(folder.options(), head()).unwrap();
    let file = File::options().write(true).open(options.path).unwrap();
    log.file = Some(Part {
        path: "/dev/full".into(),
        file: BufWriter::new(file),
        bytes: 0,
    });

    log.add(&[], &report(0), &picture());
    log.add(&[], &report(1), &picture());

    assert!(log.file.is_none());
    log.retry = Instant::now();
    log.add(&[], &report(2), &picture());
    assert!(log.file.is_some(), "continues once there is room");
    log.finish();
}
