//! Mean square of the differences of two batches, over the items to keep:
//!
//! ```text
//! loss = sum over kept items of (a - b)^2 / n     n = number of kept values, at least 1
//! gradient: 2 (a - b) / n for a, the negative for b, 0 for the other items
//! ```

use crate::{Tape, Tensor, Var};

impl Tape<'_> {
    /// The mean square of `a - b` (both `[batch, ..]`) over the items for which `keep` (one per
    /// item) is true.
    ///
    /// Panics if the shapes differ or `keep` is not of the batch's length.
    pub fn mean_square(&mut self, a: Var, b: Var, keep: &[bool]) -> Var {
        let (x, y) = (self.value(a), self.value(b));
        assert_eq!(x.shape(), y.shape(), "mean_square");
        assert_eq!(
            x.shape().first(),
            Some(&keep.len()),
            "mean_square: items to keep"
        );
        let item = x.data().len() / keep.len().max(1);
        let scale = self.one_over(item * keep.iter().filter(|keep| **keep).count());
        let mut slopes = [Tensor::zeros(x.shape()), Tensor::zeros(x.shape())];
        let mut loss = 0.0;
        for i in (0..x.data().len()).filter(|i| keep[i / item]) {
            let difference = f64::from(x.data()[i]) - f64::from(y.data()[i]);
            loss += scale * difference * difference;
            let slope = (2.0 * scale * difference) as f32;
            (slopes[0].data_mut()[i], slopes[1].data_mut()[i]) = (slope, -slope);
        }
        let [to_a, to_b] = slopes;
        self.record_loss(loss, vec![(a, to_a), (b, to_b)])
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::value_and_gradients;
    use crate::check::{check, noise};

    #[test]
    fn gradients_equal_finite_differences() {
        let inputs = [noise(&[3, 2, 2], 1), noise(&[3, 2, 2], 2)];
        check(&inputs, 0.1, 1e-4, |tape, v| {
            tape.mean_square(v[0], v[1], &[true, false, true])
        });
    }

    #[test]
    fn mean_square_of_no_items_is_zero() {
        let inputs = [noise(&[2, 3], 1), noise(&[2, 3], 2)];
        let (loss, gradients) = value_and_gradients(&inputs, |tape, v| {
            tape.mean_square(v[0], v[1], &[false, false])
        });
        assert_eq!((loss, gradients), (0.0, vec![vec![0.0; 6]; 2]));
    }
}
