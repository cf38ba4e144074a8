//! The network against the reference implementation's training step, and against the tracker.

use super::*;
use crate::rng::Rng;
use crate::targets::{Cells, Targets};
use autodiff::{Compute, Mode};
use safetensors::SafeTensors;
use track_cpu::{Isa, Model};
use weights_format::{Encoder, Provenance, Storage, Widths};

fn narrow() -> Architecture {
    Architecture::new(
        Widths::uniform([8, 16, 24, 24, 16], 16),
        Some(Encoder::standard(16)),
    )
}

/// The reference's name of one of our parameters.
fn reference_name(name: &str) -> String {
    let name = [
        ("backbone.", "basemodel."),
        ("neck.template_cls", "c_z_k"),
        ("neck.template_reg", "r_z_k"),
        ("neck.search_cls", "c_x"),
        ("neck.search_reg", "r_x"),
        ("head.cls", "head.cls_p5_conv"),
        ("head.reg", "head.bbox_p5_conv"),
        ("head.score", "head.cls_score_p5"),
        ("head.centerness", "head.ctr_score_p5"),
        ("head.offsets", "head.bbox_offsets_p5"),
        ("dr.e1.0", "dr.e1"),
        ("dr.e2.0", "dr.e2"),
    ]
    .iter()
    .find_map(|(ours, theirs)| Some(format!("{theirs}{}", name.strip_prefix(ours)?)))
    .unwrap_or_else(|| name.to_owned());
    if let Some((net, rest)) = name
        .strip_prefix("mi.")
        .and_then(|rest| rest.split_once('.'))
    {
        let (layer, part) = rest.split_once('.').unwrap();
        return format!("mi.{net}.{}.{part}", 2 * layer.parse::<usize>().unwrap());
    }
    for (ours, theirs) in [
        ("scale", "weight"),
        ("shift", "bias"),
        ("mean", "running_mean"),
        ("variance", "running_var"),
    ] {
        if let Some(layer) = name.strip_suffix(&format!(".bn.{ours}")) {
            return format!("{layer}.bn.{theirs}");
        }
    }
    match name.rsplit_once('.') {
        Some((layer, part @ ("weight" | "bias"))) => format!("{layer}.conv.{part}"),
        _ => name,
    }
}

/// A tensor with channels innermost: `[a, b, h, w]` becomes `[a, h, w, b]`.
fn golden(file: &SafeTensors, name: &str) -> Tensor {
    let view = file
        .tensor(name)
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    let bytes = view.data().chunks_exact(4);
    let values: Vec<f32> = bytes
        .map(|b| f32::from_le_bytes(b.try_into().unwrap()))
        .collect();
    let [a, b, h, w] = view.shape()[..] else {
        return Tensor::new(view.shape(), values);
    };
    let at = |i: usize| {
        let (outer, y, x, inner) = (i / (b * h * w), i / (b * w) % h, i / b % w, i % b);
        values[((outer * b + inner) * h + y) * w + x]
    };
    Tensor::new(&[a, h, w, b], (0..values.len()).map(at).collect())
}

