//! The program as its users meet it: inputs, outputs, sub-commands.
#![cfg(feature = "cli")]

mod program;

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;

use program::{SIZE, flight, folder, program, run, run_with, stderr, stdout, write_pngs};
use serde_json::Value;

/// The numbers of every line.
fn boxes(text: &str) -> Vec<Vec<f64>> {
    text.lines()
        .map(|line| line.split(',').map(|n| n.parse().unwrap()).collect())
        .collect()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn folder_of_frames_gives_a_line_per_frame() {
    let (frames, init) = flight(6);
    let folder = folder("cli-folder");
    write_pngs(&folder, &frames);
    let input = text(&folder);
    let file = program::folder("cli-folder-out").join("boxes.txt");

    let plain = run(["track", "--input", input, "--init", &init], b"");
    assert!(plain.status.success(), "{}", stderr(&plain));
    let lines = stdout(&plain);
    assert_eq!(lines.lines().next(), Some(init.as_str()));
    assert_eq!(boxes(&lines).len(), 6);
    assert!(
        boxes(&lines)
            .iter()
            .all(|b| b.len() == 4 && b.iter().all(|n| n.is_finite()))
    );
    assert!(stderr(&plain).contains("6 frames"), "{}", stderr(&plain));

    let filed = run(
        [
            "track",
            "--input",
            input,
            "--init",
            &init,
            "--out",
            text(&file),
        ],
        b"",
    );
    assert!(filed.status.success() && filed.stdout.is_empty());
    assert_eq!(std::fs::read_to_string(&file).unwrap(), lines);

    let json = run(
        [
            "track",
            "--input",
            input,
            "--init",
            &init,
            "--json",
            "--threads",
            "2",
        ],
        b"",
    );
    for (i, (line, expected)) in stdout(&json).lines().zip(boxes(&lines)).enumerate() {
        let object: Value = serde_json::from_str(line).unwrap();
        let found: Vec<f64> = serde_json::from_value(object["box"].clone()).unwrap();
        assert!(
            found
                .iter()
                .zip(&expected)
                .all(|(a, b)| (a - b).abs() < 2e-3),
            "{line}: {expected:?}"
        );
        assert_eq!(object["frame"], i);
        assert!(object["milliseconds"].as_f64().unwrap() > 0.0);
        assert_eq!(
            object["score"]
                .as_f64()
                .is_some_and(|s| (0.0..=1.0).contains(&s)),
            i > 0,
            "{line}"
        );
    }
    assert_eq!(stdout(&json).lines().count(), 6);

    let third: Vec<String> = boxes(&lines)[2].iter().map(|n| n.to_string()).collect();
    let part = run(
        [
            "track",
            "--input",
            input,
            "--init",
            &third.join(","),
            "--start",
            "2",
            "--end",
            "5",
            "--json",
        ],
        b"",
    );
    let numbers: Vec<Value> = stdout(&part)
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap()["frame"].clone())
        .collect();
    assert_eq!(numbers, [2, 3, 4]);
}

