//! The neck: one 3x3 convolution per branch and task.
//!
//! `[6, 6, C] -> [4, 4, N]` for the template, `[28, 28, C] -> [26, 26, N]` for the search region.

use super::context::{Context, Contexts};
use super::map::Map;
use kernels::conv::Conv;
use kernels::par::Threads;

/// The neck's convolutions.
#[derive(Debug)]
pub(crate) struct Neck {
    pub template_cls: Conv,
    pub template_reg: Conv,
    pub search_cls: Conv,
    pub search_reg: Conv,
}

/// One map per task.
#[derive(Debug, Default)]
pub(crate) struct TaskMaps {
    pub cls: Map,
    pub reg: Map,
}

impl Neck {
    /// Runs on a template's features.
    pub(crate) fn template(
        &self,
        context: &mut Context,
        threads: &Threads,
        features: &Map,
        maps: &mut TaskMaps,
    ) {
        context.conv(threads, &self.template_cls, features, &mut maps.cls);
        context.conv(threads, &self.template_reg, features, &mut maps.reg);
    }

    /// Runs on a search region's features, both tasks side by side.
    pub(crate) fn search(
        &self,
        contexts: &mut Contexts,
        threads: &Threads,
        features: &Map,
        TaskMaps { cls, reg }: &mut TaskMaps,
    ) {
        threads.both(
            contexts.both(),
            |threads, context| context.conv(threads, &self.search_cls, features, cls),
            |threads, context| context.conv(threads, &self.search_reg, features, reg),
        );
    }
}
