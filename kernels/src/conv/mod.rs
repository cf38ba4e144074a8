//! Convolution: `y[o] = b[o] + sum over ky, kx, i of w[o, ky, kx, i] * x[sy + ky - pad, sx + kx - pad, i]`, then ReLU
//! if asked for.
//!
//! Shapes: input `[H, W, Cin]`, weights `[Cout, k, k, Cin]`, bias `[Cout]`, output `[H', W', Cout]` with
//! `H' = (H + 2 pad - k) / stride + 1`. Cost: `H' W' Cout Cin k^2` multiply-accumulates.
//!
//! In HWC one row of the kernel's window is `k * Cin` *contiguous* floats, so a convolution is `k` matrix products with
//! overlapping rows, and no patch has to be gathered. `direct.rs` works on them in place; `winograd/` does with fewer
//! multiplications; `fold.rs` takes strides away for it; `im2col.rs` copies them into one matrix for a general matrix product; `int8.rs`
//! works on bytes; `pooled.rs` has a max-pool follow at once.

/// Calls `$tile.$run` with a tile's sizes as constants.
macro_rules! for_tile {
    ($pixels:expr, $vectors:expr, $tile:ident.$run:ident, $set:ident, $token:expr) => {
        for_tile!(@table $pixels, $vectors, $tile.$run, $set, $token;
            (1 1) (2 1) (3 1) (4 1) (5 1) (6 1) (7 1) (8 1) (9 1)
            (1 2) (2 2) (3 2) (4 2) (5 2) (6 2) (7 2) (8 2) (9 2)
            (1 3) (2 3) (3 3) (4 3) (5 3) (6 3) (7 3) (8 3) (9 3))
    };
    (@table $pixels:expr, $vectors:expr, $tile:ident.$run:ident, $set:ident, $token:expr; $(($p:literal $v:literal))*) => {
        match ($pixels, $vectors) {
            $(($p, $v) => $tile.$run::<$set, $p, $v>($token),)*
            (pixels, vectors) => unreachable!("tile of {pixels} pixels x {vectors} vectors"),
        }
    };
}
use for_tile;

mod direct;
mod fold;
mod im2col;
mod int8;
mod pooled;
pub mod winograd;

use crate::par::Threads;
use crate::quant::{Quantization, Rows, quantize};
use crate::{Isa, Size};
pub use int8::SLACK;

/// What a convolution computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ConvShape {
    /// Input channels.
    pub in_channels: usize,
    /// Output channels.
    pub out_channels: usize,
    /// Side of the square kernel.
    pub kernel: usize,
    /// Stride in both directions.
    pub stride: usize,
    /// Zero padding on all four sides.
    pub pad: usize,
    /// Whether negative outputs become 0.
    pub relu: bool,
}

impl ConvShape {
    /// Size of the output for an input of `size`, which must be no smaller than the kernel.
    pub fn out_size(&self, size: Size) -> Size {
        let side = |n: usize| {
            assert!(
                n + 2 * self.pad >= self.kernel,
                "input side {n} is smaller than the kernel {}",
                self.kernel
            );
            (n + 2 * self.pad - self.kernel) / self.stride + 1
        };
        Size {
            h: side(size.h),
            w: side(size.w),
        }
    }

    /// Multiply-accumulates for an input of `size`.
    pub fn macs(&self, size: Size) -> u64 {
        (self.out_size(size).area() * self.out_channels * self.window()) as u64
    }

    /// Values that one output depends on.
    fn window(&self) -> usize {
        self.kernel * self.kernel * self.in_channels
    }

    /// The input with its padding.
    fn padded(&self, size: Size) -> Size {
        Size {
            h: size.h + 2 * self.pad,
            w: size.w + 2 * self.pad,
        }
    }
}

/// How a convolution is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Algorithm {
    /// Register tiles over the input as it lies.
    Direct,
    /// Patches gathered into a matrix, then a matrix product by faer, which picks its own instruction set.
    Im2col,
    /// Winograd's algorithm over tiles of 6 x 6 inputs; where the shape does not allow it, `Direct`.
    Winograd6,
    /// The same over tiles of 8 x 8 inputs.
    Winograd8,
    /// The same over tiles of 10 x 10 inputs.
    Winograd10,
    /// Register tiles over bytes: inputs quantized as given, weights to `i8`; an approximation.
    Int8(Quantization),
    /// Winograd's algorithm over tiles of 6 x 6 inputs with products of 16 bits, for inputs of the range that bytes quantized as given express; a closer
    /// approximation.
    Winograd6Int16(Quantization),
    /// The same over tiles of 8 x 8 inputs.
    Winograd8Int16(Quantization),
}

