//! Every algorithm against the reference, on every instruction set of the machine.

use super::*;
use crate::par::Threads;
use crate::quant::Quantization;
use crate::{Isa, Size};
use testing::{assert_close, noise};

/// Checks every algorithm on every instruction set against the reference.
fn check(shape: ConvShape, size: Size, threads: &Threads) {
    let weights = noise(shape.out_channels * shape.window(), 1);
    let bias = noise(shape.out_channels, 2);
    let input = noise(size.area() * shape.in_channels, 3);
    let expected = crate::reference::conv(&shape, size, &input, &weights, &bias);
    for isa in Isa::available() {
        for algorithm in Algorithm::ALL {
            let what = format!(
                "{shape:?} on {size:?}, {isa}, {}, {} threads",
                algorithm.name(),
                threads.count()
            );
            let conv = Conv::new(isa, algorithm, shape, &weights, &bias);
            assert_eq!(conv.algorithm(), algorithm.supported(&shape));
            let mut out = vec![f32::NAN; expected.len()];
            let mut scratch = vec![f32::NAN; conv.scratch_len(size, threads)];
            let out_size =
                threads.enter(|| conv.run(threads, &input, size, &mut out, &mut scratch));
            assert_eq!(out_size, shape.out_size(size));
            let allowed = match conv.algorithm() {
                Algorithm::Winograd {
                    points: Points::Ten,
                    ..
                } => 5e-4,
                Algorithm::Winograd { .. } => 1e-4,
                _ => 1e-5,
            };
            assert_close(&out, &expected, allowed, &what);
        }
    }
}

#[test]
fn every_algorithm_at_awkward_widths_equals_the_reference() {
    let threads = Threads::new(1);
    for (i, n) in [1, 2, 3, 4, 5, 7, 8, 9, 15, 16, 17, 31, 33, 47, 48, 49, 80]
        .into_iter()
        .enumerate()
    {
        let relu = i % 2 == 0;
        for in_channels in [1, 3, 5, 16, 19] {
            let shape = ConvShape {
                in_channels,
                out_channels: n,
                kernel: 3,
                stride: 1,
                pad: 0,
                relu,
            };
            check(shape, Size { h: 4, w: 3 + i }, &threads);
        }
    }
}

#[test]
fn every_algorithm_with_any_kernel_stride_and_pad_equals_the_reference() {
    let threads = Threads::new(1);
    for (kernel, stride, pad) in [
        (1, 1, 0),
        (2, 1, 0),
        (3, 1, 1),
        (3, 2, 1),
        (4, 3, 2),
        (5, 1, 2),
        (6, 2, 2),
        (7, 3, 1),
        (11, 2, 0),
        (11, 2, 1),
    ] {
        let shape = ConvShape {
            in_channels: 3,
            out_channels: 21,
            kernel,
            stride,
            pad,
            relu: true,
        };
        for side in [11, 12, 23] {
            check(
                shape,
                Size {
                    h: side,
                    w: side + 5,
                },
                &threads,
            );
        }
    }
}

#[test]
fn every_algorithm_with_more_tiles_than_a_strip_equals_the_reference() {
    for threads in [1, 3].map(Threads::new) {
        for (kernel, in_channels, side) in [(3, 5, 70), (3, 16, 37), (5, 70, 30), (11, 3, 131)] {
            let stride = if kernel == 11 { 2 } else { 1 };
            let shape = ConvShape {
                in_channels,
                out_channels: 21,
                kernel,
                stride,
                pad: 0,
                relu: false,
            };
            check(
                shape,
                Size {
                    h: side,
                    w: side + 1,
                },
                &threads,
            );
        }
    }
}

