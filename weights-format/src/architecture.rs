//! The network's architecture: widths, encoder, crop sizes, and the list of layers.
//!
//! Shapes, parameter counts and multiply-accumulates (MACs) are computed here and nowhere else, so
//! that the reader, the converter, the trainer and `info` cannot disagree.

use serde::{Deserialize, Serialize};

/// Output channels of every 3x3-or-larger convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Widths {
    /// `conv1` to `conv5`.
    pub backbone: [usize; 5],
    /// Classification neck. Template and search side are correlated, so they share the width.
    pub neck_cls: usize,
    /// Regression neck, also shared by template and search side.
    pub neck_reg: usize,
    /// The three convolutions of the classification tower.
    pub head_cls: [usize; 3],
    /// The three convolutions of the regression tower.
    pub head_reg: [usize; 3],
}

impl Widths {
    /// The unpruned SiamFC++-AlexNet: 96/256/384/384/256 in the backbone, 256 everywhere after it.
    pub const FULL: Widths = Widths::uniform([96, 256, 384, 384, 256], 256);

    /// The given backbone widths, and one width for neck and head.
    pub const fn uniform(backbone: [usize; 5], n: usize) -> Widths {
        Widths {
            backbone,
            neck_cls: n,
            neck_reg: n,
            head_cls: [n; 3],
            head_reg: [n; 3],
        }
    }

    /// [`Widths::FULL`] after pruning every layer with one global `ratio` in `[0, 1)`.
    ///
    /// A layer of `C` filters keeps `floor(C * (1 - ratio))`.
    /// Source: paper section III-C; docs/method.md, section 1.6.
    pub fn pruned(ratio: f64) -> Widths {
        // No tenth but 0 and 5 is exact in binary: the tenths and the small addend keep a product
        // that should be whole from falling just below it.
        let keep = |c: usize| (c as f64 * (10.0 - 10.0 * ratio) / 10.0 + 1e-9).floor() as usize;
        Widths::uniform(Widths::FULL.backbone.map(keep), keep(256))
    }

    /// The pruning ratio among 0.0, 0.1 .. 0.9 that gives these widths; `None` if there is none.
    pub fn pruning_ratio(&self) -> Option<f64> {
        (0..10)
            .map(|tenths| f64::from(tenths) / 10.0)
            .find(|&r| Widths::pruned(r) == *self)
    }

    /// Every width in the file's order: backbone, neck, classification tower, regression tower.
    pub fn all(&self) -> [usize; 13] {
        let mut all = [0; 13];
        all[..5].copy_from_slice(&self.backbone);
        all[5] = self.neck_cls;
        all[6] = self.neck_reg;
        all[7..10].copy_from_slice(&self.head_cls);
        all[10..].copy_from_slice(&self.head_reg);
        all
    }
}

/// Position of the identity-related encoder E2.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EncoderPosition {
    /// Between backbone and neck.
    #[default]
    BeforeNeck,
    /// On the neck's outputs, a reading of the paper's Eq. 1 that no file uses;
    /// [`Architecture::check`] refuses it.
    AfterNeck,
}

/// The identity-related encoder E2: a convolution with "same" padding and bias.
///
/// Files state `layers`, `shared` and `position` with the only values that
/// [`Architecture::check`] accepts.
/// Source: paper section III-A; docs/method.md, section 1.7.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Encoder {
    /// Side of the square kernel: 1 or 3; padding is `kernel / 2`.
    pub kernel: usize,
    /// Number of convolutions: 1.
    pub layers: usize,
    /// Output channels.
    pub width: usize,
    /// Whether a ReLU follows.
    pub relu: bool,
    /// Whether template and search branch share one E2: true.
    pub shared: bool,
    /// Position in the network: before the neck.
    pub position: EncoderPosition,
}

impl Encoder {
    /// One shared 3x3 convolution with pad 1 and ReLU.
    pub const fn standard(width: usize) -> Encoder {
        Encoder {
            kernel: 3,
            layers: 1,
            width,
            relu: true,
            shared: true,
            position: EncoderPosition::BeforeNeck,
        }
    }
}

