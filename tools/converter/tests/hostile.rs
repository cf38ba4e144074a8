//! Malicious and damaged checkpoints: each is refused with a message that names what is wrong.

mod common;

use common::*;
use converter::{Options, convert_bytes};
use proptest::{prelude::*, sample::Index};
use zip::CompressionMethod;

fn refused(what: &str, bytes: &[u8], expected: &str) {
    match convert_bytes(bytes, &Options::default()) {
        Ok(_) => panic!("{what}: accepted"),
        Err(refusal) => {
            let message = refusal.to_string();
            assert!(
                message.contains(expected),
                "{what}: {message:?} does not say {expected:?}"
            );
            let printable = message.len() < 1000 && !message.chars().any(char::is_control);
            assert!(printable, "{what}: {message:?} is not fit for a terminal");
        }
    }
}

/// An archive with this pickle and no storages.
fn only(pickle: Pickle) -> Vec<u8> {
    zip(&pickle.stop(), &[])
}

/// An archive with a tensor of a storage of 12 floats.
fn tensor(elements: i64, offset: i64, shape: &[i64], strides: &[i64]) -> Vec<u8> {
    only(Pickle::new().tensor(
        |p| p.storage("FloatStorage", "0", elements, false),
        offset,
        shape,
        strides,
    ))
}

#[test]
fn globals_that_run_code_and_calls_of_unknown_ones_are_refused() {
    let p = Pickle::new;
    let call = |module: &str, name: &str| {
        only(p().global(module, name).text("touch /tmp/x").raw(b"\x85R"))
    };
    for (what, bytes, expected) in [
        (
            "os.system",
            call("os", "system"),
            "expected a global of a plain state dict, found `os.system`",
        ),
        (
            "posix.system",
            call("posix", "system"),
            "found `posix.system`",
        ),
        (
            "builtins.eval",
            call("builtins", "eval"),
            "found `builtins.eval`",
        ),
        (
            "builtins.getattr",
            call("builtins", "getattr"),
            "found `builtins.getattr`",
        ),
        ("torch.load", call("torch", "load"), "found `torch.load`"),
        (
            "a whole model",
            call("models.siamese", "Tracker"),
            "found a whole object of `models.siamese.Tracker`",
        ),
        (
            "escapes in a name",
            call("a\u{1b}[2J", "x"),
            "found a whole object of `a\u{fffd}[2J.x`",
        ),
        (
            "STACK_GLOBAL",
            only(p().text("os").text("system").raw(b"\x93)R")),
            "byte 22: expected a global of a plain state dict, found `os.system`",
        ),
        (
            "STACK_GLOBAL of numbers",
            only(p().int(1).int(2).raw(b"\x93")),
            "two strings for STACK_GLOBAL",
        ),
        (
            "REDUCE of a string",
            only(p().text("x").raw(b")R")),
            "expected REDUCE of a global, found \"x\"",
        ),
        (
            "REDUCE of a type",
            only(p().global("torch", "FloatStorage").raw(b")R")),
            "no call",
        ),
        (
            "arguments that are no tuple",
            only(p().global("collections", "OrderedDict").raw(b"]R")),
            "a tuple of arguments",
        ),
        (
            "too many arguments",
            only(
                (0..9)
                    .fold(p().global("torch", "Size").raw(b"("), |p, i| p.int(i))
                    .raw(b"tR"),
            ),
            "at most 8 arguments",
        ),
        (
            "OrderedDict of something",
            only(
                p().global("collections", "OrderedDict")
                    .int(1)
                    .raw(b"\x85R"),
            ),
            "OrderedDict: expected no call",
        ),
        (
            "parameter of no tensor",
            only(
                p().global("torch._utils", "_rebuild_parameter")
                    .int(1)
                    .raw(b"\x85R"),
            ),
            "(tensor, requires_grad, hooks)",
        ),
        (
            "tensor of no storage",
            only(p().global("torch._utils", "_rebuild_tensor_v2").raw(b")R")),
            "(storage, offset, shape",
        ),
        (
            "BUILD of a list",
            only(p().raw(b"]}b")),
            "BUILD of an OrderedDict or an object",
        ),
        (
            "INST",
            only(p().raw(b"(ios\nsystem\n")),
            "expected an opcode of plain data, found opcode INST",
        ),
        ("OBJ", only(p().raw(b"(o")), "found opcode OBJ"),
        (
            "NEWOBJ of a tuple",
            only(p().raw(b"))\x81")),
            "expected NEWOBJ of a class, found a tuple of 0",
        ),
        (
            "NEWOBJ_EX of a tuple",
            only(p().raw(b")))\x92")),
            "expected NEWOBJ of a class, found a tuple of 0",
        ),
        (
            "ADDITEMS to a list",
            only(p().raw(b"](N\x90")),
            "expected ADDITEMS to a set, found a list of 0",
        ),
        ("EXT1", only(p().raw(b"\x82\x01")), "found opcode EXT"),
        ("PERSID", only(p().raw(b"P0\n")), "found opcode PERSID"),
        ("no opcode", only(p().raw(b"\xff")), "found byte 0xff"),
    ] {
        refused(what, &bytes, expected);
    }
}