#[test]
fn same_pixels_by_every_input_give_the_same_boxes() {
    let (frames, init) = flight(4);
    let folder = folder("cli-ways");
    write_pngs(&folder, &frames);
    let rgb = frames.concat();
    let bgr: Vec<u8> = rgb
        .chunks_exact(3)
        .flat_map(|p| [p[2], p[1], p[0]])
        .collect();
    let header = format!("P6\n{} {}\n255\n", SIZE.0, SIZE.1);
    let ppm: Vec<u8> = frames
        .iter()
        .flat_map(|frame| [header.as_bytes(), frame].concat())
        .collect();
    let size = format!("{}x{}", SIZE.0, SIZE.1);
    let file = program::folder("cli-ways-stream").join("frames.ppm");
    std::fs::write(&file, &ppm).unwrap();

    let track = |more: &[&str], stdin: &[u8]| {
        let output = run(
            ["track", "--init", &init, "--input"].iter().chain(more),
            stdin,
        );
        assert!(output.status.success(), "{more:?}: {}", stderr(&output));
        stdout(&output)
    };
    let expected = track(&[text(&folder)], b"");
    assert_eq!(expected.lines().count(), 4);
    assert_eq!(track(&[text(&folder.join("img*.png"))], b""), expected);
    assert_eq!(
        track(&["-", "--raw", &size, "--pix", "rgb24"], &rgb),
        expected
    );
    assert_eq!(
        track(&["-", "--raw", &size, "--pix", "bgr24"], &bgr),
        expected
    );
    assert_eq!(track(&["-"], &ppm), expected);
    assert_eq!(track(&[text(&file)], b""), expected);

    // Gray bytes and gray pictures; and YUV without color is nearly gray.
    let gray: Vec<u8> = rgb.chunks_exact(3).map(|p| p[1]).collect();
    let raw = track(&["-", "--raw", &size, "--pix", "gray"], &gray);
    let frame = SIZE.0 * SIZE.1;
    let mut y4m = format!("YUV4MPEG2 W{} H{} F30:1 Cmono\n", SIZE.0, SIZE.1).into_bytes();
    for plane in gray.chunks_exact(frame) {
        y4m.extend(b"FRAME\n");
        y4m.extend(plane);
    }
    assert_eq!(track(&["-"], &y4m), raw);
    let full: Vec<u8> = gray
        .chunks_exact(frame)
        .flat_map(|p| [p, &vec![128; frame / 2]].concat())
        .collect();
    let mut y4m = format!(
        "YUV4MPEG2 W{} H{} C420jpeg XCOLORRANGE=FULL\n",
        SIZE.0, SIZE.1
    )
    .into_bytes();
    for planes in full.chunks_exact(frame * 3 / 2) {
        y4m.extend(b"FRAME\n");
        y4m.extend(planes);
    }
    assert_eq!(track(&["-"], &y4m), raw);
}

#[test]
fn frames_of_any_size_are_tracked_and_filmed() {
    let mut stream = Vec::new();
    for (w, h) in [(64, 48), (64, 48), (160, 90), (33, 77), (1, 1), (64, 48)] {
        stream.extend(format!("P6 {w} {h} 255\n").into_bytes());
        stream.extend((0..3 * w * h).map(|i| (i * 37 % 251) as u8));
    }
    let gif = folder("cli-sizes").join("film.gif");
    let output = run(
        [
            "track",
            "--input",
            "-",
            "--init",
            "20,10,16,16",
            "--overlay",
            text(&gif),
        ],
        &stream,
    );
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(boxes(&stdout(&output)).len(), 6);
    assert!(std::fs::metadata(&gif).unwrap().len() > 100);
}

#[test]
fn overlay_folder_holds_a_picture_per_frame() {
    let (frames, init) = flight(4);
    let folder = folder("cli-overlay");
    write_pngs(&folder, &frames);
    let drawn = folder.join("drawn");
    let output = run(
        [
            "track",
            "--input",
            text(&folder),
            "--init",
            &init,
            "--start",
            "1",
            "--overlay",
            text(&drawn),
        ],
        b"",
    );
    assert!(output.status.success(), "{}", stderr(&output));
    let mut names: Vec<String> = std::fs::read_dir(&drawn)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(names, ["000001.jpg", "000002.jpg", "000003.jpg"]);
    let bbox = &boxes(&init)[0];
    let picture = image::open(drawn.join("000001.jpg")).unwrap().into_rgb8();
    assert_eq!(picture.dimensions(), (SIZE.0 as u32, SIZE.1 as u32));
    let edge = picture
        .get_pixel((bbox[0] + bbox[2] / 2.0) as u32, bbox[1].round() as u32 - 1)
        .0;
    assert!(edge[0] > 180 && edge[2] < 120, "no amber outline: {edge:?}");
}

