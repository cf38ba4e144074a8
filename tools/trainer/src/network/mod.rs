//! The DR-MIM network for training: any widths, any encoder of the weights format, with batch
//! normalization, the identity-unrelated encoder E1 and the statistics networks beside what is
//! deployed.
//!
//! Parameters bear the names of the weights format (`<layer>.weight`, `<layer>.bias`) and
//! `<layer>.bn.scale`, `.bn.shift`, `.bn.mean`, `.bn.variance`; beside them `head.si`, `head.bi`,
//! `dr.e1.*`, `mi.global.*` and `mi.local.*`.

mod block;
mod export;
mod import;
mod init;
mod losses;
mod pass;
#[cfg(test)]
mod tests;

pub use export::INPUT;
pub use init::Init;
pub use losses::{Batch, LossOptions, LossValues, Losses};
pub use pass::{Made, Pass};

use crate::error::Error;
use autodiff::{ParameterId, Parameters, Tape, Tensor, Var};
use block::{Block, Statistics};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use weights_format::{Architecture, Layer, LayerKind};

/// Statistics networks, which are trained beside the deployed network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StatisticsNets {
    /// Nothing: no mutual-information loss.
    None,
    /// The global network sees the features' averages; 256 hidden units.
    #[default]
    Light,
    /// The global network sees the whole maps; 512 hidden units (docs/method.md, section 3.7).
    Full,
}

impl StatisticsNets {
    fn hidden(self) -> usize {
        if self == StatisticsNets::Full {
            512
        } else {
            256
        }
    }
}

/// The network in training.
#[derive(Debug)]
pub struct Network {
    architecture: Architecture,
    statistics_nets: StatisticsNets,
    blocks: BTreeMap<String, Block>,
    scalars: [ParameterId; 2],           // si, bi
    unrelated: Option<Block>,            // E1
    statistics: Option<[Statistics; 2]>, // global, local
}

/// The head's outputs before sigmoid and exp.
#[derive(Clone, Copy, Debug)]
pub struct Prediction {
    /// Classification logits, `[batch, side, side, 1]`.
    pub score: Var,
    /// Centerness logits, `[batch, side, side, 1]`.
    pub centerness: Var,
    /// Offsets, `[batch, side, side, 4]`: the distances are `exp(si o + bi) * 8`.
    pub offsets: Var,
}

/// The features of the template and their encodings.
#[derive(Clone, Copy, Debug)]
struct Template {
    features: Var, // what the encoders see
    related: Var,  // what E2 made of them
    cls: Var,      // kernels of the correlations
    reg: Var,
}

impl Network {
    /// Adds the network's parameters, uninitialized.
    ///
    /// # Errors
    /// If the architecture is out of bounds, or asks for a mutual-information loss without an
    /// encoder.
    pub fn new(
        parameters: &mut Parameters,
        architecture: Architecture,
        statistics_nets: StatisticsNets,
    ) -> Result<Network, Error> {
        architecture.check()?;
        let layers = architecture.layers();
        let mut blocks = BTreeMap::new();
        for layer in layers.iter().filter(|layer| layer.kind == LayerKind::Conv) {
            blocks.insert(layer.name.clone(), Block::new(parameters, layer));
        }
        let scalars = [("head.si", 1.0), ("head.bi", 0.0)]
            .map(|(name, value)| parameters.add(name, Tensor::scalar(value)));
        let mut unrelated = None;
        let mut statistics = None;
        if statistics_nets != StatisticsNets::None {
            let Some(encoder) = layers.iter().find(|layer| layer.name == "dr.e2.0") else {
                return Err(Error::option(
                    "--no-mi",
                    "set, for a network without an encoder",
                    "not set",
                ));
            };
            let twin = Layer {
                name: "dr.e1.0".into(),
                ..encoder.clone()
            };
            unrelated = Some(Block::new(parameters, &twin));
            let (features, encoded) = (encoder.in_channels, 2 * encoder.out_channels);
            let positions = encoder.out_template * encoder.out_template;
            let global = (features + encoded)
                * if statistics_nets == StatisticsNets::Full {
                    positions
                } else {
                    1
                };
            let hidden = statistics_nets.hidden();
            statistics = Some([
                Statistics::new(parameters, "mi.global", global, hidden),
                Statistics::new(parameters, "mi.local", features + encoded, hidden),
            ]);
        }
        Ok(Network {
            architecture,
            statistics_nets,
            blocks,
            scalars,
            unrelated,
            statistics,
        })
    }