#[test]
fn malformed_pickles_are_refused() {
    let p = Pickle::new;
    let long = [&[0x80, 2][..], &b"N0".repeat(3 << 20)].concat();
    for (what, bytes, expected) in [
        (
            "empty",
            zip(&[], &[]),
            "pickle, byte 0: expected 1 more bytes, found the end after 0",
        ),
        (
            "no end",
            zip(&p().raw(b"}").0, &[]),
            "found the end after 0",
        ),
        (
            "nothing at the end",
            only(p()),
            "expected a value on the stack, found none",
        ),
        (
            "protocol 9",
            zip(b"\x80\x09N.", &[]),
            "expected protocol 0 to 5, found 9",
        ),
        (
            "a string of 4 GiB",
            only(p().raw(b"X\xff\xff\xff\xff")),
            "expected 4294967295 more bytes, found the end after 1",
        ),
        (
            "a value that is no string",
            only(p().raw(b"U\x02\xc3\x28")),
            "a string in UTF-8",
        ),
        (
            "an integer of 255 bytes",
            only(p().raw(b"\x8a\xff")),
            "an integer of at most 16 bytes",
        ),
        (
            "an endless name",
            only(p().raw(b"c").raw(&[b'x'; 1000])),
            "a line of at most 255 bytes",
        ),
        (
            "pop below a mark",
            only(p().raw(b"N(\x85")),
            "a value on the stack",
        ),
        (
            "tuple without mark",
            only(p().raw(b"t")),
            "a mark on the stack",
        ),
        (
            "an odd number of items",
            only(p().raw(b"}(Nu")),
            "pairs for SETITEMS, found 1",
        ),
        (
            "items of a list",
            only(p().raw(b"]NNs")),
            "SETITEM of a dict, found a list of 0",
        ),
        (
            "append to a dict",
            only(p().raw(b"}Na")),
            "APPEND to a list, found a dict of 0",
        ),
        (
            "memo slot 7",
            only(p().raw(b"h\x07")),
            "a memo slot that was filled, found 7",
        ),
        (
            "memo slot 4 billion",
            only(p().raw(b"j\xff\xff\xff\xff")),
            "found 4294967295",
        ),
        (
            "two megabytes",
            zip(&long, &[]),
            "at most 2097152 bytes, found 6291458",
        ),
        (
            "more after the end",
            zip(&p().raw(b"}.").stop(), &[]),
            "data.pkl: expected 4 bytes",
        ),
        (
            "a number",
            only(p().int(5)),
            "checkpoint: expected a dict, found 5",
        ),
        (
            "a list of itself",
            only(p().raw(b"]q\x01h\x01a")),
            "checkpoint: expected a dict, found a list of 1",
        ),
        (
            "a dict in itself",
            only(p().raw(b"}q\x01").text("state_dict").raw(b"h\x01s")),
            "every tensor of the network",
        ),
        (
            "half a million nested lists",
            zip(
                &[
                    &[0x80, 2][..],
                    &vec![b']'; 1 << 19],
                    &vec![b'a'; (1 << 19) - 1],
                    b".",
                ]
                .concat(),
                &[],
            ),
            "checkpoint: expected a dict, found a list of 1",
        ),
        (
            "half a million nested tuples",
            zip(
                &[&[0x80, 2][..], b")", &vec![0x85; 1 << 19], b"."].concat(),
                &[],
            ),
            "checkpoint: expected a dict, found a tuple of 1",
        ),
        (
            "numbers as keys",
            only(p().raw(b"}").int(1).int(1).raw(b"s")),
            "strings as keys, found 1",
        ),
        (
            "a key twice",
            only(p().raw(b"}(").text("a").raw(b"N").text("a").raw(b"Nu")),
            "key \"a\": expected one entry, found two",
        ),
        (
            "a value that is no state dict",
            only(p().raw(b"}").text("model_state_dict").raw(b"Ns")),
            "model_state_dict: expected a dict, found None",
        ),
        (
            "nothing in it",
            only(p().raw(b"}")),
            "94 missing: basemodel.conv1.conv.weight",
        ),
    ] {
        refused(what, &bytes, expected);
    }
}

