//! What is converted is what the checkpoint says, in every form that a checkpoint takes.

mod common;

use common::*;
use converter::{Conversion, Options, convert_bytes};
use weights_format::{EncoderPosition, Storage, Weights, Widths};
use zip::CompressionMethod;

fn convert(bytes: &[u8]) -> Conversion {
    convert_bytes(bytes, &Options::default()).unwrap_or_else(|refusal| panic!("{refusal}"))
}

/// One output pixel of every channel, in f64, as PyTorch computes it: convolution, then BN, then
/// the head's scalars.
fn unfolded(dict: &StateDict, prefix: &str, patch: &[f32]) -> Vec<f64> {
    let get = |name: &str| {
        dict.get(&format!("{prefix}.{name}"))
            .map(|entry| &entry.data[..])
    };
    let weight = get("conv.weight").unwrap();
    let outputs = weight
        .chunks_exact(patch.len())
        .zip(get("conv.bias").unwrap());
    let mut values: Vec<f64> = outputs
        .map(|(w, &b)| {
            f64::from(b)
                + w.iter()
                    .zip(patch)
                    .map(|(&w, &x)| f64::from(w) * f64::from(x))
                    .sum::<f64>()
        })
        .collect();
    if let Some(scale) = get("bn.weight") {
        let [shift, mean, variance] =
            ["bn.bias", "bn.running_mean", "bn.running_var"].map(|n| get(n).unwrap());
        for (i, y) in values.iter_mut().enumerate() {
            let normalized = (*y - f64::from(mean[i])) / (f64::from(variance[i]) + 1e-5).sqrt();
            *y = normalized * f64::from(scale[i]) + f64::from(shift[i]);
        }
    }
    if prefix == "head.bbox_offsets_p5" {
        let scalar = |name: &str| f64::from(dict[name].data[0]);
        values
            .iter_mut()
            .for_each(|y| *y = scalar("head.si") * *y + scalar("head.bi"));
    }
    values
}

/// The same from converted weights; the patch is `[Cin, k, k]`, the weights are `[Cout, k, k,
/// Cin]`.
fn folded(weights: &Weights, layer: &str, patch: &[f32]) -> Vec<f64> {
    let weight = weights.tensor(&format!("{layer}.weight")).unwrap();
    let bias = weights.tensor(&format!("{layer}.bias")).unwrap();
    let [_, rows, columns, channels] = weight.shape[..] else {
        panic!("{:?}", weight.shape)
    };
    let outputs = weight.data.chunks_exact(patch.len()).zip(&bias.data);
    outputs
        .map(|(w, &b)| {
            let mut sum = f64::from(b);
            for (i, &w) in w.iter().enumerate() {
                let (at, channel) = (i / channels, i % channels);
                sum += f64::from(w) * f64::from(patch[channel * rows * columns + at]);
            }
            sum
        })
        .collect()
}

/// Every layer of `weights` computes what it does in `dict`.
fn same_network(weights: &Weights, dict: &StateDict, encoder: &[(&str, &str)], tolerance: f64) {
    let fixed = layers(1)
        .into_iter()
        .map(|(theirs, ours, ..)| (theirs, ours));
    let encoder = encoder
        .iter()
        .map(|&(theirs, ours)| (theirs.to_owned(), ours.to_owned()));
    let all: Vec<_> = fixed.chain(encoder).collect();
    assert_eq!(weights.tensors().count(), 2 * all.len());
    for (theirs, ours) in all {
        let inputs = dict[&format!("{theirs}.conv.weight")].shape[1..]
            .iter()
            .product();
        let patch = noise(inputs, &ours);
        let (found, expected) = (
            folded(weights, &ours, &patch),
            unfolded(dict, &theirs, &patch),
        );
        assert_eq!(found.len(), expected.len());
        let scale = expected.iter().map(|y| y.abs()).fold(1.0, f64::max);
        for (found, expected) in found.iter().zip(&expected) {
            assert!(
                (found - expected).abs() <= tolerance * scale,
                "{ours}: {found} is not {expected}"
            );
        }
    }
}