    /// Widths, encoder and crop sizes.
    pub fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    /// Statistics networks, which are trained beside the deployed network.
    pub fn statistics_nets(&self) -> StatisticsNets {
        self.statistics_nets
    }

    fn run(&self, pass: &mut Pass, name: &str, x: Var) -> Var {
        let (convolved, output) = self.blocks[name].forward(pass, x);
        pass.remember(name, convolved, output);
        output
    }

    /// Backbone features of normalized crops `[batch, side, side, 3]`.
    fn backbone(&self, pass: &mut Pass, crops: Var) -> Var {
        let mut x = crops;
        for i in 1..=5 {
            x = self.run(pass, &format!("backbone.conv{i}"), x);
            if i <= 2 {
                x = pass.max_pool(x);
                pass.remember(&format!("backbone.pool{i}"), x, x);
            }
        }
        x
    }

    /// The identity-related encoder E2; features pass through without it.
    fn encode(&self, pass: &mut Pass, features: Var) -> Var {
        if self.architecture.encoder.is_some() {
            self.run(pass, "dr.e2.0", features)
        } else {
            features
        }
    }

    fn template(&self, pass: &mut Pass, crops: Var) -> Template {
        let features = self.backbone(pass, crops);
        let related = self.encode(pass, features);
        Template {
            features,
            related,
            cls: self.run(pass, "neck.template_cls", related),
            reg: self.run(pass, "neck.template_reg", related),
        }
    }

    fn search(&self, pass: &mut Pass, crops: Var, template: &Template) -> Prediction {
        let features = self.backbone(pass, crops);
        let encoded = self.encode(pass, features);
        let cls = self.run(pass, "neck.search_cls", encoded);
        let mut cls = pass.xcorr(cls, template.cls);
        let reg = self.run(pass, "neck.search_reg", encoded);
        let mut reg = pass.xcorr(reg, template.reg);
        for i in 1..=3 {
            cls = self.run(pass, &format!("head.cls{i}"), cls);
            reg = self.run(pass, &format!("head.reg{i}"), reg);
        }
        Prediction {
            score: self.run(pass, "head.score", cls),
            centerness: self.run(pass, "head.centerness", cls),
            offsets: self.run(pass, "head.offsets", reg),
        }
    }

    /// The identity-unrelated features of encoder E1; the features themselves without it.
    fn unrelated(&self, pass: &mut Pass, features: Var) -> Var {
        let Some(encoder) = &self.unrelated else {
            return features;
        };
        let (convolved, output) = encoder.forward(pass, features);
        pass.remember("dr.e1.0", convolved, output);
        output
    }

    /// Runs template and search crops through the network as the losses do, to update batch
    /// statistics.
    pub fn predict(&self, tape: &mut Tape, template: Tensor, search: Tensor) -> Prediction {
        let pass = &mut Pass::new(tape);
        let crops = pass.constant(template);
        let template = self.template(pass, crops);
        let crops = pass.constant(search);
        self.search(pass, crops, &template)
    }

    /// Outputs of every layer for template and search crops, E1 included. Layers that run on both
    /// are listed twice.
    pub fn observe(&self, tape: &mut Tape, template: Tensor, search: Tensor) -> Vec<Made> {
        let mut pass = Pass::new(tape);
        let crops = pass.constant(template);
        let template = self.template(&mut pass, crops);
        self.unrelated(&mut pass, template.features);
        let crops = pass.constant(search);
        self.search(&mut pass, crops, &template);
        pass.into_made()
    }
}
