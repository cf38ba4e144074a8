//! The training network of DR-MIM (docs/method.md, sections 1 and 3.7): backbone, encoders, neck,
//! head and statistics networks, with parameters under PyTorch's names.

use autodiff::{
    BoxDecoder, Conv2d, Focal, ParameterId, Parameters, RunningStatistics, Tape, Tensor, Var,
};

/// Sizes of the network.
#[derive(Clone, Copy, Debug)]
pub struct Config {
    /// Output channels of the backbone's convolutions.
    pub backbone: [usize; 5],
    /// Channels of neck and head.
    pub neck: usize,
    /// Hidden units of the statistics networks.
    pub hidden: usize,
    /// Side of the template's feature map, if the global statistics network sees all of it instead
    /// of its average.
    pub flatten: Option<usize>,
}

/// Convolution, normalization, ReLU.
struct Block {
    weight: ParameterId,
    bias: ParameterId,
    norm: Option<(ParameterId, ParameterId, RunningStatistics)>,
    options: Conv2d,
}

/// What a block is made of besides its channels.
#[derive(Clone, Copy)]
struct Kind {
    kernel: usize,
    stride: usize,
    pad: usize,
    norm: bool,
    relu: bool,
}

/// A 3x3 block with normalization and ReLU.
const PLAIN: Kind = Kind {
    kernel: 3,
    stride: 1,
    pad: 0,
    norm: true,
    relu: true,
};

impl Block {
    fn new(
        parameters: &mut Parameters,
        name: &str,
        inputs: usize,
        outputs: usize,
        kind: Kind,
    ) -> Block {
        let Kind {
            kernel,
            stride,
            pad,
            norm,
            relu,
        } = kind;
        let named = |what: &str| format!("{name}.{what}");
        let vector = |value| Tensor::full(&[outputs], value);
        let weight = Tensor::zeros(&[outputs, kernel, kernel, inputs]);
        let weight = parameters.add(named("conv.weight"), weight);
        let bias = parameters.add(named("conv.bias"), vector(0.0));
        let norm = norm.then(|| {
            let gamma = parameters.add(named("bn.weight"), vector(1.0));
            let beta = parameters.add(named("bn.bias"), vector(0.0));
            let mean = parameters.add_statistic(named("bn.running_mean"), vector(0.0));
            let variance = parameters.add_statistic(named("bn.running_var"), vector(1.0));
            (gamma, beta, RunningStatistics { mean, variance })
        });
        Block {
            weight,
            bias,
            norm,
            options: Conv2d { stride, pad, relu },
        }
    }

    fn forward(&self, tape: &mut Tape, x: Var) -> Var {
        let (weight, bias) = (tape.parameter(self.weight), tape.parameter(self.bias));
        let Conv2d { relu, .. } = self.options;
        match self.norm {
            None => tape.conv2d(x, weight, Some(bias), self.options),
            Some((gamma, beta, running)) => {
                let x = tape.conv2d(
                    x,
                    weight,
                    Some(bias),
                    Conv2d {
                        relu: false,
                        ..self.options
                    },
                );
                let (gamma, beta) = (tape.parameter(gamma), tape.parameter(beta));
                tape.batch_norm(x, gamma, beta, running, relu)
            }
        }
    }
}

/// Three linear layers with ReLU between them, each weight and bias.
struct Statistics {
    layers: Vec<(ParameterId, ParameterId)>,
}

impl Statistics {
    fn new(parameters: &mut Parameters, name: &str, inputs: usize, hidden: usize) -> Statistics {
        let shapes = [(0, inputs, hidden), (2, hidden, hidden), (4, hidden, 1)];
        let layers = shapes.map(|(i, inputs, outputs)| {
            let weight = parameters.add(
                format!("{name}.{i}.weight"),
                Tensor::zeros(&[outputs, inputs]),
            );
            (
                weight,
                parameters.add(format!("{name}.{i}.bias"), Tensor::zeros(&[outputs])),
            )
        });
        Statistics {
            layers: layers.into(),
        }
    }

