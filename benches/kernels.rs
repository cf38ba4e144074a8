//! Times each convolution of the network, per instruction set and algorithm, as a share of the
//! measured multiply-add peak:
//!
//! ```text
//! cargo bench --bench kernels [-- full] [NAME...]
//! ```
//!
//! `full` takes the unpruned widths. Names of instruction sets and algorithms choose the columns;
//! without any, all are measured.

use bytemuck::Zeroable;
use kernels::conv::{Algorithm, Arithmetic, Conv};
use kernels::par::Threads;
use kernels::quant::Quantization;
use kernels::simd::{Dot, DotKernel, Kernel, Simd};
use kernels::{Isa, Size};
use std::hint::black_box;
use std::time::Instant;
use track_cpu::model::conv_shape;
use weights_format::{Architecture, Branch, LayerKind, Widths};

/// One number that depends on every chain, so that the compiler drops none.
#[inline(always)]
fn total<S: Simd>(simd: S, sums: [S::F32; Peak::CHAINS]) -> f32 {
    let all = sums
        .into_iter()
        .fold(simd.zero(), |all, sum| simd.add(all, sum));
    let mut out = vec![0.0; S::LANES];
    simd.store(all, &mut out);
    out[0]
}

/// Chains of multiply-adds that do not depend on each other, enough to hide the latency.
struct Peak {
    rounds: usize,
}

impl Peak {
    const CHAINS: usize = 12;
}

impl Kernel for Peak {
    type Output = f32;

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> f32 {
        let factor = simd.splat(black_box(0.999));
        let mut sums = [simd.zero(); Peak::CHAINS];
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum = simd.splat(black_box(i as f32));
        }
        for _ in 0..self.rounds {
            for sum in &mut sums {
                *sum = simd.mul_add(*sum, factor, factor);
            }
        }
        total(simd, sums)
    }
}

/// Returns the products of bytes that one instruction makes per lane.
impl DotKernel for Peak {
    type Output = usize;

    #[inline(always)]
    fn run<D: Dot>(self, dot: D) -> usize {
        let lanes = D::Float::LANES;
        let weights = dot.load(&vec![black_box([1; 4]); lanes * D::QUADS]);
        let x = dot.activations(black_box([D::Step::zeroed(); 2]));
        let mut sums = [dot.sums(&vec![0; lanes]); Peak::CHAINS];
        for _ in 0..self.rounds {
            for sum in &mut sums {
                *sum = dot.dot(x, weights, *sum);
            }
        }
        black_box(total(
            dot.float(),
            sums.map(|sums| dot.to_f32(dot.of_pixel(sums, 0))),
        ));
        D::PIXELS * D::QUADS * 4
    }
}

/// Chains of dot products of 16-bit pairs.
struct Int16Peak {
    rounds: usize,
}

impl DotKernel for Int16Peak {
    type Output = f32;

    #[inline(always)]
    fn run<D: Dot>(self, dot: D) -> f32 {
        let lanes = D::Float::LANES;
        let weights = dot.load_pairs(&vec![black_box([1; 2]); lanes]);
        let mut x = dot.splat_pair(black_box([1; 2]));
        let mut sums = [dot.zero(); Peak::CHAINS];
        for _ in 0..self.rounds {
            x = black_box(x); // or the compiler would move the product out of the loop
            for sum in &mut sums {
                *sum = dot.dot_pairs(x, weights, *sum);
            }
        }
        total(dot.float(), sums.map(|sum| dot.to_f32(sum)))
    }
}

/// The median of `n` runs in seconds, after one to warm up.
fn median(n: usize, mut run: impl FnMut()) -> f64 {
    run();
    let mut times: Vec<f64> = (0..n)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64()
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[n / 2]
}

/// The instruction set's peaks in `f32`, bytes and 16-bit integers, in 10^9 operations per second.
fn peaks(isa: Isa) -> [f64; 3] {
    let rounds = 100_000;
    let operations = (2 * rounds * Peak::CHAINS * isa.lanes()) as f64;
    let floats = median(5, || {
        black_box(isa.run(Peak { rounds }));
    });
    let mut products = 0;
    let bytes = median(5, || products = isa.run_dot(Peak { rounds }));
    let int16 = median(5, || {
        black_box(isa.run_dot(Int16Peak { rounds }));
    });
    [
        operations / floats / 1e9,
        products as f64 * operations / bytes / 1e9,
        2.0 * operations / int16 / 1e9,
    ]
}

