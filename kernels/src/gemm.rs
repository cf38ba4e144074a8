//! Matrix product `C = A B` and singular values through faer, row-major. The only file that names
//! faer.
//!
//! Shapes: `A` is `[m, k]`, `B` is `[k, n]`, `C` is `[m, n]`. Cost: `m n k` multiply-accumulates.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use std::ops::Range;

/// A factor of a product: a row-major matrix in a slice, its transpose, or some of its columns.
#[derive(Clone, Copy, Debug)]
pub struct Matrix<'a>(MatRef<'a, f32>);

impl<'a> Matrix<'a> {
    /// `data` as `[rows, columns]`.
    ///
    /// Panics if its length is not that of the shape.
    pub fn new(data: &'a [f32], rows: usize, columns: usize) -> Matrix<'a> {
        assert_eq!(data.len(), rows * columns, "matrix of {rows}x{columns}");
        Matrix(MatRef::from_row_major_slice(data, rows, columns))
    }

    /// Its transpose, without a copy.
    pub fn transposed(self) -> Matrix<'a> {
        Matrix(self.0.transpose())
    }

    /// Some of its columns, without a copy. Panics if there are fewer.
    pub fn columns(self, range: Range<usize>) -> Matrix<'a> {
        Matrix(self.0.subcols(range.start, range.len()))
    }

    /// Its singular values, largest first, as many as its smaller extent. `None` if a value is not
    /// finite or the iteration does not converge.
    #[inline] // compiled where it is called: the trainer, not every program with a convolution
    pub fn singular_values(self) -> Option<Vec<f32>> {
        if !self.0.is_all_finite() {
            return None;
        }
        let values = self.0.singular_values().ok();
        crate::simd::clear_upper_halves();
        values
    }

    /// Its numerical rank: the number of singular values above
    /// `largest * max(rows, columns) * 2^-23`. `None` if [`singular_values`](Self::singular_values)
    /// has none.
    ///
    /// Source: the default tolerance of NumPy's `matrix_rank`; `docs/method.md`, section 3.6.
    #[inline]
    pub fn rank(self) -> Option<usize> {
        let values = self.singular_values()?;
        let extent = self.0.nrows().max(self.0.ncols()) as f32;
        let least = values
            .first()
            .map_or(0.0, |largest| largest * extent * f32::EPSILON);
        Some(values.iter().filter(|value| **value > least).count())
    }
}

/// `c = a b`, all row-major and dense.
///
/// Panics if a length is not that of its shape.
pub fn gemm(m: usize, n: usize, k: usize, a: &[f32], b: &[f32], c: &mut [f32]) {
    product(Matrix::new(a, m, k), Matrix::new(b, k, n), c);
}

/// `c = a b` with `c` row-major and dense.
///
/// Panics if the shapes do not fit each other or the length of `c`.
pub fn product(a: Matrix, b: Matrix, c: &mut [f32]) {
    let (m, n) = (a.0.nrows(), b.0.ncols());
    assert_eq!(
        a.0.ncols(),
        b.0.nrows(),
        "inner extents of a product to {m}x{n}"
    );
    assert_eq!(c.len(), m * n, "product to {m}x{n}");
    let c = MatMut::from_row_major_slice_mut(c, m, n);
    matmul(c, Accum::Replace, a.0, b.0, 1.0, Par::Seq);
    crate::simd::clear_upper_halves();
}

#[cfg(test)]
mod tests {
    use super::*;
    use testing::{assert_close, noise};

    fn transpose(data: &[f32], rows: usize, columns: usize) -> Vec<f32> {
        (0..data.len())
            .map(|i| data[i % rows * columns + i / rows])
            .collect()
    }

    #[test]
    fn product_of_any_shapes_equals_the_reference() {
        for (m, n, k) in [
            (1, 1, 1),
            (3, 47, 5),
            (17, 16, 33),
            (64, 1, 100),
            (5, 130, 363),
        ] {
            let (a, b) = (noise(m * k, 1), noise(k * n, 2));
            let mut c = vec![f32::NAN; m * n];
            gemm(m, n, k, &a, &b, &mut c);
            let expected = crate::reference::gemm(m, n, k, &a, &b);
            assert_close(&c, &expected, 1e-5, &format!("{m}x{n}x{k}"));
            let (at, bt) = (transpose(&a, m, k), transpose(&b, k, n));
            c.fill(f32::NAN);
            product(
                Matrix::new(&at, k, m).transposed(),
                Matrix::new(&bt, n, k).transposed(),
                &mut c,
            );
            assert_close(&c, &expected, 1e-5, &format!("transposed {m}x{n}x{k}"));
        }
    }

    #[test]
    fn product_with_some_columns_equals_those_of_the_whole() {
        let (m, n, k) = (4, 9, 6);
        let (a, b) = (noise(m * k, 3), noise(k * n, 4));
        let whole = crate::reference::gemm(m, n, k, &a, &b);
        let expected: Vec<_> = (0..m)
            .flat_map(|i| whole[i * n + 2..i * n + 7].to_vec())
            .collect();
        let mut c = vec![f32::NAN; m * 5];
        product(
            Matrix::new(&a, m, k),
            Matrix::new(&b, k, n).columns(2..7),
            &mut c,
        );
        assert_close(&c, &expected, 1e-5, "columns 2..7");
    }

    #[test]
    fn singular_values_of_known_matrices_are_right() {
        let diagonal = [0.0, -3.0, 0.0, 0.5, 0.0, 0.0];
        assert_eq!(
            Matrix::new(&diagonal, 2, 3).singular_values().unwrap(),
            [3.0, 0.5]
        );
        // The sum of their squares is that of the values.
        let a = noise(17 * 12, 5);
        let values = Matrix::new(&a, 17, 12).singular_values().unwrap();
        assert!(values.len() == 12 && values.windows(2).all(|v| v[0] >= v[1]));
        let squares = |values: &[f32]| values.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>();
        assert!((squares(&values) / squares(&a) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn ranks_of_known_matrices_are_right_at_any_scale() {
        // A product of [m, r] and [r, n] has rank r.
        for (m, n, r) in [
            (28, 28, 28),
            (34, 34, 5),
            (73, 73, 40),
            (6, 6, 1),
            (9, 30, 7),
            (30, 9, 9),
        ] {
            let mut product = vec![0.0; m * n];
            gemm(m, n, r, &noise(m * r, 6), &noise(r * n, 7), &mut product);
            assert_eq!(Matrix::new(&product, m, n).rank(), Some(r), "{m}x{n}");
            let tiny: Vec<f32> = product.iter().map(|v| v * 1e-20).collect();
            assert_eq!(
                Matrix::new(&tiny, m, n).rank(),
                Some(r),
                "rank does not depend on the scale"
            );
        }
        assert_eq!(Matrix::new(&[0.0; 36], 6, 6).rank(), Some(0), "a dead map");
        assert_eq!(
            Matrix::new(&[2.0; 36], 6, 6).rank(),
            Some(1),
            "a constant one"
        );
        assert_eq!(Matrix::new(&[1.0, f32::NAN, 0.0, 1.0], 2, 2).rank(), None);
        assert_eq!(Matrix::new(&[f32::INFINITY; 4], 2, 2).rank(), None);
    }
}
