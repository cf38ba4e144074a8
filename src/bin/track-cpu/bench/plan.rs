//! `bench plan`: what every algorithm takes for every convolution on this machine, beside what
//! was planned.

use kernels::conv::{Algorithm, Conv, ConvShape};
use kernels::par::Threads;
use kernels::quant::Quantization;
use kernels::{Isa, Size};
use serde_json::{Value, json};
use std::time::Instant;
use track_cpu::Model;
use track_cpu::model::{LayerPlan, conv_shape};
use weights_format::Branch;

/// Runs per algorithm; the median counts.
const RUNS: usize = 9;

/// One convolution of the search branch.
pub struct Row {
    layer: String,
    mmacs: f64,
    planned: &'static str,
    integers: bool,                  // whether it may compute in them
    times: Vec<(&'static str, f64)>, // ms
}

impl Row {
    /// The fastest algorithm that was allowed.
    fn fastest(&self) -> &'static str {
        let floats = Algorithm::ALL.map(Algorithm::name);
        let allowed = self
            .times
            .iter()
            .filter(|(name, _)| self.integers || floats.contains(name));
        allowed
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .map_or(self.planned, |(name, _)| name)
    }

    fn time(&self, algorithm: &str) -> Option<f64> {
        self.times
            .iter()
            .find(|(name, _)| *name == algorithm)
            .map(|(_, ms)| *ms)
    }
}

/// Convolutions of a search pass.
fn convolutions(model: &Model) -> impl Iterator<Item = LayerPlan> {
    let search =
        |plan: &LayerPlan| plan.algorithm.is_some() && plan.layer.branch != Branch::Template;
    model.plan().into_iter().filter(search)
}

/// How many convolutions there are to measure.
pub fn steps(model: &Model) -> usize {
    convolutions(model).count()
}

/// Measures all of them on one thread.
pub fn measure(model: &Model, mut done: impl FnMut()) -> Vec<Row> {
    let isa = model.isa();
    let rows = convolutions(model).map(
        |LayerPlan {
             layer,
             algorithm,
             input,
         }| {
            let side = (layer.out_search - 1) * layer.stride + layer.kernel - 2 * layer.pad;
            let (shape, size) = (conv_shape(&layer), Size::square(side));
            let range = Quantization {
                scale: 1.0 / 128.0,
                zero_point: 128,
            };
            let all = Algorithm::ALL.into_iter().chain(Algorithm::integers(range));
            let times = all.filter(|a| a.supported(&shape) == *a);
            let times = times
                .map(|algorithm| (algorithm.name(), time(isa, algorithm, shape, size)))
                .collect();
            done();
            Row {
                mmacs: shape.macs(size) as f64 / 1e6,
                planned: algorithm.map_or("", Algorithm::name),
                integers: input.is_some(),
                layer: layer.name,
                times,
            }
        },
    );
    rows.collect()
}

/// The median time of one convolution, in milliseconds.
fn time(isa: Isa, algorithm: Algorithm, shape: ConvShape, size: Size) -> f64 {
    let values = |n: usize| {
        (0..n)
            .map(|i| ((i * 7919) % 1000) as f32 / 500.0 - 1.0)
            .collect::<Vec<_>>()
    };
    let weights = values(shape.out_channels * shape.kernel * shape.kernel * shape.in_channels);
    let input = values(size.area() * shape.in_channels);
    let conv = Conv::new(isa, algorithm, shape, &weights, &values(shape.out_channels));
    let threads = Threads::new(1);
    let mut scratch = vec![0.0; conv.scratch_len(size, &threads)];
    let mut out = vec![0.0; shape.out_size(size).area() * shape.out_channels];
    let mut run = || {
        let start = Instant::now();
        conv.run(&threads, &input, size, &mut out, &mut scratch);
        start.elapsed().as_secs_f64() * 1e3
    };
    run();
    let mut times: Vec<f64> = (0..RUNS).map(|_| run()).collect();
    times.sort_by(f64::total_cmp);
    times[RUNS / 2]
}

/// The table for people.
pub fn text(model: &Model, rows: &[Row]) -> String {
    let columns = [
        "direct",
        "im2col",
        "winograd6",
        "winograd8",
        "winograd10",
        "int8",
        "winograd6-int16",
        "winograd8-int16",
    ];
    let mut text = format!(
        "one thread, {}, ms per convolution\n\n{:18} {:>8}",
        model.isa().name(),
        "layer",
        "MMAC"
    );
    for name in columns {
        text += &format!(" {name:>15}");
    }
    text += &format!("  {:>15} {:>15}\n", "planned", "fastest");
    for row in rows {
        text += &format!("{:18} {:8.1}", row.layer, row.mmacs);
        for name in columns {
            text += &row
                .time(name)
                .map_or(format!(" {:>15}", "-"), |ms| format!(" {ms:15.3}"));
        }
        text += &format!("  {:>15} {:>15}\n", row.planned, row.fastest());
    }
    let [planned, fastest] = totals(rows);
    text + &format!(
        "\nas planned {planned:.2} ms, the fastest of each {fastest:.2} ms ({})",
        model.precision().name()
    )
}

/// The same for machines.
pub fn json(model: &Model, rows: &[Row]) -> Value {
    let [planned, fastest] = totals(rows);
    let layers = rows.iter().map(|row| {
        let times = row
            .times
            .iter()
            .map(|(name, ms)| ((*name).to_owned(), json!(ms)));
        json!({
            "layer": row.layer,
            "mmacs": row.mmacs,
            "planned": row.planned,
            "fastest": row.fastest(),
            "ms": Value::Object(times.collect()),
        })
    });
    json!({
        "isa": model.isa().name(),
        "precision": model.precision().name(),
        "layers": layers.collect::<Vec<_>>(),
        "planned_ms": planned,
        "fastest_ms": fastest,
    })
}

/// All layers together, as planned and with the fastest of each.
fn totals(rows: &[Row]) -> [f64; 2] {
    let total = |choice: &dyn Fn(&Row) -> &'static str| {
        rows.iter().filter_map(|row| row.time(choice(row))).sum()
    };
    [total(&|row| row.planned), total(&Row::fastest)]
}
