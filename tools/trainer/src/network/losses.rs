//! All losses of a batch (docs/method.md, sections 3.4 and 3.7).

use super::{Network, Pass, Prediction, StatisticsNets, Template};
use crate::targets::{Cells, Targets};
use autodiff::{BoxDecoder, Focal, ProcessGroup, Tape, Tensor, Var};
use serde::{Deserialize, Serialize};

/// Weights and limits of the losses.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LossOptions {
    /// Weight of the ones in the focal loss.
    pub focal_alpha: f32,
    /// Weight of the centerness loss.
    pub centerness: f32,
    /// Weight of the IoU loss.
    pub iou: f32,
    /// Weight of the global mutual information, 0 to leave it out.
    pub global: f32,
    /// Weight of the local mutual information, 0 to leave it out.
    pub local: f32,
    /// Weight of the identity loss, 0 to leave it out.
    pub identity: f32,
    /// Lower bound of the IoU.
    pub min_iou: f32,
    /// Upper bound of the exponent of the distances.
    pub max_exponent: f32,
}

impl Default for LossOptions {
    /// The weights of docs/method.md, section 3.4 and 3.7, with an IoU of at least 1e-6 and
    /// distances of at most 8 exp(6) pixels.
    fn default() -> LossOptions {
        LossOptions {
            focal_alpha: 0.25,
            centerness: 1.0,
            iou: 3.0,
            global: 0.05,
            local: 0.05,
            identity: 0.05,
            min_iou: 1e-6,
            max_exponent: 6.0,
        }
    }
}

/// Input of a step: normalized crops (`[batch, side, side, 3]`) and their targets.
#[derive(Clone, Debug)]
pub struct Batch {
    /// Template crops.
    pub template: Tensor,
    /// Search crops.
    pub search: Tensor,
    /// Template crops from the search pictures.
    pub again: Tensor,
    /// Whether template and search crop show one target.
    pub positive: Vec<bool>,
    /// Targets of the head.
    pub targets: Targets,
    /// The score map's cells.
    pub cells: Cells,
}

/// The losses of a batch, weighted as they are summed.
#[derive(Clone, Copy, Debug)]
pub struct Losses {
    cls: Var,
    centerness: Var,
    iou: Var,
    global: Option<Var>,
    local: Option<Var>,
    identity: Option<Var>,
    /// Their sum.
    pub total: Var,
}

/// The losses' values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LossValues {
    /// Sum of all.
    pub total: f64,
    /// Classification.
    pub cls: f64,
    /// Centerness.
    pub centerness: f64,
    /// IoU.
    pub iou: f64,
    /// Global mutual information.
    pub global: f64,
    /// Local mutual information.
    pub local: f64,
    /// Identity.
    pub identity: f64,
}

