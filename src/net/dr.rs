//! The disentangled-representation module at inference: encoder E2.
//!
//! E2 keeps the identity-related features. Its twin E1 exists in training only.

use super::context::Context;
use super::map::Map;
use kernels::conv::Conv;
use kernels::par::Threads;

/// E2, one convolution that template and search region share; features pass through without it.
#[derive(Debug)]
pub(crate) struct Dr {
    pub conv: Option<Conv>,
}

impl Dr {
    /// The identity-related features of a template or a search region.
    pub(crate) fn run<'a>(
        &self,
        context: &mut Context,
        threads: &Threads,
        features: &'a Map,
        encoded: &'a mut Map,
    ) -> &'a Map {
        let Some(conv) = &self.conv else {
            return features;
        };
        context.conv(threads, conv, features, encoded);
        encoded
    }

    /// What [`run`](Self::run) returned last.
    pub(crate) fn output<'a>(&self, features: &'a Map, encoded: &'a Map) -> &'a Map {
        if self.conv.is_some() {
            encoded
        } else {
            features
        }
    }
}