impl Algorithm {
    /// All that compute in `f32`.
    pub const ALL: [Algorithm; 5] = [
        Algorithm::Direct,
        Algorithm::Im2col,
        Algorithm::Winograd6,
        Algorithm::Winograd8,
        Algorithm::Winograd10,
    ];

    /// All that compute in integers, for inputs that `input` expresses.
    pub fn integers(input: Quantization) -> [Algorithm; 3] {
        [
            Algorithm::Int8(input),
            Algorithm::Winograd6Int16(input),
            Algorithm::Winograd8Int16(input),
        ]
    }

    /// This algorithm where it can compute `shape`, else `Direct`.
    pub fn supported(self, shape: &ConvShape) -> Algorithm {
        let fits = match self {
            Algorithm::Winograd6Int16(_) => winograd::fits_int16(shape, 6),
            Algorithm::Winograd8Int16(_) => winograd::fits_int16(shape, 8),
            _ => self
                .points()
                .is_none_or(|points| winograd::fits(shape, points)),
        };
        if fits { self } else { Algorithm::Direct }
    }

    /// Points along one side of a tile of Winograd's algorithm; `None` for the others.
    fn points(self) -> Option<usize> {
        match self {
            Algorithm::Winograd6 | Algorithm::Winograd6Int16(_) => Some(6),
            Algorithm::Winograd8 | Algorithm::Winograd8Int16(_) => Some(8),
            Algorithm::Winograd10 => Some(10),
            Algorithm::Direct | Algorithm::Im2col | Algorithm::Int8(_) => None,
        }
    }

    /// The algorithm in `f32` that is expected to be fastest for an input of `size`.
    pub fn plan(shape: &ConvShape, size: Size) -> Algorithm {
        let fitting = Algorithm::ALL
            .into_iter()
            .filter(|a| *a != Algorithm::Im2col);
        Algorithm::cheapest(fitting, shape, |a| a.cost(1, shape, size))
    }

    /// The same where integers would do as well.
    pub fn plan_integers(
        isa: Isa,
        shape: &ConvShape,
        size: Size,
        input: Quantization,
    ) -> Algorithm {
        let fitting = [Algorithm::plan(shape, size)]
            .into_iter()
            .chain(Algorithm::integers(input));
        let speed = |algorithm| match algorithm {
            Algorithm::Int8(_) => isa.int8_speed(),
            Algorithm::Winograd6Int16(_) | Algorithm::Winograd8Int16(_) => isa.int16_speed(),
            _ => 1,
        };
        Algorithm::cheapest(fitting, shape, |a| a.cost(speed(a), shape, size))
    }

    fn cheapest(
        algorithms: impl Iterator<Item = Algorithm>,
        shape: &ConvShape,
        cost: impl Fn(Algorithm) -> u64,
    ) -> Algorithm {
        let fitting = algorithms.filter(|a| a.supported(shape) == *a);
        fitting
            .min_by_key(|a| cost(*a))
            .expect("direct always fits")
    }

    /// An estimate of the time for an input of `size`, in units of one multiply-accumulate of the register tile in `f32`, where `speed`
    /// of this algorithm's products take as long as one of those.
    ///
    /// What all else costs in that unit was measured (Zen 4, AVX-512); the estimates are within a tenth of the clock for most of the network's layers,
    /// and order the algorithms as it does.
    fn cost(self, speed: u64, shape: &ConvShape, size: Size) -> u64 {
        const POINT: u64 = 8; // of a tile, per channel of inputs and outputs
        const OUTPUT: u64 = 32; // of a tile, likewise
        const WEIGHT: u64 = 4; // to read or to make one
        let out = shape.out_size(size);
        if let Algorithm::Int8(_) = self {
            // Bytes are taken four at a time, and come less close to their peak.
            let steps = (shape.kernel * shape.in_channels).div_ceil(4);
            let macs = out.area() * shape.out_channels * shape.kernel * 4 * steps;
            return macs as u64 * 16 / 15 / speed;
        }
        let Some(points) = self.points() else {
            return shape.macs(size);
        };
        let shape = fold::unstrided(shape);
        let product = (shape.in_channels * shape.out_channels) as u64;
        let values = (shape.in_channels + shape.out_channels) as u64;
        let side = winograd::rows_per_tile(&shape, points);
        let tiles = (out.h.div_ceil(side) * out.w.div_ceil(side)) as u64;
        let (points, outputs) = ((points * points) as u64, (side * side) as u64);
        // Where a row of points is multiplied at once, half of all else is done in registers.
        let share = if winograd::is_short(&shape) { 2 } else { 1 };
        let transforms = (points * POINT + outputs * OUTPUT) * values / share;
        // Integers of 16 bits are half as much to move, too.
        (tiles * (points * product + transforms) + points * WEIGHT * product) / speed
    }

