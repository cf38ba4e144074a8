//! What the network looks like: widths, encoder, sizes; and the list of layers that follows from them.
//!
//! Shapes, parameter counts and multiply-accumulates (MACs) are computed here and nowhere else, so that the
//! reader, the converter, the trainer and `info` cannot disagree.

use serde::{Deserialize, Serialize};

/// Output channels of every 3x3-or-larger convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Widths {
    /// `conv1` to `conv5`.
    pub backbone: [usize; 5],
    /// Classification neck; template and search side are correlated, so they share it.
    pub neck_cls: usize,
    /// Regression neck, likewise.
    pub neck_reg: usize,
    /// The three convolutions of the classification tower.
    pub head_cls: [usize; 3],
    /// The three convolutions of the regression tower.
    pub head_reg: [usize; 3],
}

impl Widths {
    /// The unpruned SiamFC++-AlexNet: 96/256/384/384/256 and 256 everywhere behind it.
    pub const FULL: Widths = Widths::uniform([96, 256, 384, 384, 256], 256);

    /// Given backbone widths, one width for neck and head.
    pub const fn uniform(backbone: [usize; 5], n: usize) -> Widths {
        Widths {
            backbone,
            neck_cls: n,
            neck_reg: n,
            head_cls: [n; 3],
            head_reg: [n; 3],
        }
    }

    /// [`Widths::FULL`] after pruning every layer with one global `ratio` in `[0, 1)`: `floor(C * (1 - ratio))`.
    ///
    /// Source: paper section III-C, spec section 1.6 (reading A, chain pruning).
    pub fn pruned(ratio: f64) -> Widths {
        let keep = |c: usize| (c as f64 * (10.0 - 10.0 * ratio) / 10.0 + 1e-9).floor() as usize;
        Widths::uniform(Widths::FULL.backbone.map(keep), keep(256))
    }

    /// The ratio `r` of 0.0, 0.1 .. 0.9 for which these widths are [`Widths::pruned(r)`](Widths::pruned), if any.
    pub fn pruning_ratio(&self) -> Option<f64> {
        (0..10)
            .map(|tenths| f64::from(tenths) / 10.0)
            .find(|&r| Widths::pruned(r) == *self)
    }

    /// Every width in the order of the file: backbone, neck, classification tower, regression tower.
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

/// Where the identity-related encoder E2 sits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EncoderPosition {
    /// Between backbone and neck (the default; spec section 1.7).
    #[default]
    BeforeNeck,
    /// On the neck's outputs, as the paper's Eq. 1 writes it.
    AfterNeck,
}

/// The identity-related encoder E2: `layers` convolutions with "same" padding, each with bias (BN folded in).
///
/// Source: paper section III-A, spec section 1.7.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Encoder {
    /// Side of the square kernel: 1 or 3; padding is `kernel / 2`.
    pub kernel: usize,
    /// How many convolutions: 1 or 2.
    pub layers: usize,
    /// Output channels of each.
    pub width: usize,
    /// Whether each ends in a ReLU.
    pub relu: bool,
    /// One E2 for template and search branch (the default), or one each.
    pub shared: bool,
    /// Before or after the neck.
    pub position: EncoderPosition,
}

impl Encoder {
    /// The default: one shared 3x3 convolution with pad 1 and ReLU that keeps its `width` channels.
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
    /// `None` is the P-SiamFC++ family; a file must say so with an explicit `null`.
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

/// Which crop(s) a layer works on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Branch {
    /// Template and search crop, the same weights.
    Both,
    /// Template crop only: once per `init`.
    Template,
    /// Search crop only: once per frame.
    Search,
}

/// One layer with its shapes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Name; a convolution's tensors are `<name>.weight` and `<name>.bias`.
    pub name: String,
    /// What it computes.
    pub kind: LayerKind,
    /// Which crops it works on.
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
    /// Whether training has a BN behind it (folded into the weights here).
    pub bn: bool,
    /// How often it runs per crop (an encoder after the neck runs for both tasks).
    pub runs: usize,
    /// Side of the output map for the template crop; 0 where the layer does not run on it.
    pub out_template: usize,
    /// Side of the output map for the search crop; 0 where the layer does not run on it.
    pub out_search: usize,
}

impl Layer {
    /// Trainable parameters as papers count them: weights, biases and BN's scale and shift.
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

    /// Multiply-accumulates on the template crop, all runs.
    pub fn macs_template(&self) -> u64 {
        self.macs(self.out_template)
    }

    /// Multiply-accumulates on the search crop, all runs.
    pub fn macs_search(&self) -> u64 {
        self.macs(self.out_search)
    }

