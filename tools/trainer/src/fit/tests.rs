//! The loop: bit-identical after an interruption, and able to learn.

use super::*;
use crate::data::augment::Augment;
use crate::testing::{Folder, pictures};
use weights_format::{Architecture, Encoder, Widths};

fn tiny() -> FitOptions {
    let widths = Widths::uniform([4, 6, 8, 8, 8], 8);
    FitOptions {
        architecture: Architecture {
            search_size: 191,
            ..Architecture::new(widths, Some(Encoder::standard(8)))
        },
        early_size: 183,
        batch: 2,
        budget: Budget::Steps(40),
        estimation_batches: 3,
        average: 0.9,
        ..FitOptions::cpu()
    }
}

fn open(fit: &Fit) -> Arc<Dataset> {
    let Position {
        data, data_options, ..
    } = fit.position();
    let specs: Vec<_> = data.iter().map(|text| text.parse().unwrap()).collect();
    Arc::new(Dataset::open(&specs, data_options.clone()).unwrap())
}

fn run_options(folder: &Folder, name: &str) -> RunOptions {
    RunOptions {
        out: folder.path().join(name),
        threads: 2,
        data_threads: 2,
        checkpoint_minutes: 1e9,
        validate_minutes: 1e9,
        validation: Validation::default(),
        stop_after: None,
    }
}

#[test]
fn interrupted_run_ends_in_the_same_bits() {
    let folder = Folder::new("fit");
    for optimizer in [OptimizerKind::AdamW, OptimizerKind::Sgd] {
        let options = FitOptions {
            optimizer,
            ..tiny()
        };
        let start = || {
            Fit::start(
                options.clone(),
                vec![pictures(&folder)],
                DataOptions::default(),
            )
            .unwrap()
        };
        let mut straight = start();
        straight
            .run(open(&straight), &run_options(&folder, "straight"))
            .unwrap();

        let mut halted = start();
        let mut run = run_options(&folder, "halted");
        run.stop_after = Some(17);
        run.data_threads = 1;
        halted.run(open(&halted), &run).unwrap();
        let path = folder.path().join("halted.safetensors");
        halted.save(&path).unwrap();
        drop(halted);
        let mut resumed = Fit::resume(&path).unwrap();
        assert_eq!(resumed.position().step, 17);
        run.stop_after = None;
        resumed.run(open(&resumed), &run).unwrap();

        assert_eq!(resumed.position().step, 40);
        for (a, b) in straight
            .parameters()
            .state()
            .zip(resumed.parameters().state())
        {
            let bits = |t: &Tensor| t.data().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert!(a.0 == b.0 && bits(a.1) == bits(b.1), "{}", a.0);
        }
        let file = |name: &str| {
            std::fs::read(folder.path().join(name).join("weights.safetensors")).unwrap()
        };
        assert_eq!(file("straight").len(), file("halted").len());
    }
}

#[test]
fn tiny_network_overfits_a_few_pairs() {
    let folder = Folder::new("fit");
    let options = FitOptions {
        batch: 6,
        budget: Budget::Steps(400),
        peak_rate: 4e-3,
        early_share: 0.0,
        average: 0.0,
        estimation_batches: 0,
        ..tiny()
    };
    let data = DataOptions {
        augment: Augment::none(),
        negatives: 0.0,
        ..DataOptions::default()
    };
    let mut fit = Fit::start(options, vec![pictures(&folder)], data).unwrap();
    let dataset = open(&fit);
    let compute = compute(2).unwrap();
    // The same six samples at every step.
    let samples: Vec<_> = (0..6).map(|i| dataset.sample(i, 191)).collect();
    let mut all = Vec::new();
    for _ in 0..400 {
        let batch = batch::batch(&samples, fit.network.architecture());
        all.push(fit.step(&compute, batch).unwrap().0);
    }
    let (first, last) = (all[0], all[399]);
    assert!(
        last.iou < 0.35 * first.iou,
        "IoU loss {} -> {}",
        first.iou,
        last.iou
    );
    assert!(
        last.cls < 0.3 * first.cls,
        "classification loss {} -> {}",
        first.cls,
        last.cls
    );
    assert!(
        last.total < 0.4 * first.total,
        "total {} -> {}",
        first.total,
        last.total
    );
}