    /// `x` (`[.., inputs]`) to scores (`[.., 1]`).
    fn forward(&self, tape: &mut Tape, mut x: Var) -> Var {
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

/// The whole training network.
pub struct DrMim {
    backbone: [Block; 5],
    identity: Block,  // E2
    unrelated: Block, // E1
    neck: [Block; 4], // r_z_k, c_z_k, r_x, c_x
    cls: [Block; 3],
    bbox: [Block; 3],
    cls_score: Block,
    ctr_score: Block,
    offsets: Block,
    si: ParameterId,
    bi: ParameterId,
    global: Statistics,
    local: Statistics,
    flatten: bool,
}

/// What one training step sees: crops (`[batch, side, side, 3]`) and targets per cell, row-major.
#[derive(Clone)]
pub struct Batch {
    pub template: Tensor,
    pub search: Tensor,
    /// Template crops from the search images.
    pub second_template: Tensor,
    /// Whether template and search show the same object.
    pub positive: Vec<bool>,
    pub labels: Tensor,  // [batch, cells, 1]
    pub quality: Tensor, // [batch, cells, 1]
    pub boxes: Tensor,   // [batch, cells, 4]
    pub decoder: BoxDecoder,
}

/// The head's outputs, before sigmoid and exp.
#[derive(Clone, Copy)]
pub struct Prediction {
    pub cls: Var,
    pub ctr: Var,
    pub offsets: Var,
    pub si: Var,
    pub bi: Var,
}

/// The losses, weighted as they are summed.
#[derive(Clone, Copy)]
pub struct Losses {
    pub cls: Var,
    pub ctr: Var,
    pub reg: Var,
    pub mi_global: Var,
    pub mi_local: Var,
    pub idsim: Var,
    pub total: Var,
}

impl DrMim {
    /// Adds the network's parameters: weights 0, scales 1.
    pub fn new(p: &mut Parameters, config: Config) -> DrMim {
        let [w1, w2, w3, w4, c] = config.backbone;
        let n = config.neck;
        let linear = Kind {
            relu: false,
            ..PLAIN
        };
        let padded = Kind { pad: 1, ..PLAIN };
        let bare = Kind {
            norm: false,
            ..PLAIN
        };
        let score = Kind {
            kernel: 1,
            ..linear
        };
        let backbone = [
            Block::new(
                p,
                "basemodel.conv1",
                3,
                w1,
                Kind {
                    kernel: 11,
                    stride: 2,
                    ..PLAIN
                },
            ),
            Block::new(p, "basemodel.conv2", w1, w2, Kind { kernel: 5, ..PLAIN }),
            Block::new(p, "basemodel.conv3", w2, w3, PLAIN),
            Block::new(p, "basemodel.conv4", w3, w4, PLAIN),
            Block::new(p, "basemodel.conv5", w4, c, linear),
        ];
        let mut tower = |branch: &str| {
            [(1, bare), (2, bare), (3, PLAIN)]
                .map(|(i, kind)| Block::new(p, &format!("head.{branch}_p5_conv{i}"), n, n, kind))
        };
        let (cls, bbox) = (tower("cls"), tower("bbox"));
        let global = if let Some(side) = config.flatten {
            3 * c * side * side
        } else {
            3 * c
        };
        DrMim {
            backbone,
            identity: Block::new(p, "dr.e2", c, c, padded),
            unrelated: Block::new(p, "dr.e1", c, c, padded),
            neck: ["r_z_k", "c_z_k", "r_x", "c_x"].map(|name| Block::new(p, name, c, n, linear)),
            cls,
            bbox,
            cls_score: Block::new(p, "head.cls_score_p5", n, 1, score),
            ctr_score: Block::new(p, "head.ctr_score_p5", n, 1, score),
            offsets: Block::new(p, "head.bbox_offsets_p5", n, 4, score),
            si: p.add("head.si", Tensor::scalar(1.0)),
            bi: p.add("head.bi", Tensor::scalar(0.0)),
            global: Statistics::new(p, "mi.global", global, config.hidden),
            local: Statistics::new(p, "mi.local", 3 * c, config.hidden),
            flatten: config.flatten.is_some(),
        }
    }

    /// Backbone features of crops.
    fn features(&self, tape: &mut Tape, mut x: Var) -> Var {
        for (i, block) in self.backbone.iter().enumerate() {
            x = block.forward(tape, x);
            if i < 2 {
                x = tape.max_pool(x);
            }
        }
        x
    }

    /// The head's outputs for identity-related features of template and search region.
    fn head(&self, tape: &mut Tape, template: Var, search: Var) -> Prediction {
        let [r_z, c_z, r_x, c_x] = [(0, template), (1, template), (2, search), (3, search)]
            .map(|(i, features)| self.neck[i].forward(tape, features));
        let (mut cls, mut bbox) = (tape.xcorr(c_x, c_z), tape.xcorr(r_x, r_z));
        for (cls_block, bbox_block) in self.cls.iter().zip(&self.bbox) {
            (cls, bbox) = (cls_block.forward(tape, cls), bbox_block.forward(tape, bbox));
        }
        Prediction {
            cls: self.cls_score.forward(tape, cls),
            ctr: self.ctr_score.forward(tape, cls),
            offsets: self.offsets.forward(tape, bbox),
            si: tape.parameter(self.si),
            bi: tape.parameter(self.bi),
        }
    }

    /// Global and local estimates of the information between features `f` and their encodings
    /// (docs/method.md, section 3.7).
    fn information(&self, tape: &mut Tape, f: Var, encodings: Var) -> (Var, Var) {
        let rolled = tape.roll(f, 1);
        let average = tape.global_average(encodings);
        let [_, h, w, _] = tape.shape(f)[..] else {
            unreachable!("features are maps")
        };
        let tiled = tape.tile(average, kernels::Size { h, w });
        let code = if self.flatten {
            tape.flatten(encodings)
        } else {
            average
        };
        let [global, local] =
            [(&self.global, true), (&self.local, false)].map(|(network, global)| {
                let scores = [f, rolled].map(|f| {
                    let input = match (global, self.flatten) {
                        (true, true) => tape.flatten(f),
                        (true, false) => tape.global_average(f),
                        (false, _) => f,
                    };
                    let input = tape.concat(&[input, if global { code } else { tiled }]);
                    network.forward(tape, input)
                });
                tape.information(scores[0], scores[1])
            });
        (global, local)
    }

    /// All losses of a batch. Uses up the crops.
    pub fn losses(&self, tape: &mut Tape, batch: &mut Batch) -> (Prediction, Losses) {
        let features = |tape: &mut Tape, crops: &mut Tensor| {
            let crops = tape.constant(std::mem::replace(crops, Tensor::scalar(0.0)));
            let features = self.features(tape, crops);
            (features, self.identity.forward(tape, features))
        };
        let (f, template) = features(tape, &mut batch.template);
        let unrelated = self.unrelated.forward(tape, f);
        let (_, search) = features(tape, &mut batch.search);
        let (_, second) = features(tape, &mut batch.second_template);
        let prediction = self.head(tape, template, search);
        let encodings = tape.concat(&[template, unrelated]);
        let (global, local) = self.information(tape, f, encodings);

        let Prediction {
            cls,
            ctr,
            offsets,
            si,
            bi,
        } = prediction;
        let reg = tape.iou_loss(offsets, si, bi, &batch.labels, &batch.boxes, batch.decoder);
        let same = tape.mean_square(template, second, &batch.positive);
        let mut losses = Losses {
            cls: tape.focal_loss(cls, &batch.labels, Focal::default()),
            ctr: tape.quality_loss(ctr, &batch.quality),
            reg: tape.scale(reg, 3.0),
            mi_global: tape.scale(global, -0.05),
            mi_local: tape.scale(local, -0.05),
            idsim: tape.scale(same, 0.05),
            total: reg,
        };
        let Losses {
            cls,
            ctr,
            reg,
            mi_global,
            mi_local,
            idsim,
            ..
        } = losses;
        let rest = [ctr, reg, mi_global, mi_local, idsim];
        losses.total = rest.into_iter().fold(cls, |sum, loss| tape.add(sum, loss));
        (prediction, losses)
    }
}
