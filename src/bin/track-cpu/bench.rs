//! `bench`: speed of the whole tracker on frames that lie ready in memory.

use std::time::Instant;

use scenes::{Flight, FlightConfig, FrameBuffer};
use serde_json::{Map, Value, json};
use track_cpu::model::LayerPlan;
use track_cpu::{BBox, ChannelOrder, Frame, Model, ModelError, Tracker, TrackerOptions};
use weights_format::Weights;

use crate::args::{BenchArgs, Precision};
use crate::exit::Failure;
use crate::machine::{Machine, peak_memory};
use crate::report::{print, progress, rounded, table};
use crate::statistics::Times;

/// Distinct frames; they are played back and forth, so that the object never jumps.
const PREPARED: usize = 32;
const WIDTH: usize = 1280;
const HEIGHT: usize = 720;
/// The stages in which the network runs; the others are crop and choice of the box.
const NETWORK: [&str; 5] = ["backbone", "dr", "neck", "xcorr", "head"];

/// Runs the sub-command.
pub fn run(args: &BenchArgs) -> Result<(), Failure> {
    let Precision::F32 = args.precision;
    let model = model(args)?;
    let (frames, target) = prepare();
    let bar = progress(Some(args.frames + args.frames / 10));
    let measured = measure(args, &model, &frames, target, || bar.inc(1))?;
    bar.finish_and_clear();
    let report = Report { args, model: &model, measured };
    match args.json {
        true => print(&report.json().to_string()),
        false => print(&report.text()),
    }
}

/// The model that the arguments ask for.
pub fn model(args: &BenchArgs) -> Result<Model, Failure> {
    let weights = match (args.random.weights()?, &args.model) {
        (Some(weights), _) => weights,
        (None, Some(path)) => Weights::read(path).map_err(ModelError::from)?,
        (None, None) => Model::builtin_weights(),
    };
    Ok(match args.algorithm {
        Some(algorithm) => Model::with_algorithm(&weights, args.engine.isa(), algorithm)?,
        None => Model::from_weights(&weights, args.engine.isa())?,
    })
}

/// Renders the frames, and says where the object is in the first.
fn prepare() -> (Vec<FrameBuffer>, BBox) {
    let config = FlightConfig { width: WIDTH, height: HEIGHT, frames: PREPARED, ..FlightConfig::default() };
    let flight = Flight::new(config);
    let mut target = BBox::default();
    let mut render = |index| {
        let mut buffer = FrameBuffer::default();
        let truth = flight.render(index, &mut buffer).bbox;
        if index == 0 {
            target = BBox::new(truth.x, truth.y, truth.w, truth.h);
        }
        buffer
    };
    let frames = (0..PREPARED).map(&mut render).collect();
    (frames, target)
}

/// What was measured.
struct Measured {
    init_ms: f64,
    frames: Times,
    stages: Vec<(&'static str, Times)>,
}

fn measure(
    args: &BenchArgs,
    model: &Model,
    buffers: &[FrameBuffer],
    target: BBox,
    tick: impl Fn(),
) -> Result<Measured, Failure> {
    let frames = buffers.iter().map(|b| Frame::new(&b.data, b.width, b.height, ChannelOrder::Rgb));
    let frames: Vec<Frame<'_>> = frames.collect::<Result<_, _>>()?;
    let options = TrackerOptions { threads: args.engine.threads, config: model.config() };
    let mut tracker = Tracker::with_options(model.clone(), options);

    tracker.init(&frames[0], target)?; // the first call also touches every buffer
    let started = Instant::now();
    tracker.init(&frames[0], target)?;
    let init_ms = started.elapsed().as_secs_f64() * 1e3;

    let there_and_back = (1..frames.len()).chain((0..frames.len() - 1).rev());
    let mut order = there_and_back.cycle();
    let mut next = || &frames[order.next().unwrap_or(0)];
    for _ in 0..args.frames / 10 {
        tracker.update(next())?;
        tick();
    }
    let mut times = Vec::with_capacity(args.frames);
    let mut stages: Vec<(&'static str, Vec<_>)> = Vec::new();
    for _ in 0..args.frames {
        let frame = next();
        let started = Instant::now();
        tracker.update(frame)?;
        times.push(started.elapsed());
        for (i, (name, time)) in tracker.stages().iter().enumerate() {
            if stages.len() <= i {
                stages.push((name, Vec::with_capacity(args.frames)));
            }
            stages[i].1.push(time);
        }
        tick();
    }
    let stages = stages.into_iter().map(|(name, times)| (name, Times::new(&times))).collect();
    Ok(Measured { init_ms, frames: Times::new(&times), stages })
}

struct Report<'a> {
    args: &'a BenchArgs,
    model: &'a Model,
    measured: Measured,
}

impl Report<'_> {
    /// Billions of floating-point operations per second within the network, two per multiply-accumulate.
    fn gflops(&self) -> f64 {
        let network = self.measured.stages.iter().filter(|(name, _)| NETWORK.contains(name));
        let milliseconds: f64 = network.map(|(_, times)| times.mean()).sum();
        2.0 * self.model.architecture().macs_search() as f64 / milliseconds / 1e6
    }

