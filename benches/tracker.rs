//! Times the tracker from frame to box: the median `update` of the built-in model on rendered 720p
//! frames in memory, per instruction set, precision and number of threads:
//!
//! ```text
//! cargo bench --bench tracker [-- NAME...]
//! ```
//!
//! Names of instruction sets and precisions choose the rows. `track-cpu bench` measures more about
//! one of them.

use scenes::{Flight, FlightConfig, FrameBuffer};
use std::time::{Duration, Instant};
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, Precision, Tracker, TrackerOptions};

/// Frames of the clip, which is shown forwards and backwards in turn.
const FRAMES: usize = 24;

/// Updates per row, after a tenth as many to warm up.
const UPDATES: usize = 100;

struct Clip {
    frames: Vec<FrameBuffer>,
    target: BBox,
}

impl Clip {
    fn render() -> Clip {
        let flight = Flight::new(FlightConfig {
            width: 1280,
            height: 720,
            frames: FRAMES,
            ..FlightConfig::default()
        });
        let mut frames = vec![FrameBuffer::default(); FRAMES];
        let mut targets = frames
            .iter_mut()
            .enumerate()
            .map(|(i, frame)| flight.render(i, frame).bbox);
        let first = targets.next().expect("a frame");
        targets.for_each(drop);
        Clip {
            frames,
            target: BBox::new(first.x, first.y, first.w, first.h),
        }
    }

    /// Frame `i` of the clip shown forwards and backwards in turn.
    fn frame(&self, i: usize) -> Frame<'_> {
        let at = i % (2 * FRAMES - 2);
        let frame = &self.frames[at.min(2 * FRAMES - 2 - at)];
        Frame::new(&frame.data, frame.width, frame.height, ChannelOrder::Rgb)
            .expect("a frame of its size")
    }
}

/// The times of all updates, sorted, and the mean share of each stage.
fn measure(
    clip: &Clip,
    model: &Model,
    threads: usize,
) -> (Vec<Duration>, Vec<(&'static str, f64)>) {
    let options = TrackerOptions {
        threads,
        ..TrackerOptions::of(model)
    };
    let mut tracker = Tracker::with_options(model.clone(), options);
    tracker
        .init(&clip.frame(0), clip.target)
        .expect("a target in its frame");
    let (mut times, mut stages) = (Vec::new(), Vec::new());
    for i in 1..=UPDATES + UPDATES / 10 {
        let frame = clip.frame(i);
        let start = Instant::now();
        tracker.update(&frame).expect("a target");
        if i > UPDATES / 10 {
            times.push(start.elapsed());
            stages.push(
                tracker
                    .stages()
                    .iter()
                    .map(|(name, time)| (name, time.as_secs_f64()))
                    .collect::<Vec<_>>(),
            );
        }
    }
    let total: f64 = stages.iter().flatten().map(|(_, seconds)| seconds).sum();
    let share = |stage: usize| {
        let seconds: f64 = stages.iter().map(|update| update[stage].1).sum();
        (stages[0][stage].0, seconds / total)
    };
    times.sort();
    (times, (0..stages[0].len()).map(share).collect())
}

fn main() {
    let args: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let precisions = [Precision::F32, Precision::Int8];
    let isas = Isa::available();
    let isa_names: Vec<_> = isas.iter().map(|isa| isa.name()).collect();
    let asked = |names: &[&str], name: &str| {
        !args.iter().any(|a| names.contains(&a.as_str())) || args.iter().any(|a| a == name)
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let clip = Clip::render();
    let weights = Model::builtin_weights();
    println!(
        "{:12} {:9} {:>7} {:>9} {:>9} {:>7}  shares",
        "isa", "precision", "threads", "p50 ms", "p99 ms", "FPS"
    );
    for isa in isas.iter().filter(|isa| asked(&isa_names, isa.name())) {
        for precision in precisions
            .into_iter()
            .filter(|p| asked(&precisions.map(Precision::name), p.name()))
        {
            let model =
                Model::with_precision(&weights, *isa, precision).expect("the built-in model runs");
            for threads in [1, 2, 4].into_iter().filter(|n| *n <= cores) {
                let (times, stages) = measure(&clip, &model, threads);
                let ms = |share: f64| {
                    1e3 * times[(share * (times.len() - 1) as f64) as usize].as_secs_f64()
                };
                let fps = times.len() as f64 / times.iter().sum::<Duration>().as_secs_f64();
                let shares: Vec<_> = stages
                    .iter()
                    .map(|(name, share)| format!("{name} {:.1} %", 100.0 * share))
                    .collect();
                println!(
                    "{:12} {:9} {threads:7} {:9.2} {:9.2} {fps:7.1}  {}",
                    isa.name(),
                    precision.name(),
                    ms(0.5),
                    ms(0.99),
                    shares.join(", ")
                );
            }
        }
    }
}
