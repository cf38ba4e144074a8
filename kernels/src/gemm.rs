//! Matrix product `C = A B` through faer, row-major: the only file that names faer.
//!
//! `A` is `[m, k]`, `B` is `[k, n]`, `C` is `[m, n]`; `2 m n k` operations.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

/// `c = a b`, all row-major and dense.
///
/// Panics if a length is not that of its shape.
pub fn gemm(m: usize, n: usize, k: usize, a: &[f32], b: &[f32], c: &mut [f32]) {
    assert_eq!((a.len(), b.len(), c.len()), (m * k, k * n, m * n), "gemm of {m}x{n}x{k}");
    let a = MatRef::from_row_major_slice(a, m, k);
    let b = MatRef::from_row_major_slice(b, k, n);
    let c = MatMut::from_row_major_slice_mut(c, m, n);
    matmul(c, Accum::Replace, a, b, 1.0, Par::Seq);
    crate::simd::clear_upper_halves();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{assert_close, noise};

    #[test]
    fn equals_the_reference() {
        for (m, n, k) in [(1, 1, 1), (3, 47, 5), (17, 16, 33), (64, 1, 100), (5, 130, 363)] {
            let (a, b) = (noise(m * k, 1), noise(k * n, 2));
            let mut c = vec![f32::NAN; m * n];
            gemm(m, n, k, &a, &b, &mut c);
            assert_close(&c, &crate::reference::gemm(m, n, k, &a, &b), 1e-5, &format!("{m}x{n}x{k}"));
        }
    }
}
