//! The forward pass, written out: template crop -> [`TemplateFeatures`], search crop -> [`Outputs`].
//!
//! ```text
//! template crop -> backbone -> dr (E2) -> neck -> TemplateFeatures        once per target
//! search crop   -> backbone -> dr (E2) -> neck -> xcorr -> head -> Outputs   once per frame
//! ```
//!
//! Source: paper section III, spec sections 1.2, 1.3, 1.6, 1.7.

pub(crate) mod backbone;
pub(crate) mod dr;
pub(crate) mod head;
pub(crate) mod neck;
mod template;

use crate::model::{Layers, Model};
use crate::scratch::{Context, Map, Scratch};
use crate::stages::{Lap, Stages};
use dr::DrMaps;
use kernels::par::Threads;
use neck::NeckMaps;
use std::collections::HashMap;
use template::Template;
use weights_format::{Architecture, EncoderPosition};

pub use template::TemplateFeatures;

/// What the network says about every cell of the score map, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outputs {
    /// Classification score times centerness, in `[0, 1]`: `[cells]`.
    pub score: Vec<f32>,
    /// Distances from the cell's center to the box's left, top, right and bottom edge in crop pixels: `[cells, 4]`.
    pub ltrb: Vec<f32>,
}

/// The network of one model with its buffers and threads, ready to run.
#[derive(Debug)]
pub struct Network {
    model: Model,
    threads: Threads,
    scratch: Scratch,
    template: Template,
    outputs: Outputs,
}

impl Network {
    /// A network without a template; `threads` as [`Threads::new`] takes it.
    pub fn new(model: Model, threads: usize) -> Network {
        Network::with_threads(model, Threads::new(threads))
    }

    /// A network without a template on given threads.
    pub fn with_threads(model: Model, threads: Threads) -> Network {
        let cells = model.architecture().score_size().pow(2);
        let outputs = Outputs {
            score: vec![0.0; cells],
            ltrb: vec![0.0; 4 * cells],
        };
        let scratch = Scratch::new(model.isa());
        Network {
            model,
            threads,
            scratch,
            template: Template::default(),
            outputs,
        }
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// The threads that the kernels run on.
    pub fn threads(&self) -> &Threads {
        &self.threads
    }

    /// Every intermediate map that the last pass left, by the layer's name: for tests and diagnosis. conv1 and conv2 leave only what is pooled.
    pub fn maps(&self) -> impl Iterator<Item = (&'static str, &Map)> {
        let TemplateFeatures { cls, reg, .. } = self.template.features();
        let template = [("neck.template_cls", cls), ("neck.template_reg", reg)];
        self.scratch.maps().chain(template)
    }

    /// The identity-related features of the template and of the last search region.
    pub(crate) fn identity(&self) -> (&Map, &Map) {
        let Scratch {
            backbone, encoded, ..
        } = &self.scratch;
        (
            &self.template.features().identity,
            self.model
                .layers()
                .encoder
                .search_features(&backbone.conv5, encoded),
        )
    }

    /// The neck's features for classification: the template's and those of the last search region.
    pub(crate) fn classification(&self) -> (&Map, &Map) {
        (&self.template.features().cls, &self.scratch.neck.cls)
    }

    /// What the last pass said.
    pub(crate) fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// The input of every convolution that may run on bytes, as the last pass left it, by the convolution's name: what a
    /// calibration measures. The outputs of the head stay in `f32` and are not among them.
    pub fn inputs(&self) -> Vec<(String, &Map)> {
        let architecture = self.model.architecture();
        let maps: HashMap<_, _> = self.maps().collect();
        let layers = architecture.layers().into_iter().map(|layer| layer.name);
        layers
            .filter_map(|name| input_map(architecture, &name).map(|input| (name, maps[input])))
            .filter(|(_, map)| !map.values().is_empty())
            .collect()
    }

    /// Computes and keeps the features of a template crop (`[size, size, 3]`, BGR).
    ///
    /// Panics if the crop has not the model's size.
    pub fn set_template(&mut self, crop: &[u8]) {
        let Network {
            model,
            threads,
            scratch,
            template,
            ..
        } = self;
        threads.enter(|| {
            let layers = model.layers();
            scratch.set_crop(
                crop,
                model.architecture().template_size,
                &layers.backbone.conv1,
            );
            let Scratch {
                contexts: [context, _],
                backbone,
                encoded,
                encoded_neck,
                template_neck: neck,
                ..
            } = scratch;
            layers.backbone.run(context, threads, backbone);
            let features = layers
                .encoder
                .template(context, threads, &backbone.conv5, encoded);
            let maps = template_maps(layers, context, threads, features, neck, encoded_neck);
            template.set(features, maps);
        });
    }

    /// Lets the template take in how the target looks in the last search region, where its window of the identity-related
    /// features starts at (`row`, `column`). `share` is what such looks may have of the template in the end.
    ///
    /// A search crop has its target at nearly the same scale as a template crop, so that its features serve and no other pass is
    /// needed; only the neck's convolutions run, on 6x6 cells. Nothing happens where encoders have other weights for
    /// templates, since features then differ.
    pub(crate) fn update_template(&mut self, row: usize, column: usize, share: f32) {
        let Network {
            model,
            threads,
            scratch,
            template,
            ..
        } = self;
        let layers = model.layers();
        if !(layers.encoder.is_shared() && layers.encoder_after_neck.is_shared()) {
            return;
        }
        threads.enter(|| {
            let Scratch {
                contexts: [context, _],
                backbone,
                encoded,
                encoded_neck,
                template_neck,
                window,
                ..
            } = scratch;
            let features = layers.encoder.search_features(&backbone.conv5, encoded);
            window.copy_window(features, template.features().identity.size(), row, column);
            let maps = template_maps(
                layers,
                context,
                threads,
                window,
                template_neck,
                encoded_neck,
            );
            template.add(maps, share);
        });
    }

    /// Runs a search crop (`[size, size, 3]`, BGR) against the template features.
    ///
    /// Panics if the crop has not the model's size or no template was set.
    pub fn search(&mut self, crop: &[u8]) -> &Outputs {
        self.search_timed(
            crop,
            self.model.architecture().search_size,
            &mut Stages::default(),
        )
    }

    /// As [`search`](Self::search) on a crop of `side` pixels, noting the time of every stage.
    pub(crate) fn search_timed(
        &mut self,
        crop: &[u8],
        side: usize,
        stages: &mut Stages,
    ) -> &mut Outputs {
        let Network {
            model,
            threads,
            scratch,
            template,
            outputs,
        } = self;
        let template = template.features();
        assert!(
            template.cls.channels() > 0,
            "search needs template features: call set_template first"
        );
        threads.enter(|| {
            let mut lap = Lap::start();
            let layers = model.layers();
            scratch.set_crop(crop, side, &layers.backbone.conv1);
            let Scratch {
                contexts,
                backbone,
                encoded,
                encoded_neck,
                neck,
                response,
                head,
                ..
            } = scratch;
            let [context, other] = contexts;

            layers.backbone.run(context, threads, backbone);
            stages.backbone = lap.lap();

            let features = layers
                .encoder
                .search(context, threads, &backbone.conv5, encoded);
            stages.dr = lap.lap();

            layers
                .neck
                .search([context, other], threads, features, neck);
            stages.neck = lap.lap();

            let [cls, reg] = encoded_neck;
            let cls = layers
                .encoder_after_neck
                .search(context, threads, &neck.cls, cls);
            let reg = layers
                .encoder_after_neck
                .search(context, threads, &neck.reg, reg);
            stages.dr += lap.lap();

            threads.both(
                [context, other],
                |threads, context| context.xcorr(threads, cls, &template.cls, &mut response.cls),
                |threads, context| context.xcorr(threads, reg, &template.reg, &mut response.reg),
            );
            stages.xcorr = lap.lap();

            layers
                .head
                .run([context, other], threads, response, head, outputs);
            stages.head = lap.lap();
        });
        &mut self.outputs
    }
}

/// From the identity-related features of a template's window to what is correlated, for `cls` and `reg`.
fn template_maps<'a>(
    layers: &Layers,
    context: &mut Context,
    threads: &Threads,
    features: &Map,
    neck: &'a mut NeckMaps,
    [cls, reg]: &'a mut [DrMaps; 2],
) -> [&'a Map; 2] {
    layers.neck.template(context, threads, features, neck);
    let encoder = &layers.encoder_after_neck;
    [
        encoder.template(context, threads, &neck.cls, cls),
        encoder.template(context, threads, &neck.reg, reg),
    ]
}

