//! Pruning against the authors' published ranks, against the totals of docs/method.md, and against
//! the network itself.

use super::*;
use crate::data::DataOptions;
use crate::data::Dataset;
use crate::fit::{compute, standard};
use crate::network::StatisticsNets;
use crate::rng::Rng;
use crate::testing::{Folder, pictures, shared};
use autodiff::{Mode, Tape, Tensor};
use std::collections::BTreeMap;
use weights_format::{Architecture, Encoder, Widths};

/// The reference's names of layers that have ranks.
const REFERENCE: [(&str, &str); 15] = [
    ("conv1", "backbone.conv1"),
    ("conv2", "backbone.conv2"),
    ("conv3", "backbone.conv3"),
    ("conv4", "backbone.conv4"),
    ("conv5", "backbone.conv5"),
    ("c_x", "neck.search_cls"),
    ("r_x", "neck.search_reg"),
    ("c_z_k", "neck.template_cls"),
    ("r_z_k", "neck.template_reg"),
    ("cls_p5_conv1", "head.cls1"),
    ("cls_p5_conv2", "head.cls2"),
    ("cls_p5_conv3", "head.cls3"),
    ("bbox_p5_conv1", "head.reg1"),
    ("bbox_p5_conv2", "head.reg2"),
    ("bbox_p5_conv3", "head.reg3"),
];

#[test]
fn published_ranks_give_the_published_p_siamfcpp() {
    let Some(path) = shared("golden/psiamfcpp_ranks.json") else {
        return;
    };
    let file: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    let numbers = |name: &str| -> Vec<f64> {
        file["ranks"][name]
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_f64().unwrap())
            .collect()
    };
    let ranks = REFERENCE
        .iter()
        .map(|(theirs, ours)| (ours.to_string(), numbers(theirs)));
    let ranks = Ranks::new(500, ranks.collect());
    let rules = REFERENCE.iter().filter_map(|(theirs, ours)| {
        let threshold = file["thresholds_P-SiamFC++"][theirs].as_f64()?;
        Some((ours.replace("search_", ""), Rule::Rank(threshold)))
    });
    let targets = Targets {
        rule: Rule::Ratio(0.0),
        layers: rules.collect(),
    };
    assert_eq!(targets.layers.len(), 13);
    let full = Architecture::new(Widths::FULL, None);
    let keep = choose(&full, &ranks, &BTreeMap::new(), &targets).unwrap();
    let pruned = keep.architecture(&full);
    assert_eq!(pruned.parameters(), 7_489_986);
    let expected = Widths {
        backbone: [76, 224, 337, 334, 256],
        neck_cls: 256,
        neck_reg: 256,
        head_cls: [230, 138, 224],
        head_reg: [227, 145, 224],
    };
    assert_eq!(pruned.widths, expected);

    // The same ranks under one ratio, for the totals of docs/method.md, section 1.6.
    for (tenths, total) in [
        (0, 9_655_380),
        (1, 7_796_411),
        (2, 6_145_199),
        (3, 4_725_663),
        (4, 3_461_819),
        (5, 2_425_396),
        (6, 1_543_163),
        (7, 862_927),
        (8, 389_231),
    ] {
        let targets = Targets::ratio(f64::from(tenths) / 10.0);
        let keep = choose(&full, &ranks, &BTreeMap::new(), &targets).unwrap();
        assert_eq!(
            keep.architecture(&full).parameters(),
            total,
            "ratio 0.{tenths}"
        );
        assert_eq!(keep.of("neck.template_cls"), keep.of("neck.search_cls"));
        // Nothing that goes has a higher rank than what stays.
        let (conv4, kept) = (
            ranks.of("backbone.conv4").unwrap(),
            keep.of("backbone.conv4").unwrap(),
        );
        let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
        for (i, rank) in conv4.iter().enumerate() {
            if kept.contains(&i) {
                least = least.min(*rank)
            } else {
                most = most.max(*rank)
            }
        }
        assert!(least >= most, "{least} {most}");
    }
}