    /// The algorithm in `f32` called `name`, as [`name`](Self::name) gives it.
    pub fn from_name(name: &str) -> Option<Algorithm> {
        Algorithm::ALL
            .into_iter()
            .find(|algorithm| algorithm.name() == name)
    }

    /// Its name in reports and options.
    pub fn name(self) -> &'static str {
        match self {
            Algorithm::Direct => "direct",
            Algorithm::Im2col => "im2col",
            Algorithm::Winograd6 => "winograd6",
            Algorithm::Winograd8 => "winograd8",
            Algorithm::Winograd10 => "winograd10",
            Algorithm::Int8(_) => "int8",
            Algorithm::Winograd6Int16(_) => "winograd6-int16",
            Algorithm::Winograd8Int16(_) => "winograd8-int16",
        }
    }
}

/// A map that a convolution reads, `[H, W, Cin]`.
#[derive(Clone, Copy, Debug)]
pub enum Input<'a> {
    /// Single precision: every algorithm reads it.
    Floats(&'a [f32]),
    /// Bytes quantized as the convolution's own [`Algorithm::Int8`] says, and [`SLACK`] bytes more.
    Bytes(&'a [u8]),
}

/// A map that a convolution writes, `[H', W', Cout]`.
#[derive(Debug)]
pub enum Output<'a> {
    /// Single precision: every algorithm writes it.
    Floats(&'a mut [f32]),
    /// Bytes, quantized like this; written by [`Algorithm::Int8`] only.
    Bytes(&'a mut [u8], Quantization),
}

impl Input<'_> {
    /// Values of the map.
    fn len(&self) -> usize {
        match self {
            Input::Floats(values) => values.len(),
            Input::Bytes(bytes) => bytes.len().saturating_sub(SLACK),
        }
    }
}

impl Output<'_> {
    /// Values of the map.
    fn len(&self) -> usize {
        match self {
            Output::Floats(values) => values.len(),
            Output::Bytes(bytes, _) => bytes.len(),
        }
    }
}

/// A convolution with its weights laid out for one algorithm on one instruction set.
#[derive(Clone, Debug)]
pub struct Conv {
    shape: ConvShape,
    isa: Isa,
    bias: Vec<f32>, // [Cout]
    weights: Packed,
}

#[derive(Clone, Debug)]
enum Packed {
    Direct(direct::Weights),
    Im2col(im2col::Weights),
    Winograd(winograd::Weights),
    Int8(int8::Weights),
}

impl Conv {
    /// Lays out `weights` (`[Cout, k, k, Cin]`) and `bias` (`[Cout]`).
    ///
    /// Panics if a length is not that of the shape.
    pub fn new(
        isa: Isa,
        algorithm: Algorithm,
        shape: ConvShape,
        weights: &[f32],
        bias: &[f32],
    ) -> Conv {
        assert!(
            shape.kernel > 0 && shape.stride > 0 && shape.in_channels > 0,
            "{shape:?}"
        );
        assert_eq!(
            weights.len(),
            shape.out_channels * shape.window(),
            "weights of {shape:?}"
        );
        assert_eq!(bias.len(), shape.out_channels, "bias of {shape:?}");
        let algorithm = algorithm.supported(&shape);
        let weights = match (algorithm, algorithm.points()) {
            (Algorithm::Winograd6Int16(input) | Algorithm::Winograd8Int16(input), Some(points)) => {
                Packed::Winograd(winograd::Weights::int16(
                    isa, &shape, points, weights, input,
                ))
            }
            (_, Some(points)) => {
                Packed::Winograd(winograd::Weights::new(isa, &shape, points, weights))
            }
            (Algorithm::Im2col, _) => Packed::Im2col(im2col::Weights::new(&shape, weights)),
            (Algorithm::Int8(input), _) => {
                Packed::Int8(int8::Weights::new(isa, &shape, weights, input))
            }
            _ => Packed::Direct(direct::Weights::new(isa, &shape, weights)),
        };
        Conv {
            shape,
            isa,
            bias: bias.to_vec(),
            weights,
        }
    }

