//! Every buffer that a pass needs. The first pass sizes them; no later one allocates.

use crate::net::backbone::BackboneMaps;
use crate::net::dr::DrMaps;
use crate::net::head::HeadMaps;
use crate::net::neck::NeckMaps;
use kernels::conv::{Algorithm, Conv, Input, Output, SLACK};
use kernels::par::Threads;
use kernels::{Aligned, Isa, Size, pointwise, pool, xcorr};

/// One map of activations: `[size.h, size.w, channels]`.
#[derive(Clone, Debug)]
pub struct Map {
    values: Aligned<f32>,
    bytes: Aligned<u8>, // instead of `values`, where the next layer reads bytes
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
    /// All values, HWC; none where they pass as bytes from one `int8` convolution to the next.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// All values, to be changed.
    pub(crate) fn values_mut(&mut self) -> &mut [f32] {
        &mut self.values
    }

    /// Height and width.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Channels.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Mean of every channel over the cells, into `means`.
    pub(crate) fn channel_means(&self, means: &mut Vec<f32>) {
        means.clear();
        means.resize(self.channels, 0.0);
        for cell in self.values.chunks_exact(self.channels.max(1)) {
            means
                .iter_mut()
                .zip(cell)
                .for_each(|(sum, value)| *sum += value);
        }
        let cells = self.size.area().max(1) as f32;
        means.iter_mut().for_each(|sum| *sum /= cells);
    }

    /// Becomes the window of `size` that starts at (`row`, `column`) of a map of floats.
    pub(crate) fn copy_window(&mut self, from: &Map, size: Size, row: usize, column: usize) {
        let (row_len, start) = (from.size.w * from.channels, column * from.channels);
        let len = size.w * from.channels;
        let rows = from.values.chunks_exact(row_len).skip(row);
        for (to, from) in self
            .reshape(size, from.channels)
            .chunks_exact_mut(len)
            .zip(rows)
        {
            to.copy_from_slice(&from[start..start + len]);
        }
    }

    /// Takes a new shape; allocates only beyond the largest one so far.
    pub(crate) fn reshape(&mut self, size: Size, channels: usize) -> &mut [f32] {
        self.bytes.clear();
        self.values.resize(size.area() * channels);
        (self.size, self.channels) = (size, channels);
        &mut self.values
    }

    /// Takes a new shape for bytes.
    fn reshape_bytes(&mut self, size: Size, channels: usize) -> &mut [u8] {
        let len = size.area() * channels;
        self.values.clear();
        self.bytes.resize(len + SLACK);
        (self.size, self.channels) = (size, channels);
        &mut self.bytes[..len]
    }

    /// Room for what `conv` writes and `next` reads: bytes, if both compute in them.
    fn output(&mut self, size: Size, conv: &Conv, next: &Conv) -> Output<'_> {
        let channels = conv.shape().out_channels;
        match (conv.algorithm(), next.algorithm()) {
            (Algorithm::Int8(_), Algorithm::Int8(quantization)) => {
                Output::Bytes(self.reshape_bytes(size, channels), quantization)
            }
            _ => Output::Floats(self.reshape(size, channels)),
        }
    }

    /// What the next convolution reads.
    fn input(&self) -> Input<'_> {
        if self.bytes.is_empty() {
            Input::Floats(&self.values)
        } else {
            Input::Bytes(&self.bytes)
        }
    }
}

/// What every layer call needs besides its maps.
#[derive(Debug)]
pub(crate) struct Context {
    isa: Isa,
    conv: Aligned<f32>, // padding and patches of the convolution at work
}

impl Context {
    pub(crate) fn conv(&mut self, threads: &Threads, conv: &Conv, from: &Map, to: &mut Map) {
        let out = to.reshape(conv.shape().out_size(from.size), conv.shape().out_channels);
        let scratch = self.scratch(conv.scratch_len(from.size, threads));
        conv.run_between(
            threads,
            from.input(),
            from.size,
            Output::Floats(out),
            scratch,
        );
    }

