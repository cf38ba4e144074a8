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

/// One convolution.
pub(super) struct Im2col<'a> {
    pub shape: &'a ConvShape,
    pub weights: &'a WeightMatrix,
    pub bias: &'a [f32],  // [Cout]
    pub input: &'a [f32], // [size.h, size.w, Cin], padding included
    pub size: Size,
}

impl Im2col<'_> {
    /// Convolves into `out` (`[H', W', Cout]`).
    pub fn run(self, threads: &Threads, out: &mut [f32], scratch: &mut [f32]) {
        let width = (self.size.w - self.shape.kernel) / self.shape.stride + 1;
        let row_len = width * self.shape.out_channels;
        let strip = strip_rows(width);
        threads.split_rows_with(out, row_len, 1, scratch, |first_row, out, patches| {
            for (i, out) in out.chunks_mut(strip * row_len).enumerate() {
                self.strip(first_row + i * strip, width, out, patches);
            }
        });
    }

    /// The output rows from `first_row` on: gathers their patches, multiplies them, then adds the
    /// bias while the outputs are in the cache.
    fn strip(&self, first_row: usize, width: usize, out: &mut [f32], patches: &mut [f32]) {
        let (channels, window) = (self.shape.out_channels, self.shape.window());
        let pixels = out.len() / channels;
        let patches = &mut patches[..pixels * window];
        self.gather(first_row, width, patches);
        gemm(pixels, channels, window, patches, &self.weights.data, out);
        for pixel in out.chunks_exact_mut(channels) {
            for (value, bias) in pixel.iter_mut().zip(self.bias) {
                *value += bias;
                if self.shape.relu {
                    *value = value.max(0.0);
                }
            }
        }
    }

    /// Copies the windows of whole output rows, from `first_row` on, into `patches`
    /// (`[pixels, k, k * Cin]`).
    fn gather(&self, first_row: usize, width: usize, patches: &mut [f32]) {
        let Im2col {
            shape, input, size, ..
        } = *self;
        let row_len = shape.kernel * shape.in_channels;
        for (pixel, patch) in patches.chunks_exact_mut(shape.window()).enumerate() {
            let y = (first_row + pixel / width) * shape.stride;
            let x = pixel % width * shape.stride;
            for (ky, to) in patch.chunks_exact_mut(row_len).enumerate() {
                let from = ((y + ky) * size.w + x) * shape.in_channels;
                to.copy_from_slice(&input[from..][..row_len]);
            }
        }
    }
}
