//! The tracker's maths on slices: no files, no model, no tracker words.
//!
//! Activations are `f32` in HWC order (`[height, width, channels]`, channels innermost), one image at a time.
//! Every kernel file has the same five parts in the same order: what it computes (formula, shapes, cost), its argument
//! struct, the public function that checks shapes once, the body, and tests against [`mod@reference`].
//!
//! | kernel | formula | input -> output | file | share of a frame |
//! |---|---|---|---|---|
//! | convolution, direct | `y = relu(b + sum w x)` | `[H, W, Cin] -> [H', W', Cout]` | [`conv`], `conv/direct.rs` | 95 % |
//! | convolution, Winograd | the same, with 3 to 6 times fewer multiplications | the same | `conv/winograd/` | all layers but the 1x1 outputs |
//! | convolution, im2col | the same, as one matrix product | the same | `conv/im2col.rs`, `gemm.rs` | portable alternative |
//! | convolution, int8 | the same on bytes, sums exact in `i32` | the same | `conv/int8.rs` | all but the outputs |
//! | quantization | `q = round(x / s) + z` | `f32 [n] -> u8 [n]` | [`quant`] | counted with the convolution |
//! | max-pool 3x3/2 | `y = max x`, ceil mode | `[H, W, C] -> [H', W', C]` | [`mod@pool`] | 2 % |
//! | cross-correlation | `y = sum x z` per channel | `[H, W, C], [k, k, C] -> [H-k+1, W-k+1, C]` | [`xcorr`] | 1 % |
//! | filter and its adjoint | `y = sum x f` over all channels | `[H, W, C], [k, k, C] -> [H-k+1, W-k+1]` | [`filter`] | learning while tracking |
//! | crop-and-resize | bilinear, constant border | `u8 [h, w, 1..4] -> u8 [D, D, 3]` | [`resample`] | 2 % |
//! | sigmoid, exp | | `[n] -> [n]` | [`pointwise`] | < 0.1 % |
//!
//! [`Isa`] says which instruction set a kernel runs on; it is detected once and passed on. [`par::Threads`] says on how
//! many threads. Neither changes a result's meaning, and the same ISA gives the same bits on any number of threads.

#![deny(unsafe_code)]

pub mod aligned;
pub mod conv;
pub mod filter;
pub mod gemm;
pub mod isa;
pub mod par;
pub mod pointwise;
pub mod pool;
pub mod quant;
pub mod reference;
pub mod resample;
pub mod simd;
pub mod xcorr;

pub use aligned::Aligned;
pub use isa::{Isa, IsaError};

/// Height and width of a map, in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Size {
    /// Rows.
    pub h: usize,
    /// Columns.
    pub w: usize,
}

impl Size {
    /// A square map.
    pub const fn square(side: usize) -> Size {
        Size { h: side, w: side }
    }

    /// Pixels.
    pub const fn area(self) -> usize {
        self.h * self.w
    }
}

#[cfg(test)]
mod testing {
    //! Deterministic test data and comparison.

    /// `n` values in `[-1, 1)` that look random.
    pub fn noise(n: usize, seed: u64) -> Vec<f32> {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        let next = |_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 40) as f32 / (1u64 << 23) as f32 - 1.0
        };
        (0..n).map(next).collect()
    }

    /// Asserts that no value is further than `tolerance` of the expected values' RMS from its twin.
    pub fn assert_close(found: &[f32], expected: &[f64], tolerance: f64, what: &str) {
        assert_eq!(found.len(), expected.len(), "{what}: length");
        let rms =
            (expected.iter().map(|v| v * v).sum::<f64>() / expected.len().max(1) as f64).sqrt();
        for (i, (f, e)) in found.iter().zip(expected).enumerate() {
            let error = (f64::from(*f) - e).abs();
            assert!(
                error <= tolerance * rms.max(1e-6),
                "{what}: [{i}] is {f}, expected {e}"
            );
        }
    }
}
