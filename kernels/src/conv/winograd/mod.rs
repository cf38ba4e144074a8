//! Convolution with fewer multiplications: Winograd's F(m x m, k x k), for stride 1 and whatever `fold.rs` makes of others.
//!
//! An `m x m` tile of outputs depends on an `a x a` tile of inputs, `a = m + k - 1`. Both and the kernel are polynomials
//! that are multiplied at `a` points (0, pairs such as 1 and -1, infinity), where a product costs one multiplication per point:
//!
//! ```text
//! V = B^T d B              input tile, per input channel              additions
//! M = sum over i of U V    a x a matrix products [tiles, Cin] x [Cin, Cout]   all the multiplications
//! Y = A^T M A              output tile, per output channel            additions
//! U = G g G^T              kernels
//! ```
//!
//! Multiplications per output, by side of the kernel and points:
//!
//! | `k` | direct | 6 points | 8 points | 10 points |
//! |---|---|---|---|---|
//! | 3 | 9 | 2.25 | 1.78 | |
//! | 5 | 25 | 9 | 4 | 2.78 |
//! | 6 | 36 | | 7.11 | 4 |
//!
//! More points round more (about 1e-6 of the outputs' RMS for 8, 1e-5 for 10) and waste more at the border.
//! Source: Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016; the choice of points: Barabasz et al., "Error
//! analysis and improving the accuracy of Winograd convolution for deep neural networks", 2020.
//!
//! In `f32`, `U` is kept and read on large maps (`kept.rs`); on small ones it would take longer to read than to multiply with, and is made
//! where it is used (`anew.rs`). On 16-bit integers (`int16.rs`) it has half the size, and is kept.

mod anew;
mod int16;
mod kept;
mod points;
mod strips;
mod transforms;

use super::{ConvShape, fold};
use crate::par::{Share, Threads, Tiling};
use crate::quant::Quantization;
use crate::simd::Line;
use crate::{Aligned, Isa, Size};
pub(super) use kept::is_short;
pub use points::{MAX_KERNEL, kernel_row, pairs, share};
pub use transforms::{AsIs, Lines, Steps, Stored, lines_len};

/// Kernels of one layer.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    shape: ConvShape, // without stride
    points: usize,    // a
    kernels: Kernels,
}

#[derive(Clone, Debug)]
enum Kernels {
    Kept(kept::Weights),
    Anew(anew::Weights),
    Int16(int16::Weights),
}

/// Whether there is an algorithm of `points` for the kernel without its stride.
pub(super) fn fits(shape: &ConvShape, points: usize) -> bool {
    [(6, 3), (8, 3), (6, 5), (8, 5), (10, 5), (8, 6), (10, 6)]
        .contains(&(points, fold::unstrided(shape).kernel))
}

/// Whether there is one on 16-bit integers.
pub(super) fn fits_int16(shape: &ConvShape, points: usize) -> bool {
    shape.stride == 1 && [(6, 3), (8, 3), (8, 5)].contains(&(points, shape.kernel))
}

impl Weights {
    /// From `[Cout, k, k, Cin]`.
    pub(super) fn new(isa: Isa, shape: &ConvShape, points: usize, weights: &[f32]) -> Weights {
        let inner = fold::unstrided(shape);
        let folded;
        let weights = if shape.stride > 1 {
            folded = fold::weights(shape, weights);
            &folded
        } else {
            weights
        };
        let kernels = if inner.kernel == anew::KERNEL {
            Kernels::Anew(anew::Weights::new(isa, &inner, weights))
        } else {
            Kernels::Kept(kept::Weights::new(isa, &inner, points, weights))
        };
        Weights {
            shape: inner,
            points,
            kernels,
        }
    }

    /// From `[Cout, k, k, Cin]`, on 16-bit integers.
    pub(super) fn int16(
        isa: Isa,
        shape: &ConvShape,
        points: usize,
        weights: &[f32],
        input: Quantization,
    ) -> Weights {
        let shape = fold::unstrided(shape);
        let kernels = Kernels::Int16(int16::Weights::new(isa, &shape, points, weights, input));
        Weights {
            shape,
            points,
            kernels,
        }
    }

    /// The range of inputs, if it is on 16-bit integers.
    pub(super) fn input(&self) -> Option<Quantization> {
        if let Kernels::Int16(weights) = &self.kernels {
            Some(weights.input)
        } else {
            None
        }
    }

