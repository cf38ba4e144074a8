//! Weights survive the roundtrip, through memory and through files.

use std::fs;
use testing::Folder;
use weights_format::{
    Architecture, Encoder, EncoderPosition, ReadError, Storage, Tensor, Weights, Widths, WriteError,
};

fn sample(storage: Storage) -> Weights {
    let widths = Widths {
        head_reg: [7, 5, 3],
        ..Widths::uniform([3, 5, 8, 13, 21], 11)
    };
    let mut weights = Weights::random(Architecture::new(widths, Some(Encoder::standard(21))), 11);
    let header = &mut weights.header;
    header.storage = storage;
    header.input.mean = [103.5, 0.1, -1.0 / 3.0];
    header.input.std = [58.0, 57.375, 1.0];
    header.tracker.size_lr = 0.1 + 0.2;
    header.provenance.source = "a \"test\" with \u{e9}\u{4e2d}".into();
    header
        .provenance
        .notes
        .insert("lines".into(), "one\ntwo".into());
    weights
}

#[test]
fn f32_file_read_back_is_exact() {
    let weights = sample(Storage::F32);
    let bytes = weights.to_bytes().unwrap();
    assert_eq!(Weights::from_bytes(&bytes).unwrap(), weights);
    assert_eq!(
        weights.to_bytes().unwrap(),
        bytes,
        "the same weights give the same bytes"
    );
}

#[test]
fn f16_file_rounds_weights_once_and_keeps_biases() {
    let weights = sample(Storage::F16);
    let bytes = weights.to_bytes().unwrap();
    let read = Weights::from_bytes(&bytes).unwrap();
    assert_eq!(read.header, weights.header);
    for (name, tensor) in weights.tensors() {
        let found = read.tensor(name).unwrap();
        assert_eq!(found.shape, tensor.shape);
        for (&a, &b) in tensor.data.iter().zip(&found.data) {
            let tolerance = if name.ends_with(".bias") {
                0.0
            } else {
                (a.abs() / 2048.0).max(f32::exp2(-25.0))
            };
            assert!((a - b).abs() <= tolerance, "{name}: {a} became {b}");
        }
    }
    assert_eq!(
        read.to_bytes().unwrap(),
        bytes,
        "rounding twice changes nothing"
    );
    assert!(bytes.len() < sample(Storage::F32).to_bytes().unwrap().len() * 6 / 10);
}

#[test]
fn any_encoder_or_none_survives_the_roundtrip() {
    let narrow = Widths::uniform([2, 3, 2, 3, 4], 3);
    let linear = Encoder {
        kernel: 1,
        relu: false,
        ..Encoder::standard(4)
    };
    for encoder in [None, Some(linear), Some(Encoder::standard(5))] {
        let weights = Weights::random(Architecture::new(narrow, encoder), 1);

        let read = Weights::from_bytes(&weights.to_bytes().unwrap()).unwrap();

        assert_eq!(read, weights);
    }
}