impl LossValues {
    /// Names and values.
    pub fn named(&self) -> [(&'static str, f64); 7] {
        let LossValues {
            total,
            cls,
            centerness,
            iou,
            global,
            local,
            identity,
        } = *self;
        [
            ("total", total),
            ("cls", cls),
            ("centerness", centerness),
            ("iou", iou),
            ("global", global),
            ("local", local),
            ("identity", identity),
        ]
    }

    /// The losses of the whole batch, given those of this process's part.
    pub fn over(&self, processes: &dyn ProcessGroup) -> LossValues {
        let sums = processes.sums(&self.named().map(|(_, value)| value));
        LossValues {
            total: sums[0],
            cls: sums[1],
            centerness: sums[2],
            iou: sums[3],
            global: sums[4],
            local: sums[5],
            identity: sums[6],
        }
    }

    /// `share` of `newer` and the rest of these.
    pub fn mixed(&self, newer: &LossValues, share: f64) -> LossValues {
        let mix = |old: f64, new: f64| old + (new - old) * share;
        LossValues {
            total: mix(self.total, newer.total),
            cls: mix(self.cls, newer.cls),
            centerness: mix(self.centerness, newer.centerness),
            iou: mix(self.iou, newer.iou),
            global: mix(self.global, newer.global),
            local: mix(self.local, newer.local),
            identity: mix(self.identity, newer.identity),
        }
    }
}

impl Losses {
    /// Their values.
    pub fn values(&self, tape: &Tape) -> LossValues {
        let value = |var: Var| f64::from(tape.value(var).item());
        let maybe = |var: Option<Var>| var.map_or(0.0, value);
        LossValues {
            total: value(self.total),
            cls: value(self.cls),
            centerness: value(self.centerness),
            iou: value(self.iou),
            global: maybe(self.global),
            local: maybe(self.local),
            identity: maybe(self.identity),
        }
    }
}

impl Network {
    /// Runs a batch through the network and its losses. The backbone runs on template, search crop
    /// and second template in this order, each with batch statistics of its own.
    pub fn losses(
        &self,
        tape: &mut Tape,
        batch: Batch,
        options: &LossOptions,
    ) -> (Prediction, Losses) {
        let pass = &mut Pass::new(tape);
        let crops = pass.constant(batch.template);
        let template = self.template(pass, crops);
        let crops = pass.constant(batch.search);
        let prediction = self.search(pass, crops, &template);
        let identity =
            (options.identity != 0.0 && self.architecture.encoder.is_some()).then(|| {
                let crops = pass.constant(batch.again);
                let again = self.template_features(pass, crops);
                let loss = pass.mean_square(template.related, again, &batch.positive);
                pass.scale(loss, options.identity)
            });
        let [global, local] = self.information(pass, &template, options);

        let Targets {
            labels,
            quality,
            boxes,
        } = &batch.targets;
        let focal = Focal {
            alpha: options.focal_alpha,
            gamma: 2.0,
        };
        let cls = pass.focal_loss(prediction.score, labels, focal);
        let centerness = pass.quality_loss(prediction.centerness, quality);
        let centerness = pass.scale(centerness, options.centerness);
        let decoder = BoxDecoder {
            max_exponent: options.max_exponent,
            min_iou: options.min_iou,
            ..BoxDecoder::new(batch.cells.first as f32)
        };
        let [si, bi] = self.scalars.map(|id| pass.parameter(id));
        let iou = pass.iou_loss(prediction.offsets, si, bi, labels, boxes, decoder);
        let iou = pass.scale(iou, options.iou);
        let more = [Some(centerness), Some(iou), global, local, identity];
        let total = more
            .into_iter()
            .flatten()
            .fold(cls, |sum, loss| pass.add(sum, loss));
        (
            prediction,
            Losses {
                cls,
                centerness,
                iou,
                global,
                local,
                identity,
                total,
            },
        )
    }

    /// The identity-related features of template crops.
    fn template_features(&self, pass: &mut Pass, crops: Var) -> Var {
        let features = self.backbone(pass, crops);
        self.encode(pass, features)
    }

    /// Minus the estimates of the mutual information between the template's features and their
    /// encodings, global and local, weighted.
    fn information(
        &self,
        pass: &mut Pass,
        template: &Template,
        options: &LossOptions,
    ) -> [Option<Var>; 2] {
        let Some([global, local]) = self.statistics else {
            return [None, None];
        };
        let f = template.features;
        let unrelated = self.unrelated(pass, f);
        let code = pass.concat(&[template.related, unrelated]);
        let rolled = pass.roll(f, 1);
        let average = pass.global_average(code);
        let weighted = |pass: &mut Pass, scores: [Var; 2], weight: f32| {
            let estimate = pass.information(scores[0], scores[1]);
            pass.scale(estimate, -weight)
        };
        let full = self.statistics_nets == StatisticsNets::Full;
        let global = (options.global != 0.0).then(|| {
            let code = if full { pass.flatten(code) } else { average };
            let scores = [f, rolled].map(|f| {
                let f = if full {
                    pass.flatten(f)
                } else {
                    pass.global_average(f)
                };
                let input = pass.concat(&[f, code]);
                global.forward(pass, input)
            });
            weighted(pass, scores, options.global)
        });
        let local = (options.local != 0.0).then(|| {
            let [_, h, w, _] = pass.shape(f)[..] else {
                unreachable!("features are maps")
            };
            let tiled = pass.tile(average, kernels::Size { h, w });
            let scores = [f, rolled].map(|f| {
                let input = pass.concat(&[f, tiled]);
                local.forward(pass, input)
            });
            weighted(pass, scores, options.local)
        });
        [global, local]
    }
}
