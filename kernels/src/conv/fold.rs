//! Rewrites a strided convolution as one of stride 1 (space to depth): the input's phases become
//! channels.
//!
//! With stride `s`, the inputs `x[s Y + p]` of one phase `p < s` form a map of their own, `s` times
//! smaller, and
//!
//! ```text
//! y[Y] = sum over k of w[k] x[s Y + k] = sum over p, q of w[s q + p] x_p[Y + q]
//! ```
//!
//! A kernel of side `k` with stride `s` on `Cin` channels is therefore one of side `ceil(k / s)`
//! with stride 1 on `s * s * Cin` channels, zero where `s q + p >= k`. The network's 11 x 11 kernel
//! with stride 2 on 3 channels becomes 6 x 6 on 12, which Winograd's algorithm supports.
//!
//! Shapes: input `[H, W, Cin] -> [H' + q - 1, W' + q - 1, s * s * Cin]` with `q = ceil(k / s)`.
//! Cost: one copy of the input.

use super::ConvShape;
use crate::Size;
use crate::par::Threads;

/// The convolution of stride 1 without padding that computes the same outputs as `shape`.
pub(super) fn unstrided(shape: &ConvShape) -> ConvShape {
    let phases = shape.stride * shape.stride;
    ConvShape {
        in_channels: phases * shape.in_channels,
        kernel: shape.kernel.div_ceil(shape.stride),
        stride: 1,
        pad: 0,
        ..*shape
    }
}

/// Size of the folded input.
pub(super) fn size(shape: &ConvShape, input: Size) -> Size {
    let out = shape.out_size(input);
    let border = shape.kernel.div_ceil(shape.stride) - 1;
    Size {
        h: out.h + border,
        w: out.w + border,
    }
}

/// Folds weights `[Cout, k, k, Cin]` to `[Cout, q_y, q_x, p_y, p_x, Cin]`.
pub(super) fn weights(shape: &ConvShape, weights: &[f32]) -> Vec<f32> {
    let (s, k, cin) = (shape.stride, shape.kernel, shape.in_channels);
    let side = k.div_ceil(s);
    let mut folded = Vec::with_capacity(shape.out_channels * side * side * s * s * cin);
    for kernel in weights.chunks_exact(k * k * cin) {
        for (q_y, q_x) in (0..side * side).map(|q| (q / side, q % side)) {
            for (p_y, p_x) in (0..s * s).map(|p| (p / s, p % s)) {
                let (y, x) = (s * q_y + p_y, s * q_x + p_x);
                let taps = if y < k && x < k {
                    &kernel[(y * k + x) * cin..][..cin]
                } else {
                    &[]
                };
                folded.extend_from_slice(taps);
                folded.extend(std::iter::repeat_n(0.0, cin - taps.len()));
            }
        }
    }
    folded
}

/// Folds `input` (`[H, W, Cin]`) to `[Y, X, p_y, p_x, Cin]` in `out`, which is of [`size`]; zeros
/// beyond the edges.
pub(super) fn input(
    shape: &ConvShape,
    threads: &Threads,
    input: &[f32],
    size: Size,
    out: &mut [f32],
) {
    let (s, cin, pad) = (shape.stride, shape.in_channels, shape.pad);
    let width = self::size(shape, size).w;
    let run = s * cin; // the phases of one row are neighbors already
    let row_len = width * s * run;
    threads.split_rows(out, row_len, |first, out| {
        for (i, row) in out.chunks_exact_mut(row_len).enumerate() {
            // Phase `p_y` of folded row `Y` is one row of the input, `s Y + p_y - pad`, or zeros
            // outside of it.
            for p_y in 0..s {
                let to = &mut row[p_y * run..];
                let from = (s * (first + i) + p_y)
                    .checked_sub(pad)
                    .filter(|y| *y < size.h);
                let from = from.map_or(&[][..], |y| &input[y * size.w * cin..][..size.w * cin]);
                match run {
                    6 if pad == 0 => spread::<6>(from, s * run, to), // the network's first layer
                    _ => spread_any(from, pad * cin, run, s * run, to),
                }
            }
        }
    });
}

/// Copies runs of `N` values of `from` to every `step`-th value of `to`; zeros once `from` is used
/// up.
fn spread<const N: usize>(from: &[f32], step: usize, to: &mut [f32]) {
    let (runs, rest) = from.as_chunks::<N>();
    let mut last = [0.0; N];
    last[..rest.len()].copy_from_slice(rest);
    let runs = runs
        .iter()
        .chain([&last])
        .chain(std::iter::repeat(&[0.0; N]));
    for (to, run) in to.chunks_mut(step).zip(runs) {
        to[..N].copy_from_slice(run);
    }
}

/// Does what [`spread`] does for runs of any length, with `before` zeros in front of `from`.
fn spread_any(from: &[f32], before: usize, run: usize, step: usize, to: &mut [f32]) {
    for (i, to) in to.chunks_mut(step).enumerate() {
        for (j, to) in to[..run].iter_mut().enumerate() {
            *to = (i * run + j)
                .checked_sub(before)
                .and_then(|at| from.get(at))
                .copied()
                .unwrap_or(0.0);
        }
    }
}
