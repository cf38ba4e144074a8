//! Checks gradients of an operation against finite differences.

use crate::{Compute, Mode, Parameters, Tape, Tensor, Var};

/// `shape` filled with values in `[-1, 1)` that look random.
pub(crate) fn noise(shape: &[usize], seed: u64) -> Tensor {
    Tensor::new(shape, testing::noise(shape.iter().product(), seed))
}

/// Asserts that the gradients of `operation` with respect to all `inputs` equal finite differences
/// of its output.
///
/// The loss is the sum of the outputs times fixed random factors, in `f64`. The difference is the
/// central one over four points, `(8 (f(h) - f(-h)) - (f(2h) - f(-2h))) / 12h` with `h = step`,
/// exact for polynomials of degree four. No value may be off by more than `tolerance` times the RMS
/// of its tensor's differences.
pub(crate) fn check(
    inputs: &[Tensor],
    step: f32,
    tolerance: f64,
    operation: impl Fn(&mut Tape, &[Var]) -> Var,
) {
    check_with(&mut Parameters::new(), inputs, step, tolerance, operation);
}

/// As [`check`], for an operation that uses parameters.
pub(crate) fn check_with(
    parameters: &mut Parameters,
    inputs: &[Tensor],
    step: f32,
    tolerance: f64,
    operation: impl Fn(&mut Tape, &[Var]) -> Var,
) {
    let compute = Compute::new(1).unwrap();
    let mut tape = Tape::new(&compute, parameters, Mode::Training);
    let vars: Vec<Var> = inputs
        .iter()
        .map(|input| tape.input(input.clone()))
        .collect();
    let output = operation(&mut tape, &vars);
    let factors = noise(tape.shape(output), 99);
    let gradients = tape.backward_from(output, factors.clone());

    let mut loss = |inputs: &[Tensor]| -> f64 {
        let mut tape = Tape::new(&compute, parameters, Mode::Training);
        let vars: Vec<Var> = inputs
            .iter()
            .map(|input| tape.constant(input.clone()))
            .collect();
        let output = operation(&mut tape, &vars);
        let products = tape.value(output).data().iter().zip(factors.data());
        products.map(|(y, r)| f64::from(*y) * f64::from(*r)).sum()
    };
    for (n, var) in vars.iter().enumerate() {
        let mut moved = inputs.to_vec();
        let differences: Vec<f64> = (0..inputs[n].data().len())
            .map(|i| {
                let x = inputs[n].data()[i];
                let mut at = |x: f32| {
                    moved[n].data_mut()[i] = x;
                    loss(&moved)
                };
                let near = at(x + step) - at(x - step);
                let far = at(x + 2.0 * step) - at(x - 2.0 * step);
                at(x);
                (8.0 * near - far) / (12.0 * f64::from(step))
            })
            .collect();
        let found = gradients
            .get(*var)
            .unwrap_or_else(|| panic!("no gradient for input {n}"));
        assert_eq!(
            found.shape(),
            inputs[n].shape(),
            "shape of the gradient of input {n}"
        );
        let rms =
            (differences.iter().map(|d| d * d).sum::<f64>() / differences.len() as f64).sqrt();
        for (i, (found, expected)) in found.data().iter().zip(&differences).enumerate() {
            let error = (f64::from(*found) - expected).abs();
            assert!(
                error <= tolerance * rms.max(1e-3),
                "gradient of input {n} [{i}] is {found}, differences say {expected}, \
                 off by {:.1e} of the RMS {rms}",
                error / rms
            );
        }
    }
}
