//! The forward pass against naive `f64` loops: odd widths, every encoder, other crop sizes.
//! Also the backbone's translation identity.

use kernels::conv::Algorithm;
use kernels::{Isa, Size, reference};
use track_cpu::Model;
use track_cpu::model::conv_shape;
use track_cpu::net::Network;
use weights_format::{Architecture, Encoder, Layer, Weights, Widths};

/// A picture of `side` x `side` pixels with edges and without symmetry.
fn picture(side: usize) -> Vec<u8> {
    let value = |i: usize| {
        let (y, x, c) = (i / 3 / side, i / 3 % side, i % 3);
        let stripes = if (x / 7 + y / 11 + c) % 2 == 0 {
            140
        } else {
            60
        };
        (stripes + (x * 31 + y * 17 + c * 57) % 61) as u8
    };
    (0..side * side * 3).map(value).collect()
}

/// A map of the naive network.
#[derive(Clone)]
struct Map {
    values: Vec<f32>,
    side: usize,
}

fn narrow(values: Vec<f64>) -> Vec<f32> {
    values.into_iter().map(|v| v as f32).collect()
}

struct Naive<'a> {
    weights: &'a Weights,
    layers: Vec<Layer>,
}

impl Naive<'_> {
    fn conv(&self, name: &str, from: &Map) -> Map {
        let layer = self
            .layers
            .iter()
            .find(|l| l.name == name)
            .unwrap_or_else(|| panic!("no layer {name}"));
        let shape = conv_shape(layer);
        let tensor = |part: &str| &self.weights.tensor(&format!("{name}.{part}")).unwrap().data;
        let size = Size::square(from.side);
        let values = reference::conv(&shape, size, &from.values, tensor("weight"), tensor("bias"));
        Map {
            values: narrow(values),
            side: shape.out_size(size).h,
        }
    }

    fn pool(&self, from: &Map) -> Map {
        let size = Size::square(from.side);
        let channels = from.values.len() / size.area();
        let side = kernels::pool::out_size(size).h;
        Map {
            values: narrow(reference::max_pool(size, channels, &from.values)),
            side,
        }
    }

    fn backbone(&self, crop: &[u8], side: usize) -> Map {
        let crop = Map {
            values: crop.iter().map(|v| f32::from(*v)).collect(),
            side,
        };
        let pool1 = self.pool(&self.conv("backbone.conv1", &crop));
        let pool2 = self.pool(&self.conv("backbone.conv2", &pool1));
        let names = ["backbone.conv3", "backbone.conv4", "backbone.conv5"];
        names.iter().fold(pool2, |map, name| self.conv(name, &map))
    }

    fn encode(&self, from: Map) -> Map {
        match self.weights.header.architecture.encoder {
            Some(_) => self.conv("dr.e2.0", &from),
            None => from,
        }
    }

    fn features(&self, branch: &str, task: &str, crop: &[u8], side: usize) -> Map {
        let features = self.encode(self.backbone(crop, side));
        self.conv(&format!("neck.{branch}_{task}"), &features)
    }

    fn tower(&self, task: &str, template: &[u8], search: &[u8]) -> Map {
        let Architecture {
            template_size,
            search_size,
            ..
        } = self.weights.header.architecture;
        let z = self.features("template", task, template, template_size);
        let x = self.features("search", task, search, search_size);
        let (zs, xs) = (Size::square(z.side), Size::square(x.side));
        let values = reference::xcorr(xs, zs, x.values.len() / xs.area(), &x.values, &z.values);
        let response = Map {
            values: narrow(values),
            side: x.side - z.side + 1,
        };
        (1..=3).fold(response, |map, i| {
            self.conv(&format!("head.{task}{i}"), &map)
        })
    }

    /// Score and offsets of every cell.
    fn run(&self, template: &[u8], search: &[u8]) -> (Vec<f32>, Vec<f32>) {
        let (cls, reg) = (
            self.tower("cls", template, search),
            self.tower("reg", template, search),
        );
        let sigmoid = |v: &f32| 1.0 / (1.0 + (-v).exp());
        let (score, centerness) = (
            self.conv("head.score", &cls),
            self.conv("head.centerness", &cls),
        );
        let score = score
            .values
            .iter()
            .zip(&centerness.values)
            .map(|(s, c)| sigmoid(s) * sigmoid(c))
            .collect();
        let offsets = self.conv("head.offsets", &reg);
        (
            score,
            offsets.values.iter().map(|v| 8.0 * v.exp()).collect(),
        )
    }
}

