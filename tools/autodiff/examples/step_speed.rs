//! Times training steps of the half-width network on random crops: pairs per second and peak
//! memory.
//!
//! `cargo run --release -p autodiff --example step_speed [SIZE [BATCH [THREADS [STEPS]]]]` (303,
//! 16, 2, 5). The statistics networks see averages, with 256 hidden units.

#[path = "../tests/network/mod.rs"]
mod network;

use autodiff::optim::{Optimizer, Sgd};
use autodiff::{BoxDecoder, Compute, Mode, Parameters, Tape, Tensor};
use network::{Batch, Config, DrMim};
use std::time::Instant;
use testing::noise;

const HALF: Config = Config {
    backbone: [48, 128, 192, 192, 128],
    neck: 128,
    hidden: 256,
    flatten: None,
};

fn batch(size: usize, items: usize, seed: u64) -> Batch {
    let side = (size - 127) / 8 + 1 - 6;
    let first = ((size - 1 - (side - 1) * 8) / 2) as f32;
    let crops = |side: usize, seed: u64| {
        let shape = [items, side, side, 3];
        Tensor::new(&shape, noise(shape.iter().product(), seed))
    };
    let template = crops(127, 3 * seed);
    let search = crops(size, 3 * seed + 1);
    let second_template = crops(127, 3 * seed + 2);
    let center = (size - 1) as f32 / 2.0;
    let truth = [center - 30.0, center - 25.0, center + 35.0, center + 30.0];
    let cell = |i: usize| [i % side, i / side].map(|n| first + 8.0 * n as f32);
    let inside = |[x, y]: [f32; 2]| x > truth[0] && x < truth[2] && y > truth[1] && y < truth[3];
    let labels = (0..side * side)
        .map(|i| f32::from(inside(cell(i))))
        .collect::<Vec<_>>()
        .repeat(items);
    let quality = labels.iter().map(|label| 0.5 * label).collect();
    let cells = [items, side * side];
    Batch {
        template,
        search,
        second_template,
        positive: vec![true; items],
        boxes: Tensor::new(&[cells[0], cells[1], 4], truth.repeat(cells[0] * cells[1])),
        labels: Tensor::new(&cells, labels),
        quality: Tensor::new(&cells, quality),
        decoder: BoxDecoder {
            max_exponent: 6.0,
            min_iou: 1e-6,
            ..BoxDecoder::new(first)
        },
    }
}

/// The most memory the process has had, in MiB, where the system tells.
fn peak_mib() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<f64>().ok()? / 1024.0)
}

fn main() {
    let args: Vec<usize> = std::env::args()
        .skip(1)
        .map(|arg| arg.parse().expect("SIZE BATCH THREADS STEPS are numbers"))
        .collect();
    let arg = |i: usize, default| args.get(i).copied().unwrap_or(default);
    let (size, items, threads, steps) = (arg(0, 303), arg(1, 16), arg(2, 2), arg(3, 5).max(1));
    let compute = Compute::new(threads)
        .expect("worker threads")
        .with_winograd();
    let mut parameters = Parameters::new();
    let network = DrMim::new(&mut parameters, HALF);
    let layers = parameters
        .iter_mut()
        .filter(|p| p.name().ends_with("weight") && p.value.shape().len() > 1);
    for (seed, parameter) in layers.enumerate() {
        let inputs = parameter.value.shape()[1..].iter().product::<usize>() as f32;
        let weights = parameter.value.data_mut();
        let noise = noise(weights.len(), seed as u64);
        for (weight, noise) in weights.iter_mut().zip(noise) {
            *weight = noise * (6.0 / inputs).sqrt();
        }
    }
    let batch = batch(size, items, 1000);
    let mut sgd = Sgd::new(0.9);
    let mut seconds = Vec::new();
    for step in 0..=steps {
        let mut batch = batch.clone();
        let start = Instant::now();
        parameters.clear_gradients();
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
        let (_, losses) = network.losses(&mut tape, &mut batch);
        let (loss, forward) = (
            tape.value(losses.total).item(),
            start.elapsed().as_secs_f64(),
        );
        tape.backward(losses.total);
        sgd.step(&compute, &mut parameters, 1e-3);
        let all = start.elapsed().as_secs_f64();
        eprintln!("step {step}: loss {loss:.4}, forward {forward:.3} s, all {all:.3} s");
        if step > 0 {
            seconds.push(all);
        }
    }
    seconds.sort_by(f64::total_cmp);
    let pairs = items as f64 / seconds[seconds.len() / 2];
    let memory = peak_mib().map_or("unknown".into(), |mib| format!("{mib:.0} MiB"));
    println!(
        "{pairs:.2} pairs/s (median of {steps}; size {size}, batch {items}, threads {}, {}), \
         peak memory {memory}",
        compute.threads(),
        compute.isa(),
    );
}
