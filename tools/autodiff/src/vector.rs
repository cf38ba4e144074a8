//! Loops over slices, compiled once per instruction set and run in parallel.
//!
//! The loops are plain; entering the instruction set around them lets the compiler use its whole
//! vectors.

use crate::Compute;
use kernels::simd::{Kernel, Simd};

/// Values that one thread takes at a time.
const PART: usize = 1 << 14;

/// `update(out)` for every value.
pub(crate) fn update1(compute: &Compute, out: &mut [f32], update: impl Fn(&mut f32) + Copy + Sync) {
    struct Loop<'a, F>(&'a mut [f32], F);
    impl<F: Fn(&mut f32)> Kernel for Loop<'_, F> {
        type Output = ();
        #[inline(always)]
        fn run<S: Simd>(self, _: S) {
            let Loop(out, update) = self;
            out.iter_mut().for_each(update);
        }
    }
    compute.each(out, PART, |_, out| compute.isa().run(Loop(out, update)));
}

/// `update(out, a)` for every pair of values.
pub(crate) fn update2(
    compute: &Compute,
    out: &mut [f32],
    a: &[f32],
    update: impl Fn(&mut f32, f32) + Copy + Sync,
) {
    struct Loop<'a, F>(&'a mut [f32], &'a [f32], F);
    impl<F: Fn(&mut f32, f32)> Kernel for Loop<'_, F> {
        type Output = ();
        #[inline(always)]
        fn run<S: Simd>(self, _: S) {
            let Loop(out, a, update) = self;
            out.iter_mut().zip(a).for_each(|(out, a)| update(out, *a));
        }
    }
    assert_eq!(out.len(), a.len());
    compute.each(out, PART, |i, out| {
        compute
            .isa()
            .run(Loop(out, &a[i * PART..][..out.len()], update));
    });
}

/// `update(out, a, b)` for every triple of values.
pub(crate) fn update3(
    compute: &Compute,
    out: &mut [f32],
    a: &[f32],
    b: &[f32],
    update: impl Fn(&mut f32, f32, f32) + Copy + Sync,
) {
    struct Loop<'a, F>(&'a mut [f32], &'a [f32], &'a [f32], F);
    impl<F: Fn(&mut f32, f32, f32)> Kernel for Loop<'_, F> {
        type Output = ();
        #[inline(always)]
        fn run<S: Simd>(self, _: S) {
            let Loop(out, a, b, update) = self;
            out.iter_mut()
                .zip(a)
                .zip(b)
                .for_each(|((out, a), b)| update(out, *a, *b));
        }
    }
    assert_eq!((out.len(), out.len()), (a.len(), b.len()));
    compute.each(out, PART, |i, out| {
        let range = i * PART..i * PART + out.len();
        compute
            .isa()
            .run(Loop(out, &a[range.clone()], &b[range], update));
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use kernels::Isa;

    #[test]
    fn update_visits_every_value_once() {
        for isa in Isa::available() {
            let compute = Compute::with_isa(3, isa).unwrap();
            for len in [0, 1, PART, 2 * PART + 7] {
                let a: Vec<f32> = (0..len).map(|i| i as f32).collect();
                let b: Vec<f32> = a.iter().map(|v| v * 0.5).collect();
                let mut out = vec![1.0; len];
                update1(&compute, &mut out, |v| *v += 1.0);
                update2(&compute, &mut out, &a, |v, a| *v += a);
                update3(&compute, &mut out, &a, &b, |v, a, b| *v += a - b);
                let expected = |i: usize| 2.0 + 1.5 * i as f32;
                assert!(
                    out.iter().enumerate().all(|(i, v)| *v == expected(i)),
                    "{isa}, {len} values"
                );
            }
        }
    }
}
