//! Convolution with fewer multiplications: Winograd's F(m x m, k x k), for stride 1; `fold.rs`
//! turns other strides into it.
//!
//! The basic idea is polynomial multiplication. An `m x m` tile of outputs depends on an `a x a`
//! tile of inputs, `a = m + k - 1`. Inputs and kernel are polynomials; evaluated at `a` points (0,
//! pairs such as 1 and -1, infinity), their product costs one multiplication per point:
//!
//! ```text
//! V = B^T d B            input tile d, per input channel        additions
//! U = G g G^T            kernel g, per pair of channels         once, or per strip of tiles
//! M = sum over i of U V  a x a products [tiles, Cin] x [Cin, Cout]  all the multiplications
//! Y = A^T M A            output tile, per output channel        additions
//! ```
//!
//! Shapes: `[H, W, Cin] -> [H', W', Cout]`. Cost in multiplications per output and pair of
//! channels:
//!
//! | `k` | direct | 6 points | 8 points | 10 points |
//! |---|---|---|---|---|
//! | 3 | 9 | 2.25 | 1.78 | |
//! | 5 | 25 | | 4 (integers only) | 2.78 |
//! | 6 | 36 | | | 4 |
//!
//! Only these sizes are compiled: in `f32`, 10 points are fastest for 5x5 and 6x6 kernels at any
//! number of channels. More points round more (1e-6 of the outputs' RMS for 8 points, 1e-5 for 10)
//! and waste more at the border.
//!
//! Sources: Lavin and Gray, "Fast algorithms for convolutional neural networks", 2016. The choice
//! of points: Barabasz et al., "Error analysis and improving the accuracy of Winograd convolution
//! for deep neural networks", 2020.
//!
//! | file | what it does |
//! |---|---|
//! | `points.rs` | the points, and the matrices `B^T`, `G` and `A^T` that follow from them |
//! | `transforms.rs` | `V = B^T d B` and `Y = A^T M A` of tiles |
//! | `strips.rs` | the walk over a map, strip by strip, where `U` is stored |
//! | `stored.rs` | products with a stored `U`: 5x5 and 6x6 kernels |
//! | `on_the_fly.rs` | products with a `U` computed in each strip: 3x3 kernels |
//! | `int16.rs` | products of 16-bit integers, `U` stored at half the size |
//!
//! Whether to store `U` is a question of bandwidth. A 3x3 kernel's `U` has 4 to 7 times as many
//! values as the kernel, and small maps have too few tiles to make up for reading them.

mod int16;
mod on_the_fly;
mod points;
mod stored;
mod strips;
mod transforms;

use super::{Arithmetic, ConvShape, Points, fold};
use crate::par::{ThreadTiles, Threads, Tiling};
use crate::quant::Quantization;
use crate::simd::Line;
use crate::{Aligned, Isa, Size};
pub use points::{MAX_KERNEL, kernel_row, pairs, share};
pub(super) use stored::is_short;
pub use transforms::{AsIs, Lines, PointFormat, Steps, lines_len};

/// Work that is compiled once per size of tiles: `A` points and `M` outputs along one side.
trait TileTask {
    fn run<const A: usize, const M: usize>(self);
}

/// Defines lists of sizes, each with a function that runs a [`TileTask`] for one of its sizes.
macro_rules! sizes {
    ($($list:ident, $run:ident: $(($points:literal, $kernel:literal))*;)*) => {$(
        const $list: &[(usize, usize)] = &[$(($points, $kernel)),*];

        #[inline(always)]
        fn $run(points: usize, kernel: usize, task: impl TileTask) {
            match (points, kernel) {
                $(($points, $kernel) => task.run::<$points, { $points + 1 - $kernel }>(),)*
                _ => unreachable!("{points} points for a {kernel}x{kernel} kernel"),
            }
        }
    )*};
}

// All compiled sizes, (points, side of the kernel), by the form of the kernels; `fits` reads them.
sizes! {
    ON_THE_FLY, run_on_the_fly: (6, 3) (8, 3);
    STORED, run_stored: (10, 5) (10, 6);
    INT16, run_int16: (6, 3) (8, 3) (8, 5);
}

/// Whether `shape`, folded to stride 1, is among the compiled sizes.
pub(super) fn fits(shape: &ConvShape, points: Points, arithmetic: Arithmetic) -> bool {
    let size = (points.count(), fold::unstrided(shape).kernel);
    match arithmetic {
        Arithmetic::F32 => ON_THE_FLY.contains(&size) || STORED.contains(&size),
        Arithmetic::Int16(_) => shape.stride == 1 && INT16.contains(&size),
    }
}

/// Kernels of one layer.
#[derive(Clone, Debug)]
pub(super) struct WinogradKernels {
    shape: ConvShape, // of stride 1
    points: usize,    // a
    form: Form,
}