    /// What it computes.
    pub fn shape(&self) -> &ConvShape {
        &self.shape
    }

    /// How it computes it.
    pub fn algorithm(&self) -> Algorithm {
        match &self.weights {
            Packed::Direct(_) => Algorithm::Direct,
            Packed::Im2col(_) => Algorithm::Im2col,
            Packed::Winograd(weights) => match (weights.points(), weights.input()) {
                (6, None) => Algorithm::Winograd6,
                (8, None) => Algorithm::Winograd8,
                (_, None) => Algorithm::Winograd10,
                (6, Some(input)) => Algorithm::Winograd6Int16(input),
                (_, Some(input)) => Algorithm::Winograd8Int16(input),
            },
            Packed::Int8(weights) => Algorithm::Int8(weights.input),
        }
    }

    /// Values of scratch space that hold the input as the tiles read it, where they cannot read it as it lies.
    fn prepared_len(&self, size: Size) -> usize {
        let values = self.shape.padded(size).area() * self.shape.in_channels;
        match &self.weights {
            Packed::Int8(_) => (values + int8::SLACK).div_ceil(size_of::<f32>()),
            Packed::Winograd(weights) if self.shape.stride > 1 => {
                fold::size(&self.shape, size).area() * weights.shape().in_channels
            }
            _ if self.shape.pad > 0 => values,
            _ => 0,
        }
    }

    /// How many values of scratch space [`run`](Self::run) needs for an input of `size` on `threads` threads.
    pub fn scratch_len(&self, size: Size, threads: &Threads) -> usize {
        self.prepared_len(size)
            + match &self.weights {
                Packed::Direct(_) | Packed::Int8(_) => 0,
                Packed::Im2col(_) => im2col::scratch_len(&self.shape, size) * threads.count(),
                Packed::Winograd(weights) => {
                    weights.scratch_len(self.shape.out_size(size), threads)
                }
            }
    }

    /// Convolves `input` (`[H, W, Cin]`) into `out` (`[H', W', Cout]`) and returns the output's size.
    ///
    /// Panics if a length is not that of its shape, or if `scratch` is shorter than [`scratch_len`](Self::scratch_len).
    pub fn run(
        &self,
        threads: &Threads,
        input: &[f32],
        size: Size,
        out: &mut [f32],
        scratch: &mut [f32],
    ) -> Size {
        self.run_between(
            threads,
            Input::Floats(input),
            size,
            Output::Floats(out),
            scratch,
        )
    }

