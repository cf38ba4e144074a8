//! One filter over all channels, and its adjoint: the two products of a filter that is learned
//! while tracking.
//!
//! ```text
//! response:  y[i, j]    = sum over u, v, c of x[i + u, j + v, c] * f[u, v, c]      valid, no bias
//! adjoint:   g[u, v, c] += sum over i, j of r[i, j] * x[i + u, j + v, c]
//! ```
//!
//! Shapes: features `[H, W, C]`, filter `[h, w, C]`, response `[H-h+1, W-w+1]`. Cost, either way:
//! one multiply-accumulate per value of the filter and of the response; 1.1 million for a 4x4
//! filter of 128 channels on 26x26 features.
//!
//! A row of the filter is `w * C` contiguous values and is multiplied with as many contiguous
//! values of the features, so no patches are copied.

use crate::par::Threads;
use crate::simd::{Kernel, Simd};
use crate::{Isa, Size};

/// Sizes of a filter and of the features that it runs over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FilterShape {
    /// Height and width of the features.
    pub size: Size,
    /// Height and width of the filter.
    pub filter: Size,
    /// Channels of both.
    pub channels: usize,
}

impl FilterShape {
    /// Height and width of the response.
    ///
    /// Panics if the filter is larger than the features.
    pub fn out_size(&self) -> Size {
        let FilterShape { size, filter, .. } = self;
        assert!(
            filter.h <= size.h && filter.w <= size.w,
            "filter {filter:?} on {size:?}"
        );
        Size {
            h: size.h - filter.h + 1,
            w: size.w - filter.w + 1,
        }
    }

    /// Values of the filter.
    pub fn filter_len(&self) -> usize {
        self.filter.area() * self.channels
    }

    /// Values of one row of the filter.
    fn row_len(&self) -> usize {
        self.filter.w * self.channels
    }

    /// The features that row `u` of the filter is multiplied with for the response at (`y`, `x`).
    #[inline(always)]
    fn window<'a>(&self, features: &'a [f32], u: usize, y: usize, x: usize) -> &'a [f32] {
        &features[((y + u) * self.size.w + x) * self.channels..]
    }
}

/// Rows of features between the last one in use and the one that is prefetched.
const AHEAD: usize = 3;

/// Some rows of a response.
struct Respond<'a> {
    shape: FilterShape,
    features: &'a [f32], // [size.h, size.w, channels]
    filter: &'a [f32],   // [filter.h, filter.w, channels]
    first_row: usize,    // of the response, that `out` starts at
    out: &'a mut [f32],  // [rows, W']
}

/// Some rows of an adjoint.
struct Adjoint<'a> {
    shape: FilterShape,
    features: &'a [f32], // [size.h, size.w, channels]
    response: &'a [f32], // [H', W']
    first_row: usize,    // of the filter, that `out` starts at
    out: &'a mut [f32],  // [rows, filter.w, channels]
}

/// The response of `filter` (`[h, w, C]`) on `features` (`[H, W, C]`), into `out`
/// (`[H-h+1, W-w+1]`).
///
/// Panics if a length is not that of its shape, or if the filter is the larger one.
pub fn respond(
    isa: Isa,
    threads: &Threads,
    shape: FilterShape,
    features: &[f32],
    filter: &[f32],
    out: &mut [f32],
) {
    let out_size = shape.out_size();
    assert_eq!(
        features.len(),
        shape.size.area() * shape.channels,
        "features of a filter"
    );
    assert_eq!(filter.len(), shape.filter_len(), "values of a filter");
    assert_eq!(out.len(), out_size.area(), "response of a filter");
    threads.split_rows(out, out_size.w, |first_row, out| {
        isa.run(Respond {
            shape,
            features,
            filter,
            first_row,
            out,
        });
    });
}

/// Adds the adjoint of [`respond`] for `response` (`[H-h+1, W-w+1]`) on `features` (`[H, W, C]`) to
/// `out` (`[h, w, C]`).
///
/// Panics if a length is not that of its shape, or if the filter is the larger one.
pub fn adjoint(
    isa: Isa,
    threads: &Threads,
    shape: FilterShape,
    features: &[f32],
    response: &[f32],
    out: &mut [f32],
) {
    assert_eq!(
        features.len(),
        shape.size.area() * shape.channels,
        "features of a filter"
    );
    assert_eq!(
        response.len(),
        shape.out_size().area(),
        "response of a filter"
    );
    assert_eq!(out.len(), shape.filter_len(), "values of a filter");
    threads.split_rows(out, shape.row_len(), |first_row, out| {
        isa.run(Adjoint {
            shape,
            features,
            response,
            first_row,
            out,
        });
    });
}

impl Kernel for Respond<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        if self.shape.filter.w.is_multiple_of(4) {
            self.rows::<S, 4>(simd);
        } else {
            self.rows::<S, 1>(simd);
        }
    }
}

