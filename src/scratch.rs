//! Every buffer that a pass needs. The first pass sizes them; no later one allocates.

use crate::net::backbone::BackboneMaps;
use crate::net::dr::DrMaps;
use crate::net::head::HeadMaps;
use crate::net::neck::NeckMaps;
use kernels::conv::Conv;
use kernels::par::Threads;
use kernels::{Isa, Size, pointwise, pool, xcorr};

/// One map of activations: `[size.h, size.w, channels]`.
#[derive(Clone, Debug)]
pub struct Map {
    values: Vec<f32>,
    size: Size,
    channels: usize,
}

impl Default for Map {
    fn default() -> Map {
        Map { values: Vec::new(), size: Size { h: 0, w: 0 }, channels: 0 }
    }
}

impl Map {
    /// All values, HWC.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// Height and width.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Channels.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Takes a new shape; allocates only beyond the largest one so far.
    fn reshape(&mut self, size: Size, channels: usize) -> &mut [f32] {
        self.values.resize(size.area() * channels, 0.0);
        (self.size, self.channels) = (size, channels);
        &mut self.values
    }
}

/// What every layer call needs besides its maps.
#[derive(Debug)]
pub(crate) struct Context {
    isa: Isa,
    conv: Vec<f32>, // padding and patches of the convolution at work
}

impl Context {
    pub(crate) fn conv(&mut self, threads: &Threads, conv: &Conv, from: &Map, to: &mut Map) {
        let shape = conv.shape();
        let out = to.reshape(shape.out_size(from.size), shape.out_channels);
        let needed = conv.scratch_len(from.size, threads);
        if self.conv.len() < needed {
            self.conv.resize(needed, 0.0);
        }
        conv.run(threads, &from.values, from.size, out, &mut self.conv[..needed]);
    }

    pub(crate) fn max_pool(&self, threads: &Threads, from: &Map, to: &mut Map) {
        let out = to.reshape(pool::out_size(from.size), from.channels);
        pool::max_pool(self.isa, threads, &from.values, from.size, from.channels, out);
    }

    pub(crate) fn xcorr(&self, threads: &Threads, search: &Map, template: &Map, to: &mut Map) {
        let (size, kernel) = (search.size, template.size);
        let out_size = Size { h: size.h - kernel.h + 1, w: size.w - kernel.w + 1 };
        let out = to.reshape(out_size, search.channels);
        xcorr::xcorr(self.isa, threads, &search.values, size, &template.values, kernel, search.channels, out);
    }
}

/// The buffers of one network.
#[derive(Debug)]
pub(crate) struct Scratch {
    pub context: Context,
    pub backbone: BackboneMaps,
    pub encoded: DrMaps,
    pub encoded_neck: [DrMaps; 2],
    pub neck: NeckMaps,
    pub response: NeckMaps,
    pub head: HeadMaps,
}

impl Scratch {
    pub(crate) fn new(isa: Isa) -> Scratch {
        Scratch {
            context: Context { isa, conv: Vec::new() },
            backbone: BackboneMaps::default(),
            encoded: DrMaps::default(),
            encoded_neck: Default::default(),
            neck: NeckMaps::default(),
            response: NeckMaps::default(),
            head: HeadMaps::default(),
        }
    }

    /// Makes `crop` (`[side, side, 3]`) the backbone's input.
    pub(crate) fn set_crop(&mut self, crop: &[u8], side: usize) {
        pointwise::widen(crop, self.backbone.crop.reshape(Size::square(side), 3));
    }

    /// Every map by its layer's name.
    pub(crate) fn maps(&self) -> impl Iterator<Item = (&'static str, &Map)> {
        let (b, h) = (&self.backbone, &self.head);
        [
            ("crop", &b.crop),
            ("backbone.conv1", &b.conv1),
            ("backbone.pool1", &b.pool1),
            ("backbone.conv2", &b.conv2),
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
