//! Checkpoints made by the tests themselves: a pickle writer, both containers, and small networks.

// Every test program uses its own part of this.
#![allow(dead_code)]

use std::{collections::BTreeMap, io::Write};
use zip::{CompressionMethod, ZipWriter, write::SimpleFileOptions};

/// A tensor of a state dict.
#[derive(Clone, Debug)]
pub struct Entry {
    pub shape: Vec<usize>,
    pub data: Vec<f32>,
}

/// Names and tensors.
pub type StateDict = BTreeMap<String, Entry>;

/// Output channels of a small network, all different, in the order of the layers.
pub const BACKBONE: [usize; 5] = [3, 5, 4, 6, 7];
pub const NECK: [usize; 2] = [5, 8];
pub const HEAD_CLS: [usize; 3] = [9, 2, 3];
pub const HEAD_REG: [usize; 3] = [4, 6, 5];

/// Values that look random, in -1..1.
pub fn noise(n: usize, seed: &str) -> Vec<f32> {
    let seed = seed
        .bytes()
        .fold(7.0, |sum, byte| (sum * 31.0 + f64::from(byte)) % 1009.0);
    (0..n)
        .map(|i| ((i as f64 + 1.0) * (seed + 12.9898)).sin() as f32)
        .collect()
}

/// Adds a convolution with noise in it, and a batch normalization if asked for.
pub fn add_layer(dict: &mut StateDict, prefix: &str, shape: [usize; 4], bn: bool) {
    let mut add = |name: &str, shape: &[usize], positive: bool| {
        let name = format!("{prefix}.{name}");
        let mut data = noise(shape.iter().product(), &name);
        if positive {
            data.iter_mut().for_each(|x| *x = 0.1 + x.abs());
        }
        dict.insert(
            name,
            Entry {
                shape: shape.to_vec(),
                data,
            },
        );
    };
    let outputs = &shape[..1];
    add("conv.weight", &shape, false);
    add("conv.bias", outputs, false);
    if bn {
        add("bn.weight", outputs, false);
        add("bn.bias", outputs, false);
        add("bn.running_mean", outputs, false);
        add("bn.running_var", outputs, true);
    }
}

/// PyTorch name, our name, kernel, input, output, BN of every layer but the encoder's; `e` is what
/// reaches the neck.
pub fn layers(e: usize) -> Vec<(String, String, usize, usize, usize, bool)> {
    let mut layers = Vec::new();
    let mut input = 3;
    for (i, &n) in BACKBONE.iter().enumerate() {
        let kernel = [11, 5, 3, 3, 3][i];
        layers.push((
            format!("basemodel.conv{}", i + 1),
            format!("backbone.conv{}", i + 1),
            kernel,
            input,
            n,
            true,
        ));
        input = n;
    }
    for (theirs, ours, n) in [
        ("c_z_k", "neck.template_cls", NECK[0]),
        ("r_z_k", "neck.template_reg", NECK[1]),
        ("c_x", "neck.search_cls", NECK[0]),
        ("r_x", "neck.search_reg", NECK[1]),
    ] {
        layers.push((theirs.into(), ours.into(), 3, e, n, true));
    }
    for (theirs, ours, mut input, widths) in [
        ("cls", "cls", NECK[0], HEAD_CLS),
        ("bbox", "reg", NECK[1], HEAD_REG),
    ] {
        for (i, n) in widths.into_iter().enumerate() {
            let i = i + 1;
            layers.push((
                format!("head.{theirs}_p5_conv{i}"),
                format!("head.{ours}{i}"),
                3,
                input,
                n,
                i == 3,
            ));
            input = n;
        }
    }
    layers.push((
        "head.cls_score_p5".into(),
        "head.score".into(),
        1,
        HEAD_CLS[2],
        1,
        true,
    ));
    layers.push((
        "head.ctr_score_p5".into(),
        "head.centerness".into(),
        1,
        HEAD_CLS[2],
        1,
        true,
    ));
    layers.push((
        "head.bbox_offsets_p5".into(),
        "head.offsets".into(),
        1,
        HEAD_REG[2],
        4,
        true,
    ));
    layers
}

/// A small network without an encoder.
pub fn network() -> StateDict {
    network_of_width(BACKBONE[4])
}

/// A small network whose neck expects `e` channels.
pub fn network_of_width(e: usize) -> StateDict {
    let mut dict = StateDict::new();
    for (theirs, _, kernel, input, output, bn) in layers(e) {
        add_layer(&mut dict, &theirs, [output, input, kernel, kernel], bn);
    }
    dict.insert(
        "head.si".into(),
        Entry {
            shape: vec![],
            data: vec![0.75],
        },
    );
    dict.insert(
        "head.bi".into(),
        Entry {
            shape: vec![],
            data: vec![-0.5],
        },
    );
    dict
}

