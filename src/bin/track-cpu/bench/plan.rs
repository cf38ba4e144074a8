//! `bench --plan`: what every algorithm takes for every convolution on this machine, beside what was planned.

use kernels::conv::{Algorithm, Conv, ConvShape};
use kernels::par::Threads;
use kernels::quant::Quantization;
use kernels::{Isa, Size};
use serde_json::{Value, json};
use std::time::Instant;
use track_cpu::Model;
use track_cpu::model::conv_shape;
use weights_format::{Architecture, Branch, LayerKind};

/// Runs per algorithm; the median counts.
const RUNS: usize = 9;

/// One convolution of the search branch.
pub struct Row {
    layer: String,
    mmacs: f64,
    planned: Algorithm,           // in f32
    times: Vec<(Algorithm, f64)>, // ms
}

impl Row {
    /// The fastest algorithm in `f32`.
    fn fastest(&self) -> Algorithm {
        let floats = self.times.iter().filter(|(algorithm, _)| !matches!(algorithm, Algorithm::Int8(_)));
        floats.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(self.planned, |(algorithm, _)| *algorithm)
    }

    fn time(&self, algorithm: Algorithm) -> Option<f64> {
        self.times.iter().find(|(other, _)| *other == algorithm).map(|(_, ms)| *ms)
    }
}

/// Convolutions of a search pass and the side of their inputs.
fn convolutions(architecture: &Architecture) -> impl Iterator<Item = (String, ConvShape, Size)> {
    let layers = architecture.layers().into_iter();
    layers.filter(|layer| layer.kind == LayerKind::Conv && layer.branch != Branch::Template).map(|layer| {
        let side = (layer.out_search - 1) * layer.stride + layer.kernel - 2 * layer.pad;
        (layer.name.clone(), conv_shape(&layer), Size::square(side))
    })
}

/// How many convolutions there are to measure.
pub fn steps(model: &Model) -> usize {
    convolutions(model.architecture()).count()
}

/// Measures all of them on one thread.
pub fn measure(model: &Model, mut done: impl FnMut()) -> Vec<Row> {
    let isa = model.isa();
    let rows = convolutions(model.architecture()).map(|(layer, shape, size)| {
        let bytes = Algorithm::Int8(Quantization { scale: 1.0 / 128.0, zero_point: 128 });
        let algorithms = Algorithm::ALL.into_iter().chain([bytes]).filter(|a| a.supported(&shape) == *a);
        let times = algorithms.map(|algorithm| (algorithm, time(isa, algorithm, shape, size))).collect();
        done();
        Row { layer, mmacs: shape.macs(size) as f64 / 1e6, planned: Algorithm::plan(&shape, size), times }
    });
    rows.collect()
}

/// The median time of one convolution, in milliseconds.
fn time(isa: Isa, algorithm: Algorithm, shape: ConvShape, size: Size) -> f64 {
    let values = |n: usize| (0..n).map(|i| ((i * 7919) % 1000) as f32 / 500.0 - 1.0).collect::<Vec<_>>();
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
    let columns = ["direct", "im2col", "winograd6", "winograd8", "winograd10", "int8"];
    let mut text =
        format!("one thread, {}, ms per convolution\n\n{:18} {:>8}", model.isa().name(), "layer", "MMAC");
    columns.iter().for_each(|name| text += &format!(" {name:>10}"));
    text += &format!("  {:>10} {:>10}\n", "planned", "fastest");
    for row in rows {
        text += &format!("{:18} {:8.1}", row.layer, row.mmacs);
        for name in columns {
            let found = row.times.iter().find(|(algorithm, _)| algorithm.name() == name);
            text += &found.map_or(format!(" {:>10}", "-"), |(_, ms)| format!(" {ms:10.3}"));
        }
        text += &format!("  {:>10} {:>10}\n", row.planned.name(), row.fastest().name());
    }
    let [planned, fastest] = totals(rows);
    text + &format!("\nas planned {planned:.2} ms, the fastest of each {fastest:.2} ms (f32)")
}

/// The same for machines.
pub fn json(model: &Model, rows: &[Row]) -> Value {
    let [planned, fastest] = totals(rows);
    let layers = rows.iter().map(|row| {
        let times = row.times.iter().map(|(algorithm, ms)| (algorithm.name().to_owned(), json!(ms)));
        json!({
            "layer": row.layer,
            "mmacs": row.mmacs,
            "planned": row.planned.name(),
            "fastest": row.fastest().name(),
            "ms": Value::Object(times.collect()),
        })
    });
    json!({
        "isa": model.isa().name(),
        "layers": layers.collect::<Vec<_>>(),
        "planned_ms": planned,
        "fastest_ms": fastest,
    })
}

/// All layers together, as planned and with the fastest of each.
fn totals(rows: &[Row]) -> [f64; 2] {
    let total =
        |choice: &dyn Fn(&Row) -> Algorithm| rows.iter().filter_map(|row| row.time(choice(row))).sum();
    [total(&|row| row.planned), total(&Row::fastest)]
}