fn norm(values: impl Iterator<Item = f32>) -> f64 {
    values.map(|v| f64::from(v).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn training_step_equals_the_reference() {
    let Some(path) = crate::testing::shared("golden/train_step.safetensors") else {
        return;
    };
    let bytes = std::fs::read(path).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
    let expected = &header.metadata().as_ref().unwrap()["losses_sgd_lr0.002_m0.9_wd5e-5"];
    let expected: Vec<serde_json::Value> = serde_json::from_str(expected).unwrap();

    let mut parameters = Parameters::new();
    let nets = StatisticsNets::Full;
    let mut network = Network::new(&mut parameters, narrow(), nets).unwrap();
    // The file's statistics networks are narrower.
    let mut others = Parameters::new();
    let blocks = parameters.iter().filter(|p| !p.name().starts_with("mi."));
    for p in blocks {
        let value = p.value.clone();
        if p.is_statistic() {
            others.add_statistic(p.name(), value)
        } else {
            others.add(p.name(), value)
        };
    }
    parameters = others;
    network.statistics = Some([
        Statistics::new(&mut parameters, "mi.global", 36 * 48, 32),
        Statistics::new(&mut parameters, "mi.local", 48, 32),
    ]);
    for parameter in parameters.iter_mut() {
        let value = golden(&file, &format!("init.{}", reference_name(parameter.name())));
        parameter.value = Tensor::new(parameter.value.shape(), value.into_data());
    }

    let positive: Vec<bool> = golden(&file, "in.neg")
        .data()
        .iter()
        .map(|n| *n == 0.0)
        .collect();
    let corners = golden(&file, "in.box");
    let items: Vec<_> = corners
        .data()
        .chunks(4)
        .zip(&positive)
        .map(|(c, p)| (c.try_into().unwrap(), !p))
        .collect();
    let cells = Cells::of(&narrow(), 303);
    let targets = Targets::new(&items, cells);
    for (found, name) in [
        (&targets.labels, "tgt.cls_gt"),
        (&targets.quality, "tgt.ctr_gt"),
        (&targets.boxes, "tgt.box_gt"),
    ] {
        let expected = golden(&file, name);
        let worst = found
            .data()
            .iter()
            .zip(expected.data())
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f32::max);
        assert!(
            found.data().len() == expected.data().len() && worst < 1e-5,
            "{name}: {worst}"
        );
    }
    let [template, search, again] = ["in.z", "in.x", "in.z2"].map(|name| golden(&file, name));
    let batch = Batch {
        template,
        search,
        again,
        positive,
        targets,
        cells,
    };

    let options = LossOptions {
        min_iou: f32::MIN_POSITIVE,
        max_exponent: f32::INFINITY,
        ..LossOptions::default()
    };
    let compute = Compute::new(2).unwrap();
    let mut tape = Tape::new(&compute, &mut parameters, Mode::Training);
    let (_, losses) = network.losses(&mut tape, batch, &options);
    let names = [
        "total",
        "cls",
        "ctr",
        "reg",
        "mi_global",
        "mi_local",
        "idsim",
    ];
    for ((ours, found), theirs) in losses.values(&tape).named().iter().zip(names) {
        let expected = expected[0][theirs].as_f64().unwrap();
        assert!(
            (found / expected - 1.0).abs() < 1e-4,
            "{ours}: {found}, expected {expected}"
        );
    }
    tape.backward(losses.total);
    for parameter in parameters.iter() {
        let name = reference_name(parameter.name());
        let (found, expected, floor) = match &parameter.gradient {
            // Before a normalization a bias has no gradient but rounding errors, judged by its
            // weights' gradient.
            Some(gradient) => {
                let weights = name
                    .strip_suffix(".conv.bias")
                    .map(|l| format!("grad.{l}.conv.weight"));
                let floor =
                    weights.map_or(0.0, |w| norm(golden(&file, &w).into_data().into_iter()));
                (
                    gradient,
                    golden(&file, &format!("grad.{name}")),
                    0.1 * floor,
                )
            }
            None => (&parameter.value, golden(&file, &format!("bn1.{name}")), 0.0),
        };
        let difference = norm(found.data().iter().zip(expected.data()).map(|(f, e)| f - e));
        let error = difference / norm(expected.into_data().into_iter()).max(floor);
        assert!(error < 1e-3, "{name}: off by {error:.1e} of its norm");
    }
}

/// A network whose every value is random, batch statistics and head scalars too.
fn random(architecture: Architecture) -> (Parameters, Network) {
    let mut parameters = Parameters::new();
    let network = Network::new(&mut parameters, architecture, StatisticsNets::None).unwrap();
    network.initialize(&mut parameters, Init::Kaiming, 3);
    for (i, parameter) in parameters.iter_mut().enumerate() {
        let mut rng = Rng::new(1, 2, i as u64);
        let name = parameter.name().to_owned();
        let values = parameter.value.data_mut();
        let (low, high) = match name.rsplit_once('.').unwrap().1 {
            "scale" => (0.6, 1.4),
            "shift" | "mean" | "bias" => (-0.3, 0.3),
            "variance" => (0.5, 2.0),
            "si" => (0.9, 0.9),
            "bi" => (0.2, 0.2),
            _ => continue,
        };
        values.iter_mut().for_each(|v| *v = rng.range(low, high));
    }
    (parameters, network)
}

#[test]
fn exported_weights_track_like_the_trained_network() {
    let encoder = |f: &dyn Fn(&mut Encoder)| {
        let mut encoder = Encoder::standard(16);
        f(&mut encoder);
        Some(encoder)
    };
    let uneven = Widths {
        neck_reg: 12,
        head_cls: [10, 6, 8],
        head_reg: [9, 16, 7],
        ..narrow().widths
    };
    for architecture in [
        narrow(),
        Architecture {
            encoder: None,
            widths: uneven,
            ..narrow()
        },
        Architecture {
            encoder: encoder(&|e| (e.kernel, e.relu) = (1, false)),
            ..narrow()
        },
    ] {
        let (mut parameters, network) = random(architecture);
        let weights = network.export(&parameters, Storage::F32, Provenance::default());
        let model = Model::from_weights(&weights, Isa::detect()).unwrap();
        let mut deployed = track_cpu::net::Network::new(model, 2);
        let mut rng = Rng::new(7, 7, 7);
        let mut crop =
            |side: usize| -> Vec<u8> { (0..side * side * 3).map(|_| rng.bits() as u8).collect() };
        let (template, search) = (crop(127), crop(303));
        deployed.set_template(&template);
        let outputs = deployed.search(&search);

        let normalized = |crop: &[u8], side: usize| {
            let values = crop
                .iter()
                .map(|v| (f32::from(*v) - INPUT.mean[0]) / INPUT.std[0]);
            Tensor::new(&[1, side, side, 3], values.collect())
        };
        let compute = Compute::new(2).unwrap();
        let (si, bi) = (
            parameters[network.scalars[0]].value.item(),
            parameters[network.scalars[1]].value.item(),
        );
        let mut tape = Tape::new(&compute, &mut parameters, Mode::Evaluation);
        let prediction = network.predict(
            &mut tape,
            normalized(&template, 127),
            normalized(&search, 303),
        );
        let sigmoid = |x: f32| 1.0 / (1.0 + (-x).exp());
        let value = |var| tape.value(var).data();
        let scores = value(prediction.score)
            .iter()
            .zip(value(prediction.centerness));
        for ((score, centerness), found) in scores.zip(&outputs.score) {
            let expected = sigmoid(*score) * sigmoid(*centerness);
            assert!(
                (found - expected).abs() < 2e-4,
                "{architecture:?}: {found}, expected {expected}"
            );
        }
        // Of a network that was never trained the exponents may be large; rounding is relative to
        // the map's size.
        let expected: Vec<f32> = value(prediction.offsets)
            .iter()
            .map(|offset| si * offset + bi)
            .collect();
        let rms = (expected.iter().map(|x| x * x).sum::<f32>() / expected.len() as f32).sqrt();
        for (expected, found) in expected.iter().zip(&outputs.ltrb) {
            let found = (found / 8.0).ln();
            let allowed = 5e-4 * rms.max(1.0);
            assert!(
                (found - expected).abs() < allowed,
                "{architecture:?}: {found}, expected {expected}"
            );
        }
    }
}

#[test]
fn standard_network_has_the_parameters_of_the_method() {
    let count = |nets| {
        let mut parameters = Parameters::new();
        let architecture = crate::fit::standard(0.5);
        Network::new(&mut parameters, architecture, nets).unwrap();
        let learned = parameters.iter().filter(|p| !p.is_statistic());
        learned.map(|p| p.value.data().len()).sum::<usize>()
    };
    let deployed = 2_573_236;
    assert_eq!(count(StatisticsNets::None), deployed);
    // E1, global and local statistics networks (docs/method.md, section 3.7).
    assert_eq!(
        count(StatisticsNets::Full),
        deployed + 147_840 + 7_341_569 + 460_289
    );
}

#[test]
fn statistics_networks_without_encoder_are_refused() {
    let architecture = Architecture {
        encoder: None,
        ..narrow()
    };
    let refused = Network::new(&mut Parameters::new(), architecture, StatisticsNets::Light);
    assert!(refused.unwrap_err().to_string().contains("--no-mi"));
}