#[test]
fn tensors_outside_their_storage_are_refused() {
    let p = Pickle::new;
    let within = "tensor: expected elements within its storage of 12";
    let id = |parts: &dyn Fn(Pickle) -> Pickle| only(parts(p().raw(b"(")).raw(b"tQ"));
    let key = "k".repeat(65);
    for (what, bytes, expected) in [
        ("one element too many", tensor(12, 0, &[13], &[1]), within),
        ("offset", tensor(12, 1, &[3, 4], &[4, 1]), within),
        ("stride", tensor(12, 0, &[3, 4], &[5, 1]), within),
        (
            "all elements the same",
            tensor(12, 0, &[1 << 20, 1 << 20], &[0, 0]),
            within,
        ),
        (
            "a product beyond 64 bits",
            tensor(12, 0, &[1 << 40, 1 << 40], &[1, 1]),
            within,
        ),
        (
            "a stride beyond 64 bits",
            tensor(12, 0, &[2, 3], &[i64::MAX, i64::MAX]),
            within,
        ),
        (
            "an offset beyond 64 bits",
            tensor(12, i64::MAX, &[2], &[i64::MAX]),
            within,
        ),
        (
            "a negative offset",
            tensor(12, -1, &[2], &[1]),
            "size: expected a non-negative integer, found -1",
        ),
        (
            "a negative length",
            tensor(12, 0, &[-2], &[1]),
            "a non-negative integer, found -2",
        ),
        (
            "a negative stride",
            tensor(12, 11, &[2], &[-1]),
            "a non-negative integer, found -1",
        ),
        (
            "a negative storage",
            tensor(-1, 0, &[0], &[1]),
            "a non-negative integer, found -1",
        ),
        (
            "a storage beyond memory",
            tensor(i64::MAX, 0, &[1], &[1]),
            "storage \"0\": expected a length that fits memory",
        ),
        (
            "no stride for a dimension",
            tensor(12, 0, &[3, 4], &[1]),
            "as many strides as dimensions",
        ),
        (
            "nine dimensions",
            tensor(12, 0, &[1; 9], &[1; 9]),
            "at most 8, found 9 and 9",
        ),
        (
            "an id that is text",
            only(p().text("0").raw(b"Q")),
            "persistent id: expected one of a storage, found \"0\"",
        ),
        (
            "a storage of complex numbers",
            id(&|p| {
                p.text("storage")
                    .global("torch", "ComplexFloatStorage")
                    .text("0")
                    .text("cpu")
                    .int(1)
            }),
            "bool type, found `torch.ComplexFloatStorage`",
        ),
        (
            "an id of something else",
            id(&|p| {
                p.text("module")
                    .global("torch", "FloatStorage")
                    .text("0")
                    .text("cpu")
                    .int(1)
            }),
            "found \"module\"",
        ),
        (
            "an id that is short",
            id(&|p| p.text("storage")),
            "found a tuple of 1",
        ),
        (
            "an id of no type",
            id(&|p| {
                p.text("storage")
                    .text("FloatStorage")
                    .text("0")
                    .text("cpu")
                    .int(1)
            }),
            "one of a storage",
        ),
        (
            "a long key",
            only(p().storage("FloatStorage", &key, 1, false)),
            "a key of at most 64 bytes, found 65",
        ),
        (
            "a view",
            id(&|p| {
                p.text("storage")
                    .global("torch", "FloatStorage")
                    .text("0")
                    .text("cpu")
                    .int(1)
                    .ints(&[0, 1])
            }),
            "no view of another storage",
        ),
    ] {
        refused(what, &bytes, expected);
    }
}