fn check(architecture: Architecture) {
    architecture.check().unwrap();
    let mut weights = Weights::random(architecture, 5);
    // Pixels of 0..255 blow random weights up. The normalization brings them down, which also
    // tests the normalization.
    weights.header.input.mean = [100.0, 110.0, 120.0];
    weights.header.input.std = [50.0, 60.0, 70.0];
    let normalized = {
        let mut folded = weights.clone();
        folded.header.input = Default::default();
        let mut conv1 = weights.tensor("backbone.conv1.weight").unwrap().clone();
        let mut bias = weights.tensor("backbone.conv1.bias").unwrap().clone();
        let window = conv1.data.len() / bias.data.len();
        for (i, w) in conv1.data.iter_mut().enumerate() {
            *w /= weights.header.input.std[i % 3];
            bias.data[i / window] -= *w * weights.header.input.mean[i % 3];
        }
        folded.insert("backbone.conv1.weight", conv1);
        folded.insert("backbone.conv1.bias", bias);
        folded
    };
    let (template, search) = (
        picture(architecture.template_size),
        picture(architecture.search_size),
    );
    let naive = Naive {
        weights: &normalized,
        layers: architecture.layers(),
    };
    let (score, ltrb) = naive.run(&template, &search);
    assert_eq!(score.len(), architecture.score_size().pow(2));
    for isa in Isa::available() {
        for algorithm in Algorithm::ALL {
            for threads in [1, 3] {
                let model = Model::with_algorithm(&weights, isa, algorithm).unwrap();
                let mut network = Network::new(model, threads);
                network.set_template(&template);
                let outputs = network.search(&search);
                let far = |a: &[f32], b: &[f32]| {
                    let rms = (b.iter().map(|v| v * v).sum::<f32>() / b.len() as f32).sqrt();
                    a.iter()
                        .zip(b)
                        .map(|(a, b)| (a - b).abs())
                        .fold(0.0, f32::max)
                        / rms
                };
                let errors = [far(&outputs.score, &score), far(&outputs.ltrb, &ltrb)];
                assert!(
                    errors.iter().all(|e| *e < 1e-3),
                    "{architecture:?} on {isa}: {errors:?}"
                );
            }
        }
    }
}

const WIDTHS: Widths = Widths {
    backbone: [5, 9, 7, 17, 6],
    neck_cls: 7,
    neck_reg: 5,
    head_cls: [6, 3, 9],
    head_reg: [4, 8, 5],
};

#[test]
fn network_without_encoder_equals_the_naive_one() {
    check(Architecture::new(WIDTHS, None));
}

#[test]
fn network_with_any_encoder_equals_the_naive_one() {
    let standard = Encoder::standard(6);
    let linear = Encoder {
        kernel: 1,
        relu: false,
        width: 3,
        ..standard
    };
    for encoder in [standard, linear] {
        check(Architecture::new(WIDTHS, Some(encoder)));
    }
}

#[test]
fn network_at_other_crop_sizes_equals_the_naive_one() {
    for (template_size, search_size) in [(127, 335), (127, 302), (110, 233)] {
        check(Architecture {
            template_size,
            search_size,
            ..Architecture::new(WIDTHS, Some(Encoder::standard(6)))
        });
    }
}

#[test]
fn features_of_a_shifted_crop_are_the_shifted_features() {
    // Without padding a crop's features are a part of the picture's, every 8 pixels
    // (docs/method.md, section 1.2).
    let weights = Weights::random(Architecture::new(WIDTHS, None), 6);
    let search = picture(303);
    for isa in Isa::available() {
        let mut network = Network::new(Model::from_weights(&weights, isa).unwrap(), 1);
        let conv5 = |network: &Network| {
            network
                .maps()
                .find(|(n, _)| *n == "backbone.conv5")
                .unwrap()
                .1
                .clone()
        };
        network.set_template(&picture(127));
        network.search(&search);
        let whole = conv5(&network);
        for (a, b) in [(0, 0), (8, 176), (96, 40), (176, 176)] {
            let row = |y: usize| &search[((a + y) * 303 + b) * 3..][..127 * 3];
            let crop: Vec<u8> = (0..127).flat_map(|y| row(y).to_vec()).collect();
            network.set_template(&crop);
            let part = conv5(&network);
            let channels = part.channels();
            for (i, value) in part.values().iter().enumerate() {
                let (y, x, c) = (i / channels / 6, i / channels % 6, i % channels);
                let expected = whole.values()[((a / 8 + y) * 28 + b / 8 + x) * channels + c];
                assert!(
                    (value - expected).abs() <= 1e-4 * expected.abs().max(1.0),
                    "{isa} at {a},{b}"
                );
            }
        }
    }
}
