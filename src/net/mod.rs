//! The forward pass: template crop -> [`TemplateFeatures`], search crop -> [`Outputs`].
//!
//! ```text
//! template crop -> backbone -> dr (E2) -> neck -> TemplateFeatures           once per target
//! search crop   -> backbone -> dr (E2) -> neck -> xcorr -> head -> Outputs   once per frame
//! ```
//!
//! | file | what happens there |
//! |---|---|
//! | `mod.rs` | both passes, stage by stage: start at [`Network::search`] |
//! | `backbone.rs`, `dr.rs`, `neck.rs`, `head.rs` | the parts: their convolutions and their maps |
//! | `template.rs` | the cached template and its update |
//! | `map.rs`, `context.rs` | one map of activations; one layer call |
//! | `buffers.rs` | the buffers of all parts |
//!
//! Source: paper section III; docs/method.md, section 1.

pub(crate) mod backbone;
mod buffers;
mod context;
pub(crate) mod dr;
pub(crate) mod head;
mod map;
pub(crate) mod neck;
mod template;

use crate::model::Model;
use crate::stages::{Lap, Stages};
use buffers::Buffers;
use context::Contexts;
use kernels::par::Threads;
use neck::TaskMaps;
use std::collections::HashMap;
use template::Template;
use weights_format::LayerKind;

pub use head::Outputs;
pub use map::Map;
pub use template::TemplateFeatures;

/// The network of one model with its buffers and threads, ready to run.
#[derive(Debug)]
pub struct Network {
    model: Model,
    threads: Threads,
    buffers: Buffers,
    template: Template,
    outputs: Outputs,
}

impl Network {
    /// A network without a template; `threads` as in [`Threads::new`].
    pub fn new(model: Model, threads: usize) -> Network {
        Network::with_threads(model, Threads::new(threads))
    }

