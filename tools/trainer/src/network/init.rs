//! First values of the parameters.

use super::Network;
use crate::rng::Rng;
use autodiff::{Parameter, Parameters};
use serde::{Deserialize, Serialize};

/// Kind of initialization.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Init {
    /// He's normal weights and zero biases, for training from random weights.
    #[default]
    Kaiming,
    /// The reference implementation's for neck and head (docs/method.md, section 1.4); He's for the
    /// backbone, which it takes from ImageNet.
    Paper,
}

impl Network {
    /// Initializes every parameter of a network.
    pub fn initialize(&self, parameters: &mut Parameters, init: Init, seed: u64) {
        for (i, parameter) in parameters.iter_mut().enumerate() {
            let mut rng = Rng::new(seed, 0x1417, i as u64);
            first_value(parameter, init, &mut rng);
        }
    }
}

fn first_value(parameter: &mut Parameter, init: Init, rng: &mut Rng) {
    let name = parameter.name().to_owned();
    let shape = parameter.value.shape().to_vec();
    let fan_in = shape.iter().skip(1).product::<usize>() as f32;
    let paper = init == Init::Paper && !name.starts_with("backbone.");
    let output = ["head.score.", "head.centerness.", "head.offsets."]
        .iter()
        .position(|o| name.starts_with(o));
    let values = parameter.value.data_mut();
    let mut normal = |deviation: f32| {
        values
            .iter_mut()
            .for_each(|v| *v = rng.normal() * deviation)
    };
    if name.starts_with("mi.") {
        // Biases have no fan-in of their own; that of their weights is unknown here, and 0 will do.
        let reach = if shape.len() == 2 {
            fan_in.powf(-0.5)
        } else {
            0.0
        };
        values
            .iter_mut()
            .for_each(|v| *v = rng.range(-reach, reach));
    } else if name.ends_with(".weight") {
        match (paper, output) {
            (true, _) if name.starts_with("head.") => normal(1e-4),
            (true, _) => normal(0.01),
            (false, Some(_)) => normal(0.05),
            (false, None) => normal((2.0 / fan_in).sqrt()),
        }
    } else if let (false, Some(output)) = (paper, output) {
        // Normalized outputs, so these are the outputs' spread and mean: few cells are the target,
        // boxes of some 30 pixels.
        if name.ends_with(".bn.scale") {
            values.fill([0.5, 0.35, 0.5][output]);
        } else if name.ends_with(".bn.shift") {
            values.fill([-2.0, -0.5, 1.2][output]);
        }
    }
}
