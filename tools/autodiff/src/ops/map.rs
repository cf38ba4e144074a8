//! What several operations do with maps: zeros around and between their pixels, sums over their
//! positions.

use crate::{Compute, Tensor};
use kernels::Size;
use kernels::simd::{Kernel, Simd};

/// Where a map's pixels go in a larger one that is 0 elsewhere.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placement {
    /// The larger map.
    pub size: Size,
    /// Row and column of the first pixel.
    pub first: usize,
    /// From one pixel to the next.
    pub step: usize,
}

impl Placement {
    /// Zeros on all four sides of a map of `size`.
    pub fn pad(size: Size, pad: usize) -> Placement {
        Placement {
            size: Size {
                h: size.h + 2 * pad,
                w: size.w + 2 * pad,
            },
            first: pad,
            step: 1,
        }
    }

    /// Places one image `from` (`[size.h, size.w, channels]`) in `to`.
    pub fn place_image(&self, from: &[f32], size: Size, channels: usize, to: &mut [f32]) {
        to.fill(0.0);
        let row = self.size.w * channels;
        let rows = to.chunks_exact_mut(row).skip(self.first).step_by(self.step);
        for (from, to) in from.chunks_exact(size.w * channels).zip(rows) {
            let to = &mut to[self.first * channels..];
            if self.step == 1 {
                to[..from.len()].copy_from_slice(from);
            } else {
                let pixels = to.chunks_exact_mut(channels).step_by(self.step);
                pixels
                    .zip(from.chunks_exact(channels))
                    .for_each(|(to, from)| to.copy_from_slice(from));
            }
        }
    }

    /// Places every image of a batch.
    pub fn place(&self, compute: &Compute, from: &Tensor) -> Tensor {
        let maps = from.maps("place");
        let mut to = compute.tensor(&[maps.batch, self.size.h, self.size.w, maps.channels]);
        compute.each(to.data_mut(), self.size.area() * maps.channels, |i, to| {
            let from = &from.data()[i * maps.image()..][..maps.image()];
            self.place_image(from, maps.size, maps.channels, to);
        });
        to
    }
}

/// Rows that are summed in `f32` before their sum is added in `f64`.
const BLOCK: usize = 64;

/// Adds the sum of the rows of `x` (`[rows, columns]`) to `sums` (`[columns]`).
pub(crate) struct SumRows<'a> {
    pub x: &'a [f32],
    pub sums: &'a mut [f64],
}

impl Kernel for SumRows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let columns = self.sums.len();
        let mut sum = vec![0.0f32; columns];
        for block in self.x.chunks(BLOCK * columns) {
            sum.fill(0.0);
            for row in block.chunks_exact(columns) {
                sum.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
            }
            self.sums
                .iter_mut()
                .zip(&sum)
                .for_each(|(all, sum)| *all += f64::from(*sum));
        }
    }
}

/// The sum of `x` (`[.., columns]`) over all but its innermost extent: `[columns]`.
pub(crate) fn sum_positions(compute: &Compute, x: &Tensor) -> Tensor {
    let (rows, columns) = x.rows("sum_positions");
    let part = rows.div_ceil(x.shape()[0].max(1)) * columns;
    let mut sums = vec![0.0f64; x.data().len().div_ceil(part) * columns];
    compute.each(&mut sums, columns, |i, sums| {
        let x = &x.data()[i * part..((i + 1) * part).min(rows * columns)];
        compute.isa().run(SumRows { x, sums });
    });
    let total = |c: usize| sums[c..].iter().step_by(columns).sum::<f64>() as f32;
    Tensor::new(&[columns], (0..columns).map(total).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::noise;

    #[test]
    fn placement_pads_and_spreads_an_image() {
        let from: Vec<f32> = (1..=4).map(|v| v as f32).collect();
        let place = |placement: Placement| {
            let mut to = vec![f32::NAN; placement.size.area()];
            placement.place_image(&from, Size::square(2), 1, &mut to);
            to
        };
        let padded = place(Placement::pad(Size::square(2), 1));
        assert_eq!(
            padded,
            [
                0., 0., 0., 0., 0., 1., 2., 0., 0., 3., 4., 0., 0., 0., 0., 0.
            ]
        );
        let spread = place(Placement {
            size: Size { h: 3, w: 4 },
            first: 0,
            step: 2,
        });
        assert_eq!(spread, [1., 0., 2., 0., 0., 0., 0., 0., 3., 0., 4., 0.]);
    }

    #[test]
    fn sum_positions_adds_every_row_once() {
        let compute = Compute::new(2).unwrap();
        for shape in [&[3, 9, 8, 5][..], &[7, 3], &[1, 200, 2]] {
            let x = noise(shape, 1);
            let columns = *shape.last().unwrap();
            let sums = sum_positions(&compute, &x);
            for (c, sum) in sums.data().iter().enumerate() {
                let expected: f64 = x.data()[c..]
                    .iter()
                    .step_by(columns)
                    .map(|v| f64::from(*v))
                    .sum();
                assert!((f64::from(*sum) - expected).abs() < 1e-5, "{shape:?}");
            }
        }
    }
}