/// A small network with the default encoder.
pub fn network_with_encoder() -> StateDict {
    let mut dict = network_of_width(10);
    add_layer(&mut dict, "dr.e2", [10, BACKBONE[4], 3, 3], true);
    dict
}

/// Bytes of a pickle, opcode by opcode.
#[derive(Clone, Default)]
pub struct Pickle(pub Vec<u8>);

impl Pickle {
    /// The beginning of protocol 2.
    pub fn new() -> Pickle {
        Pickle(vec![0x80, 2])
    }

    pub fn raw(mut self, bytes: &[u8]) -> Pickle {
        self.0.extend(bytes);
        self
    }

    pub fn text(self, text: &str) -> Pickle {
        self.raw(b"X")
            .raw(&(text.len() as u32).to_le_bytes())
            .raw(text.as_bytes())
    }

    /// Any integer, as LONG1.
    pub fn int(self, value: i64) -> Pickle {
        self.raw(&[0x8a, 8]).raw(&value.to_le_bytes())
    }

    pub fn ints(self, values: &[i64]) -> Pickle {
        values
            .iter()
            .fold(self.raw(b"("), |pickle, &value| pickle.int(value))
            .raw(b"t")
    }

    pub fn global(self, module: &str, name: &str) -> Pickle {
        self.raw(b"c")
            .raw(module.as_bytes())
            .raw(b"\n")
            .raw(name.as_bytes())
            .raw(b"\n")
    }

    /// A storage as a persistent id; the legacy form has a sixth part.
    pub fn storage(self, class: &str, key: &str, elements: i64, legacy: bool) -> Pickle {
        let pickle = self
            .raw(b"(")
            .text("storage")
            .global("torch", class)
            .text(key)
            .text("cpu")
            .int(elements);
        if legacy {
            pickle.raw(b"NtQ")
        } else {
            pickle.raw(b"tQ")
        }
    }

    /// A tensor on a storage that `storage` writes.
    pub fn tensor(
        self,
        storage: impl FnOnce(Pickle) -> Pickle,
        offset: i64,
        shape: &[i64],
        strides: &[i64],
    ) -> Pickle {
        let pickle = storage(self.global("torch._utils", "_rebuild_tensor_v2").raw(b"("));
        let pickle = pickle.int(offset).ints(shape).ints(strides).raw(&[0x89]);
        pickle.global("collections", "OrderedDict").raw(b")RtR")
    }

    pub fn stop(self) -> Vec<u8> {
        self.raw(b".").0
    }
}

/// A storage: key, number of elements, bytes.
pub type Stored = (String, usize, Vec<u8>);

/// How a checkpoint is written.
#[derive(Clone, Copy)]
pub struct Form {
    /// Keys around the state dict, beside which other things lie.
    pub wrapper: Option<&'static str>,
    /// In front of every name.
    pub prefix: &'static str,
    /// An OrderedDict with attributes, as `state_dict()` returns it, and its tensors as parameters.
    pub ordered: bool,
    pub legacy: bool,
    pub dtype: &'static str,
}

pub const PLAIN: Form = Form {
    wrapper: None,
    prefix: "",
    ordered: false,
    legacy: false,
    dtype: "Float",
};