/// Everything that determines the tensors of a weights file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Architecture {
    /// Channels per layer.
    pub widths: Widths,
    /// `None` is the P-SiamFC++ family, which a file states with an explicit `null`.
    #[serde(deserialize_with = "Option::deserialize")]
    pub encoder: Option<Encoder>,
    /// Side of the template crop in pixels.
    pub template_size: usize,
    /// Side of the search crop in pixels.
    pub search_size: usize,
}

/// What a layer computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LayerKind {
    /// Convolution with bias.
    Conv,
    /// 3x3 maximum, stride 2, no padding, ceil mode.
    Pool,
    /// Depthwise cross-correlation with the cached template features.
    Correlation,
}

/// The crops that a layer works on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Branch {
    /// Template and search crop, with the same weights.
    Both,
    /// The template crop, once per `init`.
    Template,
    /// The search crop, once per frame.
    Search,
}

/// One layer with its shapes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Name of the layer; a convolution's tensors are `<name>.weight` and `<name>.bias`.
    pub name: String,
    /// What the layer computes.
    pub kind: LayerKind,
    /// Names of the layers whose outputs it reads; none for the first, which reads the crop.
    pub inputs: Vec<String>,
    /// The crops that it works on.
    pub branch: Branch,
    /// Input channels.
    pub in_channels: usize,
    /// Output channels.
    pub out_channels: usize,
    /// Side of the square kernel.
    pub kernel: usize,
    /// Stride in both directions.
    pub stride: usize,
    /// Zero padding on all four sides.
    pub pad: usize,
    /// Whether a ReLU follows.
    pub relu: bool,
    /// Whether batch normalization (BN) follows in training; a weights file has it folded in.
    pub bn: bool,
    /// Side of the output map for the template crop; 0 where the layer does not run on it.
    pub out_template: usize,
    /// Side of the output map for the search crop; 0 where the layer does not run on it.
    pub out_search: usize,
}

impl Layer {
    /// Trainable parameters as papers count them: weights, biases, BN's scale and shift.
    pub fn parameters(&self) -> usize {
        if self.kind != LayerKind::Conv {
            return 0;
        }
        let per_output =
            self.in_channels * self.kernel * self.kernel + 1 + 2 * usize::from(self.bn);
        per_output * self.out_channels
    }

    /// Shape of `<name>.weight`: `[Cout, kh, kw, Cin]` (OHWI).
    pub fn weight_shape(&self) -> [usize; 4] {
        [
            self.out_channels,
            self.kernel,
            self.kernel,
            self.in_channels,
        ]
    }

    /// Multiply-accumulates on the template crop.
    pub fn macs_template(&self) -> u64 {
        self.macs(self.out_template)
    }

    /// Multiply-accumulates on the search crop.
    pub fn macs_search(&self) -> u64 {
        self.macs(self.out_search)
    }

    /// This layer with `channels` outputs on maps of these sides.
    fn with(self, channels: usize, out: Sides) -> Layer {
        Layer {
            out_channels: channels,
            out_template: out.template,
            out_search: out.search,
            ..self
        }
    }

    fn macs(&self, side: usize) -> u64 {
        let per_pixel = match self.kind {
            LayerKind::Conv => self.in_channels * self.out_channels * self.kernel * self.kernel,
            LayerKind::Correlation => self.out_channels * self.kernel * self.kernel,
            LayerKind::Pool => 0,
        };
        (per_pixel * side * side) as u64
    }
}

/// Why an [`Architecture`] cannot be built.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("architecture: {field} is {found}, expected {expected}")]
pub struct ArchitectureError {
    /// The offending field.
    pub field: String,
    /// What was found there.
    pub found: String,
    /// What would have been accepted.
    pub expected: String,
}

impl Architecture {
    /// Widest layer accepted, which bounds what an untrusted file can allocate.
    pub const MAX_WIDTH: usize = 2048;
    /// Largest crop side accepted, which bounds what an untrusted file can allocate.
    pub const MAX_CROP: usize = 1024;

    /// DR-MIM's geometry (template 127, search 303) with the given widths and encoder.
    pub const fn new(widths: Widths, encoder: Option<Encoder>) -> Architecture {
        Architecture {
            widths,
            encoder,
            template_size: 127,
            search_size: 303,
        }
    }