#[test]
fn loss_that_is_not_finite_stops_the_run() {
    let folder = Folder::new("fit");
    let mut fit = Fit::start(tiny(), vec![pictures(&folder)], DataOptions::default()).unwrap();
    fit.parameters.iter_mut().next().unwrap().value.data_mut()[0] = f32::NAN;
    let error = fit
        .run(open(&fit), &run_options(&folder, "nan"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("step 0") && error.contains("expected a finite number"),
        "{error}"
    );
}

#[test]
fn take_over_copies_parameters_that_fit() {
    let folder = Folder::new("fit");
    let data = vec!["scenes".to_owned()];
    let small = Fit::start(tiny(), data.clone(), DataOptions::default()).unwrap();
    let path = folder.path().join("c.safetensors");
    small.save(&path).unwrap();
    let options = FitOptions {
        seed: 9,
        statistics_nets: crate::network::StatisticsNets::Full,
        ..tiny()
    };
    let mut other = Fit::start(options, data, DataOptions::default()).unwrap();
    let fresh = other.take_over(&Fit::open(&path).unwrap());
    assert!(
        !fresh.is_empty() && fresh.iter().all(|name| name.starts_with("mi.")),
        "{fresh:?}"
    );
    let value = |fit: &Fit| fit.parameters.iter().next().unwrap().value.clone();
    assert_eq!(value(&small), value(&other));
}

#[test]
fn estimated_statistics_equal_those_of_the_data() {
    let folder = Folder::new("fit");
    let mut fit = Fit::start(tiny(), vec![pictures(&folder)], DataOptions::default()).unwrap();
    let compute = compute(2).unwrap();
    let dataset = open(&fit);
    let mut feed = Feed::new(dataset.clone(), 2, 5, 1, 2);
    statistics::estimate(&compute, &fit.network, &mut fit.parameters, &mut feed, 2);
    // By hand: conv1's outputs on the same crops, template and search crop apart.
    let parameter = |name: &str| {
        fit.parameters[fit.parameters.find(name).unwrap()]
            .value
            .data()
            .to_vec()
    };
    let (weight, found) = (
        parameter("backbone.conv1.weight"),
        parameter("backbone.conv1.bn.mean"),
    );
    let crops: Vec<_> = (10..14).map(|i| dataset.sample(i, 191)).collect();
    let mean = |crop: &[u8], side: usize| {
        let out = (side - 11) / 2 + 1;
        let mut sum = 0.0;
        for y in 0..out {
            for x in 0..out {
                for (k, weight) in weight.iter().enumerate().take(121 * 3) {
                    let (row, column, channel) = (2 * y + k / 33, 2 * x + k / 3 % 11, k % 3);
                    let value = f64::from(crop[(row * side + column) * 3 + channel]);
                    sum += f64::from(*weight) * (value - 114.0) / 58.0;
                }
            }
        }
        sum / (out * out) as f64
    };
    let template: f64 = crops.iter().map(|s| mean(&s.template, 127)).sum::<f64>() / 4.0;
    let search: f64 = crops.iter().map(|s| mean(&s.search, 191)).sum::<f64>() / 4.0;
    let expected = (0.9 * template + search) / 1.9; // the later pass counts a tenth more
    assert!(
        (f64::from(found[0]) - expected).abs() < 1e-3,
        "{}, expected {expected}",
        found[0]
    );
    let e1 = parameter("dr.e1.0.bn.variance");
    assert!(
        e1.iter().all(|v| *v == 1.0),
        "what is not deployed keeps its statistics"
    );
}
