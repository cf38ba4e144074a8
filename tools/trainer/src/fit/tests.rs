//! The loop: bit-identical after an interruption, and able to learn.

use super::*;
use crate::data::augment::Augment;
use crate::testing::{Folder, Member, pictures};
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
        processes: Arc::new(autodiff::OneProcess),
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
    let mut feed = Feed::new(dataset.clone(), Part::all(2), 5, 1, 2);
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

/// Runs `work` in each of several processes at once.
fn in_processes<T: Send>(size: usize, work: impl Fn(Arc<dyn ProcessGroup>) -> T + Sync) -> Vec<T> {
    std::thread::scope(|scope| {
        let work = &work;
        let members = Member::group(size).into_iter();
        let threads: Vec<_> = members
            .map(|process| scope.spawn(move || work(Arc::new(process))))
            .collect();
        threads.into_iter().map(|t| t.join().unwrap()).collect()
    })
}

/// Options with batches of four, and an optimizer that does not enlarge rounding errors.
fn shared() -> FitOptions {
    FitOptions {
        batch: 4,
        optimizer: OptimizerKind::Sgd,
        peak_rate: 0.01,
        budget: Budget::Steps(8),
        clip: 1.0,
        ..tiny()
    }
}

/// Names and values of all parameters and statistics.
fn values(fit: &Fit) -> Vec<(String, Vec<f32>)> {
    let parameters = fit.parameters().state();
    parameters
        .map(|(name, value)| (name.to_owned(), value.data().to_vec()))
        .collect()
}

/// One step with the losses, gradients and batch statistics that it makes.
fn one_step(fit: &mut Fit, processes: Arc<dyn ProcessGroup>) -> (LossValues, Vec<f32>, Vec<f32>) {
    let dataset = open(fit);
    let part = Part::of(fit.position().options.batch, &*processes).unwrap();
    let compute = compute(1).unwrap().with_processes(processes);
    let mut feed = Feed::new(dataset, part, 3, 1, 1);
    let batch = batch::batch(&feed.next(|_| 191), fit.network.architecture());
    let (losses, _, _) = fit.step(&compute, batch).unwrap();
    let gradients = fit.parameters.iter().filter_map(|p| p.gradient.as_ref());
    let statistics = fit.parameters.iter().filter(|p| p.is_statistic());
    (
        losses,
        gradients.flat_map(|g| g.data().to_vec()).collect(),
        statistics.flat_map(|p| p.value.data().to_vec()).collect(),
    )
}

/// The norm of `a - b`, relative to that of `b`. Some parameters have a gradient of 0 but for
/// rounding, such as biases before a normalization: they count as no smaller than 0.001.
fn distance(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let norm = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let difference = norm(&mut a.iter().zip(b).map(|(a, b)| f64::from(*a) - f64::from(*b)));
    difference / norm(&mut b.iter().map(|v| f64::from(*v))).max(1e-3)
}

#[test]
fn gradients_of_several_processes_equal_those_of_one_with_the_whole_batch() {
    let folder = Folder::new("fit");
    let data = vec![pictures(&folder)];
    for statistics_nets in [
        crate::network::StatisticsNets::Light,
        crate::network::StatisticsNets::Full,
    ] {
        let start = || {
            let options = FitOptions {
                statistics_nets,
                ..shared()
            };
            Fit::start(options, data.clone(), DataOptions::default()).unwrap()
        };
        let one = one_step(&mut start(), Arc::new(autodiff::OneProcess));
        for size in [2, 4] {
            let all = in_processes(size, |process| one_step(&mut start(), process));

            for (losses, gradients, statistics) in &all {
                for ((name, found), (_, expected)) in losses.named().iter().zip(one.0.named()) {
                    assert!(
                        (found - expected).abs() < 1e-5 * expected.abs().max(0.01),
                        "{name}: {found}, expected {expected}"
                    );
                }
                let far = distance(gradients, &one.1);
                assert!(far < 1e-5, "{size} processes: gradients {far}");
                let far = distance(statistics, &one.2);
                assert!(far < 1e-6, "{size} processes: statistics {far}");
            }
            assert!(
                all.iter().all(|process| *process == all[0]),
                "the same bits"
            );
        }
    }
}

#[test]
fn two_processes_train_to_the_weights_of_one_and_the_first_alone_writes() {
    let folder = Folder::new("fit");
    let data = vec![pictures(&folder)];
    let start = || Fit::start(shared(), data.clone(), DataOptions::default()).unwrap();
    let mut one = start();
    one.run(open(&one), &run_options(&folder, "one")).unwrap();

    let all = in_processes(2, |process| {
        let mut fit = start();
        let run = RunOptions {
            out: folder.path().join(format!("process{}", process.rank())),
            threads: 1,
            checkpoint_minutes: 0.0,
            processes: process,
            ..run_options(&folder, "")
        };
        fit.run(open(&fit), &run).unwrap();
        values(&fit)
    });

    assert!(all[0] == all[1], "the same bits");
    for ((name, found), (_, expected)) in all[0].iter().zip(values(&one)) {
        let far = distance(found, &expected);
        assert!(far < 1e-4, "{name}: {far}");
    }
    let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).unwrap();
    assert_eq!(
        read("one/log.jsonl").lines().count(),
        read("process0/log.jsonl").lines().count()
    );
    assert!(folder.path().join("process0/weights.safetensors").is_file());
    assert!(!folder.path().join("process1").exists());
}

#[test]
fn processes_with_other_weights_are_refused_by_all() {
    let folder = Folder::new("fit");
    let data = vec![pictures(&folder)];

    let refused = in_processes(2, |process| {
        let mut fit = Fit::start(shared(), data.clone(), DataOptions::default()).unwrap();
        let scalar = fit.parameters.find("head.si").unwrap();
        fit.parameters[scalar].value.data_mut()[0] += process.rank() as f32;
        let dataset = open(&fit);
        let compute = compute(1).unwrap().with_processes(process);
        agree(&fit, &dataset, &compute).unwrap_err().to_string()
    });

    for refused in refused {
        assert_eq!(
            refused,
            "process 1: expected the weights of process 0, found others"
        );
    }
}

#[test]
fn weights_file_unfolds_alike_in_several_processes() {
    let folder = Folder::new("fit");
    let data = vec![pictures(&folder)];
    let path = folder.path().join("weights.safetensors");
    let fit = Fit::start(shared(), data.clone(), DataOptions::default()).unwrap();
    let weights = fit.export(Storage::F32, "tiny", None).unwrap();
    weights.write(&path).unwrap();
    let unfolded = |process: Arc<dyn ProcessGroup>| {
        let mut fit = Fit::open(&path).unwrap();
        fit.train_on(data.clone(), DataOptions::default());
        let compute = compute(1).unwrap().with_processes(process);
        fit.unfold(&compute, &open(&fit), 1).unwrap();
        values(&fit)
    };

    let one = unfolded(Arc::new(autodiff::OneProcess));
    let all = in_processes(2, unfolded);

    assert!(all[0] == all[1], "the same bits");
    for ((name, found), (_, expected)) in all[0].iter().zip(&one) {
        let close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-5 * b.abs().max(1e-3);
        assert!(found.iter().zip(expected).all(close), "{name}");
    }
}
