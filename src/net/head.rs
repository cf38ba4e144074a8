//! The head: a tower of three 3x3 convolutions per task, then 1x1 outputs.
//!
//! `2 x [23, 23, N] -> [17, 17, 1 + 1 + 4]`.

use super::context::{Context, Contexts};
use super::map::Map;
use super::neck::TaskMaps;
use kernels::conv::Conv;
use kernels::par::Threads;
use kernels::pointwise::{scaled_exp, sigmoid};
use weights_format::Architecture;

/// The head's convolutions.
#[derive(Debug)]
pub(crate) struct Head {
    pub cls: [Conv; 3],
    pub reg: [Conv; 3],
    pub score: Conv,
    pub centerness: Conv,
    pub offsets: Conv,
}

/// The output of each layer; the last three are logits.
#[derive(Debug, Default)]
pub(crate) struct HeadMaps {
    pub cls: [Map; 3],   // sides 21, 19, 17
    pub reg: [Map; 3],   // likewise
    pub score: Map,      // [17, 17, 1]
    pub centerness: Map, // [17, 17, 1]
    pub offsets: Map,    // [17, 17, 4]
}

/// What the network says about every cell of the score map, row by row.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outputs {
    /// Classification score times centerness, in `[0, 1]`: `[cells]`.
    pub score: Vec<f32>,
    /// Distances from the cell's center to the box's left, top, right and bottom edge in crop
    /// pixels: `[cells, 4]`.
    pub ltrb: Vec<f32>,
}

impl Head {
    /// Runs on the correlations of both tasks, side by side.
    pub(crate) fn run(
        &self,
        contexts: &mut Contexts,
        threads: &Threads,
        response: &TaskMaps,
        maps: &mut HeadMaps,
        outputs: &mut Outputs,
    ) {
        let HeadMaps {
            cls,
            reg,
            score,
            centerness,
            offsets,
        } = maps;
        threads.both(
            contexts.both(),
            |threads, context| {
                tower(&self.cls, context, threads, &response.cls, cls);
                context.conv(threads, &self.score, &cls[2], score);
                context.conv(threads, &self.centerness, &cls[2], centerness);
            },
            |threads, context| {
                tower(&self.reg, context, threads, &response.reg, reg);
                context.conv(threads, &self.offsets, &reg[2], offsets);
            },
        );

        // From logits to a score in [0, 1] and to distances in crop pixels.
        outputs.ltrb.resize(maps.offsets.values().len(), 0.0);
        outputs.ltrb.copy_from_slice(maps.offsets.values());
        scaled_exp(&mut outputs.ltrb, Architecture::TOTAL_STRIDE as f32);
        outputs.score.resize(maps.score.values().len(), 0.0);
        let logits = maps.score.values().iter().zip(maps.centerness.values());
        for (value, (score, centerness)) in outputs.score.iter_mut().zip(logits) {
            *value = sigmoid(*score) * sigmoid(*centerness);
        }
    }
}

/// Runs one task's three convolutions.
fn tower(
    convs: &[Conv; 3],
    context: &mut Context,
    threads: &Threads,
    response: &Map,
    maps: &mut [Map; 3],
) {
    let [a, b, c] = maps;
    context.conv_for(threads, &convs[0], &convs[1], response, a);
    context.conv_for(threads, &convs[1], &convs[2], a, b);
    context.conv(threads, &convs[2], b, c);
}
