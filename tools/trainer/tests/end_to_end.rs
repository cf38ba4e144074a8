//! From a folder of frames and boxes to a model that tracks them: the README's "train on your own
//! videos", on flights that are rendered here.

use scenes::{Difficulty, Flight, FlightConfig, FrameBuffer};
use std::path::Path;
use std::process::Command;
use testing::Folder;
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Tracker};

/// One sequence: its frames and the target's box in each.
struct Video {
    frames: Vec<FrameBuffer>,
    boxes: Vec<BBox>,
}

impl Video {
    fn render(seed: u64, frames: usize) -> Video {
        let config = FlightConfig {
            width: 320,
            height: 200,
            frames,
            seed,
            difficulty: Difficulty::Easy,
            distractors: Some(0),
            ..FlightConfig::default()
        };
        let flight = Flight::new(config);
        let mut video = Video {
            frames: Vec::new(),
            boxes: Vec::new(),
        };
        for i in 0..flight.len() {
            let mut frame = FrameBuffer::default();
            let b = flight.render(i, &mut frame).bbox;
            video.frames.push(frame);
            video.boxes.push(BBox::new(b.x, b.y, b.w, b.h));
        }
        video
    }

    /// As OTB has it: pictures in `img`, boxes in `groundtruth_rect.txt`.
    fn write(&self, folder: &Path) {
        std::fs::create_dir_all(folder.join("img")).unwrap();
        let mut text = String::new();
        for (i, (frame, b)) in self.frames.iter().zip(&self.boxes).enumerate() {
            let (w, h) = (frame.width as u32, frame.height as u32);
            let picture = image::RgbImage::from_raw(w, h, frame.data.clone()).unwrap();
            picture
                .save(folder.join(format!("img/{:04}.png", i + 1)))
                .unwrap();
            text += &format!("{},{},{},{}\n", b.x, b.y, b.w, b.h);
        }
        std::fs::write(folder.join("groundtruth_rect.txt"), text).unwrap();
    }

    fn frame(&self, i: usize) -> Frame<'_> {
        let FrameBuffer {
            width,
            height,
            data,
        } = &self.frames[i];
        Frame::new(data, *width, *height, ChannelOrder::Rgb).unwrap()
    }

    /// Mean IoU of a tracker that is given the first box; and of that box, if it never moved.
    fn track(&self, model: &Model) -> [f32; 2] {
        let mut tracker = Tracker::new(model.clone());
        tracker.init(&self.frame(0), self.boxes[0]).unwrap();
        let mut sums = [0.0; 2];
        for (i, truth) in self.boxes.iter().enumerate().skip(1) {
            let found = tracker.update(&self.frame(i)).unwrap().bbox;
            sums[0] += found.iou(truth);
            sums[1] += self.boxes[0].iou(truth);
        }
        sums.map(|sum| sum / (self.frames.len() - 1) as f32)
    }
}

/// Renders videos, trains on them with `options`, exports, and tracks the same videos: mean IoU of
/// the tracker and of a box that never moves.
fn train_and_track(name: &str, seeds: &[u64], frames: usize, options: &[&str]) -> [f32; 2] {
    let folder = Folder::new(name);
    let videos: Vec<_> = seeds
        .iter()
        .map(|seed| Video::render(*seed, frames))
        .collect();
    for (i, video) in videos.iter().enumerate() {
        video.write(&folder.join(&format!("videos/flight{i}")));
    }
    let (data, run, model) = (
        folder.at("videos"),
        folder.at("run"),
        folder.at("mine.safetensors"),
    );
    let train = |args: &[&str]| {
        let output = Command::new(env!("CARGO_BIN_EXE_train"))
            .args(args)
            .output()
            .unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        assert!(
            output.status.success(),
            "{}{}",
            text(&output.stdout),
            text(&output.stderr)
        );
    };
    train(&[&["fit", "--data", &data, "--out", &run], options].concat());
    train(&[
        "export",
        &format!("{run}/final.safetensors"),
        "--out",
        &model,
        "--dtype",
        "f16",
    ]);
    let model = Model::read(Path::new(&model), Isa::detect()).unwrap();
    let found: Vec<_> = videos.iter().map(|video| video.track(&model)).collect();
    let mean = |of: usize| found.iter().map(|ious| ious[of]).sum::<f32>() / found.len() as f32;
    println!(
        "mean IoU {:.3}, of a box that never moves {:.3}",
        mean(0),
        mean(1)
    );
    [mean(0), mean(1)]
}

#[test]
fn tiny_network_tracks_its_training_flight() {
    let options = "--ratio 0.9 --search-size 223 --early-share 0 --augment light --negatives 0 \
                   --no-mi --no-identity --steps 110 --batch 8 --rate 0.003 \
                   --estimation-batches 4 --data-threads 2";
    let options: Vec<_> = options.split_whitespace().collect();
    let [tracked, still] = train_and_track("short", &[13], 24, &options);
    assert!(
        tracked > 0.35 && tracked > still + 0.1,
        "mean IoU {tracked}, a box that never moves {still}"
    );
}

/// The README's commands with a few minutes in place of hours:
/// `cargo test --release -p trainer --test end_to_end -- --ignored --nocapture`.
#[test]
#[ignore = "takes about ten minutes"]
fn the_commands_of_the_readme_end_with_a_model_that_tracks() {
    let options = ["--data", "scenes:0.25", "--minutes", "9"];
    let [tracked, still] = train_and_track("long", &[13, 18, 19], 90, &options);
    assert!(
        tracked > 0.5 && tracked > still + 0.2,
        "mean IoU {tracked}, a box that never moves {still}"
    );
}
