//! Studies: skipped where done, continued where interrupted, refused where different; their tables.

use super::*;
use crate::data::DataOptions;
use crate::fit::{Budget, standard};
use crate::testing::{Folder, pictures};
use crate::validate::{Accuracy, Passes, Validation};
use weights_format::{Architecture, Encoder, Widths};

fn outcome(group: &str, seed: u64, auc: f64) -> Outcome {
    let options = FitOptions {
        seed,
        architecture: standard(0.5),
        ..FitOptions::cpu()
    };
    let accuracy = Some(Accuracy {
        precision: auc + 10.0,
        auc,
    });
    Outcome {
        group: group.into(),
        parameters: options.architecture.parameters(),
        macs: options.architecture.macs_search(),
        options,
        data_options: DataOptions::default(),
        data: vec!["scenes".into()],
        steps: 100,
        seconds: 60.0,
        report: Report {
            clean: accuracy,
            ..Report::default()
        },
    }
}

#[test]
fn table_has_means_and_deviations_over_seeds() {
    let outcomes = [
        outcome("full", 1, 60.0),
        outcome("no-mi", 1, 50.0),
        outcome("full", 2, 64.0),
    ];
    assert_eq!(
        markdown("variant", &outcomes),
        "| variant | parameters | MMAC | runs | pairs each | clean precision | clean AUC |\n\
         | --- | --- | --- | --- | --- | --- | --- |\n\
         | full | 2573236 | 2445.4 | 2 | 1600 | 72.0 ± 2.8 | 62.0 ± 2.8 |\n\
         | no-mi | 2573236 | 2445.4 | 1 | 1600 | 60.0 | 50.0 |\n"
    );
    let value: serde_json::Value = serde_json::from_str(&json("variant", &outcomes)).unwrap();
    assert_eq!(value["rows"][0]["accuracy"]["clean"]["auc"]["mean"], 62.0);
    assert_eq!(value["rows"][0]["seeds"], serde_json::json!([1, 2]));
    assert!(value["rows"][1]["accuracy"]["clean"]["auc"]["deviation"].is_null());
    assert_eq!(value["runs"].as_array().unwrap().len(), 3);
    let svg = svg("variant", &outcomes);
    assert!(svg.contains("clean, percent, against variant") && svg.contains(">no-mi<"));
    assert_eq!(svg.matches("<circle").count(), 4);
}

fn tiny() -> FitOptions {
    let widths = Widths::uniform([6, 6, 8, 8, 6], 6);
    let architecture = Architecture {
        search_size: 191,
        ..Architecture::new(widths, Some(Encoder::standard(6)))
    };
    FitOptions {
        architecture,
        early_size: 183,
        batch: 2,
        budget: Budget::Steps(3),
        estimation_batches: 0,
        average: 0.5,
        ..FitOptions::cpu()
    }
}

fn run_options(out: &Path) -> RunOptions {
    RunOptions {
        out: out.into(),
        processes: std::sync::Arc::new(autodiff::OneProcess),
        threads: 2,
        data_threads: 1,
        checkpoint_minutes: 0.0,
        validate_minutes: 1e9,
        validation: Validation::open(&[], Passes::One, 1, 3).unwrap(),
        stop_after: None,
    }
}

#[test]
fn restarted_study_skips_finished_and_continues_others() {
    let folder = Folder::new("study");
    let data = vec![pictures(&folder)];
    let data_options = DataOptions::default();
    let study = ablation(
        &tiny(),
        &data,
        &data_options,
        &[1],
        &VARIANTS.map(String::from),
    );
    let names: Vec<_> = study.variants.iter().map(Variant::name).collect();
    assert_eq!(
        names,
        [
            "full-seed1",
            "no-mi-seed1",
            "no-identity-seed1",
            "no-encoder-seed1"
        ]
    );
    let run = run_options(folder.path());

    // The first is done, the second is interrupted after a step.
    let first = Study {
        variants: study.variants[..1].to_vec(),
        ..study.clone()
    };
    let before = first.run(&run).unwrap();
    let variant = &study.variants[1];
    let interrupted = RunOptions {
        out: folder.path().join("no-mi-seed1"),
        stop_after: Some(1),
        ..run.clone()
    };
    let mut fit = Fit::start(
        variant.options.clone(),
        data.clone(),
        variant.data_options.clone(),
    )
    .unwrap();
    let dataset = Arc::new(study.dataset(variant).unwrap());
    fit.run(dataset.clone(), &interrupted).unwrap();
    let outcomes = study.run(&run).unwrap();

    assert_eq!(outcomes.len(), 4);
    assert_eq!(
        outcomes[0], before[0],
        "not run again: even its seconds are the same"
    );
    assert!(
        outcomes
            .iter()
            .all(|o| o.steps == 3 && o.report.flights.is_some())
    );
    let whole = RunOptions {
        out: folder.path().join("whole"),
        ..run.clone()
    };
    let mut fit = Fit::start(variant.options.clone(), data, variant.data_options.clone()).unwrap();
    fit.run(dataset, &whole).unwrap();
    let read = |name: &str| {
        let path = folder.path().join(name).join("weights.safetensors");
        weights_format::Weights::read(&path).unwrap()
    };
    assert!(
        read("no-mi-seed1").tensors().eq(read("whole").tensors()),
        "as if never interrupted"
    );
    let table = std::fs::read_to_string(folder.path().join("table.md")).unwrap();
    assert_eq!(table.lines().count(), 6, "{table}");
    assert!(folder.path().join("plot.svg").exists() && folder.path().join("table.json").exists());

    let mut other = study.clone();
    other.variants[0].options.peak_rate = 1e-3;
    let message = other.run(&run).unwrap_err().to_string();
    assert!(
        message.contains("other training options") && message.contains("full-seed1"),
        "{message}"
    );
    let blind = RunOptions {
        validation: Validation::default(),
        ..run
    };
    assert!(
        study
            .run(&blind)
            .unwrap_err()
            .to_string()
            .contains("--validate")
    );
}

#[test]
fn sweep_prunes_and_trains() {
    let folder = Folder::new("sweep");
    let data = vec![pictures(&folder)];
    let data_options = DataOptions::default();
    let options = FitOptions {
        architecture: Architecture {
            search_size: 191,
            ..standard(0.9)
        },
        ..tiny()
    };
    let mut source = Fit::start(options.clone(), data.clone(), data_options.clone()).unwrap();
    let mut study = |ratios: &[f64]| {
        sweep(
            &mut source,
            ratios,
            &options,
            (&data, &data_options),
            2,
            (folder.path(), 2),
        )
    };
    let found = study(&[0.9, 0.95]).unwrap();
    let widths: Vec<_> = found
        .variants
        .iter()
        .map(|v| v.options.architecture.widths)
        .collect();
    assert_eq!(widths, [Widths::pruned(0.9), Widths::pruned(0.95)]);
    let message = study(&[0.8]).err().unwrap().to_string();
    assert!(message.contains("backbone.conv1"), "{message}");
    let outcomes = found.run(&run_options(folder.path())).unwrap();
    assert_eq!(
        outcomes[1].parameters,
        outcomes[1].options.architecture.parameters()
    );
    let weights =
        weights_format::Weights::read(&folder.path().join("0.95-seed0/weights.safetensors"))
            .unwrap();
    assert!(
        weights.header.provenance.notes["before"]
            .contains("pruned by rank over 2 pairs to 4/12/19/19/12")
    );
}
