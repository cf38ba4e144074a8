//! What was measured, as text, Markdown and JSON.

use serde_json::{Map, Value, json};
use track_cpu::Model;
use track_cpu::model::LayerPlan;

use super::clip::{Clip, HEIGHT, WIDTH};
use super::measure::{Measured, Window};
use crate::args::bench::MeasureArgs;
use crate::machine::{Machine, peak_memory};
use crate::report::{rounded, table};
use crate::statistics::Times;

/// The stages in which the network runs; the others are crop and choice of the box.
const NETWORK: [&str; 5] = ["backbone", "dr", "neck", "xcorr", "head"];

/// A measurement and what it was made with.
pub struct Report<'a> {
    /// The options.
    pub args: &'a MeasureArgs,
    /// The model.
    pub model: &'a Model,
    /// The times.
    pub measured: Measured,
}

impl Report<'_> {
    /// Billions of floating-point operations per second within the network, two per
    /// multiply-accumulate.
    fn gflops(&self) -> f64 {
        let network = self
            .measured
            .stages
            .iter()
            .filter(|(name, _)| NETWORK.contains(name));
        let milliseconds: f64 = network.map(|(_, times)| times.mean()).sum();
        2.0 * self.model.architecture().macs_search() as f64 / milliseconds / 1e6
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

    fn run(&self) -> String {
        let (isa, threads) = (self.model.isa().name(), self.args.network.engine.threads);
        let plural = if threads == 1 { "" } else { "s" };
        let (precision, frames) = (self.model.precision().name(), self.args.frames);
        format!("{isa}, {threads} thread{plural}, {precision}, {frames} frames of {WIDTH}x{HEIGHT}")
    }

    fn model_line(&self) -> String {
        format!(
            "{}, {:.0} MMAC a frame",
            self.model_name(),
            self.model.architecture().macs_search() as f64 / 1e6
        )
    }

    fn latency(times: &Times) -> String {
        let [p50, p95, p99, max] = [0.5, 0.95, 0.99, 1.0].map(|share| times.percentile(share));
        format!("p50 {p50:.2} ms, p95 {p95:.2} ms, p99 {p99:.2} ms, max {max:.2} ms")
    }

    fn speed(times: &Times) -> String {
        format!(
            "{:.1} FPS (frames / total time), {:.1} (got10k: mean of rates)",
            times.fps(),
            times.mean_of_rates()
        )
    }

    /// Lines beyond the plain measurement: what each is called and what it says.
    fn more(&self) -> Vec<(&'static str, String)> {
        let mut lines = Vec::new();
        if let Some(decoding) = &self.measured.decoding {
            let text = format!(
                "{:.1} FPS with reading and decoding a JPEG first ({:.2} ms of it), on the same \
                 thread",
                decoding.all.fps(),
                decoding.decode.mean()
            );
            lines.push(("decoding", text));
        }
        if !self.measured.sweep.is_empty() {
            let one =
                |(threads, times): &(usize, Times)| format!("{threads}: {:.1} FPS", times.fps());
            lines.push((
                "threads",
                self.measured
                    .sweep
                    .iter()
                    .map(one)
                    .collect::<Vec<_>>()
                    .join(", "),
            ));
        }
        if let Some(drift) = drift(&self.measured.endurance) {
            lines.push(("minutes", drift));
        }
        lines
    }

    fn stage_rows(&self) -> Vec<Vec<String>> {
        let total = self.measured.frames.mean();
        let row = |(name, times): &(&str, Times)| {
            let ms = [times.mean(), times.percentile(0.5), times.percentile(0.95)]
                .map(|v| format!("{v:.3}"));
            let share = format!("{:.1} %", 100.0 * times.mean() / total);
            [vec![(*name).to_string()], ms.to_vec(), vec![share]].concat()
        };
        self.measured.stages.iter().map(row).collect()
    }

    /// For a terminal.
    pub fn text(&self) -> String {
        let Measured {
            init_ms, frames, ..
        } = &self.measured;
        let peak = Self::peak_mib().map_or("unknown on this system".into(), |mib| {
            format!(
                "{mib:.0} MiB, of which {:.0} MiB are the prepared frames",
                Clip::mib()
            )
        });
        let mut lines = vec![
            ("machine", Machine::detect().to_string()),
            ("model", self.model_line()),
            ("run", self.run()),
            ("", String::new()),
            ("speed", Self::speed(frames)),
            (
                "latency",
                format!("{}; init {init_ms:.2} ms", Self::latency(frames)),
            ),
            ("network", format!("{:.1} GFLOP/s", self.gflops())),
            ("memory", peak),
        ];
        lines.extend(self.more());
        let lines: Vec<String> = lines
            .iter()
            .map(|(name, text)| format!("{name:<9}{text}").trim_end().to_string())
            .collect();
        let stages = table(
            &["stage", "mean ms", "p50 ms", "p95 ms", "share"],
            &self.stage_rows(),
        );
        format!(
            "{}\n\n{stages}\n\n{}",
            lines.join("\n"),
            algorithms(&self.model.plan())
        )
    }

    /// For a document.
    pub fn markdown(&self) -> String {
        let Measured {
            init_ms, frames, ..
        } = &self.measured;
        let mut rows = vec![
            ("machine", Machine::detect().to_string()),
            ("model", self.model_line()),
            ("run", self.run()),
            (
                "speed",
                format!("**{:.1} FPS** (frames / total time)", frames.fps()),
            ),
            (
                "got10k's mean of rates",
                format!("{:.1} FPS", frames.mean_of_rates()),
            ),
            (
                "latency",
                format!("{}; init {init_ms:.2} ms", Self::latency(frames)),
            ),
            ("network", format!("{:.1} GFLOP/s", self.gflops())),
        ];
        rows.extend(self.more());
        let rows: String = rows
            .iter()
            .map(|(name, text)| format!("| {name} | {text} |\n"))
            .collect();
        let stages: String = self
            .stage_rows()
            .iter()
            .map(|row| format!("| {} |\n", row.join(" | ")))
            .collect();
        format!(
            "| | |\n|---|---|\n{rows}\n| stage | mean ms | p50 ms | p95 ms | share |\n\
             |---|---:|---:|---:|---:|\n{}",
            stages.trim_end()
        )
    }

    /// For programs, `bench compare` among them.
    pub fn json(&self) -> Value {
        let Measured {
            init_ms,
            frames,
            stages,
            decoding,
            sweep,
            endurance,
        } = &self.measured;
        let ms = |value: f64| rounded(value, 4);
        let stage = |(name, times): &(&str, Times)| ((*name).to_string(), ms(times.mean()));
        let layer = |plan: &LayerPlan| {
            let algorithm = plan.algorithm.map(|algorithm| algorithm.name());
            json!({ "name": plan.layer.name, "algorithm": algorithm })
        };
        let latency = |times: &Times| {
            let [p50, p95, p99, max] =
                [0.5, 0.95, 0.99, 1.0].map(|share| ms(times.percentile(share)));
            json!({ "mean": ms(times.mean()), "p50": p50, "p95": p95, "p99": p99, "max": max })
        };
        let threads = |(threads, times): &(usize, Times)| {
            let median = ms(times.percentile(0.5));
            json!({ "threads": threads, "fps": rounded(times.fps(), 2), "p50_ms": median })
        };
        let window = |window: &Window| {
            let median = ms(window.median_ms);
            json!({ "until_s": rounded(window.until_s, 1), "median_ms": median })
        };
        json!({
            "fps": rounded(frames.fps(), 2),
            "fps_mean_of_rates": rounded(frames.mean_of_rates(), 2),
            "frames": self.args.frames,
            "width": WIDTH,
            "height": HEIGHT,
            "latency_ms": latency(frames),
            "blocks_ms": frames.blocks().iter().map(|median| ms(*median)).collect::<Vec<_>>(),
            "init_ms": ms(*init_ms),
            "stages_ms": stages.iter().map(stage).collect::<Map<_, _>>(),
            "decoding": decoding.as_ref().map(|decoding| json!({
                "fps": rounded(decoding.all.fps(), 2),
                "latency_ms": latency(&decoding.all),
                "decode_ms": latency(&decoding.decode),
            })),
            "sweep": sweep.iter().map(threads).collect::<Vec<_>>(),
            "endurance": endurance.iter().map(window).collect::<Vec<_>>(),
            "gflops": rounded(self.gflops(), 2),
            "macs": self.model.architecture().macs_search(),
            "isa": self.model.isa().name(),
            "threads": self.args.network.engine.threads,
            "precision": self.model.precision().name(),
            "model": self.model_name(),
            "layers": self.model.plan().iter().map(layer).collect::<Vec<_>>(),
            "peak_memory_mib": Self::peak_mib().map(|mib| rounded(mib, 1)),
            "prepared_frames_mib": rounded(Clip::mib(), 1),
            "machine": Machine::detect().json(),
        })
    }
}

