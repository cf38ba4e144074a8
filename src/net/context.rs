//! Calls of one layer: shapes the output map, lends the scratch space, runs the kernel.

use super::map::Map;
use kernels::conv::{Conv, Output};
use kernels::par::Threads;
use kernels::xcorr::{Features, xcorr};
use kernels::{Aligned, Isa, Size, pool};

/// What every layer call needs besides its maps.
#[derive(Debug)]
pub(crate) struct Context {
    isa: Isa,
    scratch: Aligned<f32>, // of the running convolution
}

impl Context {
    pub(crate) fn new(isa: Isa) -> Context {
        Context {
            isa,
            scratch: Aligned::default(),
        }
    }

    /// Runs a convolution whose output stays in floats.
    pub(crate) fn conv(&mut self, threads: &Threads, conv: &Conv, from: &Map, to: &mut Map) {
        let out = to.reshape(
            conv.shape().out_size(from.size()),
            conv.shape().out_channels,
        );
        let scratch = self.scratch(conv.scratch_len(from.size(), threads));
        conv.run_between(
            threads,
            from.input(),
            from.size(),
            Output::Floats(out),
            scratch,
        );
    }

    /// Runs a convolution whose output only `next` reads, so that bytes may pass between them.
    pub(crate) fn conv_for(
        &mut self,
        threads: &Threads,
        conv: &Conv,
        next: &Conv,
        from: &Map,
        to: &mut Map,
    ) {
        let out = to.output(conv.shape().out_size(from.size()), conv, next);
        let scratch = self.scratch(conv.scratch_len(from.size(), threads));
        conv.run_between(threads, from.input(), from.size(), out, scratch);
    }

    /// Runs a convolution and the max-pool behind it; only `next` reads the pooled output.
    pub(crate) fn conv_pool_for(
        &mut self,
        threads: &Threads,
        conv: &Conv,
        next: &Conv,
        from: &Map,
        to: &mut Map,
    ) {
        let pooled = pool::out_size(conv.shape().out_size(from.size()));
        let out = to.output(pooled, conv, next);
        let scratch = self.scratch(conv.pooled_scratch_len(from.size(), threads));
        conv.run_pooled(threads, from.input(), from.size(), out, scratch);
    }

    /// Correlates every channel of the search features with the same channel of the template's.
    pub(crate) fn xcorr(&self, threads: &Threads, search: &Map, template: &Map, to: &mut Map) {
        let size = search.size();
        let kernel = template.size();
        let channels = search.channels();
        let out_size = Size {
            h: size.h - kernel.h + 1,
            w: size.w - kernel.w + 1,
        };
        let out = to.reshape(out_size, channels);
        let search = Features {
            values: search.values(),
            size,
        };
        let template = Features {
            values: template.values(),
            size: kernel,
        };
        xcorr(self.isa, threads, search, template, channels, out);
    }

    /// The first `len` floats of the scratch space, which only ever grows.
    fn scratch(&mut self, len: usize) -> &mut [f32] {
        if self.scratch.len() < len {
            self.scratch.resize(len);
        }
        &mut self.scratch[..len]
    }
}

/// One context per task, because the two tasks' layers run side by side.
#[derive(Debug)]
pub(crate) struct Contexts {
    /// Of classification, and of every layer that both tasks share.
    pub cls: Context,
    /// Of regression.
    pub reg: Context,
}

impl Contexts {
    pub(crate) fn new(isa: Isa) -> Contexts {
        Contexts {
            cls: Context::new(isa),
            reg: Context::new(isa),
        }
    }

    /// Both contexts, classification first, as [`Threads::both`] takes them.
    pub(crate) fn both(&mut self) -> [&mut Context; 2] {
        [&mut self.cls, &mut self.reg]
    }
}