fn tiny(encoder: Option<Encoder>, nets: StatisticsNets) -> Fit {
    let widths = Widths::uniform([6, 8, 10, 10, 8], 8);
    let architecture = Architecture {
        search_size: 191,
        ..Architecture::new(widths, encoder)
    };
    let options = FitOptions {
        architecture,
        early_size: 191,
        statistics_nets: nets,
        ..FitOptions::cpu()
    };
    let mut fit = Fit::start(options, vec!["scenes".into()], DataOptions::default()).unwrap();
    // Statistics, scales and shifts as different as those of a trained network.
    let values: Vec<_> = fit
        .parameters()
        .state()
        .map(|(n, t)| (n.to_owned(), t.clone()))
        .collect();
    let position = fit.position().clone();
    let changed = values
        .into_iter()
        .enumerate()
        .map(|(i, (name, mut value))| {
            let mut rng = Rng::new(3, 4, i as u64);
            let (low, high) = match name.rsplit('.').next().unwrap() {
                "scale" => (0.6, 1.4),
                "shift" | "mean" | "bias" => (-0.3, 0.3),
                "variance" => (0.5, 2.0),
                _ => return (name, value),
            };
            value
                .data_mut()
                .iter_mut()
                .for_each(|v| *v = rng.range(low, high));
            (name, value)
        });
    fit = Fit::with_parameters(position, changed.collect::<Vec<_>>()).unwrap();
    fit
}

fn outputs(fit: &Fit) -> [Vec<f32>; 3] {
    let compute = compute(1).unwrap();
    let mut rng = Rng::new(5, 6, 7);
    let mut crops = |side: usize| {
        Tensor::new(
            &[1, side, side, 3],
            (0..side * side * 3).map(|_| rng.normal()).collect(),
        )
    };
    let (template, search) = (crops(127), crops(fit.network().architecture().search_size));
    let mut parameters = fit.deployed();
    let mut tape = Tape::new(&compute, &mut parameters, Mode::Evaluation);
    let found = fit.network().predict(&mut tape, template, search);
    [found.score, found.centerness, found.offsets].map(|var| tape.value(var).data().to_vec())
}

/// Targets that leave each layer as many filters.
fn counts(of: &Fit, count: impl Fn(usize) -> usize) -> Targets {
    // A ratio that leaves exactly this many of the unpruned network's.
    let all = of
        .network()
        .architecture()
        .widths
        .all()
        .into_iter()
        .zip(Widths::FULL.all());
    let rules = all.zip(LAYERS).map(|((now, full), layer)| {
        (
            layer.to_owned(),
            Rule::Ratio(1.0 - count(now) as f64 / full as f64),
        )
    });
    Targets {
        rule: Rule::Ratio(0.0),
        layers: rules.collect(),
    }
}

fn ranks_of(fit: &Fit) -> Ranks {
    let folder = Folder::new("ranks");
    let dataset = Dataset::open(
        &[pictures(&folder).parse().unwrap()],
        DataOptions::default(),
    )
    .unwrap();
    Ranks::measure(fit, &dataset, 3, 2).unwrap()
}

#[test]
fn pruning_nothing_keeps_every_value() {
    for (encoder, nets) in [
        (None, StatisticsNets::None),
        (Some(Encoder::standard(8)), StatisticsNets::Light),
        (Some(Encoder::standard(6)), StatisticsNets::Full),
    ] {
        let fit = tiny(encoder, nets);
        let pruned = prune(&fit, &Ranks::default(), &counts(&fit, |n| n)).unwrap();
        assert_eq!(
            pruned.fit.network().architecture(),
            fit.network().architecture()
        );
        assert!(
            fit.parameters().state().eq(pruned.fit.parameters().state()),
            "{encoder:?}"
        );
        assert_eq!(outputs(&fit), outputs(&pruned.fit), "the same bits");
    }
}

