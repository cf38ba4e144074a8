//! One map of activations, as floats or as bytes.

use kernels::conv::{Algorithm, Conv, Input, Output, SLACK};
use kernels::{Aligned, Size};

/// Activations of one layer: `[size.h, size.w, channels]`.
#[derive(Clone, Debug)]
pub struct Map {
    values: Aligned<f32>,
    bytes: Aligned<u8>, // used in place of `values` where the next layer reads bytes
    size: Size,
    channels: usize,
}

impl Default for Map {
    fn default() -> Map {
        Map {
            values: Aligned::default(),
            bytes: Aligned::default(),
            size: Size { h: 0, w: 0 },
            channels: 0,
        }
    }
}

impl Map {
    /// All values in HWC order; empty where two `int8` convolutions exchange bytes.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// All values in HWC order, mutable.
    pub(crate) fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// Height and width.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Number of channels.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Writes the mean of every channel over all cells into `means`.
    pub(crate) fn channel_means(&self, means: &mut Vec<f32>) {
        means.clear();
        means.resize(self.channels, 0.0);
        for cell in self.values.chunks_exact(self.channels.max(1)) {
            for (sum, value) in means.iter_mut().zip(cell) {
                *sum += value;
            }
        }
        let cells = self.size.area().max(1) as f32;
        for sum in means {
            *sum /= cells;
        }
    }

    /// Copies the window of `size` that starts at (`row`, `column`) of a map of floats.
    pub(crate) fn copy_window(&mut self, from: &Map, size: Size, row: usize, column: usize) {
        let row_len = from.size.w * from.channels;
        let start = column * from.channels;
        let len = size.w * from.channels;
        let rows = from.values.chunks_exact(row_len).skip(row);
        let window = self.reshape(size, from.channels).chunks_exact_mut(len);
        for (to, from) in window.zip(rows) {
            to.copy_from_slice(&from[start..start + len]);
        }
    }

    /// Takes a new shape; allocates only beyond the largest shape so far.
    pub(crate) fn reshape(&mut self, size: Size, channels: usize) -> &mut [f32] {
        self.bytes.clear();
        self.values.resize(size.area() * channels);
        self.size = size;
        self.channels = channels;
        &mut self.values
    }

    /// Takes a new shape for bytes.
    pub(crate) fn reshape_bytes(&mut self, size: Size, channels: usize) -> &mut [u8] {
        let len = size.area() * channels;
        self.values.clear();
        self.bytes.resize(len + SLACK);
        self.size = size;
        self.channels = channels;
        &mut self.bytes[..len]
    }

    /// Where `conv` writes what `next` reads: bytes if both compute in `int8`, else floats.
    pub(crate) fn output(&mut self, size: Size, conv: &Conv, next: &Conv) -> Output<'_> {
        let channels = conv.shape().out_channels;
        match (conv.algorithm(), next.algorithm()) {
            (Algorithm::Int8(_), Algorithm::Int8(quantization)) => {
                Output::Bytes(self.reshape_bytes(size, channels), quantization)
            }
            _ => Output::Floats(self.reshape(size, channels)),
        }
    }

    /// What the next convolution reads.
    pub(crate) fn input(&self) -> Input<'_> {
        if self.bytes.is_empty() {
            Input::Floats(&self.values)
        } else {
            Input::Bytes(&self.bytes)
        }
    }
}
