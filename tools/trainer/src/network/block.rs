//! Building blocks of the network: convolution block and statistics network.

use autodiff::{Conv2d, ParameterId, Parameters, RunningStatistics, Tape, Tensor, Var};
use weights_format::Layer;

/// Convolution, then batch normalization and ReLU if the layer has them.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    weight: ParameterId, // [Cout, k, k, Cin]
    bias: ParameterId,
    norm: Option<Norm>,
    options: Conv2d,
}

#[derive(Clone, Copy, Debug)]
struct Norm {
    scale: ParameterId,
    shift: ParameterId,
    running: RunningStatistics,
}

impl Block {
    /// Adds a layer's parameters: weights and shifts 0, scales and variances 1.
    pub fn new(parameters: &mut Parameters, layer: &Layer) -> Block {
        let (name, outputs) = (&layer.name, [layer.out_channels]);
        let weight = parameters.add(
            format!("{name}.weight"),
            Tensor::zeros(&layer.weight_shape()),
        );
        let bias = parameters.add(format!("{name}.bias"), Tensor::zeros(&outputs));
        let norm = layer.bn.then(|| Norm {
            scale: parameters.add(format!("{name}.bn.scale"), Tensor::full(&outputs, 1.0)),
            shift: parameters.add(format!("{name}.bn.shift"), Tensor::zeros(&outputs)),
            running: RunningStatistics {
                mean: parameters.add_statistic(format!("{name}.bn.mean"), Tensor::zeros(&outputs)),
                variance: parameters
                    .add_statistic(format!("{name}.bn.variance"), Tensor::full(&outputs, 1.0)),
            },
        });
        let options = Conv2d {
            stride: layer.stride,
            pad: layer.pad,
            relu: layer.relu,
        };
        Block {
            weight,
            bias,
            norm,
            options,
        }
    }

    /// Maps `[batch, H, W, Cin]` to maps `[batch, H', W', Cout]`: the outputs of the convolution
    /// alone and of the whole block. Without normalization and ReLU, both are the same.
    pub fn forward(&self, tape: &mut Tape, x: Var) -> (Var, Var) {
        let (weight, bias) = (tape.parameter(self.weight), tape.parameter(self.bias));
        let Some(Norm {
            scale,
            shift,
            running,
        }) = self.norm
        else {
            let output = tape.conv2d(x, weight, Some(bias), self.options);
            return (output, output);
        };
        let convolved = tape.conv2d(
            x,
            weight,
            Some(bias),
            Conv2d {
                relu: false,
                ..self.options
            },
        );
        let (scale, shift) = (tape.parameter(scale), tape.parameter(shift));
        (
            convolved,
            tape.batch_norm(convolved, scale, shift, running, self.options.relu),
        )
    }
}

/// A statistics network of the mutual-information estimate: three linear layers with ReLU between
/// them.
#[derive(Clone, Copy, Debug)]
pub struct Statistics {
    layers: [(ParameterId, ParameterId); 3],
}

impl Statistics {
    /// Adds the parameters `<name>.<0..3>.weight` and `.bias`, all 0.
    pub fn new(
        parameters: &mut Parameters,
        name: &str,
        inputs: usize,
        hidden: usize,
    ) -> Statistics {
        let mut i = 0;
        let layers = [(inputs, hidden), (hidden, hidden), (hidden, 1)].map(|(inputs, outputs)| {
            let weight = parameters.add(
                format!("{name}.{i}.weight"),
                Tensor::zeros(&[outputs, inputs]),
            );
            let bias = parameters.add(format!("{name}.{i}.bias"), Tensor::zeros(&[outputs]));
            i += 1;
            (weight, bias)
        });
        Statistics { layers }
    }

    /// `[.., inputs]` to scores `[.., 1]`.
    pub fn forward(&self, tape: &mut Tape, mut x: Var) -> Var {
        for (i, (weight, bias)) in self.layers.iter().enumerate() {
            if i > 0 {
                x = tape.relu(x);
            }
            let (weight, bias) = (tape.parameter(*weight), tape.parameter(*bias));
            x = tape.linear(x, weight, bias);
        }
        x
    }
}