impl Respond<'_> {
    /// All rows, `TAPS` taps of a filter row and up to 8 neighboring values at a time.
    #[inline(always)]
    fn rows<S: Simd, const TAPS: usize>(&mut self, simd: S) {
        let width = self.shape.out_size().w;
        for y in 0..self.out.len() / width {
            let mut x = 0;
            while x < width {
                x += match width - x {
                    8.. if S::LANES == 16 => self.tile::<S, TAPS, 8>(simd, y, x, width),
                    7 if S::LANES == 16 => self.tile::<S, TAPS, 7>(simd, y, x, width),
                    4.. => self.tile::<S, TAPS, 4>(simd, y, x, width),
                    _ => self.tile::<S, TAPS, 1>(simd, y, x, width),
                };
            }
        }
    }

    /// `VALUES` neighboring values of row `y` of `out`, from `x` on. Returns `VALUES`.
    ///
    /// Neighboring values share cells: `VALUES + TAPS - 1` cells and `TAPS` taps are loaded for
    /// `VALUES * TAPS` multiply-adds.
    #[inline(always)]
    fn tile<S: Simd, const TAPS: usize, const VALUES: usize>(
        &mut self,
        simd: S,
        y: usize,
        x: usize,
        width: usize,
    ) -> usize {
        let FilterShape {
            filter, channels, ..
        } = self.shape;
        let load = |from: &[f32]| {
            if from.len() >= S::LANES {
                simd.load(from)
            } else {
                simd.load_partial(from)
            }
        };
        let cells_len = const { VALUES + TAPS - 1 };
        let mut sums = [simd.zero(); VALUES];
        for u in 0..filter.h {
            for v in (0..filter.w).step_by(TAPS) {
                let window = &self
                    .shape
                    .window(self.features, u, self.first_row + y, x + v)[..cells_len * channels];
                let taps = &self.filter[(u * filter.w + v) * channels..][..TAPS * channels];
                for c in (0..channels).step_by(S::LANES) {
                    let end = channels.min(c + S::LANES);
                    let mut cells = [simd.zero(); MAX_CELLS];
                    for i in 0..cells_len {
                        cells[i] = load(&window[i * channels + c..i * channels + end]);
                    }
                    if u + 1 == filter.h && v == 0 {
                        // Features come from memory or the L3 cache, and the last filter row reads
                        // them first.
                        for i in 0..VALUES {
                            simd.prefetch(
                                &window[i * channels + c..],
                                AHEAD * self.shape.size.w * channels,
                            );
                        }
                    }
                    for t in 0..TAPS {
                        let tap = load(&taps[t * channels + c..t * channels + end]);
                        for i in 0..VALUES {
                            sums[i] = simd.mul_add(cells[i + t], tap, sums[i]);
                        }
                    }
                }
            }
        }
        for (out, sum) in self.out[y * width + x..].iter_mut().zip(sums) {
            let mut lanes = [0.0; MAX_LANES];
            simd.store(sum, &mut lanes);
            *out = lanes[..S::LANES].iter().sum();
        }
        VALUES
    }
}

/// Cells that 8 neighboring values see of 4 taps.
const MAX_CELLS: usize = 11;

/// Lanes of the widest vector there is.
const MAX_LANES: usize = 16;

impl Kernel for Adjoint<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, simd: S) {
        let (height, rows) = (
            self.shape.out_size().h,
            self.out.len() / self.shape.row_len(),
        );
        for from in 0..self.shape.size.h {
            // All rows of the filter that meet this row of features, while it is in the L1 cache.
            let meets = |u: usize| {
                from.checked_sub(self.first_row + u)
                    .is_some_and(|y| y < height)
            };
            let mut u = (0..rows).find(|u| meets(*u)).unwrap_or(rows);
            let end = (u..rows).take_while(|u| meets(*u)).count() + u;
            while u < end {
                u += match end - u {
                    4.. => self.rows::<S, 4>(simd, u, from),
                    2.. => self.rows::<S, 2>(simd, u, from),
                    _ => self.rows::<S, 1>(simd, u, from),
                };
            }
        }
    }
}

