//! The backbone: AlexNet without padding. `[127, 127, 3] -> [6, 6, C]`, `[303, 303, 3] -> [28, 28, C]`.

use crate::scratch::{Context, Map};
use kernels::conv::Conv;
use kernels::par::Threads;

#[derive(Debug)]
pub(crate) struct Backbone {
    pub conv1: Conv,
    pub conv2: Conv,
    pub conv3: Conv,
    pub conv4: Conv,
    pub conv5: Conv,
}

/// What each layer leaves behind; sides for a search crop of 303.
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
    pub(crate) fn run(&self, context: &mut Context, threads: &Threads, maps: &mut BackboneMaps) {
        context.conv_pool_for(
            threads,
            &self.conv1,
            &self.conv2,
            &maps.crop,
            &mut maps.pool1,
        );
        context.conv_pool_for(
            threads,
            &self.conv2,
            &self.conv3,
            &maps.pool1,
            &mut maps.pool2,
        );
        context.conv_for(
            threads,
            &self.conv3,
            &self.conv4,
            &maps.pool2,
            &mut maps.conv3,
        );
        context.conv_for(
            threads,
            &self.conv4,
            &self.conv5,
            &maps.conv3,
            &mut maps.conv4,
        );
        context.conv(threads, &self.conv5, &maps.conv4, &mut maps.conv5);
    }
}