    /// Product of all strides.
    pub const TOTAL_STRIDE: usize = 8;

    /// Checks every bound. An architecture that passes can be laid out and run.
    ///
    /// # Errors
    /// Names the first field that is out of range.
    pub fn check(&self) -> Result<(), ArchitectureError> {
        let wrong = |field: &str, found: &dyn ToString, expected: String| {
            Err(ArchitectureError {
                field: field.into(),
                found: found.to_string(),
                expected,
            })
        };
        let width = format!("1..={}", Self::MAX_WIDTH);
        for (i, w) in self.widths.all().into_iter().enumerate() {
            if !(1..=Self::MAX_WIDTH).contains(&w) {
                return wrong(&format!("widths[{i}]"), &w, width);
            }
        }
        let (z, x) = (self.template_size, self.search_size);
        if !(103..=Self::MAX_CROP).contains(&z) {
            return wrong("template_size", &z, format!("103..={}", Self::MAX_CROP));
        }
        if !(z..=Self::MAX_CROP).contains(&x) {
            return wrong("search_size", &x, format!("{z}..={}", Self::MAX_CROP));
        }
        if let Some(encoder) = &self.encoder {
            if ![1, 3].contains(&encoder.kernel) {
                return wrong("encoder.kernel", &encoder.kernel, "1 or 3".into());
            }
            if encoder.layers != 1 {
                return wrong("encoder.layers", &encoder.layers, "1".into());
            }
            if !(1..=Self::MAX_WIDTH).contains(&encoder.width) {
                return wrong("encoder.width", &encoder.width, width);
            }
            if !encoder.shared {
                let expected = "true: one encoder for template and search branch";
                return wrong("encoder.shared", &false, expected.into());
            }
            if encoder.position != EncoderPosition::BeforeNeck {
                return wrong("encoder.position", &"after_neck", "before_neck".into());
            }
        }
        // The towers shrink the response by 6. Sizes only ever shrink, so the last one decides.
        let backbone = backbone_sides(x)[6];
        let template = backbone_sides(z)[6] - 2;
        if backbone - 2 < template + 6 {
            return wrong("search_size", &x, format!("at least {}", z + 48));
        }
        Ok(())
    }

    /// Side of the square score map.
    pub fn score_size(&self) -> usize {
        self.layers()
            .last()
            .expect("an architecture has layers")
            .out_search
    }

    /// Crop pixel of the first score cell's center, along either axis.
    ///
    /// Source: docs/method.md, section 2.4.
    pub fn score_offset(&self) -> usize {
        (self.search_size - 1 - (self.score_size() - 1) * Self::TOTAL_STRIDE) / 2
    }

    /// Every layer in execution order; the last one's `out_search` is the score map's side.
    ///
    /// Expects an architecture that passed [`check`](Self::check).
    pub fn layers(&self) -> Vec<Layer> {
        let mut layers = self.backbone();
        let template = backbone_sides(self.template_size)[6];
        let search = backbone_sides(self.search_size)[6];
        let mut features = Source::of("backbone.conv5", self.widths.backbone[4]);
        if let Some(encoder) = &self.encoder {
            let out = Sides { template, search };
            let e2 = conv("dr.e2.0", Branch::Both, encoder.kernel, &features);
            layers.push(Layer {
                pad: encoder.kernel / 2,
                relu: encoder.relu,
                bn: true,
                ..e2.with(encoder.width, out)
            });
            features = Source::of("dr.e2.0", encoder.width);
        }
        layers.extend(self.neck(&features, template - 2, search - 2));
        layers.extend(self.head(template - 2, search - 2));
        layers
    }

