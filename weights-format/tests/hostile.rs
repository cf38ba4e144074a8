//! Hostile files: each gets an error that names the fault, none gets a panic.

use proptest::{prelude::*, sample::Index};
use serde_json::{Value, json};
use weights_format::{Architecture, Encoder, Weights, Widths};

/// A network one channel wide, so that most of its file is header.
fn valid() -> Vec<u8> {
    let architecture = Architecture::new(Widths::uniform([1; 5], 1), Some(Encoder::standard(1)));
    Weights::random(architecture, 5).to_bytes().unwrap()
}

/// A file from a header and data.
fn file(header: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header.as_bytes());
    bytes.extend(data);
    bytes
}

/// The header's text and the data of a file.
fn parts(bytes: &[u8]) -> (&str, &[u8]) {
    let (length, rest) = bytes.split_first_chunk().unwrap();
    let (header, data) = rest.split_at(u64::from_le_bytes(*length) as usize);
    (std::str::from_utf8(header).unwrap(), data)
}

/// The valid file after a change of its header and data.
fn with(change: impl FnOnce(&mut Value, &mut Vec<u8>)) -> Vec<u8> {
    let bytes = valid();
    let (header, data) = parts(&bytes);
    let (mut header, mut data) = (serde_json::from_str(header).unwrap(), data.to_vec());
    change(&mut header, &mut data);
    file(&header.to_string(), &data)
}

/// The valid file after a change of its metadata.
fn metadata(change: impl FnOnce(&mut Value)) -> Vec<u8> {
    with(|header, _| {
        let text = header["__metadata__"]["track-cpu"].as_str().unwrap();
        let mut object = serde_json::from_str(text).unwrap();
        change(&mut object);
        header["__metadata__"]["track-cpu"] = json!(object.to_string());
    })
}

/// The valid file after a change of its metadata's text, which need not stay JSON.
fn metadata_text(change: impl FnOnce(&str) -> String) -> Vec<u8> {
    with(|header, _| {
        let text = header["__metadata__"]["track-cpu"].as_str().unwrap();
        header["__metadata__"]["track-cpu"] = json!(change(text));
    })
}

fn remove(value: &mut Value, key: &str) {
    value.as_object_mut().unwrap().remove(key).unwrap();
}

#[test]
fn unchanged_file_is_valid() {
    Weights::from_bytes(&with(|_, _| {})).unwrap();
    Weights::from_bytes(&metadata(|_| {})).unwrap();
}

