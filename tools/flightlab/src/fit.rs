//! Logistic regression by Newton's method (iteratively reweighted least squares) with a ridge.

use track_cpu::flight::EVIDENCE_COUNT;

/// Most Newton steps.
const STEPS: usize = 30;
/// Weight of the ridge, on standardized inputs.
const RIDGE: f64 = 1e-3;

/// One observation to fit to.
#[derive(Clone, Copy, Debug)]
pub struct Labeled<const N: usize> {
    /// What is known.
    pub inputs: [f64; N],
    /// What came true.
    pub on: bool,
    /// How much it counts.
    pub weight: f64,
}

/// Bias and weights that predict `on` from `inputs`; the weights of the inputs in `rising` are not
/// below 0.
///
/// Minimizes the mean logistic loss plus `RIDGE` times half the squared weights of the standardized
/// inputs. An input of `rising` that would weigh less than 0 is left out, the worst first.
pub fn logistic<const N: usize>(samples: &[Labeled<N>], rising: &[usize]) -> (f64, [f64; N]) {
    let mut used = [true; N];
    loop {
        let (bias, weights) = newton(samples, &used);
        let worst = rising
            .iter()
            .copied()
            .filter(|&i| i < N)
            .min_by(|&a, &b| weights[a].total_cmp(&weights[b]));
        match worst {
            Some(i) if weights[i] < 0.0 => used[i] = false,
            _ => return (bias, weights),
        }
    }
}

/// The fit with the inputs that are `used`; the others weigh 0.
fn newton<const N: usize>(samples: &[Labeled<N>], used: &[bool; N]) -> (f64, [f64; N]) {
    let total = samples.iter().map(|s| s.weight).sum::<f64>().max(1e-9);
    let mean: [f64; N] = std::array::from_fn(|i| {
        samples.iter().map(|s| s.weight * s.inputs[i]).sum::<f64>() / total
    });
    let deviation: [f64; N] = std::array::from_fn(|i| {
        let squares = samples
            .iter()
            .map(|s| s.weight * (s.inputs[i] - mean[i]).powi(2));
        (squares.sum::<f64>() / total).sqrt().max(1e-9)
    });
    let mut weights = vec![0.0; N + 1];
    for _ in 0..STEPS {
        let mut gradient = vec![0.0; N + 1];
        let mut hessian = vec![vec![0.0; N + 1]; N + 1];
        for sample in samples {
            let mut z = vec![1.0; N + 1];
            for i in 0..N {
                z[i + 1] = if used[i] {
                    (sample.inputs[i] - mean[i]) / deviation[i]
                } else {
                    0.0
                };
            }
            let odds: f64 = weights.iter().zip(&z).map(|(w, z)| w * z).sum();
            let p = 1.0 / (1.0 + (-odds).exp());
            let share = sample.weight / total;
            let curvature = share * (p * (1.0 - p)).max(1e-9);
            for i in 0..=N {
                gradient[i] += share * z[i] * (f64::from(u8::from(sample.on)) - p);
                for j in 0..=N {
                    hessian[i][j] += curvature * z[i] * z[j];
                }
            }
        }
        for i in 0..=N {
            let ridge = if i == 0 { 1e-9 } else { RIDGE };
            gradient[i] -= ridge * weights[i];
            hessian[i][i] += ridge;
        }
        let step = solve(hessian, gradient);
        let largest = step.iter().fold(0.0f64, |m, s| m.max(s.abs()));
        let brake = (2.0 / largest.max(1e-12)).min(1.0);
        for (weight, step) in weights.iter_mut().zip(&step) {
            *weight += brake * step;
        }
        if largest < 1e-9 {
            break;
        }
    }
    let raw: [f64; N] = std::array::from_fn(|i| weights[i + 1] / deviation[i]);
    let bias = weights[0] - raw.iter().zip(&mean).map(|(w, m)| w * m).sum::<f64>();
    (bias, raw)
}

/// Elimination with pivots; the matrix is positive definite.
fn solve(mut m: Vec<Vec<f64>>, mut r: Vec<f64>) -> Vec<f64> {
    let n = r.len();
    for i in 0..n {
        let pivot = (i..n)
            .max_by(|&a, &b| m[a][i].abs().total_cmp(&m[b][i].abs()))
            .unwrap_or(i);
        m.swap(i, pivot);
        r.swap(i, pivot);
        for j in i + 1..n {
            let factor = m[j][i] / m[i][i];
            let upper = m[i].clone();
            m[j].iter_mut()
                .zip(&upper)
                .skip(i)
                .for_each(|(lower, upper)| *lower -= factor * upper);
            r[j] -= factor * r[i];
        }
    }
    for i in (0..n).rev() {
        let known: f64 = (i + 1..n).map(|j| m[i][j] * r[j]).sum();
        r[i] = (r[i] - known) / m[i][i];
    }
    r
}

/// A look with its evidence.
pub type Look = Labeled<EVIDENCE_COUNT>;

#[cfg(test)]
mod tests {
    use super::*;

    fn labeled<const N: usize>(inputs: [f64; N], on: bool) -> Labeled<N> {
        Labeled {
            inputs,
            on,
            weight: 1.0,
        }
    }

    #[test]
    fn known_coefficients_are_recovered() {
        // Every x with the share of positives that the model says.
        let mut samples = Vec::new();
        for i in -20..=20 {
            for j in -3..=3 {
                let x = [f64::from(i) / 5.0, 100.0 + f64::from(j)];
                let p = 1.0 / (1.0 + (-(1.5 * x[0] - 0.8 * (x[1] - 100.0) + 0.3)).exp());
                samples.extend((0..100).map(|k| labeled(x, f64::from(k) + 0.5 < 100.0 * p)));
            }
        }

        let (bias, weights) = logistic(&samples, &[0]);

        assert!((weights[0] - 1.5).abs() < 0.1, "{weights:?}");
        assert!((weights[1] + 0.8).abs() < 0.06, "{weights:?}");
        assert!((bias + 100.0 * weights[1] - 0.3).abs() < 0.1, "{bias}");
    }

    #[test]
    fn weight_counts_as_repetition() {
        let some = |on: bool, weight| Labeled {
            inputs: [f64::from(u8::from(on))],
            on,
            weight,
        };
        let mixed = labeled([1.0], false);

        let weighed = logistic(&[some(true, 3.0), some(false, 1.0), mixed], &[]);
        let repeated = logistic(
            &[
                some(true, 1.0),
                some(true, 1.0),
                some(true, 1.0),
                some(false, 1.0),
                mixed,
            ],
            &[],
        );

        assert!((weighed.0 - repeated.0).abs() < 1e-6);
        assert!((weighed.1[0] - repeated.1[0]).abs() < 1e-6);
    }

    #[test]
    fn rising_input_never_speaks_against() {
        let samples: Vec<_> = (0..40)
            .map(|i| labeled([f64::from(i), f64::from(i * i)], i % 7 < 3))
            .collect();

        let free = logistic(&samples, &[]).1;
        let held = logistic(&samples, &[0, 1]).1;

        assert!(free.iter().any(|w| *w < 0.0), "{free:?}");
        assert!(held.iter().all(|w| *w >= 0.0), "{held:?}");
    }

    #[test]
    fn separable_samples_stay_finite() {
        let samples: Vec<_> = (0..40)
            .map(|i| labeled([f64::from(i), 1.0], i >= 20))
            .collect();

        let (bias, weights) = logistic(&samples, &[]);

        assert!(bias.is_finite() && weights.iter().all(|w| w.is_finite()) && weights[0] > 0.1);
    }
}