    /// `backbone.conv1` to `backbone.conv5` with the two pools.
    fn backbone(&self) -> Vec<Layer> {
        let template = backbone_sides(self.template_size);
        let search = backbone_sides(self.search_size);
        let [c1, c2, c3, c4, c5] = self.widths.backbone;
        let mut layers = Vec::with_capacity(24);
        let mut source = Source::CROP;
        for (i, (name, kind, kernel, stride, width)) in [
            ("backbone.conv1", LayerKind::Conv, 11, 2, c1),
            ("backbone.pool1", LayerKind::Pool, 3, 2, c1),
            ("backbone.conv2", LayerKind::Conv, 5, 1, c2),
            ("backbone.pool2", LayerKind::Pool, 3, 2, c2),
            ("backbone.conv3", LayerKind::Conv, 3, 1, c3),
            ("backbone.conv4", LayerKind::Conv, 3, 1, c4),
            ("backbone.conv5", LayerKind::Conv, 3, 1, c5),
        ]
        .into_iter()
        .enumerate()
        {
            let out = Sides {
                template: template[i],
                search: search[i],
            };
            let is_conv = kind == LayerKind::Conv;
            layers.push(Layer {
                kind,
                stride,
                relu: is_conv && name != "backbone.conv5",
                bn: is_conv,
                ..conv(name, Branch::Both, kernel, &source).with(width, out)
            });
            source = Source::of(name, width);
        }
        layers
    }

    /// One convolution per branch and task; `template` and `search` are the sides of the outputs.
    fn neck(&self, features: &Source, template: usize, search: usize) -> Vec<Layer> {
        let Widths {
            neck_cls, neck_reg, ..
        } = self.widths;
        let mut layers = Vec::with_capacity(4);
        for (name, branch, width) in [
            ("neck.template_cls", Branch::Template, neck_cls),
            ("neck.template_reg", Branch::Template, neck_reg),
            ("neck.search_cls", Branch::Search, neck_cls),
            ("neck.search_reg", Branch::Search, neck_reg),
        ] {
            let out = Sides { template, search }.only(branch);
            layers.push(Layer {
                bn: true,
                ..conv(name, branch, 3, features).with(width, out)
            });
        }
        layers
    }

    /// Both correlations, both towers and the three outputs; `template` and `search` are the
    /// sides of the neck's outputs.
    fn head(&self, template: usize, search: usize) -> Vec<Layer> {
        let w = &self.widths;
        let response = search - template + 1;
        let mut layers = Vec::with_capacity(11);
        for (task, width) in [("cls", w.neck_cls), ("reg", w.neck_reg)] {
            let name = format!("correlation.{task}");
            let features = Source::of(&format!("neck.search_{task}"), width);
            let mut layer = conv(&name, Branch::Search, template, &features)
                .with(width, Sides::search(response));
            layer.kind = LayerKind::Correlation;
            layer.inputs.push(format!("neck.template_{task}"));
            layers.push(layer);
        }
        for (task, width, widths) in [
            ("cls", w.neck_cls, w.head_cls),
            ("reg", w.neck_reg, w.head_reg),
        ] {
            let mut source = Source::of(&format!("correlation.{task}"), width);
            for (i, width) in widths.into_iter().enumerate() {
                let name = format!("head.{task}{}", i + 1);
                let out = Sides::search(response - 2 * (i + 1));
                layers.push(Layer {
                    relu: true,
                    bn: i == 2,
                    ..conv(&name, Branch::Search, 3, &source).with(width, out)
                });
                source = Source::of(&name, width);
            }
        }
        for (name, tower, channels, width) in [
            ("head.score", "head.cls3", w.head_cls[2], 1),
            ("head.centerness", "head.cls3", w.head_cls[2], 1),
            ("head.offsets", "head.reg3", w.head_reg[2], 4),
        ] {
            let source = Source::of(tower, channels);
            let out = Sides::search(response - 6);
            layers.push(Layer {
                bn: true,
                ..conv(name, Branch::Search, 1, &source).with(width, out)
            });
        }
        layers
    }

    /// Name and shape of every tensor in execution order.
    ///
    /// Each convolution has a weight `[Cout, kh, kw, Cin]` and a bias `[Cout]`.
    /// Expects an architecture that passed [`check`](Self::check).
    pub fn tensors(&self) -> Vec<(String, Vec<usize>)> {
        let convolutions = self
            .layers()
            .into_iter()
            .filter(|layer| layer.kind == LayerKind::Conv);
        convolutions
            .flat_map(|layer| {
                [
                    (
                        format!("{}.weight", layer.name),
                        layer.weight_shape().to_vec(),
                    ),
                    (format!("{}.bias", layer.name), vec![layer.out_channels]),
                ]
            })
            .collect()
    }