impl Adjoint<'_> {
    /// Adds the products with row `from` of the features to `ROWS` neighboring rows of `out`, from
    /// `u` on. Returns `ROWS`.
    #[inline(always)]
    fn rows<S: Simd, const ROWS: usize>(&mut self, simd: S, u: usize, from: usize) -> usize {
        let row_len = self.shape.row_len();
        let mut t = 0;
        while t < row_len {
            t += match (row_len - t) / S::LANES {
                4.. if S::LANES == 16 => self.tile::<S, ROWS, 4>(simd, u, from, t),
                2.. => self.tile::<S, ROWS, 2>(simd, u, from, t),
                1.. => self.tile::<S, ROWS, 1>(simd, u, from, t),
                _ => (u..u + ROWS)
                    .map(|u| self.rest(simd, u, from - self.first_row - u, t))
                    .max()
                    .unwrap_or(0),
            };
        }
        ROWS
    }

    /// Does the same for `VECTORS` vectors of each row, from value `t` on. Returns the number of
    /// values of a row.
    ///
    /// A vector of features is loaded once for all rows, and a value of the response broadcast once
    /// for all vectors.
    #[inline(always)]
    #[expect(
        clippy::needless_range_loop,
        reason = "constant indices keep the sums in registers"
    )]
    fn tile<S: Simd, const ROWS: usize, const VECTORS: usize>(
        &mut self,
        simd: S,
        u: usize,
        from: usize,
        t: usize,
    ) -> usize {
        let FilterShape { size, channels, .. } = self.shape;
        let (row_len, width) = (self.shape.row_len(), self.shape.out_size().w);
        let features = &self.features[from * size.w * channels..][t..];
        let mut values = [&self.response[..0]; ROWS];
        for i in 0..ROWS {
            values[i] = &self.response[(from - self.first_row - u - i) * width..][..width];
        }
        let mut sums = [[simd.zero(); VECTORS]; ROWS];
        for x in 0..width {
            let window = &features[x * channels..][..VECTORS * S::LANES];
            let mut cells = [simd.zero(); VECTORS];
            for k in 0..VECTORS {
                cells[k] = simd.load(&window[k * S::LANES..]);
            }
            for i in 0..ROWS {
                let value = simd.splat(values[i][x]);
                for k in 0..VECTORS {
                    sums[i][k] = simd.mul_add(cells[k], value, sums[i][k]);
                }
            }
        }
        for i in 0..ROWS {
            let out = &mut self.out[(u + i) * row_len + t..][..VECTORS * S::LANES];
            for (k, out) in out.chunks_exact_mut(S::LANES).enumerate() {
                simd.store(simd.add(simd.load(out), sums[i][k]), out);
            }
        }
        VECTORS * S::LANES
    }

    /// Adds the products with row `y` of the response to the end of row `u` of `out`, from value
    /// `t` on: less than one vector. Returns the number of values.
    #[inline(always)]
    fn rest<S: Simd>(&mut self, simd: S, u: usize, y: usize, t: usize) -> usize {
        let (shape, width) = (self.shape, self.shape.out_size().w);
        let out = &mut self.out[u * shape.row_len()..][t..shape.row_len()];
        let features = &shape.window(self.features, self.first_row + u, y, 0)[t..];
        let mut sum = simd.load_partial(out);
        for (x, value) in self.response[y * width..][..width].iter().enumerate() {
            let window = &features[x * shape.channels..][..out.len()];
            sum = simd.mul_add(simd.load_partial(window), simd.splat(*value), sum);
        }
        simd.store_partial(sum, out);
        out.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference;
    use testing::{assert_close, noise};

    fn shapes() -> impl Iterator<Item = FilterShape> {
        let sizes = [(4, 4, 4), (7, 9, 4), (6, 5, 1), (5, 14, 3)];
        [1, 3, 4, 7, 8, 15, 16, 47, 128]
            .into_iter()
            .flat_map(move |channels| {
                sizes.map(|(h, w, side)| FilterShape {
                    size: Size { h, w },
                    filter: Size::square(side),
                    channels,
                })
            })
    }

    #[test]
    fn response_and_adjoint_of_any_shape_equal_the_reference() {
        for shape in shapes() {
            let FilterShape {
                size,
                filter,
                channels,
            } = shape;
            let x = noise(size.area() * channels, 5);
            let f = noise(shape.filter_len(), 6);
            let r = noise(shape.out_size().area(), 7);
            let start = noise(shape.filter_len(), 8);
            let response = reference::filter(size, filter, channels, &x, &f);
            let adjoint_of = reference::filter_adjoint(size, filter, channels, &x, &r);
            let added: Vec<f64> = adjoint_of
                .iter()
                .zip(&start)
                .map(|(new, start)| new + f64::from(*start))
                .collect();
            for isa in Isa::available() {
                for count in [1, 2] {
                    let threads = Threads::new(count);
                    let mut out = vec![f32::NAN; response.len()];
                    threads.enter(|| respond(isa, &threads, shape, &x, &f, &mut out));
                    assert_close(
                        &out,
                        &response,
                        1e-5,
                        &format!("response, {shape:?}, {isa}"),
                    );
                    let mut out = start.clone();
                    threads.enter(|| adjoint(isa, &threads, shape, &x, &r, &mut out));
                    assert_close(&out, &added, 1e-5, &format!("adjoint, {shape:?}, {isa}"));
                }
            }
        }
    }

    #[test]
    fn response_beside_a_nan_is_not_touched_by_it() {
        // The last partial vector of a row must not take in the next pixel, not even times zero.
        let shape = FilterShape {
            size: Size { h: 1, w: 3 },
            filter: Size { h: 1, w: 2 },
            channels: 3,
        };
        let mut x = noise(9, 1);
        x[6..].fill(f32::NAN);
        for isa in Isa::available() {
            let mut out = [0.0; 2];
            respond(isa, &Threads::new(1), shape, &x, &noise(6, 2), &mut out);
            assert!(out[0].is_finite() && out[1].is_nan(), "{isa}: {out:?}");
        }
    }
}
