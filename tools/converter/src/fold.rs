//! Folding what follows a convolution into its weights, in f64.
//!
//! Source: docs/method.md, sections 1.1 (batch normalization) and 1.3 (the head's scalars).

/// Added to the variance by every batch normalization of the network.
pub const EPSILON: f64 = 1e-5;

/// A convolution's parameters.
#[derive(Clone, Debug, PartialEq)]
pub struct Convolution {
    /// `[Cout, Cin, kh, kw]` (OIHW, as PyTorch has it).
    pub shape: [usize; 4],
    /// Row-major in that shape.
    pub weight: Vec<f64>,
    /// `[Cout]`.
    pub bias: Vec<f64>,
}

/// A batch normalization's parameters at inference, `[Cout]` each.
#[derive(Clone, Debug, PartialEq)]
pub struct BatchNorm {
    /// Gamma.
    pub scale: Vec<f64>,
    /// Beta.
    pub shift: Vec<f64>,
    /// Running mean.
    pub mean: Vec<f64>,
    /// Running variance, not negative.
    pub variance: Vec<f64>,
}

impl Convolution {
    /// Folds in a batch normalization: `w' = w g / sqrt(v + eps)`, `b' = (b - m) g / sqrt(v + eps)
    /// + beta`.
    pub fn fold_batch_norm(&mut self, bn: &BatchNorm) {
        let factors: Vec<f64> = bn
            .scale
            .iter()
            .zip(&bn.variance)
            .map(|(scale, variance)| scale / (variance + EPSILON).sqrt())
            .collect();
        self.scale_outputs(&factors);
        // The bias is scaled by now; so must the mean be.
        for (bias, ((mean, shift), factor)) in self
            .bias
            .iter_mut()
            .zip(bn.mean.iter().zip(&bn.shift).zip(&factors))
        {
            *bias += shift - mean * factor;
        }
    }

    /// Folds in `o' = scale * o + shift` for all outputs alike.
    pub fn fold_affine(&mut self, scale: f64, shift: f64) {
        self.scale_outputs(&vec![scale; self.shape[0]]);
        self.bias.iter_mut().for_each(|bias| *bias += shift);
    }

    /// Multiplies every output channel by its factor.
    fn scale_outputs(&mut self, factors: &[f64]) {
        let per_output = self.weight.len() / self.shape[0];
        for ((weights, bias), factor) in self
            .weight
            .chunks_mut(per_output)
            .zip(&mut self.bias)
            .zip(factors)
        {
            weights.iter_mut().for_each(|weight| *weight *= factor);
            *bias *= factor;
        }
    }

    /// The weights as f32 in `[Cout, kh, kw, Cin]` (OHWI).
    pub fn weight_ohwi(&self) -> Vec<f32> {
        let [_, channels, rows, columns] = self.shape;
        let area = rows * columns;
        self.weight
            .chunks_exact(channels * area)
            .flat_map(|output| {
                (0..area).flat_map(move |at| {
                    (0..channels).map(move |channel| output[channel * area + at] as f32)
                })
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values in -1..1 that look random.
    fn noise(n: usize, seed: u64) -> Vec<f64> {
        (0..n as u64)
            .map(|i| ((i + 1) as f64 * (seed as f64 + 12.9898)).sin())
            .collect()
    }

    /// One output pixel of a valid convolution: the patch has the kernel's size.
    fn evaluate(conv: &Convolution, patch: &[f64]) -> Vec<f64> {
        let outputs = conv.weight.chunks_exact(patch.len()).zip(&conv.bias);
        outputs
            .map(|(weights, bias)| {
                bias + weights.iter().zip(patch).map(|(w, x)| w * x).sum::<f64>()
            })
            .collect()
    }

    #[test]
    fn folded_convolution_equals_convolution_and_normalization() {
        let shape @ [outputs, channels, rows, columns] = [5, 3, 3, 2];
        let mut conv = Convolution {
            shape,
            weight: noise(90, 1),
            bias: noise(5, 2),
        };
        let variance = vec![1e-4, 0.0, 4.0, 1.0, 2500.0];
        let bn = BatchNorm {
            scale: noise(5, 3),
            shift: noise(5, 4),
            mean: noise(5, 5),
            variance,
        };
        let patch = noise(channels * rows * columns, 6);
        let (si, bi) = (0.75, -1.5);
        let normalized = evaluate(&conv, &patch)
            .into_iter()
            .enumerate()
            .map(|(i, y)| {
                (y - bn.mean[i]) / (bn.variance[i] + 1e-5).sqrt() * bn.scale[i] + bn.shift[i]
            });
        let expected: Vec<f64> = normalized.map(|y| si * y + bi).collect();
        conv.fold_batch_norm(&bn);
        conv.fold_affine(si, bi);
        for (found, expected) in evaluate(&conv, &patch).into_iter().zip(expected) {
            assert!(
                (found - expected).abs() <= 1e-12 * expected.abs().max(1.0),
                "{found} is not {expected}"
            );
        }
        // The same in the layout of a weights file: [Cout, kh, kw, Cin] on a patch [kh, kw, Cin].
        let ohwi = conv.weight_ohwi();
        for o in 0..outputs {
            for (r, c, i) in (0..rows)
                .flat_map(|r| (0..columns).flat_map(move |c| (0..channels).map(move |i| (r, c, i))))
            {
                let theirs = conv.weight[((o * channels + i) * rows + r) * columns + c];
                assert_eq!(
                    ohwi[((o * rows + r) * columns + c) * channels + i],
                    theirs as f32
                );
            }
        }
    }
}