    fn prepared_mib() -> f64 {
        (PREPARED * WIDTH * HEIGHT * 3) as f64 / f64::from(1 << 20)
    }

    fn peak_mib() -> Option<f64> {
        peak_memory().map(|bytes| bytes as f64 / f64::from(1 << 20))
    }

    fn model_name(&self) -> &str {
        match self.model.header().provenance.name.as_str() {
            "" => "random weights",
            name => name,
        }
    }

    fn text(&self) -> String {
        let Measured { init_ms, frames, stages } = &self.measured;
        let total = frames.mean();
        let stage_rows: Vec<Vec<String>> = stages
            .iter()
            .map(|(name, times)| {
                vec![
                    (*name).into(),
                    format!("{:.3}", times.mean()),
                    format!("{:.3}", times.percentile(0.5)),
                    format!("{:.3}", times.percentile(0.95)),
                    format!("{:.1} %", 100.0 * times.mean() / total),
                ]
            })
            .collect();
        let peak = Self::peak_mib().map_or("unknown on this system".into(), |mib| {
            format!("{mib:.0} MiB, of which {:.0} MiB are the prepared frames", Self::prepared_mib())
        });
        let (p50, p95, p99) = (frames.percentile(0.5), frames.percentile(0.95), frames.percentile(0.99));
        format!(
            "machine  {}\nmodel    {}, {:.0} MMAC a frame\nrun      {}, {} threads, f32, {} frames of {WIDTH}x{HEIGHT}\n\n\
             speed    {:.1} FPS\nlatency  p50 {p50:.2} ms, p95 {p95:.2} ms, p99 {p99:.2} ms, max {:.2} ms; \
             init {init_ms:.2} ms\nnetwork  {:.1} GFLOP/s\nmemory   {peak}\n\n{}\n\n{}",
            Machine::detect(),
            self.model_name(),
            self.model.architecture().macs_search() as f64 / 1e6,
            self.model.isa().name(),
            self.args.engine.threads,
            self.args.frames,
            frames.fps(),
            frames.percentile(1.0),
            self.gflops(),
            table(&["stage", "mean ms", "p50 ms", "p95 ms", "share"], &stage_rows),
            algorithms(&self.model.plan()),
        )
    }

    fn json(&self) -> Value {
        let Measured { init_ms, frames, stages } = &self.measured;
        let ms = |value: f64| rounded(value, 4);
        let stage = |(name, times): &(&str, Times)| ((*name).to_string(), ms(times.mean()));
        let layer = |plan: &LayerPlan| {
            let algorithm = plan.algorithm.map(|algorithm| algorithm.name());
            json!({ "name": plan.layer.name, "algorithm": algorithm })
        };
        json!({
            "fps": rounded(frames.fps(), 2),
            "frames": self.args.frames,
            "width": WIDTH,
            "height": HEIGHT,
            "latency_ms": {
                "mean": ms(frames.mean()),
                "p50": ms(frames.percentile(0.5)),
                "p95": ms(frames.percentile(0.95)),
                "p99": ms(frames.percentile(0.99)),
                "max": ms(frames.percentile(1.0)),
            },
            "init_ms": ms(*init_ms),
            "stages_ms": stages.iter().map(stage).collect::<Map<_, _>>(),
            "gflops": rounded(self.gflops(), 2),
            "macs": self.model.architecture().macs_search(),
            "isa": self.model.isa().name(),
            "threads": self.args.engine.threads,
            "precision": "f32",
            "model": self.model_name(),
            "layers": self.model.plan().iter().map(layer).collect::<Vec<_>>(),
            "peak_memory_mib": Self::peak_mib().map(|mib| rounded(mib, 1)),
            "prepared_frames_mib": rounded(Self::prepared_mib(), 1),
            "machine": Machine::detect().json(),
        })
    }
}

/// The algorithm of every convolution, layers of the same one on one line.
fn algorithms(plan: &[LayerPlan]) -> String {
    let mut lines: Vec<(&str, Vec<&str>)> = Vec::new();
    for (name, algorithm) in plan.iter().filter_map(|p| Some((p.layer.name.as_str(), p.algorithm?.name()))) {
        match lines.iter_mut().find(|(a, _)| *a == algorithm) {
            Some((_, layers)) => layers.push(name),
            None => lines.push((algorithm, vec![name])),
        }
    }
    let line = |(algorithm, layers): &(&str, Vec<&str>)| format!("{algorithm}: {}", layers.join(", "));
    lines.iter().map(line).collect::<Vec<_>>().join("\n")
}