#[test]
fn encoder_that_no_reader_runs_is_refused() {
    let narrow = Widths::uniform([2, 3, 2, 3, 4], 3);
    let standard = Encoder::standard(5);
    let two_layers = Encoder {
        layers: 2,
        ..standard
    };
    let one_each = Encoder {
        shared: false,
        ..standard
    };
    let after_neck = Encoder {
        position: EncoderPosition::AfterNeck,
        ..standard
    };
    for (encoder, expected) in [
        (two_layers, "encoder.layers is 2, expected 1"),
        (one_each, "encoder.shared is false, expected true"),
        (
            after_neck,
            "encoder.position is after_neck, expected before_neck",
        ),
    ] {
        let mut weights = Weights::random(Architecture::new(narrow, Some(standard)), 1);
        weights.header.architecture.encoder = Some(encoder);

        let message = weights.to_bytes().unwrap_err().to_string();

        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn f16_file_of_too_large_a_weight_is_refused() {
    let mut weights = sample(Storage::F16);
    let mut tensor = weights.tensor("head.score.weight").unwrap().clone();
    tensor.data[1] = 65519.0; // the largest that still rounds to 65504
    weights.insert("head.score.weight", tensor.clone());
    weights.to_bytes().unwrap();
    tensor.data[1] = -65520.0;
    weights.insert("head.score.weight", tensor);
    let error = weights.to_bytes().unwrap_err();
    assert!(
        matches!(
            error,
            WriteError::Overflow {
                value: -65520.0,
                ..
            }
        ),
        "{error}"
    );
    assert!(
        error.to_string().contains("\"head.score.weight\": -65520"),
        "{error}"
    );
    weights.header.storage = Storage::F32;
    weights.to_bytes().unwrap();
}

#[test]
fn weights_that_no_reader_accepts_are_not_written() {
    let refused = |change: &dyn Fn(&mut Weights)| {
        let mut weights = sample(Storage::F32);
        change(&mut weights);
        weights.to_bytes().unwrap_err().to_string()
    };
    let infinite = Tensor {
        shape: vec![1],
        data: vec![f32::INFINITY],
    };
    assert!(
        refused(&|w| w.insert("head.score.bias", infinite.clone())).contains("inf at element 0")
    );
    assert!(refused(&|w| w.header.input.std[1] = f32::NAN).contains("input.std"));
    assert!(refused(&|w| w.header.provenance.name = "\u{1b}[2J".into()).contains("'\\u{1b}'"));
    let note = "x".repeat(2 << 20);
    let long = refused(&|w| {
        drop(
            w.header
                .provenance
                .notes
                .insert("long".into(), note.clone()),
        )
    });
    assert!(
        long.contains("header length: expected at most 1048576 bytes"),
        "{long}"
    );
    let wide = Architecture::new(Widths::uniform([2048; 5], 2048), None);
    assert!(
        wide.check().is_ok(),
        "wide networks can be described, they are only too large for a file"
    );
}

#[test]
fn file_written_over_another_replaces_it_as_a_whole() {
    let folder = Folder::new("replace");
    let path = folder.write("model.safetensors", "old");
    let weights = sample(Storage::F32);

    weights.write(&path).unwrap();

    assert_eq!(Weights::read(&path).unwrap(), weights);
    let entries = fs::read_dir(folder.path()).unwrap();
    let names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names, ["model.safetensors"], "no temporary file stays");
}

#[test]
fn file_written_over_a_folder_is_an_error_and_leaves_nothing() {
    let folder = Folder::new("taken");
    let taken = folder.join("taken");
    fs::create_dir(&taken).unwrap();

    let error = sample(Storage::F32).write(&taken).unwrap_err().to_string();

    assert!(error.contains("taken: cannot be written"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn unreadable_file_is_named_in_the_error() {
    let folder = Folder::new("unreadable");
    let absent = folder.join("absent.safetensors");
    let huge = folder.join("huge.safetensors");
    // A sparse file claims more than is ever read.
    fs::File::create(&huge).unwrap().set_len(1 << 40).unwrap();
    let too_long = "huge.safetensors: file: expected at most 268435456 bytes, found 1099511627776";
    for (path, expected) in [
        (&absent, "absent.safetensors: cannot be read: "),
        (&folder.path().to_owned(), "cannot be read: "),
        (&huge, too_long),
    ] {
        let error = Weights::read(path).unwrap_err();

        assert!(matches!(&error, ReadError::File { path: named, .. } if named == path));
        assert!(error.to_string().contains(expected), "{error}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn endless_file_is_read_to_the_bound_only() {
    // Its length claims to be 0.
    let error = Weights::read("/dev/zero".as_ref()).unwrap_err().to_string();
    assert!(
        error.contains("/dev/zero: file: expected at most 268435456 bytes, found more"),
        "{error}"
    );
}
