//! Network and crop against reference tensors from independent code.
//!
//! Skipped without the reference data (see `testing::shared`).

use kernels::conv::Algorithm;
use safetensors::SafeTensors;
use std::collections::HashMap;
use testing::shared;
use track_cpu::net::Network;
use track_cpu::{BBox, ChannelOrder, Frame, Isa, Model, TrackConfig, Tracker, TrackerOptions};

type Tensors = HashMap<String, (Vec<usize>, Vec<f32>)>;

const GOLDEN: &str = "golden/UAV123_10fps__group1_2";

fn golden() -> Option<Tensors> {
    let path = shared(&format!("{GOLDEN}.safetensors"))?;
    let bytes = std::fs::read(path).unwrap();
    let file = SafeTensors::deserialize(&bytes).unwrap();
    let mut tensors = Tensors::new();
    for (name, view) in file.iter() {
        let floats = view.data().as_chunks().0.iter();
        let values = floats.map(|&bytes| f32::from_le_bytes(bytes)).collect();
        tensors.insert(name.to_owned(), (view.shape().to_vec(), values));
    }
    Some(tensors)
}

/// A CHW crop of whole numbers as HWC bytes.
fn crop_bytes((shape, values): &(Vec<usize>, Vec<f32>)) -> Vec<u8> {
    let area = shape[1] * shape[2];
    (0..3 * area)
        .map(|i| values[i % 3 * area + i / 3] as u8)
        .collect()
}

/// Largest distance of our map (HWC) from the reference (CHW, perhaps only its first channels), as
/// a share of the reference's RMS.
fn distance(ours: &[f32], channels: usize, (shape, reference): &(Vec<usize>, Vec<f32>)) -> f64 {
    let area = reference.len() / shape[0];
    assert_eq!(ours.len() / channels, area, "map of another size");
    let rms = (reference.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>()
        / reference.len() as f64)
        .sqrt();
    let error = |i: usize| f64::from((ours[i % area * channels + i / area] - reference[i]).abs());
    (0..reference.len()).map(error).fold(0.0, f64::max) / rms
}

/// The [`distance`] after one scaling and one shift of the reference.
///
/// The converter folds the head's two scalars into the offsets; the reference keeps them separate.
fn distance_after_scaling(
    ours: &[f32],
    channels: usize,
    (shape, reference): &(Vec<usize>, Vec<f32>),
) -> f64 {
    let (area, n) = (reference.len() / shape[0], reference.len() as f64);
    let pairs = || {
        (0..reference.len()).map(|i| {
            (
                f64::from(reference[i]),
                f64::from(ours[i % area * channels + i / area]),
            )
        })
    };
    let mx = pairs().map(|p| p.0).sum::<f64>() / n;
    let my = pairs().map(|p| p.1).sum::<f64>() / n;
    let slope = pairs().map(|(x, y)| (x - mx) * (y - my)).sum::<f64>()
        / pairs().map(|(x, _)| (x - mx).powi(2)).sum::<f64>();
    assert!(slope > 0.5 && slope < 2.0, "offsets are scaled by {slope}");
    let scaled: Vec<f32> = reference
        .iter()
        .map(|x| (my + slope * (f64::from(*x) - mx)) as f32)
        .collect();
    distance(ours, channels, &(shape.clone(), scaled))
}

/// Our names of the layers and the reference's names.
const STAGES: [(&str, &str); 16] = [
    ("backbone.pool1", "pool1"),
    ("backbone.pool2", "pool2"),
    ("backbone.conv3", "conv3"),
    ("backbone.conv4", "conv4"),
    ("backbone.conv5", "conv5"),
    ("dr.e2.0", "dr_e2"),
    ("neck.search_cls", "c_x"),
    ("neck.search_reg", "r_x"),
    ("head.cls1", "cls_p5_conv1"),
    ("head.cls2", "cls_p5_conv2"),
    ("head.cls3", "cls_p5_conv3"),
    ("head.reg1", "bbox_p5_conv1"),
    ("head.reg2", "bbox_p5_conv2"),
    ("head.reg3", "bbox_p5_conv3"),
    ("head.score", "cls_score_p5"),
    ("head.centerness", "ctr_score_p5"),
];