#[test]
fn converted_network_computes_what_the_checkpoint_does() {
    let dict = network_with_encoder();
    let conversion = convert(&checkpoint(&dict, PLAIN));
    same_network(&conversion.weights, &dict, &[("dr.e2", "dr.e2.0")], 1e-5);
    let header = &conversion.weights.header;
    let widths = Widths {
        backbone: BACKBONE,
        neck_cls: NECK[0],
        neck_reg: NECK[1],
        head_cls: HEAD_CLS,
        head_reg: HEAD_REG,
    };
    assert_eq!(header.architecture.widths, widths);
    let encoder = header.architecture.encoder.unwrap();
    assert_eq!((encoder.kernel, encoder.layers, encoder.width), (3, 1, 10));
    assert!(encoder.relu && encoder.shared && encoder.position == EncoderPosition::BeforeNeck);
    assert_eq!(header.pruning_ratio, None);
    assert_eq!(header.storage, Storage::F32);
    assert_eq!(header.input, Default::default());
    assert_eq!(conversion.ignored, [""; 0]);
    assert_eq!(conversion.unknown, [""; 0]);
}

#[test]
fn state_dict_in_any_container_and_wrapper_gives_the_same_weights() {
    let dict = network();
    let expected = convert(&checkpoint(&dict, PLAIN)).weights;
    for legacy in [false, true] {
        for wrapper in [
            None,
            Some("model_state_dict"),
            Some("state_dict"),
            Some("model"),
            Some("net"),
            Some("ema"),
            Some("weights"), // no known key, but the only dict with tensors of the network
        ] {
            for prefix in [
                "",
                "module.",
                "_orig_mod.",
                "module._orig_mod.",
                "model.",
                "_orig_mod.module.model.",
            ] {
                for ordered in [false, true] {
                    let form = Form {
                        wrapper,
                        prefix,
                        ordered,
                        legacy,
                        ..PLAIN
                    };
                    let conversion = convert(&checkpoint(&dict, form));
                    assert_eq!(conversion.weights, expected);
                    let beside: &[&str] = if wrapper.is_some() {
                        &["epoch", "optimizer_state_dict"]
                    } else {
                        &[]
                    };
                    assert_eq!(conversion.ignored, beside);
                }
            }
        }
    }
}

#[test]
fn weights_of_every_floating_point_type_are_read() {
    let dict = network();
    for (dtype, tolerance) in [("Double", 1e-5), ("Half", 3e-2), ("BFloat16", 2e-1)] {
        let form = Form {
            dtype,
            legacy: dtype == "Half",
            ..PLAIN
        };
        same_network(
            &convert(&checkpoint(&dict, form)).weights,
            &dict,
            &[],
            tolerance,
        );
    }
    let exact = convert(&checkpoint(&dict, PLAIN)).weights;
    assert_eq!(
        convert(&checkpoint(
            &dict,
            Form {
                dtype: "Double",
                ..PLAIN
            }
        ))
        .weights,
        exact
    );
}

#[test]
fn tensor_with_strides_and_an_offset_is_read() {
    // conv2 in channels-last order, 10 elements into a storage that it shares with nothing.
    let dict = network();
    let name = "basemodel.conv2.conv.weight";
    let mut others = dict.clone();
    let entry = others.remove(name).unwrap();
    let [n, c, h, w] = entry.shape[..] else {
        panic!()
    };
    let mut data = vec![f32::NAN; 10];
    for (at, channel) in (0..n * h * w).flat_map(|at| (0..c).map(move |channel| (at, channel))) {
        data.push(entry.data[(at / (h * w) * c + channel) * h * w + at % (h * w)]);
    }
    let (bytes, mut storages) = pickle(&others, PLAIN);
    let elements = data.len();
    storages.push((
        "last".into(),
        elements,
        data.iter().flat_map(|x| x.to_le_bytes()).collect(),
    ));
    let [n, c, h, w] = [n, c, h, w].map(|n| n as i64);
    let storage = |p: Pickle| p.storage("FloatStorage", "last", elements as i64, false);
    let strided =
        Pickle(vec![])
            .text(name)
            .tensor(storage, 10, &[n, c, h, w], &[h * w * c, 1, w * c, c]);
    let bytes = [&bytes[..bytes.len() - 2], &strided.0, b"u."].concat();
    assert_eq!(
        convert(&zip(&bytes, &storages)).weights,
        convert(&checkpoint(&dict, PLAIN)).weights
    );
}