fn main() {
    let args: Vec<String> = std::env::args()
        .skip(1)
        .filter(|a| !a.starts_with("--"))
        .collect();
    let full = args.iter().any(|a| a == "full");
    // A name chooses if it is given, or if none of its kind is.
    let asked = |names: &[&str], name: &str| {
        !args.iter().any(|a| names.contains(&a.as_str())) || args.iter().any(|a| a == name)
    };
    let isas: Vec<Isa> = Isa::available();
    let names: Vec<_> = isas.iter().map(|isa| isa.name()).collect();
    let isas: Vec<Isa> = isas
        .into_iter()
        .filter(|isa| asked(&names, isa.name()))
        .collect();
    let range = Quantization {
        scale: 1.0 / 128.0,
        zero_point: 128,
    };
    let all = || Algorithm::ALL.into_iter().chain(Algorithm::integers(range));
    let names: Vec<_> = all().map(Algorithm::name).collect();
    let algorithms: Vec<_> = all().filter(|a| asked(&names, a.name())).collect();
    let widths = if full {
        Widths::FULL
    } else {
        Widths::pruned(0.5)
    };
    let architecture = Architecture::new(widths, None);
    let threads = Threads::new(1);
    println!("one thread; ms (10^9 operations/s, % of the measured peak of the same arithmetic)");
    print!("{:18} {:>7}", "layer", "MMAC");
    for isa in &isas {
        for algorithm in &algorithms {
            print!(" | {:>22}", format!("{isa} {}", algorithm.name()));
        }
    }
    println!();
    let peaks: Vec<[f64; 3]> = isas.iter().map(|isa| peaks(*isa)).collect();
    // Walk the search branch layer by layer; a few layers read another map than the one before them
    // wrote.
    let mut input_side = architecture.search_size;
    let mut totals = vec![0.0; isas.len() * algorithms.len()];
    for layer in architecture.layers() {
        let side = std::mem::replace(&mut input_side, layer.out_search);
        if layer.branch == Branch::Template || layer.kind == LayerKind::Pool {
            if layer.branch == Branch::Template {
                input_side = side;
            }
            continue;
        }
        let side = match layer.name.as_str() {
            "neck.search_reg" => side + 2,
            "head.reg1" => {
                architecture
                    .layers()
                    .iter()
                    .find(|l| l.name == "correlation.cls")
                    .unwrap()
                    .out_search
            }
            "head.centerness" | "head.offsets" => layer.out_search,
            _ => side,
        };
        if layer.kind == LayerKind::Correlation {
            continue;
        }
        let shape = conv_shape(&layer);
        let size = Size::square(side);
        let values = |n: usize| {
            (0..n)
                .map(|i| ((i * 7919) % 1000) as f32 / 500.0 - 1.0)
                .collect::<Vec<_>>()
        };
        let weights = values(shape.out_channels * shape.kernel * shape.kernel * shape.in_channels);
        let (bias, input) = (
            values(shape.out_channels),
            values(size.area() * shape.in_channels),
        );
        let mut out = vec![0.0; shape.out_size(size).area() * shape.out_channels];
        let gflop = 2.0 * shape.macs(size) as f64 / 1e9;
        print!("{:18} {:7.1}", layer.name, gflop * 500.0);
        let mut column = 0;
        for (&isa, peak) in isas.iter().zip(&peaks) {
            for &algorithm in &algorithms {
                let conv = Conv::new(isa, algorithm, shape, &weights, &bias);
                let mut scratch = vec![0.0; conv.scratch_len(size, &threads)];
                let seconds = median(9, || {
                    conv.run(&threads, &input, size, &mut out, &mut scratch);
                });
                totals[column] += seconds;
                column += 1;
                let rate = gflop / seconds;
                let peak = match algorithm {
                    Algorithm::Int8(_) => peak[1],
                    Algorithm::Winograd {
                        arithmetic: Arithmetic::Int16(_),
                        ..
                    } => peak[2],
                    _ => peak[0],
                };
                print!(
                    " | {:7.3} ({rate:4.0}, {:3.0} %)",
                    seconds * 1e3,
                    100.0 * rate / peak
                );
            }
        }
        println!();
    }
    print!("{:18} {:7}", "sum", "");
    for total in totals {
        print!(" | {:7.3} ms{:13}", total * 1e3, "");
    }
    println!();
}
