use super::*;
use sequences::Annotation;
use std::sync::Mutex;
use testing::Folder;

/// Three sequences of empty pictures.
fn sequences(folder: &Folder) -> Vec<Sequence> {
    let sequence = |name: &str| {
        let frames = (1..=3)
            .map(|i| folder.write(&format!("{name}/{i}.jpg"), ""))
            .collect();
        let boxes = vec![Rect::new(1.0, 2.0, 30.0, 40.5); 3];
        Sequence {
            annotation: Annotation::new(name, boxes),
            frames,
        }
    };
    ["a", "b", "c"].map(sequence).to_vec()
}

/// Runs a program and returns the result and its messages.
fn run_command(
    sequences: &[Sequence],
    shard: &str,
    command: &str,
    out: &Path,
) -> (Result<usize, String>, String) {
    let timeout = Duration::from_secs(1);
    let runner = Runner::Program(Program {
        timeout,
        ..Program::parse(command).unwrap()
    });
    let told = Mutex::new(String::new());
    let tell = |line: &str| *told.lock().unwrap() += &format!("{line}\n");
    let jobs = NonZeroUsize::new(2).unwrap();
    let done = run(sequences, shard.parse().unwrap(), &runner, out, jobs, &tell);
    (
        done.map_err(|error| error.to_string()),
        told.into_inner().unwrap(),
    )
}

const ECHO: &str = "sh -c 'for f in $(cat {frames}); do echo {init}; done'";

#[test]
fn shards_parse_and_hold_equal_parts() {
    assert_eq!("2/4".parse(), Ok(Shard { index: 2, count: 4 }));
    for bad in ["0/4", "5/4", "1", "a/b", "1/0", "-1/2"] {
        assert!(bad.parse::<Shard>().is_err(), "{bad}");
    }
    let shards = ["1/3", "2/3", "3/3"].map(|s| s.parse::<Shard>().unwrap());
    assert!((0..10).all(|place| shards.iter().filter(|shard| shard.holds(place)).count() == 1));
}

#[test]
fn finished_sequences_are_not_run_again() {
    let folder = Folder::new("run");
    let sequences = sequences(&folder);
    let out = folder.path().join("out");
    assert_eq!(run_command(&sequences, "1/1", ECHO, &out).0, Ok(3));
    let text = std::fs::read_to_string(out.join("b.txt")).unwrap();
    assert_eq!(text, "1.000,2.000,30.000,40.500\n".repeat(3));
    assert_eq!(run_command(&sequences, "1/1", "false", &out).0, Ok(0));
    std::fs::write(out.join("b.txt"), "1,2,3,4\n").unwrap(); // cut short
    assert_eq!(run_command(&sequences, "1/1", ECHO, &out).0, Ok(1));
    let left: Vec<_> = sequences::folder::entries(&out).unwrap();
    assert_eq!(left.len(), 3, "{left:?}");
}

#[test]
fn merged_shards_equal_one_run() {
    let folder = Folder::new("run");
    let (sequences, at) = (sequences(&folder), |name: &str| folder.path().join(name));
    let timed = "sh -c 'for f in 1 2 3; do echo {init} >> {out}; echo 0.5 >> {times}; done'";
    run_command(&sequences, "1/1", timed, &at("whole"))
        .0
        .unwrap();
    assert_eq!(run_command(&sequences, "1/2", timed, &at("one")).0, Ok(2));
    assert_eq!(run_command(&sequences, "2/2", timed, &at("two")).0, Ok(1));
    assert_eq!(
        merge(&[at("one"), at("two"), at("one")], &at("merged")).unwrap(),
        3
    );
    for file in ["a.txt", "b.txt", "c.txt", "times/a_time.txt"] {
        let read = |name: &str| std::fs::read(at(name).join(file)).unwrap();
        assert_eq!(read("whole"), read("merged"), "{file}");
    }
    folder.write("two/b.txt", "5,5,5,5\n");
    let error = merge(&[at("two")], &at("merged")).unwrap_err().to_string();
    assert!(error.contains("expected the same boxes of b"), "{error}");
}

#[test]
fn failed_sequence_is_told_and_the_others_run() {
    let folder = Folder::new("run");
    let mut sequences = sequences(&folder);
    let out = folder.path().join("out");
    sequences[0].annotation.boxes[0].w = f64::NAN;
    let command = "sh -c 'echo {init}; case {folder} in */b);; *) echo {init}; echo {init};; esac'";
    let (done, told) = run_command(&sequences, "1/1", command, &out);
    assert_eq!(
        done,
        Err("2 of 3 sequences failed (the reasons are above)".into())
    );
    assert!(
        told.contains("a: failed: a: its first annotated box has no area"),
        "{told}"
    );
    assert!(
        told.contains("b: failed: b: 1 boxes, expected 3, one per frame"),
        "{told}"
    );
    assert!(out.join("c.txt").is_file() && !out.join("b.txt").exists());
    let (done, told) = run_command(
        &sequences[2..],
        "1/1",
        "/nonexistent/tracker {out}",
        &folder.path().join("n"),
    );
    assert!(
        done.is_err() && told.contains("/nonexistent/tracker"),
        "{told}"
    );
}