    /// As [`run`](Self::run), where a neighbor may hand bytes over or take them: the same bits as by way of `f32`.
    ///
    /// Panics as `run` does, or if bytes are read or written by another algorithm than [`Algorithm::Int8`], or padded.
    pub fn run_between(
        &self,
        threads: &Threads,
        input: Input<'_>,
        size: Size,
        out: Output<'_>,
        scratch: &mut [f32],
    ) -> Size {
        let shape = &self.shape;
        let out_size = shape.out_size(size);
        assert_eq!(
            input.len(),
            size.area() * shape.in_channels,
            "input of {shape:?}"
        );
        assert_eq!(
            out.len(),
            out_size.area() * shape.out_channels,
            "output of {shape:?}"
        );
        let (prepared, scratch) = scratch.split_at_mut(self.prepared_len(size));
        let row_len = out_size.w * shape.out_channels;
        let bias = &self.bias;
        match (&self.weights, input, out) {
            (Packed::Direct(weights), Input::Floats(input), Output::Floats(out)) => {
                let (input, size) = self.pad(input, size, prepared);
                threads.split_rows(out, row_len, |first_row, out| {
                    self.isa.run(direct::Direct {
                        shape,
                        weights,
                        bias,
                        input,
                        size,
                        first_row,
                        out,
                    });
                });
            }
            (Packed::Winograd(weights), Input::Floats(input), Output::Floats(out)) => {
                let (input, size) = if shape.stride > 1 {
                    fold::input(shape, threads, input, size, prepared);
                    (&*prepared, fold::size(shape, size))
                } else {
                    self.pad(input, size, prepared)
                };
                winograd::Winograd {
                    isa: self.isa,
                    weights,
                    bias,
                    input,
                    size,
                }
                .run(threads, out, scratch);
            }
            (Packed::Im2col(weights), Input::Floats(input), Output::Floats(out)) => {
                let (input, size) = self.pad(input, size, prepared);
                im2col::run(threads, shape, weights, bias, input, size, out, scratch);
            }
            (Packed::Int8(weights), input, out) => {
                let input = match input {
                    Input::Floats(input) => {
                        let bytes = bytemuck::cast_slice_mut(prepared);
                        self.quantize(threads, input, size, weights.input, bytes);
                        &*bytes
                    }
                    Input::Bytes(bytes) => {
                        assert_eq!(shape.pad, 0, "bytes for {shape:?}");
                        bytes
                    }
                };
                let size = shape.padded(size);
                match out {
                    Output::Floats(out) => {
                        self.int8(threads, weights, input, size, int8::Floats, out)
                    }
                    Output::Bytes(out, q) => {
                        self.int8(threads, weights, input, size, int8::Bytes(q), out)
                    }
                }
            }
            _ => panic!(
                "bytes for {:?}, which does not compute in them",
                self.algorithm()
            ),
        }
        out_size
    }

    /// Convolves bytes into rows of whatever `to` makes; `size` includes the padding.
    fn int8<T: int8::To>(
        &self,
        threads: &Threads,
        weights: &int8::Weights,
        input: &[u8],
        size: Size,
        to: T,
        out: &mut [T::Value],
    ) {
        let (shape, bias) = (&self.shape, &self.bias);
        let width = (size.w - shape.kernel) / shape.stride + 1;
        threads.split_rows(out, width * shape.out_channels, |first_row, out| {
            self.isa.run_dot(int8::Int8 {
                shape,
                weights,
                bias,
                input,
                size,
                first_row,
                to,
                out,
            });
        });
    }

