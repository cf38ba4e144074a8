//! A convolution that is ready to run: its weights laid out once, for one algorithm on one
//! instruction set.

use super::{Algorithm, Arithmetic, ConvShape, direct, fold, im2col, int8, winograd};
use crate::par::Threads;
use crate::quant::{Quantization, Rows, quantize};
use crate::{Isa, Size};

/// A map that a convolution reads, `[H, W, Cin]`.
#[derive(Clone, Copy, Debug)]
pub enum Input<'a> {
    /// Single precision: every algorithm reads it.
    Floats(&'a [f32]),
    /// Bytes in the quantization of the convolution's [`Algorithm::Int8`], followed by
    /// [`SLACK`](super::SLACK) bytes of any value.
    Bytes(&'a [u8]),
}

/// A map that a convolution writes, `[H', W', Cout]`.
#[derive(Debug)]
pub enum Output<'a> {
    /// Single precision: every algorithm writes it.
    Floats(&'a mut [f32]),
    /// Bytes in this quantization: [`Algorithm::Int8`] writes them.
    Bytes(&'a mut [u8], Quantization),
}

impl Input<'_> {
    /// Values of the map.
    pub(super) fn len(&self) -> usize {
        match self {
            Input::Floats(values) => values.len(),
            Input::Bytes(bytes) => bytes.len().saturating_sub(int8::SLACK),
        }
    }
}

impl Output<'_> {
    /// Values of the map.
    pub(super) fn len(&self) -> usize {
        match self {
            Output::Floats(values) => values.len(),
            Output::Bytes(bytes, _) => bytes.len(),
        }
    }
}

/// A convolution with its weights laid out for one algorithm on one instruction set.
#[derive(Clone, Debug)]
pub struct Conv {
    pub(super) shape: ConvShape,
    pub(super) isa: Isa,
    algorithm: Algorithm,
    bias: Vec<f32>, // [Cout]
    pub(super) weights: Weights,
}

/// Weights as their algorithm reads them.
#[derive(Clone, Debug)]
pub(super) enum Weights {
    Direct(direct::PackedWeights),
    Im2col(im2col::WeightMatrix),
    Winograd(winograd::WinogradKernels),
    Int8(int8::QuantizedWeights),
}

impl Conv {
    /// Lays out `weights` (`[Cout, k, k, Cin]`) and `bias` (`[Cout]`).
    ///
    /// Takes [`Algorithm::Direct`] where `algorithm` does not support the shape. Panics if a length
    /// is not that of the shape.
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
        let weights = match algorithm {
            Algorithm::Direct => Weights::Direct(direct::PackedWeights::new(isa, &shape, weights)),
            Algorithm::Im2col => Weights::Im2col(im2col::WeightMatrix::new(&shape, weights)),
            Algorithm::Int8(input) => {
                Weights::Int8(int8::QuantizedWeights::new(isa, &shape, weights, input))
            }
            Algorithm::Winograd { points, arithmetic } => {
                let points = points.count();
                Weights::Winograd(match arithmetic {
                    Arithmetic::F32 => winograd::WinogradKernels::new(isa, &shape, points, weights),
                    Arithmetic::Int16(input) => {
                        winograd::WinogradKernels::int16(isa, &shape, points, weights, input)
                    }
                })
            }
        };
        Conv {
            shape,
            isa,
            algorithm,
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
        self.algorithm
    }

    /// Scratch values for the input as the tiles read it; 0 where they read it in place.
    fn prepared_len(&self, size: Size) -> usize {
        let values = self.shape.padded(size).area() * self.shape.in_channels;
        match &self.weights {
            Weights::Int8(_) => (values + int8::SLACK).div_ceil(size_of::<f32>()),
            Weights::Winograd(kernels) if self.shape.stride > 1 => {
                fold::size(&self.shape, size).area() * kernels.shape().in_channels
            }
            _ if self.shape.pad > 0 => values,
            _ => 0,
        }
    }

    /// Scratch values that [`run`](Self::run) needs for an input of `size` on `threads` threads.
    pub fn scratch_len(&self, size: Size, threads: &Threads) -> usize {
        self.prepared_len(size)
            + match &self.weights {
                Weights::Direct(_) | Weights::Int8(_) => 0,
                Weights::Im2col(_) => im2col::scratch_len(&self.shape, size) * threads.count(),
                Weights::Winograd(kernels) => {
                    kernels.scratch_len(self.shape.out_size(size), threads)
                }
            }
    }

    /// Convolves `input` (`[H, W, Cin]`) into `out` (`[H', W', Cout]`) and returns the output's
    /// size.
    ///
    /// Panics if a length is not that of its shape, or if `scratch` is shorter than
    /// [`scratch_len`](Self::scratch_len).
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

    /// Does what [`run`](Self::run) does, but may read bytes from the layer before and write bytes
    /// for the layer after. The bits equal those of the way through `f32`.
    ///
    /// Panics as `run` does, and if an algorithm other than [`Algorithm::Int8`] gets bytes, or a
    /// padded layer does.
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
        // Each arm brings the input into the form that its tiles read, then splits the output over
        // the threads.
        match (&self.weights, input, out) {
            (Weights::Direct(weights), Input::Floats(input), Output::Floats(out)) => {
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
            (Weights::Winograd(kernels), Input::Floats(input), Output::Floats(out)) => {
                let (input, size) = if shape.stride > 1 {
                    fold::input(shape, threads, input, size, prepared);
                    (&*prepared, fold::size(shape, size))
                } else {
                    self.pad(input, size, prepared)
                };
                winograd::Winograd {
                    isa: self.isa,
                    kernels,
                    bias,
                    input,
                    size,
                }
                .run(threads, out, scratch);
            }
            (Weights::Im2col(weights), Input::Floats(input), Output::Floats(out)) => {
                let (input, size) = self.pad(input, size, prepared);
                im2col::Im2col {
                    shape,
                    weights,
                    bias,
                    input,
                    size,
                }
                .run(threads, out, scratch);
            }
            (Weights::Int8(weights), input, out) => {
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
                let convolve = |first_row: usize, out: Output<'_>| {
                    self.isa.run_dot(int8::Int8 {
                        shape,
                        weights,
                        bias,
                        input,
                        size,
                        first_row,
                        out,
                    });
                };
                match out {
                    Output::Floats(out) => threads.split_rows(out, row_len, |first_row, out| {
                        convolve(first_row, Output::Floats(out));
                    }),
                    Output::Bytes(out, q) => threads.split_rows(out, row_len, |first_row, out| {
                        convolve(first_row, Output::Bytes(out, q));
                    }),
                }
            }
            _ => panic!(
                "bytes for {:?}, which does not compute in them",
                self.algorithm()
            ),
        }
        out_size
    }

    /// `input` with its padding, copied into `padded`; `input` itself if there is no padding.
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

    /// Quantizes `input` into the middle of `bytes`; the padding around it is the zero-point, which
    /// stands for 0.
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
