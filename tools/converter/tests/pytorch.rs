//! The other way: state dicts that PyTorch reads, and that come back as they were.

mod common;

use common::*;
use converter::{Options, StateDict, Values, convert_bytes, unfold_bytes};
use std::path::Path;
use std::process::Command;
use testing::Folder;
use weights_format::{Architecture, Encoder, InputNormalization, Unfolded, Weights, Widths};

fn run(args: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_convert"))
        .args(args)
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (
        output.status.code().unwrap(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

fn values<'a>(dict: &'a StateDict, name: &str) -> &'a [f32] {
    let entry = dict
        .entries
        .iter()
        .find(|(n, ..)| n == name)
        .unwrap_or_else(|| panic!("no {name}"));
    let Values::F32(values) = &entry.2 else {
        panic!("{name} is a counter")
    };
    values
}

/// Every f32 tensor is the same bits, and there are no others but counters.
fn same(dict: &StateDict, expected: &common::StateDict) {
    let floats: Vec<_> = dict
        .entries
        .iter()
        .filter(|(_, _, v)| matches!(v, Values::F32(_)))
        .collect();
    assert_eq!(floats.len(), expected.len());
    for (name, shape, _) in floats {
        let Entry {
            shape: expected_shape,
            data,
        } = &expected[name];
        let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(
            (shape, bits(values(dict, name))),
            (expected_shape, bits(data)),
            "{name}"
        );
    }
}

#[test]
fn safetensors_state_dict_comes_back_as_the_same_weights() {
    let folder = Folder::new("safetensors");
    let dict = network();
    let original = folder.at("a.pth");
    std::fs::write(&original, checkpoint(&dict, PLAIN)).unwrap();
    let weights = folder.at("w.safetensors");
    let back = folder.at("back.safetensors");
    let again = folder.at("again.safetensors");

    for args in [
        &[&original[..], "--out", &weights][..],
        &[&weights, "--to", "pytorch", "--out", &back],
        &[&back, "--out", &again],
    ] {
        let (code, _, told) = run(args);
        assert_eq!(code, 0, "{args:?}: {told}");
    }

    let read = |path: &str| Weights::read(Path::new(path)).unwrap();
    let first = read(&weights);
    let second = read(&again);
    for (name, tensor) in first.tensors() {
        assert_eq!(second.tensor(name), Some(tensor), "{name}");
    }
    let (code, _, told) = run(&[&weights, "--out", &again]);
    assert_eq!(code, 4);
    assert!(
        told.contains("a weights file, which needs no conversion"),
        "{told}"
    );
}

#[test]
fn round_trip_keeps_every_bit() {
    let folder = Folder::new("roundtrip");
    for dict in [network_with_encoder(), network()] {
        let [theirs, ours, again, twice] =
            ["a.pth", "b.safetensors", "c.pth", "d.safetensors"].map(|name| folder.at(name));
        std::fs::write(&theirs, checkpoint(&dict, PLAIN)).unwrap();
        for (from, to, out) in [
            (&theirs, "trainer", &ours),
            (&ours, "pytorch", &again),
            (&again, "trainer", &twice),
        ] {
            let (code, _, stderr) = run(&[from, "--to", to, "--out", out]);
            assert_eq!(code, 0, "{stderr}");
        }
        same(&StateDict::read(Path::new(&ours)).unwrap(), &dict);
        let read = |path: &String| Unfolded::read(Path::new(path)).unwrap();
        assert_eq!(
            read(&ours).tensors,
            read(&twice).tensors,
            "through our own .pth"
        );
        // The .pth we wrote is as good as the one we were given.
        let bytes = std::fs::read(&again).unwrap();
        let options = Options::default();
        let first = convert_bytes(&checkpoint(&dict, PLAIN), &options)
            .unwrap()
            .weights;
        assert_eq!(convert_bytes(&bytes, &options).unwrap().weights, first);
    }
}

#[test]
fn full_network_has_the_tensors_of_the_reference() {
    let architecture = Architecture::new(Widths::pruned(0.8), None);
    let dict = StateDict::of_weights(&Weights::random(architecture, 1));
    assert_eq!(dict.entries.len(), 108); // docs/method.md, section 1.5
    let shape = |name: &str| {
        dict.entries
            .iter()
            .find(|(n, ..)| n == name)
            .map(|(_, shape, _)| shape.clone())
    };
    assert_eq!(
        shape("basemodel.conv2.conv.weight"),
        Some(vec![51, 19, 5, 5])
    );
    assert_eq!(
        shape("head.bbox_offsets_p5.bn.num_batches_tracked"),
        Some(vec![])
    );
    assert_eq!(shape("head.cls_p5_conv1.bn.weight"), None);
}

#[test]
fn folded_weights_come_with_normalizations_that_change_nothing() {
    let mut weights = Weights::random(
        Architecture::new(Widths::pruned(0.9), Some(Encoder::standard(25))),
        3,
    );
    let dict = StateDict::of_weights(&weights);
    assert!(dict.folded);
    assert_eq!(values(&dict, "c_x.bn.running_var")[0], 0.99999);
    let folder = Folder::new("folded");
    let path = folder.at("a.pth");
    dict.write(Path::new(&path)).unwrap();
    let back = convert_bytes(&std::fs::read(&path).unwrap(), &Options::default())
        .unwrap()
        .weights;
    assert!(
        back.tensors().eq(weights.tensors()),
        "the same bits when folded again"
    );

    // What the network expects of pixels moves into its first convolution.
    weights.header.input = InputNormalization::TRAINED;
    let moved = StateDict::of_weights(&weights);
    let (before, after) = (
        values(&dict, "basemodel.conv1.conv.weight"),
        values(&moved, "basemodel.conv1.conv.weight"),
    );
    assert!(
        before
            .iter()
            .zip(after)
            .all(|(b, a)| (a * 58.0 - b).abs() <= 1e-6 * b.abs())
    );
    let sum: f32 = after[..363].iter().sum();
    let bias = |dict: &StateDict| values(dict, "basemodel.conv1.conv.bias")[0];
    assert!(
        (bias(&moved) - (bias(&dict) - 114.0 * sum)).abs() < 1e-4,
        "{} {}",
        bias(&moved),
        bias(&dict)
    );
}

#[test]
fn program_reports_what_it_writes_and_refuses() {
    let folder = Folder::new("said");
    let names = ["w.safetensors", "w.pth", "again.pth", "w.onnx"];
    let [weights, pth, again, other] = names.map(|name| folder.at(name));
    Weights::random(Architecture::new(Widths::pruned(0.9), None), 3)
        .write(Path::new(&weights))
        .unwrap();
    let (code, stdout, stderr) = run(&[&weights, "--to", "pytorch", "--out", &pth]);
    assert!(
        code == 0 && stdout.contains("108 tensors"),
        "{stdout}{stderr}"
    );
    assert!(
        stderr.contains("written as ones that change nothing"),
        "{stderr}"
    );
    for (args, expected_code, message) in [
        (
            vec![&weights[..], "--to", "pytorch", "--out", &other],
            2,
            "ends in .pth",
        ),
        (
            vec![&pth[..], "--to", "pytorch", "--out", &again],
            4,
            "a weights file or a checkpoint of the trainer",
        ),
        (vec!["none", "--to", "pytorch", "--out", &pth], 3, "none"),
        (
            vec![&weights[..], "--to", "trainer", "--out", &other],
            4,
            "a PyTorch checkpoint",
        ),
    ] {
        let (code, _, stderr) = run(&args);
        assert!(
            code == expected_code && stderr.contains(message),
            "{args:?}: {code} {stderr}"
        );
    }
}

/// A Python with torch: `$TRACK_CPU_TORCH`, or `python3` if it has one.
fn python() -> Option<String> {
    let python = std::env::var("TRACK_CPU_TORCH").unwrap_or_else(|_| "python3".into());
    let works = Command::new(&python)
        .args(["-c", "import torch"])
        .output()
        .is_ok_and(|o| o.status.success());
    if !works {
        println!("SKIPPED: {python} has no torch (TRACK_CPU_TORCH names a Python that has)");
    }
    works.then_some(python)
}

#[test]
fn torch_loads_the_file_with_weights_only() {
    let Some(python) = python() else { return };
    let folder = Folder::new("torch");
    let dict = network_with_encoder();
    let unfolded = unfold_bytes(&checkpoint(&dict, PLAIN), &Options::default())
        .unwrap()
        .unfolded;
    let path = folder.at("ours.pth");
    StateDict::of_unfolded(&unfolded)
        .write(Path::new(&path))
        .unwrap();
    let script = "import sys, torch\n\
        d = torch.load(sys.argv[1], weights_only=True)\n\
        assert d['basemodel.conv1.bn.num_batches_tracked'].dtype == torch.int64\n\
        for k, v in d.items():\n    \
            if v.dtype == torch.float32:\n        \
                bits = v.contiguous().flatten().view(torch.int32)\n        \
                print(k, list(v.shape), bits.sum(dtype=torch.int64).item())\n";
    let output = Command::new(python)
        .args(["-c", script, &path])
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let text = String::from_utf8(output.stdout).unwrap();
    for (name, Entry { shape, data }) in &dict {
        let sum: i64 = data.iter().map(|v| i64::from(v.to_bits() as i32)).sum();
        let line = format!("{name} {shape:?} {sum}");
        assert!(text.lines().any(|l| l == line), "{line} is not in {text}");
    }
    assert_eq!(text.lines().count(), dict.len());
}
