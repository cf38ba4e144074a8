//! Convolution as one matrix product: patches `[H' W', k k Cin]` times weights `[k k Cin, Cout]`.
//!
//! Shapes: `[H, W, Cin] -> [H', W', Cout]`. Cost: the multiply-accumulates of the product, and a
//! copy of each input for every output that reads it. Patches are gathered one strip of output rows
//! at a time, so that they stay in the cache. It is the yardstick: short, portable, and as fast as
//! faer's matrix product. `direct.rs` saves the copy.

use super::ConvShape;
use crate::Size;
use crate::gemm::gemm;
use crate::par::Threads;

/// Weights as a matrix `[k * k * Cin, Cout]`.
#[derive(Clone, Debug)]
pub(super) struct WeightMatrix {
    data: Vec<f32>,
}

impl WeightMatrix {
    /// From `[Cout, k, k, Cin]`.
    pub(super) fn new(shape: &ConvShape, weights: &[f32]) -> WeightMatrix {
        let window = shape.window();
        let transposed =
            |i: usize| weights[i % shape.out_channels * window + i / shape.out_channels];
        WeightMatrix {
            data: (0..weights.len()).map(transposed).collect(),
        }
    }
}

/// Output pixels of one strip, unless a single row has more.
const STRIP_PIXELS: usize = 256;

/// Output rows of one strip.
fn strip_rows(width: usize) -> usize {
    (STRIP_PIXELS / width).max(1)
}

/// Scratch values per thread: the patches of one strip.
pub(super) fn scratch_len(shape: &ConvShape, size: Size) -> usize {
    let width = shape.out_size(size).w;
    strip_rows(width) * width * shape.window()
}

/// Convolves `input` (`[size.h, size.w, Cin]`, padding included) into `out` (`[H', W', Cout]`).
#[allow(clippy::too_many_arguments)] // one caller, which has just checked them all
pub(super) fn run(
    threads: &Threads,
    shape: &ConvShape,
    weights: &WeightMatrix,
    bias: &[f32],
    input: &[f32],
    size: Size,
    out: &mut [f32],
    scratch: &mut [f32],
) {
    let width = (size.w - shape.kernel) / shape.stride + 1;
    let (channels, window) = (shape.out_channels, shape.window());
    let strip = strip_rows(width);
    threads.split_rows_with(
        out,
        width * channels,
        1,
        scratch,
        |first_row, out, patches| {
            // Gather a strip's patches, multiply them, then add the bias while the outputs are in
            // the cache.
            for (i, out) in out.chunks_mut(strip * width * channels).enumerate() {
                let pixels = out.len() / channels;
                let patches = &mut patches[..pixels * window];
                gather(shape, input, size, first_row + i * strip, width, patches);
                gemm(pixels, channels, window, patches, &weights.data, out);
                for pixel in out.chunks_exact_mut(channels) {
                    for (value, bias) in pixel.iter_mut().zip(bias) {
                        *value += bias;
                        if shape.relu {
                            *value = value.max(0.0);
                        }
                    }
                }
            }
        },
    );
}

/// Copies the windows of whole output rows, from `first_row` on, into `patches`
/// (`[pixels, k, k * Cin]`).
fn gather(
    shape: &ConvShape,
    input: &[f32],
    size: Size,
    first_row: usize,
    width: usize,
    patches: &mut [f32],
) {
    let row_len = shape.kernel * shape.in_channels;
    for (pixel, patch) in patches.chunks_exact_mut(shape.window()).enumerate() {
        let y = (first_row + pixel / width) * shape.stride;
        let x = pixel % width * shape.stride;
        for (ky, to) in patch.chunks_exact_mut(row_len).enumerate() {
            to.copy_from_slice(&input[((y + ky) * size.w + x) * shape.in_channels..][..row_len]);
        }
    }
}