/// The pickle of a checkpoint, and its storages.
pub fn pickle(dict: &StateDict, form: Form) -> (Vec<u8>, Vec<Stored>) {
    let mut pickle = Pickle::new();
    let mut storages = Vec::new();
    let class = format!("{}Storage", form.dtype);
    if let Some(wrapper) = form.wrapper {
        pickle = pickle
            .raw(b"}(")
            .text("epoch")
            .int(7)
            .text("optimizer_state_dict");
        // A dict with an integer as key, floats, booleans, None, and a tensor of its own.
        pickle = pickle
            .raw(b"}(")
            .int(0)
            .raw(b"](G")
            .raw(&0.9_f64.to_be_bytes())
            .raw(&[0x88, 0x89, b'N', b'e']);
        let momentum = |p: Pickle| p.storage("FloatStorage", "momentum", 2, form.legacy);
        pickle = pickle
            .text("state")
            .tensor(momentum, 0, &[2], &[1])
            .raw(b"u")
            .text(wrapper);
        storages.push(("momentum".into(), 2, vec![0; 8]));
    }
    pickle = if form.ordered {
        pickle.global("collections", "OrderedDict").raw(b")R(")
    } else {
        pickle.raw(b"}(")
    };
    for (i, (name, entry)) in dict.iter().enumerate() {
        let key = format!("{i}");
        let elements = entry.data.len();
        let shape: Vec<i64> = entry.shape.iter().map(|&n| n as i64).collect();
        let mut strides = vec![1; shape.len()];
        for i in (1..shape.len()).rev() {
            strides[i - 1] = strides[i] * shape[i];
        }
        pickle = pickle.text(&format!("{}{name}", form.prefix));
        if form.ordered {
            pickle = pickle
                .global("torch._utils", "_rebuild_parameter")
                .raw(b"(");
        }
        pickle = pickle.tensor(
            |p| p.storage(&class, &key, elements as i64, form.legacy),
            0,
            &shape,
            &strides,
        );
        if form.ordered {
            pickle = pickle
                .raw(&[0x88])
                .global("collections", "OrderedDict")
                .raw(b")RtR");
        }
        storages.push((key, elements, encode(&entry.data, form.dtype)));
    }
    // The counters, one for all: names that share a tensor through the memo.
    pickle = pickle.text(&format!(
        "{}basemodel.conv1.bn.num_batches_tracked",
        form.prefix
    ));
    pickle = pickle
        .tensor(
            |p| p.storage("LongStorage", "counter", 1, form.legacy),
            0,
            &[],
            &[],
        )
        .raw(b"q\x05");
    pickle = pickle
        .text(&format!(
            "{}basemodel.conv2.bn.num_batches_tracked",
            form.prefix
        ))
        .raw(b"h\x05");
    storages.push(("counter".into(), 1, 1000_i64.to_le_bytes().to_vec()));
    pickle = pickle.raw(b"u");
    if form.ordered {
        pickle = pickle.raw(b"}").text("_metadata").raw(b"}sb");
    }
    if form.wrapper.is_some() {
        pickle = pickle.raw(b"u");
    }
    (pickle.stop(), storages)
}

fn encode(data: &[f32], dtype: &str) -> Vec<u8> {
    match dtype {
        "Float" => data.iter().flat_map(|x| x.to_le_bytes()).collect(),
        "Double" => data
            .iter()
            .flat_map(|&x| f64::from(x).to_le_bytes())
            .collect(),
        "Half" => data
            .iter()
            .flat_map(|&x| half::f16::from_f32(x).to_le_bytes())
            .collect(),
        "BFloat16" => data
            .iter()
            .flat_map(|&x| half::bf16::from_f32(x).to_le_bytes())
            .collect(),
        _ => data
            .iter()
            .flat_map(|&x| (x as i64).to_le_bytes())
            .collect(),
    }
}

/// A checkpoint in the form asked for.
pub fn checkpoint(dict: &StateDict, form: Form) -> Vec<u8> {
    let (pickle, storages) = pickle(dict, form);
    if form.legacy {
        legacy(&pickle, &storages)
    } else {
        zip(&pickle, &storages)
    }
}

/// A zip archive as torch writes it.
pub fn zip(pickle: &[u8], storages: &[Stored]) -> Vec<u8> {
    let data = storages
        .iter()
        .map(|(key, _, bytes)| (format!("net/data/{key}"), bytes.clone()));
    let fixed = [
        ("net/data.pkl".to_owned(), pickle.to_vec()),
        ("net/byteorder".to_owned(), b"little".to_vec()),
    ];
    archive(fixed.into_iter().chain(data), CompressionMethod::Stored)
}

/// A zip archive of any entries.
pub fn archive(
    entries: impl IntoIterator<Item = (String, Vec<u8>)>,
    method: CompressionMethod,
) -> Vec<u8> {
    let mut writer = ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(method);
    for (name, bytes) in entries {
        writer.start_file(name, options).unwrap();
        writer.write_all(&bytes).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// The three pickles in front of a legacy stream's object.
pub fn legacy_start() -> Vec<u8> {
    let magic = 0x1950_a86a_20f9_469c_fc6c_u128.to_le_bytes();
    let mut bytes = Pickle::new().raw(&[0x8a, 10]).raw(&magic[..10]).stop();
    bytes.extend(Pickle::new().raw(b"M\xe9\x03").stop());
    let system = Pickle::new()
        .raw(b"}(")
        .text("protocol_version")
        .raw(b"M\xe9\x03")
        .text("little_endian");
    bytes.extend(system.raw(b"\x88u").stop());
    bytes
}

/// A legacy stream.
pub fn legacy(pickle: &[u8], storages: &[Stored]) -> Vec<u8> {
    let mut bytes = legacy_start();
    bytes.extend(pickle);
    let keys = storages
        .iter()
        .fold(Pickle::new().raw(b"]("), |pickle, (key, ..)| {
            pickle.text(key)
        });
    bytes.extend(keys.raw(b"e").stop());
    for (_, elements, data) in storages {
        bytes.extend((*elements as i64).to_le_bytes());
        bytes.extend(data);
    }
    bytes
}