/// The form in which kernels are held.
#[derive(Clone, Debug)]
enum Form {
    Stored(stored::StoredKernels),
    OnTheFly(on_the_fly::PackedKernels),
    Int16(int16::Int16Kernels),
}

impl WinogradKernels {
    /// Lays out `weights` (`[Cout, k, k, Cin]`) for products in `f32`.
    pub(super) fn new(
        isa: Isa,
        shape: &ConvShape,
        points: usize,
        weights: &[f32],
    ) -> WinogradKernels {
        let inner = fold::unstrided(shape);
        let folded;
        let weights = if shape.stride > 1 {
            folded = fold::weights(shape, weights);
            &folded
        } else {
            weights
        };
        let form = if ON_THE_FLY.contains(&(points, inner.kernel)) {
            Form::OnTheFly(on_the_fly::PackedKernels::new(isa, &inner, weights))
        } else {
            Form::Stored(stored::StoredKernels::new(isa, &inner, points, weights))
        };
        WinogradKernels {
            shape: inner,
            points,
            form,
        }
    }

    /// Lays out `weights` (`[Cout, k, k, Cin]`) for products of 16-bit integers with inputs in the
    /// range of `input`.
    pub(super) fn int16(
        isa: Isa,
        shape: &ConvShape,
        points: usize,
        weights: &[f32],
        input: Quantization,
    ) -> WinogradKernels {
        let shape = fold::unstrided(shape);
        let form = Form::Int16(int16::Int16Kernels::new(
            isa, &shape, points, weights, input,
        ));
        WinogradKernels {
            shape,
            points,
            form,
        }
    }

    /// The convolution, of stride 1.
    pub(super) fn shape(&self) -> &ConvShape {
        &self.shape
    }

    /// Points along one side of a tile.
    pub(super) fn points(&self) -> usize {
        self.points
    }

    /// Scratch values for an output of size `out` on all threads.
    pub(super) fn scratch_len(&self, out: Size, threads: &Threads) -> usize {
        let WinogradKernels {
            shape,
            points,
            ref form,
        } = *self;
        let per_thread = match form {
            Form::Stored(kernels) => kernels.layout.scratch_len(&shape, points, out),
            Form::OnTheFly(kernels) => on_the_fly::scratch_len(kernels, &shape, points, out),
            Form::Int16(kernels) => kernels.layout.scratch_len(&shape, points, out),
        };
        per_thread * threads.count()
    }

    /// How a map of `width` columns is cut into tiles.
    fn tiling(&self, width: usize) -> Tiling {
        let rows = rows_per_tile(&self.shape, self.points);
        let channels = self.shape.out_channels;
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
    pub kernels: &'a WinogradKernels,
    pub bias: &'a [f32],  // [Cout]
    pub input: &'a [f32], // [size.h, size.w, Cin], padding included
    pub size: Size,
}

impl Winograd<'_> {
    /// Convolves into `out` (`[H', W', Cout]`); `scratch` has [`WinogradKernels::scratch_len`]
    /// values.
    pub(super) fn run(&self, threads: &Threads, out: &mut [f32], scratch: &mut [f32]) {
        let tiling = self
            .kernels
            .tiling(self.kernels.shape.out_size(self.size).w);
        threads.split_tiles(out, tiling, scratch, |tiles| match &self.kernels.form {
            Form::Stored(kernels) => self.isa.run(ThreadPart {
                conv: self,
                kernels,
                tiles,
            }),
            Form::OnTheFly(kernels) => self.isa.run(ThreadPart {
                conv: self,
                kernels,
                tiles,
            }),
            Form::Int16(kernels) => self.isa.run_dot(ThreadPart {
                conv: self,
                kernels,
                tiles,
            }),
        });
    }
}

/// One thread's part of a convolution, with kernels in one of the three forms.
struct ThreadPart<'a, K> {
    conv: &'a Winograd<'a>,
    kernels: &'a K,
    tiles: ThreadTiles<'a>,
}

/// Output rows of one row of tiles: `m`.
pub(super) fn rows_per_tile(shape: &ConvShape, points: usize) -> usize {
    points + 1 - shape.kernel
}

/// Lays out `[Cout, k, k, Cin]` as `[block][Cin][vectors of the block][k * k][LANES]`, zeros after
/// the last channel.
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

/// Values of a cache line.
const LINE: usize = size_of::<Line>() / size_of::<f32>();

/// Distance between the starts of runs of `values`: whole cache lines, plus one.
///
/// If it were a power of two, equal places of all runs would compete for one set of the cache.
#[inline(always)]
fn step(values: usize) -> usize {
    values.next_multiple_of(LINE) + LINE
}

/// `scratch` from its first cache line boundary on, so that no vector spans two lines.
#[inline(always)]
fn from_line(scratch: &mut [f32]) -> &mut [f32] {
    let start = scratch.as_ptr().align_offset(align_of::<Line>()).min(LINE);
    &mut scratch[start..]
}
