//! Every kernel as naive loops in `f64`, straight from its formula: the oracle of the tests.

use crate::Size;
use crate::conv::ConvShape;
use crate::quant::Quantization;

/// `[m, k] x [k, n] -> [m, n]`.
pub fn gemm(m: usize, n: usize, k: usize, a: &[f32], b: &[f32]) -> Vec<f64> {
    let mut c = vec![0.0; m * n];
    for i in 0..m {
        for j in 0..n {
            c[i * n + j] = (0..k)
                .map(|l| f64::from(a[i * k + l]) * f64::from(b[l * n + j]))
                .sum();
        }
    }
    c
}

/// Convolution: input `[H, W, Cin]`, weights `[Cout, k, k, Cin]`, bias `[Cout]` ->
/// `[H', W', Cout]`.
pub fn conv(
    shape: &ConvShape,
    size: Size,
    input: &[f32],
    weights: &[f32],
    bias: &[f32],
) -> Vec<f64> {
    let out = shape.out_size(size);
    let (k, cin) = (shape.kernel, shape.in_channels);
    let mut y = Vec::with_capacity(out.area() * shape.out_channels);
    for oy in 0..out.h {
        for ox in 0..out.w {
            for oc in 0..shape.out_channels {
                let mut sum = f64::from(bias[oc]);
                for ky in 0..k {
                    for kx in 0..k {
                        let (iy, ix) = (oy * shape.stride + ky, ox * shape.stride + kx);
                        let (Some(iy), Some(ix)) =
                            (iy.checked_sub(shape.pad), ix.checked_sub(shape.pad))
                        else {
                            continue;
                        };
                        if iy >= size.h || ix >= size.w {
                            continue;
                        }
                        for ic in 0..cin {
                            let x = input[(iy * size.w + ix) * cin + ic];
                            let w = weights[((oc * k + ky) * k + kx) * cin + ic];
                            sum += f64::from(x) * f64::from(w);
                        }
                    }
                }
                y.push(if shape.relu { sum.max(0.0) } else { sum });
            }
        }
    }
    y
}

/// `x / scale + zero_point`, clamped to 0..=255; not rounded.
pub fn quantize(quantization: Quantization, values: &[f32]) -> Vec<f64> {
    let scale = f64::from(quantization.scale);
    let zero = f64::from(quantization.zero_point);
    values
        .iter()
        .map(|v| (f64::from(*v) / scale + zero).clamp(0.0, 255.0))
        .collect()
}

/// 3x3 maximum, stride 2, ceil mode: `[H, W, C] -> [H', W', C]`.
pub fn max_pool(size: Size, channels: usize, input: &[f32]) -> Vec<f64> {
    let out = crate::pool::out_size(size);
    let mut y = Vec::with_capacity(out.area() * channels);
    for oy in 0..out.h {
        for ox in 0..out.w {
            for c in 0..channels {
                let mut max = f64::NEG_INFINITY;
                for iy in 2 * oy..(2 * oy + 3).min(size.h) {
                    for ix in 2 * ox..(2 * ox + 3).min(size.w) {
                        max = max.max(f64::from(input[(iy * size.w + ix) * channels + c]));
                    }
                }
                y.push(max);
            }
        }
    }
    y
}

/// Depthwise cross-correlation: `[H, W, C]` with `[h, w, C] -> [H-h+1, W-w+1, C]`.
pub fn xcorr(size: Size, kernel: Size, channels: usize, x: &[f32], z: &[f32]) -> Vec<f64> {
    let out = Size {
        h: size.h - kernel.h + 1,
        w: size.w - kernel.w + 1,
    };
    let mut y = Vec::with_capacity(out.area() * channels);
    for oy in 0..out.h {
        for ox in 0..out.w {
            for c in 0..channels {
                let mut sum = 0.0;
                for ky in 0..kernel.h {
                    for kx in 0..kernel.w {
                        let a = x[((oy + ky) * size.w + ox + kx) * channels + c];
                        sum += f64::from(a) * f64::from(z[(ky * kernel.w + kx) * channels + c]);
                    }
                }
                y.push(sum);
            }
        }
    }
    y
}

/// One filter over all channels: `[H, W, C]` with `[h, w, C] -> [H-h+1, W-w+1]`.
pub fn filter(size: Size, filter: Size, channels: usize, x: &[f32], f: &[f32]) -> Vec<f64> {
    let depthwise = xcorr(size, filter, channels, x, f);
    depthwise
        .chunks_exact(channels)
        .map(|cell| cell.iter().sum())
        .collect()
}

/// The adjoint of [`filter`]: `[H, W, C]` with `[H-h+1, W-w+1] -> [h, w, C]`.
pub fn filter_adjoint(size: Size, filter: Size, channels: usize, x: &[f32], r: &[f32]) -> Vec<f64> {
    let out_w = size.w - filter.w + 1;
    let mut g = vec![0.0; filter.area() * channels];
    for (i, r) in r.iter().enumerate() {
        for (j, g) in g.iter_mut().enumerate() {
            let (cell, c) = (j / channels, j % channels);
            let (row, column) = (i / out_w + cell / filter.w, i % out_w + cell % filter.w);
            *g += f64::from(*r) * f64::from(x[(row * size.w + column) * channels + c]);
        }
    }
    g
}

/// One bilinear sample of a channel of BGR at (`x`, `y`), outside pixels being `border`; not
/// rounded.
pub fn sample(
    image: &crate::pixels::Pixels<'_>,
    channel: usize,
    x: f64,
    y: f64,
    border: u8,
) -> f64 {
    let Size { h, w } = image.size();
    let tap = |x: f64, y: f64| {
        let inside = x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64;
        let at = || image.bgr(x as usize, y as usize)[channel];
        f64::from(if inside { at() } else { border })
    };
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let top = tap(x0, y0) * (1.0 - fx) + tap(x0 + 1.0, y0) * fx;
    let bottom = tap(x0, y0 + 1.0) * (1.0 - fx) + tap(x0 + 1.0, y0 + 1.0) * fx;
    top * (1.0 - fy) + bottom * fy
}
