//! The neck: one 3x3 convolution per branch and task. `[6, 6, C] -> [4, 4, N]`, `[28, 28, C] -> [26, 26, N]`.

use crate::scratch::{Context, Map};
use kernels::conv::Conv;
use kernels::par::Threads;

#[derive(Debug)]
pub(crate) struct Neck {
    pub template_cls: Conv,
    pub template_reg: Conv,
    pub search_cls: Conv,
    pub search_reg: Conv,
}

/// The features of the branch that ran last.
#[derive(Debug, Default)]
pub(crate) struct NeckMaps {
    pub cls: Map,
    pub reg: Map,
}

impl Neck {
    pub(crate) fn template(
        &self,
        context: &mut Context,
        threads: &Threads,
        features: &Map,
        maps: &mut NeckMaps,
    ) {
        context.conv(threads, &self.template_cls, features, &mut maps.cls);
        context.conv(threads, &self.template_reg, features, &mut maps.reg);
    }

    pub(crate) fn search(
        &self,
        contexts: [&mut Context; 2],
        threads: &Threads,
        features: &Map,
        NeckMaps { cls, reg }: &mut NeckMaps,
    ) {
        threads.both(
            contexts,
            |threads, context| context.conv(threads, &self.search_cls, features, cls),
            |threads, context| context.conv(threads, &self.search_reg, features, reg),
        );
    }
}