#[test]
fn boxes_of_several_trackers_are_compared_in_pictures_and_on_a_sheet() {
    let (frames, init) = flight(5);
    let folder = folder("cli-compare");
    let input = folder.join("input");
    std::fs::create_dir_all(&input).unwrap();
    write_pngs(&input, &frames);
    let ours = folder.join("ours.txt");
    let other = folder.join("other.txt");
    std::fs::write(&ours, format!("{init}\n").repeat(5)).unwrap();
    std::fs::write(&other, "nan,nan,nan,nan\n5 6 20 20\n").unwrap();
    let compare = |out: &Path| {
        let files = [text(&ours), text(&other)];
        let more = ["--input", text(&input), "--out", text(out)];
        run([&["compare"][..], &files, &more].concat(), b"")
    };

    let drawn = folder.join("drawn");
    let pictures = compare(&drawn);
    let sheet = folder.join("sheet.png");
    let sheeted = compare(&sheet);
    let destroyed = compare(&input);

    assert!(pictures.status.success(), "{}", stderr(&pictures));
    let said = stderr(&pictures);
    assert!(said.contains("other has 2 boxes for 5 frames"), "{said}");
    let second = image::open(drawn.join("000001.jpg")).unwrap().into_rgb8();
    let bbox = &boxes(&init)[0];
    let top = bbox[1].round() as u32 - 1;
    let amber = second.get_pixel((bbox[0] + bbox[2] / 2.0) as u32, top).0;
    assert!(amber[0] > 180 && amber[2] < 120, "{amber:?}");
    let blue = second.get_pixel(15, 5).0;
    assert!(blue[2] > 180 && blue[0] < 140, "{blue:?}");
    assert!(sheeted.status.success(), "{}", stderr(&sheeted));
    let (width, _) = image::open(&sheet).unwrap().into_rgb8().dimensions();
    assert!(width > 4 * SIZE.0.min(400) as u32, "{width}");
    assert_eq!(destroyed.status.code(), Some(2), "{}", stderr(&destroyed));
}

#[cfg(feature = "serve")]
#[test]
fn wrong_line_of_a_configuration_is_named() {
    let path = folder("cli-config").join("track-cpu.toml");
    std::fs::write(&path, "# a flight\nfps = 30\nmax-age = 250\n").unwrap();

    let refused = run(["serve", "--config", text(&path)], b"");

    let said = stderr(&refused);
    let expected = format!("{}:3: serve has no option --max-age", text(&path));
    assert!(said.contains(&expected), "{said}");
    assert_eq!(refused.status.code(), Some(2));
}

/// One test for all of ffmpeg, so that no other process holds a script while it starts.
#[cfg(unix)]
#[test]
fn video_is_read_and_written_through_ffmpeg() {
    let (frames, init) = flight(4);
    let place = folder("cli-video");
    let clip = place.join("clip.mp4");
    std::fs::write(&clip, b"not really a video").unwrap();
    let header = format!("P6\n{} {}\n255\n", SIZE.0, SIZE.1);
    let ppm: Vec<u8> = frames
        .iter()
        .flat_map(|frame| [header.as_bytes(), frame].concat())
        .collect();
    std::fs::write(place.join("frames"), &ppm).unwrap();

    // As decoder it prints the frames, as encoder it keeps what it is given.
    let script = format!(
        "case \"$*\" in *pipe:1*) cat '{}' ;; \
         *) for last; do :; done; cat > \"${{last#file:}}\" ;; esac",
        text(&place.join("frames"))
    );
    let path = program::fake_ffmpeg("cli-video-bin", &script);
    let film = place.join("film.mp4");
    let args = [
        "track",
        "--input",
        text(&clip),
        "--init",
        &init,
        "--overlay",
        text(&film),
    ];
    let output = run_with(program(args).env("PATH", &path), b"");
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(boxes(&stdout(&output)).len(), 4);
    assert_eq!(std::fs::read(&film).unwrap().len(), frames.concat().len());

    let part = run_with(
        program(args)
            .args(["--start", "1", "--end", "3"])
            .env("PATH", &path),
        b"",
    );
    assert!(
        part.status.success() && boxes(&stdout(&part)).len() == 2,
        "{}",
        stderr(&part)
    );
}