    /// Trainable parameters of the deployed network as papers count them, the two scalars of the
    /// offsets included.
    pub fn parameters(&self) -> usize {
        self.layers().iter().map(Layer::parameters).sum::<usize>() + 2
    }

    /// Multiply-accumulates of one `init`.
    pub fn macs_template(&self) -> u64 {
        self.layers().iter().map(Layer::macs_template).sum()
    }

    /// Multiply-accumulates of one `update`.
    pub fn macs_search(&self) -> u64 {
        self.layers().iter().map(Layer::macs_search).sum()
    }
}

/// The layer that another one reads.
struct Source {
    name: Option<String>, // `None` for the crop
    channels: usize,
}

impl Source {
    const CROP: Source = Source {
        name: None,
        channels: 3,
    };

    fn of(name: &str, channels: usize) -> Source {
        Source {
            name: Some(name.into()),
            channels,
        }
    }
}

/// Sides of a layer's output maps; 0 for a branch on which it does not run.
#[derive(Clone, Copy)]
struct Sides {
    template: usize,
    search: usize,
}

impl Sides {
    fn search(side: usize) -> Sides {
        Sides {
            template: 0,
            search: side,
        }
    }

    /// Zero where `branch` does not run.
    fn only(self, branch: Branch) -> Sides {
        Sides {
            template: if branch == Branch::Search {
                0
            } else {
                self.template
            },
            search: if branch == Branch::Template {
                0
            } else {
                self.search
            },
        }
    }
}

/// A convolution without padding, ReLU and BN, whose output is still to be given.
fn conv(name: &str, branch: Branch, kernel: usize, source: &Source) -> Layer {
    Layer {
        name: name.into(),
        kind: LayerKind::Conv,
        inputs: source.name.iter().cloned().collect(),
        branch,
        in_channels: source.channels,
        out_channels: 0,
        kernel,
        stride: 1,
        pad: 0,
        relu: false,
        bn: false,
        out_template: 0,
        out_search: 0,
    }
}

/// Output side of a convolution.
pub fn conv_side(n: usize, kernel: usize, stride: usize, pad: usize) -> usize {
    (n + 2 * pad - kernel) / stride + 1
}

/// Output side of the 3x3 stride-2 pool in ceil mode.
///
/// Source: docs/method.md, section 1.1.
pub fn pool_side(n: usize) -> usize {
    let out = (n - 3).div_ceil(2) + 1;
    if (out - 1) * 2 >= n { out - 1 } else { out }
}