/// Checks products of 16-bit integers against the reference, with inputs that fill the range.
///
/// The allowed error is 0.4 % of the outputs' RMS with 6 points and 1 % with 8; bytes have 1.5 %.
fn check_int16(shape: ConvShape, size: Size, input: Quantization) {
    let weights = noise(shape.out_channels * shape.window(), 1);
    let bias = noise(shape.out_channels, 2);
    let (low, high) = (input.value(0), input.value(255));
    let clamped = |v: f32| (1.5 * v).clamp(low, high);
    let values: Vec<f32> = noise(size.area() * shape.in_channels, 3)
        .into_iter()
        .map(clamped)
        .collect();
    let expected = crate::reference::conv(&shape, size, &values, &weights, &bias);
    let rms = (expected.iter().map(|y| y * y).sum::<f64>() / expected.len() as f64).sqrt();
    for (algorithm, allowed) in [
        (Algorithm::winograd_int16(Points::Six, input), 0.004),
        (Algorithm::winograd_int16(Points::Eight, input), 0.01),
    ] {
        if algorithm.supported(&shape) != algorithm {
            continue;
        }
        let mut first: Option<Vec<f32>> = None;
        for isa in Isa::available() {
            let conv = Conv::new(isa, algorithm, shape, &weights, &bias);
            assert_eq!(conv.algorithm(), algorithm);
            for threads in [1, 3].map(Threads::new) {
                let mut out = vec![f32::NAN; expected.len()];
                let mut scratch = vec![f32::NAN; conv.scratch_len(size, &threads)];
                threads.enter(|| conv.run(&threads, &values, size, &mut out, &mut scratch));
                let error = out
                    .iter()
                    .zip(&expected)
                    .map(|(y, e)| (f64::from(*y) - e).powi(2))
                    .sum::<f64>();
                let error = (error / expected.len() as f64).sqrt() / rms;
                let most = out
                    .iter()
                    .zip(&expected)
                    .map(|(y, e)| (f64::from(*y) - e).abs() / rms);
                let most = most.fold(0.0, f64::max);
                let what = format!("{shape:?} on {size:?}, {isa}, {}", algorithm.name());
                assert!(
                    error < allowed && most < 6.0 * allowed,
                    "{what}: {error}, at most {most}"
                );
                // Instruction sets differ in the transforms' roundings, and so in a few integers.
                let first = first.get_or_insert_with(|| out.clone());
                let most = out
                    .iter()
                    .zip(&*first)
                    .map(|(a, b)| (a - b).abs())
                    .fold(0.0, f32::max);
                assert!(f64::from(most) < allowed * rms, "{isa} differs by {most}");
            }
        }
    }
}

#[test]
fn int16_winograd_is_close_to_the_reference() {
    let ranges = [
        Quantization::of_range(-1.0, 1.0),
        Quantization::of_range(0.0, 1.5),
    ];
    for (i, n) in [1, 4, 7, 8, 15, 16, 17, 33, 48, 80].into_iter().enumerate() {
        for (in_channels, kernel, pad) in [(1, 3, 0), (5, 3, 1), (16, 5, 0), (19, 3, 0), (70, 5, 2)]
        {
            let relu = i % 2 == 0;
            let shape = ConvShape {
                in_channels,
                out_channels: n,
                kernel,
                stride: 1,
                pad,
                relu,
            };
            check_int16(shape, Size { h: 9, w: 5 + 3 * i }, ranges[i % 2]);
        }
    }
    let shape = ConvShape {
        in_channels: 48,
        out_channels: 40,
        kernel: 3,
        stride: 1,
        pad: 0,
        relu: false,
    };
    check_int16(shape, Size { h: 50, w: 47 }, ranges[1]);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let shape = ConvShape {
        in_channels: 13,
        out_channels: 37,
        kernel: 3,
        stride: 1,
        pad: 1,
        relu: false,
    };
    let size = Size { h: 9, w: 14 };
    let input = noise(size.area() * 13, 4);
    let (weights, bias) = (noise(37 * 9 * 13, 5), noise(37, 6));
    for isa in Isa::available() {
        for algorithm in Algorithm::ALL {
            let conv = Conv::new(isa, algorithm, shape, &weights, &bias);
            let outputs: Vec<_> = [1, 2, 3, 8, 20]
                .map(|n| {
                    let threads = Threads::new(n);
                    let mut out = vec![f32::NAN; size.area() * 37];
                    let mut scratch = vec![0.0; conv.scratch_len(size, &threads)];
                    threads.enter(|| conv.run(&threads, &input, size, &mut out, &mut scratch));
                    out
                })
                .into();
            for out in &outputs[1..] {
                if algorithm != Algorithm::Im2col {
                    assert_eq!(out, &outputs[0], "{isa}");
                }
                let expected: Vec<_> = outputs[0].iter().map(|v| f64::from(*v)).collect();
                assert_close(out, &expected, 1e-6, "threads");
            }
        }
    }
}