/// A network with an encoder of these convolutions: name, inputs, kernel.
fn network_with(encoder: &[(&str, usize, usize)]) -> StateDict {
    let wide = 6;
    let mut dict = network_of_width(wide);
    for &(name, inputs, kernel) in encoder {
        add_layer(&mut dict, name, [wide, inputs, kernel, kernel], true);
    }
    dict
}

#[test]
fn encoder_under_either_name_keeps_its_kernel() {
    for (name, kernel) in [("dr.e2", 1), ("dr.e2.0", 3)] {
        let dict = network_with(&[(name, BACKBONE[4], kernel)]);

        let weights = convert(&checkpoint(&dict, PLAIN)).weights;

        let encoder = weights.header.architecture.encoder.unwrap();
        assert_eq!((encoder.kernel, encoder.relu), (kernel, true), "{name}");
        same_network(&weights, &dict, &[(name, "dr.e2.0")], 1e-5);
    }
}

#[test]
fn encoder_without_relu_is_linear() {
    let dict = network_with(&[("dr.e2", BACKBONE[4], 3)]);
    let options = Options {
        encoder_relu: false,
        ..Options::default()
    };

    let weights = convert_bytes(&checkpoint(&dict, PLAIN), &options)
        .unwrap()
        .weights;

    assert!(!weights.header.architecture.encoder.unwrap().relu);
}