    /// `input` with its padding, in `padded`; without any, as it is.
    fn pad<'a>(&self, input: &'a [f32], size: Size, padded: &'a mut [f32]) -> (&'a [f32], Size) {
        let (c, pad) = (self.shape.in_channels, self.shape.pad);
        if pad == 0 {
            return (input, size);
        }
        let row = (size.w + 2 * pad) * c;
        padded.fill(0.0);
        for (from, to) in input
            .chunks_exact(size.w * c)
            .zip(padded[pad * row..].chunks_exact_mut(row))
        {
            to[pad * c..][..from.len()].copy_from_slice(from);
        }
        (padded, self.shape.padded(size))
    }

    /// Quantizes `input` into the middle of `bytes`, the byte that stands for 0 around it.
    fn quantize(
        &self,
        threads: &Threads,
        input: &[f32],
        size: Size,
        quantization: Quantization,
        bytes: &mut [u8],
    ) {
        let (c, pad) = (self.shape.in_channels, self.shape.pad);
        let rows = Rows {
            row_len: size.w * c,
            out_row_len: (size.w + 2 * pad) * c,
            offset: pad * c,
        };
        if pad > 0 {
            bytes.fill(quantization.zero_point);
        }
        quantize(
            self.isa,
            threads,
            input,
            quantization,
            rows,
            &mut bytes[pad * rows.out_row_len..],
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_close, noise};

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
                    Algorithm::Winograd6 | Algorithm::Winograd8 => 1e-4,
                    Algorithm::Winograd10 => 5e-4,
                    _ => 1e-5,
                };
                assert_close(&out, &expected, allowed, &what);
            }
        }
    }

    #[test]
    fn equals_the_reference_at_awkward_widths() {
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
    fn equals_the_reference_at_every_kernel_stride_and_pad() {
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

    /// More tiles than a strip takes, with every algorithm.
    #[test]
    fn equals_the_reference_on_large_maps() {
        for threads in [1, 3].map(Threads::new) {
            for (kernel, in_channels, side) in [(3, 5, 70), (3, 16, 37), (5, 70, 30), (11, 3, 131)]
            {
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

    /// 16-bit integers against the reference, with inputs that fill the range: bytes' error is 1.5 % of the outputs' RMS.
    fn check_int16(shape: ConvShape, size: Size, input: Quantization) {
        let weights = noise(shape.out_channels * shape.window(), 1);
        let bias = noise(shape.out_channels, 2);
        let (low, high) = (input.value(0), input.value(255));
        let held = |v: f32| (1.5 * v).clamp(low, high);
        let values: Vec<f32> = noise(size.area() * shape.in_channels, 3)
            .into_iter()
            .map(held)
            .collect();
        let expected = crate::reference::conv(&shape, size, &values, &weights, &bias);
        let rms = (expected.iter().map(|y| y * y).sum::<f64>() / expected.len() as f64).sqrt();
        for (algorithm, allowed) in [
            (Algorithm::Winograd6Int16(input), 0.004),
            (Algorithm::Winograd8Int16(input), 0.01),
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
                    // The transforms' roundings may turn an integer here and there, the sums are the same.
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
    fn int16_comes_close_to_the_reference() {
        let ranges = [
            Quantization::of_range(-1.0, 1.0),
            Quantization::of_range(0.0, 1.5),
        ];
        for (i, n) in [1, 4, 7, 8, 15, 16, 17, 33, 48, 80].into_iter().enumerate() {
            for (in_channels, kernel, pad) in
                [(1, 3, 0), (5, 3, 1), (16, 5, 0), (19, 3, 0), (70, 5, 2)]
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
    fn plans_follow_the_measurements() {
        use Algorithm::{Direct, Winograd6, Winograd8, Winograd10};
        for (kernel, stride, channels, side, expected) in [
            (11, 2, (3, 48), 303, Winograd10),
            (5, 1, (48, 128), 73, Winograd10),
            (3, 1, (128, 192), 34, Winograd6),
            (3, 1, (192, 192), 32, Winograd8),
            (3, 1, (192, 128), 30, Winograd8),
            (3, 1, (128, 128), 19, Winograd8),
            (1, 1, (128, 4), 17, Direct),
        ] {
            let (in_channels, out_channels) = channels;
            let shape = ConvShape {
                in_channels,
                out_channels,
                kernel,
                stride,
                pad: 0,
                relu: true,
            };
            assert_eq!(
                Algorithm::plan(&shape, Size::square(side)),
                expected,
                "{shape:?}"
            );
        }
    }

    #[test]
    fn integers_where_they_are_faster() {
        use Algorithm::{Int8, Winograd8, Winograd8Int16, Winograd10};
        let input = Quantization {
            scale: 1.0,
            zero_point: 0,
        };
        for isa in Isa::available() {
            let plan = |kernel, stride, in_channels, out_channels, side| {
                let shape = ConvShape {
                    in_channels,
                    out_channels,
                    kernel,
                    stride,
                    pad: 0,
                    relu: true,
                };
                Algorithm::plan_integers(isa, &shape, Size::square(side), input)
            };
            let inner = [plan(3, 1, 192, 192, 32), plan(3, 1, 64, 64, 19)];
            let first = plan(11, 2, 3, 16, 303); // so few channels that transforms cost more than products
            match (isa.int8_speed(), isa.int16_speed()) {
                (4, 2) => assert_eq!(
                    (inner, first),
                    ([Winograd8Int16(input); 2], Int8(input)),
                    "{isa}"
                ),
                (1, 2) => assert_eq!(
                    (inner, first),
                    ([Winograd8Int16(input); 2], Winograd10),
                    "{isa}"
                ),
                (4 | 8, 1) => assert_eq!((inner, first), ([Int8(input); 2], Int8(input)), "{isa}"),
                _ => assert_eq!((inner, first), ([Winograd8; 2], Winograd10), "{isa}"),
            }
        }
    }

    #[test]
    fn threads_change_no_bit() {
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

    #[test]
    #[should_panic(expected = "smaller than the kernel")]
    fn refuses_an_input_below_the_kernel() {
        let shape = ConvShape {
            in_channels: 1,
            out_channels: 1,
            kernel: 3,
            stride: 1,
            pad: 0,
            relu: false,
        };
        shape.out_size(Size { h: 2, w: 9 });
    }
}