#[test]
fn closed_pipe_is_not_an_error() {
    let (frames, init) = flight(8);
    let folder = folder("cli-pipe");
    write_pngs(&folder, &frames);
    let mut child = program(["track", "--input", text(&folder), "--init", &init])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(child.stdout.take().unwrap())
        .read_line(&mut line)
        .unwrap();
    assert_eq!(line.trim_end(), init);
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{:?}", output.status);
    assert_eq!(stderr(&output), "");
}

#[test]
fn demo_writes_pictures_and_measures() {
    let out = folder("cli-demo");
    let output = run(
        ["demo", "--frames", "30", "--json", "--out", text(&out)],
        b"",
    );
    assert!(output.status.success(), "{}", stderr(&output));
    let last = stdout(&output).lines().last().unwrap().to_string();
    let result: Value = serde_json::from_str(&last).unwrap();
    assert_eq!(result["frames"], 30);
    assert!(result["fps"].as_f64().unwrap() > 0.0);
    assert!((0.0..=1.0).contains(&result["precision_20"].as_f64().unwrap()));
    assert!(
        result["mean_iou"].as_f64().unwrap() > 0.5,
        "the object was lost at once: {last}"
    );
    for (file, least) in [("demo.gif", 50_000), ("sheet.png", 50_000)] {
        let bytes = std::fs::metadata(out.join(file)).unwrap().len();
        assert!((least..6_000_000).contains(&bytes), "{file}: {bytes} bytes");
        assert!(stderr(&output).contains(file));
    }
    let sheet = image::open(out.join("sheet.png")).unwrap();
    assert_eq!((sheet.width(), sheet.height()), (1330, 634));
}

#[test]
fn info_counts_parameters_as_the_papers_do() {
    let paper = "76,224,337,334,256,256,256,230,138,224,227,145,224";
    for (args, parameters) in [
        (&["info", "--widths", paper][..], "7,489,986"),
        (&["info", "--widths", "full"], "9,655,380"),
        (&["info", "--widths", "P50"], "2,425,396"),
        (
            &[
                "info",
                "--widths",
                "48,128,192,192,128,128",
                "--encoder",
                "3x3",
            ],
            "2,573,236",
        ),
        (
            &["info", "--widths", "half", "--encoder", "1x1"],
            "2,442,164",
        ),
        (&["info", "drmim-p50"], "head.offsets"),
    ] {
        let output = run(args, b"");
        assert!(output.status.success(), "{}", stderr(&output));
        assert!(
            stdout(&output).contains(parameters),
            "{args:?}: {}",
            stdout(&output)
        );
    }
    let output = run(["info", "--widths", paper, "--json"], b"");
    let object: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(object["parameters"], 7_489_986);
    assert_eq!(object["widths"].as_array().unwrap().len(), 13);
    let layers = object["layers"].as_array().unwrap();
    let sum = |key: &str| {
        layers
            .iter()
            .map(|layer| layer[key].as_u64().unwrap())
            .sum::<u64>()
    };
    assert_eq!(sum("macs_search"), object["macs_search"].as_u64().unwrap());
    assert_eq!(sum("parameters") + 2, 7_489_986);
}

#[test]
fn weights_file_given_by_path_is_used() {
    use weights_format::{Architecture, Encoder, Weights, Widths};
    let (frames, init) = flight(3);
    let folder = folder("cli-model");
    write_pngs(&folder, &frames);
    let file = folder.join("tiny.safetensors");
    let architecture = Architecture::new(Widths::pruned(0.9), Some(Encoder::standard(25)));
    Weights::random(architecture, 5).write(&file).unwrap();
    let output = run(
        [
            "track",
            "--input",
            text(&folder),
            "--init",
            &init,
            "--model",
            text(&file),
        ],
        b"",
    );
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(boxes(&stdout(&output)).len(), 3);
    let about = run(["info", text(&file)], b"");
    assert!(
        stdout(&about).contains("9,25,38,38,25,25"),
        "{}",
        stdout(&about)
    );
}