#[test]
fn encoder_in_a_form_that_no_weights_file_has_is_refused() {
    let c5 = BACKBONE[4];
    for (encoder, expected) in [
        (
            &[("dr.e2.0", c5, 3), ("dr.e2.1", 6, 3)],
            "encoder.layers: expected 1, found 2",
        ),
        (
            &[("dr.e2_z", c5, 3), ("dr.e2_x", c5, 3)],
            "encoder.shared: expected true",
        ),
    ] {
        let dict = network_with(encoder);

        let refused = convert_bytes(&checkpoint(&dict, PLAIN), &Options::default());

        let message = refused.unwrap_err().to_string();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn training_networks_are_ignored_and_strangers_reported() {
    let mut dict = network_with_encoder();
    add_layer(&mut dict, "dr.e1", [7, 7, 3, 3], true);
    dict.insert(
        "mi.g.0.weight".into(),
        Entry {
            shape: vec![2, 2],
            data: vec![0.0; 4],
        },
    );
    dict.insert(
        "loss.weight".into(),
        Entry {
            shape: vec![1],
            data: vec![f32::NAN],
        },
    );
    let conversion = convert(&checkpoint(&dict, PLAIN));
    assert_eq!(conversion.ignored.len(), 7);
    assert!(conversion.ignored.contains(&"mi.g.0.weight".to_owned()));
    assert_eq!(conversion.unknown, ["loss.weight"]);
    assert_eq!(
        conversion.weights,
        convert(&checkpoint(&network_with_encoder(), PLAIN)).weights
    );
}

#[test]
fn deflated_archive_without_a_root_folder_is_read() {
    let (pickle, storages) = pickle(&network(), PLAIN);
    let entries = storages
        .into_iter()
        .map(|(key, _, bytes)| (format!("data/{key}"), bytes));
    let entries = [("data.pkl".to_owned(), pickle)].into_iter().chain(entries);
    let weights = convert(&archive(entries, CompressionMethod::Deflated)).weights;
    assert_eq!(weights, convert(&checkpoint(&network(), PLAIN)).weights);
}

#[test]
fn pickle_of_protocol_4_is_read() {
    // Protocol 4: a frame, short strings, memoized, STACK_GLOBAL.
    let short = |text: &str| [&[0x8c, text.len() as u8], text.as_bytes(), &[0x94]].concat();
    let dict = [
        short("collections"),
        short("OrderedDict"),
        vec![0x93, b')', b'R', 0x94],
    ]
    .concat();
    let start = [&[0x80, 4, 0x95], &999_u64.to_le_bytes()[..], &dict, b"("].concat();
    let (bytes, storages) = pickle(&network(), PLAIN);
    let bytes = [&start, &bytes[4..]].concat();
    assert_eq!(
        convert(&zip(&bytes, &storages)).weights,
        convert(&checkpoint(&network(), PLAIN)).weights
    );
}

/// A checkpoint with the state dict under `model_state_dict` and, under `beside`, what the pickle
/// `object` makes.
fn beside(dict: &StateDict, beside: &str, object: impl FnOnce(Pickle) -> Pickle) -> Vec<u8> {
    let form = Form {
        wrapper: Some("model_state_dict"),
        ..PLAIN
    };
    let (bytes, storages) = pickle(dict, form);
    let end = bytes.len() - 2; // the outer dict's SETITEMS, and the end
    let more = object(Pickle(bytes[..end].to_vec()).text(beside));
    zip(&more.raw(b"u").stop(), &storages)
}

#[test]
fn objects_of_unknown_classes_beside_the_state_dict_are_ignored() {
    let dict = network();
    let expected = convert(&checkpoint(&dict, PLAIN)).weights;
    let namespace = |p: Pickle| {
        p.global("argparse", "Namespace")
            .raw(b")\x81}")
            .text("lr")
            .raw(b"Nsb")
    };
    let path = |p: Pickle| p.global("pathlib", "PosixPath").text("/data").raw(b"\x85R");
    let default_dict = |p: Pickle| {
        p.global("collections", "defaultdict")
            .global("builtins", "int")
            .raw(b"\x85R(")
            .text("seen")
            .int(3)
            .raw(b"u")
    };
    let bytes = |p: Pickle| p.raw(b"C\x03abc");
    let objects: [(&str, &dyn Fn(Pickle) -> Pickle); 4] = [
        ("args", &namespace),
        ("root", &path),
        ("counts", &default_dict),
        ("digest", &bytes),
    ];
    for (name, object) in objects {
        let conversion = convert(&beside(&dict, name, object));

        assert_eq!(conversion.weights, expected, "{name}");
        assert!(conversion.ignored.contains(&name.to_owned()), "{name}");
    }
}

#[test]
fn expanded_tensor_with_stride_0_repeats_its_element() {
    let name = "basemodel.conv2.bn.running_var";
    let mut others = network();
    let channels = others.remove(name).unwrap().data.len();
    let mut repeated = network();
    repeated.get_mut(name).unwrap().data.fill(1.0);
    let (bytes, mut storages) = pickle(&others, PLAIN);
    storages.push(("one".into(), 1, 1.0_f32.to_le_bytes().to_vec()));
    let storage = |p: Pickle| p.storage("FloatStorage", "one", 1, false);
    let expanded = Pickle(vec![])
        .text(name)
        .tensor(storage, 0, &[channels as i64], &[0]);
    let bytes = [&bytes[..bytes.len() - 2], &expanded.0, b"u."].concat();

    let found = convert(&zip(&bytes, &storages)).weights;

    assert_eq!(found, convert(&checkpoint(&repeated, PLAIN)).weights);
}

#[test]
fn missing_tensors_are_listed_with_the_closest_name_there_is() {
    let mut dict = network();
    let entry = dict.remove("basemodel.conv1.conv.weight").unwrap();
    dict.insert("basemodel.cnv1.cnv.weight".into(), entry);

    let refusal = convert_bytes(&checkpoint(&dict, PLAIN), &Options::default()).unwrap_err();

    let text = refusal.to_string();
    assert!(
        text.contains("1 missing: basemodel.conv1.conv.weight;"),
        "{text}"
    );
    assert!(text.contains("is \"basemodel.cnv1.cnv.weight\""), "{text}");
}