/// What became of the speed over minutes.
fn drift(windows: &[Window]) -> Option<String> {
    let (first, last) = (windows.first()?, windows.last()?);
    let slowest = windows
        .iter()
        .map(|window| window.median_ms)
        .fold(0.0, f64::max);
    Some(format!(
        "median {:.2} ms at the start, {:.2} ms after {:.1} min ({:+.1} %), {slowest:.2} ms in the \
         slowest of {} windows",
        first.median_ms,
        last.median_ms,
        last.until_s / 60.0,
        100.0 * (last.median_ms / first.median_ms - 1.0),
        windows.len(),
    ))
}

/// The algorithm of every convolution, layers of the same one on one line.
fn algorithms(plan: &[LayerPlan]) -> String {
    let mut lines: Vec<(&str, Vec<&str>)> = Vec::new();
    for (name, algorithm) in plan
        .iter()
        .filter_map(|p| Some((p.layer.name.as_str(), p.algorithm?.name())))
    {
        match lines.iter_mut().find(|(a, _)| *a == algorithm) {
            Some((_, layers)) => layers.push(name),
            None => lines.push((algorithm, vec![name])),
        }
    }
    let line =
        |(algorithm, layers): &(&str, Vec<&str>)| format!("{algorithm}: {}", layers.join(", "));
    lines.iter().map(line).collect::<Vec<_>>().join("\n")
}