#[test]
fn mode_and_shares_of_older_versions_still_work() {
    let (frames, init) = flight(4);
    let folder = folder("cli-modes");
    write_pngs(&folder, &frames);
    let track = |more: &str| {
        let args = ["track", "--input", text(&folder), "--init", &init];
        let output = run(args.into_iter().chain(more.split_ascii_whitespace()), b"");
        assert!(output.status.success(), "{more}: {}", stderr(&output));
        stdout(&output)
    };

    let plain = track("");
    let published = track("--as-published");

    assert_eq!(track("--mode plain"), plain);
    assert_eq!(track("--mode paper"), plain);
    let shares = "--correction 0 --template-update 0 --online-filter 0 --unstretch 0 --voting 0";
    assert_eq!(track(shares), published);
    assert_ne!(published, plain);
    let help = stdout(&run(["track", "--help"], b""));
    assert!(
        help.contains("--as-published") && help.contains("plain"),
        "{help}"
    );
    assert!(
        !help.contains("--correction") && !help.contains("paper"),
        "{help}"
    );
}

#[test]
fn small_model_given_by_name_is_used() {
    let about = run(["info", "drmim-p75", "--json"], b"");
    let object: Value = serde_json::from_str(&stdout(&about)).unwrap();
    assert_eq!(object["name"], "drmim-p75");
    let standard: Value = serde_json::from_str(&stdout(&run(["info", "--json"], b""))).unwrap();
    assert_eq!(standard["name"], "drmim-p50");
    let folder = folder("cli-small");
    let (frames, init) = flight(4);
    write_pngs(&folder, &frames);
    let output = run(
        [
            "track",
            "--input",
            text(&folder),
            "--init",
            &init,
            "--model",
            "drmim-p75",
        ],
        b"",
    );
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(boxes(&stdout(&output)).len(), 4);
}

#[test]
fn retired_model_name_runs_its_successor_and_says_so() {
    let folder = folder("cli-retired");
    let (frames, init) = flight(3);
    write_pngs(&folder, &frames);
    let track = |model: &str| {
        let input = text(&folder);
        let args = ["track", "--input", input, "--init", &init, "--model", model];
        run(args, b"")
    };

    let retired = track("drmim-p82");
    let successor = track("drmim-p75");

    assert!(retired.status.success(), "{}", stderr(&retired));
    assert_eq!(stdout(&retired), stdout(&successor));
    let note = "note: drmim-p82 is no longer built in; drmim-p75 takes its place";
    assert!(stderr(&retired).contains(note), "{}", stderr(&retired));
    assert!(!stderr(&successor).contains("note: drmim"));
}

#[test]
fn int8_is_used_for_calibrated_models_only() {
    use weights_format::{Architecture, Weights, Widths};
    let bench = |more: &[&str]| {
        let output = run(["bench", "--frames", "2", "--json"].iter().chain(more), b"");
        (output.status.code(), stdout(&output), stderr(&output))
    };
    for (precision, has_integers) in [("int8", true), ("f32", false)] {
        let (code, json, errors) = bench(&["--widths", "P90", "--precision", precision]);
        assert_eq!(code, Some(0), "{errors}");
        let object: Value = serde_json::from_str(&json).unwrap();
        assert_eq!(object["precision"], precision);
        let layers = object["layers"].as_array().unwrap();
        let algorithms: Vec<&str> = layers
            .iter()
            .filter_map(|layer| layer["algorithm"].as_str())
            .collect();
        // Which layers compute in integers depends on the instruction set.
        let found = algorithms.iter().any(|name| name.contains("int"));
        assert_eq!(found, has_integers, "{precision}: {algorithms:?}");
        assert_eq!(layers.last().unwrap()["algorithm"], "direct");
    }
    let file = folder("cli-precision").join("plain.safetensors");
    Weights::random(Architecture::new(Widths::pruned(0.9), None), 5)
        .write(&file)
        .unwrap();
    let (code, _, errors) = bench(&["--model", text(&file), "--precision", "int8"]);
    assert!(
        code == Some(4) && errors.contains("train quantize"),
        "{code:?} {errors}"
    );
    let (code, _, errors) = bench(&["--precision", "int4"]);
    assert!(
        code == Some(2) && errors.contains("expected f32 or int8"),
        "{code:?} {errors}"
    );
}