    fn macs(&self, side: usize) -> u64 {
        let per_pixel = match self.kind {
            LayerKind::Conv => self.in_channels * self.out_channels * self.kernel * self.kernel,
            LayerKind::Correlation => self.out_channels * self.kernel * self.kernel,
            LayerKind::Pool => 0,
        };
        (per_pixel * side * side * self.runs) as u64
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
    /// Widest layer accepted; a bound on what a stranger's file can make us allocate.
    pub const MAX_WIDTH: usize = 2048;
    /// Largest crop side accepted, likewise.
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

    /// Checks every bound; an architecture that passes can be laid out and run.
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
        if let Some(e) = &self.encoder {
            if ![1, 3].contains(&e.kernel) {
                return wrong("encoder.kernel", &e.kernel, "1 or 3".into());
            }
            if ![1, 2].contains(&e.layers) {
                return wrong("encoder.layers", &e.layers, "1 or 2".into());
            }
            if !(1..=Self::MAX_WIDTH).contains(&e.width) {
                return wrong("encoder.width", &e.width, width);
            }
            if e.position == EncoderPosition::AfterNeck
                && self.widths.neck_cls != self.widths.neck_reg
            {
                let found = format!("{} and {}", self.widths.neck_cls, self.widths.neck_reg);
                return wrong(
                    "neck widths",
                    &found,
                    "equal, for an encoder after the neck".into(),
                );
            }
        }
        // The towers shrink the response by 6; sizes only ever shrink, so the last one tells.
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

    /// Crop pixel of the first score cell's center, in both directions (spec section 2.4).
    pub fn score_offset(&self) -> usize {
        (self.search_size - 1 - (self.score_size() - 1) * Self::TOTAL_STRIDE) / 2
    }

    /// Every layer in execution order; the last one's `out_search` is the score map's side.
    ///
    /// Expects an architecture that passed [`check`](Self::check).
    pub fn layers(&self) -> Vec<Layer> {
        let w = &self.widths;
        let (z, x) = (
            backbone_sides(self.template_size),
            backbone_sides(self.search_size),
        );
        let mut layers = Vec::with_capacity(24);
        let conv = |name: &str,
                    branch,
                    (cin, cout): (usize, usize),
                    (kernel, pad): (usize, usize),
                    relu,
                    bn,
                    (oz, ox)| {
            Layer {
                name: name.into(),
                kind: LayerKind::Conv,
                branch,
                in_channels: cin,
                out_channels: cout,
                kernel,
                stride: 1,
                pad,
                relu,
                bn,
                runs: 1,
                out_template: oz,
                out_search: ox,
            }
        };
        let pool = |name: &str, channels, oz, ox| Layer {
            kind: LayerKind::Pool,
            stride: 2,
            ..conv(
                name,
                Branch::Both,
                (channels, channels),
                (3, 0),
                false,
                false,
                (oz, ox),
            )
        };
        let correlation = |name: &str, channels, kernel, ox| Layer {
            kind: LayerKind::Correlation,
            ..conv(
                name,
                Branch::Search,
                (channels, channels),
                (kernel, 0),
                false,
                false,
                (0, ox),
            )
        };
        let [c1, c2, c3, c4, c5] = w.backbone;
        use Branch::{Both, Search, Template};
        layers.push(Layer {
            stride: 2,
            ..conv(
                "backbone.conv1",
                Both,
                (3, c1),
                (11, 0),
                true,
                true,
                (z[0], x[0]),
            )
        });
        layers.push(pool("backbone.pool1", c1, z[1], x[1]));
        layers.push(conv(
            "backbone.conv2",
            Both,
            (c1, c2),
            (5, 0),
            true,
            true,
            (z[2], x[2]),
        ));
        layers.push(pool("backbone.pool2", c2, z[3], x[3]));
        layers.push(conv(
            "backbone.conv3",
            Both,
            (c2, c3),
            (3, 0),
            true,
            true,
            (z[4], x[4]),
        ));
        layers.push(conv(
            "backbone.conv4",
            Both,
            (c3, c4),
            (3, 0),
            true,
            true,
            (z[5], x[5]),
        ));
        layers.push(conv(
            "backbone.conv5",
            Both,
            (c4, c5),
            (3, 0),
            false,
            true,
            (z[6], x[6]),
        ));
        let (nz, nx) = (z[6] - 2, x[6] - 2);

        let encoder = |side: (usize, usize), input: usize, runs: usize| {
            let Some(e) = self.encoder else {
                return Vec::new();
            };
            let sides: &[(&str, Branch)] = if e.shared {
                &[("dr.e2", Both)]
            } else {
                &[("dr.e2_template", Template), ("dr.e2_search", Search)]
            };
            let mut list = Vec::new();
            for &(name, branch) in sides {
                for i in 0..e.layers {
                    let cin = if i == 0 { input } else { e.width };
                    let out = (
                        if branch == Search { 0 } else { side.0 },
                        if branch == Template { 0 } else { side.1 },
                    );
                    let io = ((cin, e.width), (e.kernel, e.kernel / 2));
                    let layer = conv(
                        &format!("{name}.{i}"),
                        branch,
                        io.0,
                        io.1,
                        e.relu,
                        true,
                        out,
                    );
                    list.push(Layer { runs, ..layer });
                }
            }
            list
        };
        let position = self.encoder.map(|e| e.position);
        let encoded = self.encoder.map(|e| e.width);
        let before = position == Some(EncoderPosition::BeforeNeck);
        let after = position == Some(EncoderPosition::AfterNeck);
        if before {
            layers.extend(encoder((z[6], x[6]), c5, 1));
        }
        let neck_in = if before { encoded.unwrap_or(c5) } else { c5 };
        for (name, branch, n, oz, ox) in [
            ("neck.template_cls", Template, w.neck_cls, nz, 0),
            ("neck.template_reg", Template, w.neck_reg, nz, 0),
            ("neck.search_cls", Search, w.neck_cls, 0, nx),
            ("neck.search_reg", Search, w.neck_reg, 0, nx),
        ] {
            layers.push(conv(
                name,
                branch,
                (neck_in, n),
                (3, 0),
                false,
                true,
                (oz, ox),
            ));
        }
        if after {
            layers.extend(encoder((nz, nx), w.neck_cls, 2));
        }
        let response = nx - nz + 1;
        let channels = |neck| if after { encoded.unwrap_or(neck) } else { neck };
        let (cls_in, reg_in) = (channels(w.neck_cls), channels(w.neck_reg));
        layers.push(correlation("correlation.cls", cls_in, nz, response));
        layers.push(correlation("correlation.reg", reg_in, nz, response));
        for (tower, input, widths) in [("cls", cls_in, w.head_cls), ("reg", reg_in, w.head_reg)] {
            let mut cin = input;
            for (i, &n) in widths.iter().enumerate() {
                let side = response - 2 * (i + 1);
                let name = format!("head.{tower}{}", i + 1);
                layers.push(conv(
                    &name,
                    Search,
                    (cin, n),
                    (3, 0),
                    true,
                    i == 2,
                    (0, side),
                ));
                cin = n;
            }
        }
        let score = response - 6;
        for (name, cin, n) in [
            ("head.score", w.head_cls[2], 1),
            ("head.centerness", w.head_cls[2], 1),
            ("head.offsets", w.head_reg[2], 4),
        ] {
            layers.push(conv(
                name,
                Search,
                (cin, n),
                (1, 0),
                false,
                true,
                (0, score),
            ));
        }
        layers
    }

    /// Name and shape of every tensor in execution order: a weight `[Cout, kh, kw, Cin]` and a bias `[Cout]` per
    /// convolution.
    ///
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

    /// Trainable parameters of the deployed network as papers count them, with the two scalars of the offsets.
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

/// Output side of a convolution.
pub fn conv_side(n: usize, kernel: usize, stride: usize, pad: usize) -> usize {
    (n + 2 * pad - kernel) / stride + 1
}

/// Output side of the 3x3 stride-2 pool in ceil mode (spec section 1.1).
pub fn pool_side(n: usize) -> usize {
    let out = (n - 3).div_ceil(2) + 1;
    if (out - 1) * 2 >= n { out - 1 } else { out }
}

/// Sides behind conv1, pool1, conv2, pool2, conv3, conv4, conv5.
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
    fn totals_of_the_spec() {
        // spec section 1.6: ratio, parameters, MMAC of search and template (to 0.1)
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
    fn totals_of_p_siamfcpp() {
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
    fn totals_of_the_encoders() {
        // spec section 1.7
        let half = Widths::pruned(0.5);
        let e = Encoder::standard(128);
        let after = EncoderPosition::AfterNeck;
        for (encoder, parameters, search) in [
            (Encoder { kernel: 1, ..e }, 2_442_164, 2342.6),
            (e, 2_573_236, 2445.4),
            (Encoder { layers: 2, ..e }, 2_721_076, 2561.0),
            (
                Encoder {
                    position: after,
                    ..e
                },
                2_573_236,
                2529.2,
            ),
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
    fn knows_its_own_pruning_ratio() {
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
    fn tensors_hold_the_parameters_without_bn() {
        let a = Architecture::new(Widths::FULL, None);
        let elements: usize = a
            .tensors()
            .iter()
            .map(|(_, shape)| shape.iter().product::<usize>())
            .sum();
        assert_eq!(elements, 9_645_602 - 2 + 3_942); // spec section 1.2: weights without si and bi, biases
        assert_eq!(
            a.tensors()[0],
            ("backbone.conv1.weight".into(), vec![96, 11, 11, 3])
        );
    }

    #[test]
    fn grid_of_the_spec() {
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
    fn pools_in_ceil_mode() {
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
    fn refuses_what_cannot_run() {
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
