//! Gradient clipping by global norm.

use crate::vector::update1;
use crate::{Compute, Parameter, Parameters};

/// Scales the gradients of the selected parameters together so that their norm is at most
/// `max_norm`, and returns the norm that they had. Where that is not a finite number, they stay as
/// they are, and the caller may skip the step.
pub fn clip_gradients(
    compute: &Compute,
    parameters: &mut Parameters,
    max_norm: f32,
    select: impl Fn(&Parameter) -> bool,
) -> f32 {
    let selected = |p: &Parameter| p.is_trained() && select(p);
    let gradients = parameters
        .iter()
        .filter(|p| selected(p))
        .filter_map(|p| p.gradient.as_ref());
    let norm = gradients
        .map(|gradient| squares(gradient.data()))
        .sum::<f64>()
        .sqrt();
    if norm.is_finite() && norm > f64::from(max_norm) {
        let factor = (f64::from(max_norm) / norm) as f32;
        let gradients = parameters
            .iter_mut()
            .filter(|p| selected(p))
            .filter_map(|p| p.gradient.as_mut());
        gradients.for_each(|gradient| update1(compute, gradient.data_mut(), |g| *g *= factor));
    }
    norm as f32
}

/// The sum of squares, in eight independent sums.
fn squares(values: &[f32]) -> f64 {
    let mut sums = [0.0f64; 8];
    for values in values.chunks(8) {
        sums.iter_mut()
            .zip(values)
            .for_each(|(sum, v)| *sum += f64::from(*v) * f64::from(*v));
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Tensor;

    #[test]
    fn clipping_scales_each_group_to_its_norm() {
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        for (name, gradient) in [
            ("t.a", [3.0, 0.0]),
            ("t.b", [0.0, 4.0]),
            ("u", [30.0, 40.0]),
            ("v", [6.0, 8.0]),
        ] {
            let id = parameters.add(name, Tensor::zeros(&[2]));
            parameters[id].gradient = Some(Tensor::new(&[2], gradient.to_vec()));
            parameters[id].frozen = name == "v";
        }
        let of_t = |p: &Parameter| p.name().starts_with("t.");
        assert_eq!(clip_gradients(&compute, &mut parameters, 10.0, of_t), 5.0);
        assert_eq!(clip_gradients(&compute, &mut parameters, 1.0, of_t), 5.0);
        assert_eq!(
            clip_gradients(&compute, &mut parameters, 100.0, |p| !of_t(p)),
            50.0
        );
        let found: Vec<_> = parameters
            .iter()
            .flat_map(|p| p.gradient.as_ref().unwrap().data().to_vec())
            .collect();
        let expected = [0.6, 0.0, 0.0, 0.8, 30.0, 40.0, 6.0, 8.0];
        assert!(
            found
                .iter()
                .zip(expected)
                .all(|(f, e)| (f - e).abs() < 1e-6),
            "{found:?}"
        );
    }

    #[test]
    fn gradients_that_are_not_finite_stay() {
        let compute = Compute::new(1).unwrap();
        let mut parameters = Parameters::new();
        let id = parameters.add("a", Tensor::zeros(&[2]));
        parameters[id].gradient = Some(Tensor::new(&[2], vec![f32::NAN, 2.0]));
        assert!(clip_gradients(&compute, &mut parameters, 1.0, |_| true).is_nan());
        assert_eq!(parameters[id].gradient.as_ref().unwrap().data()[1], 2.0);
    }
}
