//! Depthwise cross-correlation: `y[i, j, c] = sum over u, v of x[i + u, j + v, c] * z[u, v, c]`,
//! valid, no bias.
//!
//! Shapes: search features `[H, W, C]`, template features `[h, w, C]` -> response
//! `[H-h+1, W-w+1, C]`. Cost: one multiply-accumulate per template pixel and response value; 0.1 %
//! of the network's. Source: SiamRPN++ (Li et al., 2019); `docs/method.md`, section 1.3.
//!
//! The trick is reuse: 8 neighboring pixels and 4 columns of the template share 11 loads of search
//! features.

use crate::par::Threads;
use crate::simd::{Kernel, Simd};
use crate::{Isa, Size};

/// Some rows of one correlation.
struct Correlate<'a> {
    search: &'a [f32], // [size.h, size.w, channels]
    size: Size,
    template: &'a [f32], // [template_size.h, template_size.w, channels]
    template_size: Size,
    channels: usize,
    first_row: usize,   // of the response, that `out` starts at
    out: &'a mut [f32], // [rows, W', channels]
}

/// Features in a slice.
#[derive(Clone, Copy, Debug)]
pub struct Features<'a> {
    /// `[size.h, size.w, channels]`.
    pub values: &'a [f32],
    /// Height and width.
    pub size: Size,
}

/// Correlates `search` with `template`, both of `channels` channels, into `out`
/// (`[H-h+1, W-w+1, channels]`) and returns the size of `out`.
///
/// Panics if a length is not that of its shape, or if the template is the larger one.
pub fn xcorr(
    isa: Isa,
    threads: &Threads,
    search: Features,
    template: Features,
    channels: usize,
    out: &mut [f32],
) -> Size {
    let Features {
        values: search,
        size,
    } = search;
    let Features {
        values: template,
        size: template_size,
    } = template;
    assert!(
        template_size.h <= size.h && template_size.w <= size.w,
        "template {template_size:?} in {size:?}"
    );
    let out_size = Size {
        h: size.h - template_size.h + 1,
        w: size.w - template_size.w + 1,
    };
    assert_eq!(
        search.len(),
        size.area() * channels,
        "search features of xcorr"
    );
    assert_eq!(
        template.len(),
        template_size.area() * channels,
        "template features of xcorr"
    );
    assert_eq!(out.len(), out_size.area() * channels, "response of xcorr");
    threads.split_rows(out, out_size.w * channels, |first_row, out| {
        isa.run(Correlate {
            search,
            size,
            template,
            template_size,
            channels,
            first_row,
            out,
        });
    });
    out_size
}

impl Kernel for Correlate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let width = self.size.w - self.template_size.w + 1;
        for y in 0..self.out.len() / (width * self.channels) {
            // The last group overlaps its neighbor rather than exceed the row.
            let groups = |pixels: usize| {
                (0..width)
                    .step_by(pixels)
                    .map(move |x| x.min(width - pixels))
            };
            match width {
                8.. => groups(8).for_each(|x| self.pixels::<S, 8>(simd, y, x)),
                4.. => groups(4).for_each(|x| self.pixels::<S, 4>(simd, y, x)),
                _ => groups(1).for_each(|x| self.pixels::<S, 1>(simd, y, x)),
            }
        }
    }
}

impl Correlate<'_> {
    /// All channels of `PIXELS` neighboring pixels of row `y` of `out`, from `x` on: their windows
    /// are few runs of memory, and stay in the L1 cache.
    #[inline(always)]
    fn pixels<S: Simd, const PIXELS: usize>(&mut self, simd: S, y: usize, x: usize) {
        let whole = self.channels / S::LANES * S::LANES;
        for channel in (0..whole).step_by(S::LANES) {
            self.tile::<S, PIXELS, true>(simd, y, x, channel);
        }
        if whole < self.channels {
            self.tile::<S, PIXELS, false>(simd, y, x, whole);
        }
    }

    /// One vector of channels, `WHOLE` or with fewer lanes, of these pixels: a template value is
    /// loaded once for all.
    #[inline(always)]
    fn tile<S: Simd, const PIXELS: usize, const WHOLE: bool>(
        &mut self,
        simd: S,
        y: usize,
        x: usize,
        channel: usize,
    ) {
        let Correlate {
            search,
            size,
            template,
            template_size,
            channels,
            ..
        } = *self;
        let lanes = if WHOLE { S::LANES } else { channels - channel };
        let load = |from: &[f32]| {
            if WHOLE {
                simd.load(from)
            } else {
                simd.load_partial(&from[..lanes])
            }
        };
        let mut sums = [simd.zero(); PIXELS];
        for u in 0..template_size.h {
            let row = &search[((self.first_row + y + u) * size.w + x) * channels + channel..];
            let from = &template[u * template_size.w * channels + channel..];
            let mut t = 0;
            while t < template_size.w {
                let x = |i: usize| load(&row[(t + i) * channels..]);
                let z = |i: usize| load(&from[(t + i) * channels..]);
                t += match template_size.w - t {
                    4.. => add::<S, PIXELS, 4>(simd, &mut sums, x, z),
                    _ => add::<S, PIXELS, 1>(simd, &mut sums, x, z),
                };
            }
        }
        let width = size.w - template_size.w + 1;
        let out = &mut self.out[(y * width + x) * channels + channel..];
        for (i, sum) in sums.into_iter().enumerate() {
            let out = &mut out[i * channels..][..lanes];
            if WHOLE {
                simd.store(sum, out)
            } else {
                simd.store_partial(sum, out)
            }
        }
    }
}

/// Adds the products of `COLUMNS` columns of a template row (`z`) with a row of search features
/// (`x`) to neighboring pixels: each value is loaded once. Returns `COLUMNS`.
#[inline(always)]
fn add<S: Simd, const PIXELS: usize, const COLUMNS: usize>(
    simd: S,
    sums: &mut [S::F32; PIXELS],
    x: impl Fn(usize) -> S::F32,
    z: impl Fn(usize) -> S::F32,
) -> usize {
    let z: [S::F32; COLUMNS] = std::array::from_fn(z);
    for j in 0..PIXELS + COLUMNS - 1 {
        let x = x(j);
        for i in 0..PIXELS {
            if i <= j && j - i < COLUMNS {
                sums[i] = simd.mul_add(x, z[j - i], sums[i]);
            }
        }
    }
    COLUMNS
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::{assert_close, noise};

    #[test]
    fn xcorr_of_any_channels_and_sizes_equals_the_reference() {
        for channels in [1, 3, 4, 5, 7, 8, 9, 15, 16, 17, 47, 128] {
            for (h, w, template) in [(4, 4, 4), (7, 9, 4), (6, 5, 1), (5, 8, 3)] {
                let (size, template_size) = (Size { h, w }, Size::square(template));
                let x = noise(size.area() * channels, 8);
                let z = noise(template_size.area() * channels, 9);
                let expected = crate::reference::xcorr(size, template_size, channels, &x, &z);
                let search = Features { values: &x, size };
                let template = Features {
                    values: &z,
                    size: template_size,
                };
                for isa in Isa::available() {
                    for count in [1, 2] {
                        let threads = Threads::new(count);
                        let mut out = vec![f32::NAN; expected.len()];
                        threads
                            .enter(|| xcorr(isa, &threads, search, template, channels, &mut out));
                        assert_close(
                            &out,
                            &expected,
                            1e-5,
                            &format!("{channels} channels, {size:?}, {isa}"),
                        );
                    }
                }
            }
        }
    }
}
