//! The passes over one part's values, forward and backward.

use kernels::simd::{Kernel, Simd};

/// `y = a (x - mean) + b`, per channel, and ReLU: what both directions need.
#[derive(Clone, Debug)]
pub(super) struct Affine {
    pub mean: Vec<f32>,
    pub a: Vec<f32>,
    pub b: Vec<f32>,
    pub relu: bool,
}

/// `out = a (x - mean) + b`, and ReLU.
pub(super) struct Normalize<'a> {
    pub affine: &'a Affine,
    pub x: &'a [f32],
    pub out: &'a mut [f32],
}

impl Kernel for Normalize<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Affine { mean, a, b, relu } = self.affine;
        let floor = if *relu { 0.0 } else { f32::NEG_INFINITY };
        let channels = mean.len();
        for (out, x) in self
            .out
            .chunks_exact_mut(channels)
            .zip(self.x.chunks_exact(channels))
        {
            for ((((out, x), mean), a), b) in out.iter_mut().zip(x).zip(mean).zip(a).zip(b) {
                *out = (a * (x - mean) + b).max(floor);
            }
        }
    }
}

/// Rows that are summed in `f32` before their sum is added in `f64`.
const BLOCK: usize = 64;

/// Zeroes the gradient where ReLU was, and adds its sums `[g, g (x - mean)]` to `sums`.
pub(super) struct Sums<'a> {
    pub affine: &'a Affine,
    pub x: &'a [f32],
    pub gradient: &'a mut [f32],
    pub sums: &'a mut [f64], // [2, channels]
}

impl Kernel for Sums<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Affine { mean, a, b, relu } = self.affine;
        let channels = mean.len();
        let floor = if *relu { 0.0 } else { f32::NEG_INFINITY };
        let (all, all_products) = self.sums.split_at_mut(channels);
        let (mut sum, mut products) = (vec![0.0f32; channels], vec![0.0f32; channels]);
        let len = BLOCK * channels;
        for (gradient, x) in self.gradient.chunks_mut(len).zip(self.x.chunks(len)) {
            sum.fill(0.0);
            products.fill(0.0);
            for (gradient, x) in gradient
                .chunks_exact_mut(channels)
                .zip(x.chunks_exact(channels))
            {
                let sums = sum.iter_mut().zip(&mut products);
                let affine = mean.iter().zip(a).zip(b);
                for (((g, x), (sum, product)), ((mean, a), b)) in
                    gradient.iter_mut().zip(x).zip(sums).zip(affine)
                {
                    let distance = x - mean;
                    *g = if a * distance + b > floor { *g } else { 0.0 };
                    *sum += *g;
                    *product += *g * distance;
                }
            }
            all.iter_mut()
                .zip(&sum)
                .for_each(|(all, sum)| *all += f64::from(*sum));
            all_products
                .iter_mut()
                .zip(&products)
                .for_each(|(all, sum)| *all += f64::from(*sum));
        }
    }
}

/// `g = a (g - shift - slope (x - mean))`.
pub(super) struct Differentiate<'a> {
    pub affine: &'a Affine,
    pub shift: &'a [f32], // [channels]
    pub slope: &'a [f32], // [channels]
    pub x: &'a [f32],
    pub gradient: &'a mut [f32],
}

impl Kernel for Differentiate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Affine { mean, a, .. } = self.affine;
        let channels = mean.len();
        for (gradient, x) in self
            .gradient
            .chunks_exact_mut(channels)
            .zip(self.x.chunks_exact(channels))
        {
            let constants = mean.iter().zip(a).zip(self.shift).zip(self.slope);
            for ((g, x), (((mean, a), shift), slope)) in gradient.iter_mut().zip(x).zip(constants) {
                *g = a * (*g - shift - slope * (x - mean));
            }
        }
    }
}