#[test]
fn every_stage_on_every_isa_is_within_a_thousandth_of_the_reference() {
    let (Some(golden), Some(checkpoint)) = (golden(), shared("checkpoints/drmim_p50_probe.pth"))
    else {
        return;
    };
    let weights = converter::convert(&checkpoint, &Default::default())
        .unwrap()
        .weights;
    for isa in Isa::available() {
        for algorithm in Algorithm::ALL {
            let model = Model::with_algorithm(&weights, isa, algorithm).unwrap();
            check_stages(&golden, model, &format!("{isa} {}", algorithm.name()));
        }
        check_stages(
            &golden,
            Model::from_weights(&weights, isa).unwrap(),
            &format!("{isa}, as planned"),
        );
    }
}

fn check_stages(golden: &Tensors, model: Model, what: &str) {
    let mut network = Network::new(model, 2);
    let check = |network: &Network, branch: &str, ours: &str, reference: &str| {
        let (_, map) = network.maps().find(|(name, _)| *name == ours).unwrap();
        let error = distance(
            map.values(),
            map.channels(),
            &golden[&format!("{branch}.{reference}")],
        );
        assert!(
            error < 1e-3,
            "{what}: {branch} {ours} is {error:.1e} of the RMS away"
        );
    };
    network.set_template(&crop_bytes(&golden["template.crop"]));
    for (ours, reference) in [
        ("backbone.conv5", "conv5"),
        ("dr.e2.0", "dr_e2"),
        ("neck.template_cls", "c_z_k"),
        ("neck.template_reg", "r_z_k"),
    ] {
        check(&network, "template", ours, reference);
    }
    let outputs = network.search(&crop_bytes(&golden["search.crop"])).clone();
    for (ours, reference) in STAGES {
        check(&network, "search", ours, reference);
    }
    let (_, offsets) = network
        .maps()
        .find(|(name, _)| *name == "head.offsets")
        .unwrap();
    let error = distance_after_scaling(offsets.values(), 4, &golden["search.bbox_offsets_p5"]);
    assert!(
        error < 1e-3,
        "{what}: offsets are {error:.1e} of the RMS away"
    );
    let error = distance(
        &outputs.score,
        1,
        &(vec![1], golden["search.score"].1.clone()),
    );
    assert!(error < 1e-3, "{what}: score is {error:.1e} of the RMS away");
}

#[test]
fn crops_are_within_one_gray_level_of_the_reference() {
    let Some(golden) = golden() else { return };
    let frames: Vec<_> = ["frame1", "frame2"]
        .into_iter()
        .filter_map(|frame| shared(&format!("{GOLDEN}.{frame}.png")))
        .map(|path| image::open(path).unwrap().to_rgb8())
        .collect();
    let frame = |i: usize| {
        let (w, h) = (frames[i].width() as usize, frames[i].height() as usize);
        Frame::new(frames[i].as_raw(), w, h, ChannelOrder::Rgb).unwrap()
    };
    // Without correction and filter `init` makes no search, so the last crop is the template's.
    let model = Model::builtin(Isa::detect());
    let config = TrackConfig {
        correction: 0.0,
        online_filter: 0.0,
        ..model.config()
    };
    let options = TrackerOptions {
        config,
        ..TrackerOptions::of(&model)
    };
    let mut tracker = Tracker::with_options(model, options);
    tracker
        .init(&frame(0), BBox::new(806.0, 196.0, 31.0, 82.0))
        .unwrap();
    check_crop("template", tracker.last_crop(), &golden["template.crop"]);
    tracker.update(&frame(1)).unwrap();
    check_crop("search", tracker.last_crop(), &golden["search.crop"]);
}

fn check_crop(name: &str, ours: &[u8], reference: &(Vec<usize>, Vec<f32>)) {
    let reference = crop_bytes(reference);
    let pixels = ours.chunks_exact(3).zip(reference.chunks_exact(3));
    let far = pixels
        .filter(|(a, b)| a.iter().zip(*b).any(|(a, b)| a.abs_diff(*b) > 1))
        .count();
    let share = far as f64 / (ours.len() / 3) as f64;
    assert!(
        share <= 0.001,
        "{name}: {:.3} % of the pixels differ by more than one gray level",
        100.0 * share
    );
}