#[test]
fn malformed_archives_are_refused() {
    let dict = network();
    let (pickle, storages) = pickle(&dict, PLAIN);
    let good = zip(&pickle, &storages);
    let without = |name: &str| {
        let kept: Vec<_> = storages
            .iter()
            .filter(|(key, ..)| key != name)
            .cloned()
            .collect();
        zip(&pickle, &kept)
    };
    let other = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut changed = storages.clone();
        change(&mut changed[3].2);
        zip(&pickle, &changed)
    };
    let entries = |list: &[(&str, &[u8])]| {
        archive(
            list.iter()
                .map(|(name, bytes)| (name.to_string(), bytes.to_vec())),
            CompressionMethod::Stored,
        )
    };
    let mut flipped = good.clone();
    let at = flipped
        .windows(5)
        .position(|window| window == &storages[3].2[..5])
        .unwrap();
    flipped[at] ^= 1;
    // Two names of the same length, made one.
    let mut doubled = entries(&[("a/data.pkl", &pickle), ("b/data.pkl", &pickle)]);
    while let Some(at) = doubled
        .windows(10)
        .position(|window| window == b"b/data.pkl")
    {
        doubled[at] = b'a';
    }
    for (what, bytes, expected) in [
        (
            "empty",
            vec![],
            "file: expected a PyTorch checkpoint (zip archive, legacy stream or safetensors), found first bytes []",
        ),
        (
            "text",
            b"hello world".to_vec(),
            "first bytes [68, 65, 6c, 6c]",
        ),
        (
            "the start of a zip",
            b"PK\x03\x04".to_vec(),
            "file: expected a zip archive",
        ),
        (
            "a zip cut short",
            good[..good.len() - 30].to_vec(),
            "file: expected a zip archive",
        ),
        (
            "no pickle",
            entries(&[("net/version", b"3")]),
            "expected one entry `data.pkl`, found 0",
        ),
        (
            "two pickles",
            entries(&[("a/data.pkl", &pickle), ("b/data.pkl", &pickle)]),
            "found 2",
        ),
        ("one name twice", doubled, "every name once"),
        (
            "big-endian",
            entries(&[("n/data.pkl", &pickle), ("n/byteorder", b"big")]),
            "byteorder: expected little, found big",
        ),
        (
            "a long byteorder",
            entries(&[("n/data.pkl", &pickle), ("n/byteorder", &[b'x'; 99])]),
            "at most 16 bytes, found 99",
        ),
        (
            "a storage missing",
            without("3"),
            "expected an entry \"data/3\", found none",
        ),
        (
            "a storage too short",
            other(&|s| s.truncate(4)),
            "storage \"3\"",
        ),
        (
            "a storage too long",
            other(&|s| s.push(0)),
            "zip entry \"net/data/3\": expected at most",
        ),
        (
            "a flipped bit",
            flipped,
            "zip entry \"net/data/3\": expected readable data",
        ),
    ] {
        refused(what, &bytes, expected);
    }
}