#[test]
fn invalid_container_is_refused_by_part() {
    let bytes = valid();
    let (header, data) = parts(&bytes);
    let header = header.trim_end();
    let count = |n: u64| [n.to_le_bytes().as_slice(), header.as_bytes(), data].concat();
    let twice = format!("{{{},{}", r#""__metadata__":{}"#, &header[1..]);
    let zeros = vec![b' '; (1 << 20) + 1];
    for (what, bytes, expected) in [
        (
            "empty",
            vec![],
            "file: expected a weights file (safetensors), found 0 bytes of another kind",
        ),
        (
            "seven bytes",
            vec![0; 7],
            "file: expected a weights file (safetensors), found 7 bytes of another kind",
        ),
        (
            "short text",
            b"a note".to_vec(),
            "(safetensors), found text that begins with \"a note\"",
        ),
        (
            "text",
            "# Training\n\nHow to train".into(),
            "(safetensors), found text that begins with \"# Training\"",
        ),
        (
            "text cut within a character",
            "\u{20ac}".repeat(11).into(),
            &format!("found text that begins with {:?}", "\u{20ac}".repeat(10)),
        ),
        (
            "picture",
            b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".to_vec(),
            "(safetensors), found 16 bytes of another kind",
        ),
        (
            "no header",
            vec![0; 8],
            "header: expected the JSON of a safetensors file",
        ),
        (
            "length beyond the file",
            count(bytes.len() as u64),
            "header length: expected at most",
        ),
        (
            "length beyond memory",
            count(u64::MAX),
            "bytes, found 18446744073709551615",
        ),
        (
            "length beyond the bound",
            file(std::str::from_utf8(&zeros).unwrap(), &[]),
            "at most 1048576 bytes",
        ),
        (
            "not JSON",
            file("PK\u{3}\u{4}", data),
            "header: expected the JSON",
        ),
        (
            "not UTF-8",
            [&[1, 0, 0, 0, 0, 0, 0, 0][..], &[0xff]].concat(),
            "header: expected the JSON",
        ),
        (
            "deep",
            file(&"[".repeat(1000), data),
            "header: expected the JSON",
        ),
        (
            "metadata twice",
            file(&twice, data),
            "duplicate field `__metadata__`",
        ),
        (
            "trailing byte",
            [&bytes[..], &[0]].concat(),
            &format!("as the header says, found {}", data.len() + 1),
        ),
        (
            "truncated",
            bytes[..bytes.len() - 1].to_vec(),
            &format!("found {}", data.len() - 1),
        ),
        (
            "nothing but metadata",
            with(|h, d| {
                *h = json!({ "__metadata__": h["__metadata__"] });
                d.clear();
            }),
            "tensor \"backbone.conv1.weight\": expected F32 with shape [1, 11, 11, 3], \
             found no such tensor",
        ),
        (
            "overlap",
            with(|h, _| h["head.score.bias"]["data_offsets"] = json!([0, 4])),
            "invalid offset",
        ),
        (
            "offsets backwards",
            with(|h, _| h["head.score.bias"]["data_offsets"] = json!([8, 4])),
            "invalid offset",
        ),
        (
            "offsets and shape",
            with(|h, _| h["head.score.bias"]["shape"] = json!([2])),
            "invalid shape",
        ),
        (
            "overflowing shape",
            with(|h, _| {
                h["head.score.bias"]["shape"] = json!([1_u64 << 40, 1_u64 << 40]);
            }),
            "overflow",
        ),
        (
            "negative shape",
            with(|h, _| h["head.score.bias"]["shape"] = json!([-1])),
            "header: expected",
        ),
        (
            "unknown type",
            with(|h, _| h["head.score.bias"]["dtype"] = json!("F80")),
            "unknown variant `F80`",
        ),
        (
            "ends at the end of memory",
            file(&far(), &[]),
            "data: expected",
        ),
    ] {
        refused(what, &bytes, expected);
    }
}

/// A header of eight tensors of `2^61 - 1` bytes each: the last one ends just below `2^64`.
fn far() -> String {
    let mut header = serde_json::Map::new();
    for i in 0..8_u64 {
        let n = (1 << 61) - 1;
        header.insert(
            format!("{i}"),
            json!({"dtype": "U8", "shape": [n], "data_offsets": [i * n, (i + 1) * n]}),
        );
    }
    Value::Object(header).to_string()
}

#[test]
fn invalid_metadata_is_refused_by_field() {
    for (what, bytes, expected) in [
        (
            "none",
            with(|h, _| remove(h, "__metadata__")),
            "metadata `track-cpu`: expected the header, found no such",
        ),
        (
            "another key",
            with(|h, _| h["__metadata__"]["format"] = json!("pt")),
            "metadata `format`: expected no key",
        ),
        (
            "not JSON",
            metadata_text(|_| "{".into()),
            "metadata `format_version`: expected 1",
        ),
        (
            "version missing",
            metadata(|m| remove(m, "format_version")),
            "missing field `format_version`",
        ),
        (
            "version 2",
            metadata(|m| m["format_version"] = json!(2)),
            "`format_version`: expected 1, found 2",
        ),
        (
            "newer fields",
            metadata(|m| {
                m["format_version"] = json!(7);
                m["more"] = json!(0);
            }),
            "`format_version`: expected 1, found 7",
        ),
        (
            "version text",
            metadata(|m| m["format_version"] = json!("1")),
            "invalid type: string",
        ),
        (
            "field missing",
            metadata(|m| remove(m, "tracker")),
            "missing field `tracker`",
        ),
        (
            "field unknown",
            metadata(|m| m["color"] = json!(1)),
            "unknown field `color`",
        ),
        (
            "field twice",
            metadata_text(|m| m.replacen('{', r#"{"storage":"f32","#, 1)),
            "duplicate field `storage`",
        ),
        (
            "nested unknown",
            metadata(|m| m["input"]["gamma"] = json!(1)),
            "`input`: expected an input normalization, found unknown field `gamma`",
        ),
        (
            "nested missing",
            metadata(|m| remove(&mut m["tracker"], "size_lr")),
            "missing field `size_lr`",
        ),
        (
            "encoder missing",
            metadata(|m| remove(&mut m["architecture"], "encoder")),
            "missing field `encoder`",
        ),
        (
            "wrong type",
            metadata(|m| m["tracker"]["min_size"] = json!("10")),
            "metadata `tracker`",
        ),
        (
            "two means",
            metadata(|m| m["input"]["mean"] = json!([0, 0])),
            "`input`: expected an input normalization, found invalid length 2",
        ),
        (
            "channel order",
            metadata(|m| m["input"]["channel_order"] = json!("rgb")),
            "unknown variant `rgb`",
        ),
        (
            "storage",
            metadata(|m| m["storage"] = json!("int8")),
            "`storage`: expected \"f32\" or \"f16\", found unknown variant `int8`",
        ),
        (
            "ratio",
            metadata(|m| m["pruning_ratio"] = json!(1.0)),
            "`pruning_ratio`: expected a number in [0, 1) or null, found 1",
        ),
        (
            "std zero",
            metadata(|m| m["input"]["std"][2] = json!(0.0)),
            "`input.std`: expected a number in 0.001..=1000.0, found 0",
        ),
        (
            "mean infinite",
            metadata_text(|m| m.replacen("\"mean\":[0.0", "\"mean\":[1e30", 1)),
            "`input.mean`",
        ),
        (
            "mean beyond f64",
            metadata_text(|m| m.replacen("\"mean\":[0.0", "\"mean\":[1e999", 1)),
            "number out of range",
        ),
        (
            "learning rate",
            metadata(|m| m["tracker"]["size_lr"] = json!(1.5)),
            "`tracker.size_lr`: expected a number in 0.0..=1.0, found 1.5",
        ),
        (
            "window",
            metadata(|m| m["tracker"]["window_influence"] = json!(-0.1)),
            "`tracker.window_influence`",
        ),
        (
            "correction",
            metadata(|m| m["tracker"]["correction"] = json!(1.5)),
            "`tracker.correction`",
        ),
        (
            "update",
            metadata(|m| m["tracker"]["template_update"] = json!(-0.1)),
            "`tracker.template_update`",
        ),
        (
            "filter",
            metadata(|m| m["tracker"]["online_filter"] = json!(2)),
            "`tracker.online_filter`",
        ),
        (
            "unstretch",
            metadata(|m| m["tracker"]["unstretch"] = json!(1.5)),
            "`tracker.unstretch`",
        ),
        (
            "voting",
            metadata(|m| m["tracker"]["voting"] = json!(-1)),
            "`tracker.voting`",
        ),
        (
            "penalty",
            metadata(|m| m["tracker"]["penalty_k"] = json!(1e9)),
            "`tracker.penalty_k`",
        ),
        (
            "context",
            metadata(|m| m["tracker"]["context_amount"] = json!(-1)),
            "`tracker.context_amount`",
        ),
        (
            "smallest box",
            metadata(|m| m["tracker"]["min_size"] = json!(0)),
            "`tracker.min_size`",
        ),
        (
            "name",
            metadata(|m| m["provenance"]["name"] = json!("\u{1b}]0;x\u{7}")),
            "`provenance.name`: expected text without control characters, found '\\u{1b}'",
        ),
        (
            "a note's line",
            metadata(|m| m["provenance"]["notes"]["x"] = json!("one\ntwo\r")),
            "`provenance.notes`: expected text without control characters, found '\\r'",
        ),
        (
            "a calibration's method",
            metadata(|m| m["calibration"] = json!({"method": "\u{1b}[2J", "inputs": {}})),
            "`calibration.method`: expected text without control characters",
        ),
        (
            "a note",
            metadata(|m| m["provenance"]["notes"]["x"] = json!(1)),
            "metadata `provenance`",
        ),
        (
            "no channels",
            metadata(|m| m["architecture"]["widths"]["backbone"][1] = json!(0)),
            "widths[1] is 0, expected 1..=2048",
        ),
        (
            "many channels",
            metadata(|m| m["architecture"]["widths"]["neck_reg"] = json!(1_u64 << 62)),
            "widths[6]",
        ),
        (
            "negative width",
            metadata(|m| m["architecture"]["widths"]["neck_reg"] = json!(-1)),
            "metadata `architecture`",
        ),
        (
            "encoder kernel",
            metadata(|m| m["architecture"]["encoder"]["kernel"] = json!(5)),
            "encoder.kernel is 5, expected 1 or 3",
        ),
        (
            "crop",
            metadata(|m| m["architecture"]["search_size"] = json!(1 << 20)),
            "search_size is 1048576",
        ),
    ] {
        refused(what, &bytes, expected);
    }
}

#[test]
fn invalid_tensor_is_refused_by_name() {
    for (what, bytes, expected) in [
        (
            "encoder undeclared",
            metadata(|m| m["architecture"]["encoder"] = Value::Null),
            "tensor \"dr.e2.0.bias\": expected no tensor of this name",
        ),
        (
            "too narrow",
            metadata(|m| m["architecture"]["widths"]["head_cls"][0] = json!(2)),
            "tensor \"head.cls1.weight\": expected F32 with shape [2, 3, 3, 1], \
             found F32 with shape [1, 3, 3, 1]",
        ),
        (
            "renamed",
            with(|h, _| {
                let info = h["head.score.bias"].take();
                remove(h, "head.score.bias");
                h["head.score.bia\u{1b}"] = info;
            }),
            "tensor \"head.score.bias\": expected F32 with shape [1], found no such tensor",
        ),
        (
            "one more",
            with(|h, d| {
                h["zz\u{1b}"] =
                    json!({"dtype": "U8", "shape": [1], "data_offsets": [d.len(), d.len() + 1]});
                d.push(0);
            }),
            "tensor \"zz\u{fffd}\": expected no tensor of this name",
        ),
        (
            "declared f16",
            metadata(|m| m["storage"] = json!("f16")),
            "expected F16 with shape [1, 11, 11, 3], found F32",
        ),
        (
            "as integers",
            with(|h, _| h["head.score.bias"]["dtype"] = json!("I32")),
            "\"head.score.bias\": expected F32 with shape [1], found I32",
        ),
        (
            "other axes",
            with(|h, _| h["backbone.conv1.weight"]["shape"] = json!([1, 3, 11, 11])),
            "found F32 with shape [1, 3, 11, 11]",
        ),
        (
            "a scalar",
            with(|h, _| h["head.score.bias"]["shape"] = json!([])),
            "found F32 with shape []",
        ),
        (
            "NaN",
            with(|_, d| d[..4].copy_from_slice(&f32::NAN.to_le_bytes())),
            "expected finite values, found NaN at element 0",
        ),
        (
            "infinity",
            with(|_, d| d[4..8].copy_from_slice(&f32::NEG_INFINITY.to_le_bytes())),
            "found -inf at element",
        ),
    ] {
        refused(what, &bytes, expected);
    }
}

fn refused(what: &str, bytes: &[u8], expected: &str) {
    match Weights::from_bytes(bytes) {
        Ok(_) => panic!("{what}: accepted"),
        Err(error) => {
            let error = error.to_string();
            assert!(
                error.contains(expected),
                "{what}: {error:?} does not say {expected:?}"
            );
            assert!(
                !error.contains('\u{1b}') && error.len() < 1000,
                "{what}: {error:?} is not fit for a terminal"
            );
        }
    }
}

/// Whatever is accepted is complete, and is written as it was read.
fn never_panics(bytes: &[u8]) {
    if let Ok(weights) = Weights::from_bytes(bytes) {
        let written = weights.to_bytes().unwrap();
        assert_eq!(Weights::from_bytes(&written).unwrap(), weights);
    }
}

/// What a digit becomes: another number, or no number.
const NUMBER: &str = r"[0-9]{1,20}|-1|1e9|null|\[\]";

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1500))]

    #[test]
    fn file_truncated_anywhere_never_panics(at in any::<Index>()) {
        let bytes = valid();
        prop_assert!(Weights::from_bytes(&bytes[..at.index(bytes.len())]).is_err());
    }

    #[test]
    fn file_with_flipped_bits_never_panics(
        flips in prop::collection::vec((any::<Index>(), 0..8), 1..6),
    ) {
        let mut bytes = valid();
        for (at, bit) in flips {
            let at = at.index(bytes.len());
            bytes[at] ^= 1_u8 << bit;
        }
        never_panics(&bytes);
    }

    #[test]
    fn file_with_changed_digits_never_panics(
        changes in prop::collection::vec((any::<Index>(), NUMBER), 1..4),
    ) {
        let bytes = valid();
        let (header, data) = parts(&bytes);
        let mut header = header.to_owned();
        for (at, text) in changes {
            let digits: Vec<_> = header
                .match_indices(|c: char| c.is_ascii_digit())
                .map(|(i, _)| i)
                .collect();
            let at = digits[at.index(digits.len())];
            header.replace_range(at..=at, &text);
        }
        never_panics(&file(&header, data));
    }

    #[test]
    fn junk_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        prop_assert!(Weights::from_bytes(&bytes).is_err());
    }
}