#[test]
fn built_in_tracker_runs_on_files() {
    let folder = Folder::new("builtin");
    // A bright square on noise, moving to the right.
    let picture = |shift: usize| {
        let mut ppm = b"P6 96 64 255\n".to_vec();
        for y in 0..64 {
            for x in 0..96 {
                let inside = (24 + shift..40 + shift).contains(&x) && (24..40).contains(&y);
                ppm.extend(
                    [if inside {
                        240
                    } else {
                        ((x * 7 + y * 13) % 60) as u8
                    }; 3],
                );
            }
        }
        ppm
    };
    let frames = (0..4)
        .map(|i| folder.write(&format!("s/{i}.ppm"), picture(2 * i)))
        .collect();
    let boxes = vec![Rect::new(24.0, 24.0, 16.0, 16.0); 4];
    let annotation = Annotation::new("s", boxes);
    let mut sequence = Sequence { annotation, frames };
    let runner = Runner::Builtin(Model::builtin(track_cpu::Isa::detect()), OnBadFrame::Hold);
    let outcome = runner.track(&sequence, folder.path()).unwrap();
    assert_eq!((outcome.boxes.len(), outcome.seconds.len()), (4, 4));
    assert!(outcome.boxes.iter().all(Rect::is_usable) && outcome.seconds.iter().all(|s| *s > 0.0));
    assert!(outcome.boxes[3].x > 26.0, "{:?}", outcome.boxes);

    sequence.frames.push(folder.write("s/9.ppm", "P6"));
    let held = runner.track(&sequence, folder.path()).unwrap();
    assert_eq!((held.held, held.boxes.len()), (1, 5));
    assert_eq!(held.boxes[4], outcome.boxes[3]);
    let stopping = Runner::Builtin(Model::builtin(track_cpu::Isa::detect()), OnBadFrame::Stop);
    let stopped = stopping.track(&sequence, folder.path()).unwrap_err();
    assert!(stopped.to_string().contains("9.ppm"), "{stopped}");
}

/// A TraX server in a line of shell: answers each frame with the box moved by 1, and `MORE` at its
/// third message.
const SERVER: &str = r#"trax:sh -c '
    echo loading; echo @@TRAX:hello trax.version=VERSION trax.image=IMAGE trax.region=rectangle
    n=0
    while read -r name rest; do
        n=$((n + 1))
        case "VERSION $n" in *" 3") MORE ;; esac
        case "VERSION $name" in
            *:quit) exit 0 ;;
            "4 @@TRAX:initialize") test "$rest" = "\\"1.0000,2.0000,30.0000,40.5000\\"" || exit 9 ;;
            *) echo "@@TRAX:state \\"$n,2,30,40\\" confidence=0.5" ;;
        esac
    done'"#;

fn server(version: &str, more: &str) -> String {
    SERVER
        .replace("VERSION", version)
        .replace("MORE", more)
        .replace("IMAGE", "path")
        .replace("\\\\", "\\")
}

#[test]
fn programs_that_speak_trax_are_led_through_a_sequence() {
    let folder = Folder::new("trax");
    let (sequences, at) = (sequences(&folder), |name: &str| folder.path().join(name));
    for (version, third) in [("1", "3.000"), ("3", "3.000"), ("4", "4.000")] {
        let out = at(version);
        let (done, told) = run_command(&sequences, "1/1", &server(version, ":"), &out);
        assert_eq!(done, Ok(3), "{told}");
        let boxes = std::fs::read_to_string(out.join("b.txt")).unwrap();
        let lines: Vec<&str> = boxes.lines().collect();
        assert_eq!((lines.len(), lines[0]), (3, "1.000,2.000,30.000,40.500"));
        assert_eq!(lines[2], format!("{third},2.000,30.000,40.000"));
        assert_eq!(
            std::fs::read_to_string(out.join("times/b_time.txt"))
                .unwrap()
                .lines()
                .count(),
            3
        );
    }
    for (more, part) in [
        ("sleep 9", "frame 2: no state within 1 s"),
        ("exit 3", "frame 2: it ended before a state"),
        (
            "echo @@TRAX:quit \"\\\"trax.reason=no memory\\\"\"; exit 0",
            "frame 2: it quit: no memory",
        ),
        ("echo @@TRAX:state lost", "region: expected"),
        ("echo @@TRAX:hello", "expected state, found hello"),
        ("echo @@TRAX:nonsense", "found \"nonsense\""),
    ] {
        let (done, told) = run_command(&sequences[..1], "1/1", &server("4", more), &at("failed"));
        assert!(done.is_err() && told.contains(part), "{more}: {told}");
    }
    let blind = server("4", ":").replace("trax.image=path", "trax.image=memory");
    let (_, told) = run_command(&sequences[..1], "1/1", &blind, &at("failed"));
    assert!(
        told.contains("hello: expected pictures by path, found \"memory\""),
        "{told}"
    );
    let (_, told) = run_command(
        &sequences[..1],
        "1/1",
        "trax:yes @@TRAX:state",
        &at("failed"),
    );
    assert!(told.contains("expected hello, found state"), "{told}");
    let (_, told) = run_command(
        &sequences[..1],
        "1/1",
        "trax:/nonexistent/tracker",
        &at("failed"),
    );
    assert!(told.contains("/nonexistent/tracker"), "{told}");
}

#[test]
fn programs_that_hang_are_killed_at_the_timeout() {
    let folder = Folder::new("hang");
    let sequences = sequences(&folder);
    let began = std::time::Instant::now();
    let (done, told) = run_command(
        &sequences[..1],
        "1/1",
        "sleep 60",
        &folder.path().join("out"),
    );
    assert!(
        done.is_err() && told.contains("sleep: no end within 3 s"),
        "{told}"
    ); // three frames
    assert!(began.elapsed() < Duration::from_secs(30));
}