    /// The convolution without its stride.
    pub(super) fn shape(&self) -> &ConvShape {
        &self.shape
    }

    pub(super) fn points(&self) -> usize {
        self.points
    }

    /// Scratch values for an output of size `out`.
    pub(super) fn scratch_len(&self, out: Size, threads: &Threads) -> usize {
        let Weights {
            shape,
            points,
            ref kernels,
        } = *self;
        let each = match kernels {
            Kernels::Kept(weights) => weights.layout.scratch_len(&shape, points, out),
            Kernels::Anew(weights) => anew::scratch_len(weights, &shape, points, out),
            Kernels::Int16(weights) => weights.layout.scratch_len(&shape, points, out),
        };
        each * threads.count()
    }

    /// The tiles of a map of so many columns.
    fn tiling(&self, width: usize) -> Tiling {
        let (rows, channels) = (
            rows_per_tile(&self.shape, self.points),
            self.shape.out_channels,
        );
        Tiling {
            row_len: width * channels,
            rows,
            len: rows * channels,
        }
    }
}

/// One convolution without padding.
pub(super) struct Winograd<'a> {
    pub isa: Isa,
    pub weights: &'a Weights,
    pub bias: &'a [f32],  // [Cout]
    pub input: &'a [f32], // [size.h, size.w, Cin], padding included
    pub size: Size,
}

impl Winograd<'_> {
    /// Convolves into `out` (`[H', W', Cout]`); `scratch` is of [`Weights::scratch_len`].
    pub(super) fn run(&self, threads: &Threads, out: &mut [f32], scratch: &mut [f32]) {
        let tiling = self
            .weights
            .tiling(self.weights.shape.out_size(self.size).w);
        threads.split_tiles(out, tiling, scratch, |share| match &self.weights.kernels {
            Kernels::Kept(weights) => self.isa.run(Part {
                conv: self,
                weights,
                share,
            }),
            Kernels::Anew(weights) => self.isa.run(Part {
                conv: self,
                weights,
                share,
            }),
            Kernels::Int16(weights) => self.isa.run_dot(Part {
                conv: self,
                weights,
                share,
            }),
        });
    }
}

/// A thread's part of the output, with the kernels laid out for one way or another.
struct Part<'a, W> {
    conv: &'a Winograd<'a>,
    weights: &'a W,
    share: Share<'a>,
}

/// Output rows of one row of tiles.
pub(super) fn rows_per_tile(shape: &ConvShape, points: usize) -> usize {
    points + 1 - shape.kernel
}

/// `[Cout, k, k, Cin]` as `[block][Cin][vectors of the block][k * k][LANES]`, zeros behind the last channel.
fn pack(
    isa: Isa,
    shape: &ConvShape,
    blocks: impl Iterator<Item = usize>,
    weights: &[f32],
) -> Aligned<f32> {
    let (lanes, taps, cin) = (isa.lanes(), shape.kernel * shape.kernel, shape.in_channels);
    let vectors = shape.out_channels.div_ceil(lanes);
    let mut packed = Vec::with_capacity(vectors * lanes * shape.window());
    let mut first = 0;
    for width in blocks {
        for i in 0..cin {
            for vector in first..first + width {
                for tap in 0..taps {
                    let channels = vector * lanes..(vector + 1) * lanes;
                    let weight = |o: usize| weights.get((o * taps + tap) * cin + i).copied();
                    packed.extend(channels.map(|o| weight(o).unwrap_or(0.0)));
                }
            }
        }
        first += width;
    }
    packed.as_slice().into()
}

/// Values in a cache line.
const LINE: usize = size_of::<Line>() / size_of::<f32>();

/// From the start of one run of `values` to that of the next: one cache line more than needed, lest the runs' lines fall on each other in the
/// cache.
#[inline(always)]
fn step(values: usize) -> usize {
    values.next_multiple_of(LINE) + LINE
}

/// `scratch` from the start of a cache line on, so that no vector lies across two: up to a line less of it.
#[inline(always)]
fn from_line(scratch: &mut [f32]) -> &mut [f32] {
    let start = scratch.as_ptr().align_offset(align_of::<Line>()).min(LINE);
    &mut scratch[start..]
}
