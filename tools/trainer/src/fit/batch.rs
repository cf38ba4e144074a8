//! From samples to tensors.

use crate::data::Sample;
use crate::network::{Batch, INPUT};
use crate::targets::{Cells, Targets};
use autodiff::Tensor;
use weights_format::Architecture;

/// A batch of samples whose search crops have one size.
pub fn batch(samples: &[Sample], architecture: &Architecture) -> Batch {
    let size = samples
        .first()
        .map_or(architecture.search_size, |sample| sample.search_size);
    let cells = Cells::of(architecture, size);
    let items: Vec<_> = samples
        .iter()
        .map(|sample| (sample.corners, sample.negative))
        .collect();
    let (template, search) = crops_of(samples, architecture);
    Batch {
        template,
        search,
        again: crops(samples.iter().map(|s| &s.again), architecture.template_size),
        positive: samples.iter().map(|sample| !sample.negative).collect(),
        targets: Targets::new(&items, cells),
        cells,
    }
}

/// Template and search crops of samples whose search crops have one size, normalized.
pub fn crops_of(samples: &[Sample], architecture: &Architecture) -> (Tensor, Tensor) {
    let size = samples
        .first()
        .map_or(architecture.search_size, |sample| sample.search_size);
    (
        crops(
            samples.iter().map(|s| &s.template),
            architecture.template_size,
        ),
        crops(samples.iter().map(|s| &s.search), size),
    )
}

/// Crops of bytes as one tensor `[batch, side, side, 3]`, normalized.
fn crops<'a>(crops: impl Iterator<Item = &'a Vec<u8>>, side: usize) -> Tensor {
    let (mean, std) = (INPUT.mean[0], INPUT.std[0]);
    let table: [f32; 256] = std::array::from_fn(|value| (value as f32 - mean) / std);
    let mut values = Vec::new();
    let mut count = 0;
    for crop in crops {
        values.extend(crop.iter().map(|value| table[usize::from(*value)]));
        count += 1;
    }
    Tensor::new(&[count, side, side, 3], values)
}