#[test]
fn pruning_dead_filters_keeps_the_outputs() {
    for encoder in [None, Some(Encoder::standard(8))] {
        let nets = if encoder.is_some() {
            StatisticsNets::Full
        } else {
            StatisticsNets::None
        };
        let fit = tiny(encoder, nets);
        // Every second filter of every layer makes nothing but zeros.
        let dead = |name: &str| {
            !name.starts_with("mi.")
                && !["head.score", "head.centerness", "head.offsets"]
                    .iter()
                    .any(|o| name.starts_with(o))
        };
        let planted = fit.parameters().state().map(|(name, value)| {
            let mut value = value.clone();
            let per_filter = value.data().len() / value.shape().first().copied().unwrap_or(1);
            let part = name.rsplit('.').next().unwrap_or_default();
            if dead(name) && ["weight", "bias", "shift", "mean"].contains(&part) {
                for filter in value.data_mut().chunks_mut(per_filter).skip(1).step_by(2) {
                    filter.fill(0.0);
                }
            }
            (name.to_owned(), value)
        });
        let planted =
            Fit::with_parameters(fit.position().clone(), planted.collect::<Vec<_>>()).unwrap();
        let ranks = ranks_of(&planted);
        assert_eq!(ranks.of("backbone.conv3").unwrap()[1], 0.0);
        let pruned = prune(&planted, &ranks, &counts(&planted, |n| n.div_ceil(2))).unwrap();
        assert_eq!(
            pruned.fit.network().architecture().widths.backbone,
            [3, 4, 5, 5, 4]
        );
        assert_eq!(
            pruned.fit.network().architecture().encoder.map(|e| e.width),
            encoder.map(|_| 4)
        );
        for row in &pruned.rows {
            assert!(
                row.ranks[0].unwrap() > 0.0 && row.ranks[1] == Some(0.0),
                "{row:?}"
            );
        }
        for (before, after) in outputs(&planted).iter().zip(outputs(&pruned.fit)) {
            let scale = before.iter().map(|v| v.abs()).fold(1.0, f32::max);
            let worst = before
                .iter()
                .zip(&after)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f32::max);
            assert!(worst < 1e-4 * scale, "{worst} of {scale}");
        }
    }
}

#[test]
fn pruned_network_is_a_checkpoint_to_train_from() {
    let fit = tiny(Some(Encoder::standard(8)), StatisticsNets::Light);
    let pruned = prune(&fit, &ranks_of(&fit), &counts(&fit, |n| n - 2)).unwrap();
    let folder = Folder::new("prune");
    let path = folder.path().join("pruned.safetensors");
    pruned.fit.save(&path).unwrap();
    let resumed = Fit::resume(&path).unwrap();
    assert_eq!(outputs(&resumed), outputs(&pruned.fit));
    assert_eq!(
        (resumed.position().step, resumed.position().history.len()),
        (0, 1)
    );
    let mut next = Fit::start(
        resumed.position().options.clone(),
        vec![],
        DataOptions::default(),
    )
    .unwrap();
    assert_eq!(next.take_over(&resumed), [""; 0], "every tensor fits");
    assert_eq!(outputs(&next), outputs(&resumed));
    assert!(
        pruned.to_string().contains("backbone.conv1") && pruned.rows.len() == 15,
        "{pruned}"
    );
}

#[test]
fn impossible_pruning_targets_are_refused() {
    let fit = tiny(None, StatisticsNets::None);
    let refused = |targets: &Targets| {
        prune(&fit, &Ranks::default(), targets)
            .err()
            .unwrap()
            .to_string()
    };
    let message = refused(&Targets::ratio(0.5));
    assert!(
        message.contains("1 to 6 filters in backbone.conv1, found 48"),
        "{message}"
    );
    let mut targets = counts(&fit, |n| n);
    targets
        .layers
        .insert("backbone.conv9".into(), Rule::Ratio(0.5));
    assert!(refused(&targets).contains("backbone.conv9"));
    let mut targets = counts(&fit, |n| n);
    targets.layers.insert("head.cls2".into(), Rule::Rank(1.0));
    assert!(refused(&targets).contains("filters in head.cls2, found 0"));
    assert!(standard(0.75).widths.backbone == [24, 64, 96, 96, 64]);
}
