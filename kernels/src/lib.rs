//! The tracker's maths on slices: no files, no model, no tracker words.
//!
//! Activations are `f32` in HWC order (`[height, width, channels]`, channels innermost), one image
//! at a time.
//!
//! | kernel | formula | input -> output | file |
//! |---|---|---|---|
//! | convolution, direct | `y = relu(b + sum of w x)` | `[H, W, Cin] -> [H', W', Cout]` | [`conv`], `conv/direct.rs` |
//! | convolution, Winograd | the same, 4 to 9 times fewer multiplications | the same | `conv/winograd/` |
//! | convolution, int8 | the same on bytes, summed exactly in `i32` | the same | `conv/int8.rs` |
//! | convolution, im2col | the same, as one matrix product | the same | `conv/im2col.rs`, [`mod@gemm`] |
//! | quantization | `q = round(x / s) + z` | `f32 [n] -> u8 [n]` | [`quant`] |
//! | max-pool 3x3/2 | `y = max x`, ceil mode | `[H, W, C] -> [H', W', C]` | [`mod@pool`] |
//! | cross-correlation | `y = sum of x z`, per channel | `[H, W, C], [k, k, C] -> [H-k+1, W-k+1, C]` | [`mod@xcorr`] |
//! | filter, adjoint | `y = sum of x f`, all channels | `[H, W, C], [k, k, C] -> [H-k+1, W-k+1]` | [`filter`] |
//! | pixels | YUV in any layout to BGR | planes of `u8` -> `[b, g, r]` | [`pixels`] |
//! | crop and resize | bilinear, constant border | pixels -> `u8 [D, D, 3]` | [`mod@resample`] |
//! | sigmoid, exp | `y = 1 / (1 + exp(-x))`, `y = exp(x)` | `[n] -> [n]` | [`pointwise`] |
//!
//! Convolutions take about 90 % of a frame's time, the tracker's filter 7 %, pools and crops 2 %
//! each.
//!
//! Every kernel file has the same five parts in the same order: the module's doc (formula, shapes,
//! cost, source), a struct of arguments, a public function that checks shapes once, the body, and
//! tests against [`mod@reference`].
//!
//! [`Isa`] says on which instruction set a kernel runs, [`par::Threads`] on how many threads.
//! Detect one and start the other once, then pass both on: there is no global state. One
//! instruction set gives the same bits on any number of threads.
//!
//! A 3x3 convolution, planned for its size and run on two threads:
//!
//! ```
//! use kernels::conv::{Algorithm, Conv, ConvShape};
//! use kernels::par::Threads;
//! use kernels::{Isa, Size};
//!
//! let shape = ConvShape {
//!     in_channels: 2,
//!     out_channels: 3,
//!     kernel: 3,
//!     stride: 1,
//!     pad: 0,
//!     relu: true,
//! };
//! let size = Size { h: 5, w: 6 };
//! let weights = vec![0.5; 3 * 3 * 3 * 2]; // [Cout, k, k, Cin]
//! let bias = [0.0, 1.0, -100.0];
//! let threads = Threads::new(2);
//!
//! let conv = Conv::new(Isa::detect(), Algorithm::plan(&shape, size), shape, &weights, &bias);
//!
//! let input = vec![1.0; size.area() * 2];
//! let mut out = vec![0.0; shape.out_size(size).area() * 3];
//! let mut scratch = vec![0.0; conv.scratch_len(size, &threads)];
//! let out_size = threads.enter(|| conv.run(&threads, &input, size, &mut out, &mut scratch));
//!
//! assert_eq!(out_size, Size { h: 3, w: 4 });
//! for pixel in out.chunks(3) {
//!     assert!((pixel[0] - 9.0).abs() < 1e-4); // 3 * 3 * 2 products of 0.5
//!     assert!((pixel[1] - 10.0).abs() < 1e-4);
//!     assert_eq!(pixel[2], 0.0); // ReLU
//! }
//! ```

#![deny(unsafe_code)]

pub mod aligned;
pub mod conv;
pub mod filter;
pub mod gemm;
pub mod isa;
pub mod par;
pub mod pixels;
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