#[test]
fn decompression_is_bounded() {
    // 64 MiB of zeros deflate to 64 KiB; the pickle asks for one element of them.
    let (pickle, mut storages) = pickle(&network(), PLAIN);
    storages[3].2 = vec![0; 64 << 20];
    let entries = storages
        .into_iter()
        .map(|(key, _, bytes)| (format!("net/data/{key}"), bytes));
    let entries = [("net/data.pkl".to_owned(), pickle)]
        .into_iter()
        .chain(entries);
    let mut bomb = archive(entries, CompressionMethod::Deflated);
    refused(
        "a bomb",
        &bomb,
        "zip entry \"net/data/3\": expected at most",
    );
    // The same, with a false size in the directory.
    let real = (64_u32 << 20).to_le_bytes();
    let places: Vec<_> = bomb
        .windows(4)
        .enumerate()
        .filter(|(_, w)| *w == real)
        .map(|(i, _)| i)
        .collect();
    assert!(!places.is_empty());
    places
        .into_iter()
        .for_each(|i| bomb[i..i + 4].copy_from_slice(&4_u32.to_le_bytes()));
    refused("a bomb that lies", &bomb, "zip entry \"net/data/3\"");
}

#[test]
fn malformed_legacy_streams_are_refused() {
    let form = Form {
        legacy: true,
        ..PLAIN
    };
    let (pickle, storages) = pickle(&network(), form);
    let good = legacy(&pickle, &storages);
    let start = legacy_start();
    let with = |change: &dyn Fn(&mut Vec<Stored>)| {
        let mut changed = storages.clone();
        change(&mut changed);
        legacy(&pickle, &changed)
    };
    let mut big_endian = good.clone();
    let at = big_endian
        .windows(3)
        .position(|window| window == b"\x88u.")
        .unwrap();
    big_endian[at] = 0x89;
    let key = |k: &str| Pickle::new().storage("FloatStorage", k, 1, true);
    let conflict = key("0")
        .storage("DoubleStorage", "0", 1, true)
        .raw(b"\x86")
        .stop();
    let p = Pickle::new;
    for (what, bytes, expected) in [
        (
            "another number",
            [&p().int(5).stop()[..], &start].concat(),
            "magic number: expected 119547037146038801333356, found 5",
        ),
        (
            "another version",
            [&start[..15], &p().int(1002).stop()].concat(),
            "version: expected 1001, found 1002",
        ),
        (
            "big-endian",
            big_endian,
            "little_endian = true, found false",
        ),
        (
            "nothing after the header",
            start.clone(),
            "from byte 70: pickle, byte 0",
        ),
        (
            "no list of keys",
            [&start[..], &p().raw(b"}").stop(), &p().raw(b"}").stop()].concat(),
            "storage keys: expected a list",
        ),
        (
            "keys that are numbers",
            [
                &start[..],
                &p().raw(b"}").stop(),
                &p().raw(b"](").int(1).raw(b"e").stop(),
            ]
            .concat(),
            "storage keys: expected strings, found 1",
        ),
        (
            "a key that nobody uses",
            with(&|s| s.push(("more".into(), 0, vec![]))),
            "storage \"more\": expected a tensor that uses it",
        ),
        (
            "a key twice",
            with(&|s| s.push(s[0].clone())),
            "expected one entry, found two",
        ),
        (
            "a storage missing",
            with(&|s| drop(s.remove(3))),
            "storage \"3\": expected its data, found none",
        ),
        ("another count", with(&|s| s[3].1 += 1), "elements, found"),
        (
            "a negative count",
            with(&|s| s[3].1 = usize::MAX),
            "elements, found -1",
        ),
        (
            "one storage, two types",
            legacy(&conflict, &[]),
            "storage \"0\": expected StorageRef",
        ),
        (
            "cut short",
            good[..good.len() - 1].to_vec(),
            "storage \"counter\": expected 8 bytes, found the end after 7",
        ),
        (
            "more after the last storage",
            [&good[..], &[0]].concat(),
            "expected its end after the last storage, found 1 more bytes",
        ),
    ] {
        refused(what, &bytes, expected);
    }
}