    /// A convolution whose output `next` reads, and nobody else: as bytes, if both compute in them.
    pub(crate) fn conv_for(
        &mut self,
        threads: &Threads,
        conv: &Conv,
        next: &Conv,
        from: &Map,
        to: &mut Map,
    ) {
        let out = to.output(conv.shape().out_size(from.size), conv, next);
        let scratch = self.scratch(conv.scratch_len(from.size, threads));
        conv.run_between(threads, from.input(), from.size, out, scratch);
    }

    /// The same with the max-pool behind the convolution, which `next` reads.
    pub(crate) fn conv_pool_for(
        &mut self,
        threads: &Threads,
        conv: &Conv,
        next: &Conv,
        from: &Map,
        to: &mut Map,
    ) {
        let out = to.output(pool::out_size(conv.shape().out_size(from.size)), conv, next);
        let scratch = self.scratch(conv.pooled_scratch_len(from.size, threads));
        conv.run_pooled(threads, from.input(), from.size, out, scratch);
    }

    fn scratch(&mut self, len: usize) -> &mut [f32] {
        if self.conv.len() < len {
            self.conv.resize(len);
        }
        &mut self.conv[..len]
    }

    pub(crate) fn xcorr(&self, threads: &Threads, search: &Map, template: &Map, to: &mut Map) {
        let (size, kernel) = (search.size, template.size);
        let out_size = Size {
            h: size.h - kernel.h + 1,
            w: size.w - kernel.w + 1,
        };
        let out = to.reshape(out_size, search.channels);
        xcorr::xcorr(
            self.isa,
            threads,
            &search.values,
            size,
            &template.values,
            kernel,
            search.channels,
            out,
        );
    }
}

/// The buffers of one network.
#[derive(Debug)]
pub(crate) struct Scratch {
    pub contexts: [Context; 2], // one for each task; all else takes the first
    pub backbone: BackboneMaps,
    pub encoded: DrMaps,
    pub encoded_neck: [DrMaps; 2],
    pub neck: NeckMaps,
    pub response: NeckMaps,
    pub head: HeadMaps,
    pub window: Map, // of the search region's features, to update the template
    pub template_neck: NeckMaps,
}

impl Scratch {
    pub(crate) fn new(isa: Isa) -> Scratch {
        Scratch {
            contexts: [(); 2].map(|()| Context {
                isa,
                conv: Aligned::default(),
            }),
            backbone: BackboneMaps::default(),
            encoded: DrMaps::default(),
            encoded_neck: Default::default(),
            neck: NeckMaps::default(),
            response: NeckMaps::default(),
            head: HeadMaps::default(),
            window: Map::default(),
            template_neck: NeckMaps::default(),
        }
    }

    /// Makes `crop` (`[side, side, 3]`) the backbone's input, which `conv1` reads.
    pub(crate) fn set_crop(&mut self, crop: &[u8], side: usize, conv1: &Conv) {
        let map = &mut self.backbone.crop;
        match conv1.algorithm() {
            Algorithm::Int8(_) => map
                .reshape_bytes(Size::square(side), 3)
                .copy_from_slice(crop),
            _ => pointwise::widen(crop, map.reshape(Size::square(side), 3)),
        }
    }

    /// Every map by its layer's name.
    pub(crate) fn maps(&self) -> impl Iterator<Item = (&'static str, &Map)> {
        let (b, h) = (&self.backbone, &self.head);
        [
            ("crop", &b.crop),
            ("backbone.pool1", &b.pool1),
            ("backbone.pool2", &b.pool2),
            ("backbone.conv3", &b.conv3),
            ("backbone.conv4", &b.conv4),
            ("backbone.conv5", &b.conv5),
            ("dr.e2.0", &self.encoded[0]),
            ("dr.e2.1", &self.encoded[1]),
            ("neck.search_cls", &self.neck.cls),
            ("neck.search_reg", &self.neck.reg),
            ("correlation.cls", &self.response.cls),
            ("correlation.reg", &self.response.reg),
            ("head.cls1", &h.cls[0]),
            ("head.cls2", &h.cls[1]),
            ("head.cls3", &h.cls[2]),
            ("head.reg1", &h.reg[0]),
            ("head.reg2", &h.reg[1]),
            ("head.reg3", &h.reg[2]),
            ("head.score", &h.score),
            ("head.centerness", &h.centerness),
            ("head.offsets", &h.offsets),
        ]
        .into_iter()
    }
}
