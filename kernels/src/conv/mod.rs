//! Convolution, about 90 % of a frame's time, with ReLU if asked for:
//!
//! ```text
//! y[o] = b[o] + sum over ky, kx, i of w[o, ky, kx, i] * x[s y + ky - pad, s x + kx - pad, i]
//! ```
//!
//! Shapes: input `[H, W, Cin]`, weights `[Cout, k, k, Cin]`, bias `[Cout]`, output `[H', W', Cout]`
//! with `H' = (H + 2 pad - k) / stride + 1`. Cost: `H' W' Cout Cin k^2` multiply-accumulates.
//!
//! The basic idea: in HWC one row of the kernel's window is `k * Cin` *contiguous* values. A
//! convolution is therefore `k` matrix products whose rows overlap, and no patch has to be
//! gathered.
//!
//! | file | what it does |
//! |---|---|
//! | `shape.rs` | channels, kernel, stride, padding |
//! | `algorithm.rs` | the algorithms, and the plan that picks one per layer |
//! | `conv.rs` | [`Conv`]: weights laid out once, then run per frame. **Start here.** |
//! | `direct.rs` | register tiles over the input in place: the simplest hot loop |
//! | `winograd/` | 4 to 9 times fewer multiplications; what the plan picks for most layers |
//! | `fold.rs` | turns a strided convolution into one of stride 1, for Winograd |
//! | `int8.rs` | register tiles over bytes |
//! | `im2col.rs` | patches and a general matrix product: the portable yardstick |
//! | `pooled.rs` | a convolution and the max-pool after it, band by band |
//!
//! | hot loop | file | where it runs |
//! |---|---|---|
//! | `products` | `winograd/int16.rs` | int8 on x86: winograd6 and winograd8 on 16-bit integers |
//! | `ShortGroup::run` | `winograd/stored.rs` | conv1 on AVX-512: winograd10, always `f32` |
//! | `Tile::add`, `add_runs` | `int8.rs` | int8 on ARM, most layers; the template's neck |
//! | `Tile::run_sized` | `winograd/on_the_fly.rs` | `f32`: 3x3 layers |
//! | `add_products` | `direct.rs` | `f32`: conv1, conv2 (from `stored.rs`); all outputs |

/// Calls `$tile.$run` with the sizes of a register tile as constants, of which `$most[vectors]` is
/// the most pixels.
///
/// The compiler unrolls a tile completely and keeps its sums in registers; a size that is a
/// variable would put them in memory. Sizes beyond the instruction set's registers are not compiled
/// at all.
macro_rules! for_tile {
    ($pixels:expr, $vectors:expr, $tile:ident.$run:ident, $set:ident, $token:expr, $most:expr) => {
        for_tile!(@table $pixels, $vectors, $tile.$run, $set, $token, $most;
            (1 1) (2 1) (3 1) (4 1) (5 1) (6 1) (7 1) (8 1) (9 1)
            (1 2) (2 2) (3 2) (4 2) (5 2) (6 2) (7 2) (8 2) (9 2)
            (1 3) (2 3) (3 3) (4 3) (5 3) (6 3) (7 3) (8 3) (9 3))
    };
    (@table $pixels:expr, $vectors:expr, $tile:ident.$run:ident, $set:ident, $token:expr,
     $most:expr; $(($p:literal $v:literal))*) => {
        match ($pixels, $vectors) {
            $(($p, $v) if const { $p <= $most[$v] } => $tile.$run::<$set, $p, $v>($token),)*
            (pixels, vectors) => unreachable!("tile of {pixels} pixels x {vectors} vectors"),
        }
    };
}
use for_tile;

mod algorithm;
#[expect(
    clippy::module_inception,
    reason = "the struct `Conv` and its file have the folder's name"
)]
mod conv;
mod direct;
mod fold;
mod im2col;
mod int8;
mod pooled;
mod shape;
#[cfg(test)]
mod tests;
pub mod winograd;

pub use algorithm::{Algorithm, Arithmetic, Points};
pub use conv::{Conv, Input, Output};
pub use int8::SLACK;
pub use shape::ConvShape;