#[test]
fn tensors_of_another_network_are_refused() {
    let with = |change: &dyn Fn(&mut StateDict)| {
        let mut dict = network_with_encoder();
        change(&mut dict);
        checkpoint(&dict, PLAIN)
    };
    let scalar = |value| Entry {
        shape: vec![],
        data: vec![value],
    };
    let set = |name: &'static str, value: f32| with(&|d| d.get_mut(name).unwrap().data[0] = value);
    for (what, bytes, expected) in [
        (
            "a weight missing",
            with(&|d| drop(d.remove("c_x.conv.weight"))),
            "found 1 missing: c_x.conv.weight",
        ),
        (
            "a bias missing",
            with(&|d| drop(d.remove("r_x.conv.bias"))),
            "found 1 missing: r_x.conv.bias",
        ),
        (
            "a variance missing",
            with(&|d| drop(d.remove("dr.e2.bn.running_var"))),
            "1 missing: dr.e2.bn.running_var",
        ),
        (
            "a scalar missing",
            with(&|d| drop(d.remove("head.si"))),
            "1 missing: head.si",
        ),
        (
            "a scalar with a dimension",
            with(&|d| {
                drop(d.insert(
                    "head.si".into(),
                    Entry {
                        shape: vec![1],
                        data: vec![1.0],
                    },
                ))
            }),
            "tensor \"head.si\": expected shape [], found shape [1]",
        ),
        (
            "a weight of two dimensions",
            with(&|d| d.get_mut("r_z_k.conv.weight").unwrap().shape = vec![8, 90]),
            "tensor \"r_z_k.conv.weight\": expected four dimensions, found shape [8, 90]",
        ),
        (
            "no outputs",
            with(&|d| {
                drop(d.insert(
                    "c_z_k.conv.weight".into(),
                    Entry {
                        shape: vec![0, 10, 3, 3],
                        data: vec![],
                    },
                ))
            }),
            "widths[5]: expected 1..=2048, found 0",
        ),
        (
            "another kernel",
            with(&|d| add_layer(d, "basemodel.conv2", [5, 3, 3, 3], true)),
            "tensor \"basemodel.conv2.conv.weight\": expected shape [5, 3, 5, 5], found shape [5, 3, 3, 3]",
        ),
        (
            "a broken chain",
            with(&|d| add_layer(d, "basemodel.conv3", [4, 6, 3, 3], true)),
            "tensor \"basemodel.conv3.conv.weight\": expected shape [4, 5, 3, 3], found shape [4, 6, 3, 3]",
        ),
        (
            "necks of two widths",
            with(&|d| add_layer(d, "c_x", [6, 10, 3, 3], true)),
            "tensor \"c_x.conv.weight\": expected shape [5, 10, 3, 3], found shape [6, 10, 3, 3]",
        ),
        (
            "two scores",
            with(&|d| add_layer(d, "head.cls_score_p5", [2, 3, 1, 1], true)),
            "tensor \"head.cls_score_p5.conv.weight\": expected shape [1, 3, 1, 1]",
        ),
        (
            "a wide encoder kernel",
            with(&|d| add_layer(d, "dr.e2", [10, 7, 5, 5], true)),
            "encoder.kernel: expected 1 or 3, found 5",
        ),
        (
            "a short bias",
            with(&|d| {
                drop(d.insert(
                    "c_x.conv.bias".into(),
                    Entry {
                        shape: vec![4],
                        data: vec![0.0; 4],
                    },
                ))
            }),
            "tensor \"c_x.conv.bias\": expected shape [5], found shape [4]",
        ),
        (
            "a BN where there is none",
            with(&|d| add_layer(d, "head.cls_p5_conv1", [9, 5, 3, 3], true)),
            "tensor \"head.cls_p5_conv1.bn.bias\": expected no tensor of this name in this network",
        ),
        (
            "a second encoder layer",
            with(&|d| add_layer(d, "dr.e2.1", [10, 10, 3, 3], true)),
            "tensor \"dr.e2.1.",
        ),
        (
            "a gate",
            with(&|d| drop(d.insert("c_x.gate.weight".into(), scalar(1.0)))),
            "tensor \"c_x.gate.weight\": expected a network without dynamic channel weighting",
        ),
        (
            "NaN",
            set("basemodel.conv1.conv.weight", f32::NAN),
            "tensor \"basemodel.conv1.conv.weight\": expected finite values, found NaN at element 0",
        ),
        (
            "infinity",
            set("head.bi", f32::INFINITY),
            "tensor \"head.bi\": expected finite values, found inf",
        ),
        (
            "a negative variance",
            set("c_x.bn.running_var", -1e-6),
            "tensor \"c_x.bn.running_var\": expected no negative variance",
        ),
        (
            "too large for f32",
            set("head.si", 3e38),
            "converted weights: expected values that fit f32",
        ),
        (
            "integers",
            checkpoint(
                &network(),
                Form {
                    dtype: "Long",
                    ..PLAIN
                },
            ),
            "tensor \"basemodel.conv1.conv.weight\": expected a floating-point type",
        ),
        (
            "with and without module.",
            {
                let (bytes, storages) = pickle(&network(), PLAIN);
                let again = Pickle(vec![])
                    .text("module.basemodel.conv2.bn.num_batches_tracked")
                    .raw(b"h\x05u.");
                zip(&[&bytes[..bytes.len() - 2], &again.0].concat(), &storages)
            },
            "key \"basemodel.conv2.bn.num_batches_tracked\": expected one entry, found two",
        ),
    ] {
        refused(what, &bytes, expected);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn checkpoint_cut_anywhere_is_refused(at in any::<Index>(), legacy in any::<bool>()) {
        let bytes = checkpoint(&network(), Form { legacy, ..PLAIN });
        prop_assert!(convert_bytes(&bytes[..at.index(bytes.len())], &Options::default()).is_err());
    }

    #[test]
    fn changed_bytes_cause_no_panic(
        changes in prop::collection::vec((any::<Index>(), any::<u8>()), 1..5),
        legacy in any::<bool>(),
    ) {
        let mut bytes = checkpoint(&network(), Form { legacy, ..PLAIN });
        for (at, byte) in changes {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        let _ = convert_bytes(&bytes, &Options::default());
    }

    #[test]
    fn changed_bytes_of_the_pickle_cause_no_panic(
        changes in prop::collection::vec((any::<Index>(), any::<u8>()), 1..4),
    ) {
        let (mut pickle, storages) = pickle(&network(), PLAIN);
        for (at, byte) in changes {
            let at = at.index(pickle.len());
            pickle[at] = byte;
        }
        let _ = convert_bytes(&zip(&pickle, &storages), &Options::default());
    }

    #[test]
    fn random_opcodes_cause_no_panic(
        opcodes in prop::collection::vec(prop::sample::select(&b"\x80\x95(N\x88\x89JKM\x8aGXT\x8cU}])t\x85\x86\x87aesuqr\x94hjc\x93RbQ.\x00\x01\x02\n"[..]), 0..200),
    ) {
        let _ = convert_bytes(&zip(&[&opcodes[..], b"."].concat(), &[]), &Options::default());
    }
}
