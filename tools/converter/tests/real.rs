//! A checkpoint that PyTorch wrote, and the program itself.

mod common;

use converter::{Options, convert};
use std::{
    path::{Path, PathBuf},
    process::{Command, Output},
};
use testing::{Folder, shared};
use weights_format::{Architecture, Encoder, Storage, Weights, Widths};

/// The real checkpoint, which a clone does not have.
fn probe() -> Option<PathBuf> {
    shared("checkpoints/drmim_p50_probe.pth")
}

#[test]
fn checkpoint_of_pytorch_is_converted() {
    let Some(path) = probe() else { return };
    let conversion = convert(&path, &Options::default()).unwrap();
    assert_eq!(conversion.ignored, ["epoch"]);
    assert_eq!(conversion.unknown, [""; 0]);
    let header = &conversion.weights.header;
    let expected = Architecture::new(Widths::pruned(0.5), Some(Encoder::standard(128)));
    assert_eq!(header.architecture, expected);
    assert_eq!(header.architecture.parameters(), 2_573_236);
    assert_eq!(header.pruning_ratio, Some(0.5));
    assert_eq!(header.provenance.name, "drmim_p50_probe");
    assert_eq!(
        header.provenance.source,
        "PyTorch checkpoint drmim_p50_probe.pth"
    );
    // The checkpoint's 2,573,236 less BN's scales and shifts and the two scalars (docs/method.md,
    // section 1.6), and the encoder's BN.
    let values: usize = conversion
        .weights
        .tensors()
        .map(|(_, tensor)| tensor.data.len())
        .sum();
    assert_eq!(values, 2_573_236 - 2_924 - 2 * 128 - 2);
    // The distances that it predicts on its own average: exp of something moderate.
    let bias = &conversion.weights.tensor("head.offsets.bias").unwrap().data;
    assert!(bias.iter().all(|bias| bias.abs() < 4.0), "{bias:?}");
}

fn run(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_convert"))
        .args(args)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

#[test]
fn program_writes_weights_and_lists_what_it_ignores() {
    let folder = Folder::new("program");
    let [checkpoint, out] = ["small.pth", "small.safetensors"].map(|name| folder.at(name));
    let mut dict = common::network_with_encoder();
    dict.insert(
        "dr.e1.bn.weight".into(),
        common::Entry {
            shape: vec![1],
            data: vec![0.0],
        },
    );
    dict.insert(
        "extra\u{1b}[2J".into(),
        common::Entry {
            shape: vec![1],
            data: vec![0.0],
        },
    );
    std::fs::write(&checkpoint, common::checkpoint(&dict, common::PLAIN)).unwrap();

    let dry = run(&[&checkpoint, "--dry-run"]);
    assert_eq!(dry.status.code(), Some(0));
    assert!(
        text(&dry.stdout).contains("backbone.conv1"),
        "{}",
        text(&dry.stdout)
    );
    assert_eq!(
        text(&dry.stderr),
        "ignored (1): dr.e1.bn.weight\nwarning: unknown, not converted (1): extra\u{fffd}[2J\n"
    );
    assert!(!Path::new(&out).exists());

    let real = run(&[
        &checkpoint,
        "--out",
        &out,
        "--dtype",
        "f16",
        "--name",
        "tiny",
        "--encoder-linear",
    ]);
    assert_eq!(real.status.code(), Some(0), "{}", text(&real.stderr));
    let weights = Weights::read(out.as_ref()).unwrap();
    assert_eq!(weights.header.storage, Storage::F16);
    assert_eq!(weights.header.provenance.name, "tiny");
    assert!(!weights.header.architecture.encoder.unwrap().relu);
}

#[test]
fn program_ends_with_the_exit_code_of_the_fault() {
    let folder = Folder::new("codes");
    let path = |name: &str| folder.at(name);
    let (good, bad, large) = (path("good.pth"), path("bad.pth"), path("large.pth"));
    let mut dict = common::network();
    std::fs::write(&good, common::checkpoint(&dict, common::PLAIN)).unwrap();
    std::fs::write(&bad, "not a checkpoint").unwrap();
    dict.get_mut("head.cls_p5_conv1.conv.weight").unwrap().data[0] = 1e5;
    std::fs::write(&large, common::checkpoint(&dict, common::PLAIN)).unwrap();
    for (args, code, message) in [
        (vec![good.as_str()], 2, "--out"),
        (vec![&good, "--dry-run", "--dtype", "int8"], 2, "int8"),
        (
            vec![&path("absent"), "--dry-run"],
            3,
            "absent: cannot be read",
        ),
        (
            vec![&bad, "--dry-run"],
            4,
            "bad.pth: file: expected a PyTorch checkpoint",
        ),
        (
            vec![&large, "--dry-run", "--dtype", "f16"],
            4,
            "\"head.cls1.weight\": 100000 does not fit f16",
        ),
        (
            vec![&good, "--out", &path("absent/x.safetensors")],
            5,
            "x.safetensors: cannot be written",
        ),
    ] {
        let output = run(&args);
        assert_eq!(output.status.code(), Some(code), "{args:?}");
        assert!(
            text(&output.stderr).contains(message),
            "{args:?}: {}",
            text(&output.stderr)
        );
        assert!(output.stdout.is_empty());
    }
}