#[test]
fn bench_reports_speed_stages_and_layers() {
    let args = [
        "bench",
        "--frames",
        "4",
        "--widths",
        "P90",
        "--encoder",
        "3x3",
        "--json",
    ];
    let output = run(args, b"");
    assert!(output.status.success(), "{}", stderr(&output));
    let object: Value = serde_json::from_str(&stdout(&output)).unwrap();
    for key in ["fps", "init_ms", "gflops", "prepared_frames_mib"] {
        assert!(object[key].as_f64().unwrap() > 0.0, "{key}");
    }
    let latency = |key: &str| object["latency_ms"][key].as_f64().unwrap();
    assert!(latency("p50") <= latency("p95") && latency("p99") <= latency("max"));
    let stages: f64 = object["stages_ms"]
        .as_object()
        .unwrap()
        .values()
        .map(|v| v.as_f64().unwrap())
        .sum();
    assert!(
        stages > 0.8 * latency("mean") && stages < 1.01 * latency("mean"),
        "{stages} of {}",
        latency("mean")
    );
    assert!(
        object["layers"]
            .as_array()
            .unwrap()
            .iter()
            .any(|layer| layer["name"] == "dr.e2.0")
    );
    let text = stdout(&run(["bench", "--frames", "2", "--widths", "P90"], b""));
    for part in ["FPS", "p99", "backbone", "GFLOP/s", "MiB"] {
        assert!(text.contains(part), "{part}: {text}");
    }
}

#[test]
fn bench_plan_times_every_algorithm() {
    let args = ["bench", "plan", "--widths", "P90", "--encoder", "3x3"];
    let plan: Value =
        serde_json::from_str(&stdout(&run(args.iter().chain(&["--json"]), b""))).unwrap();
    let layers = plan["layers"].as_array().unwrap();
    assert_eq!(layers.len(), 5 + 1 + 2 + 6 + 3);
    for layer in layers {
        let times = layer["ms"].as_object().unwrap();
        assert!(
            times.values().all(|ms| ms.as_f64().unwrap() > 0.0),
            "{layer}"
        );
        let chosen = |which: &str| times[layer[which].as_str().unwrap()].as_f64().unwrap();
        assert!(chosen("fastest") <= chosen("planned"), "{layer}");
        assert!(
            layer["layer"] != "backbone.conv1" || !times.contains_key("winograd6"),
            "its stride is 2"
        );
    }
    assert!(plan["fastest_ms"].as_f64() <= plan["planned_ms"].as_f64());
    assert!(stdout(&run(args, b"")).contains("head.offsets"));
}