/// Which map the convolution `name` reads.
fn input_map(architecture: &Architecture, name: &str) -> Option<&'static str> {
    let before_neck = architecture
        .encoder
        .filter(|e| e.position == EncoderPosition::BeforeNeck);
    match name {
        "backbone.conv2" => Some("backbone.pool1"),
        "backbone.conv3" => Some("backbone.pool2"),
        "backbone.conv4" => Some("backbone.conv3"),
        "backbone.conv5" => Some("backbone.conv4"),
        "dr.e2.0" | "dr.e2_template.0" | "dr.e2_search.0" => before_neck.map(|_| "backbone.conv5"),
        "dr.e2.1" | "dr.e2_template.1" | "dr.e2_search.1" => before_neck.map(|_| "dr.e2.0"),
        "neck.template_cls" | "neck.template_reg" | "neck.search_cls" | "neck.search_reg" => {
            Some(before_neck.map_or("backbone.conv5", |e| {
                if e.layers == 2 { "dr.e2.1" } else { "dr.e2.0" }
            }))
        }
        "head.cls1" => Some("correlation.cls"),
        "head.cls2" => Some("head.cls1"),
        "head.cls3" => Some("head.cls2"),
        "head.reg1" => Some("correlation.reg"),
        "head.reg2" => Some("head.reg1"),
        "head.reg3" => Some("head.reg2"),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kernels::Isa;
    use weights_format::{Weights, Widths};

    #[test]
    fn the_window_at_the_middle_holds_what_a_template_crop_gives() {
        let architecture = Architecture::new(Widths::pruned(0.9), None);
        let (side, small) = (architecture.search_size, architecture.template_size);
        let weights = Weights::random(architecture, 4);
        let mut network = Network::new(Model::from_weights(&weights, Isa::detect()).unwrap(), 1);
        let crop: Vec<u8> = (0..side * side * 3)
            .map(|i| (i * i / 7 % 251) as u8)
            .collect();
        let edge = (side - small) / 2;
        let row = |y: usize| &crop[((edge + y) * side + edge) * 3..][..small * 3];
        let template: Vec<u8> = (0..small).flat_map(row).copied().collect();
        network.set_template(&template);
        let before = network.template.features().clone();
        network.search(&crop);
        let start = edge / Architecture::TOTAL_STRIDE;
        network.update_template(start, start, 1.0);
        let far = |network: &Network| {
            let now = network.template.features();
            let pairs = now.cls.values().iter().zip(before.cls.values());
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        let size = before
            .cls
            .values()
            .iter()
            .fold(0.0f32, |most, v| most.max(v.abs()));
        assert!(far(&network) < 1e-3 * size, "{} of {size}", far(&network));
        network.update_template(start, start + 1, 1.0);
        assert!(
            far(&network) > 1e-2 * size,
            "a window beside it holds something else"
        );
    }
}
