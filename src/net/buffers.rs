//! Every buffer of a forward pass. The first pass sizes them; later passes allocate nothing.

use super::backbone::BackboneMaps;
use super::context::Contexts;
use super::head::HeadMaps;
use super::map::Map;
use super::neck::TaskMaps;
use kernels::conv::{Algorithm, Conv};
use kernels::{Isa, Size, pointwise};

/// The buffers of one network.
#[derive(Debug)]
pub(crate) struct Buffers {
    pub contexts: Contexts,
    pub backbone: BackboneMaps,
    pub encoded: Map,
    pub neck: TaskMaps,
    pub response: TaskMaps,
    pub head: HeadMaps,
    pub window: Map, // of the search region's features, for the template update
    pub template_neck: TaskMaps,
}

impl Buffers {
    pub(crate) fn new(isa: Isa) -> Buffers {
        Buffers {
            contexts: Contexts::new(isa),
            backbone: BackboneMaps::default(),
            encoded: Map::default(),
            neck: TaskMaps::default(),
            response: TaskMaps::default(),
            head: HeadMaps::default(),
            window: Map::default(),
            template_neck: TaskMaps::default(),
        }
    }

    /// Makes `crop` (`[side, side, 3]`) the backbone's input, in the type that `conv1` reads.
    pub(crate) fn set_crop(&mut self, crop: &[u8], side: usize, conv1: &Conv) {
        let map = &mut self.backbone.crop;
        let size = Size::square(side);
        match conv1.algorithm() {
            Algorithm::Int8(_) => map.reshape_bytes(size, 3).copy_from_slice(crop),
            _ => pointwise::widen(crop, map.reshape(size, 3)),
        }
    }

    /// Every map of a search pass by its layer's name.
    pub(crate) fn maps(&self) -> impl Iterator<Item = (&'static str, &Map)> {
        let backbone = &self.backbone;
        let head = &self.head;
        [
            ("crop", &backbone.crop),
            ("backbone.pool1", &backbone.pool1),
            ("backbone.pool2", &backbone.pool2),
            ("backbone.conv3", &backbone.conv3),
            ("backbone.conv4", &backbone.conv4),
            ("backbone.conv5", &backbone.conv5),
            ("dr.e2.0", &self.encoded),
            ("neck.search_cls", &self.neck.cls),
            ("neck.search_reg", &self.neck.reg),
            ("correlation.cls", &self.response.cls),
            ("correlation.reg", &self.response.reg),
            ("head.cls1", &head.cls[0]),
            ("head.cls2", &head.cls[1]),
            ("head.cls3", &head.cls[2]),
            ("head.reg1", &head.reg[0]),
            ("head.reg2", &head.reg[1]),
            ("head.reg3", &head.reg[2]),
            ("head.score", &head.score),
            ("head.centerness", &head.centerness),
            ("head.offsets", &head.offsets),
        ]
        .into_iter()
    }
}