#[test]
fn bench_measures_more_on_request_and_compares_two_runs() {
    let folder = folder("cli-bench");
    let small = ["bench", "--frames", "12", "--widths", "P90"];
    let bench = |more: &[&str]| {
        let output = run(small.iter().chain(more), b"");
        assert!(output.status.success(), "{}", stderr(&output));
        stdout(&output)
    };
    let more = ["--decode", "--sweep", "--minutes", "0.005"];
    let json = bench(&[&more[..], &["--json"]].concat());
    let object: Value = serde_json::from_str(&json).unwrap();
    assert!(object["fps_mean_of_rates"].as_f64().unwrap() >= object["fps"].as_f64().unwrap());
    assert_eq!(object["blocks_ms"].as_array().unwrap().len(), 6); // of two frames each
    assert!(object["decoding"]["fps"].as_f64().unwrap() > 0.0);
    assert!(object["decoding"]["decode_ms"]["p50"].as_f64().unwrap() > 0.0);
    assert_eq!(object["sweep"][0]["threads"], 1);
    assert!(object["endurance"][0]["median_ms"].as_f64().unwrap() > 0.0);
    let markdown = bench(&[&more[..], &["--markdown"]].concat());
    for part in [
        "| machine |",
        "| threads | 1: ",
        "| minutes | median",
        "| decoding |",
        "| backbone |",
        "|---|---:|",
    ] {
        assert!(markdown.contains(part), "{part}: {markdown}");
    }

    let (before, after, other) = (
        folder.join("a.json"),
        folder.join("b.json"),
        folder.join("c.json"),
    );
    // Steady times, whatever else this machine was doing.
    let with_blocks = |blocks: [f64; 6]| {
        let mut object = object.clone();
        object["blocks_ms"] = blocks.to_vec().into();
        object
    };
    std::fs::write(
        &before,
        with_blocks([10.0, 10.2, 9.9, 10.1, 10.0, 9.8]).to_string(),
    )
    .unwrap();
    let mut slow = with_blocks([15.1, 15.0, 14.9, 15.2, 15.0, 14.8]);
    slow["threads"] = 8.into();
    std::fs::write(&after, slow.to_string()).unwrap();
    let compare = |a: &Path, b: &Path, more: &[&str]| {
        run(
            ["bench", "compare", text(a), text(b)].iter().chain(more),
            b"",
        )
    };
    let same = stdout(&compare(&before, &before, &[]));
    assert!(
        same.contains("no difference beyond the noise: 0.0 %") && !same.contains("not the same"),
        "{same}"
    );
    let slower = stdout(&compare(&before, &after, &[]));
    assert!(
        slower.contains("\nslower: ") && slower.contains("threads was 1, is 8"),
        "{slower}"
    );
    let verdict: Value =
        serde_json::from_str(&stdout(&compare(&after, &before, &["--json"]))).unwrap();
    assert_eq!(
        (&verdict["verdict"], &verdict["differences"][0]["of"]),
        (&"faster".into(), &"threads".into())
    );
    std::fs::write(&other, "{\"fps\": 3}").unwrap();
    for (bad, part) in [
        (&other, "blocks_ms"),
        (&folder.join("none.json"), "none.json"),
    ] {
        let output = compare(&before, bad, &[]);
        assert_eq!(output.status.code(), Some(3));
        assert!(stderr(&output).contains(part), "{}", stderr(&output));
    }
}

#[test]
fn bench_worker_answers_each_line_with_times() {
    let output = run(
        [
            "bench",
            "worker",
            "--widths",
            "P90",
            "--encoder",
            "none",
            "--precision",
            "f32",
        ],
        b"3\n1\n",
    );
    assert!(output.status.success(), "{}", stderr(&output));
    let text = stdout(&output);
    let lines: Vec<Vec<&str>> = text.lines().map(|line| line.split(' ').collect()).collect();
    assert_eq!(lines[0], ["READY"]);
    assert_eq!(lines.iter().map(Vec::len).collect::<Vec<_>>(), [1, 3, 1]);
    assert!(
        lines[1..]
            .iter()
            .flatten()
            .all(|time| time.parse::<f64>().unwrap() > 0.0)
    );
}

#[test]
fn doctor_passes_its_self_test() {
    let output = run(["doctor", "--json"], b"");
    assert!(output.status.success(), "{}", stderr(&output));
    let object: Value = serde_json::from_str(&stdout(&output)).unwrap();
    assert_eq!(object["passed"], true);
    let tested = object["self_test"].as_array().unwrap().len();
    assert_eq!(tested, object["isas"].as_array().unwrap().len());
    assert!(object["speed"][0]["fps"].as_f64().unwrap() > 0.0);
    assert!(stdout(&run(["doctor"], b"")).contains("passed"));
}

#[test]
fn help_of_every_command_explains_it() {
    for (args, parts) in [
        (&["--help"][..], &["Exit codes", "track-cpu demo"][..]),
        (&["track", "--help"], &["rtsp://", "yuv420p", "--overlay"]),
        (&["demo", "--help"], &["IoU"]),
        (&["compare", "--help"], &["sheet.png"]),
        (&["info", "--help"], &["7,489,986"]),
        (&["bench", "--help"], &["GFLOP/s"]),
    ] {
        let output = run(args, b"");
        assert!(output.status.success());
        for part in parts {
            assert!(stdout(&output).contains(part), "{args:?}: {part}");
        }
    }
}