/// Output sides of conv1, pool1, conv2, pool2, conv3, conv4, conv5.
fn backbone_sides(crop: usize) -> [usize; 7] {
    let c1 = conv_side(crop, 11, 2, 0);
    let p1 = pool_side(c1);
    let c2 = conv_side(p1, 5, 1, 0);
    let p2 = pool_side(c2);
    [c1, p1, c2, p2, p2 - 2, p2 - 4, p2 - 6]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pruned_networks_have_the_published_totals() {
        // docs/method.md, section 1.6: ratio, parameters, MMAC of search and template (to 0.1)
        for (ratio, parameters, search, template) in [
            (0.0, 9_655_380, 8561.4, 729.4),
            (0.1, 7_796_411, 6971.0, 598.7),
            (0.2, 6_145_199, 5551.5, 481.2),
            (0.3, 4_725_663, 4337.8, 381.4),
            (0.4, 3_461_819, 3233.6, 288.6),
            (0.5, 2_425_396, 2329.8, 212.7),
            (0.6, 1_543_163, 1535.8, 144.2),
            (0.7, 862_927, 907.4, 88.6),
            (0.8, 389_231, 457.9, 48.0),
        ] {
            let a = Architecture::new(Widths::pruned(ratio), None);
            a.check().unwrap();
            assert_eq!(a.parameters(), parameters, "ratio {ratio}");
            assert!(
                (a.macs_search() as f64 / 1e6 - search).abs() < 0.051,
                "ratio {ratio}"
            );
            assert!(
                (a.macs_template() as f64 / 1e6 - template).abs() < 0.051,
                "ratio {ratio}"
            );
        }
        let full = Architecture::new(Widths::FULL, None);
        assert_eq!(
            (full.macs_search(), full.macs_template()),
            (8_561_400_608, 729_439_008)
        );
    }

    #[test]
    fn p_siamfcpp_has_its_published_totals() {
        let widths = Widths {
            backbone: [76, 224, 337, 334, 256],
            neck_cls: 256,
            neck_reg: 256,
            head_cls: [230, 138, 224],
            head_reg: [227, 145, 224],
        };
        let a = Architecture::new(widths, None);
        assert_eq!(a.parameters(), 7_489_986);
        assert!((a.macs_search() as f64 / 1e6 - 6474.6).abs() < 0.051);
        assert!((a.macs_template() as f64 / 1e6 - 541.4).abs() < 0.051);
    }

    #[test]
    fn encoders_add_their_parameters_and_macs() {
        // docs/method.md, section 1.7
        let half = Widths::pruned(0.5);
        let e = Encoder::standard(128);
        for (encoder, parameters, search) in [
            (Encoder { kernel: 1, ..e }, 2_442_164, 2342.6),
            (e, 2_573_236, 2445.4),
        ] {
            let a = Architecture::new(half, Some(encoder));
            a.check().unwrap();
            assert_eq!(a.parameters(), parameters, "{encoder:?}");
            assert!(
                (a.macs_search() as f64 / 1e6 - search).abs() < 0.051,
                "{encoder:?}"
            );
        }
    }

    #[test]
    fn pruning_ratio_of_pruned_widths_is_found() {
        for tenths in 0..10 {
            let ratio = f64::from(tenths) / 10.0;
            assert_eq!(Widths::pruned(ratio).pruning_ratio(), Some(ratio));
        }
        assert_eq!(
            Widths {
                neck_reg: 255,
                ..Widths::FULL
            }
            .pruning_ratio(),
            None
        );
    }

    #[test]
    fn tensors_hold_every_parameter_but_bn() {
        let a = Architecture::new(Widths::FULL, None);
        let elements: usize = a
            .tensors()
            .iter()
            .map(|(_, shape)| shape.iter().product::<usize>())
            .sum();
        // docs/method.md, section 1.2: weights without si and bi, and biases
        assert_eq!(elements, 9_645_602 - 2 + 3_942);
        assert_eq!(
            a.tensors()[0],
            ("backbone.conv1.weight".into(), vec![96, 11, 11, 3])
        );
    }

    #[test]
    fn score_map_of_the_standard_crops_has_17_cells_from_87() {
        let a = Architecture::new(Widths::FULL, None);
        assert_eq!((a.score_size(), a.score_offset()), (17, 87));
        assert_eq!(a.score_offset() + 16 * Architecture::TOTAL_STRIDE, 215);
        assert_eq!(
            Architecture {
                search_size: 335,
                ..a
            }
            .score_size(),
            21
        );
    }

    #[test]
    fn pool_side_is_that_of_ceil_mode() {
        for (n, out) in [
            (3, 1),
            (4, 2),
            (5, 2),
            (6, 3),
            (59, 29),
            (147, 73),
            (69, 34),
            (25, 12),
        ] {
            assert_eq!(pool_side(n), out, "{n}");
        }
    }

    #[test]
    fn architecture_out_of_bounds_is_refused() {
        let good = Architecture::new(Widths::FULL, Some(Encoder::standard(256)));
        good.check().unwrap();
        let with = |f: &dyn Fn(&mut Architecture)| {
            let mut a = good;
            f(&mut a);
            a.check().unwrap_err().to_string()
        };
        assert!(with(&|a| a.widths.backbone[2] = 0).contains("widths[2] is 0"));
        assert!(with(&|a| a.widths.head_reg[2] = 1 << 40).contains("widths[12]"));
        assert!(with(&|a| a.template_size = 0).contains("template_size"));
        assert!(with(&|a| a.search_size = 127).contains("search_size"));
        assert!(with(&|a| a.search_size = usize::MAX).contains("search_size"));
        assert!(with(&|a| a.encoder.as_mut().unwrap().kernel = 2).contains("encoder.kernel"));
        assert!(with(&|a| a.encoder.as_mut().unwrap().layers = 9).contains("encoder.layers"));
    }
}
