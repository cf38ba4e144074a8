//! The backbone: AlexNet without padding.
//!
//! `[127, 127, 3] -> [6, 6, C]` for the template, `[303, 303, 3] -> [28, 28, C]` for the search
//! region.

use super::context::Context;
use super::map::Map;
use kernels::conv::Conv;
use kernels::par::Threads;

/// The backbone's convolutions.
#[derive(Debug)]
pub(crate) struct Backbone {
    pub conv1: Conv,
    pub conv2: Conv,
    pub conv3: Conv,
    pub conv4: Conv,
    pub conv5: Conv,
}

/// The output of each layer; sides for a search crop of 303.
#[derive(Debug, Default)]
pub(crate) struct BackboneMaps {
    pub crop: Map,  // [303, 303, 3]
    pub pool1: Map, // [73, 73, C1], of conv1's [147, 147, C1]
    pub pool2: Map, // [34, 34, C2], of conv2's [69, 69, C2]
    pub conv3: Map, // [32, 32, C3]
    pub conv4: Map, // [30, 30, C4]
    pub conv5: Map, // [28, 28, C5]
}

impl Backbone {
    /// Runs on `maps.crop` and leaves the features in `maps.conv5`.
    pub(crate) fn run(&self, context: &mut Context, threads: &Threads, maps: &mut BackboneMaps) {
        let Backbone {
            conv1,
            conv2,
            conv3,
            conv4,
            conv5,
        } = self;
        context.conv_pool_for(threads, conv1, conv2, &maps.crop, &mut maps.pool1);
        context.conv_pool_for(threads, conv2, conv3, &maps.pool1, &mut maps.pool2);
        context.conv_for(threads, conv3, conv4, &maps.pool2, &mut maps.conv3);
        context.conv_for(threads, conv4, conv5, &maps.conv3, &mut maps.conv4);
        context.conv(threads, conv5, &maps.conv4, &mut maps.conv5);
    }
}