    /// A network without a template on the given threads.
    pub fn with_threads(model: Model, threads: Threads) -> Network {
        let cells = model.architecture().score_size().pow(2);
        let outputs = Outputs {
            score: vec![0.0; cells],
            ltrb: vec![0.0; 4 * cells],
        };
        let buffers = Buffers::new(model.isa());
        Network {
            model,
            threads,
            buffers,
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

    /// Every intermediate map of the last pass by its layer's name: for tests and diagnosis.
    ///
    /// conv1 and conv2 are fused with their pools and leave only the pooled maps.
    pub fn maps(&self) -> impl Iterator<Item = (&'static str, &Map)> {
        let TemplateFeatures { cls, reg, .. } = self.template.features();
        let template = [("neck.template_cls", cls), ("neck.template_reg", reg)];
        self.buffers.maps().chain(template)
    }

    /// The identity-related features of the template and of the last search region.
    pub(crate) fn identity(&self) -> (&Map, &Map) {
        let Buffers {
            backbone, encoded, ..
        } = &self.buffers;
        let encoder = &self.model.layers().encoder;
        (
            &self.template.features().identity,
            encoder.output(&backbone.conv5, encoded),
        )
    }

    /// The neck's classification features of the template and of the last search region.
    pub(crate) fn classification(&self) -> (&Map, &Map) {
        (&self.template.features().cls, &self.buffers.neck.cls)
    }

    /// The outputs of the last search pass.
    pub(crate) fn outputs(&self) -> &Outputs {
        &self.outputs
    }

    /// The input of every convolution that may run on bytes, by the convolution's name.
    ///
    /// A calibration measures these maps. The first convolution reads pixels and needs no range.
    /// The three output convolutions always run in `f32`. Maps that hold bytes are left out.
    pub fn inputs(&self) -> Vec<(String, &Map)> {
        let layers = self.model.architecture().layers();
        let maps: HashMap<_, _> = self.maps().collect();
        let mut inputs = Vec::new();
        for layer in layers.iter().filter(|layer| layer.kind == LayerKind::Conv) {
            let is_read = layers
                .iter()
                .any(|other| other.inputs.contains(&layer.name));
            let [input] = &layer.inputs[..] else { continue };
            if let Some(map) = maps.get(input.as_str())
                && is_read
                && !map.values().is_empty()
            {
                inputs.push((layer.name.clone(), *map));
            }
        }
        inputs
    }

    /// Computes and keeps the features of a template crop (`[size, size, 3]`, BGR).
    ///
    /// Panics if the crop does not have the model's size.
    pub fn set_template(&mut self, crop: &[u8]) {
        let Network {
            model,
            threads,
            buffers,
            template,
            ..
        } = self;
        // Backbone, E2 and neck run one after the other, on the buffers of the classification task.
        threads.enter(|| {
            let layers = model.layers();
            let side = model.architecture().template_size;
            buffers.set_crop(crop, side, &layers.backbone.conv1);
            let Buffers {
                contexts,
                backbone,
                encoded,
                template_neck,
                ..
            } = buffers;
            let context = &mut contexts.cls;
            layers.backbone.run(context, threads, backbone);
            let features = layers
                .encoder
                .run(context, threads, &backbone.conv5, encoded);
            layers
                .neck
                .template(context, threads, features, template_neck);
            template.set(features, template_neck);
        });
    }

    /// Blends the target's look in the last search region into the template.
    ///
    /// The template's window of the identity-related features starts at (`row`, `column`).
    /// `share` is the limit that such looks approach as a part of the template.
    ///
    /// A search crop shows its target at nearly the scale of a template crop, so its features
    /// serve as they are. Only the neck's convolutions run, on 6x6 cells.
    pub(crate) fn update_template(&mut self, row: usize, column: usize, share: f32) {
        let Network {
            model,
            threads,
            buffers,
            template,
            ..
        } = self;
        let layers = model.layers();
        // Copy the window of the template's size, run the neck on it, average.
        threads.enter(|| {
            let Buffers {
                contexts,
                backbone,
                encoded,
                template_neck,
                window,
                ..
            } = buffers;
            let features = layers.encoder.output(&backbone.conv5, encoded);
            window.copy_window(features, template.features().identity.size(), row, column);
            layers
                .neck
                .template(&mut contexts.cls, threads, window, template_neck);
            template.add(template_neck, share);
        });
    }

    /// Runs a search crop (`[size, size, 3]`, BGR) against the template features.
    ///
    /// Panics if the crop does not have the model's size or no template was set.
    pub fn search(&mut self, crop: &[u8]) -> &Outputs {
        let side = self.model.architecture().search_size;
        self.search_timed(crop, side, &mut Stages::default())
    }

    /// Runs a search crop of `side` pixels and adds the time of every stage.
    pub(crate) fn search_timed(
        &mut self,
        crop: &[u8],
        side: usize,
        stages: &mut Stages,
    ) -> &mut Outputs {
        let Network {
            model,
            threads,
            buffers,
            template,
            outputs,
        } = self;
        let template = template.features();
        assert!(
            template.cls.channels() > 0,
            "search needs template features: call set_template first"
        );
        // Each stage reads the maps of the stage before. Neck, xcorr and head run both tasks side
        // by side.
        threads.enter(|| {
            let mut lap = Lap::start();
            let layers = model.layers();
            buffers.set_crop(crop, side, &layers.backbone.conv1);
            let Buffers {
                contexts,
                backbone,
                encoded,
                neck,
                response,
                head,
                ..
            } = buffers;

            layers.backbone.run(&mut contexts.cls, threads, backbone);
            stages.backbone += lap.lap();

            let features = &backbone.conv5;
            let features = layers
                .encoder
                .run(&mut contexts.cls, threads, features, encoded);
            stages.dr += lap.lap();

            layers.neck.search(contexts, threads, features, neck);
            stages.neck += lap.lap();

            correlate(contexts, threads, neck, template, response);
            stages.xcorr += lap.lap();

            layers.head.run(contexts, threads, response, head, outputs);
            stages.head += lap.lap();
        });
        &mut self.outputs
    }
}

/// Correlates the search region's neck features with the template's, both tasks side by side.
fn correlate(
    contexts: &mut Contexts,
    threads: &Threads,
    neck: &TaskMaps,
    template: &TemplateFeatures,
    response: &mut TaskMaps,
) {
    let TaskMaps { cls, reg } = response;
    threads.both(
        contexts.both(),
        |threads, context| context.xcorr(threads, &neck.cls, &template.cls, cls),
        |threads, context| context.xcorr(threads, &neck.reg, &template.reg, reg),
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use kernels::Isa;
    use weights_format::{Architecture, Weights, Widths};

    #[test]
    fn template_updated_from_the_middle_of_its_own_search_crop_stays_the_same() {
        let architecture = Architecture::new(Widths::pruned(0.9), None);
        let side = architecture.search_size;
        let small = architecture.template_size;
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
        let far = |network: &Network| {
            let now = network.template.features();
            let pairs = now.cls.values().iter().zip(before.cls.values());
            pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
        };
        let values = before.cls.values().iter();
        let size = values.fold(0.0f32, |most, v| most.max(v.abs()));

        network.update_template(start, start, 1.0);
        let at_the_middle = far(&network);
        network.update_template(start, start + 1, 1.0);
        let beside = far(&network);

        assert!(at_the_middle < 1e-3 * size, "{at_the_middle} of {size}");
        assert!(beside > 1e-2 * size, "{beside} of {size}");
    }
}
